//! From the IO-Device of a GSDML to `[bus.profinet.device]`.

use device_files::{ChosenIoDevice, ChosenModule, excerpt};

use super::{FileName, differs, hex, plain};
use crate::problem::{Check, problem};
use crate::{Profinet, ProfinetDevice, ProfinetModule, ProfinetSubmodule};

const KEY: &str = "bus.profinet.device";

/// Fills in the device, or compares it with that of the setup.
pub(super) fn fill(profinet: &mut Profinet, chosen: &mut ChosenIoDevice, file: &FileName) -> Check {
    // Values that a user could change are in the records already, and a slot without submodules is not expected.
    let submodules = chosen.modules.iter_mut().flat_map(|module| &mut module.submodules);
    submodules.flat_map(|submodule| &mut submodule.records).for_each(|record| record.values.clear());
    chosen.modules.retain(|module| !module.submodules.is_empty());
    let of_file = described(chosen);
    if let Some(own) = &profinet.device {
        compare(own, &of_file, chosen, file)?;
    }
    profinet.device = Some(of_file);
    Ok(())
}

/// Returns the keys that describe a device.
pub(super) fn described(chosen: &ChosenIoDevice) -> ProfinetDevice {
    ProfinetDevice {
        vendor: chosen.vendor_id,
        device: chosen.device_id,
        modules: chosen.modules.iter().map(module).collect(),
    }
}

fn module(chosen: &ChosenModule) -> ProfinetModule {
    let submodules = chosen.submodules.iter().map(|submodule| ProfinetSubmodule {
        subslot: submodule.subslot,
        ident: submodule.ident,
        input_bytes: submodule.input_length,
        output_bytes: submodule.output_length,
    });
    ProfinetModule { slot: chosen.slot, ident: chosen.ident, submodules: submodules.collect() }
}

fn compare(
    own: &ProfinetDevice,
    of_file: &ProfinetDevice,
    chosen: &ChosenIoDevice,
    file: &FileName,
) -> Check {
    differs(format!("{KEY}.vendor"), (own.vendor, of_file.vendor), hex, "DeviceIdentity VendorID", file)?;
    differs(format!("{KEY}.device"), (own.device, of_file.device), hex, "DeviceIdentity DeviceID", file)?;
    for (index, module) in own.modules.iter().enumerate() {
        let key = format!("{KEY}.modules[{index}]");
        let Some(found) = of_file.modules.iter().find(|found| found.slot == module.slot) else {
            let text =
                format!("slot {} is empty by {}; plug it by `config`, or leave it out", module.slot, file.0);
            return Err(problem(format!("{key}.slot"), text));
        };
        let id = chosen.modules.iter().find(|it| it.slot == module.slot).map_or("", |it| &it.id);
        let element = format!("ModuleItem `{}` ModuleIdentNumber", excerpt(id));
        differs(format!("{key}.ident"), (module.ident, found.ident), hex, &element, file)?;
        compare_submodules(&key, module, found, file)?;
    }
    let is_listed = |found: &&ProfinetModule| own.modules.iter().any(|module| module.slot == found.slot);
    match of_file.modules.iter().find(|found| !is_listed(found)) {
        None => Ok(()),
        Some(ProfinetModule { slot, ident, .. }) => {
            let text = format!(
                "slot {slot} has module 0x{ident:08X} by {}; list it, or leave the section out",
                file.0
            );
            Err(problem(format!("{KEY}.modules"), text))
        }
    }
}

fn compare_submodules(key: &str, own: &ProfinetModule, of_file: &ProfinetModule, file: &FileName) -> Check {
    let slot = own.slot;
    for (index, submodule) in own.submodules.iter().enumerate() {
        let key = format!("{key}.submodules[{index}]");
        let subslot = submodule.subslot;
        let Some(found) = of_file.submodules.iter().find(|found| found.subslot == subslot) else {
            let text = format!(
                "subslot {slot}.{subslot} is empty by {}; plug it by `config`, or leave it out",
                file.0
            );
            return Err(problem(format!("{key}.subslot"), text));
        };
        let element = |name: &str| format!("{name} of subslot {slot}.{subslot}");
        let idents = (submodule.ident, found.ident);
        differs(format!("{key}.ident"), idents, hex, &element("SubmoduleIdentNumber"), file)?;
        let inputs = (submodule.input_bytes, found.input_bytes);
        differs(format!("{key}.input_bytes"), inputs, plain, &element("IOData Input"), file)?;
        let outputs = (submodule.output_bytes, found.output_bytes);
        differs(format!("{key}.output_bytes"), outputs, plain, &element("IOData Output"), file)?;
    }
    let is_listed = |subslot: u16| own.submodules.iter().any(|submodule| submodule.subslot == subslot);
    match of_file.submodules.iter().find(|found| !is_listed(found.subslot)) {
        None => Ok(()),
        Some(ProfinetSubmodule { subslot, ident, .. }) => {
            let text = format!(
                "subslot {slot}.{subslot} has submodule 0x{ident:08X} by {}; list it, or leave the section out",
                file.0
            );
            Err(problem(format!("{key}.submodules"), text))
        }
    }
}
