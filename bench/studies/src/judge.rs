//! `bench judge`: random motion lists on the robot, each robot cycle held against laws and kinematics that are not its own.

use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use ::judge::{Case, Class, Outcome, Tally, Violation, generator, hunt, shrink};
use anyhow::Context;
use clap::Args;
use node::list::{List, flat, list};
use setup::Setup;

use crate::directory;
use crate::event_loop::{interrupted, watch_for_interrupt};
use crate::jobs;
use records::exit::{Exit, Failure};
use report::errln;
use report::outln;

/// Default number of lists.
const LISTS: u64 = 10_000;

/// Number of lists that a core executes in one job.
const CHUNK: u64 = 250;

/// Number of cases of each class that are written, and then shrunk.
const CASES: usize = 3;

const EXAMPLES: &str = "\
Examples:
  bench judge --setup B                        10000 lists in some seconds
  bench judge --lists 1000000 --seed 7 --out found
  bench judge --case found/A-joint-jerk-4421.toml
  bench judge --ignore press-speed             all but one law";

/// Options of the judge.
#[derive(Args, Debug)]
#[command(after_help = EXAMPLES)]
pub struct JudgeOptions {
    /// A built-in setup's name, or the path of a .toml file: the arm and its limits. A third of the lists runs on other
    /// arms of its kind, a third on robot controllers with another cycle and other limits of paths.
    #[arg(long, value_name = "NAME|PATH", default_value = "A")]
    pub setup: String,
    /// Number of lists.
    #[arg(long, value_name = "N", default_value_t = LISTS, value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    pub lists: u64,
    /// Seed of the lists.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Run this case instead: a file that a run with violations wrote.
    #[arg(long, value_name = "FILE")]
    pub case: Option<PathBuf>,
    /// Directory for cases that break a law: three of each law, written when they are found, and shrunk to what is needed at the end.
    #[arg(long, value_name = "DIR", default_value = "judged")]
    pub out: PathBuf,
    /// Laws that are not checked; commas or blanks between them.
    #[arg(long, value_name = "LAW", num_args = 1.., value_parser = list(law))]
    pub ignore: Vec<List<Class>>,
    /// Print the result only: no progress.
    #[arg(long, short)]
    pub quiet: bool,
}

fn law(name: &str) -> Result<Class, String> {
    Class::ALL.into_iter().find(|class| class.name() == name).ok_or_else(|| {
        let names: Vec<&str> = Class::ALL.into_iter().map(Class::name).collect();
        format!("there is no law `{name}`; the laws are {}", names.join(", "))
    })
}

/// Runs the lists, or the case, and prints which laws were broken.
///
/// # Errors
///
/// The setup or the case cannot be used, or the disk does not take a file.
pub fn run(options: &JudgeOptions) -> Result<Exit, Failure> {
    let ignored = flat(&options.ignore);
    let classes: Vec<Class> = Class::ALL.into_iter().filter(|class| !ignored.contains(class)).collect();
    match &options.case {
        Some(path) => run_case(path, &classes),
        None => run_lists(options, &setup::setup(&options.setup)?, &classes),
    }
}

fn run_case(path: &Path, classes: &[Class]) -> Result<Exit, Failure> {
    let usage = |error: anyhow::Error| Failure::new(Exit::Usage, error);
    let text = setup::read_plain_text(path).with_context(|| format!("cannot read {}", path.display()));
    let text = text.map_err(usage)?;
    let case = Case::parse(&path.display().to_string(), &text).map_err(|error| usage(error.into()))?;
    let setup = setup::setup(&case.setup)?;
    let Outcome { violation, cycles, motions, .. } =
        ::judge::run(&case, &setup, classes).with_context(|| path.display().to_string()).map_err(usage)?;
    outln!("{cycles} robot cycles, {motions} motions executed");
    match violation {
        Some(violation) => {
            outln!("{violation}");
            Ok(Exit::RunFailed)
        }
        None => {
            outln!("no law broken");
            Ok(Exit::Pass)
        }
    }
}

fn run_lists(options: &JudgeOptions, setup: &Setup, classes: &[Class]) -> Result<Exit, Failure> {
    let started = Instant::now();
    let is_interrupted = watch_for_interrupt()?;
    let chunks: Vec<Range<u64>> = (0..options.lists.div_ceil(CHUNK))
        .map(|chunk| chunk * CHUNK..((chunk + 1) * CHUNK).min(options.lists))
        .collect();
    let written = Mutex::new(Vec::new());
    let tallies = jobs::run("judge", options.quiet, &is_interrupted, &chunks, |numbers| {
        let tally = hunt(generator::any_case, setup, options.seed, numbers.clone(), classes)
            .context("a random arm makes no sense")?;
        tally.found.iter().try_for_each(|found| write_as_drawn(options, setup, found, &written))?;
        Ok(tally)
    })?;
    let mut tally = Tally::default();
    tallies.into_iter().flatten().for_each(|one| tally.add(one));
    print(&tally, options, setup, started);
    let written = written.into_inner().unwrap_or_default();
    write_shrunk(options, setup, classes, &written)?;
    if is_interrupted.load(Ordering::Relaxed) {
        return Ok(interrupted(tally.cases as usize, options.lists as usize, "lists"));
    }
    Ok(if tally.found.is_empty() { Exit::Pass } else { Exit::RunFailed })
}

/// Returns a plant's time in hours, or in seconds where that is no tenth of an hour.
fn in_words(plant: Duration) -> String {
    match plant.as_secs_f64() {
        short if short < 360.0 => format!("{short:.1} s"),
        long => format!("{:.1} h", long / 3600.0),
    }
}

fn print(tally: &Tally, options: &JudgeOptions, setup: &Setup, started: Instant) {
    let Tally { cases, cycles, plant, motions, ended: [done, given_up, failed], .. } = *tally;
    outln!("Setup {}: {}", setup.name, setup.title);
    outln!(
        "{cases} lists of seed {}, {motions} motions, {cycles} robot cycles: {}",
        options.seed,
        in_words(plant)
    );
    outln!("skills: {done} done, {given_up} given up, {failed} ended by an error");
    let took_s = started.elapsed().as_secs_f64();
    errln!("took {took_s:.1} s: {:.0} lists/s", cases as f64 / took_s);
    if tally.found.is_empty() {
        outln!("no law broken");
        return;
    }
    outln!("{} lists broke a law:", tally.found.len());
    for (class, lists) in tally.by_class() {
        outln!("{lists:>8}  {}", class.name());
    }
}

/// A list that broke a law: its number, and the first law that it broke.
type Found = (u64, Violation);

/// Writes one of the first cases of each class as soon as it is found, as it was drawn: what comes later takes its time.
fn write_as_drawn(
    options: &JudgeOptions,
    setup: &Setup,
    found: &Found,
    written: &Mutex<Vec<Found>>,
) -> anyhow::Result<()> {
    let (number, violation) = found;
    {
        let Ok(mut written) = written.lock() else { return Ok(()) };
        if written.iter().filter(|(_, other)| other.class == violation.class).count() >= CASES {
            return Ok(());
        }
        written.push(found.clone());
    }
    directory::make(&options.out).map_err(|failure| failure.error)?;
    let case = generator::any_case(setup, options.seed, *number);
    let path = write(options, setup, case, *number, violation)?;
    errln!("{}: {violation}", path.display());
    Ok(())
}

/// Shrinks the cases that were written.
fn write_shrunk(
    options: &JudgeOptions,
    setup: &Setup,
    classes: &[Class],
    written: &[Found],
) -> Result<(), Failure> {
    let shrink = |(number, violation): &Found| {
        let case = generator::any_case(setup, options.seed, *number);
        let (case, least) = shrink::shrink(&case, violation, setup, classes);
        let path = write(options, setup, case, *number, &least)?;
        Ok(format!("{}: {least}", path.display()))
    };
    let lines = jobs::run("shrink", options.quiet, &AtomicBool::new(false), written, shrink)?;
    lines.iter().flatten().for_each(|line| outln!("{line}"));
    Ok(())
}

/// Writes a case with what it breaks, in place of the same list's case that was written before. Returns the path.
fn write(
    options: &JudgeOptions,
    setup: &Setup,
    mut case: Case,
    number: u64,
    violation: &Violation,
) -> anyhow::Result<PathBuf> {
    case.setup.clone_from(&options.setup);
    case.found = format!("{violation} (list {number} of seed {})", options.seed);
    let path = options.out.join(format!("{}-{}-{number}.toml", setup.name, violation.class.name()));
    let text = case.to_toml().context("cannot write a case as TOML")?;
    fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
    Ok(path)
}
