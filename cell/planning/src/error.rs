//! Why an application cannot be read or planned.

use crate::compact_form::NotCompact;
use crate::out_of_reach::{OutOfReach, SwingsTooNear};
use crate::refusal::Refusal;
use crate::shared_zone::NoTurns;

/// Reason why planning failed.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The setup cannot be used, no application of that name is there, or its text does not have the format.
    #[error(transparent)]
    Setup(#[from] setup::Error),
    /// The text is well formed, but a value makes no sense.
    #[error("{origin}:{line}: {key}: {problem}")]
    Value {
        /// The file, or the built-in's name.
        origin: String,
        /// Line of the value, from 1.
        line: usize,
        /// The key.
        key: String,
        /// What is wrong and what would be right.
        problem: String,
    },
    /// A step asks for what cannot be planned.
    #[error("step `{step}`, motion {motion}: {refusal}")]
    Refused {
        /// The step's name.
        step: String,
        /// Number of the motion in the plan, from 1.
        motion: u64,
        /// Which quantity is beyond which limit.
        refusal: Refusal,
    },
    /// The motions have no compact form, in which the setup's PLC sends them.
    #[error("plc.form = \"compact\": {0}")]
    NotCompact(#[from] NotCompact),
    /// An application that was read cannot be planned on a setup.
    #[error("{origin} on setup {setup}: {refused}")]
    Unplannable {
        /// The file, or the built-in's name.
        origin: String,
        /// The setup's name.
        setup: String,
        /// [`Error::Refused`] or [`Error::NotCompact`].
        refused: Box<Error>,
    },
    /// The arms of a cell cannot take turns in its shared zones.
    #[error("{origin}: `{key}`: {found}")]
    NoTurns {
        /// The setup's file, or the built-in's name.
        origin: String,
        /// The key in the setup.
        key: String,
        /// The conflict.
        found: Box<NoTurns>,
    },
    /// The arm of a setup does not reach what was planned.
    #[error("{origin} on setup {setup}: {found}")]
    OutOfReach {
        /// The file, or the built-in's name.
        origin: String,
        /// The setup's name.
        setup: String,
        /// The motion, and why the arm does not follow it.
        found: Box<OutOfReach>,
    },
    /// The arm of a setup takes the tool nearer to an obstacle in a PTP than the clearance.
    #[error("{origin} on setup {setup}: {found}")]
    SwingsTooNear {
        /// The file, or the built-in's name.
        origin: String,
        /// The setup's name.
        setup: String,
        /// The motion, and how near it comes.
        found: Box<SwingsTooNear>,
    },
}

/// Returns the line that contains a place in a text, counted from 1.
pub(crate) fn line_of(text: &str, offset: usize) -> usize {
    1 + text.bytes().take(offset).filter(|&byte| byte == b'\n').count()
}
