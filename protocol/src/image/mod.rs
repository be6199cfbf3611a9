//! The skill process image: 256 bytes from the PLC to the robot ([`Command`]) and 256 bytes back ([`Feedback`]).
//!
//! A fieldbus of the paper's kind carries at most 256 bytes a direction, and a motion takes 44 of them, so that five
//! motions and a head of 36 bytes fill the image (paper, section 5.2). There is one definition; the bus picks the
//! byte order ([`Order`]), which is a type parameter where bytes are read and written.
//!
//! ```text
//! command  0..36  head      36..80  slot 0   80..124  slot 1  124..168  slot 2  168..212  slot 3  212..256  slot 4
//! feedback 0..116 head    116..120 check   120..128 more   128..256 zero
//! ```
//!
//! The last four bytes of a command's head are its check, too: [`Sealer`] writes it and [`Checker`] verifies it.
//!
//! Motion `k`, counted from 0, is in slot `k mod 5`. The PLC writes the first five before the start; whenever the
//! robot has executed one (`executed`, the paper's `curExec`), the next one goes into the slot that became free,
//! until `total` (the paper's `totalNo`) are executed.
//!
//! With [`Skill::MoveTrajectory`] bytes 36..256 hold [`CompactPoints`] in place of the slots.

mod check;
mod command;
mod configuration;
mod digest;
mod error;
mod feedback;
mod finding;
mod kind;
mod layout;
mod life;
mod motion;
mod order;
mod points;

pub use check::{
    COMMAND_CHECK, Checker, Checks, CommandChecker, CommandSealer, FEEDBACK_CHECK, FeedbackChecker,
    FeedbackSealer, Sealer, Verdict,
};
pub use command::{Command, Control, Skill};
pub use configuration::Configuration;
pub use digest::{Digest, Sum};
pub use error::ErrorNumber;
pub use feedback::{Feedback, Services, State, Status};
pub use finding::{Finding, InWords};
pub use kind::{AuxiliaryForm, KindTraits, MotionKind, PathForm, TargetForm};
pub use layout::{
    COMMAND_FIELDS, CodeTable, FEEDBACK_FIELDS, FieldType, ImageField, MOTION_FIELDS, OPTION_FIELDS,
    POINT_FIELDS,
};
pub use life::{Age, LifeMonitor};
pub use motion::Motion;
pub use order::Order;
pub use points::{
    CompactPoints, PointDifference, PointHead, PointMisfit, PointSum, RING_AT, RING_DIFFERENCES, Slots,
};

/// Length in bytes of the image in either direction.
pub const IMAGE_LEN: usize = 256;

/// Length in bytes of the command's head.
pub const HEAD_LEN: usize = 36;

/// Length in bytes of one motion (paper, section 5.2).
pub const MOTION_LEN: usize = 44;

/// Motions that the image holds at once: the paper's `cntFC`.
pub const SLOTS: usize = 5;

const _: () = assert!(HEAD_LEN + SLOTS * MOTION_LEN == IMAGE_LEN);

/// The image of one direction, as the bus carries it.
pub type Image = [u8; IMAGE_LEN];

/// Declares a set of bits with named members, transparent over its number.
macro_rules! bits {
    ($(#[$doc:meta])* $name:ident: $number:ty { $($(#[$bit_doc:meta])* $bit:ident = $index:literal,)* }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, PartialEq, Eq, Default)]
        pub struct $name(pub $number);

        impl $name {
            $($(#[$bit_doc])* pub const $bit: Self = Self(1 << $index);)*

            /// Name of each bit that has one, from bit 0.
            pub const NAMES: &'static [&'static str] = &[$(stringify!($bit),)*];

            /// Returns whether all bits of `other` are set.
            #[must_use]
            pub const fn contains(self, other: Self) -> bool {
                self.0 & other.0 == other.0
            }

            /// Sets or clears the bits of `other`.
            pub const fn set(&mut self, other: Self, on: bool) {
                if on { self.0 |= other.0 } else { self.0 &= !other.0 }
            }
        }

        impl core::ops::BitOr for $name {
            type Output = Self;
            fn bitor(self, rhs: Self) -> Self {
                Self(self.0 | rhs.0)
            }
        }

        impl core::fmt::Debug for $name {
            fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
                let mut set = f.debug_set();
                $(if self.contains(Self::$bit) {
                    set.entry(&format_args!(stringify!($bit)));
                })*
                set.finish()
            }
        }
    };
}
use bits;

/// Declares an enum over numeric codes that keeps unknown ones.
macro_rules! codes {
    ($(#[$doc:meta])* $name:ident: $number:ty { $($(#[$code_doc:meta])* $variant:ident = $code:literal,)* }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
        pub enum $name {
            $($(#[$code_doc])* $variant,)*
            /// A code that this version does not know; it survives a round trip.
            Unknown($number),
        }

        impl $name {
            /// Every code that has a name, in the order of the declaration.
            pub const NAMED: &'static [Self] = &[$(Self::$variant,)*];
        }

        impl From<$number> for $name {
            fn from(code: $number) -> Self {
                match code {
                    $($code => Self::$variant,)*
                    other => Self::Unknown(other),
                }
            }
        }

        impl From<$name> for $number {
            fn from(value: $name) -> Self {
                match value {
                    $($name::$variant => $code,)*
                    $name::Unknown(code) => code,
                }
            }
        }
    };
}
use codes;

#[cfg(test)]
mod tests;
