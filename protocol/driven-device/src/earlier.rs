//! Faults of a device from before its connection, and its modules on EtherCAT: the controller reads them once data are exchanged.

use device_files::{ChosenDevice, DeviceFile};

use crate::parameter::{DeviceParameter, Earlier, ParameterAccess, ParameterTarget};
use crate::{ethercat, ethernet_ip, profinet};

/// Returns the first reads of a device.
pub(crate) fn first(chosen: &ChosenDevice) -> Vec<ParameterAccess> {
    let places: Vec<Option<DeviceParameter>> = match chosen {
        ChosenDevice::Gsdml(_) => vec![profinet::by_place(profinet::DIAGNOSIS_RECORD)],
        ChosenDevice::Eds(_) => vec![ethernet_ip::by_place(ethernet_ip::STATUS)],
        // A device without objects has none of diagnosis.
        ChosenDevice::Esi(device) if device.mailbox.as_ref().is_none_or(|it| it.coe.is_none()) => Vec::new(),
        ChosenDevice::Esi(device) => {
            let modules = (device.slot_count > 0).then_some(ethercat::DETECTED_COUNT);
            let places = [ethercat::ERROR_COUNT, ethercat::NEWEST_MESSAGE].into_iter().chain(modules);
            places.map(ethercat::by_place).collect()
        }
    };
    places.into_iter().flatten().map(ParameterAccess::of_diagnosis).collect()
}

/// Returns what an answer says.
pub(crate) fn read(
    file: &DeviceFile,
    chosen: &ChosenDevice,
    asked: &ParameterTarget,
    bytes: &[u8],
) -> Earlier {
    match (file, chosen, asked) {
        (DeviceFile::Gsdml(gsdml), ..) => profinet::earlier(gsdml, bytes).into(),
        (DeviceFile::Eds(_), ..) => ethernet_ip::earlier(bytes).into(),
        (DeviceFile::Esi(_), ChosenDevice::Esi(chosen), ParameterTarget::Object(index, subindex)) => {
            ethercat::earlier(chosen, *index, *subindex, bytes)
        }
        (DeviceFile::Esi(_), ..) => Earlier::default(),
    }
}
