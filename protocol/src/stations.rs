//! What the two nodes are on each bus: descriptions for the stacks, and for the files that a real PLC imports.

use ethercat_subdevice::description::{DataType, Mailbox, Pdo, PdoEntry};
use ethernet_ip::cip::Revision;
use ethernet_ip::description::{Assembly, Role};
pub use profinet::is_station_name;

use profinet::description::{INTERFACE_SUBSLOT, Identity, Module, PORT_SUBSLOT, Submodule};

use crate::image::{COMMAND_FIELDS, FEEDBACK_FIELDS, FieldType, IMAGE_LEN, ImageField, MOTION_FIELDS, SLOTS};

/// The robot node on PROFINET: a device access point in slot 0 and the process image in slot 1.
pub const PROFINET_ROBOT: profinet::description::Description = profinet::description::Description {
    // A test bench has no vendor, and 0xFFFF belongs to none.
    identity: Identity { vendor: 0xFFFF, device: 0x0001 },
    station_type: "skillbench robot",
    order_id: "skillbench-robot",
    serial_number: "1",
    hardware_revision: 1,
    software_revision: [0, 1, 0],
    // 250 µs, the shortest cycle that a process on Linux keeps.
    min_device_interval: 8,
    modules: &[
        Module {
            slot: 0,
            ident: 0x0000_0001,
            submodules: &[
                without_data(1, 0x0000_0001),
                without_data(INTERFACE_SUBSLOT, 0x0000_8000),
                without_data(PORT_SUBSLOT, 0x0000_8001),
            ],
        },
        Module {
            slot: 1,
            ident: 0x0000_0100,
            submodules: &[Submodule {
                input_len: IMAGE_LEN as u16,
                output_len: IMAGE_LEN as u16,
                ..without_data(1, 0x0000_0101)
            }],
        },
    ],
};

const fn without_data(subslot: u16, ident: u32) -> Submodule {
    Submodule { subslot, ident, input_len: 0, output_len: 0, parameters: &[] }
}

/// The PLC node on PROFINET, as DCP and the device see it. It has no modules.
pub const PROFINET_PLC: profinet::description::Description = profinet::description::Description {
    identity: Identity { vendor: 0xFFFF, device: 0x0002 },
    station_type: "skillbench PLC",
    order_id: "skillbench-plc",
    serial_number: "1",
    hardware_revision: 1,
    software_revision: [0, 1, 0],
    min_device_interval: 32,
    modules: &[],
};

/// Instance of the robot node's assembly with the feedback image.
pub const FEEDBACK: u32 = 100;

/// Instance of the robot node's assembly with the command image.
pub const COMMAND: u32 = 150;

/// ODVA vendor number of both nodes: the last one, which ODVA has not assigned. A product needs one of its own.
pub const ETHERNET_IP_VENDOR: u16 = 0xFFFF;

/// The robot node on EtherNet/IP.
pub const ETHERNET_IP_ROBOT: ethernet_ip::description::Description = ethernet_ip::description::Description {
    vendor: ETHERNET_IP_VENDOR,
    vendor_name: "skillbench",
    device_type: 0x2B,
    product_code: 1,
    revision: Revision { major: 1, minor: 1 },
    product_name: "skillbench robot",
    assemblies: &[
        Assembly { instance: FEEDBACK, role: Role::Produced, size: IMAGE_LEN as u16, name: "Feedback" },
        Assembly { instance: COMMAND, role: Role::Consumed, size: IMAGE_LEN as u16, name: "Command" },
        Assembly { instance: 151, role: Role::Configuration, size: 0, name: "Configuration" },
        Assembly { instance: 152, role: Role::InputOnlyHeartbeat, size: 0, name: "Input-only heartbeat" },
        Assembly { instance: 153, role: Role::ListenOnlyHeartbeat, size: 0, name: "Listen-only heartbeat" },
    ],
    min_rpi_us: 500,
    max_rpi_us: 10_000_000,
    exclusive_owners: 1,
    input_only: 4,
    listen_only: 4,
    explicit: 8,
    sessions: 16,
};

/// The robot node on EtherCAT: one process data object each way, which is the image.
pub static ETHERCAT_ROBOT: ethercat_subdevice::Description = ethercat_subdevice::Description {
    // A test bench has no vendor, and the last number belongs to none.
    vendor_id: 0xFFFF_FFFF,
    product_code: 1,
    revision: 0x0001_0000,
    order_code: "skillbench-robot",
    name: "skillbench robot",
    group: "skillbench",
    device_type: 0,
    hardware_version: "1",
    software_version: "0.1.0",
    outputs: &[Pdo { index: 0x1600, name: "Command", entries: &COMMAND_ENTRIES }],
    inputs: &[Pdo { index: 0x1A00, name: "Feedback", entries: &FEEDBACK_ENTRIES }],
    mailbox: Some(Mailbox { len: 128, file_capacity: 0 }),
    objects: &[],
    optional_outputs: &[],
    optional_inputs: &[],
    clock_modes: &[],
    numbers_names: true,
};

static COMMAND_ENTRIES: [PdoEntry; entry_count(COMMAND_FIELDS)] = entries(0x7000, COMMAND_FIELDS);
static FEEDBACK_ENTRIES: [PdoEntry; entry_count(FEEDBACK_FIELDS)] = entries(0x6000, FEEDBACK_FIELDS);

/// Most bits of a gap: an entry of a process data object has at most 255.
const GAP_BITS: usize = 128;

/// Names of a slot's fields.
macro_rules! slot_names {
    ($slot:literal) => {
        [
            concat!($slot, " target"),
            concat!($slot, " auxiliary"),
            concat!($slot, " velocity"),
            concat!($slot, " acceleration"),
            concat!($slot, " approximation"),
            concat!($slot, " kind"),
            concat!($slot, " tool and base"),
        ]
    };
}

const SLOT_NAMES: [[&str; MOTION_FIELDS.len()]; SLOTS] = [
    slot_names!("slot 0"),
    slot_names!("slot 1"),
    slot_names!("slot 2"),
    slot_names!("slot 3"),
    slot_names!("slot 4"),
];

/// Returns how many entries a field becomes: a number one, a list of numbers one each, a slot those of its motion.
const fn entries_of(form: FieldType) -> usize {
    match form {
        FieldType::Real(count) => count,
        FieldType::Motion => entry_count(MOTION_FIELDS),
        FieldType::Reserved(len) => (8 * len).div_ceil(GAP_BITS),
        _ => 1,
    }
}

#[expect(clippy::indexing_slicing, reason = "a constant is made without iterators")]
const fn entry_count(fields: &[ImageField]) -> usize {
    let (mut count, mut number) = (0, 0);
    while number < fields.len() {
        count += entries_of(fields[number].form);
        number += 1;
    }
    count
}

/// Returns the entries that name the fields of an image.
#[expect(clippy::indexing_slicing, reason = "a constant is made without iterators")]
const fn entries<const N: usize>(index: u16, fields: &[ImageField]) -> [PdoEntry; N] {
    let gap = PdoEntry { index: 0, subindex: 0, bits: 0, data_type: DataType::Unsigned8, name: "" };
    let (mut entries, mut count, mut number, mut slot) = ([gap; N], 0, 0, 0);
    while number < fields.len() {
        if matches!(fields[number].form, FieldType::Motion) {
            let mut part = 0;
            while part < MOTION_FIELDS.len() {
                count = add(&mut entries, count, index, MOTION_FIELDS[part].form, SLOT_NAMES[slot][part]);
                part += 1;
            }
            slot += 1;
        } else {
            count = add(&mut entries, count, index, fields[number].form, fields[number].name);
        }
        number += 1;
    }
    entries
}

/// Adds the entries of a field, numbered on from those before. Returns how many there are now.
#[expect(clippy::indexing_slicing, reason = "a constant is made without iterators")]
const fn add(
    entries: &mut [PdoEntry],
    mut count: usize,
    index: u16,
    form: FieldType,
    name: &'static str,
) -> usize {
    let until = count + entries_of(form);
    let mut left = 8 * form.len();
    while count < until {
        let (bits, data_type) = match form {
            FieldType::Real(_) => (32, DataType::Real32),
            FieldType::Reserved(_) if left < GAP_BITS => (left, DataType::Unsigned8),
            FieldType::Reserved(_) => (GAP_BITS, DataType::Unsigned8),
            _ => match form.len() {
                1 => (8, DataType::Unsigned8),
                2 => (16, DataType::Unsigned16),
                4 => (32, DataType::Unsigned32),
                _ => (64, DataType::Unsigned64),
            },
        };
        left -= bits;
        let bits = bits as u8;
        entries[count] = match form {
            FieldType::Reserved(_) => PdoEntry { index: 0, subindex: 0, bits, data_type, name: "" },
            _ => PdoEntry { index, subindex: count as u8 + 1, bits, data_type, name },
        };
        count += 1;
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_robot_carries_one_image_each_way_and_its_texts_fit_their_fields() {
        let (inputs, outputs) =
            PROFINET_ROBOT.submodules().fold((0, 0), |(inputs, outputs), (_, submodule)| {
                (inputs + usize::from(submodule.input_len), outputs + usize::from(submodule.output_len))
            });
        assert_eq!((inputs, outputs), (IMAGE_LEN, IMAGE_LEN));
        for pdo in [&ETHERCAT_ROBOT.outputs[0], &ETHERCAT_ROBOT.inputs[0]] {
            let bits: usize = pdo.entries.iter().map(|entry| usize::from(entry.bits)).sum();
            assert_eq!(bits, IMAGE_LEN * 8);
        }
        let command = ETHERCAT_ROBOT.outputs[0].entries;
        let names: Vec<_> = MOTION_FIELDS.iter().map(|field| format!("slot 3 {}", field.name)).collect();
        assert!(names.iter().all(|name| command.iter().any(|entry| entry.name == name)), "{names:?}");
        assert!(PROFINET_ROBOT.station_type.len() <= 25);
        assert!(PROFINET_ROBOT.order_id.len() <= 20 && PROFINET_ROBOT.serial_number.len() <= 16);
        assert_eq!(PROFINET_ROBOT.submodule(0, PORT_SUBSLOT).map(|submodule| submodule.ident), Some(0x8001));
    }
}
