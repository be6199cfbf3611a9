//! Speed of a virtual run, for its output.

use std::fmt;
use std::time::Duration;

/// How much faster than the plant a virtual run was.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct PlantSpeed {
    /// Time that the plant would have taken.
    pub plant: Duration,
    /// Time that it took on this host.
    pub host: Duration,
}

impl PlantSpeed {
    /// Returns the speed of two runs that were begun together on two cores: the time of both plants in that of the longer one.
    #[must_use]
    pub fn beside(self, other: Self) -> Self {
        Self { plant: self.plant + other.plant, host: self.host.max(other.host) }
    }
}

impl fmt::Display for PlantSpeed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (plant, host) = (self.plant.as_secs_f64(), self.host.as_secs_f64());
        write!(f, "{plant:.1} s of the plant in {host:.2} s, {:.0} ×", plant / host)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_speed_is_printed_in_seconds_of_the_plant_and_of_the_host_and_as_their_ratio() {
        let speed = PlantSpeed { plant: Duration::from_millis(348_400), host: Duration::from_millis(310) };
        assert_eq!(speed.to_string(), "348.4 s of the plant in 0.31 s, 1124 ×");
    }

    #[test]
    fn two_runs_beside_each_other_take_the_time_of_the_longer_one() {
        let [long, short] = [(353, 600), (304, 550)].map(|(plant_s, host_ms)| PlantSpeed {
            plant: Duration::from_secs(plant_s),
            host: Duration::from_millis(host_ms),
        });
        for both in [long.beside(short), short.beside(long)] {
            assert_eq!(both.to_string(), "657.0 s of the plant in 0.60 s, 1095 ×");
        }
    }
}
