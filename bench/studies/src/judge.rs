//! `bench judge`: random motion lists on the robot, each robot cycle held against laws and kinematics that are not its own.

mod tally;

use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use ::judge::{Case, Class, Outcome, Violation, generator, hunt, shrink};
use anyhow::Context;
use clap::Args;
use node::list::{List, flat, list};
use setup::Setup;

use crate::directory;
use crate::engine::claim::{RowsOrigin, StudyClaim};
use crate::engine::numbered::NumberedJobs;
use crate::event_loop::{interrupted, watch_for_interrupt};
use crate::jobs::{self, Pool};
use records::exit::{Exit, Failure};
use report::{errln, in_shell, outln};
use tally::{BrokenList, ListsTally, TotalTally};

/// Directory for cases where none is given.
const JUDGED: &str = "judged";

/// The file with the counts of each job of [`CHUNK`] lists.
const LISTS_FILE: &str = "lists.csv";

/// Default number of lists.
const LISTS: u64 = 10_000;

/// Number of lists that a core executes in one job.
const CHUNK: u64 = 250;

const EXAMPLES: &str = "\
Examples:
  bench judge --setup B                        10000 lists in some seconds
  bench judge --lists 1000000 --seed 7 --out found    given again, it goes on after an interrupt or a kill
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
    /// Directory for cases that break a law: three of each law, written when they are found, and shrunk to what is needed at the end
    /// [default: judged]. Where it is given, it also keeps what was judged, and an interrupted call goes on.
    #[arg(long, value_name = "DIR", conflicts_with = "case")]
    pub out: Option<PathBuf>,
    /// Laws that are not checked; commas or blanks between them.
    #[arg(long, value_name = "LAW", num_args = 1.., value_parser = list(law))]
    pub ignore: Vec<List<Class>>,
    /// Jobs of 250 lists at a time [default: one a core].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub threads: Option<u16>,
    /// Print the result only: no progress.
    #[arg(long, short)]
    pub quiet: bool,
}

impl JudgeOptions {
    /// Returns the directory for cases.
    fn directory(&self) -> &Path {
        self.out.as_deref().unwrap_or(Path::new(JUDGED))
    }

    /// Returns the lists of a job.
    fn numbers(&self, job: u64) -> Range<u64> {
        job * CHUNK..((job + 1) * CHUNK).min(self.lists)
    }
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
pub fn run(options: &JudgeOptions, commit: &str) -> Result<Exit, Failure> {
    let ignored = flat(&options.ignore);
    let classes: Vec<Class> = Class::ALL.into_iter().filter(|class| !ignored.contains(class)).collect();
    match &options.case {
        Some(path) => run_case(path, &classes),
        None => Judged { options, setup: &setup::setup(&options.setup)?, classes: &classes }.run(commit),
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

/// What lists are drawn and judged by.
#[derive(Clone, Copy)]
struct Judged<'a> {
    options: &'a JudgeOptions,
    setup: &'a Setup,
    classes: &'a [Class],
}

impl Judged<'_> {
    fn run(self, commit: &str) -> Result<Exit, Failure> {
        let Self { options, setup, .. } = self;
        let started = Instant::now();
        let is_interrupted = watch_for_interrupt()?;
        let mut tally = TotalTally::default();
        let (quiet, threads) = (options.quiet, options.threads);
        let pool = Pool { name: "judge", quiet, threads, interrupted: &is_interrupted };
        let mut jobs = NumberedJobs::in_memory(pool, options.lists.div_ceil(CHUNK));
        if let Some(directory) = &options.out {
            let claim = self.claim(directory, commit)?;
            jobs = jobs.saved_in(&claim, LISTS_FILE, ListsTally::HEAD, |_, fields| {
                tally.add(ListsTally::of_fields(fields)?);
                Some(())
            })?;
        }
        let known = tally.lists;
        jobs.each(
            |job| {
                let drawn = generator::any_case;
                let found = hunt(drawn, setup, options.seed, options.numbers(job), self.classes);
                found.context("a random arm makes no sense")
            },
            |_, judged| {
                let judged = ListsTally::of(judged);
                let line = judged.line();
                // Before the line: a case whose writing was cut off is found again.
                tally.add(judged).iter().try_for_each(|one| self.write_as_drawn(one))?;
                Ok(Some(line))
            },
        )?;
        print(&tally, options, setup);
        let took_s = started.elapsed().as_secs_f64();
        errln!("took {took_s:.1} s: {:.0} lists/s", (tally.lists - known) as f64 / took_s);
        print_laws(&tally);
        self.write_shrunk(&tally.first)?;
        if is_interrupted.load(Ordering::Relaxed) && tally.lists < options.lists {
            return Ok(interrupted(tally.lists as usize, options.lists as usize, "lists"));
        }
        Ok(if tally.first.is_empty() { Exit::Pass } else { Exit::RunFailed })
    }

    /// Claims the directory for these lists. Cases without a claim are of a call without `--out`, or of an older version.
    fn claim(self, directory: &Path, commit: &str) -> Result<StudyClaim, Failure> {
        let Self { options, setup, classes } = self;
        let names: Vec<&str> = classes.iter().map(|class| class.name()).collect();
        let ignored: Vec<&str> = flat(&options.ignore).iter().map(|class| class.name()).collect();
        let ignored =
            if ignored.is_empty() { String::new() } else { format!(" --ignore {}", ignored.join(",")) };
        let (lists, seed) = (options.lists, options.seed);
        let command = format!("--setup {}{ignored} --lists {lists} --seed {seed}", in_shell(&options.setup));
        let described = setup::setup_to_toml(setup)?;
        let jobs = format!("judge {lists} {seed} {CHUNK} {}\n{described}", names.join(","));
        let entries = fs::read_dir(directory).into_iter().flatten().flatten();
        let entries: Vec<String> = entries.filter_map(|entry| entry.file_name().into_string().ok()).collect();
        let is_case = |name: &&str| {
            let of_class = |class: Class| name.contains(&format!("-{}-", class.name()));
            name.ends_with(".toml") && Class::ALL.into_iter().any(of_class)
        };
        let mut results: Vec<&str> = entries.iter().map(String::as_str).filter(is_case).collect();
        results.push(LISTS_FILE);
        StudyClaim::checked(RowsOrigin {
            directory,
            options: &jobs,
            command: &command,
            results: &results,
            commit,
        })
    }

    /// Writes one of the first cases of each class as soon as it is found, as it was drawn: what comes later takes its time.
    fn write_as_drawn(self, one: &BrokenList) -> anyhow::Result<()> {
        directory::make(self.options.directory()).map_err(|failure| failure.error)?;
        let (case, violation) = self.again(one)?;
        let path = write(self.options, self.setup, case, one.number, &violation)?;
        errln!("{}: {violation}", path.display());
        Ok(())
    }

    /// Draws and runs a list that broke a law once more; returns it with what it breaks.
    fn again(self, one: &BrokenList) -> anyhow::Result<(Case, Violation)> {
        let case = generator::any_case(self.setup, self.options.seed, one.number);
        let outcome = ::judge::run(&case, self.setup, self.classes).context("a random arm makes no sense")?;
        let violation = outcome.violation.filter(|violation| violation.class == one.class);
        let violation = violation.with_context(|| {
            format!("list {} broke {} and does not again; use another --out", one.number, one.class.name())
        })?;
        Ok((case, violation))
    }

    /// Shrinks the first cases of each class.
    fn write_shrunk(self, first: &[BrokenList]) -> Result<(), Failure> {
        let Self { options, setup, classes } = self;
        if !first.is_empty() {
            directory::make(options.directory())?;
        }
        let shrink = |one: &BrokenList| {
            let (case, violation) = self.again(one)?;
            let (case, least) = shrink::shrink(&case, &violation, setup, classes);
            let path = write(options, setup, case, one.number, &least)?;
            Ok(format!("{}: {least}", path.display()))
        };
        let lines = jobs::run("shrink", options.quiet, &AtomicBool::new(false), first, shrink)?;
        lines.iter().flatten().for_each(|line| outln!("{line}"));
        Ok(())
    }
}

/// Returns a plant's time in hours, or in seconds where that is no tenth of an hour.
fn in_words(plant: Duration) -> String {
    match plant.as_secs_f64() {
        short if short < 360.0 => format!("{short:.1} s"),
        long => format!("{:.1} h", long / 3600.0),
    }
}

fn print(tally: &TotalTally, options: &JudgeOptions, setup: &Setup) {
    let TotalTally { lists, cycles, plant, motions, ended: [done, aborted, failed], .. } = *tally;
    outln!("Setup {}: {}", setup.name, setup.title);
    outln!(
        "{lists} lists of seed {}, {motions} motions, {cycles} robot cycles: {}",
        options.seed,
        in_words(plant)
    );
    outln!("skills: {done} done, {aborted} aborted, {failed} ended by an error");
}

fn print_laws(tally: &TotalTally) {
    if tally.first.is_empty() {
        outln!("no law broken");
        return;
    }
    outln!("{} lists broke a law:", tally.broken());
    for (class, lists) in &tally.by_class {
        outln!("{lists:>8}  {}", class.name());
    }
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
    let path = options.directory().join(format!("{}-{}-{number}.toml", setup.name, violation.class.name()));
    let text = case.to_toml().context("cannot write a case as TOML")?;
    fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
    Ok(path)
}
