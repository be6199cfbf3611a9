//! One repetition of a cell with several stations.

use std::time::Duration;

use crate::trace::Recording;

/// One repetition of a cell.
#[derive(Clone, PartialEq, Debug)]
pub struct CellSample {
    /// Execution time by the PLC.
    pub execution: Duration,
    /// True time between the first motions of the arms.
    pub start_skew: Option<Duration>,
    /// Largest difference of the arms' relative pose from the plan, in mm.
    pub relative_pose_mm: Option<f64>,
    /// Each station, in the order of the setup.
    pub stations: Vec<StationSample>,
}

/// One repetition at a station.
#[derive(Clone, PartialEq, Debug)]
pub struct StationSample {
    /// Execution time by the robot.
    pub robot_execution: Duration,
    /// Motions that ended in a stop because the next motion did not arrive in time.
    pub blends_suppressed: u32,
    /// Time for which the arm stood at marks.
    pub waited: Duration,
    /// Time for which the arm stood before shared zones; `None` in a cell without such zones.
    pub waited_for_zones: Option<Duration>,
    /// Each mark, and when the arm came to it, in true time.
    pub came: Vec<(u32, Duration)>,
}

impl CellSample {
    /// Returns the longest time between the arrivals of the arms at a mark; `None` in a cell without marks.
    #[must_use]
    pub fn worst_mark_skew(&self) -> Option<Duration> {
        mark_skews(&self.stations).into_iter().map(|(_, skew)| skew).max()
    }
}

/// Returns the true time between the first motions of the arms in a repetition; `None` where an arm did not move.
#[must_use]
pub fn start_skew(stations: &[Recording]) -> Option<Duration> {
    let began = |recording: &Recording| {
        let mut ticks = recording.robot_ticks().iter();
        ticks.find(|tick| tick.sample.path_speed_mm_s > 0.0).map(|tick| tick.true_ns)
    };
    let began: Vec<u64> = stations.iter().map(began).collect::<Option<_>>()?;
    Some(Duration::from_nanos(began.iter().max()? - began.iter().min()?))
}

/// Returns each mark in the order of the first arm that has it, and how far apart the arms came; a mark that is passed several
/// times counts each time.
pub(crate) fn mark_skews(stations: &[StationSample]) -> Vec<(u32, Duration)> {
    // Each passage of a mark: the mark, how often that arm had passed it before, and the first and the last arrival.
    let mut passages: Vec<(u32, usize, [Duration; 2])> = Vec::new();
    for station in stations {
        for (index, (mark, came)) in station.came.iter().enumerate() {
            let before = station.came.iter().take(index).filter(|(other, _)| other == mark).count();
            match passages.iter_mut().find(|(other, nth, _)| (other, *nth) == (mark, before)) {
                Some((.., [first, last])) => (*first, *last) = (*came.min(first), *came.max(last)),
                None => passages.push((*mark, before, [*came; 2])),
            }
        }
    }
    passages.into_iter().map(|(mark, _, [first, last])| (mark, last - first)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_skew_at_a_mark_is_between_the_first_and_the_last_arrival_each_time_it_is_passed() {
        let ms = Duration::from_millis;
        let station = |came: &[(u32, u64)]| StationSample {
            robot_execution: ms(1),
            blends_suppressed: 0,
            waited: ms(0),
            waited_for_zones: None,
            came: came.iter().map(|(mark, at)| (*mark, ms(*at))).collect(),
        };
        let stations = [station(&[(1, 10), (2, 20), (1, 40)]), station(&[(1, 13), (2, 15), (1, 41)])];
        assert_eq!(mark_skews(&stations), [(1, ms(3)), (2, ms(5)), (1, ms(1))]);
        let stations = [station(&[(1, 10)]), station(&[(1, 12), (3, 30)]), station(&[(3, 37)])];
        assert_eq!(
            mark_skews(&stations),
            [(1, ms(2)), (3, ms(7))],
            "a mark of the second and third arm alone"
        );
    }
}
