//! EtherCAT: from ESIs and the chosen SubDevices to a MainDevice, their signals and their objects.

mod modules;

use device_files::{ChosenPdo, ChosenSubDevice};
use ethercat_maindevice::{
    Config, ExpectedDevice, LONGEST_OBJECT, MAX_PROCESS_DATA, MainDevice, SdoRequest, StartupWrite,
    SubDeviceId,
};
use machine::{Duration, Instant};

use crate::config::{BusConfig, DriveConfig, DriveError};
use crate::file_device::OpenedDevice;
use crate::parameter::{DeviceParameter, Earlier, ParameterAccess, ParameterTarget};
use crate::signal::{Signal, SignalType};
use crate::table::SignalTable;

pub(crate) use self::modules::DETECTED_COUNT;

/// Interval where the user gives none.
const DEFAULT_INTERVAL: Duration = Duration::from_millis(2);

/// Time without a good exchange after which the connection ends: hosts stall for 10 to 20 ms.
const WATCHDOG: Duration = Duration::from_millis(100);

/// First object by which PDOs are assigned: that of sync manager 0 (ETG.1000.6, 5.6.7.4.9).
const ASSIGNMENT: u16 = 0x1C10;

/// Chosen device with its settings, and what the MainDevice expects of it and writes to it.
pub(crate) struct PlacedDevice<'d> {
    pub(crate) chosen: &'d ChosenSubDevice,
    pub(crate) config: &'d DriveConfig,
    pub(crate) expected: ExpectedDevice,
    pub(crate) startup: Vec<StartupWrite>,
}

/// Returns what the MainDevice expects of a device.
pub(crate) fn expected(chosen: &ChosenSubDevice) -> Result<ExpectedDevice, DriveError> {
    let (outputs, inputs) = chosen.lengths();
    let (outputs, inputs) = (outputs as usize, inputs as usize);
    if outputs + inputs > MAX_PROCESS_DATA {
        let fault = format!(
            "{} bytes of process data: at most {MAX_PROCESS_DATA} fit into a frame",
            outputs + inputs
        );
        return Err(DriveError::File(fault));
    }
    Ok(ExpectedDevice {
        vendor: chosen.vendor_id,
        product: chosen.product_code,
        // A newer revision has the same process data by the maker's promise; the sizes are compared.
        revision: None,
        output_bytes: outputs,
        input_bytes: inputs,
    })
}

/// Opens the MainDevice with its devices, each at its position; a single one may be the only one on the cable.
pub(crate) fn open(
    devices: &[PlacedDevice<'_>],
    bus: &BusConfig,
    now: Instant,
) -> Result<MainDevice, DriveError> {
    let refused = |error: &dyn std::fmt::Display| DriveError::Bus(error.to_string());
    let mut intervals = devices.iter().filter_map(|device| device.config.interval);
    let cycle = intervals.next().unwrap_or(DEFAULT_INTERVAL);
    if intervals.any(|other| other != cycle) {
        let fault = "the devices of an EtherCAT cable have one interval; give the same --interval to all";
        return Err(DriveError::Bus(fault.to_owned()));
    }
    let settings = Config {
        mac: bus.mac,
        devices: devices.iter().map(|device| device.expected).collect(),
        cycle,
        watchdog: WATCHDOG.max(4 * cycle),
    };
    let mut machine = match devices {
        [PlacedDevice { config: DriveConfig { position: None, .. }, .. }] => {
            MainDevice::new(settings, now).map_err(|error| refused(&error))?
        }
        _ => {
            let positions: Result<Vec<_>, _> = devices.iter().map(|device| index(device.config)).collect();
            MainDevice::at_positions(&positions?, settings, now).map_err(|error| refused(&error))?
        }
    };
    for (id, device) in machine.ids().zip(devices) {
        machine.set_startup(id, device.startup.clone());
        machine.hold_safe_op(id, !device.config.is_running);
        let mut managers = device.chosen.sync_managers.iter();
        if let Some(mailbox) = managers.find(|it| it.usage == "MBoxIn") {
            machine.set_mailbox(id, mailbox.start_address, mailbox.default_size.unwrap_or(0));
        }
    }
    Ok(machine)
}

/// Returns the position of a device on the cable, from 0.
fn index(config: &DriveConfig) -> Result<u16, DriveError> {
    let fault = match config.position {
        Some(position) if position > 0 => return Ok(position - 1),
        Some(_) => "position 0: positions on the cable count from 1",
        None => "a position of a device is unknown; give each its own, as in --at 3",
    };
    Err(DriveError::Bus(fault.to_owned()))
}

/// Returns the names of what a device exchanges.
pub(crate) fn names(chosen: &ChosenSubDevice) -> OpenedDevice {
    let (outputs, inputs) = chosen.lengths();
    OpenedDevice {
        inputs: table(&chosen.inputs, inputs as usize),
        outputs: table(&chosen.outputs, outputs as usize),
        parameters: parameters(chosen),
    }
}

/// Returns what is written in PRE-OP: the init commands of the ESI, and the assignment of PDOs where it can be written.
///
/// # Errors
///
/// An init command is longer than what can be written.
pub fn startup_writes(chosen: &ChosenSubDevice) -> Result<Vec<StartupWrite>, DriveError> {
    let Some(coe) = chosen.mailbox.as_ref().and_then(|it| it.coe.as_ref()) else { return Ok(Vec::new()) };
    let to_safe_op = |transitions: &[String]| transitions.iter().any(|it| it == "PS");
    let commands = coe.init_commands.iter().filter(|it| to_safe_op(&it.transitions));
    let mut writes: Vec<_> = commands
        .map(|it| StartupWrite {
            index: it.index,
            subindex: it.subindex,
            is_complete: it.is_complete_access,
            data: it.data.clone(),
        })
        .collect();
    writes.extend(modules::list(chosen));
    if coe.has_pdo_assign {
        for pdos in [&chosen.outputs, &chosen.inputs] {
            writes.extend(assignment(pdos));
        }
    }
    match writes.iter().find(|write| write.data.len() > LONGEST_OBJECT) {
        None => Ok(writes),
        Some(StartupWrite { index, subindex, data, .. }) => Err(DriveError::File(format!(
            "init command 0x{index:04X}:{subindex:02X} has {} bytes: at most {LONGEST_OBJECT} can be written; remove it from a copy \
             of the file, and write the object with the maker's tool",
            data.len()
        ))),
    }
}

/// Assigns PDOs to their sync managers: the count is 0 while they are written (ETG.1000.6, 5.6.7.4.9).
fn assignment(pdos: &[ChosenPdo]) -> Vec<StartupWrite> {
    let mut managers: Vec<u8> = pdos.iter().map(|it| it.sync_manager).collect();
    managers.dedup();
    let mut writes = Vec::new();
    for manager in managers {
        let index = ASSIGNMENT + u16::from(manager);
        let write = |subindex: u8, data: Vec<u8>| StartupWrite { index, subindex, is_complete: false, data };
        writes.push(write(0, vec![0]));
        let own = pdos.iter().filter(|it| it.sync_manager == manager);
        let mut count = 0;
        for pdo in own.take(255) {
            count += 1;
            writes.push(write(count, pdo.pdo.index.to_le_bytes().to_vec()));
        }
        writes.push(write(0, vec![count]));
    }
    writes
}

fn table(pdos: &[ChosenPdo], len: usize) -> SignalTable {
    let mut signals = Vec::new();
    let mut bit: usize = 0;
    let mut manager = None;
    for ChosenPdo { pdo, sync_manager } in pdos {
        // The data of each sync manager are whole bytes.
        if manager.replace(*sync_manager).is_some_and(|before| before != *sync_manager) {
            bit = bit.next_multiple_of(8);
        }
        for entry in &pdo.entries {
            let bits = usize::from(entry.bits);
            if entry.index != 0 {
                let place = format!("0x{:04X}:{:02X}", entry.index, entry.subindex);
                let name = if entry.name.is_empty() { &place } else { &entry.name };
                let name = if pdo.name.is_empty() { name.clone() } else { format!("{}/{name}", pdo.name) };
                let mut signal = Signal::new(&name, &place, kind(&entry.data_type), bit, bits);
                // The objects of FSoE, and the frame of a safety PDU.
                signal.is_safety = entry.data_type.starts_with("FSOE") || pdo.name.contains("FSoE");
                signals.push(signal);
            }
            bit += bits;
        }
    }
    SignalTable::new(signals, len, false)
}

/// Returns the type of a name in ETG.2000.
fn kind(name: &str) -> SignalType {
    match name {
        "BOOL" | "BIT" => SignalType::Bool,
        "SINT" | "INT" | "DINT" | "LINT" => SignalType::Signed,
        "REAL" | "LREAL" => SignalType::Real,
        name if name.starts_with("STRING") || name.starts_with("ARRAY") || name.starts_with("OCTET") => {
            SignalType::Bytes
        }
        _ => SignalType::Unsigned,
    }
}

/// Lists the objects of the dictionary.
fn parameters(chosen: &ChosenSubDevice) -> Vec<DeviceParameter> {
    let mut parameters = Vec::new();
    let mut add = |name: String, index: u16, subindex: u8, data_type: &str, bits: u32, access: &str| {
        let place = format!("0x{index:04X}:{subindex:02X}");
        parameters.push(DeviceParameter {
            signal: Signal::new(&name, &place, kind(data_type), 0, bits as usize),
            is_read_only: access == "ro",
            target: ParameterTarget::Object(index, subindex),
            is_big_endian: false,
        });
    };
    for object in chosen.dictionary.iter().flat_map(|it| &it.objects) {
        if object.entries.is_empty() {
            add(object.name.clone(), object.index, 0, &object.data_type, object.bits, &object.access);
        }
        for entry in &object.entries {
            let access = if entry.access.is_empty() { &object.access } else { &entry.access };
            let name = format!("{}/{}", object.name, entry.name);
            add(name, object.index, entry.subindex, &entry.data_type, entry.bits, access);
        }
    }
    parameters
}

/// Returns the object of a place such as `0x1018:01`, of four bytes, `0x6000:01:2` of two, or `0x1018:all`: all its entries by
/// complete access, as bytes, whose first is the number of entries, in 16 bits.
pub(crate) fn by_place(name: &str) -> Option<DeviceParameter> {
    let parts: Vec<_> = name.split(':').collect();
    let (index, subindex, len) = match parts.as_slice() {
        [index, "all"] => {
            let target = ParameterTarget::WholeObject(index_of(index)?);
            return Some(crate::parameter::unnamed(name, target));
        }
        [index, subindex] => (index, subindex, 4),
        [index, subindex, len] => {
            (index, subindex, len.parse().ok().filter(|len| [1, 2, 4, 8].contains(len))?)
        }
        _ => return None,
    };
    let index = index_of(index)?;
    let subindex = u8::from_str_radix(subindex, 16).ok()?;
    let mut parameter = crate::parameter::unnamed(name, ParameterTarget::Object(index, subindex));
    parameter.signal = Signal::new(name, name, SignalType::Unsigned, 0, 8 * len);
    Some(parameter)
}

fn index_of(text: &str) -> Option<u16> {
    u16::from_str_radix(text.strip_prefix("0x")?, 16).ok()
}

/// Places of the number of errors that a device has stored, and of the subindex of the newest message of its diagnosis history
/// (CiA 301, object 1003; ETG.1020, object 10F3).
pub(crate) const ERROR_COUNT: &str = "0x1003:00:1";
pub(crate) const NEWEST_MESSAGE: &str = "0x10F3:02:1";
const ERRORS: u16 = 0x1003;
const HISTORY: u16 = 0x10F3;

/// First and last subindex of a message of the diagnosis history (ETG.1020, 13.3).
const MESSAGES: std::ops::RangeInclusive<u8> = 6..=255;

/// Errors of the list that are said.
const MOST_EARLIER: u8 = 8;

/// Says what an object of diagnosis has, and which ones are to be read after it.
pub(crate) fn earlier(chosen: &ChosenSubDevice, index: u16, subindex: u8, bytes: &[u8]) -> Earlier {
    let read = |index: u16, subindex: u8| {
        let place = format!("0x{index:04X}:{subindex:02X}");
        by_place(&place).map(ParameterAccess::of_diagnosis)
    };
    let number = bytes.first().copied().unwrap_or(0);
    match (index, subindex) {
        (ERRORS, 0) => {
            let reads = (1..=number.min(MOST_EARLIER)).filter_map(|entry| read(ERRORS, entry)).collect();
            Earlier { reads, ..Earlier::default() }
        }
        (ERRORS, _) => match bytes.first_chunk::<4>() {
            // The code is in the lower half; the upper one is the maker's.
            Some([low, high, ..]) if (*low, *high) != (0, 0) => {
                let code = u16::from_le_bytes([*low, *high]);
                vec![format!("stored error 0x{code:04X}: {}", class(code))].into()
            }
            _ => Earlier::default(),
        },
        (HISTORY, 2) if MESSAGES.contains(&number) => {
            Earlier { reads: read(HISTORY, number).into_iter().collect(), ..Earlier::default() }
        }
        (HISTORY, entry) if MESSAGES.contains(&entry) => {
            message(bytes).into_iter().collect::<Vec<_>>().into()
        }
        (modules::DETECTED, slot) => modules::detected(chosen, slot, bytes),
        _ => Earlier::default(),
    }
}

/// Says a message of the diagnosis history: code, flags, number of its text, time stamp (ETG.1020, 13.3).
fn message(bytes: &[u8]) -> Option<String> {
    let (code, rest) = bytes.split_first_chunk::<4>()?;
    let (flags, rest) = rest.split_first_chunk::<2>()?;
    let text = u16::from_le_bytes(*rest.first_chunk()?);
    let kind = match u16::from_le_bytes(*flags) & 0xF {
        0 => "information",
        1 => "warning",
        2 => "error",
        _ => "of the maker",
    };
    let code = u32::from_le_bytes(*code);
    // The upper half of a code of CiA 301 is its error code.
    let class =
        if code & 0xFFFF == 0xE800 { format!(", {}", class((code >> 16) as u16)) } else { String::new() };
    Some(format!("diagnosis message 0x{code:08X}: {kind}{class}; text 0x{text:04X} of its ESI"))
}

/// Sends an access to an object.
pub(crate) fn access(
    machine: &mut MainDevice,
    id: SubDeviceId,
    access: &ParameterAccess,
) -> Result<(), String> {
    let (index, subindex, is_complete) = match access.parameter.target {
        ParameterTarget::Object(index, subindex) => (index, subindex, false),
        ParameterTarget::WholeObject(index) => (index, 0, true),
        _ => return Err("not an object".to_owned()),
    };
    let request = SdoRequest { index, subindex, is_complete, data: access.written.clone() };
    machine.request_sdo(id, request).map_err(|refusal| refusal.to_string())
}

/// Returns the answer to an access once it is there.
pub(crate) fn answer(machine: &mut MainDevice, id: SubDeviceId) -> Option<Result<Vec<u8>, String>> {
    machine.take_sdo(id)
}

/// Returns the next emergency in words (ETG.1000.6, 5.6.4.2; CiA 301, error codes).
pub(crate) fn emergency(machine: &mut MainDevice, id: SubDeviceId) -> Option<String> {
    let [low, high, register, data @ ..] = machine.poll_emergency(id)?;
    let code = u16::from_le_bytes([low, high]);
    let digits: String = data.iter().map(|byte| format!("{byte:02x}")).collect();
    Some(format!("emergency 0x{code:04X}: {}; error register 0x{register:02X}, data {digits}", class(code)))
}

/// Returns the class of an error code.
const fn class(code: u16) -> &'static str {
    match code >> 8 {
        0x00 => "no error any more",
        0x10 => "generic error",
        0x20..=0x23 => "current",
        0x30..=0x33 => "voltage",
        0x40..=0x42 => "temperature",
        0x50 => "hardware",
        0x60..=0x63 => "software",
        0x70 => "additional modules",
        0x80..=0x82 => "monitoring",
        0x90 => "external error",
        0xA0 => "state machine of the device",
        0xF0 => "additional functions",
        _ => "of the maker",
    }
}
