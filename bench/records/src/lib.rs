//! What is measured and kept. How it is measured or shown is not in here.
//!
//! ```text
//! schedule       the order of the runs; not_ready: why a virtual one did not begin
//! mode           real or virtual time
//! lateness       lateness of a cyclic task
//! conditions     the result of one run, and the conditions of the measurement
//! comparable     what a run measured and how; in what two runs differ
//! results        the results of a measurement, as in results.json; figures derives what tables show of them, statistics has
//!                the formulas, quality the arm's motion
//! paper          when the paper's figures stand beside a run; calibrated: the numbers chosen to meet them
//! plant_speed    how much faster than the plant a virtual run was
//! distance       how far a run is from the paper, in standard errors; arms: RC's time on the paper's two arms
//! trace          both nodes tick by tick
//! ratio          the ratio of two means of a real run, with its confidence interval
//! interval       means with their confidence intervals
//! disturbances   what disturbed a run without ending it
//! attached       the nodes of a run that ran already
//! origin         the source of samples that no bench measured; imported_samples: those that were read
//!                out of a PLC, measured_results: results of both
//! faults         the faults that the user injects, and their result
//! cell_results   the same for a cell of several stations; cell_sample: one repetition,
//!                cell_stop: one that failed; cell_directory: its files
//! host           the computer of a run
//! listening      the sockets that nodes and benches hold open for others
//! counted        a number with the noun that it counts
//! feed           the events of a run for whoever watches it; voice: lines for a person meanwhile; exit: the exit codes, and which error leads to which
//! digest         the digests of what is saved; agreement: whether saved figures agree with the samples;
//!                sample_rows: samples.csv, read back
//! run_directory  the files of a measurement; occupied: the directories that no verb writes into;
//!                replacement: files that are replaced as a whole; free_space: room on a disk
//! ```

pub mod agreement;
pub mod arms;
pub mod attached;
pub mod calibrated;
pub mod cell_directory;
mod cell_marks;
pub mod cell_results;
pub mod cell_sample;
pub mod cell_stop;
pub mod comparable;
pub mod conditions;
pub mod counted;
pub mod digest;
pub mod distance;
pub mod disturbances;
pub mod exit;
pub mod faults;
pub mod feed;
pub mod figures;
mod frames;
pub mod free_space;
pub mod host;
pub mod imported_samples;
pub mod interval;
pub mod lateness;
pub mod listening;
mod measured_results;
pub mod mode;
pub mod not_ready;
pub mod occupied;
pub mod origin;
pub mod own_memory;
pub mod paper;
pub mod plant_speed;
pub mod quality;
pub mod ratio;
pub mod replacement;
pub mod results;
pub mod run_directory;
mod sample_rows;
pub mod sample_unit;
pub mod schedule;
pub mod statistics;
pub mod trace;
pub mod voice;
