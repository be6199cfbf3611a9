//! The stack of the devices' bus: opened, asked for inputs and given outputs. Devices are numbered from 0.

use device_files::{ChosenDevice, DeviceFile};
use ethercat_maindevice::{MainDevice, SubDeviceId};
use ethernet_ip::{Connection, ConnectionId, Scanner};
use machine::{Counters, Instant, LinkEvent, Machine};
use profinet::{Ar, ArId, Controller};

use crate::config::{BusConfig, DriveError};
use crate::file_device::{FileDevice, OpenedDevice};
use crate::parameter::{DeviceParameter, ParameterAccess};
use crate::table::{InputChange, SignalTable};
use crate::{ethercat, ethernet_ip as scanner, profinet as controller};

/// The stack, and what each device is to it, in the order of the devices.
#[derive(Debug)]
pub(crate) enum Stack {
    Profinet(Box<Controller>, Vec<ArId>),
    EthernetIp(Box<Scanner>, Vec<ConnectionId>),
    Ethercat(Box<MainDevice>, Vec<SubDeviceId>),
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

/// Opens the stack of chosen devices of one bus.
pub(crate) fn open(
    devices: &[FileDevice],
    bus: &BusConfig,
    now: Instant,
) -> Result<(Stack, Vec<OpenedDevice>), DriveError> {
    let Some(first) = devices.first() else {
        return Err(DriveError::File("no device is given; give a device file".to_owned()));
    };
    for device in devices {
        let has_two_intervals =
            device.config.output_interval.is_some() || device.config.input_interval.is_some();
        if has_two_intervals && !matches!(device.file, DeviceFile::Eds(_)) {
            let fault = "an interval for each direction: only EtherNet/IP has it; give one interval for both";
            return Err(named(devices.len(), &device.name, DriveError::Bus(fault.to_owned())));
        }
        if std::mem::discriminant(&device.file) != std::mem::discriminant(&first.file) {
            return Err(DriveError::Bus(format!(
                "devices `{}` and `{}` are of different buses; drive each bus by a command of its own",
                device_files::excerpt(&first.name),
                device_files::excerpt(&device.name)
            )));
        }
    }
    match first.file {
        DeviceFile::Gsdml(_) => {
            let mut machine = controller::open(bus)?;
            let connected = each(devices, |device| {
                let (DeviceFile::Gsdml(gsdml), ChosenDevice::Gsdml(chosen)) = (&device.file, &device.chosen)
                else {
                    return Err(of_another_file());
                };
                controller::connect(&mut machine, gsdml, chosen, &device.config, now)
            })?;
            let (ids, opened) = connected.into_iter().unzip();
            Ok((Stack::Profinet(Box::new(machine), ids), opened))
        }
        DeviceFile::Eds(_) => {
            let mut machine = scanner::open(bus, now)?;
            let connected = each(devices, |device| {
                let (DeviceFile::Eds(eds), ChosenDevice::Eds(chosen)) = (&device.file, &device.chosen) else {
                    return Err(of_another_file());
                };
                scanner::connect(&mut machine, eds, chosen, &device.config, now)
            })?;
            let (ids, opened) = connected.into_iter().unzip();
            Ok((Stack::EthernetIp(Box::new(machine), ids), opened))
        }
        DeviceFile::Esi(_) => {
            let chosen = each(devices, |device| match &device.chosen {
                ChosenDevice::Esi(chosen) => Ok(ethercat::PlacedDevice {
                    chosen,
                    config: &device.config,
                    expected: ethercat::expected(chosen)?,
                    startup: ethercat::startup_writes(chosen)?,
                }),
                _ => Err(of_another_file()),
            })?;
            let machine = ethercat::open(&chosen, bus, now)?;
            let opened = chosen.iter().map(|device| ethercat::names(device.chosen)).collect();
            let ids = machine.ids().collect();
            Ok((Stack::Ethercat(Box::new(machine), ids), opened))
        }
    }
}

fn of_another_file() -> DriveError {
    DriveError::File("the chosen device is of another file".to_owned())
}

/// Adds the name of a device to its error, where there are `count` of them.
pub(crate) fn named(count: usize, name: &str, error: DriveError) -> DriveError {
    if count < 2 {
        return error;
    }
    DriveError::Device { device: device_files::excerpt(name), error: Box::new(error) }
}

/// Makes something of each device. The error names its device.
fn each<'d, T>(
    devices: &'d [FileDevice],
    mut make: impl FnMut(&'d FileDevice) -> Result<T, DriveError>,
) -> Result<Vec<T>, DriveError> {
    let made =
        devices.iter().map(|device| make(device).map_err(|error| named(devices.len(), &device.name, error)));
    made.collect()
}

impl Stack {
    pub(crate) const fn bus(&self) -> &'static str {
        match self {
            Self::Profinet(..) => "PROFINET",
            Self::EthernetIp(..) => "EtherNet/IP",
            Self::Ethercat(..) => "EtherCAT",
        }
    }

    pub(crate) fn is_up(&self, device: usize) -> bool {
        match self {
            Self::Profinet(machine, ids) => ar(machine, ids, device).is_some_and(Ar::is_up),
            Self::EthernetIp(machine, ids) => connection(machine, ids, device).is_some_and(Connection::is_up),
            Self::Ethercat(machine, ids) => machine.inputs(sub_device(ids, device)).is_some(),
        }
    }

    /// Returns whether a device has a connection without data.
    pub(crate) fn is_null(&self, device: usize) -> bool {
        match self {
            Self::EthernetIp(machine, ids) => {
                connection(machine, ids, device).is_some_and(Connection::is_null)
            }
            Self::Profinet(..) | Self::Ethercat(..) => false,
        }
    }

    pub(crate) fn counters(&self, device: usize) -> Counters {
        match self {
            Self::Profinet(machine, ids) => ar(machine, ids, device).map(Ar::counters).unwrap_or_default(),
            Self::EthernetIp(machine, ids) => {
                connection(machine, ids, device).map(Connection::counters).unwrap_or_default()
            }
            Self::Ethercat(machine, ids) => {
                machine.counters(sub_device(ids, device)) + machine.cable_counters()
            }
        }
    }

    /// Returns the next device whose cyclic data arrived since the last call.
    pub(crate) fn poll_received(&mut self) -> Option<usize> {
        match self {
            Self::Profinet(machine, ids) => machine.poll_received().and_then(|id| place(ids, id)),
            Self::EthernetIp(machine, ids) => machine.poll_received().and_then(|id| place(ids, id)),
            Self::Ethercat(machine, ids) => machine.poll_received().and_then(|id| place(ids, id)),
        }
    }

    /// Copies the newest inputs.
    pub(crate) fn read_inputs(&self, device: usize, inputs: &mut SignalTable) -> InputChange {
        let data = match self {
            Self::Profinet(machine, ids) => {
                return ar(machine, ids, device)
                    .map_or(InputChange::Invalid, |ar| controller::read_inputs(ar, inputs));
            }
            Self::EthernetIp(machine, ids) => connection(machine, ids, device).and_then(Connection::input),
            Self::Ethercat(machine, ids) => machine.inputs(sub_device(ids, device)),
        };
        let Some(data) = data else { return InputChange::Invalid };
        let most = data.len().min(inputs.bytes().len());
        match inputs.copy(0, data.get(..most).unwrap_or_default()) {
            true => InputChange::Changed,
            false => InputChange::Same,
        }
    }

    /// Gives the outputs to the stack: zeros that the device is to ignore while they do not run.
    pub(crate) fn write_outputs(&mut self, device: usize, outputs: &SignalTable, is_running: bool) {
        match self {
            Self::Profinet(machine, ids) => {
                if let Some(ar) = ar_mut(machine, ids, device) {
                    controller::write_outputs(ar, outputs, is_running);
                }
            }
            Self::EthernetIp(machine, ids) => {
                if let Some(connection) = connection_mut(machine, ids, device) {
                    connection.set_run(is_running);
                    copy_outputs(connection.output_mut(), outputs, is_running);
                }
            }
            Self::Ethercat(machine, ids) => {
                machine.hold_safe_op(sub_device(ids, device), !is_running);
                copy_outputs(machine.outputs_mut(sub_device(ids, device)), outputs, is_running);
            }
        }
    }

    pub(crate) fn disconnect(&mut self, now: Instant, device: usize) {
        match self {
            Self::Profinet(machine, ids) => {
                if let Some(ar) = ar_mut(machine, ids, device) {
                    ar.disconnect(now);
                }
            }
            Self::EthernetIp(machine, ids) => {
                if let Some(connection) = connection_mut(machine, ids, device) {
                    connection.disconnect(now);
                }
            }
            Self::Ethercat(machine, ids) => machine.disconnect(now, sub_device(ids, device)),
        }
    }

    pub(crate) fn poll_link(&mut self) -> Option<(usize, LinkEvent)> {
        match self {
            Self::Profinet(machine, ids) => {
                machine.poll_event().and_then(|(id, event)| Some((place(ids, id)?, event)))
            }
            Self::EthernetIp(machine, ids) => {
                machine.poll_event().and_then(|(id, event)| Some((place(ids, id)?, event)))
            }
            Self::Ethercat(machine, ids) => {
                machine.poll_event().and_then(|(id, event)| Some((place(ids, id)?, event)))
            }
        }
    }

    /// Returns details of the last failure.
    pub(crate) fn explain(&self, device: usize) -> String {
        let mut words = String::new();
        // Writing to a String cannot fail.
        let _ = match self {
            Self::Profinet(machine, ids) => {
                ar(machine, ids, device).map_or(Ok(()), |ar| ar.explain(&mut words))
            }
            Self::EthernetIp(machine, ids) => {
                connection(machine, ids, device).map_or(Ok(()), |connection| connection.explain(&mut words))
            }
            Self::Ethercat(machine, ids) => machine.explain(sub_device(ids, device), &mut words),
        };
        words
    }

    /// Returns the identity of the connected device in words; empty where the bus checks it before.
    pub(crate) fn identity(&self, device: usize, chosen: &ChosenDevice) -> String {
        match (self, chosen) {
            (Self::EthernetIp(machine, ids), _) => {
                let found = connection(machine, ids, device).and_then(Connection::identity);
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
    pub(crate) fn differences(&self, device: usize, chosen: &ChosenDevice) -> Vec<String> {
        match (self, chosen) {
            (Self::Profinet(machine, ids), ChosenDevice::Gsdml(chosen)) => {
                ar(machine, ids, device).map(|ar| controller::differences(ar, chosen)).unwrap_or_default()
            }
            (Self::EthernetIp(machine, ids), ChosenDevice::Eds(chosen)) => {
                let connection = connection(machine, ids, device);
                connection.map(|connection| scanner::differences(connection, chosen)).unwrap_or_default()
            }
            _ => Vec::new(),
        }
    }

    /// Returns the next alarm, refused record or emergency in words.
    pub(crate) fn poll_alarm(&mut self, device: usize, file: &DeviceFile) -> Option<String> {
        match (self, file) {
            (Self::Profinet(machine, ids), DeviceFile::Gsdml(gsdml)) => {
                let ar = ar_mut(machine, ids, device)?;
                let alarm = ar.poll_alarm().map(|alarm| controller::describe(gsdml, &alarm));
                alarm.or_else(|| controller::refused_record(ar))
            }
            (Self::Ethercat(machine, ids), _) => ethercat::emergency(machine, sub_device(ids, device)),
            _ => None,
        }
    }

    /// Sends an access to a parameter.
    pub(crate) fn access(
        &mut self,
        now: Instant,
        device: usize,
        access: &ParameterAccess,
    ) -> Result<(), String> {
        match self {
            Self::Profinet(machine, ids) => {
                let ar = ar_mut(machine, ids, device).ok_or_else(|| "not connected".to_owned())?;
                controller::access(ar, now, access)
            }
            Self::EthernetIp(machine, ids) => {
                let connection =
                    connection_mut(machine, ids, device).ok_or_else(|| "not connected".to_owned())?;
                scanner::access(connection, now, access)
            }
            Self::Ethercat(machine, ids) => ethercat::access(machine, sub_device(ids, device), access),
        }
    }

    /// Returns the answer to an access once it is there.
    pub(crate) fn answer(&mut self, device: usize) -> Option<Result<Vec<u8>, String>> {
        match self {
            Self::Profinet(machine, ids) => controller::answer(ar_mut(machine, ids, device)?),
            Self::EthernetIp(machine, ids) => scanner::answer(connection_mut(machine, ids, device)?),
            Self::Ethercat(machine, ids) => ethercat::answer(machine, sub_device(ids, device)),
        }
    }
}

fn copy_outputs(place: &mut [u8], outputs: &SignalTable, is_running: bool) {
    match (is_running, place.get_mut(..outputs.bytes().len())) {
        (true, Some(place)) => place.copy_from_slice(outputs.bytes()),
        _ => place.fill(0),
    }
}

/// Returns the parameter of a place that the file does not name.
pub(crate) fn parameter_at(file: &DeviceFile, place: &str) -> Option<DeviceParameter> {
    match file {
        DeviceFile::Gsdml(_) => controller::by_place(place),
        DeviceFile::Eds(_) => scanner::by_place(place),
        DeviceFile::Esi(_) => ethercat::by_place(place),
    }
}

fn place<I: PartialEq>(ids: &[I], id: I) -> Option<usize> {
    ids.iter().position(|known| *known == id)
}

fn ar<'m>(machine: &'m Controller, ids: &[ArId], device: usize) -> Option<&'m Ar> {
    machine.ar(*ids.get(device)?)
}

fn ar_mut<'m>(machine: &'m mut Controller, ids: &[ArId], device: usize) -> Option<&'m mut Ar> {
    machine.ar_mut(*ids.get(device)?)
}

fn connection<'m>(machine: &'m Scanner, ids: &[ConnectionId], device: usize) -> Option<&'m Connection> {
    machine.connection(*ids.get(device)?)
}

fn connection_mut<'m>(
    machine: &'m mut Scanner,
    ids: &[ConnectionId],
    device: usize,
) -> Option<&'m mut Connection> {
    machine.connection_mut(*ids.get(device)?)
}

/// Returns the number of a device. That of one which there is not is none of the MainDevice's either.
fn sub_device(ids: &[SubDeviceId], device: usize) -> SubDeviceId {
    ids.get(device).copied().unwrap_or(SubDeviceId(u16::MAX))
}
