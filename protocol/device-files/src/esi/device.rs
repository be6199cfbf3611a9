//! Devices: identity, sync managers, FMMUs, clocks, slots, EEPROM.

use serde::{Deserialize, Serialize};

use super::dictionary::ObjectDictionary;
use super::mailbox::{EsiMailbox, hex_bytes};
use super::names::{Warnings, name_of};
use super::pdo::EsiPdo;
use crate::fault::{FileFault, excerpt};
use crate::xml::{Element, number};

/// Revision of a SubDevice.
#[derive(Clone, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct EsiDevice {
    /// Type, such as the order number.
    pub kind: String,
    /// Name.
    pub name: String,
    /// Product code.
    pub product_code: u32,
    /// Revision number.
    pub revision: u32,
    /// Group in which it is shown.
    pub group: String,
    /// Physics of its ports, such as `YY` for two of 100BASE-TX.
    pub physics: String,
    /// Use of each FMMU.
    pub fmmus: Vec<String>,
    /// Sync managers.
    pub sync_managers: Vec<EsiSyncManager>,
    /// Data to the device.
    pub rx_pdos: Vec<EsiPdo>,
    /// Data from the device.
    pub tx_pdos: Vec<EsiPdo>,
    /// Mailbox, if it has one.
    pub mailbox: Option<EsiMailbox>,
    /// Modes of its clock; none if it has no distributed clock.
    pub dc_modes: Vec<DcMode>,
    /// Slots for modules.
    pub slots: Vec<EsiSlot>,
    /// True if the controller writes the list of modules into object 0xF030.
    pub takes_module_list: bool,
    /// EEPROM, if the file describes it.
    pub eeprom: Option<EepromContent>,
    /// Object dictionary, if the file has it.
    pub dictionary: Option<ObjectDictionary>,
    /// File that has the dictionary instead.
    pub dictionary_file: Option<String>,
}

/// Sync manager.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct EsiSyncManager {
    /// Use: `MBoxOut`, `MBoxIn`, `Outputs`, `Inputs`; empty for an unused one.
    pub usage: String,
    /// Start address.
    pub start_address: u16,
    /// Bytes by default; none if the PDOs decide.
    pub default_size: Option<u16>,
    /// Fewest bytes.
    pub min_size: Option<u16>,
    /// Most bytes.
    pub max_size: Option<u16>,
    /// Control byte.
    pub control: u8,
    /// True if it is on.
    pub is_enabled: bool,
}

/// Mode of a distributed clock.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct DcMode {
    /// Name.
    pub name: String,
    /// Description.
    pub description: String,
    /// AssignActivate: the word for register 0x0980.
    pub assign_activate: u16,
    /// Cycle of SYNC0 in ns; 0 for that of the controller.
    pub sync0_cycle_ns: i64,
    /// Factor of the cycle of SYNC0.
    pub sync0_factor: Option<i32>,
    /// Shift of SYNC0 in ns.
    pub sync0_shift_ns: i64,
    /// Cycle of SYNC1 in ns.
    pub sync1_cycle_ns: i64,
    /// Factor of the cycle of SYNC1, in cycles of SYNC0.
    pub sync1_factor: Option<i32>,
    /// Shift of SYNC1 in ns.
    pub sync1_shift_ns: i64,
}

/// Slot for modules.
#[derive(Clone, PartialEq, Eq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct EsiSlot {
    /// Name.
    pub name: String,
    /// Fewest modules.
    pub min_instances: u16,
    /// Most modules.
    pub max_instances: u16,
    /// Step of the indices of objects from one slot to the next.
    pub index_increment: u16,
    /// Step of the indices of PDOs from one slot to the next.
    pub pdo_increment: u16,
    /// Module that is there by default, by ident.
    pub default_ident: Option<u32>,
    /// Modules that fit, by ident.
    pub module_idents: Vec<u32>,
    /// Modules that fit, by class.
    pub module_classes: Vec<String>,
}

/// Content of the EEPROM.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct EepromContent {
    /// Bytes.
    pub byte_size: u32,
    /// First 14 bytes, which configure the chip.
    #[serde(with = "crate::hex")]
    #[cfg_attr(test, schemars(with = "String"))]
    pub config_data: Vec<u8>,
    /// Mailbox of the bootstrap: offsets and sizes.
    #[serde(with = "crate::hex")]
    #[cfg_attr(test, schemars(with = "String"))]
    pub bootstrap: Vec<u8>,
    /// True if the file is a dump of an EEPROM.
    #[serde(default)]
    pub is_dump: bool,
    /// Whole content, if the file gives it.
    #[serde(with = "crate::hex")]
    #[cfg_attr(test, schemars(with = "String"))]
    pub data: Vec<u8>,
}

impl EsiDevice {
    pub(super) fn read(device: Element<'_>, warnings: &mut Warnings) -> Result<Self, FileFault> {
        let kind = device.child("Type").ok_or_else(|| device.finding("element Type is missing; add it"))?;
        let profiles = || device.children_named("Profile");
        let dictionary = profiles().find_map(|profile| profile.child("Dictionary"));
        let file = profiles().find_map(|profile| profile.child_text("DictionaryFile"));
        if kind.attribute("ProductCode").is_none() {
            let fault = format!("`{}` has no ProductCode; shown with 0", excerpt(kind.text()));
            warnings.add(kind.finding(fault));
        }
        Ok(Self {
            kind: kind.keep(kind.text())?,
            name: name_of(device)?,
            product_code: kind.number("ProductCode")?.unwrap_or(0),
            revision: kind.number("RevisionNo")?.unwrap_or(0),
            group: device.keep(device.child_text("GroupType").unwrap_or_default())?,
            physics: device.keep(device.attribute("Physics").unwrap_or_default())?,
            fmmus: device.list("Fmmu", |fmmu| fmmu.keep(fmmu.text()))?,
            sync_managers: device.list("Sm", EsiSyncManager::read)?,
            rx_pdos: EsiPdo::list(device, "RxPdo", warnings)?,
            tx_pdos: EsiPdo::list(device, "TxPdo", warnings)?,
            mailbox: EsiMailbox::read(device)?,
            dc_modes: match device.child("Dc") {
                Some(dc) => dc.list("OpMode", DcMode::read)?,
                None => Vec::new(),
            },
            slots: match device.child("Slots") {
                Some(slots) => slots.list("Slot", |slot| EsiSlot::read(slots, slot))?,
                None => Vec::new(),
            },
            takes_module_list: match device.child("Slots") {
                Some(slots) => slots.is("DownloadModuleIdentList")?,
                None => false,
            },
            eeprom: device.child("Eeprom").map(EepromContent::read).transpose()?,
            dictionary: dictionary.map(|it| ObjectDictionary::read(it, warnings)).transpose()?,
            dictionary_file: device.keep_some(file)?,
        })
    }
}

impl EsiSyncManager {
    fn read(manager: Element<'_>) -> Result<Self, FileFault> {
        Ok(Self {
            usage: manager.keep(manager.text())?,
            start_address: manager.number("StartAddress")?.unwrap_or(0),
            default_size: manager.number("DefaultSize")?,
            min_size: manager.number("MinSize")?,
            max_size: manager.number("MaxSize")?,
            control: manager.number("ControlByte")?.unwrap_or(0),
            is_enabled: manager.attribute("Enable").is_some_and(|enable| number::<i64>(enable) != Some(0)),
        })
    }
}

impl DcMode {
    fn read(mode: Element<'_>) -> Result<Self, FileFault> {
        let time = |name: &str| mode.child_number(name).map(Option::unwrap_or_default);
        let factor = |name| mode.child(name).map_or(Ok(None), |cycle| cycle.number("Factor"));
        Ok(Self {
            name: name_of(mode)?,
            description: mode.keep(mode.child_text("Desc").unwrap_or_default())?,
            assign_activate: mode.child_number("AssignActivate")?.unwrap_or(0),
            sync0_cycle_ns: time("CycleTimeSync0")?,
            sync0_factor: factor("CycleTimeSync0")?,
            sync0_shift_ns: time("ShiftTimeSync0")?,
            sync1_cycle_ns: time("CycleTimeSync1")?,
            sync1_factor: factor("CycleTimeSync1")?,
            sync1_shift_ns: time("ShiftTimeSync1")?,
        })
    }
}

impl EsiSlot {
    fn read(slots: Element<'_>, slot: Element<'_>) -> Result<Self, FileFault> {
        let idents = slot.list("ModuleIdent", Element::text_number)?;
        // What a slot does not say is that of all slots.
        let increment = |name: &str| Ok(slot.number(name)?.or(slots.number(name)?).unwrap_or(0));
        let mut default_ident = None;
        for ident in slot.children_named("ModuleIdent") {
            if default_ident.is_none() && ident.is("Default")? {
                default_ident = ident.text_number()?;
            }
        }
        Ok(Self {
            name: name_of(slot)?,
            min_instances: slot.number("MinInstances")?.unwrap_or(0),
            max_instances: slot.number("MaxInstances")?.unwrap_or(1),
            index_increment: increment("SlotIndexIncrement")?,
            pdo_increment: increment("SlotPdoIncrement")?,
            default_ident,
            module_idents: idents.into_iter().flatten().collect(),
            module_classes: slot.list("ModuleClass", class_of)?,
        })
    }
}

/// Returns the class that a slot names, in the element or in an element within.
fn class_of(class: Element<'_>) -> Result<String, FileFault> {
    class.keep(class.child_text("Class").unwrap_or(class.text()))
}

impl EepromContent {
    fn read(eeprom: Element<'_>) -> Result<Self, FileFault> {
        let bytes = |name: &str| eeprom.child(name).map_or(Ok(Vec::new()), hex_bytes);
        Ok(Self {
            byte_size: eeprom.child_number("ByteSize")?.unwrap_or(0),
            config_data: bytes("ConfigData")?,
            bootstrap: bytes("BootStrap")?,
            is_dump: false,
            data: bytes("Data")?,
        })
    }
}
