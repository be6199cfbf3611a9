//! The IO-Device by what the wire shows: its modules are those that it reports.

use std::collections::BTreeSet;

use super::config::{DeviceChoice, ModulePlace};
use super::error::ChoiceError;
use super::gsdml::{ChosenIoDevice, find_access_point, make};
use crate::gsdml::{AccessPoint, Gsdml, GsdmlModule, Placement};

/// Module that a device reports.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct FoundModule {
    /// Slot.
    pub slot: u16,
    /// ModuleIdentNumber.
    pub ident: u32,
    /// Subslot and SubmoduleIdentNumber of each submodule.
    pub submodules: Vec<(u16, u32)>,
}

/// First subslot of interface and ports, which belong to the access point.
const FIRST_SYSTEM_SUBSLOT: u16 = 0x8000;

/// Makes the device of the access point alone, so that it can be asked for its modules.
///
/// # Errors
///
/// The access point is not in the file, or there are several and none is chosen.
pub fn choose_head(gsdml: &Gsdml, choice: &DeviceChoice) -> Result<ChosenIoDevice, ChoiceError> {
    let access_point = find_access_point(gsdml, choice.access_point.as_deref())?;
    make(gsdml, &head_alone(access_point, choice), false)
}

/// Returns the slot of the access point itself.
fn head_slot(access_point: &AccessPoint) -> u16 {
    access_point.fixed_in_slots.iter().next().unwrap_or(0)
}

/// Returns the choice of the access point with nothing plugged but what is fixed there.
fn head_alone(access_point: &AccessPoint, choice: &DeviceChoice) -> DeviceChoice {
    let mut head = DeviceChoice { access_point: choice.access_point.clone(), ..DeviceChoice::default() };
    for slot in preset_places(&access_point.modules) {
        head.modules.insert(ModulePlace { slot, subslot: None }, DeviceChoice::EMPTY.to_owned());
    }
    leave_subslots_empty(&access_point.module, head_slot(access_point), &mut head);
    head
}

/// Leaves those subslots of a module empty that a new configuration fills.
fn leave_subslots_empty(module: &GsdmlModule, slot: u16, wanted: &mut DeviceChoice) {
    let preset = preset_places(&module.pluggable);
    for subslot in preset.into_iter().filter(|subslot| *subslot < FIRST_SYSTEM_SUBSLOT) {
        let place = ModulePlace { slot, subslot: Some(subslot) };
        wanted.modules.insert(place, DeviceChoice::EMPTY.to_owned());
    }
}

/// Places that one placement may take of a file whose ranges have up to 65,536.
const MOST_PLACES: usize = 4096;

/// Returns the places that a new configuration fills and the user may empty.
fn preset_places(placements: &[Placement]) -> BTreeSet<u16> {
    let mut places: BTreeSet<u16> =
        placements.iter().flat_map(|placement| placement.used.iter().take(MOST_PLACES)).collect();
    for fixed in placements.iter().flat_map(|placement| placement.fixed.iter().take(MOST_PLACES)) {
        places.remove(&fixed);
    }
    places
}

/// Makes the device of the modules that it reports, and says which of them the file does not have; these are left out.
///
/// # Errors
///
/// The modules do not fit together by the file.
pub fn choose_found(
    gsdml: &Gsdml,
    choice: &DeviceChoice,
    found: &[FoundModule],
) -> Result<(ChosenIoDevice, Vec<String>), ChoiceError> {
    let access_point = find_access_point(gsdml, choice.access_point.as_deref())?;
    let head_slot = head_slot(access_point);
    let mut wanted = head_alone(access_point, choice);
    let mut unknown = Vec::new();
    for FoundModule { slot, ident, submodules } in found {
        let module = match *slot == head_slot {
            true => Some(&access_point.module),
            false => module_of(gsdml, access_point, *slot, *ident),
        };
        let Some(module) = module.filter(|module| module.ident == *ident) else {
            unknown.push(format!(
                "slot {slot}: the device has module 0x{ident:08X}, which the file does not have there; it is left out"
            ));
            continue;
        };
        if *slot != head_slot {
            wanted.modules.insert(ModulePlace { slot: *slot, subslot: None }, module.id.clone());
            leave_subslots_empty(module, *slot, &mut wanted);
        }
        for (subslot, ident) in submodules.iter().filter(|(subslot, _)| *subslot < FIRST_SYSTEM_SUBSLOT) {
            add_submodule(gsdml, module, (*slot, *subslot), *ident, &mut wanted, &mut unknown);
        }
    }
    Ok((make(gsdml, &wanted, false)?, unknown))
}

/// Finds the module of an ident among those that fit into the slot.
fn module_of<'g>(
    gsdml: &'g Gsdml,
    access_point: &AccessPoint,
    slot: u16,
    ident: u32,
) -> Option<&'g GsdmlModule> {
    let fitting = access_point.modules.iter().filter(|placement| placement.fits(slot));
    fitting.filter_map(|placement| gsdml.module(&placement.id)).find(|module| module.ident == ident)
}

/// Plugs a submodule that its module does not always have.
fn add_submodule(
    gsdml: &Gsdml,
    module: &GsdmlModule,
    (slot, subslot): (u16, u16),
    ident: u32,
    wanted: &mut DeviceChoice,
    unknown: &mut Vec<String>,
) {
    let is_own = module.submodules.iter().any(|it| {
        let is_there =
            it.fixed_in_subslots.contains(subslot) || it.fixed_in_subslots.0.is_empty() && subslot == 1;
        it.ident == ident && is_there
    });
    if is_own {
        return;
    }
    let fitting = module.pluggable.iter().filter(|placement| placement.fits(subslot));
    let found = fitting.filter_map(|placement| gsdml.submodule(&placement.id)).find(|it| it.ident == ident);
    match found {
        Some(submodule) => {
            wanted.modules.insert(ModulePlace { slot, subslot: Some(subslot) }, submodule.id.clone());
        }
        None => unknown.push(format!(
            "subslot {slot}.{subslot}: the device has submodule 0x{ident:08X}, which the file does not have there; it is left out"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::DeviceFile;

    fn gsdml() -> Gsdml {
        let text = include_str!("../../../../scripts/interop/files/GSDML-V2.35-made-up-io-20260101.xml");
        match crate::read("GSDML-V2.35-a.xml", text.into()).unwrap() {
            DeviceFile::Gsdml(gsdml) => gsdml,
            _ => unreachable!("the file is a GSDML"),
        }
    }

    #[test]
    fn the_modules_that_a_device_reports_are_chosen_and_foreign_ones_are_said() {
        let module = |slot, ident, submodules: &[(u16, u32)]| FoundModule {
            slot,
            ident,
            submodules: submodules.to_vec(),
        };
        let found = [
            module(0, 0x10, &[(1, 1), (0x8000, 0x8000), (0x8001, 0x8001)]),
            module(2, 0x42, &[(1, 2)]),
            module(3, 0x99, &[(1, 1)]),
            module(4, 0x21, &[(1, 1), (7, 5)]),
        ];
        let (device, unknown) = choose_found(&gsdml(), &DeviceChoice::default(), &found).unwrap();
        let slots: Vec<_> = device.modules.iter().map(|it| (it.slot, it.id.as_str())).collect();
        assert_eq!(slots, [(0, "DAP"), (2, "M_2AO"), (4, "M_8DI")]);
        assert_eq!(
            unknown,
            [
                "slot 3: the device has module 0x00000099, which the file does not have there; it is left out",
                "subslot 4.7: the device has submodule 0x00000005, which the file does not have there; it is left out",
            ]
        );
        let head = choose_head(&gsdml(), &DeviceChoice::default()).unwrap();
        assert_eq!(head.modules.len(), 1);
    }
    #[test]
    fn submodules_that_the_device_does_not_report_are_not_expected() {
        let text = include_str!("../../../../scripts/interop/files/GSDML-V2.35-made-up-io-20260101.xml");
        let item = |id: &str, ident: u8| {
            format!(
                "<SubmoduleItem ID='{id}' SubmoduleIdentNumber='{ident}'><IOData><Input>\
                 <DataItem DataType='Unsigned8' TextId='T_8DI'/></Input></IOData>\
                 <ModuleInfo><Name TextId='T_8DI'/></ModuleInfo></SubmoduleItem>"
            )
        };
        let usable = "<UseableSubmodules><SubmoduleItemRef SubmoduleItemTarget='A' UsedInSubslots='2 3'/>\
                      <SubmoduleItemRef SubmoduleItemTarget='B' AllowedInSubslots='2..4' FixedInSubslots='4'/>\
                      </UseableSubmodules>";
        let text = text.replace(
            "</ModuleList>",
            &format!("</ModuleList><SubmoduleList>{}{}</SubmoduleList>", item("A", 7), item("B", 8)),
        );
        let module = "<ModuleInfo><Name TextId=\"T_8DI\"/></ModuleInfo>\n          <VirtualSubmoduleList>";
        assert!(text.contains(module));
        let text = text.replace(module, &module.replace("<Virtual", &format!("{usable}<Virtual")));
        let DeviceFile::Gsdml(gsdml) = crate::read("GSDML-V2.35-a.xml", text.into()).unwrap() else {
            unreachable!("the file is a GSDML")
        };
        let reported = vec![(1, 1), (3, 8), (4, 8)];
        let found = [FoundModule { slot: 1, ident: 0x21, submodules: reported.clone() }];
        let (device, unknown) = choose_found(&gsdml, &DeviceChoice::default(), &found).unwrap();
        let expected: Vec<_> = device.modules[1].submodules.iter().map(|it| (it.subslot, it.ident)).collect();
        assert_eq!((expected, unknown), (reported, Vec::new()));
    }
}
