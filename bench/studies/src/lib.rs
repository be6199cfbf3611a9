//! Studies: many runs with one table, each a verb of the bench with its options.
//!
//! ```text
//! sweep, sensitivity, buses   vary the setup or the application in virtual runs
//! calibrate                   fits a setup's numbers to the paper's figures
//! explore, soak               runs with faults: at each frame of a run, and for hours of operation
//! judge, long                 random motion lists held against independent laws; runs of millions of motions
//! trajectory                  a finely planned path, its speed and what limits it
//! engine                      `bench study`: a file says what varies, and jobs give rows; the other studies execute their runs by it
//! study, jobs, event_loop     the options of studies, runs on all cores, signals
//! outputs, directory          the files that a verb writes; setup_option, each_bus: what it runs on
//! ```

#![warn(clippy::print_stdout, clippy::print_stderr)]

pub mod buses;
pub mod calibrate;
pub mod directory;
pub mod each_bus;
pub mod engine;
pub mod event_loop;
pub mod explore;
pub mod jobs;
pub mod judge;
pub mod long;
pub mod outputs;
pub mod sensitivity;
pub mod setup_option;
pub mod soak;
pub mod study;
mod study_files;
pub mod sweep;
pub mod trajectory;
