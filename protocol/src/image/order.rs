//! The byte order of a bus, as a value: nodes read and write their images in the order of their bus.

use core::ops::Range;

use machine::wire::{BigEndian, LittleEndian, Truncated};

use super::{Command, Feedback, Image};

/// Bytes of a feedback with the robot's clock.
const CLOCK: Range<usize> = 28..36;

/// Order of the bytes of a number on a bus.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Order {
    /// Most significant byte first: PROFINET.
    BigEndian,
    /// Least significant byte first: EtherNet/IP, EtherCAT.
    LittleEndian,
}

/// Calls a method that has the byte order as its type parameter with this one.
macro_rules! in_order {
    ($order:expr, $type:ident::$method:ident($($argument:expr),*)) => {
        match $order {
            Order::BigEndian => $type::$method::<BigEndian>($($argument),*),
            Order::LittleEndian => $type::$method::<LittleEndian>($($argument),*),
        }
    };
}

impl Order {
    /// Parses a command like [`Command::parse`].
    pub fn parse_command(self, image: &Image) -> Result<Command, Truncated> {
        in_order!(self, Command::parse(image))
    }

    /// Parses a command's head like [`Command::parse_head`].
    pub fn parse_command_head(self, image: &Image) -> Result<Command, Truncated> {
        in_order!(self, Command::parse_head(image))
    }

    /// Writes a command like [`Command::emit`].
    pub fn emit_command(self, command: &Command, image: &mut Image) {
        in_order!(self, Command::emit(command, image));
    }

    /// Writes a command's head like [`Command::emit_head`].
    pub fn emit_command_head(self, command: &Command, image: &mut Image) {
        in_order!(self, Command::emit_head(command, image));
    }

    /// Parses feedback like [`Feedback::parse`].
    pub fn parse_feedback(self, image: &Image) -> Result<Feedback, Truncated> {
        in_order!(self, Feedback::parse(image))
    }

    /// Returns the robot's clock of a feedback, in ns, without reading the rest.
    #[must_use]
    pub fn feedback_clock(self, image: &Image) -> u64 {
        let bytes = image.get(CLOCK).and_then(|bytes| <[u8; 8]>::try_from(bytes).ok()).unwrap_or_default();
        match self {
            Self::BigEndian => u64::from_be_bytes(bytes),
            Self::LittleEndian => u64::from_le_bytes(bytes),
        }
    }

    /// Writes feedback like [`Feedback::emit`].
    pub fn emit_feedback(self, feedback: &Feedback, image: &mut Image) {
        in_order!(self, Feedback::emit(feedback, image));
    }
}
