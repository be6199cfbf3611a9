//! `bench study`: the verbs of [`studies::engine`], and a job of it as a measured run.

use clap::Parser as _;
use studies::engine::{self, RerunJob, StudyVerb};

use crate::COMMIT;
use crate::verbs::measure;
use crate::verbs::measure::RunOptions;
use records::exit::{Exit, Failure};

/// Options of a measured run, parsed from the arguments of a job.
#[derive(clap::Parser, Debug)]
struct JobRun {
    #[command(flatten)]
    run: RunOptions,
}

/// Runs a verb of a study.
///
/// # Errors
///
/// Those of [`engine::run`] and of a measured run.
pub fn run(verb: &StudyVerb) -> Result<Exit, Failure> {
    match engine::run(verb, COMMIT)? {
        Ok(exit) => Ok(exit),
        Err(RerunJob { arguments }) => {
            let parsed = JobRun::try_parse_from(arguments);
            let JobRun { run } = parsed.map_err(|error| Failure::new(Exit::Internal, error))?;
            measure::run(&run)
        }
    }
}
