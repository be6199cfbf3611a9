//! The file as a whole: vendor, devices, modules.

use std::collections::HashSet;

use super::device::EsiDevice;
use super::dictionary::ObjectDictionary;
use super::mailbox::EsiMailbox;
use super::names::{Warnings, name_of};
use super::pdo::EsiPdo;
use super::{Esi, EsiModule};
use crate::fault::{FileFault, excerpt};
use crate::xml::Element;

/// Reads an ESI file.
pub(crate) fn read(root: Element<'_>) -> Result<Esi, FileFault> {
    let needed = |path: &[&str]| {
        let fault = || root.finding(format!("element {} is missing; add it", path.join("/")));
        root.at(path).ok_or_else(fault)
    };
    let id = needed(&["Vendor", "Id"])?;
    let vendor_id = id.text_number()?.ok_or_else(|| id.finding("the vendor ID is empty; add it"))?;
    let descriptions = needed(&["Descriptions"])?;
    let mut warnings = Warnings::default();
    let devices = match descriptions.child("Devices") {
        Some(within) => within.list("Device", |device| EsiDevice::read(device, &mut warnings))?,
        None => Vec::new(),
    };
    let modules = match descriptions.child("Modules") {
        Some(within) => within.list("Module", |module| EsiModule::read(module, &mut warnings))?,
        None => Vec::new(),
    };
    if devices.is_empty() && modules.is_empty() {
        return Err(descriptions.finding("the file has neither a device nor a module; add a Device"));
    }
    check_slots(descriptions, &devices, &modules, &mut warnings);
    let vendor = root.child("Vendor").map_or(Ok(String::new()), name_of)?;
    Ok(Esi { vendor_id, vendor, devices, modules, warnings: warnings.into_list() })
}

/// Warns of slots that name modules which are not in the file.
fn check_slots(
    descriptions: Element<'_>,
    devices: &[EsiDevice],
    modules: &[EsiModule],
    warnings: &mut Warnings,
) {
    let idents: HashSet<u32> = modules.iter().map(|module| module.ident).collect();
    let classes: HashSet<&str> = modules.iter().filter_map(|module| module.class.as_deref()).collect();
    for device in devices {
        for slot in &device.slots {
            let ident = slot.module_idents.iter().find(|ident| !idents.contains(ident));
            let class = slot.module_classes.iter().find(|class| !classes.contains(class.as_str()));
            let missing = ident.map(|ident| format!("0x{ident:08X}")).or(class.map(|class| excerpt(class)));
            if let Some(missing) = missing {
                let (device, slot) = (excerpt(&device.kind), excerpt(&slot.name));
                let fault =
                    format!("slot `{slot}` of {device} names module {missing}, which is not in the file");
                warnings.add(descriptions.finding(fault));
            }
        }
    }
}

impl EsiModule {
    fn read(module: Element<'_>, warnings: &mut Warnings) -> Result<Self, FileFault> {
        let kind = module.child("Type").ok_or_else(|| module.finding("element Type is missing; add it"))?;
        let dictionary = module.at(&["Profile", "Dictionary"]);
        Ok(Self {
            ident: kind.number("ModuleIdent")?.unwrap_or(0),
            kind: kind.keep(kind.text())?,
            name: name_of(module)?,
            class: kind.keep_some(kind.attribute("ModuleClass"))?,
            rx_pdos: EsiPdo::list(module, "RxPdo", warnings)?,
            tx_pdos: EsiPdo::list(module, "TxPdo", warnings)?,
            mailbox: EsiMailbox::read(module)?,
            dictionary: dictionary.map(|it| ObjectDictionary::read(it, warnings)).transpose()?,
        })
    }
}
