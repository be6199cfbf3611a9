//! `bench report` and `bench compare`: draw the report of an existing run again, and compare existing runs.

use std::path::PathBuf;

use clap::Args;

use records::exit::{Exit, Failure};
use records::run_directory::{Durability, replace};
use report::errln;
use report::outln;
use report::pages::{self, Comparison, Pages, WantedPages};
use studies::outputs::{self, FigureExports, Own, location};

/// Options of a report that is drawn again.
#[derive(Args, Debug)]
pub struct ReportOptions {
    /// The run directory.
    #[arg(value_name = "RUN")]
    pub run: PathBuf,
    /// Write the report to this file alone [default: RUN/report.html, and RUN/race.html].
    #[arg(long, value_name = "FILE")]
    pub out: Option<PathBuf>,
}

/// Draws a run's report and its race again and prints the path of the report; with `--out` the report alone.
///
/// # Errors
///
/// There is no run, it has another version, or the report cannot be written; the old report is then kept.
pub fn run(options: &ReportOptions) -> Result<Exit, Failure> {
    let (path, lacks) = match &options.out {
        None => {
            let Pages { report, lacks, .. } =
                pages::write(&options.run, WantedPages::BOTH).map_err(as_it_was)?;
            (report, lacks)
        }
        Some(path) => {
            let is_report = location(path) == location(&options.run.join(pages::FILE));
            let asked = (!is_report).then_some(path.as_path());
            outputs::check(&[("--out", asked)], &[], Own::default())?;
            let (html, lacks) = pages::render(&options.run)?;
            replace(path, &html, Durability::Synced).map_err(|error| as_it_was(error.into()))?;
            (path.clone(), lacks)
        }
    };
    lacks.iter().for_each(|lack| errln!("warning: the report is not complete: {lack}"));
    outln!("{}", path.display());
    Ok(Exit::Pass)
}

/// Says what to do about a page that cannot be written.
fn as_it_was(failure: Failure) -> Failure {
    let Failure { exit, error } = failure;
    let what_to_do = "the run is as it was; name a file that can be written by --out";
    Failure { exit, error: if exit == Exit::Internal { error.context(what_to_do) } else { error } }
}

/// Options of a comparison.
#[derive(Args, Debug)]
pub struct CompareOptions {
    /// The run directories; each other run is compared with the first.
    #[arg(value_name = "RUN", required = true, num_args = 2..)]
    pub runs: Vec<PathBuf>,
    /// Write a page with the samples of all runs to this file as well.
    #[arg(long, value_name = "FILE")]
    pub html: Option<PathBuf>,
    /// Files for other programs.
    #[command(flatten)]
    pub exports: FigureExports,
}

/// Prints runs side by side, and writes a page if requested.
///
/// # Errors
///
/// A directory contains no run, or the page cannot be written.
pub fn compare(options: &CompareOptions) -> Result<Exit, Failure> {
    let CompareOptions { html, exports, .. } = options;
    let [json, csv] = exports.files();
    outputs::check(&[("--html", html.as_deref()), json, csv], &[], Own::default())?;
    let comparison = Comparison::load(&options.runs)?;
    outln!("{}", comparison.table());
    exports.write(&outputs::json(&comparison.figures())?, &comparison.csv())?;
    if let Some(path) = html {
        replace(path, &comparison.page()?, Durability::Written)?;
        outln!("\n{}", path.display());
    }
    Ok(Exit::Pass)
}
