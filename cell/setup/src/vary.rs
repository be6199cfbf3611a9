//! The same setup with one change, for studies of its effect.
//!
//! A changed number becomes `assumed`, and its note says so: what was calibrated for the original setup is not
//! calibrated for this one. The caller checks the result, like any setup, by [`check`](crate::check).

use std::fmt::Display;

use crate::{Cell, Drives, Provenance, Refill, Servo, Setup, SlotForm, Sourced};

/// Fewest bus cycles without a frame that a connection must tolerate; 3 is usual.
const LEAST_WATCHDOG_CYCLES: u32 = 3;

impl<T: Display> Sourced<T> {
    /// Returns this number with another value.
    #[must_use]
    pub fn varied(&self, value: T) -> Self {
        Self { note: format!("varied for a study, from {}", self.value), value, from: Provenance::Assumed }
    }
}

impl Setup {
    /// Returns the setup with another bus cycle. The watchdog time stays the same, but is at least three cycles.
    #[must_use]
    pub fn with_bus_cycle(mut self, cycle_us: u32) -> Self {
        let bus = &mut self.bus;
        let cycles = bus.watchdog().as_micros().div_ceil(u128::from(cycle_us.max(1)));
        let cycles = u32::try_from(cycles).unwrap_or(u32::MAX).max(LEAST_WATCHDOG_CYCLES);
        bus.watchdog_cycles = bus.watchdog_cycles.varied(cycles);
        bus.cycle_us = bus.cycle_us.varied(cycle_us);
        self
    }

    /// Returns the setup with this many of the image's slots in use.
    #[must_use]
    pub fn with_queue_depth(mut self, depth: u32) -> Self {
        let before = self.plc.slots_in_use();
        let note = format!("varied for a study, from {before}");
        self.plc.queue_depth = Some(Sourced { value: depth, from: Provenance::Assumed, note });
        self
    }

    /// Returns the setup with a robot that keeps this many motions.
    #[must_use]
    pub fn with_queue_motions(mut self, motions: u32) -> Self {
        let note = format!("varied for a study, from {}", self.robot.queue_holds());
        self.robot.queue_motions = Some(Sourced { value: motions, from: Provenance::Assumed, note });
        self
    }

    /// Returns the setup with a robot that takes compact points.
    #[must_use]
    pub const fn with_compact_points(mut self) -> Self {
        self.robot.compact_points = Some(true);
        self
    }

    /// Returns the setup with a PLC that sends compact points to a robot that takes them.
    #[must_use]
    pub const fn with_form_compact(mut self) -> Self {
        self.plc.form = Some(SlotForm::Compact);
        self.with_compact_points()
    }

    /// Returns the setup with a PLC that refills slots by this count.
    #[must_use]
    pub const fn with_refill(mut self, refill: Refill) -> Self {
        self.plc.refill = Some(refill);
        self
    }

    /// Returns the setup with this time of a skill call besides its motion, in µs: the h of SM's penalty.
    #[must_use]
    pub fn with_skill_overhead(mut self, overhead_us: u32) -> Self {
        self.robot.skill_overhead_us = self.robot.skill_overhead_us.varied(overhead_us);
        self
    }

    /// Returns the setup with a controller that notices every command at once.
    #[must_use]
    pub fn without_quanta(mut self) -> Self {
        let robot = &mut self.robot;
        robot.interpreter_quantum_us = robot.interpreter_quantum_us.varied(0);
        robot.start_quantum_us = robot.start_quantum_us.as_ref().map(|quantum| quantum.varied(0));
        self
    }

    /// Returns the setup with these drives of the robot controller.
    #[must_use]
    pub fn with_drives(mut self, drives: Drives) -> Self {
        self.robot.drives = Some(drives);
        self.with_servo()
    }

    /// Returns the setup with assumed limits of its drives, if it has drives and gives no limits.
    #[must_use]
    pub(crate) fn with_servo(mut self) -> Self {
        if self.robot.drives.is_some() {
            self.robot.servo.get_or_insert_with(Servo::assumed);
        }
        self
    }

    /// Returns the setup with motions at this share of the rated speeds, in %.
    #[must_use]
    pub fn with_velocity(mut self, percent: f64) -> Self {
        self.motions.velocity_percent = self.motions.velocity_percent.varied(percent);
        self
    }

    /// Returns the setup with motions at this share of the rated accelerations, in %.
    #[must_use]
    pub fn with_acceleration(mut self, percent: f64) -> Self {
        self.motions.acceleration_percent = self.motions.acceleration_percent.varied(percent);
        self
    }

    /// Returns the setup with this approximation distance in mm.
    #[must_use]
    pub fn with_approximation(mut self, mm: f64) -> Self {
        self.motions.approximation_mm = self.motions.approximation_mm.varied(mm);
        self
    }

    /// Returns the setup without numbers that were chosen to reproduce published figures: motions at their rated
    /// speeds, and calls that take no time and are noticed at once.
    #[must_use]
    pub fn uncalibrated(self) -> Self {
        self.without_start_cycles().with_velocity(100.0).with_skill_overhead(0).without_quanta()
    }

    /// Returns the setup with a robot that needs no cycle between a MoveContinuousSkill and its first motion.
    #[must_use]
    pub fn without_start_cycles(mut self) -> Self {
        let cycles = &mut self.robot.continuous_start_cycles;
        *cycles = cycles.as_ref().map(|cycles| cycles.varied(0));
        self
    }
}

impl Cell {
    /// Returns the cell with one station changed as a setup of its own: its bus, its robot and its motions, the keys
    /// `station.NAME.…`. What the change does to the PLC, all stations have. Without a station of this name there is no cell.
    #[must_use]
    pub fn with_station(mut self, name: &str, change: impl FnOnce(Setup) -> Setup) -> Option<Self> {
        let changed = change(self.setup_of(self.station(name)?));
        self.plc = changed.plc;
        let station = self.stations.iter_mut().find(|station| station.name == name)?;
        (station.bus, station.robot, station.motions) = (changed.bus, changed.robot, changed.motions);
        Some(self)
    }

    /// Returns the cell with every station changed as [`Cell::with_station`] does.
    #[must_use]
    pub fn with_each_station(mut self, change: impl Fn(Setup) -> Setup) -> Self {
        let changed: Vec<Setup> = self.setups().map(change).collect();
        if let Some(Setup { plc, .. }) = changed.first() {
            self.plc = plc.clone();
        }
        for (station, Setup { bus, robot, motions, .. }) in self.stations.iter_mut().zip(changed) {
            (station.bus, station.robot, station.motions) = (bus, robot, motions);
        }
        self
    }

    /// Returns the cell with assumed limits of drives where a station has drives and gives none.
    #[must_use]
    pub(crate) fn with_servos(mut self) -> Self {
        for station in &mut self.stations {
            if station.robot.drives.is_some() {
                station.robot.servo.get_or_insert_with(Servo::assumed);
            }
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use crate::{Provenance, check, setup};

    #[test]
    fn the_watchdog_time_stays_with_another_bus_cycle_but_is_at_least_three_cycles() {
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
    fn an_uncalibrated_setup_has_no_calibrated_number_and_marks_the_changed_ones() {
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
