//! The device of the examples: it sends its eight bytes of outputs back as its inputs.

use ethernet_ip::cip::Revision;
use ethernet_ip::description::{Assembly, Description, Role};

/// The assembly that the adapter sends.
pub(crate) const INPUTS: u32 = 100;

/// The assembly that the scanner sends.
pub(crate) const OUTPUTS: u32 = 150;

/// A device with eight bytes each way.
pub(crate) static DEVICE: Description = Description {
    // A product needs a vendor number from ODVA; 0xFFFF belongs to nobody.
    vendor: 0xFFFF,
    vendor_name: "examples",
    device_type: 0x2B,
    product_code: 0xEC,
    revision: Revision { major: 1, minor: 1 },
    product_name: "echo",
    assemblies: &[
        Assembly { instance: INPUTS, role: Role::Produced, size: 8, name: "Inputs" },
        Assembly { instance: OUTPUTS, role: Role::Consumed, size: 8, name: "Outputs" },
        Assembly { instance: 152, role: Role::InputOnlyHeartbeat, size: 0, name: "Heartbeat" },
    ],
    min_rpi_us: 1_000,
    max_rpi_us: 1_000_000,
    exclusive_owners: 1,
    input_only: 4,
    listen_only: 0,
    explicit: 4,
    sessions: 8,
};
