//! What the PLC waits for, and how long it waits: the limit is on silence, and never on the length of a run.

use core::fmt;

use machine::Duration;
use protocol::fieldbus::Down;
use protocol::image::{ErrorNumber, State};

use crate::PoseDifference;

/// Time after which the PLC reports what it waits for; a robot that works needs less to get ready. Assumed.
const FIRST_REPORT: Duration = Duration::from_secs(2);

/// Time from one report to the next, and time for which a robot that owes progress may show none. Assumed: longer than any
/// controller pauses, and short enough for a person who waits.
const SILENCE: Duration = Duration::from_secs(10);

/// Returns how long a robot that owes progress may show none, which may take this long to answer and to wait at a stop.
pub(crate) fn longest_silence(answer: Duration, longest_stop: Duration) -> Duration {
    SILENCE + answer + longest_stop
}

/// What the PLC waits for.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum WaitingFor {
    /// A connection.
    Connection {
        /// Why there is none, if the bus has said it.
        last: Option<Down>,
    },
    /// Data that the robot does not mark as bad.
    GoodData,
    /// An image that the PLC can read.
    Image {
        /// Frames received so far.
        received: u64,
        /// Images refused so far, because their check is wrong.
        altered: u64,
    },
    /// A life counter that counts.
    Life {
        /// Frames received so far.
        received: u64,
        /// Value at which the counter stands.
        life: u16,
        /// Images refused so far, because their check is wrong.
        altered: u64,
    },
    /// A robot whose joints and pose are those of the setup's arm.
    Arm(PoseDifference),
    /// The robot's state `Ready`.
    Ready {
        /// The robot's state.
        state: State,
        /// The robot's error.
        error: ErrorNumber,
        /// Whether the robot reports that its drives are on.
        is_enabled: bool,
    },
    /// An override above 0.
    Override,
    /// A robot that resumes its suspended skill.
    Resume,
}

impl WaitingFor {
    /// Returns whether somebody owes progress. Without this, it may last as long as it likes.
    #[must_use]
    pub const fn is_owed(&self) -> bool {
        !matches!(self, Self::Override | Self::Resume)
    }
}

impl fmt::Display for WaitingFor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Connection { last: None } => f.write_str("the connection to the robot"),
            Self::Connection { last: Some(down) } => write!(f, "the connection to the robot: {down}"),
            Self::GoodData => f.write_str(
                "good data: the robot marks its data as bad or idle, although it is connected; set it to run, or look at \
                 its node",
            ),
            Self::Image { received, altered } => write!(
                f,
                "an image of the robot: {received} frames came, and in {altered} scans the image had a wrong check and was refused; \
                 compare its image with docs/process-image.md"
            ),
            Self::Life { received, life, altered } => {
                write!(
                    f,
                    "the robot's life counter: it stands at {life}, {received} frames came, and in {altered} scans the image was refused; "
                )?;
                f.write_str("look whether the robot's program runs and fills the image")
            }
            Self::Arm(PoseDifference { mm, deg }) => write!(
                f,
                "the arm of the setup: this robot is another one, {mm:.0} mm and {deg:.0}° off where its joints would bring the setup's \
                 arm; look which robot has this name and address, or correct robot.kinematics, robot.tools and robot.bases"
            ),
            Self::Ready { state, error, is_enabled } => {
                let drives = if *is_enabled { "on" } else { "off" };
                write!(f, "the robot's state Ready: it is {state:?}, drives {drives}, error: {error}; ")?;
                f.write_str("look at the robot")
            }
            Self::Override => f.write_str("an override above 0 %: the arm stands on its path"),
            Self::Resume => f.write_str("the robot to resume: its skill is suspended"),
        }
    }
}

/// Time of a wait, in scans, and when it is reported next.
///
/// Scans are counted, and no time is measured, so that a stalled PLC does not report the robot.
#[derive(Clone, Debug)]
pub(crate) struct Patience {
    scan: Duration,
    scans: u64,
    next_report: Duration,
}

impl Patience {
    pub(crate) const fn new(scan: Duration) -> Self {
        Self { scan, scans: 0, next_report: FIRST_REPORT }
    }

    /// Begins anew: there was progress.
    pub(crate) const fn restart(&mut self) {
        (self.scans, self.next_report) = (0, FIRST_REPORT);
    }

    /// Counts a scan without progress; returns how long that lasts already.
    pub(crate) fn count(&mut self) -> Duration {
        self.scans += 1;
        Duration::from_nanos(
            self.scan.as_nanos().saturating_mul(u128::from(self.scans)).try_into().unwrap_or(u64::MAX),
        )
    }

    /// Returns whether a wait of this length is to be reported now.
    pub(crate) fn is_report_due(&mut self, waited: Duration, for_what: &WaitingFor) -> bool {
        // Each attempt to connect has a report of its own.
        let is_quiet = matches!(for_what, WaitingFor::Connection { .. }) && waited < SILENCE;
        if waited < self.next_report || is_quiet {
            return false;
        }
        self.next_report =
            SILENCE * (u32::try_from(waited.as_secs() / SILENCE.as_secs()).unwrap_or(u32::MAX - 1) + 1);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wait_is_reported_after_two_seconds_and_then_every_ten() {
        let reported = |for_what: WaitingFor| {
            let mut patience = Patience::new(Duration::from_millis(500));
            let waits = (0..70).map(|_| patience.count()).collect::<Vec<_>>();
            waits.into_iter().filter(|waited| patience.is_report_due(*waited, &for_what)).collect::<Vec<_>>()
        };
        assert_eq!(reported(WaitingFor::GoodData), [2, 10, 20, 30].map(Duration::from_secs));
        assert_eq!(reported(WaitingFor::Connection { last: None }), [10, 20, 30].map(Duration::from_secs));
    }
}
