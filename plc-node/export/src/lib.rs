//! The PLC's code for other PLCs: the first layer in Structured Text, with the planned motions as data.
//!
//! ```text
//! templates/      the code, written once in Structured Text, with the places of an application's numbers
//! application     what these numbers are
//! words           a motion as the eleven UDINT that the code packs into the image
//! structured_text the code with an application's numbers, as one file
//! ```
//!
//! The crate `structured-text` executes the text; `tests/` compare it with the PLC's own function blocks, scan by scan.

mod application;
mod structured_text;
mod words;

pub use application::{Application, Refused, StopData};
pub use structured_text::{FILE, structured_text};
