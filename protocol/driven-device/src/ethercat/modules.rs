//! Modules of a SubDevice: the list that it gets, and the one that it reports (ETG.5001.1, objects F030 and F050).

use device_files::ChosenSubDevice;
use ethercat_maindevice::StartupWrite;

use super::by_place;
use crate::parameter::{Earlier, ParameterAccess};

/// Objects with the configured and the detected ModuleIdent of each slot, which is the subindex.
const CONFIGURED: u16 = 0xF030;
pub(super) const DETECTED: u16 = 0xF050;

/// Place of the number of detected modules.
pub(crate) const DETECTED_COUNT: &str = "0xF050:00:1";

/// Returns what tells a device its modules, where its file says that it takes a list: the count is 0 while they are written.
pub(super) fn list(chosen: &ChosenSubDevice) -> Vec<StartupWrite> {
    if !chosen.takes_module_list {
        return Vec::new();
    }
    let last = chosen.modules.last().map_or(0, |module| module.slot);
    let write =
        |subindex: u8, data: Vec<u8>| StartupWrite { index: CONFIGURED, subindex, is_complete: false, data };
    let ident = |slot: u8| {
        let module = chosen.modules.iter().find(|module| module.slot == slot);
        module.map_or(0, |module| module.ident).to_le_bytes().to_vec()
    };
    let slots = (1..=last).map(|slot| write(slot, ident(slot)));
    std::iter::once(write(0, vec![0])).chain(slots).chain([write(0, vec![last])]).collect()
}

/// Returns what an entry of the detected modules says, and which ones are to be read after it.
pub(super) fn detected(chosen: &ChosenSubDevice, subindex: u8, bytes: &[u8]) -> Earlier {
    let differences: Vec<String> = match subindex {
        0 => {
            let count = bytes.first().copied().unwrap_or(0);
            let reads = (1..=count).filter_map(|slot| by_place(&format!("0x{DETECTED:04X}:{slot:02X}")));
            let reads = reads.map(ParameterAccess::of_diagnosis).collect();
            let missing = chosen.modules.iter().filter(|module| module.slot > count);
            let differences = missing.filter_map(|module| difference(chosen, module.slot, 0)).collect();
            return Earlier { differences, reads, ..Earlier::default() };
        }
        slot => {
            let ident = bytes.first_chunk().copied().map(u32::from_le_bytes);
            ident.and_then(|ident| difference(chosen, slot, ident)).into_iter().collect()
        }
    };
    Earlier { differences, ..Earlier::default() }
}

/// Returns in what a slot differs; the ident 0 means an empty slot.
fn difference(chosen: &ChosenSubDevice, slot: u8, found: u32) -> Option<String> {
    let expected = chosen.modules.iter().find(|module| module.slot == slot);
    let expected_words = expected.map_or_else(
        || "no module".to_owned(),
        |it| format!("{} (0x{:08X})", device_files::excerpt(&it.kind), it.ident),
    );
    match (expected.map_or(0, |module| module.ident), found) {
        (expected, found) if expected == found => None,
        (_, 0) => {
            Some(format!("slot {slot}: expected {expected_words}, found none; plug it or leave it out"))
        }
        (_, found) => Some(format!(
            "slot {slot}: expected {expected_words}, found module 0x{found:08X}; choose it with --module {slot}=0x{found:08X}"
        )),
    }
}
