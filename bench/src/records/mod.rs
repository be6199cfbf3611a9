//! What is measured and kept, without a word of how it came about or how it is shown.
//!
//! ```text
//! schedule       which run follows which
//! mode           on which clock a run runs
//! lateness       how late a cyclic task ran
//! conditions     what a stand says of a run and of the conditions it was measured under
//! results        what a run found out, as results.json has it; statistics has the formulas, quality how well the arm moved
//! trace          both nodes tick by tick
//! ratio          two means of a real run as a ratio, with how sure it is
//! faults         what the user puts into the cable, and what came of it
//! host           the machine that a run ran on
//! run_directory  the files of a run
//! ```

pub mod conditions;
pub mod faults;
pub mod host;
pub mod lateness;
pub mod mode;
pub mod quality;
pub mod ratio;
pub mod results;
pub mod run_directory;
pub mod schedule;
pub mod statistics;
pub mod trace;
