//! The cost of a cycle on a real network: the PLC on one core of this process, the robots in processes on another one.
//!
//! One cable leads from the PLC to the robots, each with an interface of its own at its end; robots on EtherCAT are in line, in one
//! process. In turns of a second the PLC
//! connects to all of them and executes CM, or a bare loop sleeps on the same core while the robots wait.

mod network;
mod plc;
mod robots;

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use machine::Lateness;
use protocol_linux::wakeups;
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};

use super::measured::{RealRow, ScaleRow, median};
use super::memory_mib;
use super::plant::{ScalePlant, ScaledBus};
use network::ScaleNetwork;
use plc::{Turn, run_turn};
use robots::RobotProcess;

pub use robots::run_as_robots;

/// Robots in one process, where they are not in line.
const ROBOTS_A_PROCESS: u8 = 32;

/// Length of a turn.
const TURN: Duration = Duration::from_secs(1);

/// Measures for so many seconds; `None` if it was interrupted.
pub(super) fn measure(
    bus: ScaledBus,
    count: u32,
    seconds: u32,
    is_interrupted: &AtomicBool,
) -> anyhow::Result<Option<ScaleRow>> {
    let plant = ScalePlant::on(bus)?;
    let stations = plant.stations(count)?;
    let numbers = u8::try_from(stations.len())?;
    let in_line = bus == ScaledBus::Ethercat;
    let network = if in_line { ScaleNetwork::set_up_line() } else { ScaleNetwork::set_up(numbers) }?;
    let (own_core, robots_core) = cores()?;
    run_on(own_core)?;
    let mut robots = Vec::new();
    let a_process = if in_line { numbers } else { ROBOTS_A_PROCESS };
    for first in (0..numbers).step_by(a_process.into()) {
        let some = a_process.min(numbers - first);
        robots.push(RobotProcess::spawn(&network, bus, first, some, robots_core)?);
    }
    let cycle = Duration::from_micros(plant.cycle_us().into());
    let (mut turns, mut bare) = (Vec::new(), Histogram::default());
    for turn in 0..seconds {
        if is_interrupted.load(Ordering::Relaxed) {
            return Ok(None);
        }
        let count = u64::try_from(TURN.as_nanos() / cycle.as_nanos().max(1))?;
        bare.add(&wakeups::measure(cycle, count)?.lateness, None);
        turns.push(run_turn(&network, &plant, &stations, turn)?);
    }
    for process in &mut robots {
        process.check()?;
    }
    Ok(Some(row(bus, count, &turns, &bare)))
}

fn row(bus: ScaledBus, stations: u32, turns: &[Turn], bare: &Histogram) -> ScaleRow {
    let mut late = Histogram::default();
    for turn in turns {
        late.add(&turn.end.lateness, Some(&turn.begin.lateness));
    }
    let total = |figure: fn(&Turn) -> u64| turns.iter().map(figure).sum::<u64>();
    let cycles = total(Turn::cycles).max(1);
    let mut costs: Vec<f64> = turns.iter().map(Turn::cost_us).collect();
    let [late_p50_us, late_p99_us] = [0.5, 0.99].map(|share| late.quantile_us(share));
    let [bare_p50_us, bare_p99_us] = [0.5, 0.99].map(|share| bare.quantile_us(share));
    ScaleRow {
        bus: bus.key(),
        stations,
        cycles,
        cost_us: median(&mut costs),
        frames_sent: total(|turn| turn.end.frames_sent - turn.begin.frames_sent) as f64 / cycles as f64,
        frames_received: total(|turn| turn.end.frames_received - turn.begin.frames_received) as f64
            / cycles as f64,
        memory_mib: memory_mib(),
        real: Some(RealRow {
            ready_ms: turns.iter().map(|turn| turn.ready_in.as_secs_f64() * 1e3).fold(0.0, f64::max),
            late_p50_us,
            late_p99_us,
            late_max_us: late.quantile_us(1.0),
            bare_p50_us,
            bare_p99_us,
            bare_max_us: bare.quantile_us(1.0),
            late_by_bare: late_p99_us / bare_p99_us,
            scans_missed: total(|turn| turn.end.scans_missed - turn.begin.scans_missed),
            allocations: total(|turn| turn.end.allocations - turn.begin.allocations),
        }),
    }
}

/// Lateness of several turns: how many wake-ups were at most so late.
#[derive(Default, Debug)]
struct Histogram(std::collections::BTreeMap<Duration, u64>);

impl Histogram {
    /// Adds what was recorded since `before`, or all of it.
    fn add(&mut self, now: &Lateness, before: Option<&Lateness>) {
        for (bound, count) in now.buckets() {
            *self.0.entry(bound).or_default() += u64::from(count);
        }
        for (bound, count) in before.into_iter().flat_map(Lateness::buckets) {
            let held = self.0.entry(bound).or_default();
            *held = held.saturating_sub(count.into());
        }
    }

    /// Returns the lateness that this share of the wake-ups did not exceed.
    fn quantile_us(&self, share: f64) -> f64 {
        let wanted = self.0.values().sum::<u64>() as f64 * share;
        let mut seen = 0;
        let reaches = |(_, count): &(&Duration, &u64)| {
            seen += **count;
            seen > 0 && seen as f64 >= wanted
        };
        self.0.iter().find(reaches).map_or(0.0, |(bound, _)| bound.as_secs_f64() * 1e6)
    }
}

/// Returns the core of the PLC and that of the robots; they are the same where this process may use only one.
fn cores() -> anyhow::Result<(usize, usize)> {
    // Read before this process keeps to one core.
    static ALLOWED: std::sync::OnceLock<Vec<usize>> = std::sync::OnceLock::new();
    let allowed = match ALLOWED.get() {
        Some(allowed) => allowed,
        None => {
            let set = sched_getaffinity(None)?;
            ALLOWED.get_or_init(|| (0..CpuSet::MAX_CPU).filter(|core| set.is_set(*core)).collect())
        }
    };
    let first = allowed.first().copied().unwrap_or_default();
    Ok((first, allowed.last().copied().unwrap_or(first)))
}

/// Keeps this thread, and those that it starts from now on, on one core.
fn run_on(core: usize) -> anyhow::Result<()> {
    let mut set = CpuSet::new();
    set.set(core);
    Ok(sched_setaffinity(None, &set)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use machine::{Instant, Tick};

    fn lateness(micros: &[u64]) -> Lateness {
        let mut lateness = Lateness::default();
        for micros in micros {
            let lateness_of_one = Duration::from_micros(*micros);
            lateness.record(&Tick { due: Instant::ZERO, lateness: lateness_of_one, skipped: 0 });
        }
        lateness
    }

    #[test]
    fn only_what_was_recorded_within_a_turn_counts() {
        let mut histogram = Histogram::default();
        histogram.add(&lateness(&[900, 900, 10, 20]), Some(&lateness(&[900, 900])));
        assert!((19.0..22.0).contains(&histogram.quantile_us(1.0)), "{histogram:?}");
        assert!((9.0..11.0).contains(&histogram.quantile_us(0.5)), "{histogram:?}");
        assert_eq!(Histogram::default().quantile_us(0.99), 0.0);
    }
}
