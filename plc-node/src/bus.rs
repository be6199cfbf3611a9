//! From a setup to the PLC's end of its bus.

use protocol::ethernet_ip::connection::TimeoutMultiplier;
use protocol::ethernet_ip::description::SKILL_ROBOT;
use protocol::ethernet_ip::{Scanner, ScannerConfig};
use protocol::profinet::ethernet::Mac;
use protocol::profinet::rt::Transport;
use protocol::profinet::{self, Controller, ControllerConfig, Parameter, description};
use protocol::{Duration, Instant};
use setup::{Cyclic, Setup};

/// Why a setup gives no bus endpoint.
#[derive(Clone, PartialEq, Debug, thiserror::Error)]
pub enum BusError {
    /// The setup names PROFINET but does not describe it.
    #[error(
        "bus.kind is `profinet`, so the setup needs a table [bus.profinet] with cyclic and both station names"
    )]
    NoProfinet,
    /// What the setup says of PROFINET does not work.
    #[error("bus: {0}")]
    Profinet(#[from] profinet::ConfigError),
    /// No EtherNet/IP connection waits for that long.
    #[error(
        "bus.watchdog_cycles is {intervals}, but an EtherNet/IP connection waits for 512 packet intervals at most"
    )]
    Timeout {
        /// Packet intervals.
        intervals: u32,
    },
}

/// The IO-Controller of a setup, on an interface with this MAC address. It looks for the robot from `start` on.
///
/// `seed` makes its UUIDs its own among those of earlier runs.
pub fn profinet_controller(
    setup: &Setup,
    mac: Mac,
    seed: u64,
    start: Instant,
) -> Result<Controller, BusError> {
    let bus = &setup.bus;
    let profinet = bus.profinet.as_ref().ok_or(BusError::NoProfinet)?;
    let config = ControllerConfig {
        mac,
        station_name: profinet.plc_station_name.clone(),
        address: bus.plc_address,
        mask: bus.subnet_mask,
        device_station_name: profinet.robot_station_name.clone(),
        device_address: bus.robot_address,
        description: description::ROBOT,
        parameters: vec![Parameter::interface_adjust()],
        transport: match profinet.cyclic {
            Cyclic::Udp => Transport::Udp,
            Cyclic::Rt1 => Transport::Rt1,
        },
        cycle: Duration::from_micros(bus.cycle_us.value.into()),
        // More than fits is more than PROFINET allows, and the controller says so.
        watchdog_cycles: u16::try_from(bus.watchdog_cycles.value).unwrap_or(u16::MAX),
        seed,
    };
    Ok(Controller::new(config, start)?)
}

/// The scanner of a setup, on an interface with this MAC address. It connects to the robot from `start` on.
///
/// `seed` makes its connection numbers its own among those of earlier runs.
pub fn ethernet_ip_scanner(
    setup: &Setup,
    Mac([_, _, serial @ ..]): Mac,
    seed: u64,
    start: Instant,
) -> Result<Scanner, BusError> {
    let bus = &setup.bus;
    let intervals = bus.timeout_intervals();
    let config = ScannerConfig {
        multiplier: TimeoutMultiplier::covering(intervals).ok_or(BusError::Timeout { intervals })?,
        serial_number: u32::from_be_bytes(serial),
        first_id: seed as u32,
        ..ScannerConfig::exclusive_owner(bus.robot_address, &SKILL_ROBOT, bus.cycle_us.value)
    };
    Ok(Scanner::new(config, start))
}
