//! The bench: runs a setup in real or in virtual time, measures it and sets the figures beside the paper's.
//!
//! ```text
//! cli            the command line
//! measure        the run command, from options to exit code
//! ├─ session     plan → repetitions → saved results, whatever they run on
//! │  ├─ plan     which run follows which
//! │  ├─ stand    what it runs on: virtual_run, or the rig with two processes
//! │  ├─ progress the live view
//! │  └─ run_directory, results, export, host    what stays
//! └─ table       what is printed; statistics has the formulas, quality how well the arm moved
//! faults         what the user puts into the cable
//! capture        what passes a virtual cable, as packets
//! calibrate      finds the numbers that only a published figure can fix
//! sweep          where CM loses to RC: queue depth × bus cycle × length of motions
//! sensitivity    how AET and AETi move with what the setup assumes
//! study          options and files that both have; jobs runs them on all cores
//! timeline       a trace as Perfetto opens it
//! playback       a trace as Foxglove and Rerun open it, where it is built in
//! trace          both nodes tick by tick; watch fills it in virtual time
//! overhead       what recording costs
//! ratio          two means of a real run as a ratio, with how sure it is
//! long           one MoveContinuous of millions of motions, in virtual time, digested on both sides
//! report         report.html of a run, and runs beside each other
//! timing         how evenly cyclic frames come, beside a bare loop and a peer
//! gate           a virtual run against its committed baseline
//! history        the runs that are kept
//! doctor         what this machine can do
//! exit           the exit codes
//! output         printing, for a reader that may be gone
//! ```

#![warn(clippy::print_stdout, clippy::print_stderr)]

pub mod calibrate;
pub mod capture;
pub mod cli;
pub mod doctor;
pub mod exit;
pub mod export;
pub mod faults;
pub mod gate;
pub mod history;
pub mod host;
pub mod jobs;
pub mod long;
pub mod measure;
pub mod output;
pub mod overhead;
pub mod plan;
#[cfg(feature = "mcap")]
pub mod playback;
pub mod progress;
pub mod quality;
pub mod ratio;
pub mod report;
pub mod results;
pub mod rig;
pub mod run_directory;
pub mod sensitivity;
pub mod session;
pub mod stand;
pub mod statistics;
pub mod study;
pub mod sweep;
pub mod table;
pub mod timeline;
pub mod timing;
pub mod trace;
pub mod virtual_run;
mod watch;
