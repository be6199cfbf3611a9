//! What the two nodes are on each bus: descriptions for the stacks, and for the files that a real PLC imports.

use ethercat_subdevice::description::{DataType, Mailbox, Pdo, PdoEntry};
use ethernet_ip::cip::Revision;
use ethernet_ip::description::{Assembly, Role};
pub use profinet::is_station_name;

use profinet::description::{INTERFACE_SUBSLOT, Identity, Module, PORT_SUBSLOT, Submodule};

use crate::image::IMAGE_LEN;

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
    distributed_clocks: false,
};

/// An entry of a process data object has 255 bits at most, so the image is cut into entries of 32 bits.
const ENTRIES: usize = IMAGE_LEN / 4;

static COMMAND_ENTRIES: [PdoEntry; ENTRIES] = entries(0x7000, "Command");
static FEEDBACK_ENTRIES: [PdoEntry; ENTRIES] = entries(0x6000, "Feedback");

#[expect(clippy::indexing_slicing, reason = "a constant is made without iterators")]
const fn entries(index: u16, name: &'static str) -> [PdoEntry; ENTRIES] {
    let mut entries =
        [PdoEntry { index, subindex: 0, bits: 32, data_type: DataType::Unsigned32, name }; ENTRIES];
    let mut number = 0;
    while number < ENTRIES {
        entries[number].subindex = number as u8 + 1;
        number += 1;
    }
    entries
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
        assert!(PROFINET_ROBOT.station_type.len() <= 25);
        assert!(PROFINET_ROBOT.order_id.len() <= 20 && PROFINET_ROBOT.serial_number.len() <= 16);
        assert_eq!(PROFINET_ROBOT.submodule(0, PORT_SUBSLOT).map(|submodule| submodule.ident), Some(0x8001));
    }
}
