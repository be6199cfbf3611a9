//! Readers of the files by which makers describe their devices: GSDML for PROFINET, EDS for EtherNet/IP, ESI for EtherCAT.
//!
//! A file is a catalogue, not a device: it lists access points, modules, connections or revisions from which the user
//! chooses. [`read`] finds out which of the three a file is, and returns its catalogue:
//!
//! ```
//! let text = "[File]\nRevision = 1.0;\n[Device]\nVendCode = 1; ProdType = 12; ProdCode = 2; MajRev = 3; MinRev = 4;\n\
//!     [Device Classification]\nClass1 = EtherNetIP;\n[Connection Manager]\n";
//! let device_files::DeviceFile::Eds(eds) = device_files::read("a.eds", text.into())? else { unreachable!() };
//! assert_eq!((eds.vendor_id, eds.product_code), (1, 2));
//! # Ok::<(), device_files::ReadError>(())
//! ```
//!
//! Readers take bytes from anywhere. They do not panic, stay below 100 MiB, and name file, line and element of a fault.
//! Everything in a catalogue can be serialized; the program prints it as JSON.

mod choice;
mod eds;
mod encoding;
mod esi;
mod fault;
mod gsdml;
mod hex;
mod xml;

use serde::Serialize;

pub use crate::choice::{
    ChoiceError, ChoiceFileError, ChoiceOption, ChosenAdapter, ChosenAssembly, ChosenDevice, ChosenEsiModule,
    ChosenIoDevice, ChosenModule, ChosenPdo, ChosenSubDevice, ChosenSubmodule, DeviceChoice, FoundModule,
    HeartbeatUse, ModulePlace, PlaceError, SubDeviceHead, choose, choose_detected, choose_found, choose_head,
    sub_device_head,
};
pub use crate::eds::{
    CapacityLimit, ConnectionEnd, ConnectionUse, Eds, EdsAssembly, EdsConnection, EdsMember, EdsParameter,
    EdsPort, EdsReference, EdsScale, ParameterText, RealTimeFormat,
};
pub use crate::encoding::MOST_BYTES;
pub use crate::esi::{
    CoeService, DcMode, DictionaryEntry, DictionaryObject, EepromContent, Esi, EsiDevice, EsiMailbox,
    EsiModule, EsiPdo, EsiPdoEntry, EsiSlot, EsiSyncManager, ObjectDictionary, StartupCommand,
};
pub use crate::fault::{FileFault, ReadError, excerpt, is_printable, without_controls};
pub use crate::gsdml::{
    AccessPoint, ChannelDiagnosis, CyclicTiming, DataBit, DataItem, Gsdml, GsdmlModule, GsdmlSubmodule,
    IoDirection, ParameterRecord, Placement, RecordValue, SlotRanges, SystemSubmodule, UnitDiagnosis,
    ValueText, ValueTexts,
};
use crate::xml::Document;

/// Version of the form in which catalogues are serialized.
pub const SCHEMA_VERSION: u32 = 1;

/// Catalogue as the program prints it.
#[derive(Clone, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct DeviceCatalogue {
    /// Version of this form.
    pub schema_version: u32,
    /// Name of the file.
    pub file: String,
    /// Catalogue.
    pub device: DeviceFile,
}

/// Catalogue of a device file.
#[derive(Clone, PartialEq, Debug, Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[serde(tag = "format", rename_all = "snake_case")]
pub enum DeviceFile {
    /// PROFINET IO-Device.
    Gsdml(Gsdml),
    /// EtherNet/IP adapter.
    Eds(Eds),
    /// EtherCAT SubDevices.
    Esi(Esi),
}

impl DeviceFile {
    /// Returns the name of the device's bus.
    #[must_use]
    pub const fn bus(&self) -> &'static str {
        match self {
            Self::Gsdml(_) => "PROFINET",
            Self::Eds(_) => "EtherNet/IP",
            Self::Esi(_) => "EtherCAT",
        }
    }

    /// Returns the faults that do not keep the file from being used.
    #[must_use]
    pub fn warnings(&self) -> &[FileFault] {
        match self {
            Self::Gsdml(gsdml) => &gsdml.warnings,
            Self::Eds(eds) => &eds.warnings,
            Self::Esi(esi) => &esi.warnings,
        }
    }
}

/// Reads a device file. Its name is for messages, and has the version of a GSDML file that does not give it.
///
/// # Errors
///
/// It is of another kind, version or encoding, larger than [`MOST_BYTES`], or faulty.
pub fn read(name: &str, bytes: Vec<u8>) -> Result<DeviceFile, ReadError> {
    read_file(name, bytes).map_err(|finding| ReadError { file: name.to_owned(), finding })
}

fn read_file(name: &str, bytes: Vec<u8>) -> Result<DeviceFile, FileFault> {
    if esi::is_eeprom(&bytes) {
        return esi::read_eeprom(bytes).map(DeviceFile::Esi);
    }
    let text = encoding::decode(bytes)?;
    if !text.trim_start().starts_with('<') {
        if eds::is_canopen(&text) {
            return Err(FileFault::of_file("an EDS of CANopen; expected one of EtherNet/IP"));
        }
        return eds::read(&text).map(DeviceFile::Eds);
    }
    let document = Document::parse(&text)?;
    let root = document.root();
    let other = match root.name() {
        "ISO15745Profile" => return gsdml::read(name, root).map(DeviceFile::Gsdml),
        "EtherCATInfo" => return esi::read(root).map(DeviceFile::Esi),
        "EtherCATConfig" => "a network configuration (ENI); expected the ESI of a device",
        "EtherCATDict" => "the dictionary of a device alone; read the ESI that names it",
        "EtherCATModule" => "modules of EtherCAT without a device; read the ESI of the device",
        "ISO15745ProfileContainer" => "a profile of CANopen or POWERLINK; expected a GSDML or ESI file",
        "IODevice" => "an IODD of IO-Link; expected the file of the IO-Link master",
        other => {
            let fault = format!(
                "element `{}`: expected ISO15745Profile (GSDML) or EtherCATInfo (ESI)",
                excerpt(other)
            );
            return Err(FileFault::new(root.line(), "file", fault));
        }
    };
    Err(root.finding(other))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `INSTA_UPDATE=always` writes it again, as for snapshots.
    #[test]
    #[expect(clippy::disallowed_methods, reason = "the test compares a file of this folder")]
    fn the_committed_schema_matches_the_catalogue() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/device-catalogue.schema.json");
        let schema = serde_json::to_string_pretty(&schemars::schema_for!(DeviceCatalogue)).unwrap() + "\n";
        if std::env::var("INSTA_UPDATE").is_ok_and(|update| update == "always") {
            std::fs::write(path, &schema).unwrap();
        }
        assert!(
            std::fs::read_to_string(path).unwrap_or_default() == schema,
            "the catalogue changed: count SCHEMA_VERSION up where a reader breaks, then INSTA_UPDATE=always cargo test -p device-files"
        );
    }
}
