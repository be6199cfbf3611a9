//! PROFINET: from a GSDML and the chosen modules to an AR, its signals, its records and what its alarms say.

mod alarm;

use device_files::{ChosenIoDevice, ChosenSubmodule, DataItem, FoundModule, Gsdml, GsdmlModule, IoDirection};
use machine::{Duration, Instant};
use profinet::connect::ModuleState;
use profinet::description::{Description, INTERFACE_SUBSLOT, Identity, Module, Submodule};
use profinet::rt::Transport;
use profinet::status::Status;
use profinet::{Ar, ArConfig, ArId, Controller, ControllerConfig, Parameter as Record};

use crate::config::{BusConfig, DriveConfig, DriveError};
use crate::file_device::OpenedDevice;
use crate::parameter::{DeviceParameter, ParameterAccess, ParameterTarget};
use crate::signal::{Signal, SignalType};
use crate::table::{InputChange, SignalTable, TablePart};

pub(crate) use alarm::{describe, earlier};

/// Interval where neither the user nor the file gives a longer one.
const DEFAULT_INTERVAL: Duration = Duration::from_millis(4);

/// Time without data after which the connection ends: hosts stall for 10 to 20 ms.
const WATCHDOG: Duration = Duration::from_millis(200);

/// Own station on the wire. Its numbers are placeholders, as those of our PLC.
const OWN: Description = Description {
    identity: Identity { vendor: 0xFFFF, device: 0x0003 },
    station_type: "skillbench io",
    order_id: "skillbench-io",
    serial_number: "1",
    hardware_revision: 1,
    software_revision: [0, 1, 0],
    min_device_interval: 32,
    modules: &[],
};

/// Opens the controller without an AR.
pub(crate) fn open(bus: &BusConfig) -> Result<Controller, DriveError> {
    let controller = Controller::new(ControllerConfig {
        mac: bus.mac,
        station_name: "skillbench-io".to_owned(),
        address: bus.address.ok_or(DriveError::NoAddress)?,
        mask: bus.mask,
        description: OWN,
        seed: bus.seed,
    });
    controller.map_err(refused)
}

fn refused(error: profinet::ConfigError) -> DriveError {
    DriveError::Bus(error.to_string())
}

/// Adds the AR of a device.
pub(crate) fn connect(
    controller: &mut Controller,
    gsdml: &Gsdml,
    chosen: &ChosenIoDevice,
    config: &DriveConfig,
    now: Instant,
) -> Result<(ArId, OpenedDevice), DriveError> {
    let device_address = config.device_address.ok_or(DriveError::NoDeviceAddress)?;
    let description = description(chosen)?;
    // MinDeviceInterval is in units of 31.25 us.
    let shortest = Duration::from_nanos(31_250 * u64::from(chosen.min_device_interval));
    let cycle = config.interval.unwrap_or_else(|| DEFAULT_INTERVAL.max(shortest));
    let watchdog = WATCHDOG.as_nanos().div_ceil(cycle.as_nanos().max(1)).clamp(3, 255);
    let settings = ArConfig {
        station_name: config.station_name.clone().unwrap_or_else(|| chosen.station_name.to_lowercase()),
        address: device_address,
        mac: None,
        description,
        parameters: startup_records(chosen),
        transport: Transport::Rt1,
        cycle,
        watchdog_cycles: watchdog as u16,
    };
    let id = controller.connect(settings, now).map_err(refused)?;
    if let Some(ar) = controller.ar_mut(id) {
        ar.keep_alarms();
        ar.accept_long_records();
        if gsdml.access_point(&chosen.access_point).is_some_and(|it| it.has_multiple_write) {
            ar.write_together();
        }
        ar.accept_differences();
    }
    let inputs = table(gsdml, chosen, |it| it.input_length, |it| &it.inputs);
    let outputs = table(gsdml, chosen, |it| it.output_length, |it| &it.outputs);
    Ok((id, OpenedDevice { inputs, outputs, parameters: parameters(chosen) }))
}

/// Makes the description that the stack takes. It lives as long as the program, which drives the same devices from its start to its end.
fn description(chosen: &ChosenIoDevice) -> Result<Description, DriveError> {
    let mut modules = Vec::new();
    // A module whose subslots are all empty has no part in the connection (IEC 61158-6-10, NumberOfSubmodules is at least 1).
    for module in chosen.modules.iter().filter(|module| !module.submodules.is_empty()) {
        let mut submodules = Vec::new();
        for submodule in &module.submodules {
            let place = format!("subslot {}.{}", module.slot, submodule.subslot);
            if submodule.api != 0 {
                let fault = format!(
                    "{place} is in API 0x{:04X} of a profile; only API 0 can be driven",
                    submodule.api
                );
                return Err(DriveError::File(fault));
            }
            if submodule.has_data() && submodule.status_lengths != (1, 1) {
                return Err(DriveError::File(format!(
                    "{place} has a status of several bytes; only one can be driven"
                )));
            }
            submodules.push(Submodule {
                subslot: submodule.subslot,
                ident: submodule.ident,
                input_len: submodule.input_length,
                output_len: submodule.output_length,
                parameters: &[],
            });
        }
        modules.push(Module { slot: module.slot, ident: module.ident, submodules: submodules.leak() });
    }
    Ok(Description {
        identity: Identity { vendor: chosen.vendor_id, device: chosen.device_id },
        station_type: "",
        order_id: "",
        serial_number: "",
        hardware_revision: 0,
        software_revision: [0; 3],
        min_device_interval: chosen.min_device_interval,
        modules: modules.leak(),
    })
}

/// Returns the start-up records with their defaults. Those of PROFIsafe are not made.
#[must_use]
pub fn startup_records(chosen: &ChosenIoDevice) -> Vec<Record> {
    let has_interface = submodules(chosen).any(|(_, it)| it.subslot == INTERFACE_SUBSLOT);
    let mut records: Vec<_> = has_interface.then(Record::interface_adjust).into_iter().collect();
    for (slot, submodule) in submodules(chosen) {
        for record in submodule.records.iter().filter(|record| !record.is_safety) {
            let (subslot, index) = (submodule.subslot, record.index);
            records.push(Record { slot, subslot, index, data: record.default.clone() });
        }
    }
    records
}

fn submodules(chosen: &ChosenIoDevice) -> impl Iterator<Item = (u16, &ChosenSubmodule)> {
    chosen.modules.iter().flat_map(|module| module.submodules.iter().map(|it| (module.slot, it)))
}

/// Makes the signals of one direction in the order of slots and subslots, which is that of the frames.
fn table(
    gsdml: &Gsdml,
    chosen: &ChosenIoDevice,
    length: impl Fn(&ChosenSubmodule) -> u16,
    direction: impl Fn(&device_files::GsdmlSubmodule) -> &IoDirection,
) -> SignalTable {
    let (mut signals, mut parts) = (Vec::new(), Vec::new());
    let mut at = 0;
    for module in &chosen.modules {
        for submodule in module.submodules.iter().filter(|submodule| length(submodule) > 0) {
            let place = format!("{}.{}", module.slot, submodule.subslot);
            let len = usize::from(length(submodule));
            let mut whole = Signal::new(&place, &place, SignalType::Bytes, 8 * at, 8 * len);
            whole.is_safety = submodule.is_safety;
            signals.push(whole);
            parts.push(TablePart { len, is_safety: submodule.is_safety });
            let file = file_submodule(gsdml, chosen, &module.id, submodule);
            if let Some(file) = file.filter(|_| !submodule.is_safety) {
                items(&direction(file).items, &place, 8 * at, &mut signals);
            }
            at += len;
        }
    }
    SignalTable::new(signals, at, true).with_parts(parts)
}

/// Finds a submodule in the file: among those of its module, or among the pluggable ones.
fn file_submodule<'g>(
    gsdml: &'g Gsdml,
    chosen: &ChosenIoDevice,
    module: &str,
    submodule: &ChosenSubmodule,
) -> Option<&'g device_files::GsdmlSubmodule> {
    let head = gsdml.access_point(&chosen.access_point).map(|it| &it.module);
    let of_head: Option<&GsdmlModule> = head.filter(|head| head.id == module);
    let module = of_head.or_else(|| gsdml.module(module));
    let own = module.and_then(|module| module.submodules.iter().find(|it| it.id == submodule.id));
    own.or_else(|| gsdml.submodule(&submodule.id))
}

fn items(items: &[DataItem], place: &str, first: usize, signals: &mut Vec<Signal>) {
    let mut bit = first;
    for (number, item) in items.iter().enumerate() {
        let bits = 8 * item.length as usize;
        let own = if item.name.is_empty() { format!("item {}", number + 1) } else { item.name.clone() };
        let name = format!("{place}/{own}");
        signals.push(Signal::new(&name, place, kind(&item.data_type), bit, bits));
        for named in item.bits.iter().filter(|named| usize::from(named.offset) < bits) {
            // Numbers have their highest byte first; bits count from the lowest.
            let offset = usize::from(named.offset);
            let byte = bits / 8 - 1 - offset / 8;
            let name = format!("{name}/{}", named.name);
            signals.push(Signal::new(&name, place, SignalType::Bool, bit + 8 * byte + offset % 8, 1));
        }
        bit += bits;
    }
}

/// Returns the type of a name in GSDML (DataItem, DataType).
fn kind(name: &str) -> SignalType {
    match name {
        "Unsigned8" | "Unsigned16" | "Unsigned32" | "Unsigned64" => SignalType::Unsigned,
        "Integer8" | "Integer16" | "Integer32" | "Integer64" => SignalType::Signed,
        "Float32" | "Float64" => SignalType::Real,
        _ => SignalType::Bytes,
    }
}

/// Copies the inputs. Those that the device marks as bad are zeros.
pub(crate) fn read_inputs(ar: &Ar, inputs: &mut SignalTable) -> InputChange {
    if !ar.is_up() {
        return InputChange::Invalid;
    }
    let mut at = 0;
    let mut is_changed = false;
    for (index, (_, data)) in ar.inputs().enumerate() {
        let Some(TablePart { len, .. }) = inputs.parts().get(index).copied() else { break };
        is_changed |= match data {
            Some(data) if data.len() == len => inputs.copy(at, data),
            _ => inputs.clear(at, len),
        };
        at += len;
    }
    if is_changed { InputChange::Changed } else { InputChange::Same }
}

/// Sets the outputs; before they run none are set, so that their status is bad.
pub(crate) fn write_outputs(ar: &mut Ar, outputs: &SignalTable, is_running: bool) {
    if !is_running {
        return ar.withdraw_outputs();
    }
    let mut rest = outputs.bytes();
    let mut parts = outputs.parts().iter();
    ar.set_outputs_of(|_, _, place| {
        let (own, others) = rest.split_at(place.len().min(rest.len()));
        rest = others;
        let is_safety = parts.next().is_some_and(|part| part.is_safety);
        let is_set = !is_safety && own.len() == place.len();
        if is_set {
            place.copy_from_slice(own);
        }
        is_set
    });
}

/// Returns in what the connected device differs, module by module.
pub(crate) fn differences(ar: &Ar, chosen: &ChosenIoDevice) -> Vec<String> {
    let mut found = Vec::new();
    for module in ar.module_diff() {
        let slot = module.slot;
        let expected = chosen.modules.iter().find(|it| it.slot == slot);
        let (name, ident) = expected.map_or(("no module", 0), |it| (it.name.as_str(), it.ident));
        match module.state {
            ModuleState::NoModule => {
                found.push(format!(
                    "slot {slot}: expected {name} (0x{ident:08X}), found none; plug it or leave it out"
                ));
            }
            ModuleState::WrongModule => found.push(format!(
                "slot {slot}: expected {name} (0x{ident:08X}), found module 0x{:08X}; choose that one",
                module.ident
            )),
            _ => {}
        }
        for submodule in module.submodules.iter().filter(|it| !it.state.is_usable()) {
            let subslot = submodule.subslot;
            let expected = expected.and_then(|it| it.submodules.iter().find(|it| it.subslot == subslot));
            let (name, ident) = expected.map_or(("none", 0), |it| (it.name.as_str(), it.ident));
            let there = match submodule.ident {
                0 => "none".to_owned(),
                ident => format!("submodule 0x{ident:08X}"),
            };
            found.push(format!(
                "subslot {slot}.{subslot}: expected {name} (0x{ident:08X}), found {there}; choose what is there"
            ));
        }
    }
    found
}

/// Returns the next record of the startup that the device refused, in words.
pub(crate) fn refused_record(ar: &mut Ar) -> Option<String> {
    let (record, code) = ar.poll_refused_record()?;
    let Record { slot, subslot, index, data } = record;
    Some(format!(
        "record {index} of subslot {slot}.{subslot}, {} bytes: the device refuses it (status 0x{code:08X}): {}",
        data.len(),
        Status(code).text()
    ))
}

/// Lists the records of the chosen submodules.
fn parameters(chosen: &ChosenIoDevice) -> Vec<DeviceParameter> {
    let mut parameters = Vec::new();
    for (slot, submodule) in submodules(chosen) {
        for record in submodule.records.iter().filter(|record| !record.is_safety) {
            let (subslot, index) = (submodule.subslot, record.index);
            let place = format!("{slot}.{subslot}:{index}");
            let name = if record.name.is_empty() {
                place.clone()
            } else {
                format!("{slot}.{subslot}/{}", record.name)
            };
            parameters.push(DeviceParameter {
                signal: Signal::new(&name, &place, SignalType::Bytes, 0, 8 * record.default.len()),
                is_read_only: false,
                target: ParameterTarget::Record(slot, subslot, index),
                is_big_endian: true,
            });
        }
    }
    parameters
}

/// Returns the record of a place such as `1.1:100` or `0.1:0xAFF0`.
pub(crate) fn by_place(name: &str) -> Option<DeviceParameter> {
    let (place, index) = name.split_once(':')?;
    let (slot, subslot) = place.split_once('.')?;
    let number = crate::ethernet_ip::number;
    let target = ParameterTarget::Record(number(slot)?, number(subslot)?, number(index)?);
    Some(crate::parameter::unnamed(name, target))
}

/// Place of the record that lists the modules of a device: RealIdentificationData of API 0.
pub const MODULES_RECORD: &str = "0.1:0xF000";

/// Place of the record with the diagnosis of the whole device.
pub(crate) const DIAGNOSIS_RECORD: &str = "0.1:0xF80C";

/// Reads the modules of a device from that record; `None` if it is another one.
#[must_use]
pub fn found_modules(record: &[u8]) -> Option<Vec<FoundModule>> {
    let modules = profinet::record::parse_real_identification(record)?;
    let found = modules.into_iter();
    Some(found.map(|it| FoundModule { slot: it.slot, ident: it.ident, submodules: it.submodules }).collect())
}

/// Sends an access to a record.
pub(crate) fn access(ar: &mut Ar, now: Instant, access: &ParameterAccess) -> Result<(), String> {
    let ParameterTarget::Record(slot, subslot, index) = access.parameter.target else {
        return Err("not a record".to_owned());
    };
    match &access.written {
        Some(data) => ar.write_record(now, (slot, subslot), index, data),
        None => ar.read_record(now, (slot, subslot), index),
    }
    .map_err(|error| error.to_string())
}

/// Returns the answer to an access once it is there.
pub(crate) fn answer(ar: &mut Ar) -> Option<Result<Vec<u8>, String>> {
    Some(ar.take_record()?.map_err(|code| match code {
        0 => "the device did not answer; try again".to_owned(),
        code => format!("the device refuses it (status 0x{code:08X}): {}", Status(code).text()),
    }))
}
