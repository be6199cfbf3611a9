//! EtherNet/IP: from an EDS and the chosen connection to a scanner's connection, its signals and its parameters.

mod members;

use device_files::{
    ChosenAdapter, ChosenAssembly, ConnectionEnd, Eds, EdsConnection, EdsParameter, EdsReference,
};
use ethernet_ip::cip::{ElectronicKey, Path, Revision, service};
use ethernet_ip::connection::{RealTimeFormat, TimeoutMultiplier};
use ethernet_ip::scanner::ExplicitAnswer;
use ethernet_ip::{Connection, ConnectionConfig, ConnectionId, Scanner, ScannerConfig};
use machine::{Duration, Instant};

use self::members::{PlacedMember, members};
use crate::config::{BusConfig, DriveConfig, DriveError};
use crate::file_device::OpenedDevice;
use crate::parameter::{DeviceParameter, ParameterAccess, ParameterTarget};
use crate::signal::{Signal, SignalType};
use crate::table::SignalTable;
use crate::value::SignalValue;

/// Interval where neither the user nor the file gives one, in µs.
const DEFAULT_RPI_US: u32 = 10_000;

/// ODVA vendor number of tools without one of their own, as our PLC has it.
const VENDOR: u16 = 0xFFFF;

/// Bit of a parameter's descriptor: it can only be read (volume 1, table 7-3.14).
const READ_ONLY: u32 = 0x10;

/// Longest configuration data in bytes, so that the Forward_Open fits into an unconnected message.
const MOST_CONFIGURATION: u16 = 400;

/// Opens the scanner without a connection.
pub(crate) fn open(bus: &BusConfig, now: Instant) -> Result<Scanner, DriveError> {
    let own = bus.address.ok_or(DriveError::NoAddress)?;
    let scanner = Scanner::new(ScannerConfig {
        vendor: VENDOR,
        serial_number: bus.seed as u32 ^ serial_number(bus),
        first_id: (bus.seed >> 16) as u32,
    });
    Ok(scanner.with_conflict_detection(bus.mac, own, bus.mask, now))
}

/// Adds the connection of a device.
pub(crate) fn connect(
    scanner: &mut Scanner,
    eds: &Eds,
    chosen: &ChosenAdapter,
    config: &DriveConfig,
    now: Instant,
) -> Result<(ConnectionId, OpenedDevice), DriveError> {
    let target = config.device_address.ok_or(DriveError::NoDeviceAddress)?;
    let connection = eds.connections.iter().find(|it| it.number == chosen.connection);
    let connection =
        connection.ok_or_else(|| DriveError::File("the chosen connection is not in the file".to_owned()))?;
    let is_null_each = (is_null(&connection.o_to_t), is_null(&connection.t_to_o));
    let is_null = is_null_each == (true, true);
    if !is_null && (is_null_each.1 || chosen.consumed.is_some() && is_null_each.0) {
        let fault = format!(
            "connection `{}`: the file allows null in one direction only, which no connection has; choose another one with \
             --connection",
            device_files::excerpt(&connection.name)
        );
        return Err(DriveError::File(fault));
    }
    let (consumed_format, o_t_size) = match &chosen.consumed {
        Some(consumed) => (format(&connection.o_to_t), consumed.size),
        None => (RealTimeFormat::Heartbeat, 0),
    };
    let (o_t_rpi_us, t_o_rpi_us) = intervals(connection, chosen, config)?;
    let types = &connection.t_to_o.types;
    let settings = ConnectionConfig {
        target,
        route: Vec::new(),
        key: Some(key(chosen)),
        serial_number: None,
        described: None,
        configuration: chosen.configuration.as_ref().map(|it| it.instance),
        configuration_data: configuration_data(eds, chosen)?,
        consumed: chosen.consumed_point,
        produced: chosen.produced.instance,
        multicast: !types.is_empty() && !types.contains(&"point to point"),
        o_t_size,
        t_o_size: chosen.produced.size,
        consumed_format,
        produced_format: format(&connection.t_to_o),
        o_t_rpi_us,
        t_o_rpi_us,
        // At least 100 ms without a frame: hosts stall for 10 to 20 ms.
        multiplier: TimeoutMultiplier::at_least(100_000_u32.div_ceil(o_t_rpi_us.min(t_o_rpi_us).max(1)))
            .unwrap_or(TimeoutMultiplier::TIMES_128),
        request_timeout: Duration::from_secs(1),
        open_timeout: Duration::from_secs(5),
        retry_after: Duration::from_secs(1),
    };
    let id = scanner.connect(settings, now).map_err(|error| DriveError::Bus(error.to_string()))?;
    let produced = Some(&chosen.produced).filter(|_| !is_null);
    let consumed = chosen.consumed.as_ref().filter(|_| !is_null);
    let inputs = table(eds, &connection.t_to_o, produced)?;
    let outputs = table(eds, &connection.o_to_t, consumed)?;
    if let Some(connection) = scanner.connection_mut(id) {
        connection.set_run(config.is_running);
        if is_null {
            connection.make_null();
        }
    }
    Ok((id, OpenedDevice { inputs, outputs, parameters: parameters(eds) }))
}

/// Returns whether a direction has no other connection type than null.
fn is_null(end: &ConnectionEnd) -> bool {
    !end.types.is_empty() && end.types.iter().all(|kind| *kind == "null")
}

/// Returns a number that no other scanner of the network has: it is made of the MAC address.
fn serial_number(bus: &BusConfig) -> u32 {
    let [.., a, b, c] = bus.mac.0;
    u32::from_be_bytes([2, a, b, c])
}

fn key(chosen: &ChosenAdapter) -> ElectronicKey {
    ElectronicKey {
        vendor: chosen.vendor_id,
        device_type: chosen.device_type,
        product_code: chosen.product_code,
        revision: Revision { major: chosen.revision.0, minor: chosen.revision.1 },
        compatible: true,
    }
}

/// Returns in what the connected device differs from the file without being refused.
pub(crate) fn differences(connection: &Connection, chosen: &ChosenAdapter) -> Vec<String> {
    let Some(found) = connection.identity() else { return Vec::new() };
    let (major, minor) = chosen.revision;
    let Revision { major: found_major, minor: found_minor } = found.key.revision;
    if (found_major, found_minor) == (major, minor) {
        return Vec::new();
    }
    vec![format!(
        "revision: the file is for {major}.{minor}, the device has {found_major}.{found_minor}; use its own file if data differ"
    )]
}

/// Returns the packet intervals O→T and T→O in µs: those that the user gives for each direction, or one for both.
fn intervals(
    connection: &EdsConnection,
    chosen: &ChosenAdapter,
    config: &DriveConfig,
) -> Result<(u32, u32), DriveError> {
    let (least, most) = (chosen.min_rpi_us.unwrap_or(1), chosen.max_rpi_us.unwrap_or(u32::MAX));
    let (o_to_t, t_to_o) = (&connection.o_to_t, &connection.t_to_o);
    let both = match config.interval {
        Some(interval) => allowed(interval, "both directions", (least, most))?,
        None => {
            let proposed = o_to_t.rpi_us.max(t_to_o.rpi_us).filter(|micros| *micros > 0);
            proposed.unwrap_or(DEFAULT_RPI_US).clamp(least, most)
        }
    };
    let of = |interval: Option<Duration>, direction, end: &ConnectionEnd| match interval {
        Some(interval) => {
            let limits = end.rpi_limits_us.filter(|(least, most)| 0 < *least && least <= most);
            allowed(interval, direction, limits.unwrap_or((1, u32::MAX)))
        }
        None => Ok(both),
    };
    Ok((of(config.output_interval, "the outputs", o_to_t)?, of(config.input_interval, "the inputs", t_to_o)?))
}

/// Returns an interval in µs if the file allows it.
fn allowed(interval: Duration, direction: &str, (least, most): (u32, u32)) -> Result<u32, DriveError> {
    let micros = u32::try_from(interval.as_micros()).unwrap_or(u32::MAX);
    if (least..=most).contains(&micros) {
        return Ok(micros);
    }
    Err(DriveError::Bus(format!(
        "interval {micros} us of {direction}: the file allows {least} to {most} us; give one of these"
    )))
}

const fn format(end: &ConnectionEnd) -> RealTimeFormat {
    match end.real_time_format {
        device_files::RealTimeFormat::Header32Bit => RealTimeFormat::RunIdleHeader,
        device_files::RealTimeFormat::ZeroLength => RealTimeFormat::ZeroLength,
        device_files::RealTimeFormat::Heartbeat => RealTimeFormat::Heartbeat,
        _ => RealTimeFormat::Modeless,
    }
}

/// Makes the configuration data of the parameters' defaults; none if the file has none.
///
/// # Errors
///
/// They are too long for a request, or their assembly is deeper than one of an adapter.
pub fn configuration_data(eds: &Eds, chosen: &ChosenAdapter) -> Result<Vec<u8>, DriveError> {
    let Some(assembly) = chosen.configuration.as_ref().filter(|it| it.size > 0) else {
        return Ok(Vec::new());
    };
    if assembly.size > MOST_CONFIGURATION {
        let fault = format!(
            "{} bytes of configuration: at most {MOST_CONFIGURATION} fit into one request",
            assembly.size
        );
        return Err(DriveError::File(fault));
    }
    let len = usize::from(assembly.size);
    let mut table = SignalTable::new(Vec::new(), len, false);
    let connection = eds.connections.iter().find(|it| it.number == chosen.connection);
    let format = connection.and_then(|it| EdsReference::parse(&it.configuration_format));
    let members = match format {
        Some(reference) => members(eds, reference, "")?,
        None => Vec::new(),
    };
    // A member without a default, or with one that its type does not take, keeps its place as zeros.
    for PlacedMember { parameter, signal } in members.iter().filter(|member| member.signal.fits(len)) {
        if let Ok(value) = SignalValue::parse(signal, &parameter.default) {
            table.set(signal, &value)?;
        }
    }
    Ok(table.bytes().to_vec())
}

/// Makes the signals of an assembly: the whole of it by its name, and its members.
fn table(eds: &Eds, end: &ConnectionEnd, chosen: Option<&ChosenAssembly>) -> Result<SignalTable, DriveError> {
    let Some(chosen) = chosen else { return Ok(SignalTable::default()) };
    let place = chosen.instance.to_string();
    let reference = EdsReference::parse(&end.format);
    let assembly = match reference {
        Some(EdsReference::Assembly(number)) => eds.assembly(number),
        _ => None,
    };
    let name = assembly.map(|assembly| assembly.name.as_str()).filter(|name| !name.is_empty());
    let bits = 8 * usize::from(chosen.size);
    let mut signals = vec![Signal::new(name.unwrap_or(&chosen.name), &place, SignalType::Bytes, 0, bits)];
    let is_parameter = matches!(reference, Some(EdsReference::Parameter(_)));
    let by_format = reference.filter(|_| assembly.is_some() || is_parameter);
    let members = members(eds, by_format.unwrap_or(EdsReference::Assembly(chosen.instance)), &place)?;
    signals.extend(members.into_iter().map(|PlacedMember { parameter, signal }| scaled(signal, parameter)));
    Ok(SignalTable::new(signals, chosen.size.into(), false))
}

/// Makes the signal of a parameter at a place.
fn signal(parameter: &EdsParameter, place: &str, bit: usize, bits: usize) -> Signal {
    let mut signal = Signal::new(&parameter.name, place, kind(parameter.data_type), bit, bits);
    if signal.kind == SignalType::Bytes && !(bit.is_multiple_of(8) && bits.is_multiple_of(8)) {
        signal = Signal::new(&parameter.name, place, SignalType::Unsigned, bit, bits);
    }
    signal.unit.clone_from(&parameter.unit);
    signal.texts = parameter.texts.iter().map(|text| (text.value, text.text.clone())).collect();
    signal
}

/// Adds the scale of its parameter to a signal. Defaults of the file are raw values, so theirs have none.
fn scaled(signal: Signal, parameter: &EdsParameter) -> Signal {
    let is_number = matches!(signal.kind, SignalType::Unsigned | SignalType::Signed | SignalType::Real);
    Signal { scale: parameter.scale().filter(|_| is_number), ..signal }
}

/// Returns the type of a CIP data type (volume 1, table C-6.1).
const fn kind(data_type: u16) -> SignalType {
    match data_type {
        0xC1 => SignalType::Bool,
        0xC2..=0xC5 => SignalType::Signed,
        0xC6..=0xC9 | 0xD1..=0xD4 => SignalType::Unsigned,
        0xCA | 0xCB => SignalType::Real,
        _ => SignalType::Bytes,
    }
}

/// Lists the parameters that have a path.
fn parameters(eds: &Eds) -> Vec<DeviceParameter> {
    let with_path = eds.parameters.iter().filter_map(|parameter| Some((parameter, path(&parameter.path)?)));
    with_path
        .map(|(parameter, path)| DeviceParameter {
            signal: scaled(
                signal(
                    parameter,
                    &format!("Param{}", parameter.number),
                    0,
                    8 * parameter.size.unwrap_or(0) as usize,
                ),
                parameter,
            ),
            is_read_only: parameter.descriptor & READ_ONLY != 0,
            target: ParameterTarget::Attribute(path),
            is_big_endian: false,
        })
        .collect()
}

fn path(text: &str) -> Option<Vec<u8>> {
    let bytes: Option<Vec<u8>> = text
        .split_whitespace()
        .map(|word| u8::from_str_radix(word.trim_matches(['[', ']']), 16).ok())
        .collect();
    bytes.filter(|bytes| !bytes.is_empty() && bytes.len().is_multiple_of(2))
}

/// Returns the attribute of a name such as `1/1/7`: class, instance and attribute.
pub(crate) fn by_place(name: &str) -> Option<DeviceParameter> {
    let numbers: Option<Vec<u16>> = name.split('/').map(number).collect();
    let [class, instance, attribute] = numbers?.try_into().ok()?;
    let mut path = Vec::new();
    for (segment, number) in [(0x20, class), (0x24, instance), (0x30, attribute)] {
        match u8::try_from(number) {
            Ok(number) => path.extend([segment, number]),
            Err(_) => path.extend([segment | 1, 0, number.to_le_bytes()[0], number.to_le_bytes()[1]]),
        }
    }
    Some(crate::parameter::unnamed(name, ParameterTarget::Attribute(path)))
}

/// Place of the status of the Identity object.
pub(crate) const STATUS: &str = "1/1/5";

/// Says what the status of the Identity object reports (volume 1, table 5-2.4): faults in bits 8 to 11, and states in bits 4 to 7
/// that are faults.
#[must_use]
pub fn identity_status(status: u16) -> Option<String> {
    let faults = [
        (1 << 8, "minor recoverable fault"),
        (1 << 9, "minor unrecoverable fault"),
        (1 << 10, "major recoverable fault"),
        (1 << 11, "major unrecoverable fault"),
    ];
    let mut found: Vec<&str> =
        faults.iter().filter(|(bit, _)| status & bit != 0).map(|(_, name)| *name).collect();
    match status >> 4 & 0xF {
        2 => found.push("an I/O connection has failed"),
        4 => found.push("its stored configuration is bad"),
        5 => found.push("its state is major fault"),
        _ => {}
    }
    (!found.is_empty()).then(|| format!("identity status 0x{status:04X}: {}", found.join(", ")))
}

/// Says what the answer to a read of that status reports.
pub(crate) fn earlier(bytes: &[u8]) -> Vec<String> {
    let status = bytes.first_chunk().copied().map(u16::from_le_bytes);
    status.and_then(identity_status).into_iter().collect()
}

pub(crate) fn number(text: &str) -> Option<u16> {
    match text.strip_prefix("0x") {
        Some(digits) => u16::from_str_radix(digits, 16).ok(),
        None => text.parse().ok(),
    }
}

/// Sends an access to a parameter.
pub(crate) fn access(
    connection: &mut Connection,
    now: Instant,
    access: &ParameterAccess,
) -> Result<(), String> {
    let ParameterTarget::Attribute(path) = &access.parameter.target else {
        return Err("not an attribute".to_owned());
    };
    let (service, data) = match &access.written {
        Some(data) => (service::SET_ATTRIBUTE_SINGLE, data.as_slice()),
        None => (service::GET_ATTRIBUTE_SINGLE, &[][..]),
    };
    connection.request(now, service, Path(path), data).map_err(|error| error.to_string())
}

/// Returns the answer to an access once it is there.
pub(crate) fn answer(connection: &mut Connection) -> Option<Result<Vec<u8>, String>> {
    Some(match connection.take_answer()? {
        (ExplicitAnswer::Status(general), data) if u8::from(general) == 0 => Ok(data),
        (ExplicitAnswer::Status(general), _) => {
            Err(format!("the device refuses it (status 0x{:02X}): {}", u8::from(general), general.text()))
        }
        (ExplicitAnswer::NoAnswer, _) => Err("the device did not answer; try again".to_owned()),
    })
}
