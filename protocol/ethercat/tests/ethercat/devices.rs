//! The devices of the tests.

use ethercat_subdevice::Description;
use ethercat_subdevice::description::{
    Access, CLOCK_MODES, DataType, Entry, Mailbox, Object, ObjectCode, Pdo, PdoEntry,
};

const fn byte(index: u16, subindex: u8) -> PdoEntry {
    PdoEntry { index, subindex, bits: 8, data_type: DataType::Unsigned8, name: "Byte" }
}

/// Four bytes of outputs and two of inputs, without mailbox.
pub static SIMPLE: Description = Description {
    vendor_id: 0x0000_0F00,
    product_code: 0x0000_0001,
    revision: 2,
    order_code: "SIMPLE",
    name: "Four bytes out, two bytes in",
    group: "Test devices",
    device_type: 0,
    hardware_version: "1",
    software_version: "1",
    outputs: &[Pdo {
        index: 0x1600,
        name: "Outputs",
        entries: &[byte(0x7000, 1), byte(0x7000, 2), byte(0x7000, 3), byte(0x7000, 4)],
    }],
    inputs: &[Pdo { index: 0x1A00, name: "Inputs", entries: &[byte(0x6000, 1), byte(0x6000, 2)] }],
    mailbox: None,
    objects: &[],
    optional_outputs: &[],
    optional_inputs: &[],
    clock_modes: &[],
    numbers_names: true,
};

const fn dwords<const N: usize>(index: u16, name: &'static str) -> [PdoEntry; N] {
    let mut entries = [PdoEntry { index, subindex: 0, bits: 32, data_type: DataType::Unsigned32, name }; N];
    let mut number = 0;
    while number < N {
        entries[number].subindex = number as u8 + 1;
        number += 1;
    }
    entries
}

static OUT: [PdoEntry; 64] = dwords(0x7000, "Output");
static IN: [PdoEntry; 64] = dwords(0x6000, "Input");

/// A text that does not fit a mailbox of 128 bytes.
pub const LONG_TEXT: [u8; 300] = {
    let mut text = [0; 300];
    let mut at = 0;
    while at < text.len() {
        text[at] = b'a' + (at % 26) as u8;
        at += 1;
    }
    text
};

/// 256 bytes each way, as the bridge of a robot, with a mailbox, a file and a clock.
pub static BRIDGE: Description = Description {
    vendor_id: 0x0000_0F00,
    product_code: 0x0000_0002,
    revision: 0x0001_0000,
    order_code: "BRIDGE",
    name: "256 bytes out, 256 bytes in",
    group: "Test devices",
    device_type: 0x0000_1389,
    hardware_version: "1.0",
    software_version: "2.0",
    outputs: &[Pdo { index: 0x1600, name: "Outputs", entries: &OUT }],
    inputs: &[Pdo { index: 0x1A00, name: "Inputs", entries: &IN }],
    mailbox: Some(Mailbox { len: 128, file_capacity: 1000 }),
    objects: &[
        Object {
            index: 0x8000,
            name: "Settings",
            code: ObjectCode::Record,
            entries: &[
                entry(0, "Highest subindex", DataType::Unsigned8, Access::ReadOnly, 1, &[4]),
                entry(1, "Gain", DataType::Unsigned16, Access::ReadWrite, 2, &[7, 0]),
                entry(2, "Mode", DataType::Unsigned8, Access::WriteInPreOp, 1, &[1]),
                entry(3, "Key", DataType::Unsigned32, Access::WriteOnly, 4, &[]),
                entry(4, "Offset", DataType::Integer64, Access::ReadWrite, 8, &[]),
            ],
        },
        Object {
            index: 0x8001,
            name: "Text",
            code: ObjectCode::Variable,
            entries: &[entry(0, "Text", DataType::VisibleString, Access::ReadWrite, 400, &LONG_TEXT)],
        },
    ],
    optional_outputs: &[],
    optional_inputs: &[],
    clock_modes: &CLOCK_MODES,
    numbers_names: true,
};

const fn entry(
    subindex: u8,
    name: &'static str,
    data_type: DataType,
    access: Access,
    capacity: usize,
    default: &'static [u8],
) -> Entry {
    Entry { subindex, name, data_type, access, capacity, default }
}

/// Four bytes each way, without mailbox.
pub static PLAIN: Description = Description {
    product_code: 3,
    order_code: "PLAIN",
    name: "Four bytes out, four bytes in",
    inputs: &[Pdo {
        index: 0x1A00,
        name: "Inputs",
        entries: &[byte(0x6000, 1), byte(0x6000, 2), byte(0x6000, 3), byte(0x6000, 4)],
    }],
    ..SIMPLE
};

/// The same with a mailbox and a clock.
pub static SMART: Description = Description {
    product_code: 4,
    order_code: "SMART",
    name: "Four bytes out, four bytes in, with a mailbox",
    mailbox: Some(Mailbox { len: 128, file_capacity: 0 }),
    clock_modes: &CLOCK_MODES,
    numbers_names: true,
    ..PLAIN
};

/// The smallest mailbox: lists of objects come in fragments.
pub static TINY: Description = Description {
    product_code: 5,
    order_code: "TINY",
    mailbox: Some(Mailbox { len: 32, file_capacity: 0 }),
    clock_modes: &[],
    numbers_names: true,
    ..SMART
};

/// Inputs alone.
pub static SENSOR: Description = Description { product_code: 7, order_code: "SENSOR", outputs: &[], ..TINY };

/// Outputs alone.
pub static ACTUATOR: Description =
    Description { product_code: 6, order_code: "ACTUATOR", inputs: &[], ..TINY };

const fn bit(subindex: u8) -> PdoEntry {
    PdoEntry { index: 0x6000, subindex, bits: 1, data_type: DataType::Boolean, name: "Input" }
}

/// Four bits of inputs without mailbox, as a terminal for digital inputs.
pub static TERMINAL: Description = Description {
    product_code: 8,
    order_code: "TERMINAL",
    name: "Four bits in",
    outputs: &[],
    inputs: &[Pdo { index: 0x1A00, name: "Inputs", entries: &[bit(1), bit(2), bit(3), bit(4)] }],
    ..SIMPLE
};

/// No process data and no mailbox, as a coupler.
pub static COUPLER: Description =
    Description { product_code: 9, order_code: "COUPLER", name: "Nothing", inputs: &[], ..TERMINAL };
