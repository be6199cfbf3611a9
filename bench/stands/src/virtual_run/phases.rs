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

/// Clocks and phases, drawn in sequence.
pub(super) struct Phases {
    random: Pcg64Mcg,
    pub(super) clocks: [Clock; 2],
}

impl Phases {
    pub(super) fn new(setup: &Setup, seed: u64) -> Self {
        let mut random = Pcg64Mcg::seed_from_u64(!seed);
        let drift = Duration::from_nanos(u64::from(setup.bus.clock_drift_ppm.value) * 1_000);
        let mut clock = || {
            let offset_ns = below(&mut random, OFFSET).as_nanos() as u64;
            let drift_ppb = below(&mut random, drift * 2).as_nanos() as i32 - drift.as_nanos() as i32;
            Clock { offset_ns, drift_ppb }
        };
        let clocks = [clock(), clock()];
        Self { random, clocks }
    }

    /// Returns when a task of this cycle runs first, on its side's own clock.
    pub(super) fn first(&mut self, side: Side, cycle_us: u32) -> Instant {
        let [a, b] = self.clocks;
        let clock = if side == Side::A { a } else { b };
        let cycle = Duration::from_micros(cycle_us.into());
        clock.local_time(Instant::ZERO) + below(&mut self.random, cycle)
    }
}
