//! From a setup to the PLC's end of its bus.

mod ethercat;

use device_files::ChosenDevice;
use ethernet_ip::cip::{ElectronicKey, Revision};
use ethernet_ip::connection::{RealTimeFormat, TimeoutMultiplier};
use ethernet_ip::{ConnectionConfig, ScannerConfig};
use machine::ethernet::Mac;
use machine::{Duration, Instant};
use profinet::description::{Description, INTERFACE_SUBSLOT, Identity, Module, Submodule};
use profinet::rt::Transport;
use profinet::{ArConfig, ControllerConfig, Parameter};
use protocol::buses::{Endpoint, EthernetIpScanner, ProfinetController};
use protocol::stations::{ETHERNET_IP_ROBOT, ETHERNET_IP_VENDOR, PROFINET_PLC, PROFINET_ROBOT};
use setup::{
    Addresses, Bus, BusKind, Cyclic, EthernetIp, EthernetIpAdapter, EthernetIpFormat, EthernetIpKey,
    Profinet, ProfinetDevice,
};

pub use ethercat::EthercatMainDevice;

/// The PLC's endpoint on any bus.
pub type PlcBus = Endpoint<ProfinetController, EthernetIpScanner, EthercatMainDevice>;

/// Why a setup gives no bus endpoint.
#[derive(Clone, PartialEq, Debug, thiserror::Error)]
pub enum BusError {
    /// What the setup says of PROFINET does not work.
    #[error("bus: {0}")]
    Profinet(profinet::ConfigError),
    /// There are more stations on a bus than it has.
    #[error("bus: {0}")]
    TooMany(String),
    /// A device cannot be started as its file says.
    #[error("bus.device: {0}")]
    Device(String),
    /// An EtherNet/IP connection cannot have such a long timeout.
    #[error(
        "bus.watchdog_cycles is {intervals}, but an EtherNet/IP connection waits for 512 packet intervals at most"
    )]
    Timeout {
        /// Packet intervals.
        intervals: u32,
    },
}

// Not `#[from]`, which would also make it the source: then it would be printed twice.
impl From<profinet::ConfigError> for BusError {
    fn from(reason: profinet::ConfigError) -> Self {
        Self::Profinet(reason)
    }
}

/// What an endpoint has besides its setup.
#[derive(Clone, Copy, Debug)]
struct Station {
    mac: Mac,
    seed: u64,
    start: Instant,
}

/// Returns the PLC's endpoint on the bus of a setup, on an interface with this MAC address. It looks for the robot
/// from `start` on.
///
/// `seed` makes its UUIDs and connection numbers different from those of earlier runs.
///
/// # Errors
///
/// The bus does not allow what the setup says.
pub fn open(bus: &Bus, mac: Mac, seed: u64, start: Instant) -> Result<PlcBus, BusError> {
    open_all(bus, &[], mac, seed, start)
}

/// Returns the PLC's endpoint on a bus with several stations, as each of them describes the bus: the first one and the `others`.
/// All are of one kind, and agree on what the PLC is there; [`setup`] checks that.
///
/// # Errors
///
/// The bus does not allow what a setup says, or that many stations.
pub fn open_all(
    first: &Bus,
    others: &[&Bus],
    mac: Mac,
    seed: u64,
    start: Instant,
) -> Result<PlcBus, BusError> {
    let plc = Station { mac, seed, start };
    let all = || std::iter::once(first).chain(others.iter().copied());
    Ok(match &first.kind {
        BusKind::Profinet(addresses, profinet) => {
            let devices = all().filter_map(|bus| match &bus.kind {
                BusKind::Profinet(addresses, profinet) => Some(io_device(bus, addresses, profinet)),
                BusKind::EthernetIp(..) | BusKind::Ethercat(_) => None,
            });
            let config = io_controller(addresses, profinet, plc);
            Endpoint::Profinet(ProfinetController::new(config, devices.collect(), start)?)
        }
        BusKind::EthernetIp(addresses, _) => {
            let connections = all().filter_map(|bus| match &bus.kind {
                BusKind::EthernetIp(addresses, ethernet_ip) => Some(connection(bus, addresses, ethernet_ip)),
                BusKind::Profinet(..) | BusKind::Ethercat(_) => None,
            });
            let connections = connections.collect::<Result<Vec<_>, _>>()?;
            Endpoint::EthernetIp(ethernet_ip_scanner(addresses, connections, plc)?)
        }
        BusKind::Ethercat(_) => {
            let devices = all().filter_map(|bus| match &bus.kind {
                BusKind::Ethercat(ethercat) => Some((ethercat::expected(ethercat), bus.device.as_deref())),
                BusKind::Profinet(..) | BusKind::EthernetIp(..) => None,
            });
            Endpoint::Ethercat(EthercatMainDevice::new(first, devices.collect(), mac, start)?)
        }
    })
}

/// Returns what the PLC is on this bus.
#[must_use]
pub const fn role(kind: &BusKind) -> &'static str {
    match kind {
        BusKind::Profinet(..) => "PROFINET IO-Controller",
        BusKind::EthernetIp(..) => "EtherNet/IP scanner",
        BusKind::Ethercat(_) => "EtherCAT MainDevice",
    }
}

fn io_controller(
    addresses: &Addresses,
    profinet: &Profinet,
    Station { mac, seed, .. }: Station,
) -> ControllerConfig {
    ControllerConfig {
        mac,
        station_name: profinet.plc_station_name.clone(),
        address: addresses.plc,
        mask: addresses.mask,
        description: PROFINET_PLC,
        seed,
    }
}

fn io_device(bus: &Bus, addresses: &Addresses, profinet: &Profinet) -> ArConfig {
    let description = expected_device(profinet);
    // Devices may refuse a record for a subslot that they do not have.
    let has_interface = description.submodule(0, INTERFACE_SUBSLOT).is_some();
    let parameters = match bus.device.as_deref() {
        Some(ChosenDevice::Gsdml(device)) => driven_device::startup_records(device),
        _ => has_interface.then(Parameter::interface_adjust).into_iter().collect(),
    };
    ArConfig {
        station_name: profinet.robot_station_name.clone(),
        mac: bus.robot.and_then(|robot| robot.mac),
        address: addresses.robot,
        description,
        parameters,
        transport: match profinet.cyclic {
            Cyclic::Udp => Transport::Udp,
            Cyclic::Rt1 => Transport::Rt1,
        },
        cycle: Duration::from_micros(bus.cycle_us.value.into()),
        // More than fits is more than PROFINET allows, and the controller says so.
        watchdog_cycles: u16::try_from(bus.watchdog_cycles.value).unwrap_or(u16::MAX),
    }
}

/// Returns the device that a setup expects at its robot's station name.
#[must_use]
pub fn expected_device(profinet: &Profinet) -> Description {
    profinet.device.as_ref().map_or(PROFINET_ROBOT, described)
}

/// Returns the description of a setup's device, for a controller that expects it.
///
/// A description exists as long as the program, since the usual one is compiled in. A description from a setup is read once
/// at the start, so leaking its few hundred bytes costs less than counting references to them.
fn described(device: &ProfinetDevice) -> Description {
    let modules: Vec<Module> = device
        .modules
        .iter()
        .map(|module| {
            let submodules: Vec<Submodule> = module
                .submodules
                .iter()
                .map(|submodule| Submodule {
                    subslot: submodule.subslot,
                    ident: submodule.ident,
                    input_len: submodule.input_bytes,
                    output_len: submodule.output_bytes,
                    parameters: &[],
                })
                .collect();
            Module { slot: module.slot, ident: module.ident, submodules: submodules.leak() }
        })
        .collect();
    let identity = Identity { vendor: device.vendor, device: device.device };
    // A setup does not tell the device's shortest cycle: it refuses a shorter one itself.
    Description { identity, modules: modules.leak(), min_device_interval: 1, ..PROFINET_ROBOT }
}

fn ethernet_ip_scanner(
    addresses: &Addresses,
    connections: Vec<ConnectionConfig>,
    Station { mac, seed, start }: Station,
) -> Result<EthernetIpScanner, BusError> {
    let Mac([_, _, serial @ ..]) = mac;
    let config = ScannerConfig {
        vendor: ETHERNET_IP_VENDOR,
        serial_number: u32::from_be_bytes(serial),
        first_id: seed as u32,
    };
    let own = (mac, addresses.plc, addresses.mask);
    EthernetIpScanner::with_conflict_detection(config, own, connections, start)
        .map_err(|error| BusError::TooMany(error.to_string()))
}

fn connection(
    bus: &Bus,
    addresses: &Addresses,
    ethernet_ip: &EthernetIp,
) -> Result<ConnectionConfig, BusError> {
    let intervals = ethernet_ip.timeout_intervals(&bus.watchdog_cycles);
    let connection = ConnectionConfig {
        multiplier: TimeoutMultiplier::at_least(intervals).ok_or(BusError::Timeout { intervals })?,
        multicast: ethernet_ip.multicast,
        serial_number: bus.robot.and_then(|robot| robot.serial_number),
        ..ConnectionConfig::exclusive_owner(addresses.robot, &ETHERNET_IP_ROBOT, bus.cycle_us.value)
    };
    Ok(match &ethernet_ip.adapter {
        Some(adapter) => of_adapter(adapter, connection),
        None => connection,
    })
}

/// Returns the configuration for an adapter of the setup that takes the place of our robot.
fn of_adapter(adapter: &EthernetIpAdapter, config: ConnectionConfig) -> ConnectionConfig {
    ConnectionConfig {
        route: adapter.route.clone(),
        key: adapter.key.map(electronic_key),
        configuration: adapter.configuration_assembly,
        configuration_data: adapter.configuration_data.clone(),
        consumed: adapter.consumed_assembly,
        produced: adapter.produced_assembly,
        o_t_size: adapter.consumed_bytes,
        t_o_size: adapter.produced_bytes,
        consumed_format: format_of(adapter.consumed_format),
        produced_format: format_of(adapter.produced_format),
        ..config
    }
}

/// Returns the key that the PLC sends to the robot's adapter; `None` if it sends none and takes any device.
#[must_use]
pub fn expected_key(ethernet_ip: &EthernetIp) -> Option<ElectronicKey> {
    match &ethernet_ip.adapter {
        Some(adapter) => adapter.key.map(electronic_key),
        None => Some(ETHERNET_IP_ROBOT.key()),
    }
}

const fn electronic_key(key: EthernetIpKey) -> ElectronicKey {
    ElectronicKey {
        vendor: key.vendor,
        device_type: key.device_type,
        product_code: key.product_code,
        revision: Revision { major: key.major_revision, minor: key.minor_revision },
        compatible: key.compatible,
    }
}

const fn format_of(format: EthernetIpFormat) -> RealTimeFormat {
    match format {
        EthernetIpFormat::Modeless => RealTimeFormat::Modeless,
        EthernetIpFormat::ZeroLength => RealTimeFormat::ZeroLength,
        EthernetIpFormat::Heartbeat => RealTimeFormat::Heartbeat,
        EthernetIpFormat::RunIdleHeader => RealTimeFormat::RunIdleHeader,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use setup::{ProfinetModule, ProfinetSubmodule};

    #[test]
    fn a_device_of_the_setup_takes_the_place_of_our_robot() {
        let submodule =
            |subslot, ident, input_bytes| ProfinetSubmodule { subslot, ident, input_bytes, output_bytes: 0 };
        let device = ProfinetDevice {
            vendor: 0x0493,
            device: 2,
            modules: vec![
                ProfinetModule { slot: 0, ident: 1, submodules: vec![submodule(1, 1, 0)] },
                ProfinetModule { slot: 4, ident: 0x40, submodules: vec![submodule(1, 0x140, 8)] },
            ],
        };
        let description = described(&device);
        assert_eq!(description.identity, Identity { vendor: 0x0493, device: 2 });
        let found: Vec<_> =
            description.submodules().map(|(slot, s)| (slot, s.subslot, s.ident, s.input_len)).collect();
        assert_eq!(found, [(0, 1, 1, 0), (4, 1, 0x140, 8)]);
    }

    #[test]
    fn an_adapter_of_the_setup_is_asked_for_its_formats_and_by_a_compatible_key() {
        let key = EthernetIpKey {
            vendor: 42,
            device_type: 0,
            product_code: 7,
            major_revision: 3,
            minor_revision: 1,
            compatible: true,
        };
        let adapter = EthernetIpAdapter {
            consumed_assembly: 112,
            consumed_bytes: 32,
            produced_assembly: 110,
            produced_bytes: 64,
            consumed_format: EthernetIpFormat::ZeroLength,
            produced_format: EthernetIpFormat::RunIdleHeader,
            configuration_assembly: None,
            configuration_data: vec![1, 2],
            route: Vec::new(),
            key: Some(key),
        };
        let config = ConnectionConfig::exclusive_owner([10, 0, 0, 2].into(), &ETHERNET_IP_ROBOT, 1_000);
        let config = of_adapter(&adapter, config);
        assert_eq!((config.o_t().size, config.t_o().size), (34, 70), "with sequence count and header");
        assert!(config.key.is_some_and(|key| key.compatible));
        assert_eq!(config.configuration_data, [1, 2]);
    }
}
