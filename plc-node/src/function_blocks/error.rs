//! Why a block ended with `Error`.

use core::fmt;

use protocol::image::{ErrorNumber, Finding, MotionKind};

use super::BufferMode;

/// Formats what the robot says as text: an error number, or that there is none.
fn robot_in_words(number: ErrorNumber, finding: Finding) -> String {
    match number {
        ErrorNumber::None => "the robot ended the skill with an error but without its number".to_owned(),
        _ => format!("the robot reports error {}: {}", u16::from(number), finding.in_words(number)),
    }
}

/// Why a block ended with `Error`: the robot's number, or what the block itself found.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, thiserror::Error)]
pub enum BlockError {
    /// The robot refused the skill or ended it early.
    #[error("{} (motion {motion}, counted from 0)", robot_in_words(*number, *finding))]
    Robot {
        /// What the robot says.
        number: ErrorNumber,
        /// Which motion of the skill, counted from 0.
        motion: u32,
        /// The quantity and its limits.
        finding: Finding,
    },
    /// There is no connection, or it was lost.
    #[error("no connection to the robot; start again once it is up")]
    NotConnected,
    /// Another block waits for its turn already.
    #[error(
        "another skill waits already for the one that is under way, and one may wait; start this one after it, or with \
         BufferMode Aborting"
    )]
    QueueFull,
    /// The sequence is empty.
    #[error("the sequence has no motions; nothing was sent to the robot")]
    NoMotions,
    /// The slots are to be refilled by `accepted`, and the robot does not keep what it accepts.
    #[error(
        "this robot does not keep the motions that it accepts (services bit 2 is 0); set plc.refill to `executed`"
    )]
    RefillNotServed,
    /// The robot does not take compact points.
    #[error(
        "this robot does not take compact points (services bit 1 is 0); send the motions by MoveContinuous"
    )]
    CompactNotServed,
    /// No single-motion skill has this kind of motion.
    #[error("no skill moves this kind of motion ({0:?}); correct the motion's kind")]
    NoSkillForKind(MotionKind),
    /// The source gave no motion where there must be one.
    #[error("the source of motions gave no motion {index} of {total}; check the file or list it reads from")]
    SourceEnded {
        /// Which motion, counted from 0.
        index: u32,
        /// How many there should be.
        total: u32,
    },
    /// The robot is connected and alive, but does not echo the command.
    #[error(
        "the robot did not take up command {number} in {scans} scans; it is alive, so look at its program"
    )]
    NoAnswer {
        /// The command's number.
        number: u16,
        /// How many scans the block waited.
        scans: u32,
    },
    /// The robot is connected, but does not get into the state that it was asked for.
    #[error("the robot did not follow in {scans} scans; the robot itself shows the reason")]
    StateNotReached {
        /// How many scans the block waited.
        scans: u32,
    },
    /// The robot echoes another command than the one it was executing.
    #[error("the robot was executing command {expected} and now reports command {found}; was it restarted?")]
    Forgotten {
        /// The command's number.
        expected: u16,
        /// What the robot echoes.
        found: u16,
    },
    /// The robot neither executes the command nor says how it ended.
    #[error("the robot stopped executing command {number} without saying how it ended")]
    EndUnknown {
        /// The command's number.
        number: u16,
    },
    /// The robot counts more motions than it was given.
    #[error("the robot counts {counted} motions but was given {written}; its count cannot be trusted")]
    CountedTooFar {
        /// Motions that the robot counts as executed or accepted.
        counted: u32,
        /// Motions that were written into its slots.
        written: u32,
    },
    /// The robot's count of executed motions went back.
    #[error("the robot's count of executed motions went back from {from} to {to}")]
    CountedBackwards {
        /// What it was.
        from: u32,
        /// What it is.
        to: u32,
    },
    /// The robot reports the end before the last motion.
    #[error("the robot reports the end after {executed} of {total} motions")]
    EndedEarly {
        /// Motions that the robot counts as executed.
        executed: u32,
        /// Motions of the skill.
        total: u32,
    },
    /// A buffer mode that blends.
    #[error(
        "BufferMode is {0:?}: the skills of two blocks are not blended into each other; use Buffered, or give the motions \
         to one MoveContinuous, which blends them by their approximation distances"
    )]
    BlendingBetweenSkills(BufferMode),
    /// A number that the image cannot carry.
    #[error("{name} is {found}, the process image carries {lower} to {upper}; change {name}")]
    InputOutOfRange {
        /// The input.
        name: &'static str,
        /// As it stands there.
        found: Real,
        /// The least that the image carries beside 0.
        lower: Real,
        /// The most.
        upper: Real,
    },
    /// An input that this kind of motion does not have.
    #[error(
        "{name} is given, and the process image has no room for it in this kind of motion ({kind:?}); leave it out"
    )]
    InputNotSupported {
        /// The input.
        name: &'static str,
        /// The block's kind of motion.
        kind: MotionKind,
    },
    /// The velocity factor of an override is out of its range.
    #[error(
        "VelFactor is {found}, it may be 0 (the arm stops on its path) to 1; the override stays as it is"
    )]
    OverrideOutOfRange {
        /// As it stands at the input.
        found: Real,
    },
    /// The robot overrides velocities only.
    #[error(
        "{name} is {found}, but must be 1: this robot overrides only velocities; the override stays as it is"
    )]
    FactorNotSupported {
        /// The input.
        name: &'static str,
        /// As it stands there.
        found: Real,
    },
    /// The robot does not go by the override.
    #[error(
        "the robot moves at an override of {in_effect} % and did not accept {wanted} % in {scans} scans; look at its program"
    )]
    OverrideNotTaken {
        /// The override in the image, in %.
        wanted: u8,
        /// The one that the robot reports, in %.
        in_effect: u8,
        /// How many scans the block waited.
        scans: u32,
    },
    /// The robot stands in an error that was not acknowledged.
    #[error("the robot stands in error {}: {number}; GroupReset acknowledges it", u16::from(*number))]
    InError {
        /// What the robot says.
        number: ErrorNumber,
    },
    /// The robot is being stopped, because a block ended with an error while it moved.
    #[error(
        "the robot is stopping, since a block ended with an error; wait until it stands, then GroupReset"
    )]
    Stopping,
    /// The robot is not in the state that the block acts on.
    #[error("the robot is not {0}, so there is nothing to do")]
    NothingToDo(
        /// The state in which the robot should be.
        &'static str,
    ),
}

/// A number at an input of a block, kept as its bits, so that errors can be compared and hashed.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Real(u32);

impl From<f64> for Real {
    fn from(value: f64) -> Self {
        Self((value as f32).to_bits())
    }
}

impl fmt::Display for Real {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f32::from_bits(self.0).fmt(f)
    }
}

impl fmt::Debug for Real {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl BlockError {
    /// Returns PLCopen's `ErrorID`, never 0: the robot's own error number, or 0x8000 and above for an error that the
    /// block found.
    #[must_use]
    pub fn error_id(self) -> u16 {
        match self {
            Self::Robot { number, .. } => u16::from(number).max(1),
            Self::NotConnected => 0x8001,
            Self::QueueFull => 0x8002,
            Self::NoMotions => 0x8003,
            Self::NoSkillForKind(_) => 0x8004,
            Self::SourceEnded { .. } => 0x8005,
            Self::NoAnswer { .. } => 0x8006,
            Self::Forgotten { .. } => 0x8007,
            Self::EndUnknown { .. } => 0x8008,
            Self::CountedTooFar { .. } => 0x8009,
            Self::CountedBackwards { .. } => 0x800A,
            Self::EndedEarly { .. } => 0x800B,
            Self::NothingToDo(_) => 0x800C,
            Self::StateNotReached { .. } => 0x800D,
            Self::OverrideOutOfRange { .. } => 0x800E,
            Self::FactorNotSupported { .. } => 0x800F,
            Self::OverrideNotTaken { .. } => 0x8010,
            Self::InError { .. } => 0x8011,
            Self::Stopping => 0x8012,
            Self::BlendingBetweenSkills(_) => 0x8013,
            Self::InputOutOfRange { .. } => 0x8014,
            Self::InputNotSupported { .. } => 0x8015,
            Self::RefillNotServed => 0x8016,
            Self::CompactNotServed => 0x8017,
        }
    }
}
