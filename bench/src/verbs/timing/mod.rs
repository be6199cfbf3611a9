//! `bench timing`: how regularly the cyclic frames of each bus arrive, and how long a number is on the way from the PLC
//! to the robot and back, compared with the best that the host allows.
//!
//! An absolute figure would depend on the host as much as on the program. So the contenders send side by side on the
//! same cores, each on its own cable: a bare loop that sleeps until an absolute deadline and sends frames of the same
//! size, this project's two ends of a bus, and on EtherNet/IP optionally a foreign adapter. A stall of the host affects
//! all of them at the same time. The buses take turns of a second; in each turn everything starts again, in another
//! phase to each other. Arrival times are the kernel's, of frames as they leave the cable.

mod bare;
mod cable;
mod comparison;
mod connection;
mod evenness;
mod stopwatch;
mod turns;

use std::ffi::OsString;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use clap::ValueEnum as _;
use node::list::{List, flat, list};
use setup::{BusKind, Cyclic, EthernetIp, EthernetIpAdapter, EthernetIpFormat, Setup};

use bare::Wire;
use cable::{Cable, MASK, PLC, ROBOT};
use records::exit::{Exit, Failure};
use report::errln;
use report::outln;
use stands::rig;
use studies::each_bus::over_each_bus;
use studies::event_loop::{interrupted, watch_for_interrupt};
use turns::{BusMeasurement, Turns};

/// Options of a comparison.
#[derive(clap::Args, Debug)]
pub struct TimingOptions {
    /// Turns of one second for each bus.
    #[arg(long, value_name = "N", default_value_t = 30, value_parser = clap::value_parser!(u32).range(5..=3_600))]
    pub seconds: u32,
    /// Buses to measure: profinet-udp, profinet-rt1, ethernet-ip, ethercat, with commas or blanks between them; all without it.
    #[arg(long, value_name = "BUS", num_args = 1.., value_parser = list(bus))]
    pub buses: Vec<List<TimedBus>>,
    /// Command of another EtherNet/IP adapter to compare with, with assemblies 100, 150 and 151 as the robot node has
    /// them: a command that is run at the other end of a cable of its own, where it has the address 192.168.64.2.
    #[arg(last = true, value_name = "COMMAND")]
    pub peer: Vec<OsString>,
}

/// A bus to measure.
#[derive(clap::ValueEnum, Clone, Copy, PartialEq, Eq, Debug)]
pub enum TimedBus {
    /// PROFINET, RT_CLASS_UDP.
    ProfinetUdp,
    /// PROFINET, RT_CLASS_1.
    ProfinetRt1,
    /// EtherNet/IP.
    EthernetIp,
    /// EtherCAT.
    Ethercat,
}

fn bus(name: &str) -> Result<TimedBus, String> {
    let unknown = || {
        format!(
            "there is no bus `{name}`; the buses are profinet-udp, profinet-rt1, ethernet-ip and ethercat"
        )
    };
    TimedBus::from_str(name, false).map_err(|_| unknown())
}

/// Time from one cyclic frame to the next, in both directions.
const INTERVAL: Duration = Duration::from_millis(1);

/// Measured time of each turn.
const TURN: Duration = Duration::from_secs(1);

/// Time from a turn's first frame to the first that counts: caches are warm by then.
const SETTLE: Duration = Duration::from_millis(100);

/// Measures, prints the tables and the verdicts.
pub fn run(options: &TimingOptions) -> Result<Exit, Failure> {
    let buses = buses(options)?;
    rig::enter_user_namespace()?;
    let is_interrupted = watch_for_interrupt()?;
    measure(options, &buses, &is_interrupted).map_err(|error| Failure::new(Exit::EnvironmentUnusable, error))
}

/// Returns the setups to measure: Setup A over each bus, with the addresses of the cables.
fn buses(options: &TimingOptions) -> Result<Vec<(&'static str, Setup)>, Failure> {
    let chosen = flat(&options.buses);
    let mut all: Vec<_> = over_each_bus(&setup::setup("A")?)?
        .into_iter()
        .filter(|(_, setup)| chosen.is_empty() || chosen.contains(&timed(&setup.bus.kind)))
        .collect();
    for (_, setup) in &mut all {
        setup.bus.cycle_us.value = INTERVAL.as_micros() as u32;
        if let BusKind::Profinet(addresses, _) | BusKind::EthernetIp(addresses, _) = &mut setup.bus.kind {
            (addresses.plc, addresses.robot, addresses.mask) = (PLC, ROBOT, MASK);
        }
    }
    let has_ethernet_ip = all.iter().any(|(_, setup)| timed(&setup.bus.kind) == TimedBus::EthernetIp);
    if !options.peer.is_empty() && !has_ethernet_ip {
        let reason =
            "the adapter to compare with speaks EtherNet/IP, which --buses leaves out: add `ethernet-ip`";
        return Err(Failure::new(Exit::Usage, anyhow::anyhow!(reason)));
    }
    Ok(all)
}

const fn timed(kind: &BusKind) -> TimedBus {
    match kind {
        BusKind::Profinet(_, profinet) => match profinet.cyclic {
            Cyclic::Udp => TimedBus::ProfinetUdp,
            Cyclic::Rt1 => TimedBus::ProfinetRt1,
        },
        BusKind::EthernetIp(..) => TimedBus::EthernetIp,
        BusKind::Ethercat(_) => TimedBus::Ethercat,
    }
}

/// Returns how the bare loop carries what this bus carries: the bus's own framing, with an image.
const fn wire(kind: &BusKind) -> Wire {
    match timed(kind) {
        // FrameID, the cyclic data with their states, the status of the frame.
        TimedBus::ProfinetUdp => Wire::Udp(276),
        TimedBus::ProfinetRt1 => Wire::Ethernet(280),
        // 18 bytes of items, the sequence count, the run/idle head.
        TimedBus::EthernetIp => Wire::Udp(276),
        // An image in each direction, in one frame.
        TimedBus::Ethercat => Wire::Ethernet(540),
    }
}

/// Measures bus by bus, in turns, until an interrupt; then prints the turns that are complete.
fn measure(
    options: &TimingOptions,
    buses: &[(&'static str, Setup)],
    is_interrupted: &AtomicBool,
) -> anyhow::Result<Exit> {
    let mut measurements: Vec<BusMeasurement<'_>> =
        buses.iter().map(|(name, setup)| BusMeasurement::new(name, setup, wire(&setup.bus.kind))).collect();
    let turns = Turns::new()?;
    let foreign = match options.peer.split_first() {
        None => None,
        Some((program, arguments)) => {
            let cable = Cable::set_up()?;
            let process = cable.spawn_at_robot(program, arguments)?;
            Some((cable, process))
        }
    };
    let mut complete = 0;
    'turns: for turn in 0..options.seconds {
        errln!("turn {} of {}", turn + 1, options.seconds);
        for measurement in &mut measurements {
            if is_interrupted.load(Ordering::Relaxed) {
                break 'turns;
            }
            let is_ethernet_ip = timed(&measurement.setup.bus.kind) == TimedBus::EthernetIp;
            let peer = foreign.as_ref().filter(|_| is_ethernet_ip).map(|(cable, _)| cable);
            turns.take(measurement, turn, peer.map(|cable| (cable, foreign_adapter(measurement.setup))))?;
        }
        complete = turn + 1;
    }
    let is_interrupted = complete < options.seconds;
    if complete == 0 {
        return Ok(interrupted(0, options.seconds as usize, "turns"));
    }
    let of_peer = match foreign {
        Some((cable, process)) => {
            drop(process);
            Some(cable.arrivals()?)
        }
        None => None,
    };
    let comparisons = turns.compare(measurements, of_peer.as_ref())?;
    outln!("{}", comparison::render(&comparisons));
    if is_interrupted {
        return Ok(interrupted(complete as usize, options.seconds as usize, "turns"));
    }
    // A limit that is certainly exceeded.
    let fails = comparisons.iter().any(comparison::Comparison::fails);
    Ok(if fails { Exit::TimingRegression } else { Exit::Pass })
}

/// Returns the same setup with an adapter that has our assemblies, but any identity.
fn foreign_adapter(setup: &Setup) -> Setup {
    let mut setup = setup.clone();
    if let BusKind::EthernetIp(_, ethernet_ip) = &mut setup.bus.kind {
        let adapter = EthernetIpAdapter {
            consumed_assembly: 150,
            consumed_bytes: 256,
            produced_assembly: 100,
            produced_bytes: 256,
            consumed_format: EthernetIpFormat::RunIdleHeader,
            produced_format: EthernetIpFormat::Modeless,
            configuration_assembly: Some(151),
            configuration_data: Vec::new(),
            route: Vec::new(),
            key: None,
        };
        *ethernet_ip = EthernetIp { adapter: Some(adapter), ..ethernet_ip.clone() };
    }
    setup
}

#[cfg(test)]
mod tests {
    use super::*;

    fn options(buses: &str, peer: &[&str]) -> TimingOptions {
        let buses = if buses.is_empty() { vec![] } else { vec![list(bus)(buses).unwrap()] };
        TimingOptions { seconds: 5, buses, peer: peer.iter().map(OsString::from).collect() }
    }

    #[test]
    fn every_bus_is_measured_unless_some_are_named_and_each_has_the_cables_addresses() {
        let all = buses(&options("", &[])).unwrap();
        let names: Vec<_> = all.iter().map(|(name, _)| *name).collect();
        assert_eq!(names, ["PROFINET udp", "PROFINET rt1", "EtherNet/IP", "EtherCAT"]);
        for (name, setup) in &all {
            setup::check(setup).unwrap();
            assert_eq!(setup.bus.cycle_us.value, 1_000, "{name}");
            assert!(setup.bus.addresses().is_none_or(|at| (at.plc, at.robot) == (PLC, ROBOT)), "{name}");
        }
        let some = buses(&options("ethercat, profinet-rt1", &[])).unwrap();
        let names: Vec<_> = some.iter().map(|(name, _)| *name).collect();
        assert_eq!(names, ["PROFINET rt1", "EtherCAT"]);
    }

    #[test]
    fn an_adapter_to_compare_with_is_refused_where_its_bus_is_left_out() {
        let refused = buses(&options("ethercat", &["adapter"])).unwrap_err();
        assert!(format!("{refused:?}").contains("add `ethernet-ip`"), "{refused:?}");
        let ethernet_ip = buses(&options("ethernet-ip", &["adapter"])).unwrap();
        let [(_, setup)] = &ethernet_ip[..] else { panic!("one bus") };
        let foreign = foreign_adapter(setup);
        setup::check(&foreign).unwrap();
        assert_ne!(foreign.bus.kind, setup.bus.kind);
    }
}
