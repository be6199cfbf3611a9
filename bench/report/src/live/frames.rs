//! From the rows that the nodes write to the frames that the page draws.

use std::collections::VecDeque;

use machine::Instant;
use protocol::image::SLOTS;

use super::state::Frame;
use crate::pages::race::numbering::Numbering;

/// Shortest time between two frames, in ns: 30 frames a second.
const EVERY_NS: u64 = 33_000_000;

/// Rows of the robot that wait for the PLC's rows of the same time; more than both nodes' writers hold back.
const WAITING: usize = 4_096;

/// Puts the robot's cycles and the PLC's scans of one repetition side by side.
#[derive(Debug)]
pub(super) struct LiveFrames {
    /// Index of the arm.
    arm: usize,
    axes: usize,
    /// Time of the start edge, in ns of the nodes' clock.
    start_ns: Option<u64>,
    last_ns: Option<u64>,
    plc: VecDeque<(Instant, plc_node::Sample)>,
    robot: VecDeque<(Instant, robot_node::Sample)>,
    in_slots: Numbering,
    slots: [u32; SLOTS],
    executed: Numbering,
    /// The first command of the repetition.
    command: Option<u16>,
    /// Whether the robot has noticed that command; until then it reports the one before.
    is_noticed: bool,
    done: u32,
    /// Marks that the arm has come to, and those that it has passed.
    marks: [u32; 2],
}

impl LiveFrames {
    pub(super) fn new(arm: usize, axes: usize) -> Self {
        Self {
            arm,
            axes,
            start_ns: None,
            last_ns: None,
            plc: VecDeque::new(),
            robot: VecDeque::new(),
            in_slots: Numbering::default(),
            slots: [0; SLOTS],
            executed: Numbering::default(),
            command: None,
            is_noticed: false,
            done: 0,
            marks: [0; 2],
        }
    }

    /// Begins a repetition whose start edge was at this time.
    pub(super) fn start(&mut self, at_ns: u64) {
        let (plc, robot) = (std::mem::take(&mut self.plc), std::mem::take(&mut self.robot));
        *self = Self { start_ns: Some(at_ns), plc, robot, ..Self::new(self.arm, self.axes) };
    }

    /// Adds rows and returns the frames that they complete. Rows from before the start edge are left out.
    pub(super) fn add(
        &mut self,
        plc: impl IntoIterator<Item = (Instant, plc_node::Sample)>,
        robot: impl IntoIterator<Item = (Instant, robot_node::Sample)>,
    ) -> VecDeque<Frame> {
        self.plc.extend(plc);
        self.robot.extend(robot);
        let mut frames = VecDeque::new();
        while let Some((at, sample)) = self.robot.front().copied() {
            let is_paired = self.plc.back().is_some_and(|(last, _)| *last >= at);
            if !is_paired && self.robot.len() <= WAITING {
                break;
            }
            self.robot.pop_front();
            frames.extend(self.frame(at, &sample));
        }
        self.plc.drain(..self.plc.len().saturating_sub(WAITING));
        frames
    }

    /// Follows one cycle of the robot; returns its frame if the last one is long enough ago.
    fn frame(&mut self, at: Instant, sample: &robot_node::Sample) -> Option<Frame> {
        let start_ns = self.start_ns?;
        while let Some((scanned, scan)) = self.plc.pop_front_if(|(scanned, _)| *scanned <= at) {
            if scanned.as_nanos() >= start_ns {
                self.command.get_or_insert(scan.command);
                self.slots = self.in_slots.slots(&scan);
                self.marks = [scan.marks_come, scan.marks_passed];
            }
        }
        let since_ns = at.as_nanos().checked_sub(start_ns)?;
        self.is_noticed |= self.command == Some(sample.command);
        if self.is_noticed {
            self.done = self.done.max(self.executed.done(sample));
        }
        if self.last_ns.is_some_and(|last| since_ns < last + EVERY_NS) {
            return None;
        }
        self.last_ns = Some(since_ns);
        let joints = sample.joints.iter().take(self.axes);
        Some(Frame {
            arm: self.arm,
            marks: self.marks,
            at_ms: rounded(since_ns as f64 / 1e6, 10.0),
            joints: joints.map(|joint| rounded(*joint, 1e3)).collect(),
            speed_mm_s: rounded(f64::from(sample.path_speed_mm_s), 10.0),
            done: self.done,
            slots: self.slots,
        })
    }
}

/// Rounds to a share of one, which keeps the messages short.
fn rounded(value: f64, of_one: f64) -> f64 {
    (value * of_one).round() / of_one
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scan(at_ms: u64, command: u16, written: u32, in_slots: u32) -> (Instant, plc_node::Sample) {
        let sample = plc_node::Sample { command, written, in_slots, ..plc_node::Sample::default() };
        (Instant::from_nanos(at_ms * 1_000_000), sample)
    }

    fn cycle(at_ms: u64, command: u16, executed: u32) -> (Instant, robot_node::Sample) {
        let sample = robot_node::Sample { command, executed, ..robot_node::Sample::default() };
        (Instant::from_nanos(at_ms * 1_000_000), sample)
    }

    fn shown(frames: VecDeque<Frame>) -> Vec<(f64, u32, [u32; SLOTS])> {
        frames.into_iter().map(|frame| (frame.at_ms, frame.done, frame.slots)).collect()
    }

    #[test]
    fn a_frame_has_the_slots_of_its_time_and_the_motions_of_its_repetition() {
        let mut frames = LiveFrames::new(0, 4);
        frames.start(1_000_000_000);
        // The robot's rows are flushed first: they wait for those of the PLC.
        let cycles = [cycle(996, 6, 13), cycle(1_000, 6, 13), cycle(1_040, 7, 1), cycle(1_080, 8, 1)];
        assert_eq!(frames.add([], cycles), []);
        let scans = [scan(999, 6, 13, 5), scan(1_000, 7, 1, 1), scan(1_050, 8, 6, 5)];
        let first = shown(frames.add(scans, []));
        assert_eq!(first, [(0.0, 0, [1, 0, 0, 0, 0]), (40.0, 1, [1, 0, 0, 0, 0])]);
        let second = shown(frames.add([scan(1_080, 8, 6, 5)], []));
        assert_eq!(second, [(80.0, 2, [7, 3, 4, 5, 6])]);
    }

    #[test]
    fn a_frame_of_a_cell_names_its_arm_and_the_marks_that_it_has_come_to_and_passed() {
        let mut frames = LiveFrames::new(1, 6);
        frames.start(1_000_000_000);
        let at_mark = |at_ms: u64, come: u32, passed: u32| {
            let (at, sample) = scan(at_ms, 7, 2, 1);
            (at, plc_node::Sample { marks_come: come, marks_passed: passed, ..sample })
        };
        let scans = [at_mark(1_000, 0, 0), at_mark(1_040, 1, 0), at_mark(1_080, 1, 1), at_mark(1_120, 1, 1)];
        let found = frames.add(scans, [1_000, 1_040, 1_080].map(|at| cycle(at, 7, 1)));
        let found: Vec<_> = found.into_iter().map(|frame| (frame.arm, frame.marks)).collect();
        assert_eq!(found, [(1, [0, 0]), (1, [1, 0]), (1, [1, 1])]);
    }

    #[test]
    fn there_are_thirty_frames_a_second_and_none_before_the_first_start_edge() {
        let mut frames = LiveFrames::new(0, 4);
        let second = |from: u64| {
            let at = move |index: u64| from + index * 4;
            (
                (0..250).map(move |index| scan(at(index), 1, 1, 1)),
                (0..250).map(move |index| cycle(at(index), 1, 0)),
            )
        };
        let (scans, cycles) = second(0);
        assert_eq!(frames.add(scans, cycles), []);
        frames.start(1_000_000_000);
        let (scans, cycles) = second(1_000);
        assert_eq!(frames.add(scans, cycles).len(), 28, "each ninth cycle");
    }

    #[test]
    fn a_plc_that_writes_nothing_holds_no_memory_back() {
        let mut frames = LiveFrames::new(0, 4);
        frames.start(0);
        let given = frames.add([], (0..100_000).map(|index| cycle(index * 4, 1, 0)));
        assert!(!given.is_empty() && frames.robot.len() <= WAITING);
    }
}
