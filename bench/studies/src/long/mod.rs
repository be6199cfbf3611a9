//! `bench long`: a MoveContinuousSkill of millions of motions, which the paper claims to be possible, in virtual
//! time.
//!
//! ```text
//! supply   the motions: a thread plans or reads them, a few thousand ahead
//! run      both nodes, which execute them; digests of the motions sent and of the motions accepted
//! memory   memory of this process
//! ```
//!
//! It is one job: there is nothing to divide between threads, and no point between two jobs at which a killed run could go on.

mod memory;
mod run;
mod supply;

use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow};
use clap::Args;
use setup::{Setup, SlotForm};

pub use memory::PeakResident;
pub use run::{Finished, LongRun, Mismatch};
pub use supply::{Origin, SuppliedMotions, SupplyThread};

use crate::event_loop::watch_for_interrupt;
use crate::jobs::Progress;
use crate::outputs::{self, Own};
use crate::setup_option::SetupOption;
use records::exit::{Exit, Failure};
use report::errln;
use report::outln;

/// The default application: many short motions, repeated.
const APPLICATION: &str = "engraving";

/// Default number of motions.
const MOTIONS: u32 = 5_000_000;

/// True time between two checks of the digests and for Ctrl-C.
const SLICE: Duration = Duration::from_secs(1);

/// Options of a long run.
#[derive(Args, Debug)]
pub struct LongOptions {
    /// Which setup.
    #[command(flatten)]
    pub setup: SetupOption,
    /// Motions of the one MoveContinuousSkill [default: 5000000, or all of a list].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub motions: Option<u32>,
    /// The application that is repeated: a built-in one's name, or the path of a .toml file.
    #[arg(long, value_name = "NAME|FILE", default_value = APPLICATION, conflicts_with = "from")]
    pub application: String,
    /// Take the motions from a list, one a line; see --write.
    #[arg(long, value_name = "FILE")]
    pub from: Option<PathBuf>,
    /// Write the motions to a list instead of running them.
    #[arg(long, value_name = "FILE")]
    pub write: Option<PathBuf>,
    /// Seed of the clocks and phases.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Print the result only: no progress.
    #[arg(long, short)]
    pub quiet: bool,
}

/// Runs the motions and prints whether all arrived, or writes them to a list.
///
/// # Errors
///
/// The setup, the application or the list cannot be used; the run fails; a motion was lost, duplicated or reordered.
pub fn run(options: &LongOptions) -> Result<Exit, Failure> {
    let (setup, directory) = setup::setup_with_directory(options.setup.name())?;
    let (origin, application) = origin(options, &setup, directory.as_deref())?;
    let usage = |error| Failure::new(Exit::Usage, error);
    if setup.plc.sends_in_form() == SlotForm::Compact {
        return Err(usage(anyhow!(
            "setup {}: plc.form = \"compact\": this verb sends full motions; leave it out",
            setup.name
        )));
    }
    let most = match (options.motions, &origin) {
        (Some(motions), _) => motions,
        (None, Origin::List(_)) => u32::MAX,
        (None, Origin::Application(_)) => MOTIONS,
    };
    if let Some(path) = &options.write {
        check_list(options, path, application.as_deref())?;
        let sum = origin.write(most, path)?.map_err(usage)?;
        outln!("{}: {sum}", path.display());
        return Ok(Exit::Pass);
    }
    let total = origin.count(most).map_err(usage)?;
    if let Some(asked) = options.motions.filter(|asked| total < *asked) {
        errln!("warning: {} has {total} motions, not the {asked} of --motions", origin.name());
    }
    outln!("Setup {}: {}", setup.name, setup.title);
    outln!("MoveContinuous of {total} motions of {}, virtual mode, seed {}\n", origin.name(), options.seed);
    drive(options, &setup, origin, total)
}

impl LongOptions {
    /// Returns the line of the list whose motion made the run fail, as `FILE:LINE`; `None` where the motions come from an
    /// application or no motion is at fault.
    fn line_of(&self, error: &anyhow::Error) -> Option<String> {
        let path = self.from.as_deref()?;
        let motion = error.downcast_ref::<plc_node::Failure>()?.cause.motion()?;
        let line = supply::line_of(path, motion)?;
        Some(format!("{}:{line}", path.display()))
    }
}

/// Rejects a list that would replace what its motions are made from.
fn check_list(options: &LongOptions, path: &Path, application: Option<&Path>) -> Result<(), Failure> {
    let read = [
        ("the setup", options.setup.file()),
        ("the application", application),
        ("the list of --from", options.from.as_deref()),
    ];
    outputs::check(&[("--write", Some(path))], &read, Own::default())
}

/// Returns where the motions come from, and the file of the application if they come from one.
fn origin(
    options: &LongOptions,
    setup: &Setup,
    directory: Option<&Path>,
) -> Result<(Origin, Option<PathBuf>), Failure> {
    match &options.from {
        Some(path) => Ok((Origin::List(path.clone()), None)),
        None => {
            let found = planning::application(&options.application, directory)?;
            found.plan(setup)?;
            let origin = Origin::Application(Box::new((found.application, setup.clone())));
            Ok((origin, found.path))
        }
    }
}

/// Runs until the end, an error or an interrupt.
fn drive(options: &LongOptions, setup: &Setup, origin: Origin, total: u32) -> Result<Exit, Failure> {
    let is_interrupted = watch_for_interrupt()?;
    let started = Instant::now();
    let at_start = PeakResident::now()?;
    let failed = |error| Failure::new(Exit::RunFailed, error);
    let mut run = LongRun::start(setup, origin, total, options.seed).map_err(failed)?;
    let mut progress = Progress::start("motions", options.quiet, total.into());
    let mut milestones = Milestones { total, started, tenths: 0, peak_at_a_tenth: None };
    let ended = loop {
        if is_interrupted.load(Ordering::Relaxed) {
            break None;
        }
        match run.advance(SLICE) {
            Ok(None) => {}
            Ok(Some(execution)) => break Some(Ok(execution)),
            Err(error) => break Some(Err(error)),
        }
        progress.set(run.digests()[1].sum().motions);
        if let Some(line) = milestones.next(&run)? {
            progress.line(&line);
        }
    };
    progress.end();
    let (plant, elapsed) = (run.plant_time(), started.elapsed());
    let accepted = run.digests()[1].sum();
    let so_far = format!(
        "after {:.0} s of plant time, with {} of {total} motions on the robot's path",
        plant.as_secs_f64(),
        accepted.motions,
    );
    let Some(ended) = ended else {
        return Err(Failure::new(
            Exit::Interrupted,
            anyhow!("interrupted {so_far}; the PLC and the robot agreed up to there"),
        ));
    };
    let line = ended.as_ref().err().and_then(|error| options.line_of(error));
    let at = line.map_or_else(String::new, |line| format!(", at {line}"));
    let finished =
        run.finish(ended).with_context(|| format!("the run failed {so_far}{at}")).map_err(failed)?;
    print(&finished, plant, elapsed);
    let peak = milestones.peak_at_a_tenth;
    let tenth = peak.map_or_else(String::new, |peak| format!("{peak} at 10 %, "));
    outln!("resident memory at most: {at_start} at the start, {tenth}{} at the end", PeakResident::now()?);
    finished.check().map_err(|mismatch| failed(mismatch.into()))?;
    outln!("every motion arrived, once and in order");
    Ok(Exit::Pass)
}

/// Prints the digests and the speed of a finished run.
fn print(finished: &Finished, plant: Duration, elapsed: Duration) {
    let Finished { execution, list, sent, accepted } = finished;
    outln!("digest of the list   {list}\n       of the PLC    {sent}\n       of the robot  {accepted}");
    let rate = f64::from(execution.motions) / elapsed.as_secs_f64();
    outln!(
        "executed {} motions, {} blends suppressed, in {:.3} s of plant time\ntook {:.1} s: {rate:.0} motions/s, {:.0} times faster than the plant",
        execution.motions,
        execution.blends_suppressed,
        execution.execution_time_ns as f64 / 1e9,
        elapsed.as_secs_f64(),
        plant.as_secs_f64() / elapsed.as_secs_f64(),
    );
}

/// What is reported after each tenth of the motions.
struct Milestones {
    total: u32,
    started: Instant,
    /// Tenths of the motions reported so far.
    tenths: u64,
    peak_at_a_tenth: Option<PeakResident>,
}

impl Milestones {
    /// Returns a line if another tenth of the motions is done.
    fn next(&mut self, run: &LongRun) -> anyhow::Result<Option<String>> {
        let [sent, accepted] = run.digests();
        let done = accepted.sum().motions;
        let now = done * 10 / u64::from(self.total);
        if now <= self.tenths {
            return Ok(None);
        }
        self.tenths = now;
        self.peak_at_a_tenth.get_or_insert(PeakResident::now()?);
        let speed = done as f64 / self.started.elapsed().as_secs_f64();
        Ok(Some(format!(
            "{:>4} %  {:>9.0} s of plant time  {speed:>7.0} motions/s  at {:>8} motions PLC {:016x}, robot {:016x}",
            now * 10,
            run.plant_time().as_secs_f64(),
            accepted.mark().motions,
            sent.mark().value,
            accepted.mark().value,
        )))
    }
}
