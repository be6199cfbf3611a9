//! How the program ends: the exit codes, and which error leads to which.

use std::process::ExitCode;

use robot_node::quality::RatingExceeded;

/// How the program ends. The numbers are part of its interface: scripts and CI read them.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Exit {
    /// All was done as asked.
    Pass = 0,
    /// A fault of the program itself, or of the disk that it writes to.
    Internal = 1,
    /// The command line, a setup or an application is wrong.
    Usage = 2,
    /// A figure differs from its baseline by more than its tolerance. Reserved for the gate.
    TimingRegression = 3,
    /// A repetition failed; those before it are saved.
    RunFailed = 4,
    /// This machine or this user lacks what real mode needs.
    EnvironmentUnusable = 5,
    /// A joint exceeded its rated speed, acceleration or jerk; the repetitions before it are saved.
    RatingExceeded = 6,
    /// Ctrl-C or SIGTERM; the results so far are saved.
    Interrupted = 130,
}

impl Exit {
    /// How the program ends where a repetition failed for this reason.
    #[must_use]
    pub fn of_run(error: &anyhow::Error) -> Self {
        if error.is::<RatingExceeded>() { Self::RatingExceeded } else { Self::RunFailed }
    }

    /// Whether a repetition failed.
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

/// An error and the code that the program ends with for it.
#[derive(Debug)]
pub struct Failure {
    /// The code.
    pub exit: Exit,
    /// What was being done, what was found, what to do.
    pub error: anyhow::Error,
}

impl Failure {
    /// A failure that ends the program with `exit`.
    pub fn new(exit: Exit, error: impl Into<anyhow::Error>) -> Self {
        Self { exit, error: error.into() }
    }
}

/// What is wrong with a setup is for the user to put right.
impl From<setup::Error> for Failure {
    fn from(error: setup::Error) -> Self {
        Self::new(Exit::Usage, error)
    }
}

/// So is what is wrong with an application.
impl From<planning::Error> for Failure {
    fn from(error: planning::Error) -> Self {
        Self::new(Exit::Usage, error)
    }
}

/// Whatever has no code of its own is internal.
impl From<anyhow::Error> for Failure {
    fn from(error: anyhow::Error) -> Self {
        let exit = if error.is::<RatingExceeded>() { Exit::RatingExceeded } else { Exit::Internal };
        Self::new(exit, error)
    }
}
