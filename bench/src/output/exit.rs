//! The exit codes, and which error leads to which.

use std::process::ExitCode;

use robot_node::StartOutOfReach;
use robot_node::quality::RatingExceeded;

use crate::records::agreement::Altered;
use crate::records::not_ready::NotReady;
use crate::records::occupied::Occupied;

/// The program's exit code. The numbers are part of its interface: scripts and CI read them.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Exit {
    /// All was done as asked.
    Pass = 0,
    /// An error of the program itself, or of the disk that it writes to.
    Internal = 1,
    /// An error in the command line, a setup or an application.
    Usage = 2,
    /// A figure differs from its baseline by more than its tolerance. Reserved for the gate.
    TimingRegression = 3,
    /// A repetition failed, where earlier ones are saved, the run's own faults kept it from beginning, or a saved figure of
    /// a run was changed.
    RunFailed = 4,
    /// This computer or this user lacks what real mode needs, or no node answers.
    EnvironmentUnusable = 5,
    /// A joint exceeded its rated speed, acceleration or jerk; earlier repetitions are saved.
    RatingExceeded = 6,
    /// Ctrl-C or SIGTERM; the results so far are saved.
    Interrupted = 130,
}

impl Exit {
    /// Returns the exit code of a run in which a repetition failed for this reason.
    #[must_use]
    pub fn of_run(error: &anyhow::Error) -> Self {
        if error.is::<RatingExceeded>() { Self::RatingExceeded } else { Self::RunFailed }
    }

    /// Returns whether a repetition failed.
    #[must_use]
    pub const fn is_failed_run(self) -> bool {
        matches!(self, Self::RunFailed | Self::RatingExceeded)
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}

/// An error and its exit code.
#[derive(Debug)]
pub struct Failure {
    /// The exit code.
    pub exit: Exit,
    /// What was being done, what was found, what to do.
    pub error: anyhow::Error,
}

impl Failure {
    /// Creates a failure that ends the program with `exit`.
    pub fn new(exit: Exit, error: impl Into<anyhow::Error>) -> Self {
        Self { exit, error: error.into() }
    }

    /// Creates the failure of reading a run directory: changed figures are the run's, anything else is the user's.
    pub fn of_saved_run(error: anyhow::Error) -> Self {
        let exit = if error.is::<Altered>() { Exit::RunFailed } else { Exit::Usage };
        Self { exit, error }
    }
}

/// The user can correct an error in a setup.
impl From<setup::Error> for Failure {
    fn from(error: setup::Error) -> Self {
        Self::new(Exit::Usage, error)
    }
}

/// The user can correct an error in an application.
impl From<planning::Error> for Failure {
    fn from(error: planning::Error) -> Self {
        Self::new(Exit::Usage, error)
    }
}

/// What the user can correct and what the robot refused have their codes, however far inside they happened; an error without a
/// code is internal.
impl From<anyhow::Error> for Failure {
    fn from(error: anyhow::Error) -> Self {
        let is_of_user = error.is::<Occupied>()
            || error.is::<NotReady>()
            || error.is::<setup::Error>()
            || error.is::<planning::Error>()
            || error.is::<StartOutOfReach>();
        let exit = if error.is::<RatingExceeded>() {
            Exit::RatingExceeded
        } else if is_of_user {
            Exit::Usage
        } else if error.is::<plc_node::Failure>() || error.is::<Altered>() {
            Exit::RunFailed
        } else {
            Exit::Internal
        };
        Self::new(exit, error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    use anyhow::Context as _;

    #[test]
    fn an_error_from_far_inside_keeps_its_code() {
        let exit = |error: anyhow::Error| {
            let outer: anyhow::Result<()> = Err(error).context("a study failed");
            Failure::from(outer.unwrap_err()).exit
        };
        let failed = plc_node::Failure {
            execution_type: plc_node::ExecutionType::Rc,
            executed: 0,
            cause: plc_node::FailureCause::Aborted,
        };
        assert_eq!(exit(failed.into()), Exit::RunFailed);
        assert_eq!(exit(NotReady::Late(Duration::from_secs(60)).into()), Exit::Usage);
        assert_eq!(exit(planning::application("nowhere", None).unwrap_err().into()), Exit::Usage);
        assert_eq!(exit(anyhow::anyhow!("the disk is full")), Exit::Internal);
    }
}
