//! The description of a chosen device for whoever runs its stack, as the robot node does with an image in its data.

use std::sync::{Mutex, PoisonError};

use device_files::ChosenDevice;
use ethercat_subdevice::DeviceConfig;

use crate::config::EmulationError;
use crate::faults::Alteration;
use crate::{ethercat, ethernet_ip, profinet as io_device};

/// Description that the stack of a bus takes.
#[derive(Clone, Debug)]
pub enum DeviceDescription {
    /// IO-Device.
    Profinet(profinet::description::Description),
    /// Adapter.
    EthernetIp(&'static ::ethernet_ip::description::Description),
    /// SubDevice.
    Ethercat(DeviceConfig),
}

/// Descriptions made so far. They live as long as the program, and a study opens the same device for each of its jobs.
static MADE: Mutex<Vec<(ChosenDevice, DeviceDescription)>> = Mutex::new(Vec::new());

/// Serial number of a device whose owner gives it none.
const SERIAL_NUMBER: u32 = 1;

/// Makes the description of a device. The same device has its description from the first call.
///
/// # Errors
///
/// The device has a form that the stack does not have.
pub fn describe(chosen: &ChosenDevice) -> Result<DeviceDescription, EmulationError> {
    let mut made = MADE.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, description)) = made.iter().find(|(known, _)| known == chosen) {
        return Ok(description.clone());
    }
    let plain = Alteration::default();
    let description = match chosen {
        ChosenDevice::Gsdml(device) => {
            DeviceDescription::Profinet(io_device::describe(device, &plain, SERIAL_NUMBER)?)
        }
        ChosenDevice::Eds(adapter) => {
            DeviceDescription::EthernetIp(Box::leak(Box::new(ethernet_ip::describe(adapter, &plain))))
        }
        ChosenDevice::Esi(device) => {
            DeviceDescription::Ethercat(ethercat::configure(device, &plain, SERIAL_NUMBER)?)
        }
    };
    made.push((chosen.clone(), description.clone()));
    Ok(description)
}
