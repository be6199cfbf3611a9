//! Mode of a measurement: real or virtual time.

use clap::ValueEnum;

/// Mode of a measurement.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
pub enum Mode {
    /// Two processes, real sockets, the host's clock.
    Real,
    /// Both nodes in this process, in virtual time; needs no permission.
    Virtual,
}

impl Mode {
    /// Returns the mode's name in options, results and run directories.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Real => "real",
            Self::Virtual => "virtual",
        }
    }
}
