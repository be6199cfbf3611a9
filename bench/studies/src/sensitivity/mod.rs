//! `bench sensitivity`: how the execution times depend on numbers that are not known: one number at a time, with and
//! without calibration.
//!
//! ```text
//! factor   the varied numbers, and the setup or plan of each case
//! table    the rows on screen and as CSV
//! page     sensitivity.html
//! ```

mod factor;
mod page;
mod table;

use std::time::SystemTime;

use clap::Args;
use node::list::{List, flat, list};
use planning::Application;
use plc_node::ExecutionType;
use serde::{Deserialize, Serialize};
use setup::Setup;

use factor::Job;
pub use factor::{Case, Factor};
pub use table::{csv, csv_header, render};

use crate::engine::job::{JobRows, ListedJob};
use crate::engine::listed::ListedStudy;
use crate::event_loop::watch_for_interrupt;
use crate::outputs;
use crate::study::{Found, StudyOptions, ended, interrupted};
use records::exit::{Exit, Failure};
use records::paper::PaperComparison;
use records::results::PerType;
use records::schedule::Schedule;
use records::statistics::{AetMad, aet_improvement};
use report::outln;
use stands::planned_cell::PlannedCell;

/// Version of the study's JSON.
pub const SCHEMA_VERSION: u32 = 1;

/// Repetitions of each type in every case.
const REPETITIONS: u32 = 5;

const EXAMPLES: &str = "\
Examples:
  bench sensitivity --setup A                     one number at a time: half of it, as it is, twice as much
  bench sensitivity --setup B --reps 25           as exact as the table of a run
  bench sensitivity --factors 0.9,1,1.1           ten per cent either way
  bench sensitivity --export-csv sensitivity.csv --quiet";

/// Options of a sensitivity study.
#[derive(Args, Debug)]
#[command(after_help = EXAMPLES)]
pub struct SensitivityOptions {
    /// Setup, seed and files.
    #[command(flatten)]
    pub study: StudyOptions,
    /// Factors for each number except the number of motions, in place of its own factors; commas or blanks between them.
    #[arg(long, value_name = "F", num_args = 1.., value_parser = list(multiplier))]
    pub factors: Option<Vec<List<f64>>>,
    /// Repetitions of each execution type in every case.
    #[arg(long, value_name = "N", default_value_t = REPETITIONS, value_parser = clap::value_parser!(u32).range(1..=1_000))]
    pub reps: u32,
}

fn multiplier(text: &str) -> Result<f64, String> {
    let factor: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    if (0.0..=100.0).contains(&factor) { Ok(factor) } else { Err("a factor is 0 to 100".to_owned()) }
}

/// All results of a study.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct Sensitivity {
    /// Version of this format.
    pub schema_version: u32,
    /// The setup's name.
    pub setup: String,
    /// The setup's title.
    pub title: String,
    /// The application's name.
    pub application: String,
    /// Repetitions of each type in every case.
    pub reps: u32,
    /// Seed of clocks, phases and pauses.
    pub seed: u64,
    /// The published figures, if this is the paper's cell.
    pub paper: Option<PerType<AetMad>>,
    /// Cases of the whole study.
    pub planned: usize,
    /// The cases; the first one is the unchanged setup. An interrupt leaves out the last ones.
    pub rows: Vec<Row>,
}

/// One case: the setup with one number changed.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct Row {
    /// The varied number; null for the unchanged setup.
    pub factor: Option<Factor>,
    /// Its multiplier; for the motions see [`Factor`].
    pub times: f64,
    /// The resulting value, with its unit.
    pub value: String,
    /// Why the case cannot be run, as text; then there are no figures.
    pub refused: Option<String>,
    /// Figures with the setup's calibrated numbers.
    pub calibrated: Figures,
    /// Figures if a skill call costs no time besides its motion.
    pub without_skill_overhead: Figures,
    /// Figures without any calibrated number: h = 0, rated speeds, no quanta.
    pub uncalibrated: Figures,
}

/// Figures of one variant of a case.
#[derive(Clone, Copy, PartialEq, Debug, Default, Serialize, Deserialize)]
pub struct Figures {
    /// AET of RC, in ms.
    pub rc_ms: Option<f64>,
    /// AET of SM, in ms.
    pub sm_ms: Option<f64>,
    /// AET of CM, in ms.
    pub cm_ms: Option<f64>,
    /// AETi, (SM − CM) / SM, 0…1.
    pub aet_improvement: Option<f64>,
}

/// Which calibrated numbers of the setup are kept.
#[derive(Clone, Copy, Debug)]
enum Variant {
    Calibrated,
    WithoutOverhead,
    Uncalibrated,
}

/// Runs the study, prints its table and saves it.
///
/// # Errors
///
/// The options or the setup do not allow it, a run fails, or the results cannot be written. A case that the planner
/// or the robot refuses is not an error: its row contains the reason.
pub fn run(options: &SensitivityOptions, commit: &str) -> Result<Exit, Failure> {
    let started = SystemTime::now();
    let (setup, found) = options.study.setup.load()?;
    found.plan(&setup)?;
    let directory = options.study.prepare("sensitivity", &setup, &found, started)?;
    let is_interrupted = watch_for_interrupt()?;
    let factors = options.factors.as_deref().map(flat);
    let cases = Case::all(&setup, factors.as_deref());
    let listed = ListedStudy::in_memory("sensitivity", options.study.quiet, &is_interrupted);
    let claim = format!("{:?} {} {}", factors, options.reps, options.study.seed);
    let listed = options.study.with_rows(listed, (&setup, &found), &directory, &claim, commit)?;
    let study = study(&setup, &found.application, options, &cases, &listed)?;
    if study.rows.is_empty() {
        listed.discard_if_empty();
        return Ok(interrupted(&directory, study.planned, "cases"));
    }
    outln!("{}", render(&study));
    let found = Found { json: &outputs::json(&study)?, csv: &csv(&study), page: Some(&page::page(&study)?) };
    options.study.save(&directory, "sensitivity", &setup, found)?;
    outln!("  Saved in {}.", directory.display());
    Ok(ended(study.rows.len(), study.planned, "cases"))
}

/// Runs the cases. Those that an interrupt left without figures have no row.
fn study(
    setup: &Setup,
    application: &Application,
    options: &SensitivityOptions,
    cases: &[Case],
    listed: &ListedStudy<'_>,
) -> anyhow::Result<Sensitivity> {
    let schedule = Schedule::new(&ExecutionType::ALL, options.reps, options.study.seed);
    let mut jobs = Vec::new();
    for case in cases {
        for variant in [Variant::Calibrated, Variant::WithoutOverhead, Variant::Uncalibrated] {
            let job = case.make(&variant.of(setup.clone()), application);
            jobs.push(job.and_then(|job| job.listed(&schedule).map_err(|error| format!("{error:#}"))));
        }
    }
    // A refusal by the robot is a result, too: the case is out of its reach.
    let made: Vec<ListedJob> = jobs.iter().filter_map(|job| job.as_ref().ok().cloned()).collect();
    let mut executed = listed.executed(&made)?.into_iter();
    let outcome = |job: Result<ListedJob, String>| match job {
        Ok(_) => executed.next().flatten().map(|rows| figures(&rows)),
        Err(reason) => Some(Err(reason)),
    };
    let outcomes: Vec<Option<Result<Figures, String>>> = jobs.into_iter().map(outcome).collect();
    let mut outcomes = outcomes.into_iter();
    let rows = cases.iter().filter_map(|case| {
        let variants = [outcomes.next()?, outcomes.next()?, outcomes.next()?];
        let [Some(calibrated), Some(without_skill_overhead), Some(uncalibrated)] = variants else {
            return None;
        };
        let mut refused = None;
        let mut figures = |outcome: Result<Figures, String>| {
            outcome.unwrap_or_else(|reason| {
                refused.get_or_insert(reason);
                Figures::default()
            })
        };
        let [calibrated, without_skill_overhead, uncalibrated] =
            [calibrated, without_skill_overhead, uncalibrated].map(&mut figures);
        let value = case.value(setup, application);
        let Case { factor, times } = *case;
        Some(Row { factor, times, value, refused, calibrated, without_skill_overhead, uncalibrated })
    });
    Ok(Sensitivity {
        schema_version: SCHEMA_VERSION,
        setup: setup.name.clone(),
        title: setup.title.clone(),
        application: application.name.clone(),
        reps: options.reps,
        seed: options.study.seed,
        paper: match PaperComparison::of(setup, application, None, &[]) {
            PaperComparison::Comparable(paper) => Some(paper),
            PaperComparison::NotComparable(_) | PaperComparison::NoPaper => None,
        },
        planned: cases.len(),
        rows: rows.collect(),
    })
}

impl Variant {
    fn of(self, setup: Setup) -> Setup {
        match self {
            Self::Calibrated => setup,
            Self::WithoutOverhead => setup.with_skill_overhead(0),
            Self::Uncalibrated => setup.uncalibrated(),
        }
    }
}

impl Job {
    fn listed(self, schedule: &Schedule) -> anyhow::Result<ListedJob> {
        let Self { setup, application, plan } = self;
        let planned = PlannedCell::of_plan(&setup, &application, &plan)?;
        Ok(ListedJob { setup, planned, schedule: schedule.clone() })
    }
}

/// Returns the figures of a job, or why it failed.
fn figures(rows: &JobRows) -> Result<Figures, String> {
    if !rows.reason.is_empty() {
        return Err(rows.reason.clone());
    }
    let [rc_ms, sm_ms, cm_ms] = [ExecutionType::Rc, ExecutionType::Sm, ExecutionType::Cm]
        .map(|execution_type| rows.aet_mad(execution_type).map(|figure| figure.aet_ms));
    let aet_improvement = sm_ms.zip(cm_ms).map(|(sm, cm)| aet_improvement(sm, cm));
    Ok(Figures { rc_ms, sm_ms, cm_ms, aet_improvement })
}
