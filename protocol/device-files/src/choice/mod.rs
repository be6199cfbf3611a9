//! The choice of a device from a catalogue, and the device that it makes.
//!
//! A file lists what may be chosen; [`DeviceChoice`] names what is chosen, on the command line or in a TOML file, and
//! [`choose`] makes the device of it: slots with their sizes, or assemblies with their connection, or process data with
//! sync managers. An error lists what can be chosen.
//!
//! ```
//! use device_files::{DeviceChoice, choose};
//!
//! let text = "[File]\nRevision = 1.0;\n[Device]\nVendCode = 1; ProdType = 12; ProdCode = 2; MajRev = 3; MinRev = 4;\n\
//!     [Device Classification]\nClass1 = EtherNetIP;\n[Connection Manager]\n";
//! let file = device_files::read("a.eds", text.into())?;
//! let error = choose(&file, &DeviceChoice::default()).unwrap_err();
//! assert_eq!(error.to_string(), "--connection: the file has no connection with data; use another file");
//! # Ok::<(), device_files::ReadError>(())
//! ```

mod config;
mod eds;
mod error;
mod esi;
mod esi_modules;
mod found;
mod gsdml;
mod path;

pub use self::config::{ChoiceFileError, DeviceChoice, ModulePlace, PlaceError};
pub use self::eds::{ChosenAdapter, ChosenAssembly, HeartbeatUse};
pub use self::error::{ChoiceError, ChoiceOption};
pub use self::esi::{ChosenPdo, ChosenSubDevice, SubDeviceHead, choose_detected, sub_device_head};
pub use self::esi_modules::ChosenEsiModule;
pub use self::found::{FoundModule, choose_found, choose_head};
pub use self::gsdml::{ChosenIoDevice, ChosenModule, ChosenSubmodule};

use serde::{Deserialize, Serialize};

use crate::DeviceFile;

/// Device that was chosen from a file.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(tag = "format", rename_all = "snake_case")]
pub enum ChosenDevice {
    /// PROFINET IO-Device.
    Gsdml(ChosenIoDevice),
    /// EtherNet/IP adapter.
    Eds(ChosenAdapter),
    /// EtherCAT SubDevice.
    Esi(ChosenSubDevice),
}

impl ChosenDevice {
    /// Returns the choice that makes this device again, with nothing left to a default.
    #[must_use]
    pub fn choice(&self) -> DeviceChoice {
        match self {
            Self::Gsdml(device) => device.choice(),
            Self::Eds(device) => device.choice(),
            Self::Esi(device) => device.choice(),
        }
    }
}

/// Makes the device of a choice.
///
/// # Errors
///
/// The choice names what the file does not have or what does not fit together, or leaves open what has no default.
pub fn choose(file: &DeviceFile, choice: &DeviceChoice) -> Result<ChosenDevice, ChoiceError> {
    match file {
        DeviceFile::Gsdml(gsdml) => gsdml::choose(gsdml, choice).map(ChosenDevice::Gsdml),
        DeviceFile::Eds(eds) => eds::choose(eds, choice).map(ChosenDevice::Eds),
        DeviceFile::Esi(esi) => esi::choose(esi, choice).map(ChosenDevice::Esi),
    }
}
