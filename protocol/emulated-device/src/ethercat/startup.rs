//! Objects that the start-up commands of a file write and its dictionary does not have: a device takes the commands of its own file.

use std::borrow::Cow;

use device_files::{ChosenSubDevice, DictionaryEntry, DictionaryObject};

/// Returns the objects of the dictionary, with those that only start-up commands name. Commands with complete access name no entries.
pub(super) fn with_commanded(chosen: &ChosenSubDevice) -> Vec<Cow<'_, DictionaryObject>> {
    let dictionary = chosen.dictionary.iter().flat_map(|dictionary| &dictionary.objects);
    let mut objects: Vec<_> = dictionary.map(Cow::Borrowed).collect();
    let coe = chosen.mailbox.iter().filter_map(|mailbox| mailbox.coe.as_ref());
    for command in coe.flat_map(|coe| &coe.init_commands).filter(|command| !command.is_complete_access) {
        let Ok(bits) = u32::try_from(8 * command.data.len()) else { continue };
        let entry = DictionaryEntry {
            subindex: command.subindex,
            name: String::new(),
            data_type: String::new(),
            bits,
            access: "rw".to_owned(),
            default: Vec::new(),
        };
        let known = objects.iter().position(|object| object.index == command.index);
        let position = known.unwrap_or_else(|| {
            objects.push(Cow::Owned(DictionaryObject {
                index: command.index,
                depends_on_slot: false,
                name: String::new(),
                data_type: String::new(),
                bits,
                access: "rw".to_owned(),
                default: Vec::new(),
                entries: Vec::new(),
            }));
            objects.len() - 1
        });
        let Some(object) = objects.get_mut(position) else { continue };
        // A variable has its value in subindex 0.
        let has = object.entries.iter().any(|it| it.subindex == command.subindex)
            || object.entries.is_empty() && command.subindex == 0;
        if !has {
            object.to_mut().entries.push(entry);
        }
    }
    objects
}
