//! The gate: compares a virtual run with committed figures, so that a change that costs a millisecond is noticed.
//!
//! Virtual time repeats to the nanosecond, so a difference is never noise: it is a change of the program, of a setup or of
//! an application. Tolerances only allow for the last digits of floating point.

mod baseline;
mod export;
mod real;
mod verdict;

use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use clap::Args;
use planning::Application;
use plc_node::ExecutionType;
use setup::Setup;

pub use baseline::{BASELINES, Baseline, Expected, Refusal};
pub use real::CSV_HEADER as RATIO_CSV_HEADER;
pub use verdict::{CSV_HEADER, FigureChange, Verdict};

use self::export::GateExport;
use crate::verbs::measure::cell::whole;
use records::exit::{Exit, Failure};
use records::results::Results;
use records::run_directory::{Durability, replace};
use records::schedule::Schedule;
use report::{out, outln};
use stands::virtual_run;
use studies::outputs::{self, FigureExports, Own};
use studies::setup_option::SetupOption;

/// Where the committed baselines lie, from the repository's root.
const DIRECTORY: &str = "bench/baselines";

/// Options of the gate.
#[derive(Args, Debug)]
pub struct GateOptions {
    /// Which setup.
    #[command(flatten)]
    pub setup: SetupOption,
    /// The baseline [default: bench/baselines/SETUP.json from here; outside the repository the one built in].
    #[arg(long, value_name = "FILE")]
    pub baseline: Option<PathBuf>,
    /// Take this run's figures as the new baseline, and print what changes.
    #[arg(long, conflicts_with_all = ["json", "csv"])]
    pub update: bool,
    /// Compare the ratios of an existing real run, with that run's own setup.
    #[arg(long, value_name = "RUN", conflicts_with_all = ["update", "setup"])]
    pub run: Option<PathBuf>,
    /// Files for other programs.
    #[command(flatten)]
    pub exports: FigureExports,
}

/// Runs the setup in virtual time and prints how it compares with its baseline.
///
/// # Errors
///
/// The setup or the baseline cannot be used, the run fails, or a new baseline cannot be written.
pub fn run(options: &GateOptions) -> Result<Exit, Failure> {
    if let Some(directory) = &options.run {
        return real::run(options, directory);
    }
    if options.setup.of_several().is_some() {
        let (cell, found) = planning::cell_with_applications(options.setup.name())?;
        let application = found.application_name(&cell);
        check_exports(options, &cell.name, found.stations.iter().map(|station| station.path.as_deref()))?;
        return compare(options, &cell.name, &application, |schedule| {
            Ok(baseline::figures_of_cell(&whole(&cell, &found, schedule)?))
        });
    }
    let (setup, found) = options.setup.load()?;
    check_exports(options, &setup.name, [found.path.as_deref()])?;
    compare(options, &setup.name, &found.application.name, |schedule| {
        Ok(baseline::figures(&virtual_results(&setup, &found.application, schedule)?))
    })
}

/// Rejects exports that replace the baseline, the setup with this name or an application, or that cannot be written.
fn check_exports<'a>(
    options: &'a GateOptions,
    setup: &str,
    applications: impl IntoIterator<Item = Option<&'a Path>>,
) -> Result<(), Failure> {
    let baseline = options.baseline.clone().unwrap_or_else(|| default_path(setup));
    let mut read = vec![("the baseline", Some(baseline.as_path())), ("the setup", options.setup.file())];
    read.extend(applications.into_iter().map(|application| ("the application", application)));
    outputs::check(&options.exports.files(), &read, Own::default())?;
    Ok(options.exports.check_writable()?)
}

/// Compares the figures of a run with their baseline and prints the verdict, or makes them the new baseline.
fn compare(
    options: &GateOptions,
    setup: &str,
    application: &str,
    figures: impl FnOnce(&Schedule) -> Result<Vec<Expected>, Failure>,
) -> Result<Exit, Failure> {
    let path = options.baseline.clone().unwrap_or_else(|| default_path(setup));
    let found = find(&path, options.baseline.is_none(), setup)?;
    if let Some((baseline, _)) = &found {
        baseline.is_for(setup, application).map_err(|refusal| refusal.at(&path))?;
    }
    if options.update {
        let old = found.filter(|(_, origin)| *origin == Origin::File).map(|(baseline, _)| baseline);
        let (reps, seed) =
            old.as_ref().map_or((baseline::REPETITIONS, baseline::SEED), |old| (old.reps, old.seed));
        let figures = figures(&schedule(reps, seed))?;
        return write(
            &Baseline::new([setup, application], reps, seed, figures, old.as_ref()),
            old.as_ref(),
            &path,
        );
    }
    let Some((baseline, origin)) = found else {
        let error = anyhow!(
            "there is no baseline {} for setup {setup}; make one by --update, or name another by --baseline",
            path.display()
        );
        return Err(Failure::new(Exit::Usage, error));
    };
    let verdict = Verdict::of(&baseline, &figures(&schedule(baseline.reps, baseline.seed))?);
    let origin = match origin {
        Origin::File => path.display().to_string(),
        Origin::BuiltIn => "the one built in".to_owned(),
    };
    out!("{}", verdict.render(&baseline, &origin));
    options.exports.write(&outputs::json(&GateExport::of_figures(&verdict.rows()))?, &verdict.csv())?;
    Ok(if verdict.is_pass() { Exit::Pass } else { Exit::TimingRegression })
}

fn schedule(reps: u32, seed: u64) -> Schedule {
    Schedule::new(&ExecutionType::ALL, reps, seed)
}

/// Runs the setup as the baseline was run and compares.
///
/// # Errors
///
/// A repetition fails.
pub fn judge(setup: &Setup, application: &Application, baseline: &Baseline) -> Result<Verdict, Failure> {
    let results = virtual_results(setup, application, &schedule(baseline.reps, baseline.seed))?;
    Ok(Verdict::new(baseline, &results))
}

fn virtual_results(
    setup: &Setup,
    application: &Application,
    schedule: &Schedule,
) -> Result<Results, Failure> {
    virtual_run::whole(setup, application, schedule)
        .context("the virtual run for the gate failed")
        .map_err(|error| Failure::new(Exit::of_run(&error), error))
}

/// Writes a new baseline, and prints what it changes.
fn write(new: &Baseline, old: Option<&Baseline>, path: &Path) -> Result<Exit, Failure> {
    let diff = new.diff(old);
    let json = new.to_json().context("cannot write the baseline as JSON")?;
    replace(path, &json, Durability::Synced).context(
        "no baseline was changed; run this from the repository's root, or name a file that can be written by --baseline",
    )?;
    if diff.is_empty() {
        outln!("{} stays as it is.", path.display());
    } else {
        out!("{diff}\n{} is rewritten; commit it with the reason of the change.\n", path.display());
    }
    Ok(Exit::Pass)
}

/// Where a baseline was found.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Origin {
    File,
    BuiltIn,
}

fn find(path: &Path, or_built_in: bool, setup: &str) -> Result<Option<(Baseline, Origin)>, Failure> {
    match setup::read_plain_text(path) {
        Ok(text) => {
            let baseline = Baseline::parse(&text).map_err(|refusal| refusal.at(path))?;
            return Ok(Some((baseline, Origin::File)));
        }
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {}
        Err(error) => {
            let error = anyhow!(error).context(format!("cannot read the baseline {}", path.display()));
            return Err(Failure::new(Exit::Usage, error));
        }
    }
    let built_in = BASELINES.iter().find(|(name, _)| or_built_in && *name == setup);
    let Some((_, text)) = built_in else { return Ok(None) };
    let baseline = Baseline::parse(text).map_err(|refusal| refusal.at(Path::new("the baseline built in")))?;
    Ok(Some((baseline, Origin::BuiltIn)))
}

fn default_path(setup: &str) -> PathBuf {
    let name: String = setup.chars().map(|c| if c.is_alphanumeric() { c } else { '_' }).collect();
    Path::new(DIRECTORY).join(name + ".json")
}
