//! The sync managers of a SubDevice as its file has them.

use device_files::{ChosenPdo, ChosenSubDevice, EsiSyncManager};
use ethercat_subdevice::{SyncManagerLayout, Usage};

use crate::config::EmulationError;
use crate::leak;

/// Bytes of memory that a chip has at most, registers included.
const MEMORY_LEN: u32 = 0x1_0000;

/// First address of process data: digital outputs (ESC datasheet section II, 0x0F00). What is before it are registers of the chip.
const FIRST_DATA: u16 = 0x0F00;

/// Returns the sync managers as the file has them, with the lengths of the process data.
pub(super) fn places(
    chosen: &ChosenSubDevice,
    outputs: u16,
    inputs: u16,
) -> Result<&'static [SyncManagerLayout], EmulationError> {
    let mut places: Vec<SyncManagerLayout> = Vec::new();
    for (number, manager) in chosen.sync_managers.iter().enumerate() {
        let Some(usage) = usage(chosen, number, manager) else {
            // Unused ones at the end are not configured.
            let mut rest = chosen.sync_managers.iter().enumerate().skip(number);
            if rest.all(|(number, rest)| usage(chosen, number, rest).is_none()) {
                break;
            }
            return Err(EmulationError::SyncManagers(format!("SM{number} is unused between others")));
        };
        // Bits 0 to 3: a mailbox that the MainDevice writes, or reads (ETG.1000.4, sync manager control).
        let mailbox_control = match usage {
            Usage::MailboxReceive => Some(0x06),
            Usage::MailboxSend => Some(0x02),
            _ => None,
        };
        if let Some(mode) = mailbox_control.filter(|mode| manager.control & 0x0F != *mode) {
            let (name, found) = (device_files::excerpt(&manager.usage), manager.control);
            let fault = format!(
                "SM{number} is {name} with ControlByte 0x{found:02X}, by which no chip has a mailbox: correct it to 0x{:02X} in a copy of the file",
                0x20 | mode
            );
            return Err(EmulationError::SyncManagers(fault));
        }
        let own = |pdos: &[ChosenPdo]| {
            let own = pdos.iter().filter(|pdo| usize::from(pdo.sync_manager) == number);
            let bits = own.map(|pdo| pdo.pdo.bits).fold(0, u32::saturating_add);
            u16::try_from(bits.div_ceil(8)).unwrap_or(u16::MAX)
        };
        let is_second = places.iter().any(|place| place.usage == usage);
        if is_second && chosen.mailbox.is_some() {
            // The objects 0x1C12 and 0x1C13 of the stack are those of one sync manager each.
            if own(&chosen.inputs) > 0 || own(&chosen.outputs) > 0 {
                let fault = format!("SM{number} is the second of its kind with data, beside a mailbox");
                return Err(EmulationError::SyncManagers(fault));
            }
            continue;
        }
        let len = match usage {
            Usage::Outputs if chosen.mailbox.is_some() => outputs,
            Usage::Inputs if chosen.mailbox.is_some() => inputs,
            Usage::Outputs => own(&chosen.outputs),
            // A fault of the script may make the inputs longer than those of the file.
            Usage::Inputs if chosen.lengths().1 < inputs.into() && !is_second => {
                own(&chosen.inputs) + (inputs - chosen.lengths().1 as u16)
            }
            Usage::Inputs => own(&chosen.inputs),
            Usage::MailboxReceive | Usage::MailboxSend => manager.default_size.unwrap_or(0),
        };
        if len > 0 && manager.start_address < FIRST_DATA {
            let start = manager.start_address;
            let fault = format!(
                "SM{number} shows registers from 0x{start:04X} on, which are not emulated; leave out its PDOs with --pdo"
            );
            return Err(EmulationError::SyncManagers(fault));
        }
        let buffers = if manager.control & 0x03 == 0 { 3 } else { 1 };
        let end = u32::from(manager.start_address) + buffers * u32::from(len);
        if end > MEMORY_LEN {
            let fault = format!("SM{number} ends at 0x{end:04X}, beyond the memory of a chip");
            return Err(EmulationError::SyncManagers(fault));
        }
        let (start, control) = (manager.start_address, manager.control);
        places.push(SyncManagerLayout { usage, start, len, control });
    }
    let has = |wanted| places.iter().any(|place| place.usage == wanted);
    if outputs > 0 && !has(Usage::Outputs) || inputs > 0 && !has(Usage::Inputs) {
        return Err(EmulationError::SyncManagers("process data without a sync manager".to_owned()));
    }
    Ok(leak::list(places))
}

/// Returns what a sync manager is for: by its name in the file, or with a name of the maker's by the PDOs that it has.
fn usage(chosen: &ChosenSubDevice, number: usize, manager: &EsiSyncManager) -> Option<Usage> {
    let has = |pdos: &[ChosenPdo]| pdos.iter().any(|pdo| usize::from(pdo.sync_manager) == number);
    match manager.usage.as_str() {
        "MBoxOut" => Some(Usage::MailboxReceive),
        "MBoxIn" => Some(Usage::MailboxSend),
        "Outputs" => Some(Usage::Outputs),
        "Inputs" => Some(Usage::Inputs),
        _ if has(&chosen.outputs) => Some(Usage::Outputs),
        _ if has(&chosen.inputs) => Some(Usage::Inputs),
        _ => None,
    }
}
