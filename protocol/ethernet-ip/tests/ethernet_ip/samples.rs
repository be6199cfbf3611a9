//! The devices of the tests.

use ethernet_ip::cip::Revision;
use ethernet_ip::description::{Assembly, Description, Role};

/// Bytes of data each way.
pub(crate) const LEN: usize = 256;

/// The assembly that the device sends.
pub(crate) const PRODUCED: u32 = 100;

/// The assembly that its owner sends.
pub(crate) const CONSUMED: u32 = 150;

/// A device with data both ways and every kind of connection.
pub(crate) const DEVICE: Description = Description {
    vendor: 0xFFFF,
    vendor_name: "sample vendor",
    device_type: 0x2B,
    product_code: 1,
    revision: Revision { major: 1, minor: 1 },
    product_name: "sample device 01",
    assemblies: &[
        Assembly { instance: PRODUCED, role: Role::Produced, size: LEN as u16, name: "Inputs" },
        Assembly { instance: CONSUMED, role: Role::Consumed, size: LEN as u16, name: "Outputs" },
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
