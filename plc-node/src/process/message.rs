//! Messages of a PLC, instructions to it, and the orders to its cyclic thread.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::{Execution, ExecutionType, MarkPassage, OverrideError, OverrideSchedule, PlcEvent, StartError};

/// A message that only a PLC sends.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PlcMessage {
    /// The connection is up, but the robot marks its data as bad.
    ImageBad,
    /// The robot marks its data as good again.
    ImageGood,
    /// The robot's life counter has never moved on this connection.
    LifeStill,
    /// The arm does not stand where a run starts and is moved there.
    MovingToStart,
    /// The robot is connected and ready, and the arm where a run starts: a run may start.
    Ready,
    /// The start edge of a run was set.
    Started {
        /// How the sequence is run.
        execution_type: ExecutionType,
        /// Start of the scan with the start edge, in ns of `CLOCK_MONOTONIC`.
        at_ns: u64,
        /// Number of the last command before those of the run.
        after: u16,
    },
    /// The arms of a mark have all come to it, and this one goes on.
    Passed {
        /// Number of the mark.
        mark: u32,
        /// Start of the first scan that saw the arm stand there, in ns of `CLOCK_MONOTONIC`.
        came_ns: u64,
        /// Start of the scan that let it go on.
        passed_ns: u64,
    },
    /// The run ended as wanted.
    Finished(Execution),
    /// The run ended otherwise, or was not started.
    Failed {
        /// How the sequence was to be run.
        execution_type: ExecutionType,
        /// Why not, in words.
        reason: String,
    },
    /// An instruction was refused; a run in progress continues.
    Refused {
        /// Why not, in words.
        reason: String,
    },
}

impl fmt::Display for PlcMessage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::ImageBad => f.write_str(
                "the robot marks its data as bad, although the connection is up: look at its node, and whether it has \
                 another controller",
            ),
            Self::ImageGood => f.write_str("the robot marks its data as good again"),
            Self::LifeStill => f.write_str(
                "warning: the robot's life counter does not move, so no run can start: look at its node; it adds 1 in each \
                 cycle",
            ),
            Self::MovingToStart => f.write_str("moving the arm to the application's start"),
            Self::Ready => f.write_str("robot ready"),
            Self::Started { execution_type, .. } => write!(f, "{execution_type} started"),
            Self::Passed { mark, came_ns, passed_ns } => {
                let waited_ms = passed_ns.saturating_sub(*came_ns) as f64 / 1e6;
                write!(f, "mark {mark} passed after a wait of {waited_ms:.3} ms")
            }
            Self::Finished(run) => {
                let ms = |ns: u64| ns as f64 / 1e6;
                let Execution { execution_type, motions, blends_suppressed, frames, .. } = run;
                // Lost on the way or never sent, because the robot's host delayed it: only both nodes together know which.
                write!(
                    f,
                    "{execution_type} {:9.3} ms, by the robot's clock {:9.3} ms; {motions} motions, \
                     {blends_suppressed} blends suppressed, {} frames missing",
                    ms(run.execution_time_ns),
                    ms(run.robot_execution_ns),
                    frames.lost
                )
            }
            Self::Failed { execution_type, reason } => write!(f, "{execution_type} failed: {reason}"),
            Self::Refused { reason } => write!(f, "refused: {reason}"),
        }
    }
}

/// An instruction that only a PLC receives.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum PlcInstruction {
    /// Run the sequence once.
    Start {
        /// How.
        execution_type: ExecutionType,
        /// What becomes of the override meanwhile; without it the override stays as it is.
        #[serde(default, rename = "override", skip_serializing_if = "Option::is_none")]
        overrides: Option<OverrideSchedule>,
    },
    /// Set the override, in a run or between two.
    SetOverride {
        /// In percent of every programmed speed, 0 to 100; 0 stops the arm on its path.
        percent: f64,
    },
    /// Give the run up.
    Abort,
}

/// What the owner of a PLC may want of it.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum PlcOrder {
    /// Run the sequence once, with this schedule of overrides.
    Start(ExecutionType, Option<OverrideSchedule>),
    /// Set the override, in percent.
    SetOverride(f64),
    /// Give the run up.
    Abort,
}

/// An order that a PLC does not follow.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum PlcRefusal {
    /// A run is not started.
    Start {
        /// How it was to be run.
        execution_type: ExecutionType,
        /// Why not.
        error: StartError,
        /// Index of the station that is the reason; `None` if that is none.
        station: Option<usize>,
    },
    /// The override stays as it is.
    Override(OverrideError),
}

impl From<PlcInstruction> for PlcOrder {
    fn from(instruction: PlcInstruction) -> Self {
        match instruction {
            PlcInstruction::Start { execution_type, overrides } => Self::Start(execution_type, overrides),
            PlcInstruction::SetOverride { percent } => Self::SetOverride(percent),
            PlcInstruction::Abort => Self::Abort,
        }
    }
}

pub(super) fn message(event: &PlcEvent) -> Option<PlcMessage> {
    Some(match event {
        PlcEvent::Link(_) | PlcEvent::Waiting { .. } => return None,
        PlcEvent::ImageBad => PlcMessage::ImageBad,
        PlcEvent::ImageGood => PlcMessage::ImageGood,
        PlcEvent::LifeStill => PlcMessage::LifeStill,
        PlcEvent::MovingToStart => PlcMessage::MovingToStart,
        PlcEvent::Ready => PlcMessage::Ready,
        PlcEvent::Started { execution_type, at, after } => {
            PlcMessage::Started { execution_type: *execution_type, at_ns: at.as_nanos(), after: *after }
        }
        PlcEvent::Passed(MarkPassage { mark, came, passed }) => PlcMessage::Passed {
            mark: *mark,
            came_ns: came.as_nanos(),
            passed_ns: passed.unwrap_or(*came).as_nanos(),
        },
        PlcEvent::Finished(run) => PlcMessage::Finished(*run),
        PlcEvent::Failed(failure) => {
            PlcMessage::Failed { execution_type: failure.execution_type, reason: failure.cause.to_string() }
        }
    })
}

pub(super) fn refusal(refusal: PlcRefusal) -> PlcMessage {
    match refusal {
        // The run under way has not failed: it continues.
        PlcRefusal::Start { error: error @ StartError::Running(_), .. } => {
            PlcMessage::Refused { reason: error.to_string() }
        }
        PlcRefusal::Start { execution_type, error, .. } => {
            PlcMessage::Failed { execution_type, reason: error.to_string() }
        }
        PlcRefusal::Override(error) => PlcMessage::Refused { reason: error.to_string() },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_start_during_a_run_is_refused_and_any_other_start_that_is_not_possible_has_failed() {
        let start = |error| PlcRefusal::Start { execution_type: ExecutionType::Cm, error, station: None };
        let during = refusal(start(StartError::Running(ExecutionType::Sm)));
        let reason = "a run of sm is under way; wait for its end or abort it".to_owned();
        assert_eq!(during, PlcMessage::Refused { reason });
        let unconnected = refusal(start(StartError::NotConnected));
        assert!(matches!(unconnected, PlcMessage::Failed { execution_type: ExecutionType::Cm, .. }));
    }
}
