//! What the robot waits for, and how often it says so. A robot may wait as long as it likes.

use core::fmt;

use machine::{Duration, Instant};
use protocol::image::{Command, Control, Feedback, State, Status};

/// Time from one report to the next. Assumed: short enough for a person who waits.
const REPORT_EVERY: Duration = Duration::from_secs(10);

/// What the robot waits for.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum WaitingFor {
    /// A PLC that sends commands over a connection.
    Plc,
    /// Data of the PLC that are not marked as bad or idle.
    GoodData,
    /// An image with a right check.
    RightCheck {
        /// Images refused so far.
        altered: u64,
    },
    /// A life counter of the PLC that counts.
    Life {
        /// Value at which it stands.
        life: u16,
    },
    /// An override above 0.
    Override {
        /// Number of the command.
        number: u16,
    },
    /// `RESUME`.
    Resume {
        /// Number of the command.
        number: u16,
    },
    /// The start time of a skill.
    StartTime {
        /// Number of the command.
        number: u16,
    },
    /// The other arms of a mark of the stored program.
    OtherArms {
        /// Number of the command.
        number: u16,
        /// Inputs for which the program waits.
        inputs: u16,
        /// State in which they let it go on.
        set: bool,
    },
    /// The master that the arm follows.
    Master {
        /// Number of the command.
        number: u16,
    },
    /// The next motion of a skill that has more of them.
    Motion {
        /// Number of the command.
        number: u16,
        /// Motions that the PLC has written.
        written: u32,
        /// Motions of the skill.
        total: u32,
    },
}

impl WaitingFor {
    /// Returns what a robot with a connection waits for in this cycle, if it waits.
    pub(crate) fn of(command: &Command, feedback: &Feedback) -> Option<Self> {
        let number = feedback.number;
        match feedback.state {
            State::Suspended => Some(Self::Resume { number }),
            State::Running if command.override_percent == 0 || feedback.override_percent == 0 => {
                Some(Self::Override { number })
            }
            State::Running if feedback.status.contains(Status::AT_REST) && command.number == number => {
                let Command { written, total, start_time_ns, .. } = *command;
                let follows = command.control.contains(Control::SYNC);
                if !follows && feedback.executed == 0 && start_time_ns > feedback.clock_ns {
                    return Some(Self::StartTime { number });
                }
                if follows && feedback.accepted > feedback.executed {
                    return Some(Self::Master { number });
                }
                let is_empty = feedback.accepted >= written && feedback.executed >= written;
                (is_empty && written < total).then_some(Self::Motion { number, written, total })
            }
            _ => None,
        }
    }
}

impl fmt::Display for WaitingFor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Plc => f.write_str("a PLC: none sends commands over a connection"),
            Self::GoodData => f.write_str(
                "good data of the PLC: it marks them as bad or idle, although it is connected; set it to run",
            ),
            Self::RightCheck { altered } => write!(
                f,
                "an image of the PLC that it may use: {altered} had a wrong check, others were outdated; look at the cable, or \
                 compare check and life counter with docs/process-image.md"
            ),
            Self::Life { life } => write!(
                f,
                "the PLC's life counter: it stands at {life}, although the connection is up; look whether its program runs"
            ),
            Self::Override { number } => {
                write!(f, "an override above 0 %: the arm stands on its path in command {number}")
            }
            Self::Resume { number } => write!(f, "RESUME from the PLC: command {number} is suspended"),
            Self::StartTime { number } => write!(
                f,
                "the start time of command {number}, bytes 20..28: it is ahead of the robot's clock; a halt or a cancel ends the wait"
            ),
            Self::OtherArms { number, inputs, set } => write!(
                f,
                "the other arms of a mark in command {number}: the PLC has to {} bits {inputs:#06x} of its digital outputs",
                if *set { "set" } else { "clear" }
            ),
            Self::Master { number } => write!(
                f,
                "the master of command {number}: with SYNC the arm stands until the law time in bytes 28..32 passes its own"
            ),
            Self::Motion { number, written, total } => {
                write!(f, "the next motion of command {number}: the PLC has written {written} of {total}")
            }
        }
    }
}

/// A wait under way, and when it is reported next.
#[derive(Clone, Copy, Default, Debug)]
pub(crate) struct Wait {
    under_way: Option<(WaitingFor, Instant)>,
    reported: u32,
    life: u16,
    /// Whether the counter has counted in this connection. A simple PLC sends none.
    has_counted: bool,
}

impl Wait {
    /// Forgets the PLC's life counter: there is no connection.
    pub(crate) const fn disconnect(&mut self) {
        self.has_counted = false;
    }

    /// Returns whether the PLC's life counter has counted, and is that of the cycle before.
    pub(crate) const fn is_still(&mut self, life: u16) -> bool {
        let is_same = core::mem::replace(&mut self.life, life) == life;
        let was_counted = self.has_counted;
        self.has_counted |= !is_same;
        is_same && was_counted
    }

    /// Takes what the robot waits for in the cycle at `now`. Returns it with its length in s whenever a report is due.
    pub(crate) fn see(&mut self, now: Instant, for_what: Option<WaitingFor>) -> Option<(WaitingFor, u32)> {
        let Some(for_what) = for_what else {
            (self.under_way, self.reported) = (None, 0);
            return None;
        };
        let kind = core::mem::discriminant(&for_what);
        let before = self.under_way.filter(|(before, _)| core::mem::discriminant(before) == kind);
        let since = before.map_or(now, |(_, since)| since);
        if before.is_none() {
            self.reported = 0;
        }
        self.under_way = Some((for_what, since));
        let waited = now.since(since);
        if waited < REPORT_EVERY * (self.reported + 1) {
            return None;
        }
        let seconds = u32::try_from(waited.as_secs()).unwrap_or(u32::MAX);
        self.reported = seconds / REPORT_EVERY.as_secs() as u32;
        Some((for_what, seconds))
    }
}
