//! Why a repetition cannot be verified, in either mode.

/// The robot reported another number of motions than the PLC counted.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
#[error(
    "the robot-node reported {reported} motions of this run, and the PLC counted {executed}: the run cannot be verified"
)]
pub struct Unreported {
    /// Motions that the robot executed, as the PLC counted them.
    pub executed: u32,
    /// Motions in the messages of the robot node.
    pub reported: u32,
}
