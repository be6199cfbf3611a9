//! The same setup with one thing changed, for studies that ask what depends on it.
//!
//! A number that was changed is `assumed` from then on, and its note says so: what was calibrated for the setup as it was is
//! not calibrated for this one. The caller checks what comes out, as any setup, by [`check`](crate::check).

use std::fmt::Display;

use crate::{Provenance, Setup, Sourced};

/// Bus cycles that a connection bears at least without a frame; 3 is usual.
const LEAST_WATCHDOG_CYCLES: u32 = 3;

impl<T: Display> Sourced<T> {
    /// Another value in its place.
    #[must_use]
    pub fn varied(&self, value: T) -> Self {
        Self { note: format!("varied for a study, from {}", self.value), value, from: Provenance::Assumed }
    }
}

impl Setup {
    /// With another bus cycle. The watchdog waits as long as before, but for three cycles at least.
    #[must_use]
    pub fn with_bus_cycle(mut self, cycle_us: u32) -> Self {
        let bus = &mut self.bus;
        let cycles = bus.watchdog().as_micros().div_ceil(u128::from(cycle_us.max(1)));
        let cycles = u32::try_from(cycles).unwrap_or(u32::MAX).max(LEAST_WATCHDOG_CYCLES);
        bus.watchdog_cycles = bus.watchdog_cycles.varied(cycles);
        bus.cycle_us = bus.cycle_us.varied(cycle_us);
        self
    }

    /// With so many of the image's slots in use.
    #[must_use]
    pub fn with_queue_depth(mut self, depth: u32) -> Self {
        let before = self.plc.slots_in_use();
        let note = format!("varied for a study, from {before}");
        self.plc.queue_depth = Some(Sourced { value: depth, from: Provenance::Assumed, note });
        self
    }

    /// With a skill call that costs so much besides its motion: the h of SM's penalty, in µs.
    #[must_use]
    pub fn with_skill_overhead(mut self, overhead_us: u32) -> Self {
        self.robot.skill_overhead_us = self.robot.skill_overhead_us.varied(overhead_us);
        self
    }

    /// With a controller that notices every command at once.
    #[must_use]
    pub fn without_quanta(mut self) -> Self {
        let robot = &mut self.robot;
        robot.interpreter_quantum_us = robot.interpreter_quantum_us.varied(0);
        robot.start_quantum_us = robot.start_quantum_us.as_ref().map(|quantum| quantum.varied(0));
        self
    }

    /// With motions programmed at this share of the rated speeds, in %.
    #[must_use]
    pub fn with_velocity(mut self, percent: f64) -> Self {
        self.motions.velocity_percent = self.motions.velocity_percent.varied(percent);
        self
    }

    /// With motions programmed at this share of the rated accelerations, in %.
    #[must_use]
    pub fn with_acceleration(mut self, percent: f64) -> Self {
        self.motions.acceleration_percent = self.motions.acceleration_percent.varied(percent);
        self
    }

    /// With this approximation distance in mm.
    #[must_use]
    pub fn with_approximation(mut self, mm: f64) -> Self {
        self.motions.approximation_mm = self.motions.approximation_mm.varied(mm);
        self
    }

    /// With nothing in it that was chosen to meet a published figure: motions at their rated speeds, calls that cost
    /// nothing and that are noticed at once.
    #[must_use]
    pub fn uncalibrated(self) -> Self {
        self.with_velocity(100.0).with_skill_overhead(0).without_quanta()
    }
}

#[cfg(test)]
mod tests {
    use crate::{Provenance, check, setup};

    #[test]
    fn the_watchdog_of_another_bus_cycle_waits_as_long_but_for_three_cycles_at_least() {
        for name in ["A", "B"] {
            let shipped = setup(name).unwrap();
            let hold_us = shipped.bus.cycle_us.value * shipped.bus.watchdog_cycles.value;
            for cycle_us in [1_000, 2_000, 4_000, 8_000, 16_000, 32_000, 64_000] {
                let setup = shipped.clone().with_bus_cycle(cycle_us);
                check(&setup).unwrap();
                let (cycles, waits) =
                    (setup.bus.watchdog_cycles.value, setup.bus.watchdog_cycles.value * cycle_us);
                assert!(waits >= hold_us && cycles >= 3, "{name}, {cycle_us} µs: {cycles} cycles");
            }
        }
    }

    #[test]
    fn no_calibrated_number_is_left_in_an_uncalibrated_setup_and_the_changed_ones_say_so() {
        for name in ["A", "B"] {
            let setup = setup(name).unwrap().uncalibrated();
            check(&setup).unwrap();
            let toml = crate::setup_to_toml(&setup).unwrap();
            assert!(!toml.contains("calibrated\""), "{toml}");
            assert_eq!(setup.robot.skill_overhead_us.from, Provenance::Assumed);
            assert!(setup.motions.velocity_percent.note.starts_with("varied for a study, from "));
        }
    }

    #[test]
    fn a_queue_deeper_than_the_image_is_refused() {
        let setup = setup("A").unwrap();
        assert_eq!(setup.plc.slots_in_use(), 5);
        assert!(check(&setup.clone().with_queue_depth(1)).is_ok());
        for depth in [0, 6] {
            let refused = check(&setup.clone().with_queue_depth(depth)).unwrap_err().to_string();
            assert!(refused.contains("plc.queue_depth") && refused.contains("5 slots"), "{refused}");
        }
    }
}
