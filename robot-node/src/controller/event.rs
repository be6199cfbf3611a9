//! What the robot tells its owner.

use core::time::Duration;

use machine::Instant;
use protocol::fieldbus::LinkEvent;
use protocol::image::{ErrorNumber, Finding, Skill, State};

use super::{Account, DriveError};
use crate::arm::Violation;
use crate::{Quality, WaitingFor};

/// What happened in the robot.
#[derive(Clone, Copy, PartialEq, Debug)]
#[expect(clippy::large_enum_variant, reason = "a box would be an allocation on the cyclic thread")]
pub enum RobotEvent {
    /// News of the connection.
    Link(LinkEvent),
    /// Whether all images of the PLC are refused; reported when this changes. The end of a connection does not change it.
    ImagesRefused {
        /// On what ground.
        fault: ImageFault,
        /// Whether they are; otherwise one was accepted again.
        is_refused: bool,
    },
    /// The PLC's life counter has never moved on this connection, although its images arrive.
    LifeStill,
    /// The drives do not follow the set-points any more.
    DrivesFailed(DriveError),
    /// The robot waits, and has waited for this long. The event comes again every ten seconds.
    Waiting {
        /// What it waits for.
        for_what: WaitingFor,
        /// How long already, in s.
        seconds: u32,
    },
    /// The state machine changed its state.
    State(State),
    /// The interpreter took up a command.
    SkillStarted {
        /// Its command number.
        number: u16,
        /// What it executes.
        skill: Skill,
    },
    /// A skill ended.
    SkillFinished {
        /// Its command number.
        number: u16,
        /// What it executed.
        skill: Skill,
        /// How it ended.
        ending: Ending,
        /// Motions that were executed.
        executed: u32,
        /// From the tick that saw the command to the tick that reports the end.
        execution: Duration,
        /// When its first motion began; `None` if the arm did not move.
        began: Option<Instant>,
        /// How well the arm moved meanwhile.
        quality: Quality,
        /// What it did.
        account: Account,
    },
    /// A motion ended in an exact stop because the next motion had not arrived at its decision point.
    BlendSuppressed {
        /// Which motion of the skill, counted from 0.
        motion: u32,
    },
    /// A command was refused, or a motion of a running skill, which then stops after the last good one.
    Refused {
        /// The command's number.
        number: u16,
        /// What the feedback image says.
        error: ErrorNumber,
        /// Which motion of the skill, counted from 0.
        motion: u32,
        /// The quantity and its limit.
        cause: Violation,
    },
}

/// Why all images of the PLC are refused.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum ImageFault {
    /// Their checks are wrong.
    Altered,
    /// Their life counters are those of old images, or too far ahead.
    Outdated,
}

impl ImageFault {
    /// Returns what the feedback image says.
    pub(super) const fn number(self) -> ErrorNumber {
        match self {
            Self::Altered => ErrorNumber::WrongCheck,
            Self::Outdated => ErrorNumber::WrongLifeCounter,
        }
    }
}

/// How a skill ended.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Ending {
    /// All motions are executed.
    Done,
    /// Given up by a halt: the robot needs a reset.
    Halted,
    /// Given up by a cancel: the robot is ready for the next skill.
    Cancelled,
    /// Ended by an error.
    Fault {
        /// What is wrong.
        error: ErrorNumber,
        /// Which motion of the skill, counted from 0.
        motion: u32,
        /// The quantity and its limits.
        finding: Finding,
    },
}

impl Ending {
    /// Returns whether the robot is ready for the next skill after this ending.
    pub(super) const fn leads_to_ready(self) -> bool {
        matches!(self, Self::Done | Self::Cancelled)
    }

    /// Creates a fault that its error number describes completely.
    pub(super) const fn plain(error: ErrorNumber, motion: u32) -> Self {
        Self::Fault { error, motion, finding: Finding::NONE }
    }

    /// Creates a fault from a motion's violation.
    pub(super) fn of(violation: Violation, motion: u32) -> Self {
        Self::Fault { error: violation.number(), motion, finding: violation.finding() }
    }
}
