//! A device as its owner gives it, and the names of what it exchanges.

use device_files::{ChosenDevice, DeviceFile};

use crate::config::DriveConfig;
use crate::parameter::DeviceParameter;
use crate::script::OutputScript;
use crate::table::SignalTable;

/// A device of a file that is to be driven.
#[derive(Clone, Debug)]
pub struct FileDevice {
    /// Its name among the devices of the bus.
    pub name: String,
    /// Its file.
    pub file: DeviceFile,
    /// Choice from the file.
    pub chosen: ChosenDevice,
    /// Its outputs over time.
    pub script: OutputScript,
    /// Its settings.
    pub config: DriveConfig,
}

/// Names of what a device exchanges.
pub(crate) struct OpenedDevice {
    pub(crate) inputs: SignalTable,
    pub(crate) outputs: SignalTable,
    pub(crate) parameters: Vec<DeviceParameter>,
}
