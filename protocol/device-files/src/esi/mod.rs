//! ESI: the catalogue of EtherCAT SubDevices. Elements are those of ETG.2000, "EtherCAT Slave Information Specification".

mod device;
mod dictionary;
mod mailbox;
mod names;
mod pdo;
mod read;
mod sii;

use serde::Serialize;

pub use self::device::{DcMode, EepromContent, EsiDevice, EsiSlot, EsiSyncManager};
pub use self::dictionary::{DictionaryEntry, DictionaryObject, ObjectDictionary};
pub use self::mailbox::{CoeService, EsiMailbox, StartupCommand};
pub use self::pdo::{EsiPdo, EsiPdoEntry};
pub(crate) use self::read::read;
pub(crate) use self::sii::{is_eeprom, read as read_eeprom};

use crate::fault::FileFault;

/// Catalogue of EtherCAT SubDevices of one vendor.
#[derive(Clone, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct Esi {
    /// Vendor ID.
    pub vendor_id: u32,
    /// Vendor's name.
    pub vendor: String,
    /// Devices; each revision is one.
    pub devices: Vec<EsiDevice>,
    /// Modules that devices with slots name.
    pub modules: Vec<EsiModule>,
    /// Faults that do not keep the file from being used.
    pub warnings: Vec<FileFault>,
}

/// Module of a device with slots.
#[derive(Clone, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct EsiModule {
    /// ModuleIdent.
    pub ident: u32,
    /// Type.
    pub kind: String,
    /// Name.
    pub name: String,
    /// Class that slots name, if it has one.
    pub class: Option<String>,
    /// Data to the device.
    pub rx_pdos: Vec<EsiPdo>,
    /// Data from the device.
    pub tx_pdos: Vec<EsiPdo>,
    /// Mailbox, with the commands for the start.
    pub mailbox: Option<EsiMailbox>,
    /// Object dictionary, if the file has it.
    pub dictionary: Option<ObjectDictionary>,
}

impl Esi {
    /// Returns the module of an ident.
    #[must_use]
    pub fn module(&self, ident: u32) -> Option<&EsiModule> {
        self.modules.iter().find(|module| module.ident == ident)
    }
}
