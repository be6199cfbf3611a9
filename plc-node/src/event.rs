//! The events of a PLC node.

use core::{fmt, str::FromStr};
use std::collections::VecDeque;

use machine::Instant;
use protocol::fieldbus::{Counters, Down, LinkEvent};
use protocol::image::{ErrorNumber, Finding, State};
use serde::{Deserialize, Serialize};

use crate::advice::advice;
use crate::exported_program::{ProgramTrap, exported_in_words};
use crate::function_blocks::BlockError;
use crate::{MarkPassage, WaitingFor};

/// How a sequence is run: the paper's execution types (section 6.2).
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Debug, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ExecutionType {
    /// Programmed in the robot controller; the PLC starts the program.
    Rc,
    /// Single motions from the PLC, each started when the one before is done.
    Sm,
    /// One MoveContinuousSkill from the PLC.
    Cm,
}

impl ExecutionType {
    /// All three, in the order of the paper's Table 2.
    pub const ALL: [Self; 3] = [Self::Rc, Self::Sm, Self::Cm];
}

impl fmt::Display for ExecutionType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Rc => "rc",
            Self::Sm => "sm",
            Self::Cm => "cm",
        })
    }
}

impl FromStr for ExecutionType {
    type Err = UnknownExecutionType;

    fn from_str(name: &str) -> Result<Self, UnknownExecutionType> {
        let known = Self::ALL.into_iter().find(|known| known.to_string().eq_ignore_ascii_case(name));
        known.ok_or_else(|| UnknownExecutionType(name.to_owned()))
    }
}

/// A name that is no execution type.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error(
    "there is no execution type `{0}`: rc runs the robot's program, sm single motions, cm one MoveContinuousSkill"
)]
pub struct UnknownExecutionType(pub String);

/// An event of a PLC, and the station that it concerns.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct PlcReport {
    /// Index of the station; `None` where it concerns all of them.
    pub station: Option<usize>,
    /// What happened.
    pub event: PlcEvent,
}

/// The events of a PLC that its owner has not taken yet.
#[derive(Debug)]
pub(crate) struct Events {
    queue: VecDeque<PlcReport>,
    capacity: usize,
}

/// More events of a station than one handler can cause; the owner drains them after each.
const EVENTS: usize = 16;

impl Events {
    pub(crate) fn for_stations(count: usize) -> Self {
        let capacity = EVENTS * count.max(1);
        Self { queue: VecDeque::with_capacity(capacity), capacity }
    }

    /// Adds an event of a station. The capacity taken at the start is never exceeded.
    pub(crate) fn push(&mut self, station: usize, event: PlcEvent) {
        self.add(PlcReport { station: Some(station), event });
    }

    /// Adds an event of all stations.
    pub(crate) fn push_for_all(&mut self, event: PlcEvent) {
        self.add(PlcReport { station: None, event });
    }

    fn add(&mut self, report: PlcReport) {
        if self.queue.len() < self.capacity {
            self.queue.push_back(report);
        }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.queue.is_empty()
    }

    pub(crate) fn pop(&mut self) -> Option<PlcReport> {
        self.queue.pop_front()
    }
}

/// What happens at a station, or in the PLC.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum PlcEvent {
    /// News of the connection.
    Link(LinkEvent),
    /// The connection is up, but the robot marks its data as bad: the PLC has no image of it.
    ImageBad,
    /// The robot marks its data as good again.
    ImageGood,
    /// The robot's life counter has never moved on this connection, although its images arrive.
    LifeStill,
    /// The arm does not stand where a run starts and is moved there.
    MovingToStart,
    /// The robot is connected and ready, and the arm stands where a run starts: a run may start. The event comes again
    /// after each run and each lost connection. It also comes if the arm could not be moved to the start: the next run
    /// tries again, and reports the reason if that fails.
    Ready,
    /// The scan at `at` set the start edge of a run.
    Started {
        /// How the sequence is run.
        execution_type: ExecutionType,
        /// Start of that scan.
        at: Instant,
        /// Number of the last command before those of the run.
        after: u16,
    },
    /// The arms of a mark have all come to it, and this one goes on.
    Passed(MarkPassage),
    /// The run ended as wanted.
    Finished(Execution),
    /// The run ended otherwise.
    Failed(Failure),
    /// The PLC waits, and has waited for this long without any progress. The event comes again every ten seconds.
    Waiting {
        /// What it waits for.
        for_what: WaitingFor,
        /// Time since the last progress, in s.
        seconds: u32,
    },
}

/// A finished run.
///
/// The execution time is taken between the starts of two scans: of the one whose program sets the start edge, and of
/// the one whose inputs show the end. Both are the times at which those scans did read their inputs, not the grid
/// points that they stand for: where the host delays a scan, the edge is set or the end is seen later, and a grid
/// point would hide it. A PLC program that reads its clock at the top of the scan measures the same. What the first
/// scan costs until its outputs are written is part of the time; what the last one costs is not.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub struct Execution {
    /// How the sequence was run.
    pub execution_type: ExecutionType,
    /// From the start edge to the end seen, on the PLC, in ns.
    pub execution_time_ns: u64,
    /// The robot's own measure in ns; for SM the sum over its skills, which leaves out the time between them.
    pub robot_execution_ns: u64,
    /// Motions that the robot counted as executed.
    pub motions: u32,
    /// Motions that were run to a stop because the next one was not there in time.
    pub blends_suppressed: u32,
    /// Scans from the one with the start edge to the one that saw the end; 0 if they were one.
    pub scans: u64,
    /// Frames of the bus during the run.
    pub frames: Counters,
    /// What the PLC commanded.
    pub commanded: Commanded,
    /// What the PLC saw of the robot; `None` from a PLC of an older version.
    #[serde(default)]
    pub seen: Option<Seen>,
    /// Number of the last command to this robot before those of the run; `None` from a PLC of an older version.
    #[serde(default)]
    pub after: Option<u16>,
    /// Time for which the arm stood before shared zones until they were granted, in ns; `None` in a cell without such zones, and from
    /// a PLC of an older version.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub zone_wait_ns: Option<u64>,
}

/// What the PLC saw of the robot in a run, by its images alone.
#[derive(Clone, Copy, PartialEq, Default, Debug, Serialize, Deserialize)]
pub struct Seen {
    /// Joints in the scan that set the start edge, in degrees (mm).
    pub start: [f32; 6],
    /// Pose of the tool in the base at the end: mm and degrees.
    pub end_pose: [f32; 6],
    /// Time by the robot's own clock from that scan to the end, in ns; 0 if its images have no clock.
    pub clock_ns: u64,
}

/// What the PLC commanded in a run, and what it saw of the arm at the end.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub struct Commanded {
    /// Number of motions that it sent; 0 with RC.
    pub motions: u64,
    /// Their digest, as [`protocol::image::Sum`] has it.
    pub digest: u64,
    /// Lowest and highest override, in %.
    pub override_percent: [u8; 2],
    /// Joints of the robot's last image, in degrees (mm).
    pub end: [f32; 6],
}

/// A run that did not end as wanted.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
#[error("{execution_type} failed with {executed} motions executed: {cause}")]
pub struct Failure {
    /// How the sequence was run.
    pub execution_type: ExecutionType,
    /// Motions of the sequence that the robot had counted as executed.
    pub executed: u32,
    /// Why.
    pub cause: FailureCause,
}

/// Why a run did not end as wanted.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum FailureCause {
    /// The connection went down.
    #[error(
        "the connection to the robot was lost: {0}; the run can be repeated once the robot is ready again"
    )]
    ConnectionLost(Down),
    /// The bus says that it is connected, but has no image of the robot.
    #[error("the bus holds no image of the robot; the robot marks its data as bad, look at its node")]
    NoImage,
    /// The robot refused or ended a skill.
    #[error("{}", robot_in_words(*number, *motion, finding))]
    Robot {
        /// What the robot says.
        number: ErrorNumber,
        /// Which motion of the sequence, counted from 0.
        motion: u32,
        /// The quantity and its limits.
        finding: Finding,
    },
    /// No frame of the robot arrived.
    #[error(
        "no frame came from the robot for {scans} scans: its cable is cut, frames are lost, or its node stands still"
    )]
    RobotUnheard {
        /// Scans in which its image did not change.
        scans: u32,
    },
    /// No image of the robot arrived as it was sent.
    #[error(
        "every image of the robot had a wrong check for {scans} scans and was refused: bytes are altered on the way, look at \
         cables, switches and gateways"
    )]
    RobotAltered {
        /// Scans in which no image was taken over.
        scans: u32,
    },
    /// All images of the robot were refused because of their life counters.
    #[error(
        "every image of the robot was refused for {scans} scans: its life counter ran backwards or too fast; frames are old, \
         or `robot.cycle_us` is not the robot's cycle"
    )]
    RobotOutdated {
        /// Scans in which no image was taken over.
        scans: u32,
    },
    /// The robot's life counter stood still, although its frames arrived.
    #[error(
        "the robot's life counter stood still for {scans} scans, although frames came from it: its controller does not \
         run, look at its node"
    )]
    RobotSilent {
        /// Scans in which it did not change.
        scans: u32,
    },
    /// The robot is alive, but neither moves nor counts nor ends its skill.
    #[error(
        "for {seconds} s the arm has not moved and the robot (state {state:?}) has neither counted a motion nor ended its \
         skill: look at its drives and its program"
    )]
    NoProgress {
        /// Time without progress, in s.
        seconds: u32,
        /// The robot's state.
        state: State,
    },
    /// The way to the start leads through a shared zone that another arm is in, or may be in.
    #[error(
        "for {seconds} s the way to the start was not free: another arm is in a shared zone on it, or its place is not known; lead \
         that arm out, or connect it"
    )]
    ZoneTaken {
        /// Time without progress, in s.
        seconds: u32,
    },
    /// A stored program went beyond a mark before the other arms had come.
    #[error(
        "the robot's program did not wait at mark {mark}: compare the digital outputs and inputs of its program with `plc-node plan`"
    )]
    MarkIgnored {
        /// Number of the mark.
        mark: u32,
    },
    /// The owner of the PLC gave the run up.
    #[error("the run was aborted on the PLC")]
    Aborted,
    /// The robot gave the skill up although the PLC did not ask for it.
    #[error("the robot gave the skill up although the PLC did not ask for it; was it halted by hand?")]
    RobotHalted,
    /// The arm could not be moved to where the run starts.
    #[error("the arm did not get to the application's `start`: {}", at_start_in_words(.0))]
    StartNotReached(BlockError),
    /// The exported code ended the run with this `error_id`; 0 if it ended without `done` and `error`.
    #[error("{}", exported_in_words(*.0))]
    Exported(u16),
    /// The exported code went wrong.
    #[error("{0}")]
    Trapped(ProgramTrap),
    /// A function block found something that must not be.
    #[error("at motion {} of the plan: {error}", motion.saturating_add(1))]
    Block {
        /// What it found.
        error: BlockError,
        /// Which motion of the sequence, counted from 0.
        motion: u32,
    },
}

impl FailureCause {
    /// Returns the motion of the sequence, counted from 0, at which it happened; `None` if it has nothing to do with one.
    #[must_use]
    pub const fn motion(&self) -> Option<u32> {
        match self {
            Self::Robot { motion, .. } | Self::Block { motion, .. } => Some(*motion),
            _ => None,
        }
    }
}

/// Formats a robot's error number and findings as text. The image counts motions from 0, a printed plan from 1.
fn robot_in_words(number: ErrorNumber, motion: u32, finding: &Finding) -> String {
    if number == ErrorNumber::None {
        return format!(
            "the robot ended the skill at motion {} of the plan with an error but without its number: look at its node",
            motion.saturating_add(1)
        );
    }
    let (code, words) = (u16::from(number), finding.in_words(number));
    let advice = advice(number).unwrap_or("correct that motion");
    format!(
        "the robot reports error {code} at motion {} of the plan: {words}; {advice}",
        motion.saturating_add(1)
    )
}

/// Formats an error on the way to the start with what to do about it, which other errors than the robot's say themselves.
fn at_start_in_words(error: &BlockError) -> String {
    match error {
        BlockError::Robot { number, .. } => {
            format!("{error}; {}", advice(*number).unwrap_or("correct the frame that `start` names"))
        }
        _ => error.to_string(),
    }
}

/// Why a run was not started.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum StartError {
    /// There is no connection.
    #[error("the robot is not connected; wait for the connection to come up")]
    NotConnected,
    /// The robot is connected but not ready.
    #[error(
        "the robot is not ready (state {state:?}, error: {error}); it is being reset, wait until it is ready"
    )]
    NotReady {
        /// The robot's state.
        state: State,
        /// The robot's error.
        error: ErrorNumber,
    },
    /// A run is under way.
    #[error("a run of {0} is under way; wait for its end or abort it")]
    Running(ExecutionType),
    /// SM and CM have nothing to run.
    #[error("the application has no motions, so there is nothing for {0} to run")]
    NoMotions(ExecutionType),
    /// An arm is to move together with others, and its robot does not serve that; with the index of the station.
    #[error(
        "the robot does not serve SYNC (services, bit 0), so it cannot move together with others; \
         run rc or sm, or remove `together` from the mark"
    )]
    NoSync(usize),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn execution_types_have_the_names_that_the_command_line_takes() {
        for execution_type in ExecutionType::ALL {
            assert_eq!(execution_type.to_string().parse(), Ok(execution_type));
        }
        assert_eq!("CM".parse(), Ok(ExecutionType::Cm));
        let unknown = "ptp".parse::<ExecutionType>().unwrap_err().to_string();
        assert!(unknown.starts_with("there is no execution type `ptp`: rc runs"), "{unknown}");
    }

    #[test]
    fn an_error_without_a_number_is_not_called_no_error() {
        let cause = FailureCause::Robot { number: ErrorNumber::None, motion: 3, finding: Finding::NONE };
        let words = cause.to_string();
        assert!(words.contains("without its number") && !words.contains("no error"), "{words}");
    }

    #[test]
    fn a_failure_says_what_was_run_how_far_it_came_what_is_wrong_and_what_to_do() {
        let failure = Failure {
            execution_type: ExecutionType::Sm,
            executed: 7,
            cause: FailureCause::Robot {
                number: ErrorNumber::AxisLimit,
                motion: 7,
                finding: Finding::new(3, 176.0, 0.0, 175.0),
            },
        };
        assert_eq!(
            failure.to_string(),
            "sm failed with 7 motions executed: the robot reports error 15 at motion 8 of the plan: \
             a joint would leave its range (joint 3 would be at 176, its range is 0 to 175); correct that motion"
        );
    }

    #[test]
    fn only_a_motion_that_is_wrong_is_to_be_corrected_and_any_other_error_says_what_to_do() {
        let words = |number: u16| {
            let cause = FailureCause::Robot { number: number.into(), motion: 0, finding: Finding::NONE };
            cause.to_string()
        };
        let of_motions = (0..=45).filter(|number| words(*number).ends_with("; correct that motion"));
        assert_eq!(of_motions.count(), 23);
        let others = (0..=45).map(words).filter(|words| !words.ends_with("; correct that motion"));
        insta::assert_snapshot!(others.collect::<Vec<_>>().join("\n"), @"
        the robot ended the skill at motion 1 of the plan with an error but without its number: look at its node
        the robot reports error 1 at motion 1 of the plan: the robot does not have this skill; use skills that this robot has
        the robot reports error 4 at motion 1 of the plan: no skill can start in this state; reset first; start again when the robot is ready
        the robot reports error 5 at motion 1 of the plan: the robot has no program of this number; store the program in the robot, or run sm or cm
        the robot reports error 6 at motion 1 of the plan: the skill has no motions; give the application motions
        the robot reports error 7 at motion 1 of the plan: motions were written over before the robot took them; look at how the PLC writes motions into the slots
        the robot reports error 12 at motion 1 of the plan: the override is not within 0 to 100 %; set an override of 0 to 100 %
        the robot reports error 17 at motion 1 of the plan: the connection to the PLC was lost while the skill ran; look at the cable and at the robot's log, and start again once the connection is up
        the robot reports error 18 at motion 1 of the plan: the PLC took back `enable` while the skill ran; enable the robot first and keep it enabled while a skill runs
        the robot reports error 31 at motion 1 of the plan: the checks of the command images are wrong: bytes are altered on the way, or the PLC computes them otherwise; look at cables, switches and gateways, and at the PLC's check
        the robot reports error 32 at motion 1 of the plan: the drive of an axis has a fault; see to the robot's drives
        the robot reports error 33 at motion 1 of the plan: the drive of an axis stopped without a command; see to the robot's drives
        the robot reports error 34 at motion 1 of the plan: the robot controller lost the connection to its drives; see to the robot's drives
        the robot reports error 36 at motion 1 of the plan: the contact force swings and does not settle; set the robot's force controller for this surface (`stiffest_n_per_mm`), or press on a softer one
        the robot reports error 37 at motion 1 of the plan: a skill of one motion needs `total` and `written` of 1; write 1 to `total` and `written` in the scan that calls the skill
        the robot reports error 38 at motion 1 of the plan: the life counters of the command images are refused: the images are old, or the PLC counts faster than the robot's setup says; add 1 to the life counter in each scan, and set `plc.scan_cycle_us` of the robot's setup to the PLC's scan
        the robot reports error 39 at motion 1 of the plan: following error: an axis was too far from its set-point; look for what holds the axis, reset, and start again
        the robot reports error 40 at motion 1 of the plan: an axis did not arrive at its set-point within the settling time; look for what holds the axis, reset, and start again
        the robot reports error 41 at motion 1 of the plan: the drives did not switch on after a reset; see to the robot's drives
        the robot reports error 42 at motion 1 of the plan: the robot does not serve a suspend or a start time; leave out the start time, and do not suspend this robot
        the robot reports error 43 at motion 1 of the plan: the robot does not take compact points; set robot.compact_points, or send the motions by MoveContinuous
        the robot reports error 44 at motion 1 of the plan: the head of the compact points cannot be used; correct the head of the compact points
        the robot reports error 45 at motion 1 of the plan: error number 45; look the number up in the robot's manual
        ");
    }

    #[test]
    fn a_start_that_was_not_reached_says_what_to_do_by_the_error() {
        let of_robot = |number| BlockError::Robot { number, motion: 0, finding: Finding::NONE };
        let numbers =
            [ErrorNumber::None, ErrorNumber::ConnectionLost, ErrorNumber::Disabled, ErrorNumber::Unreachable];
        let errors = numbers.map(of_robot).into_iter().chain([BlockError::NotConnected]);
        let words: Vec<_> = errors.map(|error| FailureCause::StartNotReached(error).to_string()).collect();
        insta::assert_snapshot!(words.join("\n"), @"
        the arm did not get to the application's `start`: the robot ended the skill with an error but without its number (motion 0, counted from 0); look at the robot's node
        the arm did not get to the application's `start`: the robot reports error 17: the connection to the PLC was lost while the skill ran (motion 0, counted from 0); look at the cable and at the robot's log, and start again once the connection is up
        the arm did not get to the application's `start`: the robot reports error 18: the PLC took back `enable` while the skill ran (motion 0, counted from 0); enable the robot first and keep it enabled while a skill runs
        the arm did not get to the application's `start`: the robot reports error 14: the target is out of the arm's reach (motion 0, counted from 0); correct the frame that `start` names
        the arm did not get to the application's `start`: no connection to the robot; start again once it is up
        ");
    }
}
