//! The modules that a device detects (ETG.5001.1, object F050), read in PRE-OP: before them nobody knows the size of its process data.

use ethercrab::MainDevice;

use crate::coe::SdoObject;
use crate::commissioning::DetectedModule;
use crate::sdo::access;
use crate::sdo_fault::SdoFault;

/// Object with the ModuleIdent of each slot, which is the subindex; subindex 0 is the last slot.
const DETECTED: u16 = 0xF050;

/// Reads the modules of the device with this station address. Slots without a module are left out.
pub(crate) async fn read(main: &MainDevice<'_>, station: u16) -> Result<Vec<DetectedModule>, SdoFault> {
    let object = |subindex| SdoObject { index: DETECTED, subindex, is_complete: false };
    let last = access(main, station, object(0), None).await?.first().copied().unwrap_or(0);
    let mut modules = Vec::new();
    for slot in 1..=last {
        let value = access(main, station, object(slot), None).await?;
        // A maker may have idents of 16 bits.
        let ident = value.iter().take(4).rev().fold(0, |ident, byte| ident << 8 | u32::from(*byte));
        if ident != 0 {
            modules.push(DetectedModule { slot, ident });
        }
    }
    Ok(modules)
}
