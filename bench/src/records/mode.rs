//! On which clock a run runs.

use clap::ValueEnum;

/// On which clock a run runs.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
pub enum Mode {
    /// Two processes, real sockets, the machine's clock.
    Real,
    /// Both nodes in this process, in virtual time; needs no permission.
    Virtual,
}

impl Mode {
    /// The name that options, results and run directories use.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Real => "real",
            Self::Virtual => "virtual",
        }
    }
}
