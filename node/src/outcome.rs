//! How a program of this project ended.

use std::process::ExitCode;

use crate::errln;

/// How a node's process ended. The numbers are its exit codes, the same as the bench's.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Outcome {
    /// Ended on request.
    Done = 0,
    /// An error of the program.
    Internal = 1,
    /// An error in the command line or a setup.
    Usage = 2,
    /// A run failed.
    RunFailed = 4,
    /// The host lacks what the node needs: an interface, a permission, a port.
    EnvironmentUnusable = 5,
    /// Ctrl-C or SIGTERM.
    Interrupted = 130,
}

impl From<Outcome> for ExitCode {
    fn from(outcome: Outcome) -> Self {
        Self::from(outcome as u8)
    }
}

/// Prints the error of a command, if it failed, and returns the process's exit code. `is_usage` returns true for the
/// command's own errors that the user can correct, as errors in a setup or an application are; all others count as
/// errors of the host.
pub fn exit_code(
    outcome: anyhow::Result<Outcome>,
    is_usage: impl FnOnce(&anyhow::Error) -> bool,
) -> ExitCode {
    let outcome = outcome.unwrap_or_else(|error| {
        errln!("error: {error:#}");
        if error.is::<setup::Error>() || error.is::<planning::Error>() || is_usage(&error) {
            Outcome::Usage
        } else {
            Outcome::EnvironmentUnusable
        }
    });
    outcome.into()
}
