//! The bench: runs a setup in real or in virtual time, measures it and sets the figures beside the paper's.
//!
//! ```text
//! cli            the command line
//! measure        the run command, from options to exit code
//! ├─ session     plan → repetitions → saved results, whatever they run on
//! │  ├─ plan     which run follows which
//! │  ├─ stand    what it runs on: virtual_run, or the rig with two processes
//! │  ├─ progress the live view
//! │  └─ run_directory, results, host    what stays
//! └─ table       what is printed; statistics has the formulas
//! calibrate      finds the numbers that only a published figure can fix
//! trace          both nodes tick by tick; watch fills it in virtual time
//! ratio          two means of a real run as a ratio, with how sure it is
//! long           one MoveContinuous of millions of motions, in virtual time, digested on both sides
//! report         report.html of a run, and runs beside each other
//! gate           a virtual run against its committed baseline
//! exit           the exit codes
//! ```

pub mod calibrate;
pub mod cli;
pub mod exit;
pub mod gate;
pub mod host;
pub mod long;
pub mod measure;
pub mod plan;
pub mod progress;
pub mod ratio;
pub mod report;
pub mod results;
pub mod rig;
pub mod run_directory;
pub mod session;
pub mod stand;
pub mod statistics;
pub mod table;
pub mod trace;
pub mod virtual_run;
mod watch;
