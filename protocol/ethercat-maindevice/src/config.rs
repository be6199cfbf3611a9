//! What a MainDevice expects on its cable, and how often it exchanges process data.

use machine::Duration;
use machine::ethernet::Mac;

/// Largest number of devices that are up or down together.
pub(crate) const MAX_DEVICES: usize = 16;

/// Largest length in bytes of the process data of one device, or of devices that are up or down together, so that one frame
/// carries them.
pub const MAX_PROCESS_DATA: usize = 1400;

/// A MainDevice and the devices that it drives.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Config {
    /// Address of the interface. The source address of the frames is made of it, so it distinguishes them from those of other
    /// MainDevices.
    pub mac: Mac,
    /// The devices in the order in which they are on the cable.
    pub devices: Vec<ExpectedDevice>,
    /// Time from one exchange of process data to the next.
    pub cycle: Duration,
    /// Time without a good exchange after which the MainDevice ends the connection. The watchdogs of the devices use the
    /// same time.
    pub watchdog: Duration,
}

/// A SubDevice that has to be there.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ExpectedDevice {
    /// Vendor ID.
    pub vendor: u32,
    /// Product code.
    pub product: u32,
    /// Revision; any, if `None`.
    pub revision: Option<u32>,
    /// Process data that it receives, in bytes.
    pub output_bytes: usize,
    /// Process data that it sends, in bytes.
    pub input_bytes: usize,
}

impl Config {
    pub(crate) fn output_bytes(&self) -> usize {
        self.devices.iter().map(|device| device.output_bytes).sum()
    }

    pub(crate) fn input_bytes(&self) -> usize {
        self.devices.iter().map(|device| device.input_bytes).sum()
    }

    /// Returns the working counter of a good exchange: a device adds 1 for its inputs and 2 for its outputs.
    pub(crate) fn working_counter(&self) -> u16 {
        let contribution = |device: &ExpectedDevice| {
            u16::from(device.input_bytes > 0) + 2 * u16::from(device.output_bytes > 0)
        };
        self.devices.iter().map(contribution).sum()
    }

    /// Returns the working counter of an exchange in which the devices send inputs and take no outputs.
    pub(crate) fn inputs_working_counter(&self) -> u16 {
        self.devices.iter().map(|device| u16::from(device.input_bytes > 0)).sum()
    }
}
