//! The bench: runs a setup in real or in virtual time, measures it and compares the figures with the paper's.
//!
//! Its modules form floors. A module imports only from the floors below it:
//!
//! ```text
//! command_line   the verbs and where their options go
//! verbs          what a user can ask for: measure, gate, calibrate, sweep, ...; each with its options
//! stands         what a sequence is run on: rig, two processes on a real network; virtual_run, both nodes in virtual time
//! output         what a person or another program gets to see: tables, report, exports, timeline, progress, exit codes
//! records        what is measured and kept: results, run directory, traces, statistics, the host
//! ```
//!
//! `scripts/module-graph.py` fails where an import runs up, or where modules of one folder import each other in a circle.

#![warn(clippy::print_stdout, clippy::print_stderr)]

pub mod command_line;
pub mod verbs;

/// The commit that the program was built from, empty if it is unknown.
pub(crate) const COMMIT: &str = env!("SKILLBENCH_COMMIT");
