//! The bench: runs a setup in real or in virtual time, measures it and compares the figures with the paper's.
//!
//! Its modules and crates form floors. Each imports only from the floors below it:
//!
//! ```text
//! command_line   the verbs and where their options go
//! verbs          what a user can ask for of one run or of saved runs: measure, gate, report, ...; each with its options
//! studies        (crate) verbs of many runs: calibrate, sweep, explore, ...
//! report         (crate) what a person or another program gets to see: tables, pages, exports, timeline, progress
//! stands         (crate) what a sequence is run on: rig, a process for each node; virtual_run, all nodes in virtual time
//! records        (crate) what is measured and kept: results, run directory, traces, statistics, the host, exit codes
//! ```
//!
//! `scripts/module-graph.py` fails where an import runs up, or where modules of one folder import each other in a circle.

#![warn(clippy::print_stdout, clippy::print_stderr)]

pub mod command_line;
pub mod verbs;

/// The commit that the program was built from, empty if it is unknown.
pub const COMMIT: &str = env!("SKILLBENCH_COMMIT");
