//! A repetition that failed, at each arm of a cell: when it came to rest, and how far it went after the first one had.

use serde::{Deserialize, Serialize};

use crate::trace::Recording;

/// Speed of the tool in mm/s below which an arm counts as standing.
pub const STANDS_MM_S: f32 = 1.0;

/// The arms in a repetition that failed.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct CellStop {
    /// Its number among the repetitions of its type, counted from 1.
    pub repetition: u32,
    /// Each station, in the order of the setup.
    pub stations: Vec<StationStop>,
}

/// An arm in a repetition that failed.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub struct StationStop {
    /// End of its last motion since the start edge, in ms of true time; null if it did not move.
    pub stopped_at_ms: Option<f64>,
    /// Way of its tool after the first arm had come to rest for good, in mm.
    pub way_after_mm: f64,
    /// Marks that it had passed.
    pub marks_passed: u32,
}

impl CellStop {
    /// Takes the recordings of a repetition that failed, which go on until the arms stand.
    #[must_use]
    pub fn of(repetition: u32, stations: &[Recording]) -> Self {
        let stopped = |recording: &Recording| {
            let mut ticks = recording.robot_ticks().iter().rev();
            ticks.find(|tick| tick.sample.path_speed_mm_s >= STANDS_MM_S).map(|tick| tick.at_ms)
        };
        let first_ms = stations.iter().filter_map(stopped).reduce(f64::min);
        let station = |recording: &Recording| StationStop {
            stopped_at_ms: stopped(recording),
            way_after_mm: first_ms.map_or(0.0, |first_ms| way_mm(recording, first_ms)),
            marks_passed: recording
                .plc_scans()
                .iter()
                .map(|scan| scan.sample.marks_passed)
                .max()
                .unwrap_or(0),
        };
        Self { repetition, stations: stations.iter().map(station).collect() }
    }

    /// Returns what each arm did, with the names of the stations.
    #[must_use]
    pub fn sentence(&self, names: &[&str]) -> String {
        let arms = names.iter().zip(&self.stations).map(|(name, arm)| match arm.stopped_at_ms {
            None => format!("{name} did not move"),
            Some(at_ms) => format!(
                "{name} stood from {:.3} s on, after {:.1} mm since the first arm stood",
                at_ms / 1e3,
                arm.way_after_mm
            ),
        });
        arms.collect::<Vec<_>>().join("; ")
    }
}

/// Returns the way of the tool after an instant, in mm.
fn way_mm(recording: &Recording, after_ms: f64) -> f64 {
    let steps = recording.robot_ticks().windows(2).filter_map(|pair| pair.first().zip(pair.last()));
    let after = steps.filter(|(before, _)| before.at_ms >= after_ms);
    after
        .map(|(before, tick)| f64::from(tick.sample.path_speed_mm_s) * (tick.at_ms - before.at_ms) / 1e3)
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::RobotTick;

    #[test]
    fn the_way_of_an_arm_counts_from_where_the_first_one_stands() {
        let moving = |until_ms: u32| {
            let mut recording = Recording::default();
            for at_ms in (0..1_000).step_by(4) {
                let speed = if at_ms <= until_ms { 100.0 } else { 0.0 };
                let sample = robot_node::Sample { path_speed_mm_s: speed, ..robot_node::Sample::default() };
                recording.robot(RobotTick { at_ms: at_ms.into(), true_ns: 0, sample });
            }
            recording
        };
        let stop = CellStop::of(3, &[moving(400), moving(600), Recording::default()]);
        let [killed, other, still] = &stop.stations[..] else { panic!("three stations") };
        assert_eq!((killed.stopped_at_ms, killed.way_after_mm), (Some(400.0), 0.0));
        assert_eq!(other.stopped_at_ms, Some(600.0));
        assert!((other.way_after_mm - 20.0).abs() < 1e-9, "{}", other.way_after_mm);
        assert_eq!(still.stopped_at_ms, None);
        let said = stop.sentence(&["left", "right", "third"]);
        assert_eq!(
            said,
            "left stood from 0.400 s on, after 0.0 mm since the first arm stood; right stood from 0.600 s on, after 20.0 mm since \
             the first arm stood; third did not move"
        );
    }
}
