//! How long a slot of the image stays empty, and how long a motion must be so that CM keeps up.
//!
//! When the robot counts motion k as executed, which is in the middle of its corner, it writes so into its feedback; the
//! PLC reads it, writes motion k + n into the slot, and the robot reads that. With n slots the robot meanwhile has n − 1
//! motions before it. It must know of motion k + n at the decision point of the last of them, which lies somewhere
//! within that motion. So the round trip R may last at least n − 2 motions, and less than n − 1:
//!
//! ```text
//! (n − 2) · t ≥ R at its longest:   CM keeps up, whatever the profile of the motions is
//! (n − 1) · t < R at its shortest:  CM starves
//! ```

use std::time::Duration;

use setup::Setup;

/// From the instant at which a motion is executed to the robot's cycle that finds another one in its slot.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct RoundTrip {
    /// The shortest: no cycle on the way has to be waited for.
    pub shortest: Duration,
    /// The longest: every cycle on the way was just missed.
    pub longest: Duration,
}

impl RoundTrip {
    /// Computes the round trip from a setup's cycles: twice the robot's, twice the bus's, once the PLC's scan, and the
    /// delays of cable and scan.
    #[must_use]
    pub fn of(setup: &Setup) -> Self {
        let micros = |value: u32| Duration::from_micros(value.into());
        let bus = &setup.bus;
        let shortest = micros(bus.cable_delay_us.value) * 2 + micros(setup.plc.scan_cost_us.value);
        let cycles = micros(setup.robot.cycle_us.value) * 2
            + micros(bus.cycle_us.value) * 2
            + micros(setup.plc.scan_cycle_us.value);
        Self { shortest, longest: shortest + cycles }
    }

    /// Returns the shortest motion with which `depth` slots are sure to keep up; `None` with fewer than three slots,
    /// where it depends on the place within the motion at which the robot must decide.
    #[must_use]
    pub fn sufficient(&self, depth: u32) -> Option<Duration> {
        depth.checked_sub(2).filter(|motions| *motions > 0).map(|motions| self.longest / motions)
    }

    /// Returns the length of motion below which `depth` slots are sure to starve; with a single slot every motion
    /// starves.
    #[must_use]
    pub fn necessary(&self, depth: u32) -> Duration {
        depth
            .checked_sub(1)
            .filter(|motions| *motions > 0)
            .map_or(Duration::MAX, |motions| self.shortest / motions)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn setup_a_needs_motions_of_a_third_of_its_round_trip() {
        let trip = RoundTrip::of(&setup::setup("A").unwrap());
        // 2 · 4 ms of the robot, 2 · 1 ms of the bus, a scan of 1 ms that costs 0.15 ms, twice 25 µs of cable.
        assert_eq!(trip.longest, Duration::from_micros(11_200));
        assert_eq!(trip.shortest, Duration::from_micros(200));
        assert_eq!(trip.sufficient(5), Some(trip.longest / 3));
        assert_eq!((trip.sufficient(2), trip.necessary(1)), (None, Duration::MAX));
    }
}
