//! Writes an EDS file from the description of an adapter (volume 1, chapter 7; volume 2, chapter 7).
//!
//! A section is a name in brackets; an entry is a keyword, `=`, fields separated by commas, and `;`. A field may be
//! empty. `$` begins a comment.

use std::fmt::{self, Write};

use ethernet_ip::PORT_NUMBER;
use ethernet_ip::cip::ObjectClass;
use ethernet_ip::description::{Assembly, Description, Role};

use crate::Date;
use crate::members::{self, ImageMember, MemberType};

/// Packet interval that an engineering system proposes, in µs.
const PROPOSED_RPI_US: u32 = 1_000;

/// Trigger and transport: class 1; cyclic, change of state, application.
const CLASS_1_ANY_TRIGGER: u32 = 1 << 1 | 0b111 << 16;

/// Trigger and transport: what the originator may do with the outputs.
const LISTEN_ONLY: u32 = 1 << 24;
const INPUT_ONLY: u32 = 1 << 25;
const EXCLUSIVE_OWNER: u32 = 1 << 26;

/// Connection parameters: fixed size in both directions; O→T point to point; T→O multicast or point to point;
/// priorities low, high and scheduled in both directions.
const FIXED_AND_SHARED: u32 = 1 | 1 << 2 | 1 << 18 | 0b11 << 21 | 0b111 << 24 | 0b111 << 28;

/// Connection parameters: a run/idle header of 32 bits precedes the O→T data.
const O_T_RUN_IDLE: u32 = 4 << 8;

/// Connection parameters: O→T is a heartbeat.
const O_T_HEARTBEAT: u32 = 3 << 8;

/// Writes the file.
#[must_use]
pub fn write(device: &Description, changed: Date) -> String {
    let mut text = String::new();
    // Writing to a String cannot fail.
    let _ = write_all(&mut text, device, changed);
    text
}

fn write_all(text: &mut String, device: &Description, changed: Date) -> fmt::Result {
    writeln!(
        text,
        "$ {}: Electronic Data Sheet. Made from the adapter's own description.",
        device.product_name
    )?;
    write_file(text, device, changed)?;
    write_device(text, device)?;
    section(text, "Device Classification")?;
    entry(text, "Class1", "EtherNetIP")?;
    write_params(text, device)?;
    write_assemblies(text, device)?;
    write_connections(text, device)?;
    write_capacity(text, device)?;
    section(text, "Port")?;
    write_class(text, device, ObjectClass::Port)?;
    entry(text, "Port1", format_args!("TCP, \"EtherNet/IP\", \"20 F5 24 01\", {PORT_NUMBER}"))?;
    let mut plain: Vec<_> =
        ObjectClass::ALL.iter().filter_map(|class| Some((plain_section(*class)?, *class))).collect();
    plain.sort_by_key(|(position, _)| *position);
    for (_, class) in plain {
        section(text, &format!("{} Class", class.name()))?;
        write_class(text, device, class)?;
    }
    Ok(())
}

/// Returns the position of a class among the sections that only describe a class; none for a class whose section has
/// entries of its own, which another function writes.
const fn plain_section(class: ObjectClass) -> Option<u8> {
    match class {
        ObjectClass::Identity => Some(0),
        ObjectClass::MessageRouter => Some(1),
        ObjectClass::TcpIpInterface => Some(2),
        ObjectClass::EthernetLink => Some(3),
        ObjectClass::Qos => Some(4),
        ObjectClass::Assembly | ObjectClass::ConnectionManager | ObjectClass::Port => None,
    }
}

/// Writes the entries that describe a class of objects.
fn write_class(text: &mut String, device: &Description, class: ObjectClass) -> fmt::Result {
    let (instances, highest) = match class {
        ObjectClass::Assembly => {
            let instances = device.assemblies.iter().map(|assembly| assembly.instance);
            (instances.len(), instances.max().unwrap_or(0))
        }
        ObjectClass::Identity | ObjectClass::MessageRouter | ObjectClass::ConnectionManager => (1, 1),
        ObjectClass::Qos | ObjectClass::Port => (1, 1),
        ObjectClass::TcpIpInterface | ObjectClass::EthernetLink => (1, 1),
    };
    entry(text, "Revision", class.revision())?;
    entry(text, "Object_Name", format_args!("\"{} Object\"", class.name()))?;
    entry(text, "Object_Class_Code", format_args!("0x{:02X}", class.code()))?;
    entry(text, "MaxInst", highest)?;
    entry(text, "Number_Of_Static_Instances", instances)?;
    entry(text, "Max_Number_Of_Dynamic_Instances", 0)
}

fn section(text: &mut String, name: &str) -> fmt::Result {
    writeln!(text, "\n[{name}]")
}

fn entry(text: &mut String, keyword: &str, value: impl fmt::Display) -> fmt::Result {
    writeln!(text, "    {keyword} = {value};")
}

/// Writes an entry, with a field and its meaning on each line.
fn table(text: &mut String, keyword: &str, fields: &[(String, &str)]) -> fmt::Result {
    writeln!(text, "    {keyword} =")?;
    for (index, (field, meaning)) in fields.iter().enumerate() {
        let end = if index + 1 == fields.len() { ';' } else { ',' };
        let field = format!("{field}{end}");
        writeln!(text, "        {field:<28} $ {meaning}")?;
    }
    Ok(())
}

fn quoted(text: &str) -> String {
    format!("\"{text}\"")
}

fn write_file(text: &mut String, device: &Description, Date { year, month, day }: Date) -> fmt::Result {
    section(text, "File")?;
    entry(text, "DescText", format_args!("\"{} as EtherNet/IP adapter\"", device.product_name))?;
    for (date, time) in [("CreateDate", "CreateTime"), ("ModDate", "ModTime")] {
        entry(text, date, format_args!("{month:02}-{day:02}-{year:04}"))?;
        entry(text, time, "00:00:00")?;
    }
    entry(text, "Revision", "1.0")
}

fn write_device(text: &mut String, device: &Description) -> fmt::Result {
    section(text, "Device")?;
    entry(text, "VendCode", device.vendor)?;
    entry(text, "VendName", quoted(device.vendor_name))?;
    entry(text, "ProdType", device.device_type)?;
    entry(text, "ProdTypeStr", "\"Generic Device (keyable)\"")?;
    entry(text, "ProdCode", device.product_code)?;
    entry(text, "MajRev", device.revision.major)?;
    entry(text, "MinRev", device.revision.minor)?;
    entry(text, "ProdName", quoted(device.product_name))?;
    entry(text, "Catalog", quoted(device.product_name))
}

fn write_params(text: &mut String, device: &Description) -> fmt::Result {
    section(text, "Params")?;
    let limits = format!("{}, {}, {PROPOSED_RPI_US}", device.min_rpi_us, device.max_rpi_us);
    let field = |value: &str| value.to_owned();
    table(
        text,
        "Param1",
        &[
            (field("0"), "reserved"),
            (field(","), "link path size, link path: none"),
            (field("0x0000"), "descriptor"),
            (field("0xC8"), "data type: UDINT"),
            (field("4"), "bytes"),
            (quoted("RPI"), "name"),
            (quoted("us"), "unit"),
            (quoted("Requested packet interval"), "help"),
            (limits, "least, most, proposed"),
            (field(",,,"), "scaling: none"),
            (field(",,,"), "links of the scaling: none"),
            (field("0"), "decimal places"),
        ],
    )?;
    let named = device.assemblies.iter().flat_map(members_of).filter(ImageMember::is_named);
    (FIRST_MEMBER..).zip(named).try_for_each(|(number, member)| write_member(text, number, &member))
}

/// Number of the parameter that describes the first member of an assembly: the one before it is the packet interval.
const FIRST_MEMBER: usize = 2;

/// Returns the members of an assembly that carries an image.
fn members_of(assembly: &Assembly) -> Vec<ImageMember> {
    match assembly.role {
        Role::Produced => members::of_feedback(),
        Role::Consumed => members::of_command(),
        Role::Configuration | Role::InputOnlyHeartbeat | Role::ListenOnlyHeartbeat => Vec::new(),
    }
}

/// Returns a unit in the characters that every reader of an EDS knows.
fn ascii(unit: &str) -> String {
    unit.replace('µ', "u").replace('²', "^2").replace('³', "^3")
}

/// Writes what a member of an assembly is: its data type by the codes of volume 1, appendix C, its name and unit.
fn write_member(text: &mut String, number: usize, member: &ImageMember) -> fmt::Result {
    let data_type = match member.form {
        MemberType::Unsigned(8) => "0xC6",
        MemberType::Unsigned(16) => "0xC7",
        MemberType::Unsigned(64) => "0xC9",
        MemberType::Unsigned(_) | MemberType::Bytes(_) => "0xC8",
        MemberType::Bits(_) => "0xD2",
        MemberType::Real => "0xCA",
    };
    let (bytes, name, unit) = (member.bits() / 8, quoted(&member.name), quoted(&ascii(member.unit)));
    writeln!(
        text,
        "    Param{number} = 0, ,, 0x0000, {data_type}, {bytes}, {name}, {unit}, \"\", ,,, ,,,, ,,,, 0;"
    )
}

fn write_assemblies(text: &mut String, device: &Description) -> fmt::Result {
    section(text, "Assembly")?;
    write_class(text, device, ObjectClass::Assembly)?;
    let mut number = FIRST_MEMBER;
    for assembly in device.assemblies {
        let Assembly { instance, size, name, .. } = assembly;
        let mut fields = vec![
            (quoted(name), "name"),
            (quoted(&format!("20 04 {} 30 03", hex("24", *instance))), "path of its data"),
            (size.to_string(), "bytes"),
            ("0x0000".to_owned(), "descriptor"),
            (",".to_owned(), "reserved"),
        ];
        for member in members_of(assembly) {
            let bits = member.bits();
            if member.is_named() {
                fields.push((format!("{bits}, Param{number}"), "member: bits, what it is"));
                number += 1;
            } else {
                fields.push((format!("{bits},"), "member: bits, no meaning"));
            }
        }
        table(text, &format!("Assem{instance}"), &fields)?;
    }
    Ok(())
}

/// Formats an 8-bit segment in hexadecimal. The robot's numbers fit into 8 bits.
fn hex(segment: &str, instance: u32) -> String {
    format!("{segment} {instance:02X}")
}

fn write_connections(text: &mut String, device: &Description) -> fmt::Result {
    section(text, "Connection Manager")?;
    write_class(text, device, ObjectClass::ConnectionManager)?;
    let Some(produced) = device.role(Role::Produced) else { return Ok(()) };
    let kinds = [
        (Role::Consumed, "Exclusive Owner", EXCLUSIVE_OWNER, O_T_RUN_IDLE),
        (Role::InputOnlyHeartbeat, "Input Only", INPUT_ONLY, O_T_HEARTBEAT),
        (Role::ListenOnlyHeartbeat, "Listen Only", LISTEN_ONLY, O_T_HEARTBEAT),
    ];
    let mut number = 0;
    for (role, name, kind, format) in kinds {
        let Some(consumed) = device.role(role) else { continue };
        number += 1;
        let mut path = "20 04".to_owned();
        let configuration = device.role(Role::Configuration);
        if let Some(configuration) = configuration {
            write!(path, " {}", hex("24", configuration.instance))?;
        }
        write!(path, " {} {}", hex("2C", consumed.instance), hex("2C", produced.instance))?;
        let assembly = |assembly: &Assembly| format!("Assem{}", assembly.instance);
        let configuration = configuration.map_or_else(
            || ",".to_owned(),
            |configuration| format!("{}, {}", configuration.size, assembly(configuration)),
        );
        table(
            text,
            &format!("Connection{number}"),
            &[
                (format!("0x{:08X}", CLASS_1_ANY_TRIGGER | kind), "trigger and transport"),
                (format!("0x{:08X}", FIXED_AND_SHARED | format), "connection parameters"),
                (format!("Param1, {}, {}", consumed.size, assembly(consumed)), "O=>T RPI, bytes, format"),
                (format!("Param1, {}, {}", produced.size, assembly(produced)), "T=>O RPI, bytes, format"),
                (",".to_owned(), "configuration of a proxy: none"),
                (configuration, "configuration: bytes, format"),
                (quoted(name), "name"),
                (quoted(""), "help"),
                (quoted(&path), "path"),
            ],
        )?;
    }
    Ok(())
}

fn write_capacity(text: &mut String, device: &Description) -> fmt::Result {
    let Description { exclusive_owners, input_only, listen_only, explicit, .. } = device;
    let io = u16::from(*exclusive_owners) + u16::from(*input_only) + u16::from(*listen_only);
    let largest = device.assemblies.iter().map(Assembly::connection_size).max().unwrap_or(0);
    section(text, "Capacity")?;
    entry(text, "MaxMsgConnections", explicit)?;
    entry(text, "MaxIOProducers", io)?;
    entry(text, "MaxIOConsumers", io)?;
    entry(text, "MaxIOProduceConsume", io)?;
    entry(text, "MaxIOMcastProducers", 1)?;
    entry(text, "MaxConsumersPerMcast", io)?;
    // For one connection, at the shortest interval.
    entry(text, "TSpec1", format_args!("TxRx, {largest}, {}", 1_000_000 / device.min_rpi_us.max(1)))
}
