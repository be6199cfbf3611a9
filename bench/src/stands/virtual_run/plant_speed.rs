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

impl fmt::Display for PlantSpeed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (plant, host) = (self.plant.as_secs_f64(), self.host.as_secs_f64());
        write!(f, "virtual: {plant:.1} s of the plant in {host:.2} s, {:.0} ×", plant / host)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_speed_is_printed_in_seconds_of_the_plant_and_of_the_host_and_as_their_ratio() {
        let speed = PlantSpeed { plant: Duration::from_millis(348_400), host: Duration::from_millis(310) };
        assert_eq!(speed.to_string(), "virtual: 348.4 s of the plant in 0.31 s, 1124 ×");
    }
}
