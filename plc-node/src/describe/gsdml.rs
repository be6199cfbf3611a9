//! The catalogue of a PROFINET device.

use std::fmt;

use device_files::{
    AccessPoint, Gsdml, GsdmlModule, GsdmlSubmodule, IoDirection, ParameterRecord, Placement,
};

use super::{Digits, FileText, line};

/// Unit of PROFINET's intervals in ns (IEC 61158-6-10, SendClockFactor).
const UNIT_NS: u32 = 31_250;

/// Lists the catalogue.
pub(super) fn list(text: &mut String, gsdml: &Gsdml) -> fmt::Result {
    let family = FileText(&gsdml.product_family);
    line(
        text,
        0,
        format_args!("GSDML {}: {}, {family}", FileText(&gsdml.schema_version), FileText(&gsdml.vendor)),
    )?;
    line(
        text,
        0,
        format_args!(
            "vendor 0x{:04X}, device 0x{:04X}: {}",
            gsdml.vendor_id,
            gsdml.device_id,
            FileText(&gsdml.info)
        ),
    )?;
    for access_point in &gsdml.access_points {
        list_access_point(text, gsdml, access_point)?;
    }
    for module in &gsdml.modules {
        line(text, 0, format_args!(""))?;
        line(text, 0, format_args!("module {}", Head(module)))?;
        list_submodules(text, gsdml, module)?;
    }
    if !gsdml.submodules.is_empty() {
        line(text, 0, format_args!(""))?;
        line(text, 0, format_args!("submodules"))?;
    }
    for submodule in &gsdml.submodules {
        list_submodule(text, submodule, "")?;
    }
    let (channels, units) = (gsdml.channel_diagnosis.len(), gsdml.unit_diagnosis.len());
    line(text, 0, format_args!(""))?;
    line(
        text,
        0,
        format_args!("diagnosis: {channels} errors of channels, {units} formats of the manufacturer"),
    )
}

/// First line of a module.
struct Head<'a>(&'a GsdmlModule);

impl fmt::Display for Head<'_> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let module = self.0;
        write!(formatter, "{}: 0x{:08X} {}", FileText(&module.id), module.ident, FileText(&module.name))?;
        match &module.order_number {
            Some(number) => write!(formatter, ", order number {}", FileText(number)),
            None => Ok(()),
        }
    }
}

fn list_access_point(text: &mut String, gsdml: &Gsdml, access_point: &AccessPoint) -> fmt::Result {
    line(text, 0, format_args!(""))?;
    line(text, 0, format_args!("access point {}", Head(&access_point.module)))?;
    let interval = f64::from(u32::from(access_point.min_device_interval) * UNIT_NS) / 1e6;
    let name = FileText(&access_point.dns_compatible_name);
    line(
        text,
        2,
        format_args!(
            "station name {name}; slots {}; shortest interval {interval} ms",
            access_point.physical_slots
        ),
    )?;
    let modes = access_point.startup_modes.join(", ");
    line(
        text,
        2,
        format_args!(
            "start-up {}; schema V{}",
            FileText(&modes),
            FileText(&access_point.required_schema_version)
        ),
    )?;
    let limits = [
        ("inputs", access_point.max_input_length),
        ("outputs", access_point.max_output_length),
        ("both", access_point.max_data_length),
    ];
    let limits = limits.iter().filter_map(|(name, limit)| limit.map(|limit| format!("{name} {limit}")));
    let limits = limits.collect::<Vec<_>>().join(", ");
    if !limits.is_empty() {
        line(text, 2, format_args!("most bytes with status: {limits}"))?;
    }
    for timing in &access_point.timing {
        let (class, clocks, ratios) = (timing.rt_class, &timing.send_clocks, &timing.reduction_ratios);
        line(
            text,
            2,
            format_args!("RT class {class}: send clocks {clocks} x 31.25 us; reduction ratios {ratios}"),
        )?;
    }
    list_submodules(text, gsdml, &access_point.module)?;
    for placement in &access_point.modules {
        let name = gsdml.module(&placement.id).map_or("", |module| module.name.as_str());
        line(
            text,
            2,
            format_args!(
                "{}: module {} {}",
                Places(placement, "slot"),
                FileText(&placement.id),
                FileText(name)
            ),
        )?;
    }
    Ok(())
}

/// Slots or subslots of a placement.
struct Places<'a>(&'a Placement, &'static str);

impl fmt::Display for Places<'_> {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(placement, noun) = self;
        let places = [("", &placement.allowed), ("fixed ", &placement.fixed), ("used ", &placement.used)];
        let places = places.iter().filter(|(_, ranges)| !ranges.0.is_empty());
        let places: Vec<_> = places.map(|(word, ranges)| format!("{word}{ranges}")).collect();
        write!(formatter, "{noun} {}", places.join(", "))
    }
}

fn list_submodules(text: &mut String, gsdml: &Gsdml, module: &GsdmlModule) -> fmt::Result {
    for submodule in &module.submodules {
        // A submodule without a place is in subslot 1 (GSDML, FixedInSubslots).
        let places = submodule.fixed_in_subslots.to_string();
        list_submodule(
            text,
            submodule,
            &format!("subslot {}: ", if places.is_empty() { "1" } else { &places }),
        )?;
    }
    for system in &module.system_submodules {
        let (subslot, ident, name) = (system.subslot, system.ident, FileText(&system.name));
        line(text, 2, format_args!("subslot {subslot}: 0x{ident:08X} {name}"))?;
        list_records(text, &system.records)?;
    }
    for placement in &module.pluggable {
        let name = gsdml.submodule(&placement.id).map_or("", |submodule| submodule.name.as_str());
        let places = Places(placement, "subslot");
        line(text, 2, format_args!("{places}: submodule {} {}", FileText(&placement.id), FileText(name)))?;
    }
    Ok(())
}

fn list_submodule(text: &mut String, submodule: &GsdmlSubmodule, place: &str) -> fmt::Result {
    let (inputs, outputs) = (submodule.inputs.length, submodule.outputs.length);
    let safety = if submodule.is_safety { ", PROFIsafe" } else { "" };
    let (id, ident, name) = (FileText(&submodule.id), submodule.ident, FileText(&submodule.name));
    line(
        text,
        2,
        format_args!("{place}{id}: 0x{ident:08X} {name}; {inputs} bytes in, {outputs} bytes out{safety}"),
    )?;
    list_data(text, "in", &submodule.inputs)?;
    list_data(text, "out", &submodule.outputs)?;
    list_records(text, &submodule.records)
}

fn list_data(text: &mut String, word: &str, direction: &IoDirection) -> fmt::Result {
    let mut at = 0_u32;
    for item in &direction.items {
        let (data_type, name) = (FileText(&item.data_type), FileText(&item.name));
        line(text, 4, format_args!("{word} {at}: {data_type}, {} bytes: {name}", item.length))?;
        for bit in &item.bits {
            line(text, 6, format_args!("bit {}: {}", bit.offset, FileText(&bit.name)))?;
        }
        at = at.saturating_add(item.length);
    }
    Ok(())
}

fn list_records(text: &mut String, records: &[ParameterRecord]) -> fmt::Result {
    for record in records {
        let (index, name, bytes) = (record.index, FileText(&record.name), Digits(&record.default));
        line(text, 4, format_args!("record {index}: {name}, default {bytes}"))?;
        for value in &record.values {
            let (name, data_type, default) =
                (FileText(&value.name), FileText(&value.data_type), FileText(&value.default));
            let at = match value.data_type.as_str() {
                "Bit" => format!("byte {} bit {}", value.byte_offset, value.bit_offset),
                "BitArea" => {
                    let last = value.bit_offset.saturating_add(value.bit_length).saturating_sub(1);
                    format!("byte {} bits {}..{last}", value.byte_offset, value.bit_offset)
                }
                _ => format!("byte {}", value.byte_offset),
            };
            let allowed = value
                .allowed
                .as_deref()
                .map_or(String::new(), |allowed| format!(", allowed {}", FileText(allowed)));
            line(text, 6, format_args!("{at}: {data_type} {name}, default {default}{allowed}"))?;
        }
    }
    Ok(())
}
