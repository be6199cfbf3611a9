//! From a setup to the robot's end of its bus.

use core::net::Ipv4Addr;

use ethernet_ip::{Adapter, AdapterConfig};
use machine::Instant;
use machine::ethernet::Mac;
use profinet::{Device, DeviceConfig};
use protocol::stations::{ETHERNET_IP_ROBOT, PROFINET_ROBOT};
use setup::Setup;

/// Why a setup gives no bus endpoint.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum BusError {
    /// The setup names PROFINET but does not describe it.
    #[error(
        "bus.kind is `profinet`, so the setup needs a table [bus.profinet] with cyclic and both station names"
    )]
    NoProfinet,
}

/// The IO-Device of a setup, on an interface with this MAC address and, if it has one already, this IP address.
pub fn profinet_device(
    setup: &Setup,
    mac: Mac,
    address: Option<Ipv4Addr>,
    start: Instant,
) -> Result<Device, BusError> {
    let profinet = setup.bus.profinet.as_ref().ok_or(BusError::NoProfinet)?;
    let config = DeviceConfig {
        mac,
        station_name: profinet.robot_station_name.clone().into_bytes(),
        address,
        mask: setup.bus.subnet_mask,
        description: PROFINET_ROBOT,
    };
    Ok(Device::new(config, start))
}

/// The adapter of a setup, on an interface with this MAC address and the setup's IP address.
///
/// `seed` makes its connection numbers its own among those of earlier runs.
#[must_use]
pub fn ethernet_ip_adapter(setup: &Setup, mac: Mac, seed: u64) -> Adapter {
    let Mac([_, _, serial @ ..]) = mac;
    Adapter::new(AdapterConfig {
        description: &ETHERNET_IP_ROBOT,
        serial_number: u32::from_be_bytes(serial),
        address: setup.bus.robot_address,
        mask: setup.bus.subnet_mask,
        gateway: Ipv4Addr::UNSPECIFIED,
        mac: mac.0,
        first_id: seed as u32,
    })
}
