//! Description of a SubDevice: identity, process data, mailbox and objects. Its EEPROM, its memory and its object dictionary
//! follow from it.

use alloc::borrow::Cow;
use alloc::format;

/// Object with the ModuleIdent that the controller expects in each slot (ETG.5001.1).
pub const CONFIGURED_MODULES: u16 = 0xF030;

/// Object with the ModuleIdent of the module in each slot (ETG.5001.1).
pub const DETECTED_MODULES: u16 = 0xF050;

/// A kind of SubDevice. Every emulated one of that kind reads the same description.
#[derive(Clone, Copy, Debug)]
pub struct Description {
    /// Vendor ID, assigned by the EtherCAT Technology Group.
    pub vendor_id: u32,
    /// The vendor's code of the product.
    pub product_code: u32,
    /// Revision of the product.
    pub revision: u32,
    /// Order code, which MainDevices show as the device's name, at most 255 ASCII characters.
    pub order_code: &'static str,
    /// Name in words, at most 255 ASCII characters.
    pub name: &'static str,
    /// Group of devices under which tools list it, at most 255 ASCII characters.
    pub group: &'static str,
    /// Object 0x1000: the device profile in the low word, 0 for none.
    pub device_type: u32,
    /// Object 0x1009.
    pub hardware_version: &'static str,
    /// Object 0x100A.
    pub software_version: &'static str,
    /// Process data that the MainDevice writes (RxPDOs), in the order of their bytes.
    pub outputs: &'static [Pdo],
    /// Process data that the MainDevice reads (TxPDOs), in the order of their bytes.
    pub inputs: &'static [Pdo],
    /// Entries besides those of `outputs` that the MainDevice may map into outputs, where it may map process data at all. Their
    /// total length is the room that there is beyond that of `outputs`.
    pub optional_outputs: &'static [PdoEntry],
    /// The same of inputs.
    pub optional_inputs: &'static [PdoEntry],
    /// The mailbox, or `None` for a device that has only process data.
    pub mailbox: Option<Mailbox>,
    /// Objects of the dictionary besides those that follow from the other fields.
    pub objects: &'static [Object],
    /// Modes of its distributed clocks; none for a device without these.
    pub clock_modes: &'static [ClockMode],
    /// Whether the names of `PdoEntry` are those of objects, so that EEPROM and dictionary add the subindex to tell the parts of
    /// an object apart.
    pub numbers_names: bool,
}

impl Description {
    /// Returns whether the device has distributed clocks.
    #[must_use]
    pub const fn has_clocks(&self) -> bool {
        !self.clock_modes.is_empty()
    }

    /// Returns the name of an entry that ESI file, EEPROM and dictionary have.
    #[must_use]
    pub fn full_name(&self, entry: &PdoEntry) -> Cow<'static, str> {
        match entry.subindex {
            1.. if self.numbers_names => Cow::Owned(format!("{} {}", entry.name, entry.subindex)),
            _ => Cow::Borrowed(entry.name),
        }
    }

    /// Returns whether files can be written to the device.
    #[must_use]
    pub fn has_files(&self) -> bool {
        self.mailbox.is_some_and(|mailbox| mailbox.file_capacity > 0)
    }
}

/// A mailbox with CoE.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Mailbox {
    /// Length in bytes of each of the two mailboxes, 32 to 1486.
    pub len: u16,
    /// Length in bytes of the largest file that can be written by FoE; 0 for a device without FoE.
    pub file_capacity: usize,
}

/// A process data object: a row of entries that the MainDevice maps as a whole.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Pdo {
    /// Index of its mapping object: 0x1600 to 0x17FF for outputs, 0x1A00 to 0x1BFF for inputs.
    pub index: u16,
    /// Name in words.
    pub name: &'static str,
    /// Its entries, in the order of their bits.
    pub entries: &'static [PdoEntry],
}

/// An entry of a process data object.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct PdoEntry {
    /// Index of the object that it shows; 0 for a gap.
    pub index: u16,
    /// Subindex of the object.
    pub subindex: u8,
    /// Length in bits.
    pub bits: u8,
    /// Type of the object.
    pub data_type: DataType,
    /// Name in words.
    pub name: &'static str,
}

/// Mode of a device with distributed clocks, as ESI file and EEPROM list them (ETG.2000, OpMode; ETG.2010, category 60).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ClockMode {
    /// Its name.
    pub name: &'static str,
    /// Explanation in words.
    pub description: &'static str,
    /// Value for the registers 0x0980 and 0x0981.
    pub assign_activate: u16,
    /// Cycle of SYNC0 in ns; 0 for one of the MainDevice's task.
    pub sync0_cycle_ns: u32,
    /// Cycle of SYNC0, in cycles of the MainDevice's task; 0 without SYNC0.
    pub sync0_factor: i16,
    /// Shift of SYNC0 in ns.
    pub sync0_shift_ns: i32,
    /// Cycle of SYNC1, in cycles of SYNC0.
    pub sync1_factor: i16,
    /// Shift of SYNC1 in ns.
    pub sync1_shift_ns: i32,
}

impl ClockMode {
    /// No SYNC signal, with names and values that all are empty.
    pub const EMPTY: Self = Self {
        name: "",
        description: "",
        assign_activate: 0,
        sync0_cycle_ns: 0,
        sync0_factor: 0,
        sync0_shift_ns: 0,
        sync1_factor: 0,
        sync1_shift_ns: 0,
    };
}

/// The usual modes of a device with distributed clocks: without them, and with SYNC0.
pub const CLOCK_MODES: [ClockMode; 2] = [
    ClockMode { name: "FreeRun", description: "without clock", ..ClockMode::EMPTY },
    ClockMode {
        name: "DC",
        description: "SYNC0",
        assign_activate: 0x0300,
        sync0_factor: 1,
        ..ClockMode::EMPTY
    },
];

/// An object of the dictionary.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Object {
    /// Its index.
    pub index: u16,
    /// Name in words.
    pub name: &'static str,
    /// Its shape.
    pub code: ObjectCode,
    /// Its entries, subindices ascending. An array or a record begins with subindex 0, its highest subindex.
    pub entries: &'static [Entry],
}

/// An entry of an object.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Entry {
    /// Its subindex.
    pub subindex: u8,
    /// Name in words.
    pub name: &'static str,
    /// Type of its value.
    pub data_type: DataType,
    /// How the MainDevice may access it.
    pub access: Access,
    /// Length in bytes of its longest value; every value has this length, unless it is a string.
    pub capacity: usize,
    /// Its value at power-on; shorter ones are filled up with zeros.
    pub default: &'static [u8],
}

/// Shape of an object (ETG.1000.6, object code).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum ObjectCode {
    /// One value, at subindex 0.
    Variable = 7,
    /// Values of one type.
    Array = 8,
    /// Values of any types.
    Record = 9,
}

/// How the MainDevice may access an entry by SDO.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Access {
    /// The MainDevice reads it.
    ReadOnly,
    /// The MainDevice reads and writes it.
    ReadWrite,
    /// The MainDevice reads it, and writes it only in PRE-OP.
    WriteInPreOp,
    /// The MainDevice writes it and cannot read it back.
    WriteOnly,
    /// The MainDevice reads it, and writes one of these numbers.
    WriteOneOf(&'static [i64]),
}

/// Type of a value (ETG.1000.6, table of basic data types).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum DataType {
    /// True or false.
    Boolean = 0x01,
    /// A signed number of 8 bits.
    Integer8 = 0x02,
    /// A signed number of 16 bits.
    Integer16 = 0x03,
    /// A signed number of 32 bits.
    Integer32 = 0x04,
    /// A number of 8 bits.
    Unsigned8 = 0x05,
    /// A number of 16 bits.
    Unsigned16 = 0x06,
    /// A number of 32 bits.
    Unsigned32 = 0x07,
    /// A floating-point number of 32 bits.
    Real32 = 0x08,
    /// ASCII characters.
    VisibleString = 0x09,
    /// Bytes.
    OctetString = 0x0A,
    /// A floating-point number of 64 bits.
    Real64 = 0x11,
    /// A signed number of 64 bits.
    Integer64 = 0x15,
    /// A number of 64 bits.
    Unsigned64 = 0x1B,
    /// The type of the identity object.
    Identity = 0x23,
    /// The type of a mapping object.
    PdoMapping = 0x21,
    /// One bit.
    Bit1 = 0x30,
    /// Two bits.
    Bit2 = 0x31,
    /// Three bits.
    Bit3 = 0x32,
    /// Four bits.
    Bit4 = 0x33,
    /// Five bits.
    Bit5 = 0x34,
    /// Six bits.
    Bit6 = 0x35,
    /// Seven bits.
    Bit7 = 0x36,
    /// Eight bits.
    Bit8 = 0x37,
}

impl DataType {
    /// Returns whether values may be shorter than their capacity.
    #[must_use]
    pub const fn is_string(self) -> bool {
        matches!(self, Self::VisibleString | Self::OctetString)
    }
}

/// Returns the length in bytes of process data objects, one after another without gaps.
#[must_use]
pub fn process_data_len(pdos: &[Pdo]) -> u16 {
    let entries = pdos.iter().flat_map(|pdo| pdo.entries);
    let bits: u32 = entries.map(|entry| u32::from(entry.bits)).sum();
    u16::try_from(bits.div_ceil(8)).unwrap_or(u16::MAX)
}
