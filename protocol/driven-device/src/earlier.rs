//! Faults of a device from before its connection: the controller reads them once data are exchanged.

use device_files::{ChosenDevice, DeviceFile};

use crate::parameter::{DeviceParameter, Earlier, ParameterAccess, ParameterTarget};
use crate::{ethercat, ethernet_ip, profinet};

/// Returns the first reads of a device.
pub(crate) fn first(chosen: &ChosenDevice) -> Vec<ParameterAccess> {
    let places: &[Option<DeviceParameter>] = &match chosen {
        ChosenDevice::Gsdml(_) => [profinet::by_place(profinet::DIAGNOSIS_RECORD), None],
        ChosenDevice::Eds(_) => [ethernet_ip::by_place(ethernet_ip::STATUS), None],
        // A device without objects has none of diagnosis.
        ChosenDevice::Esi(device) if device.mailbox.as_ref().is_none_or(|it| it.coe.is_none()) => {
            [None, None]
        }
        ChosenDevice::Esi(_) => [ethercat::ERROR_COUNT, ethercat::NEWEST_MESSAGE].map(ethercat::by_place),
    };
    places.iter().flatten().cloned().map(ParameterAccess::of_diagnosis).collect()
}

/// Returns what an answer says.
pub(crate) fn read(file: &DeviceFile, asked: &ParameterTarget, bytes: &[u8]) -> Earlier {
    match (file, asked) {
        (DeviceFile::Gsdml(gsdml), _) => profinet::earlier(gsdml, bytes).into(),
        (DeviceFile::Eds(_), _) => ethernet_ip::earlier(bytes).into(),
        (DeviceFile::Esi(_), ParameterTarget::Object(index, subindex)) => {
            ethercat::earlier(*index, *subindex, bytes)
        }
        (DeviceFile::Esi(_), _) => Earlier::default(),
    }
}
