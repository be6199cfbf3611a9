//! What the seed determines and no setup gives: what each node's clock shows at the start, how fast it runs within
//! `bus.clock_drift_ppm`, and where in its cycle each cyclic task starts.

use std::time::Duration;

use machine::Instant;
use rand_core::SeedableRng;
use rand_pcg::Pcg64Mcg;
use setup::Setup;
use virtual_time::{Clock, Side};

use records::schedule::below;

/// Largest value of a clock at the start: two nodes are never switched on together.
const OFFSET: Duration = Duration::from_secs(1);

/// Clocks and phases of the nodes of a cell, drawn in sequence.
pub(super) struct Phases {
    random: Pcg64Mcg,
    pub(super) plc: Clock,
    /// In the order of the stations.
    pub(super) robots: Vec<Clock>,
}

impl Phases {
    /// Draws the clocks of a setup with one station.
    pub(super) fn of_one(setup: &Setup, seed: u64) -> Self {
        Self::new(std::iter::once(setup), seed)
    }

    /// Returns the clocks of the PLC and of the first robot.
    pub(super) fn clocks(&self) -> [Clock; 2] {
        [self.plc, self.robots.first().copied().unwrap_or_default()]
    }

    /// Returns when a task of the PLC (A), or of the first robot (B), runs first, on its own clock.
    pub(super) fn first_at(&mut self, side: Side, cycle_us: u32) -> Instant {
        let clock = if side == Side::A { Some(&self.plc) } else { self.robots.first() };
        self.first(clock.copied().unwrap_or_default(), cycle_us)
    }

    /// Draws the clocks of a cell whose stations have these setups.
    pub(super) fn new<'a>(setups: impl Iterator<Item = &'a Setup> + Clone, seed: u64) -> Self {
        let mut random = Pcg64Mcg::seed_from_u64(!seed);
        let of_plc = setups.clone().next().map(|setup| clock(&mut random, setup));
        let robots = setups.map(|setup| clock(&mut random, setup)).collect();
        Self { random, plc: of_plc.unwrap_or_default(), robots }
    }

    /// Returns when a task of this cycle runs first, on this clock.
    pub(super) fn first(&mut self, clock: Clock, cycle_us: u32) -> Instant {
        first(&mut self.random, clock, cycle_us)
    }
}

fn clock(random: &mut Pcg64Mcg, setup: &Setup) -> Clock {
    let drift = Duration::from_nanos(u64::from(setup.bus.clock_drift_ppm.value) * 1_000);
    let offset_ns = below(random, OFFSET).as_nanos() as u64;
    let drift_ppb = below(random, drift * 2).as_nanos() as i32 - drift.as_nanos() as i32;
    Clock { offset_ns, drift_ppb }
}

fn first(random: &mut Pcg64Mcg, clock: Clock, cycle_us: u32) -> Instant {
    let cycle = Duration::from_micros(cycle_us.into());
    clock.local_time(Instant::ZERO) + below(random, cycle)
}
