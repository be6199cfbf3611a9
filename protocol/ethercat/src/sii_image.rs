//! The EEPROM of a device, made from its description (ETG.1000.6, slave information interface; ETG.2010).
//!
//! ```text
//! word
//! 0x00..0x07  configuration of the chip: PDI, station alias at 0x04, checksum of the first 14 bytes at 0x07
//! 0x08..0x10  vendor, product, revision, serial number
//! 0x14..0x18  mailbox in BOOT: receive start, length, send start, length
//! 0x18..0x1C  mailbox: the same
//! 0x1C        mailbox protocols: CoE 0x04, FoE 0x08
//! 0x3E, 0x3F  size in KiBit - 1, version
//! 0x40..      categories: type, length in words, data; the last one is 0xFFFF
//! ```

use alloc::borrow::Cow;
use alloc::vec;
use alloc::vec::Vec;

use crate::Writer;
use crate::description::{ClockMode, Description, Pdo};
use crate::dictionary::PdoConfiguration;
use crate::esc::checksum;
use crate::layout::{Layout, SyncManagerLayout, Usage};

/// Largest size of an image in bytes: what 16-bit addresses of a 32 KiBit EEPROM reach.
const CAPACITY: usize = 0x1_0000;

const STRINGS: u16 = 10;
const GENERAL: u16 = 30;
const FMMU: u16 = 40;
const SYNC_MANAGER: u16 = 41;
const TX_PDO: u16 = 50;
const RX_PDO: u16 = 51;
const CLOCK: u16 = 60;
const END: u16 = 0xFFFF;

/// A byte that was not written.
const ERASED: u8 = 0xFF;

/// Bytes of a mode in category 60.
const CLOCK_MODE: usize = 24;

/// Returns the content of the EEPROM of a device with this description, serial number and station alias, and with fixed
/// process data.
#[must_use]
pub fn sii_image(description: &Description, serial_number: u32, alias: u16) -> Vec<u8> {
    image_of(description, (serial_number, alias), PdoConfiguration::Fixed, &[])
}

/// Returns the content of the EEPROM of a device whose process data the MainDevice may choose, with sync managers where
/// `sync_managers` has them, if it has any.
pub(crate) fn image_of(
    description: &Description,
    (serial_number, alias): (u32, u16),
    pdo_configuration: PdoConfiguration,
    sync_managers: &[SyncManagerLayout],
) -> Vec<u8> {
    let mut image = vec![0; CAPACITY];
    let layout = Layout::new(description, sync_managers);
    let mut writer = Writer::new(&mut image);
    header(&mut writer, description, &layout, serial_number, alias);
    let mut strings = Strings::default();
    let general = general(description, pdo_configuration, &mut strings);
    let mut pdos_of = |pdos, usage| pdo_category(description, pdos, (&layout, usage), &mut strings);
    let tx = pdos_of(description.inputs, Usage::Inputs);
    let rx = pdos_of(description.outputs, Usage::Outputs);
    let clock = clock_modes(description.clock_modes, &mut strings);
    category(&mut writer, STRINGS, &strings.bytes());
    category(&mut writer, GENERAL, &general);
    category(&mut writer, FMMU, &fmmus(&layout));
    category(&mut writer, SYNC_MANAGER, &layout.iter().flat_map(sync_manager).collect::<Vec<u8>>());
    category(&mut writer, TX_PDO, &tx);
    category(&mut writer, RX_PDO, &rx);
    category(&mut writer, CLOCK, &clock);
    writer.u16(END);
    let used = writer.len();
    // EEPROMs have sizes of powers of two, 1 KiBit = 128 bytes being the smallest.
    let size = used.next_power_of_two().max(0x800);
    writer.patch_u16(0x7C, u16::try_from(size / 128 - 1).unwrap_or(u16::MAX));
    image.truncate(size);
    // The rest is as a manufacturer leaves it.
    if let Some(rest) = image.get_mut(used..) {
        rest.fill(ERASED);
    }
    image
}

fn header(
    writer: &mut Writer<'_>,
    description: &Description,
    layout: &Layout,
    serial_number: u32,
    alias: u16,
) {
    // PDI control: 16-bit microcontroller, asynchronous; bit 10 switches SYNC signals on. SYNC0 and SYNC1 are outputs, both
    // with interrupt.
    let mut configuration = [0; 14];
    let mut first = Writer::new(&mut configuration);
    first.u16(if description.has_clocks() { 0x0408 } else { 0x0008 });
    first.u16(if description.has_clocks() { 0xCC00 } else { 0 });
    first.u16(if description.has_clocks() { 100 } else { 0 }); // pulse length in 10 ns
    first.u16(0);
    first.u16(alias);
    writer.bytes(&configuration);
    writer.u16(u16::from(checksum(&configuration)));
    writer.u32(description.vendor_id);
    writer.u32(description.product_code);
    writer.u32(description.revision);
    writer.u32(serial_number);
    writer.pad_to(0x14 * 2);
    let place =
        |usage| layout.find(usage).map_or((0, 0), |(_, SyncManagerLayout { start, len, .. })| (start, len));
    for exists in [description.has_files(), true] {
        for usage in [Usage::MailboxReceive, Usage::MailboxSend] {
            let (start, len) = if exists { place(usage) } else { (0, 0) };
            writer.u16(start);
            writer.u16(len);
        }
    }
    writer.u16(
        if description.mailbox.is_some() { 0x04 } else { 0 } | if description.has_files() { 0x08 } else { 0 },
    );
    writer.pad_to(0x3F * 2);
    writer.u16(1);
}

/// Returns the sync manager of the data from this bit of a direction on.
fn number(layout: &Layout, usage: Usage, bit: usize) -> u8 {
    let mut parts = layout.parts(usage);
    let found = parts.find(|(_, range)| bit / 8 < range.end).or_else(|| layout.parts(usage).last());
    found.map_or(0, |(number, _)| number as u8)
}

fn category(writer: &mut Writer<'_>, kind: u16, data: &[u8]) {
    if data.is_empty() {
        return;
    }
    writer.u16(kind);
    writer.u16(u16::try_from(data.len().div_ceil(2)).unwrap_or(u16::MAX));
    writer.bytes(data);
    writer.align(2);
}

/// The strings, which the other categories name by their numbers from 1.
#[derive(Default)]
struct Strings(Vec<Cow<'static, str>>);

impl Strings {
    fn number(&mut self, string: impl Into<Cow<'static, str>>) -> u8 {
        let string = string.into();
        if string.is_empty() {
            return 0;
        }
        let known = self.0.iter().position(|known| *known == string);
        let index = known.unwrap_or_else(|| {
            self.0.push(string);
            self.0.len() - 1
        });
        // If there are more strings than numbers, the last strings get none.
        u8::try_from(index + 1).unwrap_or(0)
    }

    fn bytes(&self) -> Vec<u8> {
        let mut bytes = vec![self.0.len().min(255) as u8];
        for string in self.0.iter().take(255) {
            let string = string.as_bytes().get(..string.len().min(255)).unwrap_or_default();
            bytes.push(string.len() as u8);
            bytes.extend_from_slice(string);
        }
        bytes
    }
}

fn general(
    description: &Description,
    pdo_configuration: PdoConfiguration,
    strings: &mut Strings,
) -> [u8; 32] {
    let mut general = [0; 32];
    let mut writer = Writer::new(&mut general);
    // Some MainDevices take the first string for the device's name.
    let order_code = strings.number(description.order_code);
    let name = strings.number(description.name);
    writer.u8(strings.number(description.group));
    writer.u8(0); // image
    writer.u8(order_code);
    writer.u8(name);
    writer.u8(0);
    // CoE: SDO, SDO information, complete access; assignment of PDOs 0x04 and their mapping 0x08.
    let chosen = match pdo_configuration {
        PdoConfiguration::Fixed => 0,
        PdoConfiguration::Assignable => 0x04,
        PdoConfiguration::Mappable => 0x04 | 0x08,
    };
    writer.u8(if description.mailbox.is_some() { 0x01 | 0x02 | 0x20 | chosen } else { 0 });
    writer.u8(description.has_files().into());
    writer.zeros(4); // EoE, SoE, channels of DS402, SysmanClass
    // The mailbox repeats its last message.
    writer.u8(if description.mailbox.is_some() { 0x04 } else { 0 });
    writer.zeros(4);
    writer.u16(0x0011); // ports 0 and 1 are MII
    general
}

/// Returns what each FMMU is for: 1 outputs, 2 inputs, 3 status of the send mailbox. 0 fills up the last word: an FMMU that is
/// not used.
fn fmmus(layout: &Layout) -> Vec<u8> {
    let uses = [(Usage::Outputs, 1), (Usage::Inputs, 2), (Usage::MailboxSend, 3)];
    // Without a mailbox, FMMU n is that of sync manager n; some MainDevices take that for granted.
    if layout.find(Usage::MailboxSend).is_none() {
        let number = |layout: SyncManagerLayout| if layout.usage == Usage::Outputs { 1 } else { 2 };
        let mut fmmus: Vec<u8> = layout.iter().map(number).collect();
        fmmus.resize(fmmus.len().next_multiple_of(2), 0);
        return fmmus;
    }
    let mut fmmus: Vec<u8> =
        uses.iter().flat_map(|(usage, number)| layout.parts(*usage).map(|_| *number)).collect();
    fmmus.resize(fmmus.len().next_multiple_of(2), 0);
    fmmus
}

/// Returns the modes of the clock (ETG.2010, category 60).
///
/// ```text
/// 0..4    cycle of SYNC0 in ns, 0: that of the MainDevice's task
/// 4..12   shift of SYNC0, of SYNC1
/// 12..14  cycle of SYNC1 in cycles of SYNC0
/// 14..16  registers 0x0980 and 0x0981
/// 16..18  cycle of SYNC0 in cycles of the task
/// 18, 19  strings: name, description
/// 20..24  reserved
/// ```
fn clock_modes(modes: &[ClockMode], strings: &mut Strings) -> Vec<u8> {
    let mut bytes = vec![0; modes.len() * CLOCK_MODE];
    let mut writer = Writer::new(&mut bytes);
    for mode in modes {
        writer.u32(mode.sync0_cycle_ns);
        writer.u32(mode.sync0_shift_ns.cast_unsigned());
        writer.u32(mode.sync1_shift_ns.cast_unsigned());
        writer.u16(mode.sync1_factor.cast_unsigned());
        writer.u16(mode.assign_activate);
        writer.u16(mode.sync0_factor.cast_unsigned());
        writer.u8(strings.number(mode.name));
        writer.u8(strings.number(mode.description));
        writer.zeros(4);
    }
    bytes
}

fn sync_manager(layout: SyncManagerLayout) -> [u8; 8] {
    let SyncManagerLayout { usage, start, len, control } = layout;
    let [start_low, start_high] = start.to_le_bytes();
    let [len_low, len_high] = len.to_le_bytes();
    let enable = u8::from(len > 0);
    [start_low, start_high, len_low, len_high, control, 0, enable, usage as u8]
}

fn pdo_category(
    description: &Description,
    pdos: &'static [Pdo],
    (layout, usage): (&Layout, Usage),
    strings: &mut Strings,
) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut bit = 0;
    for pdo in pdos {
        let sync_manager = number(layout, usage, bit);
        bit += pdo.entries.iter().map(|entry| usize::from(entry.bits)).sum::<usize>();
        bytes.extend_from_slice(&pdo.index.to_le_bytes());
        bytes.push(pdo.entries.len().min(255) as u8);
        bytes.push(sync_manager);
        bytes.push(0); // no synchronisation
        bytes.push(strings.number(pdo.name));
        bytes.extend_from_slice(&[0, 0]);
        for entry in pdo.entries.iter().take(255) {
            bytes.extend_from_slice(&entry.index.to_le_bytes());
            bytes.push(entry.subindex);
            bytes.push(strings.number(description.full_name(entry)));
            bytes.push(entry.data_type as u8);
            bytes.push(entry.bits);
            bytes.extend_from_slice(&[0, 0]);
        }
    }
    bytes
}
