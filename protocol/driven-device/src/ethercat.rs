//! EtherCAT: from an ESI and the chosen SubDevice to a MainDevice with one device, its signals and its objects.

use device_files::{ChosenPdo, ChosenSubDevice};
use ethercat_maindevice::{
    Config, ExpectedDevice, LONGEST_WRITE, MAX_PROCESS_DATA, MainDevice, SdoRequest, StartupWrite,
    SubDeviceId,
};
use machine::{Duration, Instant};

use crate::config::{DriveConfig, DriveError};
use crate::parameter::{DeviceParameter, ParameterAccess, ParameterTarget};
use crate::signal::{Signal, SignalType};
use crate::table::SignalTable;

/// Interval where the user gives none.
const DEFAULT_INTERVAL: Duration = Duration::from_millis(2);

/// Time without a good exchange after which the connection ends: hosts stall for 10 to 20 ms.
const WATCHDOG: Duration = Duration::from_millis(100);

/// First object by which PDOs are assigned: that of sync manager 0 (ETG.1000.6, 5.6.7.4.9).
const ASSIGNMENT: u16 = 0x1C10;

/// Opens the MainDevice with one device: the one at its position, or the only one on the cable.
pub(crate) fn open(
    chosen: &ChosenSubDevice,
    config: &DriveConfig,
    now: Instant,
) -> Result<(MainDevice, SubDeviceId, SignalTable, SignalTable), DriveError> {
    let (outputs, inputs) = chosen.lengths();
    let (outputs, inputs) = (outputs as usize, inputs as usize);
    if outputs + inputs > MAX_PROCESS_DATA {
        let fault = format!(
            "{} bytes of process data: at most {MAX_PROCESS_DATA} fit into a frame",
            outputs + inputs
        );
        return Err(DriveError::File(fault));
    }
    let cycle = config.interval.unwrap_or(DEFAULT_INTERVAL);
    let expected = ExpectedDevice {
        vendor: chosen.vendor_id,
        product: chosen.product_code,
        // A newer revision has the same process data by the maker's promise; the sizes are compared.
        revision: None,
        output_bytes: outputs,
        input_bytes: inputs,
    };
    let settings =
        Config { mac: config.mac, devices: vec![expected], cycle, watchdog: WATCHDOG.max(4 * cycle) };
    let machine = match config.position.map(|position| position.checked_sub(1)) {
        None => MainDevice::new(settings, now),
        Some(Some(index)) => MainDevice::from_position(index, settings, now),
        Some(None) => {
            return Err(DriveError::Bus("position 0: positions on the cable count from 1".to_owned()));
        }
    };
    let mut machine = machine.map_err(|error| DriveError::Bus(error.to_string()))?;
    let id = SubDeviceId(0);
    machine.set_startup(id, startup(chosen)?);
    machine.hold_safe_op(id, !config.is_running);
    if let Some(mailbox) = chosen.sync_managers.iter().find(|it| it.usage == "MBoxIn") {
        machine.set_mailbox(id, mailbox.start_address, mailbox.default_size.unwrap_or(0));
    }
    Ok((machine, id, table(&chosen.inputs, inputs), table(&chosen.outputs, outputs)))
}

/// Returns what is written in PRE-OP: the init commands of the ESI, and the assignment of PDOs where it can be written.
fn startup(chosen: &ChosenSubDevice) -> Result<Vec<StartupWrite>, DriveError> {
    let Some(coe) = chosen.mailbox.as_ref().and_then(|it| it.coe.as_ref()) else { return Ok(Vec::new()) };
    let to_safe_op = |transitions: &[String]| transitions.iter().any(|it| it == "PS");
    let commands =
        coe.init_commands.iter().filter(|it| to_safe_op(&it.transitions) && !it.is_complete_access);
    let mut writes: Vec<_> = commands
        .map(|it| StartupWrite { index: it.index, subindex: it.subindex, data: it.data.clone() })
        .collect();
    if coe.has_pdo_assign {
        for pdos in [&chosen.outputs, &chosen.inputs] {
            writes.extend(assignment(pdos));
        }
    }
    match writes.iter().find(|write| write.data.len() > LONGEST_WRITE) {
        None => Ok(writes),
        Some(StartupWrite { index, subindex, data }) => Err(DriveError::File(format!(
            "init command 0x{index:04X}:{subindex:02X} has {} bytes: at most {LONGEST_WRITE} can be written; remove it from a copy \
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
        let write = |subindex: u8, data: Vec<u8>| StartupWrite { index, subindex, data };
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
    let mut bit = 0;
    for ChosenPdo { pdo, .. } in pdos {
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
pub(crate) fn parameters(chosen: &ChosenSubDevice) -> Vec<DeviceParameter> {
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

/// Returns the object of a place such as `0x1018:01`, of four bytes, or `0x6000:01:2` of two.
pub(crate) fn by_place(name: &str) -> Option<DeviceParameter> {
    let parts: Vec<_> = name.split(':').collect();
    let (index, subindex, len) = match parts.as_slice() {
        [index, subindex] => (index, subindex, 4),
        [index, subindex, len] => {
            (index, subindex, len.parse().ok().filter(|len| [1, 2, 4, 8].contains(len))?)
        }
        _ => return None,
    };
    let index = u16::from_str_radix(index.strip_prefix("0x")?, 16).ok()?;
    let subindex = u8::from_str_radix(subindex, 16).ok()?;
    let mut parameter = crate::parameter::unnamed(name, ParameterTarget::Object(index, subindex));
    parameter.signal = Signal::new(name, name, SignalType::Unsigned, 0, 8 * len);
    Some(parameter)
}

/// Sends an access to an object.
pub(crate) fn access(
    machine: &mut MainDevice,
    id: SubDeviceId,
    access: &ParameterAccess,
) -> Result<(), String> {
    let ParameterTarget::Object(index, subindex) = access.parameter.target else {
        return Err("not an object".to_owned());
    };
    let len = access.parameter.signal.bits.div_ceil(8);
    let request = SdoRequest { index, subindex, len, data: access.written.clone() };
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
