//! Why an access to an object failed.

use std::fmt;

use ethercrab::error::{CoeAbortCode, Error};
use machine::Duration;

use crate::commissioning::LONGEST_OBJECT;

/// Time within which a device takes a message and answers it.
pub(crate) const ANSWER_WITHIN: Duration = Duration::from_secs(1);

/// Why an access to an object failed.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) enum SdoFault {
    /// The device refuses it.
    Aborted(CoeAbortCode),
    /// The device could not read the message.
    NotUnderstood(u16),
    /// No answer came, or none that fits.
    NoAnswer,
    /// The device has no mailbox.
    NoMailbox,
    /// The device sends more data than an object has.
    TooLong,
    /// The frames failed.
    Cable(Error),
}

impl From<Error> for SdoFault {
    fn from(error: Error) -> Self {
        Self::Cable(error)
    }
}

impl fmt::Display for SdoFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Aborted(code) => write!(f, "the device refuses it: {code}"),
            Self::NotUnderstood(detail) => {
                let reason = match detail {
                    1 => "syntax",
                    2 => "protocol not supported",
                    3 => "invalid channel",
                    4 => "service not supported",
                    5 => "invalid header",
                    6 => "too short",
                    7 => "out of memory",
                    8 => "invalid size",
                    _ => "of the maker",
                };
                write!(f, "the device refuses the message: mailbox error 0x{detail:04X}, {reason}")
            }
            Self::NoAnswer => {
                write!(f, "no fitting answer within {} s; try again", ANSWER_WITHIN.as_secs_f64())
            }
            Self::NoMailbox => f.write_str("the device has no mailbox, so it has no objects"),
            Self::TooLong => write!(f, "the device sends more than {LONGEST_OBJECT} bytes"),
            Self::Cable(error) => write!(f, "the frames failed: {error}"),
        }
    }
}
