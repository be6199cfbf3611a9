//! EEPROM of a SubDevice as a device file: a dump of its slave information (ETG.1000.6, SII; ETG.2010).
//!
//! ```text
//! byte
//! 0x00..0x10  configuration of the chip; 0x0E checksum of the bytes before it, 0x0F zero
//! 0x10..0x20  vendor, product, revision, serial number, each u32
//! 0x38        mailbox protocols: AoE 1, EoE 2, CoE 4, FoE 8, SoE 16, VoE 32
//! 0x80..      categories: type, words, data; the last one is 0xFFFF
//! ```

use super::{
    CoeService, DcMode, EepromContent, Esi, EsiDevice, EsiMailbox, EsiPdo, EsiPdoEntry, EsiSyncManager,
};
use crate::fault::FileFault;

/// First category.
const CATEGORIES: usize = 0x80;

/// Longest EEPROM: 16-bit addresses of words reach 128 KiB.
const MOST_BYTES: usize = 0x2_0000;

const STRINGS: u16 = 10;
const GENERAL: u16 = 30;
const SYNC_MANAGERS: u16 = 41;
const TX_PDOS: u16 = 50;
const RX_PDOS: u16 = 51;
const CLOCKS: u16 = 60;
const END: u16 = 0xFFFF;

/// Returns whether these are the bytes of an EEPROM: the checksum of the first seven words is right (ETG.1000.4, 6.4), and what no
/// text has.
pub(crate) fn is_eeprom(bytes: &[u8]) -> bool {
    let Some(([head @ .., sum, 0], _)) = bytes.split_first_chunk::<16>() else { return false };
    bytes.len() >= CATEGORIES + 2
        && bytes.iter().take(CATEGORIES).any(|byte| *byte == 0)
        && checksum(head) == *sum
}

/// Returns the checksum: polynomial x^8 + x^2 + x + 1, initial value 0xFF.
fn checksum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0xFF, |sum, byte| {
        (0..8).fold(sum ^ byte, |sum, _| if sum & 0x80 != 0 { sum << 1 ^ 0x07 } else { sum << 1 })
    })
}

fn u16_at(bytes: &[u8], at: usize) -> u16 {
    bytes.get(at..).and_then(<[u8]>::first_chunk).map_or(0, |bytes| u16::from_le_bytes(*bytes))
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    bytes.get(at..).and_then(<[u8]>::first_chunk).map_or(0, |bytes| u32::from_le_bytes(*bytes))
}

fn u8_at(bytes: &[u8], at: usize) -> u8 {
    bytes.get(at).copied().unwrap_or(0)
}

/// Reads a dump: an ESI of one device.
pub(crate) fn read(bytes: Vec<u8>) -> Result<Esi, FileFault> {
    if bytes.len() > MOST_BYTES {
        let fault = format!("an EEPROM of {} bytes: expected at most {MOST_BYTES}", bytes.len());
        return Err(FileFault::of_file(fault));
    }
    let mut warnings = Vec::new();
    let categories = categories(&bytes, &mut warnings);
    let of = |kind: u16| categories.iter().filter(move |it| it.0 == kind).map(|it| it.1);
    let strings = strings(of(STRINGS).next().unwrap_or_default());
    let text = |number: u8| {
        let found = usize::from(number).checked_sub(1).and_then(|number| strings.get(number));
        found.cloned().unwrap_or_default()
    };
    let general = of(GENERAL).next().unwrap_or_default();
    let clocks =
        of(CLOCKS).flat_map(|data| data.as_chunks::<24>().0).map(|mode| clock(mode, &text)).collect();
    let pdos = |kind| of(kind).flat_map(|data| pdos(data, &text)).collect();
    let device = EsiDevice {
        kind: text(u8_at(general, 2)),
        name: text(u8_at(general, 3)),
        product_code: u32_at(&bytes, 0x14),
        revision: u32_at(&bytes, 0x18),
        group: text(u8_at(general, 0)),
        physics: String::new(),
        fmmus: Vec::new(),
        sync_managers: of(SYNC_MANAGERS).flat_map(|data| data.as_chunks::<8>().0).map(sync_manager).collect(),
        rx_pdos: pdos(RX_PDOS),
        tx_pdos: pdos(TX_PDOS),
        mailbox: mailbox(u16_at(&bytes, 0x38), u8_at(general, 5)),
        dc_modes: clocks,
        slots: Vec::new(),
        takes_module_list: false,
        eeprom: None,
        dictionary: None,
        dictionary_file: None,
    };
    let eeprom = EepromContent {
        byte_size: u32::try_from(bytes.len()).unwrap_or(u32::MAX),
        config_data: bytes.get(..14).unwrap_or_default().to_vec(),
        bootstrap: bytes.get(0x28..0x30).unwrap_or_default().to_vec(),
        is_dump: true,
        data: bytes.clone(),
    };
    Ok(Esi {
        vendor_id: u32_at(&bytes, 0x10),
        vendor: String::new(),
        devices: vec![EsiDevice { eeprom: Some(eeprom), ..device }],
        modules: Vec::new(),
        warnings,
    })
}

/// Splits the dump into its categories. What is cut is a warning.
fn categories<'b>(bytes: &'b [u8], warnings: &mut Vec<FileFault>) -> Vec<(u16, &'b [u8])> {
    let mut found = Vec::new();
    let mut at = CATEGORIES;
    while let Some(head) = bytes.get(at..at + 4) {
        let (kind, words) = (u16_at(head, 0), u16_at(head, 2));
        if kind == END {
            return found;
        }
        let end = at + 4 + 2 * usize::from(words);
        let Some(data) = bytes.get(at + 4..end) else {
            let fault =
                format!("category {kind} at byte {at} ends at byte {end} of {}; ignored", bytes.len());
            warnings.push(FileFault::of_file(fault));
            return found;
        };
        // Empty words after a chip's last category.
        if kind != 0 || words != 0 {
            found.push((kind, data));
        }
        at = end;
    }
    found
}

fn strings(data: &[u8]) -> Vec<String> {
    let Some((count, mut rest)) = data.split_first() else { return Vec::new() };
    let mut strings = Vec::new();
    for _ in 0..*count {
        let Some((len, after)) = rest.split_first() else { break };
        let Some((text, after)) = after.split_at_checked((*len).into()) else { break };
        // ISO 8859-1, whose characters are the first of Unicode.
        strings.push(text.iter().map(|byte| char::from(*byte)).collect());
        rest = after;
    }
    strings
}

fn mailbox(protocols: u16, coe_details: u8) -> Option<EsiMailbox> {
    const NAMES: [&str; 6] = ["AoE", "EoE", "CoE", "FoE", "SoE", "VoE"];
    let has = |bit: usize| protocols & 1 << bit != 0;
    let names = NAMES.iter().enumerate().filter(|(bit, _)| has(*bit));
    let detail = |bit: u8| coe_details & bit != 0;
    let coe = CoeService {
        has_sdo_info: detail(0x02),
        has_pdo_assign: detail(0x04),
        has_pdo_config: detail(0x08),
        has_pdo_upload: detail(0x10),
        has_complete_access: detail(0x20),
        init_commands: Vec::new(),
    };
    (protocols != 0).then(|| EsiMailbox {
        has_repeat: false,
        protocols: names.map(|(_, name)| (*name).to_owned()).collect(),
        coe: has(2).then_some(coe),
    })
}

/// Reads a sync manager: start, length, control, status, activation, use.
fn sync_manager(data: &[u8; 8]) -> EsiSyncManager {
    let [_, _, _, _, control, _, enable, usage] = *data;
    let usage = match usage {
        1 => "MBoxOut",
        2 => "MBoxIn",
        3 => "Outputs",
        4 => "Inputs",
        _ => "",
    };
    EsiSyncManager {
        usage: usage.to_owned(),
        start_address: u16_at(data, 0),
        default_size: Some(u16_at(data, 2)),
        min_size: None,
        max_size: None,
        control,
        is_enabled: enable & 1 != 0,
    }
}

/// Reads the process data objects of a category: eight bytes for the object, and eight for each entry.
fn pdos(data: &[u8], text: &impl Fn(u8) -> String) -> Vec<EsiPdo> {
    let mut words = data.as_chunks::<8>().0.iter();
    let mut pdos = Vec::new();
    while let Some(head) = words.next() {
        let [_, _, count, manager, _, name, ..] = *head;
        let entries: Vec<_> = words.by_ref().take(count.into()).map(|entry| pdo_entry(entry, text)).collect();
        pdos.push(EsiPdo {
            index: u16_at(head, 0),
            depends_on_slot: false,
            name: text(name),
            // An object that is not assigned.
            sync_manager: (manager != 0xFF).then_some(manager),
            is_fixed: false,
            is_mandatory: false,
            excludes: Vec::new(),
            excluded_sync_managers: Vec::new(),
            bits: entries.iter().map(|entry| u32::from(entry.bits)).sum(),
            entries,
        });
    }
    pdos
}

fn pdo_entry(data: &[u8; 8], text: &impl Fn(u8) -> String) -> EsiPdoEntry {
    let [_, _, subindex, name, data_type, bits, ..] = *data;
    EsiPdoEntry {
        index: u16_at(data, 0),
        depends_on_slot: false,
        subindex,
        bits: bits.into(),
        name: text(name),
        data_type: type_name(data_type).to_owned(),
    }
}

/// Returns the name of a base data type (ETG.1020, base data types).
const fn type_name(number: u8) -> &'static str {
    match number {
        0x01 => "BOOL",
        0x02 => "SINT",
        0x03 => "INT",
        0x04 => "DINT",
        0x05 => "USINT",
        0x06 => "UINT",
        0x07 => "UDINT",
        0x08 => "REAL",
        0x11 => "LREAL",
        0x15 => "LINT",
        0x1B => "ULINT",
        _ => "",
    }
}

/// Reads a mode of the clock.
fn clock(data: &[u8; 24], text: &impl Fn(u8) -> String) -> DcMode {
    let signed = |at: usize| u32_at(data, at).cast_signed();
    let factor = |at: usize| Some(u16_at(data, at).cast_signed().into());
    DcMode {
        name: text(u8_at(data, 18)),
        description: text(u8_at(data, 19)),
        assign_activate: u16_at(data, 14),
        sync0_cycle_ns: u32_at(data, 0).into(),
        sync0_factor: factor(16),
        sync0_shift_ns: signed(4).into(),
        sync1_cycle_ns: 0,
        sync1_factor: factor(12),
        sync1_shift_ns: signed(8).into(),
    }
}
