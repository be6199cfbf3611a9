//! What both node processes share, whatever their bus and their work.
//!
//! ```text
//! run         the command `run`: its options, and what happens before and after a node runs on its bus; cell_run
//!             prepares the nodes of a setup with several stations
//! supervise   the thread beside the cyclic one: notices become messages, instructions become commands; link_state is what it
//!             knows of a connection
//! ├─ message  the messages and instructions, one JSON line each; report has their figures, station_message
//! │           names the station of a message where a node has several
//! ├─ inbox    waits for instructions, signals and notices at once; input lists them, carrier_report is one
//! └─ control  the control port: one controller at a time over TCP; token is the secret that it shows
//! role        which of the two nodes
//! station_file  where a node keeps what its bus set permanently: name, address and what the operator wrote
//! node        a node on its cyclic thread, where cyclic_task owns it; short_text is text without allocation
//! trace_row   a cycle as a line of text, written and read; trace_file records a node's cycles
//! output      printing to a reader that may be gone; screen makes tables and text fit it
//! arguments   the command line, parsed; list has options with several values, duration times with units,
//!             interface_option an interface for each bus
//! device_options  a device from its file, and what is chosen from it; grouped_arguments the options of several devices
//! outcome     how a program ended, as its exit code
//! ```

#![cfg_attr(not(test), warn(clippy::print_stdout, clippy::print_stderr))]

#[cfg(all(feature = "real", target_os = "linux"))]
pub mod address_check;
pub mod arguments;
#[cfg(all(feature = "real", target_os = "linux"))]
mod carrier_report;
#[cfg(all(feature = "real", target_os = "linux"))]
pub mod cell_run;
pub mod cell_run_error;
#[cfg(all(feature = "real", target_os = "linux"))]
mod control;
#[cfg(all(feature = "real", target_os = "linux"))]
mod cyclic_task;
pub mod device_options;
mod duration;
pub mod grouped_arguments;
#[cfg(all(feature = "real", target_os = "linux"))]
mod inbox;
#[cfg(all(feature = "real", target_os = "linux"))]
mod input;
pub mod interface_option;
#[cfg(all(feature = "real", target_os = "linux"))]
mod link_state;
pub mod list;
pub mod message;
#[cfg(all(feature = "real", target_os = "linux"))]
mod node;
#[cfg(all(feature = "real", target_os = "linux"))]
mod node_error;
mod outcome;
pub mod output;
pub mod planned_station;
pub mod report;
pub mod role;
#[cfg(all(feature = "real", target_os = "linux"))]
pub mod run;
pub mod screen;
mod short_text;
pub mod station_file;
pub mod station_message;
#[cfg(all(feature = "real", target_os = "linux"))]
pub mod supervise;
pub mod token;
#[cfg(all(feature = "real", target_os = "linux"))]
mod trace_file;
pub mod trace_row;
mod version;
pub mod wait_lines;

#[cfg(all(feature = "real", target_os = "linux"))]
pub use control::{ControlError, ControlPort};
#[cfg(all(feature = "real", target_os = "linux"))]
pub use cyclic_task::CyclicTask;
pub use duration::{duration_argument, parse_duration};
#[cfg(all(feature = "real", target_os = "linux"))]
pub use inbox::{Commands, Inbox};
#[cfg(all(feature = "real", target_os = "linux"))]
pub use input::Input;
#[cfg(all(feature = "real", target_os = "linux"))]
pub use node::{Command, Node, NodeProcess, Notice, ProcessEvent, Snapshot, Waiting};
#[cfg(all(feature = "real", target_os = "linux"))]
pub use node_error::NodeError;
pub use outcome::{Outcome, exit_code};
pub use short_text::ShortText;
#[cfg(all(feature = "real", target_os = "linux"))]
pub use trace_file::TraceError;
pub use version::version;
