//! The stack of a device's bus: opened, given inputs and asked for outputs.

use device_files::{ChosenDevice, ChosenIoDevice};
use ethercat_subdevice::{DeviceId, Segment};
use ethernet_ip::Adapter;
use machine::Instant;
use profinet::Device;
use profinet::alarm::{AlarmHead, Notification, Priority};
use profinet::record::Diagnosis;

use crate::config::{EmulationConfig, EmulationError};
use crate::faults::Alteration;
use crate::image::{Image, copy};
use crate::script::ScriptedFault;
use crate::{ethercat, ethernet_ip as adapter, profinet as io_device};

#[derive(Debug)]
pub(crate) enum Stack {
    Profinet(Box<Device>),
    EthernetIp(Box<Adapter>),
    Ethercat(Box<Segment>, DeviceId),
}

/// Calls a method of whichever stack there is.
macro_rules! stack {
    ($stack:expr, $machine:ident => $call:expr) => {
        match $stack {
            Stack::Profinet($machine) => $call,
            Stack::EthernetIp($machine) => $call,
            Stack::Ethercat($machine, _) => $call,
        }
    };
}
pub(crate) use stack;

impl Stack {
    /// Copies the outputs, and notes which of them count. Returns whether either has changed.
    pub(crate) fn read_outputs(&self, outputs: &mut Image) -> bool {
        match self {
            Stack::Profinet(device) => {
                let mut own = device.outputs();
                let mut is_changed = false;
                for (place, counts) in outputs.places.iter().zip(&mut outputs.counts) {
                    // The places are the submodules with outputs, in the order of the frame.
                    let data = own.next().and_then(|(_, data)| data);
                    is_changed |= *counts != data.is_some();
                    *counts = data.is_some();
                    let to = outputs.bytes.get_mut(place.bit / 8..(place.bit + place.bits) / 8);
                    if let (Some(to), Some(data)) = (to, data) {
                        is_changed |= copy(to, data);
                    }
                }
                is_changed
            }
            Stack::EthernetIp(adapter) => {
                let instance = outputs.places.first().and_then(|place| place.place.parse().ok());
                let data = instance.and_then(|instance| adapter.consumed(instance));
                outputs.set_all(data)
            }
            Stack::Ethercat(segment, id) => {
                let data = segment.outputs(*id);
                let most = outputs.bytes.len();
                outputs.set_all(data.map(|data| data.get(..most).unwrap_or(data)))
            }
        }
    }

    /// Gives the inputs to the stack.
    pub(crate) fn write_inputs(&mut self, inputs: &Image, extra: u16) {
        if inputs.bytes.is_empty() {
            return;
        }
        match self {
            Stack::Profinet(device) => {
                let mut at = 0;
                device.set_inputs(|_, _, data| {
                    if let Some(from) = inputs.bytes.get(at..at + data.len()) {
                        data.copy_from_slice(from);
                    }
                    at += data.len();
                });
            }
            Stack::EthernetIp(adapter) => {
                let instance = inputs.places.first().and_then(|place| place.place.parse().ok());
                // Place and length are those of the adapter's own description.
                let _ = instance.map(|instance| adapter.set_produced(instance, &inputs.bytes));
            }
            Stack::Ethercat(segment, id) => {
                // A device with a wrong size has bytes that no script names.
                if extra > 0 {
                    let mut longer = inputs.bytes.to_vec();
                    longer.resize(longer.len() + usize::from(extra), 0);
                    let _ = segment.set_inputs(*id, &longer);
                } else {
                    let _ = segment.set_inputs(*id, &inputs.bytes);
                }
            }
        }
    }
}

/// Opens the stack of a chosen device, changed by faults.
pub(crate) fn open(
    chosen: &ChosenDevice,
    alteration: &Alteration,
    config: &EmulationConfig,
    now: Instant,
) -> Result<(Stack, Image, Image), EmulationError> {
    Ok(match chosen {
        ChosenDevice::Gsdml(device) => {
            let (device, inputs, outputs) = io_device::open(device, alteration, config, now)?;
            (Stack::Profinet(Box::new(device)), inputs, outputs)
        }
        ChosenDevice::Eds(chosen) => {
            let (adapter, inputs, outputs) = adapter::open(chosen, alteration, config)?;
            (Stack::EthernetIp(Box::new(adapter)), inputs, outputs)
        }
        ChosenDevice::Esi(device) => {
            let (segment, id, inputs, outputs) = ethercat::open(device, alteration, config)?;
            (Stack::Ethercat(Box::new(segment), id), inputs, outputs)
        }
    })
}

/// Returns ModuleIdentNumber and SubmoduleIdentNumber where an alarm comes from.
pub(crate) fn idents(device: &ChosenIoDevice, fault: &ScriptedFault) -> Option<(u32, u32)> {
    let module = device.modules.iter().find(|module| module.slot == fault.slot)?;
    let submodule = module.submodules.iter().find(|submodule| submodule.subslot == fault.subslot)?;
    Some((module.ident, submodule.ident))
}

/// UserStructureIdentifier of ChannelDiagnosisData.
const CHANNEL_DIAGNOSIS: u16 = 0x8000;

/// ChannelProperties.Specifier, bits 11 and 12.
const APPEARING: u16 = 1 << 11;
const DISAPPEARING: u16 = 2 << 11;

/// Returns the diagnosis of a channel as the device keeps it.
pub(crate) fn diagnosis(fault: &ScriptedFault) -> Diagnosis {
    let words = [fault.channel, APPEARING, fault.code].map(u16::to_be_bytes);
    Diagnosis {
        api: 0,
        slot: fault.slot,
        subslot: fault.subslot,
        channel: fault.channel,
        properties: APPEARING,
        identifier: CHANNEL_DIAGNOSIS,
        data: words.as_flattened().to_vec(),
    }
}

/// Sends a diagnosis of a channel, appearing or disappearing (IEC 61158-6-10, ChannelDiagnosisData). Returns whether it is on its
/// way.
pub(crate) fn raise(
    device: &mut Device,
    chosen: &ChosenDevice,
    fault: &ScriptedFault,
    appears: bool,
) -> bool {
    const APPEARS: u16 = 1;
    const DISAPPEARS: u16 = 0x0C;
    let specifier = if appears { APPEARING } else { DISAPPEARING };
    // AlarmSpecifier: channel diagnosis, state of the submodule, state of the AR.
    let pending: u16 = if appears { 1 << 11 | 1 << 13 | 1 << 15 } else { 0 };
    let ChosenDevice::Gsdml(chosen) = chosen else { return false };
    let Some((module_ident, submodule_ident)) = idents(chosen, fault) else { return false };
    let words = [CHANNEL_DIAGNOSIS, fault.channel, specifier, fault.code].map(u16::to_be_bytes);
    let head = AlarmHead {
        alarm_type: if appears { APPEARS } else { DISAPPEARS },
        api: 0,
        slot: fault.slot,
        subslot: fault.subslot,
    };
    let items = words.as_flattened();
    let priority = Priority::Low;
    let alarm = Notification { priority, head, module_ident, submodule_ident, specifier: pending, items };
    device.raise(&alarm).is_ok()
}
