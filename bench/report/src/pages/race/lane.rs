//! What the page shows of one recording: the arm's joints and speed over time, where it stands still, the motions done and
//! the five slots.
//!
//! Columns are coded as differences of whole numbers, which keeps the page small: the value is their sum so far, times the
//! unit of the column.

use plc_node::ExecutionType;
use protocol::image::SLOTS;
use serde::Serialize;

use super::super::end::End;
use super::numbering::Numbering;
use crate::figures::how;
use crate::progress::label;
use records::trace::{PlcScan, Recording, RobotTick};

/// Ticks that are shown at most, so that a page stays below a few MB; of a longer recording every second or third.
const TICKS: usize = 10_000;

/// Speed of the tool in mm/s below which it counts as standing still, if it stays below for [`STILL_MS`].
const STILL_MM_S: f32 = 1.0;
/// Shortest standstill that is shown, in ms. Where the tool turns back on its path it is slow for a cycle or two, which is
/// too short to be seen.
const STILL_MS: f64 = 20.0;

/// Units of the columns.
const TIME_MS: f64 = 0.1;
const JOINT: f64 = 0.001;
const SPEED_MM_S: f64 = 0.1;

/// One recording.
#[derive(Serialize, Debug)]
pub(super) struct Lane {
    /// Name of the type in lower case.
    pub(super) key: String,
    pub(super) name: String,
    pub(super) how: &'static str,
    /// Time of the PLC's last scan, in ms.
    pub(super) end_ms: f64,
    pub(super) end: End,
    pub(super) is_program: bool,
    /// Stretches in which the tool stands still between its first and its last movement, in ms.
    pub(super) still_ms: Vec<[f64; 2]>,
    /// The motions done, each time that they become more: ms and number.
    pub(super) done: Vec<(f64, u32)>,
    /// The slots, each time that they change: ms, and the number of the motion in each; 0 is an empty slot.
    slots: Vec<(f64, [u32; SLOTS])>,
    /// Columns over the ticks.
    times: Vec<i64>,
    joints: Vec<Vec<i64>>,
    speeds: Vec<i64>,
    #[serde(skip)]
    pub(super) fastest_mm_s: f32,
}

/// Units of the columns, for the page.
#[derive(Serialize, Debug)]
pub(super) struct Units {
    time_ms: f64,
    joint: f64,
    speed_mm_s: f64,
}

pub(super) const UNITS: Units = Units { time_ms: TIME_MS, joint: JOINT, speed_mm_s: SPEED_MM_S };

impl Lane {
    /// Returns what a recording that ends like this shows of an arm with so many joints; `None` without ticks.
    pub(super) fn of(
        execution_type: ExecutionType,
        end: End,
        recording: &Recording,
        axes: usize,
    ) -> Option<Self> {
        let ticks: Vec<_> = recording.robot_ticks().iter().filter(|tick| tick.at_ms >= 0.0).collect();
        let last = ticks.last()?;
        let scans = recording.plc_scans();
        let every = ticks.len().div_ceil(TICKS).max(1);
        let shown: Vec<_> = ticks.iter().step_by(every).chain((every > 1).then_some(last)).copied().collect();
        let column =
            |value: &dyn Fn(&RobotTick) -> f64, unit| differences(shown.iter().map(|tick| value(tick)), unit);
        let joint =
            |axis: usize| column(&|tick| tick.sample.joints.get(axis).copied().unwrap_or_default(), JOINT);
        Some(Self {
            key: execution_type.to_string(),
            name: label(execution_type),
            how: how(execution_type),
            end_ms: recording.end_ms(),
            end,
            is_program: execution_type == ExecutionType::Rc,
            still_ms: still(&ticks),
            done: done(&ticks, scans),
            slots: slots(scans),
            times: column(&|tick| tick.at_ms, TIME_MS),
            joints: (0..axes).map(joint).collect(),
            speeds: column(&|tick| f64::from(tick.sample.path_speed_mm_s), SPEED_MM_S),
            fastest_mm_s: ticks.iter().map(|tick| tick.sample.path_speed_mm_s).fold(0.0, f32::max),
        })
    }

    /// Returns the time of the PLC's last scan in s.
    pub(super) fn end_s(&self) -> f64 {
        self.end_ms / 1e3
    }

    /// Returns for how long the arm stands still between its motions, in ms.
    pub(super) fn total_still_ms(&self) -> f64 {
        self.still_ms.iter().fold(0.0, |sum, [from, to]| sum + (to - from))
    }
}

/// Codes a column.
fn differences(values: impl Iterator<Item = f64>, unit: f64) -> Vec<i64> {
    let mut before = 0;
    values
        .map(|value| {
            let whole = (value / unit).round() as i64;
            whole - std::mem::replace(&mut before, whole)
        })
        .collect()
}

/// Returns the stretches in which the tool stands still, from its first movement to its last.
fn still(ticks: &[&RobotTick]) -> Vec<[f64; 2]> {
    let is_still = |tick: &&&RobotTick| tick.sample.path_speed_mm_s < STILL_MM_S;
    let moves = |tick: &&RobotTick| !is_still(&tick);
    let (Some(first), Some(last)) = (ticks.iter().position(moves), ticks.iter().rposition(moves)) else {
        return Vec::new();
    };
    let between = ticks.get(first..=last).unwrap_or_default();
    let stretches = between.chunk_by(|one, other| is_still(&one) == is_still(&other));
    let ends = |stretch: &[&RobotTick]| match stretch {
        [first, .., last] if is_still(&first) => Some([first.at_ms, last.at_ms]),
        _ => None,
    };
    stretches.filter_map(ends).filter(|[from, to]| to - from >= STILL_MS).collect()
}

/// Returns the motions done over time. Until the robot has noticed the first command it reports the one before.
fn done(ticks: &[&RobotTick], scans: &[PlcScan]) -> Vec<(f64, u32)> {
    let is_of_run = |tick: &&&RobotTick| scans.iter().any(|scan| scan.sample.command == tick.sample.command);
    let mut numbering = Numbering::default();
    let mut changes: Vec<(f64, u32)> = vec![(0.0, 0)];
    let of_run = ticks.iter().skip_while(|tick| !is_of_run(tick));
    for tick in of_run {
        let done = numbering.done(&tick.sample);
        if changes.last().is_none_or(|(_, before)| done > *before) {
            changes.push((tick.at_ms, done));
        }
    }
    changes
}

/// Returns the slots over time.
fn slots(scans: &[PlcScan]) -> Vec<(f64, [u32; SLOTS])> {
    let mut numbering = Numbering::default();
    let mut changes: Vec<(f64, [u32; SLOTS])> = Vec::new();
    for scan in scans {
        let slots = numbering.slots(&scan.sample);
        if changes.last().is_none_or(|(_, last)| *last != slots) {
            changes.push((scan.at_us as f64 / 1e3, slots));
        }
    }
    changes
}

#[cfg(test)]
mod tests {
    use super::*;
    use protocol::image::State;

    fn tick(at_ms: f64, command: u16, executed: u32, path_speed_mm_s: f32) -> RobotTick {
        let joints = [at_ms, 0.0, 0.0, 0.0, 0.0, 0.0];
        let sample = robot_node::Sample {
            state: State::Running,
            command,
            executed,
            path_speed_mm_s,
            joints,
            ..robot_node::Sample::default()
        };
        RobotTick { at_ms, true_ns: 0, sample }
    }

    fn scan(at_us: i64, command: u16, written: u32, in_slots: u32) -> PlcScan {
        let sample =
            plc_node::Sample { command, total: written, written, in_slots, ..plc_node::Sample::default() };
        PlcScan { at_us, true_ns: 0, sample }
    }

    #[test]
    fn a_column_is_the_sum_of_its_differences() {
        let coded = differences([-0.5, 1.0, 0.25].into_iter(), 0.25);
        assert_eq!(coded, [-2, 6, -3]);
    }

    #[test]
    fn the_slots_count_the_motions_of_all_commands_and_a_sixth_motion_lies_in_the_first_slot() {
        let scans = [scan(0, 7, 1, 1), scan(1_000, 7, 1, 0), scan(2_000, 8, 6, 5), scan(3_000, 8, 6, 5)];
        let expected = [(0.0, [1, 0, 0, 0, 0]), (1.0, [0; 5]), (2.0, [7, 3, 4, 5, 6])];
        assert_eq!(slots(&scans), expected);
    }

    #[test]
    fn the_motions_done_leave_out_the_command_before_the_run() {
        let ticks =
            [tick(0.0, 6, 13, 0.0), tick(4.0, 7, 0, 9.0), tick(8.0, 7, 1, 9.0), tick(12.0, 8, 1, 9.0)];
        let ticks: Vec<_> = ticks.iter().collect();
        let found = done(&ticks, &[scan(0, 7, 1, 1), scan(9_000, 8, 1, 1)]);
        assert_eq!(found, [(0.0, 0), (8.0, 1), (12.0, 2)]);
    }

    #[test]
    fn an_arm_that_waits_between_its_motions_stands_still_and_one_that_turns_back_does_not() {
        let speeds = [0.0, 0.0, 50.0, 0.0, 50.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 50.0, 0.0, 0.0];
        let ticks: Vec<_> = speeds
            .into_iter()
            .enumerate()
            .map(|(index, speed)| tick(index as f64 * 4.0, 1, 0, speed))
            .collect();
        let ticks: Vec<_> = ticks.iter().collect();
        assert_eq!(still(&ticks), [[20.0, 40.0]]);
    }

    #[test]
    fn of_a_long_recording_the_first_and_the_last_tick_are_shown() {
        let mut recording = Recording::default();
        (0..25_000).for_each(|index| recording.robot(tick(f64::from(index) * 4.0, 1, 0, 1.0)));
        let lane = Lane::of(ExecutionType::Cm, End::Done, &recording, 4).unwrap();
        assert!(lane.times.len() <= TICKS && lane.times.len() > TICKS / 2, "{}", lane.times.len());
        let last: i64 = lane.times.iter().sum();
        assert_eq!((lane.times[0], last), (0, 999_960));
    }
}
