//! The stack of a device's bus: opened, asked for inputs and given outputs.

use device_files::{ChosenDevice, DeviceFile};
use ethercat_maindevice::{MainDevice, SubDeviceId};
use ethernet_ip::{ConnectionId, Scanner};
use machine::{Counters, Instant, LinkEvent, Machine};
use profinet::{ArId, Controller};

use crate::config::{DriveConfig, DriveError};
use crate::parameter::{DeviceParameter, ParameterAccess};
use crate::table::{InputChange, SignalTable};
use crate::{ethercat, ethernet_ip as scanner, profinet as controller};

#[derive(Debug)]
pub(crate) enum Stack {
    Profinet(Box<Controller>, ArId),
    EthernetIp(Box<Scanner>, ConnectionId),
    Ethercat(Box<MainDevice>, SubDeviceId),
}

/// Calls a method of whichever stack there is.
macro_rules! stack {
    ($stack:expr, $machine:ident => $call:expr) => {
        match $stack {
            Stack::Profinet($machine, _) => $call,
            Stack::EthernetIp($machine, _) => $call,
            Stack::Ethercat($machine, _) => $call,
        }
    };
}
pub(crate) use stack;

/// Stack with the names of what it exchanges.
pub(crate) struct Opened {
    pub(crate) stack: Stack,
    pub(crate) inputs: SignalTable,
    pub(crate) outputs: SignalTable,
    pub(crate) parameters: Vec<DeviceParameter>,
}

/// Opens the stack of a chosen device.
pub(crate) fn open(
    file: &DeviceFile,
    chosen: &ChosenDevice,
    config: &DriveConfig,
    now: Instant,
) -> Result<Opened, DriveError> {
    let has_two_intervals = config.output_interval.is_some() || config.input_interval.is_some();
    if has_two_intervals && !matches!(file, DeviceFile::Eds(_)) {
        let fault = "an interval for each direction: only EtherNet/IP has it; give one interval for both";
        return Err(DriveError::Bus(fault.to_owned()));
    }
    match (file, chosen) {
        (DeviceFile::Gsdml(gsdml), ChosenDevice::Gsdml(chosen)) => {
            let (machine, id, inputs, outputs) = controller::open(gsdml, chosen, config, now)?;
            let parameters = controller::parameters(chosen);
            Ok(Opened { stack: Stack::Profinet(Box::new(machine), id), inputs, outputs, parameters })
        }
        (DeviceFile::Eds(eds), ChosenDevice::Eds(chosen)) => {
            let (machine, id, inputs, outputs) = scanner::open(eds, chosen, config, now)?;
            let parameters = scanner::parameters(eds);
            Ok(Opened { stack: Stack::EthernetIp(Box::new(machine), id), inputs, outputs, parameters })
        }
        (DeviceFile::Esi(_), ChosenDevice::Esi(chosen)) => {
            let (machine, id, inputs, outputs) = ethercat::open(chosen, config, now)?;
            let parameters = ethercat::parameters(chosen);
            Ok(Opened { stack: Stack::Ethercat(Box::new(machine), id), inputs, outputs, parameters })
        }
        _ => Err(DriveError::File("the chosen device is of another file".to_owned())),
    }
}

impl Stack {
    pub(crate) const fn bus(&self) -> &'static str {
        match self {
            Self::Profinet(..) => "PROFINET",
            Self::EthernetIp(..) => "EtherNet/IP",
            Self::Ethercat(..) => "EtherCAT",
        }
    }

    pub(crate) fn is_up(&self) -> bool {
        match self {
            Self::Profinet(machine, id) => machine.ar(*id).is_some_and(profinet::Ar::is_up),
            Self::EthernetIp(machine, id) => {
                machine.connection(*id).is_some_and(ethernet_ip::Connection::is_up)
            }
            Self::Ethercat(machine, id) => machine.inputs(*id).is_some(),
        }
    }

    pub(crate) fn counters(&self) -> Counters {
        match self {
            Self::Profinet(machine, id) => machine.ar(*id).map(profinet::Ar::counters).unwrap_or_default(),
            Self::EthernetIp(machine, id) => {
                machine.connection(*id).map(ethernet_ip::Connection::counters).unwrap_or_default()
            }
            Self::Ethercat(machine, id) => machine.counters(*id) + machine.cable_counters(),
        }
    }

    /// Returns whether cyclic data arrived since the last call.
    pub(crate) fn poll_received(&mut self) -> bool {
        match self {
            Self::Profinet(machine, _) => machine.poll_received().is_some(),
            Self::EthernetIp(machine, _) => machine.poll_received().is_some(),
            Self::Ethercat(machine, _) => machine.poll_received().is_some(),
        }
    }

    /// Copies the newest inputs.
    pub(crate) fn read_inputs(&self, inputs: &mut SignalTable) -> InputChange {
        let data = match self {
            Self::Profinet(machine, id) => {
                return machine
                    .ar(*id)
                    .map_or(InputChange::Invalid, |ar| controller::read_inputs(ar, inputs));
            }
            Self::EthernetIp(machine, id) => machine.connection(*id).and_then(ethernet_ip::Connection::input),
            Self::Ethercat(machine, id) => machine.inputs(*id),
        };
        let Some(data) = data else { return InputChange::Invalid };
        let most = data.len().min(inputs.bytes().len());
        match inputs.copy(0, data.get(..most).unwrap_or_default()) {
            true => InputChange::Changed,
            false => InputChange::Same,
        }
    }

    /// Gives the outputs to the stack: zeros that the device is to ignore while they do not run.
    pub(crate) fn write_outputs(&mut self, outputs: &SignalTable, is_running: bool) {
        match self {
            Self::Profinet(machine, id) => {
                if let Some(ar) = machine.ar_mut(*id) {
                    controller::write_outputs(ar, outputs, is_running);
                }
            }
            Self::EthernetIp(machine, id) => {
                if let Some(connection) = machine.connection_mut(*id) {
                    connection.set_run(is_running);
                    copy_outputs(connection.output_mut(), outputs, is_running);
                }
            }
            Self::Ethercat(machine, id) => {
                machine.hold_safe_op(*id, !is_running);
                copy_outputs(machine.outputs_mut(*id), outputs, is_running);
            }
        }
    }

    pub(crate) fn disconnect(&mut self, now: Instant) {
        match self {
            Self::Profinet(machine, id) => {
                if let Some(ar) = machine.ar_mut(*id) {
                    ar.disconnect(now);
                }
            }
            Self::EthernetIp(machine, id) => {
                if let Some(connection) = machine.connection_mut(*id) {
                    connection.disconnect(now);
                }
            }
            Self::Ethercat(machine, id) => machine.disconnect(now, *id),
        }
    }

    pub(crate) fn poll_link(&mut self) -> Option<LinkEvent> {
        match self {
            Self::Profinet(machine, _) => machine.poll_event().map(|(_, event)| event),
            Self::EthernetIp(machine, _) => machine.poll_event().map(|(_, event)| event),
            Self::Ethercat(machine, _) => machine.poll_event().map(|(_, event)| event),
        }
    }

    /// Returns details of the last failure.
    pub(crate) fn explain(&self) -> String {
        let mut words = String::new();
        // Writing to a String cannot fail.
        let _ = match self {
            Self::Profinet(machine, id) => machine.ar(*id).map_or(Ok(()), |ar| ar.explain(&mut words)),
            Self::EthernetIp(machine, id) => {
                machine.connection(*id).map_or(Ok(()), |connection| connection.explain(&mut words))
            }
            Self::Ethercat(machine, id) => machine.explain(*id, &mut words),
        };
        words
    }

    /// Returns the identity of the connected device in words; empty where the bus checks it before.
    pub(crate) fn identity(&self, chosen: &ChosenDevice) -> String {
        match (self, chosen) {
            (Self::EthernetIp(machine, id), _) => {
                let found = machine.connection(*id).and_then(ethernet_ip::Connection::identity);
                found.map_or_else(String::new, |found| {
                    let ethernet_ip::cip::ElectronicKey { vendor, product_code, revision, .. } = found.key;
                    format!(
                        "vendor {vendor}, product code {product_code}, revision {}.{}, serial number 0x{:08X}",
                        revision.major, revision.minor, found.serial_number
                    )
                })
            }
            (_, ChosenDevice::Gsdml(device)) => {
                format!("vendor 0x{:04X}, device 0x{:04X}", device.vendor_id, device.device_id)
            }
            (_, ChosenDevice::Esi(device)) => {
                format!("vendor 0x{:08X}, product 0x{:08X}", device.vendor_id, device.product_code)
            }
            (_, ChosenDevice::Eds(_)) => String::new(),
        }
    }

    /// Returns in what the connected device differs from the file.
    pub(crate) fn differences(&self, chosen: &ChosenDevice) -> Vec<String> {
        match (self, chosen) {
            (Self::Profinet(machine, id), ChosenDevice::Gsdml(chosen)) => {
                machine.ar(*id).map(|ar| controller::differences(ar, chosen)).unwrap_or_default()
            }
            (Self::EthernetIp(machine, id), ChosenDevice::Eds(chosen)) => {
                let connection = machine.connection(*id);
                connection.map(|connection| scanner::differences(connection, chosen)).unwrap_or_default()
            }
            _ => Vec::new(),
        }
    }

    /// Returns the next alarm, refused record or emergency in words.
    pub(crate) fn poll_alarm(&mut self, file: &DeviceFile) -> Option<String> {
        match (self, file) {
            (Self::Profinet(machine, id), DeviceFile::Gsdml(gsdml)) => {
                let ar = machine.ar_mut(*id)?;
                let alarm = ar.poll_alarm().map(|alarm| controller::describe(gsdml, &alarm));
                alarm.or_else(|| controller::refused_record(ar))
            }
            (Self::Ethercat(machine, id), _) => ethercat::emergency(machine, *id),
            _ => None,
        }
    }

    /// Returns the parameter of a place that the file does not name.
    pub(crate) fn parameter_at(&self, place: &str) -> Option<DeviceParameter> {
        match self {
            Self::Profinet(..) => controller::by_place(place),
            Self::EthernetIp(..) => scanner::by_place(place),
            Self::Ethercat(..) => ethercat::by_place(place),
        }
    }

    /// Sends an access to a parameter.
    pub(crate) fn access(&mut self, now: Instant, access: &ParameterAccess) -> Result<(), String> {
        match self {
            Self::Profinet(machine, id) => {
                let ar = machine.ar_mut(*id).ok_or_else(|| "not connected".to_owned())?;
                controller::access(ar, now, access)
            }
            Self::EthernetIp(machine, id) => {
                let connection = machine.connection_mut(*id).ok_or_else(|| "not connected".to_owned())?;
                scanner::access(connection, now, access)
            }
            Self::Ethercat(machine, id) => ethercat::access(machine, *id, access),
        }
    }

    /// Returns the answer to an access once it is there.
    pub(crate) fn answer(&mut self) -> Option<Result<Vec<u8>, String>> {
        match self {
            Self::Profinet(machine, id) => controller::answer(machine.ar_mut(*id)?),
            Self::EthernetIp(machine, id) => scanner::answer(machine.connection_mut(*id)?),
            Self::Ethercat(machine, id) => ethercat::answer(machine, *id),
        }
    }
}

fn copy_outputs(place: &mut [u8], outputs: &SignalTable, is_running: bool) {
    match (is_running, place.get_mut(..outputs.bytes().len())) {
        (true, Some(place)) => place.copy_from_slice(outputs.bytes()),
        _ => place.fill(0),
    }
}
