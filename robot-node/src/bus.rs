//! From a setup to the robot's end of its bus.

use core::net::Ipv4Addr;

use emulated_device::DeviceDescription;
use ethercat_subdevice::DeviceConfig as SubDeviceConfig;
use ethernet_ip::description::Description;
use ethernet_ip::{Adapter, AdapterConfig};
use machine::ethernet::Mac;
use machine::{Allowed, Instant};
use node::station_file::{Address, Station};
use profinet::dcp::IpSuite;
use profinet::{Device, DeviceConfig, Permanent};
use protocol::buses::{Endpoint, EthercatSubDevice};
use protocol::fieldbus::Maintenance;
use protocol::stations::{ETHERCAT_ROBOT, ETHERNET_IP_ROBOT, PROFINET_ROBOT};
use setup::{Addresses, Bus, BusKind};

/// The robot's endpoint on any bus.
pub type RobotBus = Endpoint<Device, Adapter, EthercatSubDevice>;

/// Returns the robot's endpoint on the bus of a setup, on an interface with this MAC address and, if it has one
/// already, this IP address.
///
/// `seed` makes its connection numbers different from those of earlier runs. `start` is called only by an endpoint with
/// cycles of its own; it returns the instant of the first one.
pub fn open(
    bus: &Bus,
    mac: Mac,
    address: Option<Ipv4Addr>,
    seed: u64,
    start: impl FnOnce() -> Instant,
) -> RobotBus {
    open_station(bus, Host { mac, address, gateway: None }, None, seed, start)
}

/// The interface of the host that a robot is on.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Host {
    /// Its MAC address.
    pub mac: Mac,
    /// Its IP address, if it has one already.
    pub address: Option<Ipv4Addr>,
    /// The gateway to other networks through it, if there is one.
    pub gateway: Option<Ipv4Addr>,
}

/// Returns the same endpoint of a robot whose owner keeps what the bus sets permanently: `stored` is what it has kept; `None`
/// if it cannot.
pub fn open_station(
    bus: &Bus,
    Host { mac, address, gateway }: Host,
    stored: Option<Station>,
    seed: u64,
    start: impl FnOnce() -> Instant,
) -> RobotBus {
    // A setup is refused with a device that has no description, so this is that of our robot without a file only.
    let described = bus.device.as_deref().and_then(|device| emulated_device::describe(device).ok());
    match &bus.kind {
        BusKind::Profinet(addresses, profinet) => {
            let description = match described {
                Some(DeviceDescription::Profinet(description)) => description,
                _ => PROFINET_ROBOT,
            };
            let config = DeviceConfig {
                mac,
                station_name: profinet.robot_station_name.clone().into_bytes(),
                permanent: stored.map(permanent),
                address,
                mask: addresses.mask,
                description,
                controllers: bus.allowed(),
            };
            Endpoint::Profinet(Device::new(config, start()))
        }
        BusKind::EthernetIp(addresses, _) => {
            let description = match described {
                Some(DeviceDescription::EthernetIp(description)) => description,
                _ => &ETHERNET_IP_ROBOT,
            };
            let adapter = ethernet_ip_adapter(description, addresses, bus.allowed(), (mac, gateway), seed);
            Endpoint::EthernetIp(adapter.with_conflict_detection(Instant::ZERO))
        }
        BusKind::Ethercat(_) => {
            let Mac([_, _, serial @ ..]) = mac;
            let serial_number = u32::from_be_bytes(serial);
            let config = match described {
                Some(DeviceDescription::Ethercat(config)) => config,
                _ => SubDeviceConfig::new(&ETHERCAT_ROBOT),
            };
            let config = SubDeviceConfig { serial_number, ..config };
            Endpoint::Ethercat(EthercatSubDevice::new(&config))
        }
    }
}

/// Returns what the robot is on this bus.
#[must_use]
pub const fn role(kind: &BusKind) -> &'static str {
    match kind {
        BusKind::Profinet(..) => "PROFINET IO-Device",
        BusKind::EthernetIp(..) => "EtherNet/IP adapter",
        BusKind::Ethercat(_) => "EtherCAT SubDevice",
    }
}

/// Returns the IP address that the robot has from its project; `None` where its controller gives it one by DCP, or where it
/// has none.
#[must_use]
pub const fn address_from_project(kind: &BusKind) -> Option<Ipv4Addr> {
    match kind {
        BusKind::Profinet(..) | BusKind::Ethercat(_) => None,
        BusKind::EthernetIp(addresses, _) => Some(addresses.robot),
    }
}

fn permanent(Station { name, address, maintenance }: Station) -> Permanent {
    let suite = |Address { ip, mask, gateway }| IpSuite { address: ip, mask, gateway };
    Permanent {
        name: name.map(String::into_bytes),
        address: address.map(suite),
        maintenance: maintenance.as_ref().map(Maintenance::from),
    }
}

fn ethernet_ip_adapter(
    description: &'static Description,
    addresses: &Addresses,
    originators: Allowed,
    (mac, gateway): (Mac, Option<Ipv4Addr>),
    seed: u64,
) -> Adapter {
    let Mac([_, _, serial @ ..]) = mac;
    Adapter::new(AdapterConfig {
        description,
        serial_number: u32::from_be_bytes(serial),
        address: addresses.robot,
        mask: addresses.mask,
        gateway: gateway.unwrap_or(Ipv4Addr::UNSPECIFIED),
        mac: mac.0,
        first_id: seed as u32,
        originators,
    })
}
