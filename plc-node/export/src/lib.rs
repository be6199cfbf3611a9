//! The PLC's code for other PLCs: the first layer in Structured Text, with the planned motions as data.
//!
//! ```text
//! templates/      the code, written once in Structured Text, with the places of an application's numbers
//! application     what these numbers are
//! words           a motion as the eleven UDINT that the code packs into the image
//! directory       the files, written whole or not at all
//! vectors         what the code gets and answers in each scan, for other compilers
//! structured_text the code with an application's numbers, as one file
//! parts           the same in its parts, for those that rewrite it
//! names           what must hold of the names in them
//! siemens, codesys, br  the dialects of makers, each with an adapter
//! maker           who they are, and how much their PLCs hold
//! ```
//!
//! The crate `structured-text` executes the text; `tests/` compare it with the PLC's own function blocks, scan by scan.

mod application;
pub mod br;
pub mod codesys;
mod directory;
mod maker;
mod names;
mod parts;
pub mod siemens;
mod structured_text;
mod vectors;
mod words;

pub use application::{ExportedApplication, Refused, StopData};
pub use directory::{ExportError, ExportFile, export, files};
pub use maker::Maker;
pub use structured_text::{FILE, structured_text};
pub use vectors::{VECTORS, VectorsError, vectors};
