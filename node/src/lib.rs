//! What both node processes share, whatever their bus and their work.
//!
//! ```text
//! run         the command `run`: its options, and what happens before and after a node runs on its bus
//! supervise   the thread beside the cyclic one: notices become messages, instructions become commands
//! ├─ message  the messages and instructions, one JSON line each; report has their figures
//! ├─ inbox    waits for instructions, signals and notices at once; input lists them
//! └─ control  the control port: one controller at a time over TCP; token is the secret that it shows
//! role        which of the two nodes
//! station_file  where a node keeps what its bus set permanently: name, address and what the operator wrote
//! node        a node on its cyclic thread; short_text is text without allocation
//! trace_row   a cycle as a line of text, written and read; trace_file records a node's cycles
//! output      printing to a reader that may be gone; screen makes tables and text fit it
//! arguments   the command line, parsed; list has options with several values
//! ```

#![cfg_attr(not(test), warn(clippy::print_stdout, clippy::print_stderr))]

pub mod address_check;
pub mod arguments;
mod control;
mod inbox;
mod input;
pub mod list;
pub mod message;
mod node;
pub mod output;
pub mod report;
pub mod role;
pub mod run;
pub mod screen;
mod short_text;
pub mod station_file;
pub mod supervise;
pub mod token;
mod trace_file;
pub mod trace_row;
mod version;

pub use control::{ControlError, ControlPort};
pub use inbox::{Commands, Inbox};
pub use input::Input;
pub use node::{Command, CyclicTask, Node, NodeError, NodeProcess, Notice, ProcessEvent, Snapshot};
pub use short_text::ShortText;
pub use trace_file::TraceError;
pub use version::version;
