//! The catalogue of an EtherNet/IP adapter.

use std::fmt;

use device_files::{ConnectionEnd, ConnectionUse, Eds, EdsConnection, RealTimeFormat};

use super::{FileText, line};

/// Lists the catalogue.
pub(super) fn list(text: &mut String, eds: &Eds) -> fmt::Result {
    line(
        text,
        0,
        format_args!(
            "EDS {}: {}, {}",
            FileText(&eds.file_revision),
            FileText(&eds.vendor),
            FileText(&eds.product_name)
        ),
    )?;
    let revision = (eds.major_revision, eds.minor_revision);
    let kind = FileText(&eds.device_type_name);
    line(
        text,
        0,
        format_args!(
            "vendor {}, device type {} ({kind}), product code {}, revision {}.{}",
            eds.vendor_id, eds.device_type, eds.product_code, revision.0, revision.1
        ),
    )?;
    for connection in &eds.connections {
        list_connection(text, connection)?;
    }
    list_assemblies(text, eds)?;
    list_parameters(text, eds)?;
    if !eds.capacity.is_empty() {
        line(text, 0, format_args!(""))?;
    }
    for limit in &eds.capacity {
        line(
            text,
            0,
            format_args!("capacity {}: {}", FileText(&limit.key), FileText(&limit.fields.join(", "))),
        )?;
    }
    for port in &eds.ports {
        line(
            text,
            0,
            format_args!("port {}: {} {}", port.entry, FileText(&port.kind), FileText(&port.name)),
        )?;
    }
    Ok(())
}

fn list_connection(text: &mut String, connection: &EdsConnection) -> fmt::Result {
    let uses = connection.uses.iter().map(|it| match it {
        ConnectionUse::ListenOnly => "listen only",
        ConnectionUse::InputOnly => "input only",
        ConnectionUse::ExclusiveOwner => "exclusive owner",
        ConnectionUse::RedundantOwner => "redundant owner",
    });
    let uses = uses.collect::<Vec<_>>().join(", ");
    line(text, 0, format_args!(""))?;
    line(text, 0, format_args!("connection {}: {}; {uses}", connection.number, FileText(&connection.name)))?;
    let classes: Vec<_> = connection.transport_classes.iter().map(u8::to_string).collect();
    let triggers = connection.triggers.join(", ");
    line(
        text,
        2,
        format_args!("class {}; {triggers}; path {}", classes.join(", "), FileText(&connection.path)),
    )?;
    list_end(text, "O->T", &connection.o_to_t)?;
    list_end(text, "T->O", &connection.t_to_o)?;
    let size = bytes(connection.configuration_size);
    line(text, 2, format_args!("configuration: {size} {}", FileText(&connection.configuration_format)))
}

fn bytes(size: Option<u32>) -> String {
    size.map_or("size from the originator".to_owned(), |size| format!("{size} bytes"))
}

fn list_end(text: &mut String, word: &str, end: &ConnectionEnd) -> fmt::Result {
    let format = match end.real_time_format {
        RealTimeFormat::Modeless => "modeless",
        RealTimeFormat::ZeroLength => "zero length means idle",
        RealTimeFormat::Heartbeat => "heartbeat",
        RealTimeFormat::Header32Bit => "32-bit header",
        RealTimeFormat::Safety => "CIP Safety",
        RealTimeFormat::Reserved => "reserved format",
    };
    let size = bytes(end.size);
    let kind = match (end.is_fixed_size, end.is_variable_size) {
        (true, true) => "fixed or variable",
        (_, true) => "variable",
        _ => "fixed",
    };
    let rpi = match (end.rpi_us, end.rpi_limits_us) {
        (rpi, Some((least, most))) => {
            let proposed = rpi.map_or(String::new(), |rpi| format!(", proposed {rpi} us"));
            format!("RPI {least} to {most} us{proposed}")
        }
        (Some(rpi), None) => format!("RPI {rpi} us"),
        (None, None) => "RPI from the originator".to_owned(),
    };
    let (data, types) = (FileText(&end.format), end.types.join(" or "));
    line(text, 2, format_args!("{word}: {size} {data}; {kind}; {format}; {types}; {rpi}"))
}

fn list_assemblies(text: &mut String, eds: &Eds) -> fmt::Result {
    if !eds.assemblies.is_empty() {
        line(text, 0, format_args!(""))?;
    }
    for assembly in &eds.assemblies {
        let size = assembly.size.map_or("size from the device".to_owned(), |size| format!("{size} bytes"));
        let (name, path) = (FileText(&assembly.name), FileText(&assembly.path));
        line(text, 0, format_args!("assembly {}: {name}, {size}, path {path}", assembly.number))?;
        for member in &assembly.members {
            let bits = member.bits.map_or(String::new(), |bits| format!("{bits} bits "));
            line(text, 2, format_args!("{bits}{}", FileText(&member.target)))?;
        }
    }
    Ok(())
}

fn list_parameters(text: &mut String, eds: &Eds) -> fmt::Result {
    if !eds.parameters.is_empty() {
        line(text, 0, format_args!(""))?;
    }
    for parameter in &eds.parameters {
        let size = parameter.size.map_or(String::new(), |size| format!(", {size} bytes"));
        let (name, unit, default) =
            (FileText(&parameter.name), FileText(&parameter.unit), FileText(&parameter.default));
        let (least, most) = (FileText(&parameter.minimum), FileText(&parameter.maximum));
        let data_type = parameter.data_type;
        line(
            text,
            0,
            format_args!(
                "parameter {}: {name} [{unit}], type 0x{data_type:02X}{size}, {least} to {most}, default {default}",
                parameter.number
            ),
        )?;
        for value in &parameter.texts {
            line(text, 2, format_args!("{}: {}", value.value, FileText(&value.text)))?;
        }
    }
    Ok(())
}
