//! The cost of a cycle in virtual time: PLC, network and robots on one thread.

use std::sync::atomic::{AtomicBool, Ordering};

use plc_node::ExecutionType;
use records::schedule::Schedule;
use stands::cell_measured::CellHealth;
use stands::virtual_run::CellRun;

use super::measured::{ScaleRow, median};
use super::plant::{ScalePlant, ScaledBus};
use super::{memory_mib, thread_time_ns};

/// Repetitions of one schedule: more than fit into the longest measurement.
const REPETITIONS: u32 = 10_000;

/// Seed of the run.
const SEED: u64 = 1;

/// Measures for so many seconds of virtual time; `None` if it was interrupted.
pub(super) fn measure(
    bus: ScaledBus,
    count: u32,
    seconds: u32,
    is_interrupted: &AtomicBool,
) -> anyhow::Result<Option<ScaleRow>> {
    let plant = ScalePlant::on(bus)?;
    let mut run = CellRun::start(&plant.stations(count)?, SEED)?;
    let wanted = u64::from(seconds) * 1_000_000 / u64::from(plant.cycle_us().max(1));
    let (mut costs, before) = (Vec::new(), FrameTotals::of(&run.health()));
    let mut last = before;
    for step in Schedule::new(&[ExecutionType::Cm], REPETITIONS, SEED).steps() {
        if is_interrupted.load(Ordering::Relaxed) {
            return Ok(None);
        }
        let start_ns = thread_time_ns();
        run.execute(step)?;
        let cost_us = (thread_time_ns() - start_ns) as f64 / 1e3;
        let now = FrameTotals::of(&run.health());
        costs.push(cost_us / now.since(&last).cycles(count) as f64);
        last = now;
        if last.since(&before).cycles(count) >= wanted {
            break;
        }
    }
    let all = last.since(&before);
    let cycles = all.cycles(count).max(1);
    Ok(Some(ScaleRow {
        bus: bus.key(),
        stations: count,
        cycles,
        cost_us: median(&mut costs),
        frames_sent: all.sent as f64 / cycles as f64,
        frames_received: all.received as f64 / cycles as f64,
        memory_mib: memory_mib(),
        real: None,
    }))
}

/// Cyclic frames of all stations, by the PLC's count.
#[derive(Clone, Copy)]
struct FrameTotals {
    sent: u64,
    received: u64,
}

impl FrameTotals {
    fn of(health: &CellHealth) -> Self {
        let stations = health.stations.iter();
        let add = |sum: Self, one: protocol::fieldbus::Counters| Self {
            sent: sum.sent + one.sent,
            received: sum.received + one.received,
        };
        stations.map(|station| station.bus).fold(Self { sent: 0, received: 0 }, add)
    }

    const fn since(&self, before: &Self) -> Self {
        Self { sent: self.sent - before.sent, received: self.received - before.received }
    }

    /// Returns the number of cycles: the PLC sends a frame to each station in each.
    fn cycles(&self, stations: u32) -> u64 {
        self.sent / u64::from(stations.max(1))
    }
}
