//! From the SubDevice of an ESI to the description that the stack takes.

mod startup;
mod sync_managers;

use device_files::{ChosenPdo, ChosenSubDevice, DcMode, DictionaryEntry, DictionaryObject};
use ethercat_subdevice::description::{
    Access, CONFIGURED_MODULES, ClockMode, DETECTED_MODULES, DataType, Description, Entry, Mailbox, Object,
    ObjectCode, Pdo, PdoEntry,
};
use ethercat_subdevice::{DeviceConfig, DeviceId, PdoConfiguration, Segment};

use crate::config::{EmulationConfig, EmulationError};
use crate::faults::Alteration;
use crate::image::{DataPlace, Image};
use crate::leak;

use self::sync_managers::places;

/// Lengths of a mailbox that the stack has.
const MAILBOX_LENGTHS: std::ops::RangeInclusive<u16> = 32..=1486;

/// Objects that the stack makes itself (ETG.1000.6, CoE communication area).
const OWN_OBJECTS: [u16; 7] = [0x1000, 0x1001, 0x1008, 0x1009, 0x100A, 0x1018, 0x1C00];

/// Makes the segment of one chosen device.
pub(crate) fn open(
    chosen: &ChosenSubDevice,
    alteration: &Alteration,
    config: &EmulationConfig,
) -> Result<(Segment, DeviceId, Image, Image), EmulationError> {
    let device = configure(chosen, alteration, config.serial_number)?;
    let (inputs, outputs) = (device.description.inputs, device.description.outputs);
    let (input_image, output_image) =
        (image(&chosen.inputs, inputs, "inputs"), image(&chosen.outputs, outputs, "outputs"));
    let mut segment = Segment::new();
    let id = segment.add(&device);
    Ok((segment, id, input_image, output_image))
}

/// Makes the configuration of one chosen device.
pub(crate) fn configure(
    chosen: &ChosenSubDevice,
    alteration: &Alteration,
    serial_number: u32,
) -> Result<DeviceConfig, EmulationError> {
    let description = describe(chosen, alteration)?;
    let sync_managers = places(chosen, byte_len(description.outputs), byte_len(description.inputs))?;
    let coe = chosen.mailbox.as_ref().and_then(|it| it.coe.as_ref());
    let assigns = coe.is_some_and(|coe| coe.has_pdo_assign);
    Ok(DeviceConfig {
        serial_number,
        pdo_configuration: if assigns { PdoConfiguration::Assignable } else { PdoConfiguration::Fixed },
        sync_managers,
        checks_modules: chosen.takes_module_list,
        eeprom: eeprom(chosen, alteration),
        ..DeviceConfig::new(Box::leak(Box::new(description)))
    })
}

/// Returns the EEPROM of a dump, with another product code where a fault wants it; empty for a device of an ESI.
fn eeprom(chosen: &ChosenSubDevice, alteration: &Alteration) -> &'static [u8] {
    // The data of an ESI may be cut. A fault that changes the process data changes the EEPROM, too.
    let dump = chosen.eeprom.as_ref().filter(|eeprom| eeprom.is_dump && alteration.extra_input_bytes() == 0);
    let Some(mut data) = dump.map(|eeprom| eeprom.data.clone()) else { return &[] };
    if let Some(product) = data.get_mut(0x14..0x18).filter(|_| alteration.is_other_identity) {
        product.copy_from_slice(&chosen.product_code.wrapping_add(1).to_le_bytes());
    }
    leak::list(data)
}

/// Makes the description of one chosen device.
fn describe(chosen: &ChosenSubDevice, alteration: &Alteration) -> Result<Description, EmulationError> {
    let mut inputs = pdos(&chosen.inputs)?;
    let outputs = pdos(&chosen.outputs)?;
    if alteration.extra_input_bytes() > 0 {
        inputs.push(Pdo { index: 0x1BFF, name: "Added", entries: &[GAP] });
    }
    let mailbox = mailbox(chosen)?;
    let text = |text: &str| leak::text(&leak::ascii(text), 255);
    Ok(Description {
        vendor_id: chosen.vendor_id,
        product_code: chosen.product_code.wrapping_add(u32::from(alteration.is_other_identity)),
        revision: chosen.revision,
        order_code: text(&chosen.kind),
        name: text(&chosen.name),
        group: text(&chosen.group),
        device_type: default_of(chosen, 0x1000).map_or(0, |bytes| number(&bytes)),
        hardware_version: text(&string_of(chosen, 0x1009)),
        software_version: text(&string_of(chosen, 0x100A)),
        outputs: leak::list(outputs),
        inputs: leak::list(inputs),
        optional_outputs: &[],
        optional_inputs: &[],
        mailbox,
        objects: if mailbox.is_some() { objects(chosen) } else { &[] },
        clock_modes: leak::list(chosen.dc_modes.iter().map(clock_mode).collect()),
        numbers_names: false,
    })
}

/// One byte without meaning.
const GAP: PdoEntry =
    PdoEntry { index: 0, subindex: 0, bits: 8, data_type: DataType::Unsigned8, name: "Added" };

fn byte_len(pdos: &[Pdo]) -> u16 {
    ethercat_subdevice::description::process_data_len(pdos)
}

/// Returns the PDOs of a direction. Those of each sync manager are whole bytes.
fn pdos(chosen: &[ChosenPdo]) -> Result<Vec<Pdo>, EmulationError> {
    let mut pdos = Vec::new();
    let mut bits = 0_u32;
    for (it, next) in chosen.iter().zip(chosen.iter().skip(1).map(Some).chain([None])) {
        bits = bits.saturating_add(it.pdo.bits);
        let ends = next.is_some_and(|next| next.sync_manager != it.sync_manager);
        let gap = if ends { bits.div_ceil(8) * 8 - bits } else { 0 };
        bits = bits.saturating_add(gap);
        pdos.push(pdo(&it.pdo, gap)?);
    }
    Ok(pdos)
}

/// Returns a PDO with so many bits of a gap at its end.
fn pdo(pdo: &device_files::EsiPdo, gap: u32) -> Result<Pdo, EmulationError> {
    let mut entries = Vec::new();
    for entry in &pdo.entries {
        // An entry of a mapping object has eight bits for its length; a gap may be cut.
        let mut rest = entry.bits;
        if entry.index != 0 && u8::try_from(rest).is_err() {
            return Err(EmulationError::LongEntry {
                index: entry.index,
                subindex: entry.subindex,
                bits: rest,
            });
        }
        while rest > 0 {
            let bits = u8::try_from(rest.min(255)).unwrap_or(u8::MAX);
            rest -= u16::from(bits);
            entries.push(PdoEntry {
                index: entry.index,
                subindex: entry.subindex,
                bits,
                data_type: data_type(&entry.data_type, u32::from(bits)),
                name: leak::text(&leak::ascii(&entry.name), 255),
            });
        }
    }
    if gap > 0 {
        let bits = u8::try_from(gap).unwrap_or(0);
        entries.push(PdoEntry { bits, data_type: data_type("", gap), name: "", ..GAP });
    }
    Ok(Pdo { index: pdo.index, name: leak::text(&leak::ascii(&pdo.name), 255), entries: leak::list(entries) })
}

fn image(chosen: &[ChosenPdo], pdos: &[Pdo], whole: &str) -> Image {
    let bits: usize = pdos.iter().flat_map(|pdo| pdo.entries).map(|entry| usize::from(entry.bits)).sum();
    let mut places = Vec::new();
    if bits > 0 {
        let all = DataPlace {
            place: whole.to_owned(),
            name: String::new(),
            bit: 0,
            bits: bits.next_multiple_of(8),
        };
        places.push(all);
    }
    let mut bit: usize = 0;
    let mut manager = None;
    for chosen in chosen {
        if manager.replace(chosen.sync_manager).is_some_and(|before| before != chosen.sync_manager) {
            bit = bit.next_multiple_of(8);
        }
        for entry in &chosen.pdo.entries {
            if entry.index != 0 {
                let place = format!("0x{:04X}:{:02X}", entry.index, entry.subindex);
                let name = format!("{}: {}", chosen.pdo.name, entry.name);
                places.push(DataPlace { place, name, bit, bits: entry.bits.into() });
            }
            bit += usize::from(entry.bits);
        }
    }
    Image::new(places, false)
}

fn mailbox(chosen: &ChosenSubDevice) -> Result<Option<Mailbox>, EmulationError> {
    let Some(mailbox) = &chosen.mailbox else { return Ok(None) };
    let size = |usage: &str| {
        let manager = chosen.sync_managers.iter().find(|manager| manager.usage == usage);
        manager.and_then(|manager| manager.default_size)
    };
    let (Some(out), Some(into)) = (size("MBoxOut"), size("MBoxIn")) else {
        return Err(EmulationError::Mailbox(
            "sync managers MBoxOut and MBoxIn need a DefaultSize".to_owned(),
        ));
    };
    if out != into || !MAILBOX_LENGTHS.contains(&out) {
        return Err(EmulationError::Mailbox(format!("{out} and {into} bytes: must be equal, 32 to 1486")));
    }
    let file_capacity = if mailbox.protocols.iter().any(|it| it == "FoE") { 1 << 20 } else { 0 };
    Ok(Some(Mailbox { len: out, file_capacity }))
}

/// Returns the objects of the file that the stack does not make itself.
fn objects(chosen: &ChosenSubDevice) -> &'static [Object] {
    let mut objects: Vec<Object> = Vec::new();
    for object in &startup::with_commanded(chosen) {
        // The device's name is that of the file, where it has one; else it is the type.
        let is_named = object.index == 0x1008 && !object.default.is_empty();
        let is_own = OWN_OBJECTS.contains(&object.index) && !is_named
            || matches!(object.index, 0x1600..=0x17FF | 0x1A00..=0x1BFF | 0x1C10..=0x1C33)
            || chosen.slot_count > 0 && [CONFIGURED_MODULES, DETECTED_MODULES].contains(&object.index)
            || objects.iter().any(|known| known.index == object.index);
        // Entries that process data map are the stack's, with the value in the process data.
        let is_mapped = || {
            let pdos = chosen.inputs.iter().chain(&chosen.outputs);
            pdos.flat_map(|it| &it.pdo.entries).any(|entry| entry.index == object.index)
        };
        if !is_own && !is_mapped() {
            objects.extend(object_of(object));
        }
    }
    objects.extend(module_lists(chosen));
    leak::list(objects)
}

/// Longest value that is kept of an object, in bytes.
const LONGEST_VALUE: u32 = 4096;

/// Returns the lists of modules of a device with slots: the controller may write the configured ones, and the detected ones are those
/// that were chosen.
fn module_lists(chosen: &ChosenSubDevice) -> Vec<Object> {
    if chosen.slot_count == 0 {
        return Vec::new();
    }
    let last = chosen.modules.last().map_or(0, |module| module.slot);
    let ident = |slot: u8| chosen.modules.iter().find(|it| it.slot == slot).map_or(0, |it| it.ident);
    let list = |index, name: &'static str, slots: u8, access, count: u8, is_detected: bool| {
        let count = Entry {
            subindex: 0,
            name: "Number of modules",
            data_type: DataType::Unsigned8,
            access,
            capacity: 1,
            default: leak::list(vec![count]),
        };
        let entries = (1..=slots).map(|slot| Entry {
            subindex: slot,
            name: "ModuleIdent",
            data_type: DataType::Unsigned32,
            access,
            capacity: 4,
            default: leak::list(if is_detected { ident(slot).to_le_bytes().to_vec() } else { vec![0; 4] }),
        });
        let entries = leak::list(std::iter::once(count).chain(entries).collect());
        Object { index, name, code: ObjectCode::Record, entries }
    };
    vec![
        list(CONFIGURED_MODULES, "Configured modules", chosen.slot_count, Access::ReadWrite, 0, false),
        list(DETECTED_MODULES, "Detected modules", last, Access::ReadOnly, last, true),
    ]
}

fn object_of(object: &DictionaryObject) -> Option<Object> {
    let name = leak::text(&leak::ascii(&object.name), 255);
    if object.entries.is_empty() {
        let entry = entry(0, name, &object.data_type, object.bits, &object.access, &object.default)?;
        return Some(Object {
            index: object.index,
            name,
            code: ObjectCode::Variable,
            entries: leak::list(vec![entry]),
        });
    }
    let mut entries: Vec<Entry> = Vec::new();
    let mut sorted: Vec<&DictionaryEntry> = object.entries.iter().collect();
    sorted.sort_by_key(|entry| entry.subindex);
    sorted.dedup_by_key(|entry| entry.subindex);
    for given in sorted {
        let name = leak::text(&leak::ascii(&given.name), 255);
        let access = if given.access.is_empty() { &object.access } else { &given.access };
        entries.extend(entry(given.subindex, name, &given.data_type, given.bits, access, &given.default));
    }
    let highest = entries.last().map_or(0, |entry| entry.subindex);
    let first = entries.iter_mut().find(|entry| entry.subindex == 0);
    let count = Entry {
        subindex: 0,
        name: "Highest subindex",
        data_type: DataType::Unsigned8,
        access: Access::ReadOnly,
        capacity: 1,
        default: leak::list(vec![highest]),
    };
    match first {
        Some(first) if first.default.is_empty() => *first = count,
        Some(_) => {}
        None => entries.insert(0, count),
    }
    Some(Object { index: object.index, name, code: ObjectCode::Record, entries: leak::list(entries) })
}

fn entry(
    subindex: u8,
    name: &'static str,
    kind: &str,
    bits: u32,
    access: &str,
    default: &[u8],
) -> Option<Entry> {
    let bytes = bits.div_ceil(8);
    if !(1..=LONGEST_VALUE).contains(&bytes) {
        return None;
    }
    let access = match access {
        "ro" => Access::ReadOnly,
        "wo" => Access::WriteOnly,
        _ => Access::ReadWrite,
    };
    let capacity = bytes as usize;
    let default = default.get(..capacity.min(default.len())).unwrap_or_default();
    Some(Entry {
        subindex,
        name,
        data_type: data_type(kind, bits),
        access,
        capacity,
        default: leak::list(default.to_vec()),
    })
}

/// Returns a mode of the clock as the EEPROM has it. A value that does not fit its field becomes the nearest one that does.
fn clock_mode(mode: &DcMode) -> ClockMode {
    let i16_of = |factor: Option<i32>| factor.unwrap_or(0).clamp(i16::MIN.into(), i16::MAX.into()) as i16;
    let i32_of = |ns: i64| ns.clamp(i32::MIN.into(), i32::MAX.into()) as i32;
    ClockMode {
        name: leak::text(&leak::ascii(&mode.name), 255),
        description: leak::text(&leak::ascii(&mode.description), 255),
        assign_activate: mode.assign_activate,
        sync0_cycle_ns: mode.sync0_cycle_ns.clamp(0, u32::MAX.into()) as u32,
        sync0_factor: i16_of(mode.sync0_factor),
        sync0_shift_ns: i32_of(mode.sync0_shift_ns),
        sync1_factor: i16_of(mode.sync1_factor),
        sync1_shift_ns: i32_of(mode.sync1_shift_ns),
    }
}

/// Returns the type of a name of ETG.2000, or the one that fits the bits (ETG.1020, base data types).
fn data_type(name: &str, bits: u32) -> DataType {
    match (name, bits) {
        ("BOOL", 1) => DataType::Boolean,
        ("BIT" | "BIT1", 1) => DataType::Bit1,
        ("BIT8", 8) => DataType::Bit8,
        ("SINT", 8) => DataType::Integer8,
        ("INT", 16) => DataType::Integer16,
        ("DINT", 32) => DataType::Integer32,
        ("LINT", 64) => DataType::Integer64,
        ("REAL", 32) => DataType::Real32,
        ("LREAL", 64) => DataType::Real64,
        (name, _) if name.starts_with("STRING") => DataType::VisibleString,
        (_, 1) => DataType::Boolean,
        (_, 2) => DataType::Bit2,
        (_, 3) => DataType::Bit3,
        (_, 4) => DataType::Bit4,
        (_, 5) => DataType::Bit5,
        (_, 6) => DataType::Bit6,
        (_, 7) => DataType::Bit7,
        (_, 8) => DataType::Unsigned8,
        (_, 16) => DataType::Unsigned16,
        (_, 32) => DataType::Unsigned32,
        (_, 64) => DataType::Unsigned64,
        _ => DataType::OctetString,
    }
}

fn default_of(chosen: &ChosenSubDevice, index: u16) -> Option<Vec<u8>> {
    let objects = &chosen.dictionary.as_ref()?.objects;
    let object = objects.iter().find(|object| object.index == index)?;
    Some(object.default.clone()).filter(|default| !default.is_empty())
}

fn string_of(chosen: &ChosenSubDevice, index: u16) -> String {
    let bytes = default_of(chosen, index).unwrap_or_default();
    String::from_utf8_lossy(&bytes).trim_end_matches('\0').to_owned()
}

fn number(bytes: &[u8]) -> u32 {
    let mut number = [0; 4];
    number.iter_mut().zip(bytes).for_each(|(place, byte)| *place = *byte);
    u32::from_le_bytes(number)
}

#[cfg(test)]
mod tests;
