//! The exit codes, and which error leads to which.

use std::process::ExitCode;

use robot_node::quality::RatingExceeded;

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
    /// A repetition failed; earlier ones are saved.
    RunFailed = 4,
    /// This computer or this user lacks what real mode needs.
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

/// An error without a code of its own is internal.
impl From<anyhow::Error> for Failure {
    fn from(error: anyhow::Error) -> Self {
        let exit = if error.is::<RatingExceeded>() {
            Exit::RatingExceeded
        } else if error.is::<Occupied>() {
            Exit::Usage
        } else {
            Exit::Internal
        };
        Self::new(exit, error)
    }
}
