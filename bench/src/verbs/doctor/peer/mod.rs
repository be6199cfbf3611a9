//! `bench doctor --peer plc|robot`: what of a foreign end is seen on the wire, step by step, and what is missing.
//!
//! ```text
//! stations   who answers a search on the bus: name, address, identity, twins
//! look       a machine that is one end of the bus and exchanges images without a command
//!   robot    the foreign robot, seen from an idle PLC
//!   plc      the foreign PLC, seen from a robot without an arm
//!   images   what the images that arrive show
//! plugged    the modules and the version that a PROFINET robot reports without a connection
//! assemblies the sizes of the assemblies of an EtherNet/IP robot, read without a connection
//! version    the version of an EtherNet/IP robot and of its parts, read in the same way
//!   unreachable why the robot is not asked for either
//! ```
//!
//! Nothing moves: a robot is sent neither enable nor a command, and a PLC finds a robot that holds its first skill suspended.

mod assemblies;
mod images;
mod look;
mod plc;
mod plugged;
mod robot;
mod stations;
mod unreachable;
mod version;

use std::ops::ControlFlow;

use anyhow::Context as _;
use machine::{Cycle, Duration, Instant, LinkEvent, Machine};
use node::address_check::AddressCheckError;
use node::interface_option::InterfaceOption;
use node::run::take_address;
use plc_node::discover::find_devices;
use protocol::fieldbus::StationId;
use protocol_linux::{Driver, Interface, Notifier, OpenPort, Owner, Statistics, capabilities, clock};
use records::exit::{Exit, Failure};
use report::errln;
use setup::{Bus, BusKind, CellBus, Setup};

use super::addresses;
use super::finding::{self, Finding, Verdict};
use look::{Look, PeerWatch};
use plc::PlcWatch;
use robot::RobotWatch;

/// Length of a search: devices spread their answers over a quarter of it.
const SEARCH: Duration = Duration::from_secs(2);

/// Time of images after which nothing more can be found out: a counter is named that has not moved for 1 s, and a robot of
/// 4 ms has counted 500 times.
const COMPLETE_AFTER: Duration = Duration::from_secs(2);

/// Longest wait for the foreign end to confirm the end of the connection.
const DISCONNECT_LIMIT: Duration = Duration::from_millis(300);

/// Longest wait for the other end of a cable: auto-negotiation of 1000BASE-T takes up to 3 s.
const CARRIER: Duration = Duration::from_secs(3);

/// Time between two looks at the carrier.
const CARRIER_STEP: Duration = Duration::from_millis(50);

/// Which end of the bus is the foreign one.
#[derive(Clone, Copy, PartialEq, Eq, Debug, clap::ValueEnum)]
pub(super) enum PeerRole {
    /// A PLC: this host takes the robot's place.
    Plc,
    /// A robot: this host takes the PLC's place.
    Robot,
}

/// Options of the look at a foreign end.
#[derive(clap::Args, Debug)]
pub(super) struct PeerOptions {
    /// Look at a foreign PLC or robot on --interface, step by step, without moving anything.
    #[arg(id = "peer", long = "peer", value_name = "plc|robot", requires = "interface")]
    pub(super) role: Option<PeerRole>,
    /// With --peer: the station of the setup, where it has several.
    #[arg(long, value_name = "NAME", requires = "peer")]
    station: Option<String>,
    /// With --peer: longest wait for the connection and, of a PLC, for its first command, in s.
    #[arg(long, value_name = "S", default_value_t = 10, requires = "peer", value_parser = clap::value_parser!(u32).range(1..=3_600))]
    wait: u32,
}

/// The station to look at: its setup, how all stations of its bus describe the bus, and its number there.
struct PeerStation {
    setup: Setup,
    buses: Vec<Bus>,
    id: StationId,
}

/// Looks at the foreign end and prints what was found of each step.
///
/// # Errors
///
/// The setup cannot be used, or has no such station. What is missing on the wire is not an error: it is printed, and the exit code
/// reports it.
pub(super) fn run(
    options: &PeerOptions,
    role: PeerRole,
    setup: &str,
    interface: &InterfaceOption,
    as_json: bool,
) -> Result<Exit, Failure> {
    let place = find_place(setup, options.station.as_deref())?;
    let name = place.setup.bus.kind.name();
    let interface = interface.for_buses(&[name]).map_err(|error| Failure::new(Exit::Usage, error))?;
    let interface = interface.first().copied().unwrap_or_default();
    capabilities::raise().context("making use of the program's capabilities")?;
    let wait = Duration::from_secs(options.wait.into());
    if !as_json {
        errln!(
            "looking for a foreign {} on {name} at `{interface}`, at most {} s …",
            role.name(),
            options.wait
        );
    }
    let findings = look_at(role, &place, interface, wait)?;
    let is_all = findings.iter().all(|it| matches!(it.verdict, Verdict::Good | Verdict::Limited));
    let ending = if is_all {
        format!("Every step of the {} was seen.", role.name())
    } else {
        format!("Not every step of the {} was seen: begin with the first one that is missing.", role.name())
    };
    finding::print(&findings, as_json, &ending)?;
    Ok(if is_all { Exit::Pass } else { Exit::EnvironmentUnusable })
}

impl PeerRole {
    const fn name(self) -> &'static str {
        match self {
            Self::Plc => "PLC",
            Self::Robot => "robot",
        }
    }
}

fn find_place(setup: &str, station: Option<&str>) -> Result<PeerStation, Failure> {
    let (cell, _) = setup::cell(setup)?;
    let index = match station {
        None if cell.stations.len() == 1 => Some(0),
        None => None,
        Some(name) => cell.stations.iter().position(|station| station.name == name),
    };
    let names = cell.names().collect::<Vec<_>>().join(", ");
    let Some((index, station)) = index.and_then(|index| Some((index, cell.stations.get(index)?))) else {
        let error = match station {
            Some(name) => anyhow::anyhow!("--station {name}: the setup has no such station, only {names}"),
            None => anyhow::anyhow!("the setup has several stations: add --station with one of {names}"),
        };
        return Err(Failure::new(Exit::Usage, error));
    };
    let setup = cell.setup_of(station);
    // A MainDevice drives every SubDevice of its cable; a controller and a scanner need to know only the one.
    let is_cable = matches!(setup.bus.kind, BusKind::Ethercat(_));
    let cable = CellBus::of_cell(&cell).into_iter().find(|bus| is_cable && bus.stations.contains(&index));
    let (buses, id) = cable.map_or((vec![setup.bus.clone()], 0), |bus| {
        let id = bus.stations.iter().position(|other| *other == index).unwrap_or_default();
        (bus.descriptions(&cell).cloned().collect(), id)
    });
    Ok(PeerStation { setup, buses, id: StationId(u16::try_from(id).unwrap_or_default()) })
}

fn look_at(role: PeerRole, place: &PeerStation, name: &str, wait: Duration) -> anyhow::Result<Vec<Finding>> {
    let mut findings = Vec::new();
    let Some(interface) = link(name, &mut findings) else { return Ok(findings) };
    let bus = &place.setup.bus;
    let role_address = match (&bus.kind, role) {
        (BusKind::Profinet(addresses, _) | BusKind::EthernetIp(addresses, _), PeerRole::Robot) => {
            Some(("bus.plc_address", addresses.plc, addresses.mask))
        }
        (BusKind::EthernetIp(addresses, _), PeerRole::Plc) => {
            Some(("bus.robot_address", addresses.robot, addresses.mask))
        }
        // A PROFINET device gets its address from the PLC.
        (BusKind::Profinet(..), PeerRole::Plc) | (BusKind::Ethercat(_), _) => None,
    };
    if let Some((key, address, mask)) = role_address {
        let taken = take_address(&interface, key, address, mask);
        findings.push(own_address(address, taken));
        if findings.last().is_some_and(|finding| finding.verdict == Verdict::Missing) {
            return Ok(findings);
        }
    }
    let searched = find_devices(&interface, &bus.kind, SEARCH);
    match (role, &searched) {
        (PeerRole::Robot, Ok(found)) => findings.extend(stations::robot(found, bus, place.id.0.into())),
        (PeerRole::Plc, Ok(found)) => findings.extend(stations::plc(found, bus)),
        (_, Err(error)) => findings.push(Finding::not_seen(
            "search",
            format!("{error:#}"),
            "run it as root, or with the capability CAP_NET_RAW",
        )),
    }
    if role == PeerRole::Robot {
        let twins = addresses::check(interface.name(), &place.setup).into_iter();
        findings.extend(twins.filter(|finding| finding.verdict != Verdict::Good));
    }
    let start = clock::now();
    let deadline = start + wait;
    findings.extend(match role {
        PeerRole::Robot => driven(idle_plc(place, &interface, start)?, &interface, deadline)?,
        PeerRole::Plc => driven(robot_without_arm(place, &interface, start), &interface, deadline)?,
    });
    if role == PeerRole::Robot {
        findings.extend(assemblies::findings(bus, &findings));
        findings.extend(version::findings(bus, &findings));
    }
    if let (PeerRole::Robot, Ok(found)) = (role, &searched) {
        findings.extend(plugged::findings(found, bus, &interface, &findings));
    }
    Ok(findings)
}

/// Opens the interface and judges its link; `None` if nothing can be seen by it.
fn link(name: &str, findings: &mut Vec<Finding>) -> Option<Interface> {
    const LINK: &str = "link";
    let interface = match Interface::find(name).and_then(|found| found.set_up().map(|()| found)) {
        Ok(interface) => interface,
        Err(error) => {
            findings.push(Finding::missing(LINK, error.to_string(), "name one that `ip link` shows"));
            return None;
        }
    };
    let until = clock::now() + CARRIER;
    while !interface.has_carrier().unwrap_or(true) {
        if clock::now() > until {
            let found = format!("`{name}` is up, and nothing is at the other end of its cable");
            findings.push(Finding::missing(LINK, found, "plug the cable in, and switch the foreign end on"));
            return None;
        }
        std::thread::sleep(CARRIER_STEP);
    }
    findings.push(Finding::good(LINK, format!("`{}` ({})", interface.name(), interface.mac())));
    Some(interface)
}

fn own_address(address: std::net::Ipv4Addr, taken: anyhow::Result<()>) -> Finding {
    const OWN: &str = "own address";
    match taken {
        Ok(()) => Finding::good(OWN, format!("{address} on this interface")),
        Err(error) => {
            let is_taken = error.chain().any(|cause| cause.is::<AddressCheckError>());
            let fix = if is_taken {
                "give that station another address, or choose another one in the setup"
            } else {
                "remove the interface's own address, or give the setup addresses of its subnet"
            };
            Finding::missing(OWN, format!("{error:#}"), fix)
        }
    }
}

/// Returns an idle PLC on the bus of the place.
fn idle_plc(
    place: &PeerStation,
    interface: &Interface,
    start: Instant,
) -> anyhow::Result<Look<plc_node::bus::PlcBus, RobotWatch>> {
    let PeerStation { setup, buses, id } = place;
    let others: Vec<_> = buses.iter().skip(1).collect();
    let first = buses.first().unwrap_or(&setup.bus);
    let mut bus = plc_node::bus::open_all(first, &others, interface.mac(), start.as_nanos(), start)?;
    if let plc_node::bus::PlcBus::EthernetIp(scanner) = &mut bus
        && OpenPort::open(interface, machine::arp::ETHERNET).is_err()
    {
        scanner.stop_conflict_detection();
    }
    let robot_cycle = Duration::from_micros(setup.robot.cycle_us.value.into());
    let watch = RobotWatch::new(&bus, *id, robot_cycle);
    let scan = Duration::from_micros(setup.plc.scan_cycle_us.value.into());
    Ok(Look::new(bus, watch, Cycle::new(start, scan), start))
}

/// Returns a robot that has no arm, on the bus of the place.
fn robot_without_arm(
    place: &PeerStation,
    interface: &Interface,
    start: Instant,
) -> Look<robot_node::bus::RobotBus, PlcWatch> {
    let setup = &place.setup;
    let host = robot_node::bus::Host {
        mac: interface.mac(),
        address: interface.address(),
        gateway: interface.gateway(),
    };
    let mut bus = robot_node::bus::open_station(&setup.bus, host, None, start.as_nanos(), || start);
    if let robot_node::bus::RobotBus::EthernetIp(adapter) = &mut bus
        && OpenPort::open(interface, machine::arp::ETHERNET).is_err()
    {
        adapter.stop_conflict_detection();
    }
    let own_name = match &setup.bus.kind {
        BusKind::Profinet(_, profinet) => Some(profinet.robot_station_name.clone()),
        BusKind::EthernetIp(..) | BusKind::Ethercat(_) => None,
    };
    let scan = Duration::from_micros(setup.plc.scan_cycle_us.value.into());
    let watch = PlcWatch::new(&bus, own_name, scan);
    let cycle = Duration::from_micros(setup.robot.cycle_us.value.into());
    Look::new(bus, watch, Cycle::new(start, cycle), start)
}

/// Runs a look until it is complete, or until the deadline, and returns what it found.
fn driven<B: Machine, W: PeerWatch<B>>(
    look: Look<B, W>,
    interface: &Interface,
    deadline: Instant,
) -> anyhow::Result<Vec<Finding>> {
    let mut driver = Driver::new(look, interface.clone(), Notifier::new()?)?;
    driver.run(&mut Looking { interface, deadline, is_up: false, ending: None })?;
    Ok(driver.machine().findings())
}

/// Ends a look in order, and sets the address that the foreign PLC wants.
struct Looking<'a> {
    interface: &'a Interface,
    deadline: Instant,
    is_up: bool,
    /// When to end although the foreign end has not confirmed it.
    ending: Option<Instant>,
}

impl<B: Machine, W: PeerWatch<B>> Owner<Look<B, W>> for Looking<'_> {
    fn wake(&mut self, now: Instant, look: &mut Look<B, W>, _: &Statistics) -> ControlFlow<()> {
        match self.ending {
            Some(ending) if now >= ending => ControlFlow::Break(()),
            None if now >= self.deadline || look.is_complete(now) => {
                look.disconnect(now);
                self.ending = Some(now + DISCONNECT_LIMIT);
                if self.is_up { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
            }
            _ => ControlFlow::Continue(()),
        }
    }

    fn event(&mut self, now: Instant, look: &mut Look<B, W>, event: LinkEvent) -> ControlFlow<()> {
        match event {
            LinkEvent::Up => self.is_up = true,
            LinkEvent::Down(_) => {
                self.is_up = false;
                if self.ending.is_some() {
                    return ControlFlow::Break(());
                }
            }
            LinkEvent::SetAddress { address, mask, gateway } => {
                let done = self.interface.set_address(address, mask);
                let done = done.and_then(|()| self.interface.set_gateway(gateway));
                look.address_set(now, done.is_ok());
            }
            LinkEvent::Store
            | LinkEvent::Foreign(_)
            | LinkEvent::Owner(_)
            | LinkEvent::Conflict(_)
            | LinkEvent::Health => {}
        }
        ControlFlow::Continue(())
    }

    fn deadline(&self) -> Option<Instant> {
        Some(self.ending.unwrap_or(self.deadline))
    }
}

/// Returns the finding on the sizes of the process data, which a connection compares before it comes up.
fn sizes(was_up: bool) -> Finding {
    const SIZES: &str = "sizes";
    if was_up {
        Finding::good(SIZES, "both ends agree on the bytes each way")
    } else {
        Finding::not_seen(SIZES, "no connection came up", "see the step `connection`")
    }
}

/// Returns the finding on a connection that did not last.
fn lost(times: u32) -> Finding {
    let plural = if times == 1 { "" } else { "s" };
    let fix = "look at cables and load; a longer watchdog (bus.watchdog_cycles) bridges stalls";
    Finding::limited("connection", format!("it came up, and was lost {times} time{plural} meanwhile"), fix)
}

#[cfg(test)]
mod tests;
