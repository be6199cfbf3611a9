//! The SubDevice of an ESI: a revision, and the process data that are assigned.

use serde::{Deserialize, Serialize};

use super::config::{DeviceChoice, ModulePlace};
use super::error::{ChoiceError, refuse};
use super::esi_modules::{self, ChosenEsiModule};
use crate::esi::{
    DcMode, EepromContent, Esi, EsiDevice, EsiMailbox, EsiPdo, EsiSyncManager, ObjectDictionary,
};
use crate::fault::excerpt;
use crate::xml::number;

/// EtherCAT SubDevice with its process data.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct ChosenSubDevice {
    /// Type, such as the order number.
    pub kind: String,
    /// Type, or the product code where several devices of the file have one type and revision.
    pub id: String,
    /// Name.
    pub name: String,
    /// Group in which it is shown.
    pub group: String,
    /// Vendor ID.
    pub vendor_id: u32,
    /// Product code.
    pub product_code: u32,
    /// Revision.
    pub revision: u32,
    /// Sync managers by their numbers.
    pub sync_managers: Vec<EsiSyncManager>,
    /// Data to the device, in the order of their bytes.
    pub outputs: Vec<ChosenPdo>,
    /// Data from the device, in the order of their bytes.
    pub inputs: Vec<ChosenPdo>,
    /// Number of its slots for modules.
    pub slot_count: u8,
    /// Modules in its slots.
    pub modules: Vec<ChosenEsiModule>,
    /// True if the controller writes the list of modules into object 0xF030.
    pub takes_module_list: bool,
    /// Mailbox, if it has one; with the commands of the modules.
    pub mailbox: Option<EsiMailbox>,
    /// Object dictionary, if the file has it; with the objects of the modules.
    pub dictionary: Option<ObjectDictionary>,
    /// Content of the EEPROM, if the file describes it.
    pub eeprom: Option<EepromContent>,
    /// Modes of its clock; none if it has no distributed clock.
    pub dc_modes: Vec<DcMode>,
}

/// Process data object that is assigned.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub struct ChosenPdo {
    /// Sync manager.
    pub sync_manager: u8,
    /// Index, name and entries.
    pub pdo: EsiPdo,
}

impl ChosenSubDevice {
    /// Returns the bytes of the data to the device and from it: those of each sync manager are whole bytes, one after another.
    #[must_use]
    pub fn lengths(&self) -> (u32, u32) {
        let bytes = |pdos: &[ChosenPdo]| {
            let managers = pdos.chunk_by(|one, next| one.sync_manager == next.sync_manager);
            let of_manager = |pdos: &[ChosenPdo]| {
                pdos.iter().map(|chosen| chosen.pdo.bits).fold(0, u32::saturating_add).div_ceil(8)
            };
            managers.map(of_manager).fold(0, u32::saturating_add)
        };
        (bytes(&self.outputs), bytes(&self.inputs))
    }

    pub(super) fn choice(&self) -> DeviceChoice {
        let pdos = self.outputs.iter().chain(&self.inputs).map(|chosen| chosen.pdo.index);
        let modules = self.modules.iter().map(|module| {
            let place = ModulePlace { slot: module.slot.into(), subslot: None };
            (place, format!("0x{:08X}", module.ident))
        });
        DeviceChoice {
            device_name: Some(self.id.clone()),
            revision: Some(self.revision),
            pdos: Some(pdos.collect()),
            modules: modules.collect(),
            ..DeviceChoice::default()
        }
    }
}

const NAME: &str = "--device-name";
const PDO: &str = "--pdo";

/// Largest process data of one direction: the memory of a chip ends at 0xFFFF.
const LARGEST_DATA: u32 = 0xF000;

/// Makes the SubDevice of a choice.
pub(super) fn choose(esi: &Esi, choice: &DeviceChoice) -> Result<ChosenSubDevice, ChoiceError> {
    const FORMAT: &str = "an ESI";
    refuse("--access-point", choice.access_point.is_some(), FORMAT)?;
    refuse("--connection", choice.connection.is_some(), FORMAT)?;
    let device = find(esi, choice)?;
    let modules = esi_modules::choose(esi, device, choice)?;
    let mut offered = OfferedPdos { rx: device.rx_pdos.clone(), tx: device.tx_pdos.clone() };
    let mut mailbox = device.mailbox.clone();
    let mut dictionary = device.dictionary.clone();
    for module in &modules {
        offered.rx.extend(module.pdos(&module.module.rx_pdos)?);
        offered.tx.extend(module.pdos(&module.module.tx_pdos)?);
        if let Some(coe) = mailbox.as_mut().and_then(|it| it.coe.as_mut()) {
            coe.init_commands.extend(module.commands()?);
        }
        let objects = module.objects()?;
        if !objects.is_empty() {
            dictionary.get_or_insert_default().objects.extend(objects);
        }
    }
    let pdos = choice.pdos.as_deref();
    if let Some(unknown) = pdos.into_iter().flatten().find(|index| !offered.has(**index)) {
        let fault = format!("0x{unknown:04X} is not in the file; choose from these");
        return Err(ChoiceError::new(PDO, fault).with(offered.list()));
    }
    let outputs = assigned(device, &offered, &offered.rx, "Outputs", pdos)?;
    let inputs = assigned(device, &offered, &offered.tx, "Inputs", pdos)?;
    let chosen = ChosenSubDevice {
        kind: device.kind.clone(),
        id: id_of(esi, device),
        name: device.name.clone(),
        group: device.group.clone(),
        vendor_id: esi.vendor_id,
        product_code: device.product_code,
        revision: device.revision,
        sync_managers: device.sync_managers.clone(),
        outputs,
        inputs,
        slot_count: esi_modules::slot_count(device),
        modules: modules.iter().map(esi_modules::PlacedModule::chosen).collect(),
        takes_module_list: device.takes_module_list,
        mailbox,
        dictionary,
        eeprom: device.eeprom.clone(),
        dc_modes: device.dc_modes.clone(),
    };
    check(&chosen).map_err(|fault| ChoiceError::new(PDO, fault).with(offered.list()))?;
    Ok(chosen)
}

/// SubDevice of a file before its modules are chosen.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct SubDeviceHead {
    /// Vendor ID.
    pub vendor_id: u32,
    /// Product code.
    pub product_code: u32,
    /// True if it has slots for modules, and a mailbox by which it lists those that it detects.
    pub lists_modules: bool,
}

/// Returns the device of a choice, whatever its modules are.
///
/// # Errors
///
/// The choice leaves no device or several.
pub fn sub_device_head(esi: &Esi, choice: &DeviceChoice) -> Result<SubDeviceHead, ChoiceError> {
    let device = find(esi, choice)?;
    let has_objects = device.mailbox.as_ref().is_some_and(|mailbox| mailbox.coe.is_some());
    Ok(SubDeviceHead {
        vendor_id: esi.vendor_id,
        product_code: device.product_code,
        lists_modules: has_objects && esi_modules::slot_count(device) > 0,
    })
}

/// Makes the SubDevice of the modules that it detects, by slot and ModuleIdent, and says which of them the file does not have; these
/// are left out.
///
/// # Errors
///
/// The modules do not fit together by the file.
pub fn choose_detected(
    esi: &Esi,
    choice: &DeviceChoice,
    detected: &[(u8, u32)],
) -> Result<(ChosenSubDevice, Vec<String>), ChoiceError> {
    let (choice, unknown) = esi_modules::with_detected(esi, find(esi, choice)?, choice, detected);
    Ok((choose(esi, &choice)?, unknown))
}

/// PDOs that may be assigned: those of the device, and those of its modules in their slots.
struct OfferedPdos {
    rx: Vec<EsiPdo>,
    tx: Vec<EsiPdo>,
}

impl OfferedPdos {
    fn all(&self) -> impl Iterator<Item = &EsiPdo> {
        self.rx.iter().chain(&self.tx)
    }

    fn has(&self, index: u16) -> bool {
        self.all().any(|pdo| pdo.index == index)
    }

    fn list(&self) -> Vec<(String, String)> {
        self.all().map(|pdo| (format!("0x{:04X}", pdo.index), pdo.name.clone())).collect()
    }
}

/// Returns what names a device: its type, or its product code where another device has this type and revision, too.
fn id_of(esi: &Esi, device: &EsiDevice) -> String {
    let is_twin = |it: &&EsiDevice| it.kind == device.kind && it.revision == device.revision;
    match esi.devices.iter().filter(is_twin).count() {
        0 | 1 => device.kind.clone(),
        _ => format!("0x{:08X}", device.product_code),
    }
}

/// Finds the device by type, name or product code and by revision, where these leave only one.
fn find<'e>(esi: &'e Esi, choice: &DeviceChoice) -> Result<&'e EsiDevice, ChoiceError> {
    let is_named = |device: &&EsiDevice| {
        choice.device_name.as_ref().is_none_or(|name| {
            let code = name.strip_prefix("0x").and_then(|_| number::<u32>(name));
            [&device.kind, &device.name].contains(&name) || code == Some(device.product_code)
        })
    };
    let named: Vec<_> = esi.devices.iter().filter(is_named).collect();
    let is_wanted = |device: &&&EsiDevice| choice.revision.is_none_or(|revision| device.revision == revision);
    let wanted: Vec<_> = named.iter().filter(is_wanted).copied().collect();
    let list = |devices: &[&EsiDevice]| -> Vec<_> {
        let value = |device: &&EsiDevice| {
            let id = id_of(esi, device);
            let quote = if id.contains(' ') { "'" } else { "" };
            let value = format!("{quote}{id}{quote} --revision 0x{:08X}", device.revision);
            (value, device.name.clone())
        };
        devices.iter().map(value).collect()
    };
    let all: Vec<_> = esi.devices.iter().collect();
    match (wanted.as_slice(), &choice.device_name) {
        ([only], _) => Ok(only),
        ([], _) if all.is_empty() => Err(ChoiceError::new(NAME, "the file has no device; use another file")),
        ([], Some(name)) if named.is_empty() => {
            let fault = format!("`{}` is not in the file; choose one", excerpt(name));
            Err(ChoiceError::new(NAME, fault).with(list(&all)))
        }
        ([], _) => {
            let revision = choice.revision.unwrap_or(0);
            let fault = format!("0x{revision:08X} is not in the file; choose one");
            Err(ChoiceError::new("--revision", fault).with(list(&named)))
        }
        (several, None) => {
            Err(ChoiceError::new(NAME, format!("the file has {}; choose one", several.len()))
                .with(list(several)))
        }
        (several, Some(name)) => {
            let fault = format!("`{}` has {}; choose one", excerpt(name), several.len());
            Err(ChoiceError::new("--revision", fault).with(list(several)))
        }
    }
}

/// Returns the process data of a direction: the chosen ones, or those that the file assigns.
fn assigned(
    device: &EsiDevice,
    offered: &OfferedPdos,
    pdos: &[EsiPdo],
    usage: &str,
    chosen: Option<&[u16]>,
) -> Result<Vec<ChosenPdo>, ChoiceError> {
    let fault = |text: String| ChoiceError::new(PDO, text).with(offered.list());
    // A file may have several forms of one PDO: the first one counts.
    let is_first = |number: usize, pdo: &EsiPdo| pdos.iter().take(number).all(|it| it.index != pdo.index);
    let default = || {
        let numbered = pdos.iter().enumerate().filter(|(number, pdo)| is_first(*number, pdo));
        numbered.map(|(_, pdo)| pdo).filter(|pdo| pdo.sync_manager.is_some()).collect::<Vec<_>>()
    };
    let found: Vec<&EsiPdo> = match chosen {
        Some(indices) => {
            indices.iter().filter_map(|index| pdos.iter().find(|pdo| pdo.index == *index)).collect()
        }
        None => default(),
    };
    let missing = pdos.iter().find(|pdo| pdo.is_mandatory && !found.iter().any(|it| it.index == pdo.index));
    if let Some(missing) = missing.filter(|_| chosen.is_some()) {
        return Err(fault(format!("0x{:04X} is mandatory; add it", missing.index)));
    }
    let of_usage = device.sync_managers.iter().position(|manager| manager.usage == usage);
    let mut assigned: Vec<ChosenPdo> = Vec::new();
    for pdo in found {
        let other = assigned.iter().find(|it| {
            pdo.excludes.contains(&it.pdo.index)
                || it.pdo.excludes.contains(&pdo.index)
                || it.pdo.index == pdo.index
        });
        if let Some(other) = other {
            let (one, other) = (pdo.index, other.pdo.index);
            return Err(fault(format!("0x{one:04X} excludes 0x{other:04X}; leave one out")));
        }
        let default = of_usage.and_then(|number| u8::try_from(number).ok());
        let Some(sync_manager) = pdo.sync_manager.or(default) else {
            return Err(fault(format!("0x{:04X} has no sync manager in the file; leave it out", pdo.index)));
        };
        assigned.push(ChosenPdo { sync_manager, pdo: pdo.clone() });
    }
    // The data of one sync manager lie together.
    assigned.sort_by_key(|pdo| pdo.sync_manager);
    Ok(assigned)
}

fn check(device: &ChosenSubDevice) -> Result<(), String> {
    for chosen in device.outputs.iter().chain(&device.inputs) {
        if usize::from(chosen.sync_manager) >= device.sync_managers.len() {
            let (index, manager) = (chosen.pdo.index, chosen.sync_manager);
            return Err(format!(
                "0x{index:04X} is in SM{manager}, which the file does not have; leave it out"
            ));
        }
    }
    let (outputs, inputs) = device.lengths();
    let bytes = outputs.max(inputs);
    if bytes > LARGEST_DATA {
        return Err(format!(
            "{bytes} bytes of process data: a chip has at most {LARGEST_DATA}; choose fewer"
        ));
    }
    Ok(())
}
