//! The gate for a cell with several stations.

use anyhow::anyhow;
use plc_node::ExecutionType;

use super::baseline::{REPETITIONS, SCHEMA_VERSION, SEED, figures_of_cell};
use super::{Baseline, GateOptions, Verdict, default_path, find, write};
use crate::verbs::measure::cell::whole;
use records::exit::{Exit, Failure};
use records::schedule::Schedule;
use report::out;

/// Runs a cell in virtual time and prints how it compares with its baseline.
pub(super) fn run(options: &GateOptions) -> Result<Exit, Failure> {
    let (cell, found) = planning::cell_with_applications(options.setup.name())?;
    let path = options.baseline.clone().unwrap_or_else(|| default_path(&cell.name));
    let application = cell.application.clone().unwrap_or_default();
    let old = find(&path, false, &cell.name)?.map(|(baseline, _)| baseline);
    if let Some(old) = &old {
        old.is_for_names(&cell.name, &application).map_err(|refusal| refusal.at(&path))?;
    }
    if old.is_none() && !options.update {
        let error = anyhow!(
            "there is no baseline {} for setup {}; make one by --update, or name another by --baseline",
            path.display(),
            cell.name
        );
        return Err(Failure::new(Exit::Usage, error));
    }
    let (reps, seed) = old.as_ref().map_or((REPETITIONS, SEED), |old| (old.reps, old.seed));
    let results = whole(&cell, &found, &Schedule::new(&ExecutionType::ALL, reps, seed))?;
    let figures = figures_of_cell(&results);
    match old {
        Some(baseline) if !options.update => {
            let verdict = Verdict::of(&baseline, &figures);
            out!("{}", verdict.render(&baseline, &path.display().to_string()));
            Ok(if verdict.is_pass() { Exit::Pass } else { Exit::TimingRegression })
        }
        old => {
            let setup = cell.name.clone();
            let mut new =
                Baseline { schema_version: SCHEMA_VERSION, setup, application, reps, seed, figures };
            new.keep_tolerances(old.as_ref());
            write(&new, old.as_ref(), &path)
        }
    }
}
