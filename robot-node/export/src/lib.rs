//! The robot's code for robots of makers: the second layer in KRL and RAPID, with the planned program.
//!
//! ```text
//! form        the intermediate form: tasks of statements, each an instant of its own
//! layer       the second layer, written once in it
//! execution   executes the form, with an arm that has an advance run
//! registers   a motion as the layer reads it from a slot
//! application what an export is made of, and what a language cannot say of it
//! kuka, abb   the printers, each with an adapter in templates/ for what depends on the maker
//! krl_check   a tokenizer and block checker of KRL
//! names       the names of the files, none of which is a word of a language or stands for two things
//! directory   the files, written whole or not at all
//! ```
//!
//! `tests/` execute the form against the PLC's own function blocks over random scripts.

mod abb;
mod application;
mod directory;
pub mod execution;
pub mod form;
pub mod krl_check;
mod kuka;
pub mod layer;
mod names;
mod printed;
pub mod registers;

pub use application::{Maker, Refused, RobotApplication, StoredProgram};
pub use directory::{ExportError, export, files};
pub use names::{NameFault, check_names};
pub use printed::ExportFile;
pub use protocol::image::ErrorNumber;
