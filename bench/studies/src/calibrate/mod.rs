//! `bench calibrate`: finds the numbers of a setup that only the paper's Table 2 can fix, in virtual time, over many seeds.
//!
//! ```text
//! parameter  the numbers of a setup, and the figures that each one is found from
//! metric     a figure over many seeds, and the paper's with its error
//! fit        finds the value with which a figure is met, and how well it is known
//! findings   the result in words and as lines of a setup
//! write      writes these lines into a setup's file
//! export     the result as JSON and CSV
//! ```
//!
//! Each figure depends on one number more than on the others, so the numbers are found one after another. Only numbers
//! that the setup marks as calibrated are changed; for the others the value that the figures suggest is printed.

mod export;
mod findings;
mod fit;
mod metric;
mod parameter;
mod write;

use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow, bail};
use clap::Args;
use setup::{Paper, Provenance, Setup};

pub use export::CSV_HEADER;
pub use findings::{Calibration, Found};
pub use fit::Fit;
pub use metric::{Metric, Seeds};
pub use parameter::Parameter;

use crate::engine::claim::{RowsOrigin, StudyClaim};
use crate::engine::listed::ListedStudy;
use crate::event_loop::{interrupted, watch_for_interrupt};
use crate::outputs::{self, FigureExports, Own};
use crate::setup_option::SetupOption;
use crate::study_files::CLAIMED_FILES;
use findings::Conditions;
use fit::FitTarget;
use metric::Interrupted;
use records::distance::Estimate;
use records::exit::{Exit, Failure};
use records::schedule::{REPETITIONS, SEED};
use report::errln;
use report::{out, outln};

/// Number of seeds of a calibration: with this many, its own error is small compared with the paper's.
const SEEDS: u32 = 32;

/// Number of rounds: speed and cost of a call affect the same figures, so each round corrects the effect of the other
/// number.
const ROUNDS: usize = 2;

/// A programmed speed from which the right one is found where the setup's own is on a plateau, in %.
const SLOW_PERCENT: f64 = 10.0;

/// Share by which an assumed number is varied to see what depends on it.
const VARIED: f64 = 0.05;

/// Options of a calibration.
#[derive(Args, Debug)]
pub struct CalibrateOptions {
    /// Which setup.
    #[command(flatten)]
    pub setup: SetupOption,
    /// Seeds over which each figure is averaged.
    #[arg(long, value_name = "N", default_value_t = SEEDS, value_parser = clap::value_parser!(u32).range(2..=10_000))]
    pub seeds: u32,
    /// First seed of the clocks and phases; the others follow it.
    #[arg(long, value_name = "N", default_value_t = SEED)]
    pub seed: u64,
    /// Repetitions of each execution type with a seed, where the scatter is measured.
    #[arg(long, value_name = "N", default_value_t = REPETITIONS, value_parser = clap::value_parser!(u32).range(2..=10_000))]
    pub reps: u32,
    /// Directory for the rows; given again, a calibration that ended early goes on.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Write the numbers into the setup's file, with a note on how well each is known. The file's comments stay.
    #[arg(long)]
    pub write: bool,
    /// Files for other programs.
    #[command(flatten)]
    pub exports: FigureExports,
}

/// Calibrates a setup and prints the numbers that were found, or writes them into its file.
///
/// # Errors
///
/// The setup or its application cannot be used, the paper has no figures for it, or its file cannot be written.
pub fn run(options: &CalibrateOptions, commit: &str) -> Result<Exit, Failure> {
    let (setup, found) = options.setup.load()?;
    found.plan(&setup)?;
    let file = options.write.then(|| Path::new(options.setup.name()));
    if let Some(file) = file
        && !file.is_file()
    {
        let error = anyhow!(
            "--write changes a setup's file, and {} is built in: name its file by --setup",
            options.setup.name()
        );
        return Err(Failure::new(Exit::Usage, error));
    }
    if setup.paper.is_none() {
        let error = anyhow!(
            "setup {} has no section [paper], and calibration needs its figures: give rc, sm and cm there, or calibrate a setup that has them, such as A",
            setup.name
        );
        return Err(Failure::new(Exit::Usage, error));
    }
    let read = [("the setup", options.setup.file()), ("the application", found.path.as_deref())];
    let own = Own { directory: options.out.as_deref(), files: &CLAIMED_FILES };
    outputs::check(&options.exports.files(), &read, own)?;
    options.exports.check_writable()?;
    let is_interrupted = watch_for_interrupt()?;
    let mut study = ListedStudy::in_memory("seeds", true, &is_interrupted);
    if let Some(directory) = &options.out {
        // The jobs follow from the figures: whatever seeds are asked for, those that are saved are used.
        let claim = format!("calibrate\n{}\n{}", setup::setup_to_toml(&setup)?, found.text);
        let (options, command, results) = (claim.as_str(), "", &[]);
        let origin = RowsOrigin { directory, options, command, results, commit };
        study = study.saved_in(&StudyClaim::checked(origin)?)?;
    }
    let seeds = Seeds {
        application: &found.application,
        first: options.seed,
        count: options.seeds,
        reps: options.reps,
        study: &study,
    };
    let mut settled: Vec<(Parameter, String)> = Vec::new();
    let calibration = calibrate(&setup, seeds, |number, interval| {
        errln!("{}: {interval}", number.key());
        settled.retain(|(earlier, _)| *earlier != number);
        settled.push((number, interval));
    });
    let calibration = match calibration {
        Err(error) if error.is::<Interrupted>() => {
            settled.iter().for_each(|(number, interval)| outln!("# {}: {interval}", number.key()));
            let all = Parameter::ALL.iter().filter(|number| number.of(&setup).is_some());
            return Ok(interrupted(settled.len(), all.count(), "numbers"));
        }
        ended => ended?,
    };
    out!("{}", calibration.report());
    let export = export::CalibrationExport::of(&calibration, &found.application.name, options.seed);
    options.exports.write(&outputs::json(&export)?, &export.csv())?;
    if let Some(file) = file {
        write::into_file(file, &calibration)?;
        errln!("{} has the new numbers.", file.display());
    }
    Ok(Exit::Pass)
}

/// Calibrates a setup on the paper's figures for it.
///
/// # Errors
///
/// The paper has no figures for this setup, a run fails, a figure is out of reach of its number, or an interrupt ends it.
pub fn calibrate(
    setup: &Setup,
    seeds: Seeds<'_>,
    progress: impl FnMut(Parameter, String),
) -> anyhow::Result<Calibration> {
    let Some(paper) = setup.paper.clone() else {
        bail!("setup {} has no [paper] figures to calibrate on", setup.name);
    };
    let mut search = Search { paper, seeds, setup: setup.clone(), progress };
    let mut found = Vec::new();
    for number in [Parameter::Quantum, Parameter::StartQuantum] {
        found.extend(search.settle(number, true)?);
    }
    for _ in 1..ROUNDS {
        search.settle(Parameter::Velocity, false)?;
        search.settle(Parameter::Overhead, false)?;
    }
    for number in [Parameter::Velocity, Parameter::Overhead, Parameter::StartCycles] {
        found.extend(search.settle(number, true)?);
    }
    let Search { paper, setup, .. } = search;
    let figures = seeds.measure(&setup, &Metric::ALL)?;
    let reached = Metric::ALL.into_iter().zip(figures).collect();
    let speed = speed_and_acceleration(&setup, seeds)?;
    Ok(Calibration { paper, found, reached, speed, conditions: Conditions::of(seeds), setup })
}

/// A setup whose numbers are found one after the other.
struct Search<'a, P> {
    paper: Paper,
    seeds: Seeds<'a>,
    setup: Setup,
    progress: P,
}

impl<P: FnMut(Parameter, String)> Search<'_, P> {
    /// Finds a number, and takes it over if the setup calls it calibrated: with all its digits, or `as_known` with no more
    /// than are known. `None` if the setup does not have the number.
    fn settle(&mut self, number: Parameter, as_known: bool) -> anyhow::Result<Option<Found>> {
        let Some((own, from)) = number.of(&self.setup) else { return Ok(None) };
        let targets: Vec<FitTarget> =
            number.figures(&self.setup).iter().map(|figure| self.target(*figure)).collect();
        let measure = |value: f64| self.measure(number, &targets, value);
        let fit = fit_of(number, &targets, own, measure)
            .with_context(|| format!("cannot calibrate {}", number.key()))?;
        let finest = number.range().2;
        let steps = targets.first().copied().filter(|_| number.has_steps());
        let value = match (from, as_known, steps) {
            (Provenance::Calibrated, true, Some(target)) => {
                let measure = |value| Ok(measure(value)?.first().context("no figure")?.ms);
                fit.measured(target, own, finest, measure)?
            }
            (Provenance::Calibrated, true, None) => fit.rounded(own, finest),
            (Provenance::Calibrated, false, _) => fit.value,
            _ => own,
        };
        self.setup = number.put(value, self.setup.clone());
        let found = Found { number, value, from, fit };
        (self.progress)(number, found.interval());
        Ok(Some(found))
    }

    /// Returns the targets' figures with a value of a number.
    fn measure(&self, number: Parameter, targets: &[FitTarget], value: f64) -> anyhow::Result<Vec<Estimate>> {
        let figures: Vec<Metric> = targets.iter().map(|target| target.figure).collect();
        let setup = number.put(value, self.setup.clone());
        self.seeds.measure(&setup, &figures)
    }

    /// Returns the paper's figure with its error. An AET ends with a robot cycle, so that it is met to the scatter of one.
    fn target(&self, figure: Metric) -> FitTarget {
        let Estimate { ms, error_ms } = figure.of_paper(&self.paper);
        let cycle_ms = f64::from(self.setup.robot.cycle_us.value) / 1e3;
        let error_ms = match figure {
            Metric::Aet(_) => libm::hypot(error_ms, cycle_ms / 12.0_f64.sqrt()),
            Metric::Mad(_) | Metric::CmMinusRc => error_ms,
        };
        FitTarget { figure, wanted: Estimate { ms, error_ms } }
    }
}

fn fit_of(
    number: Parameter,
    targets: &[FitTarget],
    own: f64,
    measure: impl Fn(f64) -> anyhow::Result<Vec<Estimate>> + Copy,
) -> anyhow::Result<Fit> {
    let range = number.range();
    match number {
        Parameter::StartCycles => fit::fit_from_zero(targets, range, measure),
        Parameter::Velocity => fit::fit(targets, own, range, measure)
            .or_else(|_| fit::fit(targets, SLOW_PERCENT, range, measure)),
        Parameter::Quantum | Parameter::StartQuantum | Parameter::Overhead => {
            fit::fit(targets, own, range, measure)
        }
    }
}

/// What RC's AET depends on besides the programmed speed.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Speed {
    /// Change of RC's AET, in ms, for a hundredth more programmed speed.
    pub by_velocity_ms: f64,
    /// The same for a hundredth more programmed acceleration.
    pub by_acceleration_ms: f64,
    /// RC's AET at full speed, in ms.
    pub at_full_speed_ms: f64,
}

fn speed_and_acceleration(setup: &Setup, seeds: Seeds<'_>) -> anyhow::Result<Speed> {
    let rc = |setup: &Setup| -> anyhow::Result<f64> {
        let figure = Metric::Aet(plc_node::ExecutionType::Rc);
        Ok(seeds.measure(setup, &[figure])?.first().context("no figure")?.ms)
    };
    let (velocity, acceleration) =
        (setup.motions.velocity_percent.value, setup.motions.acceleration_percent.value);
    let by_a_hundredth = |vary: &dyn Fn(f64) -> Setup, value: f64| -> anyhow::Result<f64> {
        let (less, more) = (value * (1.0 - VARIED), (value * (1.0 + VARIED)).min(100.0));
        let change = rc(&vary(more))? - rc(&vary(less))?;
        Ok(change / ((more - less) / value) / 100.0)
    };
    Ok(Speed {
        by_velocity_ms: by_a_hundredth(&|percent| setup.clone().with_velocity(percent), velocity)?,
        by_acceleration_ms: by_a_hundredth(
            &|percent| setup.clone().with_acceleration(percent),
            acceleration,
        )?,
        at_full_speed_ms: rc(&setup.clone().with_velocity(100.0))?,
    })
}
