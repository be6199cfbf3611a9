//! `bench explore`: runs with one fault at each frame of a short run, or with pairs of faults drawn by a seed, in virtual
//! time; counts how they end.
//!
//! ```text
//! fault      the faults of a run
//! runs       which runs are made with which faults
//! subject    what is explored, as its files in the directory and as the options of its commands
//! explored   the nodes with faults: a robot that works alone, or a cell
//! clean_run  the run without faults, and runs with faults, which are compared with it
//! classes    counts of the outcomes
//! table      the counts and the reasons on screen
//! page       explore.html
//! ```

mod classes;
mod clean_run;
mod explored;
mod fault;
mod page;
mod runs;
mod subject;
mod table;

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::SystemTime;

use anyhow::Context as _;
use clap::Args;
use node::list::{List, flat};
use plc_node::ExecutionType;

use super::engine::claim::StudyClaim;
use super::engine::lines::field;
use super::engine::numbered::NumberedJobs;
use super::event_loop::{interrupted, watch_for_interrupt};
use super::jobs::Pool;
use super::setup_option::{DrivesOption, SetupOption};
use classes::{Classes, Outcome};
use clean_run::CleanRun;
pub use fault::What;
use fault::{Extent, FaultTexts, LONGEST_HOLD_MS, Lengths};
use records::exit::{Exit, Failure};
use records::run_directory::{self, Durability, replace};
use report::in_shell;
use report::outln;
use report::progress::label;
use runs::{Job, drawn, singles};
use subject::Subject;

/// The page with the counts.
const PAGE: &str = "explore.html";

/// The file with the outcomes, a line for each run in the order of the runs.
const OUTCOMES: &str = "outcomes.csv";

const HEAD: &str = "run,type,faults,class,later_ns,reason";

/// Options of the exploration.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bench explore                               every kind of fault at every frame of RC, SM and CM on Setup A: 90,000 runs
  bench explore --setup B --types cm --every 10 --kinds lose,cut
  bench explore --pairs 100000 --seed 7 --out runs/pairs
  bench explore --drives ethercat --kinds drive-block --draws 400
  bench explore --setup G --every 500         every kind of fault at both stations of a cell with a shared zone

Each run that does not pass is a command that runs again, such as
  bench --setup A --mode virtual --types cm --reps 1 --fault to-robot:lose-frame=117
An exploration that was interrupted goes on if the same options and the same --out are given again.")]
pub struct ExploreOptions {
    /// Which setup.
    #[command(flatten)]
    pub setup: SetupOption,
    /// What moves the robot's joints.
    #[command(flatten)]
    pub drives: DrivesOption,
    /// A built-in application's name, or the path of a .toml file, in place of seven short motions; with several stations in place of
    /// the setup's.
    #[arg(long, value_name = "NAME|FILE")]
    pub application: Option<String>,
    /// Which execution types; commas or blanks between them.
    #[arg(long, value_name = "TYPE", default_value = "rc,sm,cm", num_args = 1..)]
    pub types: Vec<List<ExecutionType>>,
    /// Which faults, at each station; commas or blanks between them [default: lose, double, hold, hold-old, flip-memory, flip-wire, cut, restart-robot,
    /// restart-plc; and where the robot has drives, drive-block, drive-fault, drive-stop].
    #[arg(long, value_name = "KIND", num_args = 1..)]
    pub kinds: Vec<List<What>>,
    /// Test only every Nth frame of each direction.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=100_000_000))]
    pub every: u64,
    /// Make this many runs with two faults each, drawn by the seed, in place of one fault at every frame.
    #[arg(long, value_name = "N", conflicts_with = "every", value_parser = clap::value_parser!(u32).range(1..=100_000_000))]
    pub pairs: Option<u32>,
    /// Make this many runs with one fault each, drawn by the seed, in place of one fault at every frame.
    #[arg(long, value_name = "N", conflicts_with_all = ["every", "pairs"], value_parser = clap::value_parser!(u32).range(1..=100_000_000))]
    pub draws: Option<u32>,
    /// Seed of clocks, phases and pauses, of pairs, and of which bit flips.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// How long a frame is held back, in ms.
    #[arg(long, value_name = "MS", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub hold_ms: u32,
    /// How long the cable is cut, in ms.
    #[arg(long, value_name = "MS", default_value_t = 10, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub cut_ms: u32,
    /// How long a node is off before it is started again, in ms.
    #[arg(long, value_name = "MS", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub restart_ms: u32,
    /// A run that passes later than this is wrong, in ms.
    #[arg(long, value_name = "MS", default_value_t = 500)]
    pub late_ms: u32,
    /// Directory for outcomes and page [default: runs/TIME-SETUP-explore].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Runs at a time [default: one a core].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub threads: Option<u16>,
    /// Print the table only: no progress.
    #[arg(long, short)]
    pub quiet: bool,
}

impl ExploreOptions {
    const fn lengths(&self) -> Lengths {
        Lengths { hold: self.hold_ms, cut: self.cut_ms, restart: self.restart_ms }
    }

    /// Returns the kinds of faults, by default all that a robot of the setup can have.
    fn kinds_for(&self, setup: &str, has_drives: bool) -> Result<Vec<What>, Failure> {
        let kinds = flat(&self.kinds);
        match kinds.iter().find(|what| what.is_of_drives() && !has_drives) {
            Some(what) => {
                let error = anyhow::anyhow!(
                    "--kinds {what}: no robot of setup {setup} has drives; add --drives ethercat"
                );
                Err(Failure::new(Exit::Usage, error))
            }
            None if kinds.is_empty() => {
                Ok(What::ALL.into_iter().filter(|what| has_drives || !what.is_of_drives()).collect())
            }
            None => Ok(kinds),
        }
    }

    /// Returns the options that determine the jobs, as a shell takes them.
    fn command(&self, kinds: &[What]) -> String {
        let Self {
            setup,
            drives,
            application,
            types,
            every,
            pairs,
            draws,
            seed,
            hold_ms,
            cut_ms,
            restart_ms,
            late_ms,
            ..
        } = self;
        let joined = |texts: Vec<String>| texts.join(",");
        let types = joined(flat(types).iter().map(ToString::to_string).collect());
        let kinds = joined(kinds.iter().map(ToString::to_string).collect());
        let jobs = match (pairs, draws) {
            (Some(pairs), _) => format!("--pairs {pairs}"),
            (None, Some(draws)) => format!("--draws {draws}"),
            (None, None) => format!("--every {every}"),
        };
        let drives = drives.in_command();
        let application = application.as_ref();
        let application =
            application.map_or_else(String::new, |name| format!(" --application {}", in_shell(name)));
        format!(
            "--setup {}{drives}{application} --types {types} --kinds {kinds} {jobs} --seed {seed} --hold-ms {hold_ms} --cut-ms {cut_ms} \
             --restart-ms {restart_ms} --late-ms {late_ms}",
            in_shell(setup.name())
        )
    }
}

/// An exploration: what is run, and how it ended so far.
struct Exploration<'a> {
    /// Name of the setup.
    name: &'a str,
    /// Its title.
    about: &'a str,
    options: &'a ExploreOptions,
    clean_runs: Vec<CleanRun<'a>>,
    /// The `--application` of commands that run again, after a blank; empty where the setup's own one is run.
    application: &'a str,
    texts: &'a FaultTexts,
    classes: Classes,
    kinds: &'a [What],
}

/// Runs all faults, prints how the runs ended and saves it.
///
/// # Errors
///
/// The setup cannot be read, a run without faults does not pass, or the outcomes cannot be written.
pub fn run(options: &ExploreOptions, commit: &str) -> Result<Exit, Failure> {
    let started = SystemTime::now();
    let default = || run_directory::default_path(options.setup.name(), "explore", started);
    let directory = options.out.clone().unwrap_or_else(default);
    let (subject, claim) = Subject::prepare(options, &directory, commit)?;
    let Subject { name, title, explored, texts, kinds, application } = subject;
    let longest_ms = if kinds.contains(&What::HoldOld) { LONGEST_HOLD_MS } else { 0 };
    let clean = |execution_type| {
        CleanRun::of(execution_type, &*explored, options.seed, &texts, options.late_ms, longest_ms)
    };
    let clean_runs = flat(&options.types).into_iter().map(clean).collect::<anyhow::Result<_>>()?;
    let mut exploration = Exploration {
        name: &name,
        about: &title,
        options,
        clean_runs,
        application: &application,
        texts: &texts,
        classes: Classes::default(),
        kinds: &kinds,
    };
    let is_interrupted = watch_for_interrupt()?;
    let runs = exploration.run(&claim, &is_interrupted)?;
    outln!("{}", exploration.table());
    exploration.tell_reasons();
    if is_interrupted.load(Ordering::Relaxed) {
        let done = exploration.classes.runs() as usize;
        outln!(
            "\n  Saved in {}; give the same options with --out {} to go on.",
            directory.display(),
            in_shell(directory.display())
        );
        return Ok(interrupted(done, runs, "runs"));
    }
    replace(&directory.join(PAGE), &exploration.page()?, Durability::Written)?;
    outln!("\n  Saved in {}.", directory.display());
    Ok(if exploration.classes.wrong() > 0 { Exit::RunFailed } else { Exit::Pass })
}

impl Exploration<'_> {
    fn jobs(&self) -> Vec<Job> {
        let extents: Vec<Vec<Extent>> = self.clean_runs.iter().map(|clean| clean.extents.clone()).collect();
        let (kinds, seed) = (self.kinds, self.options.seed);
        match (self.options.pairs, self.options.draws) {
            (Some(count), _) => drawn(&extents, kinds, [count as usize, 2], seed),
            (None, Some(count)) => drawn(&extents, kinds, [count as usize, 1], seed),
            (None, None) => singles(&extents, kinds, self.options.every, seed),
        }
    }

    /// Makes the runs that the directory does not have yet. Returns how many there are in all.
    fn run(&mut self, claim: &StudyClaim, is_interrupted: &AtomicBool) -> Result<usize, Failure> {
        let jobs = self.jobs();
        let Self { clean_runs, classes, options, texts, .. } = self;
        let (quiet, threads) = (options.quiet, options.threads);
        let job = |run: u64| jobs.get(usize::try_from(run).ok()?);
        let clean = |run| clean_runs.get(job(run)?.type_index).zip(job(run));
        let pool = Pool { name: "explore", quiet, threads, interrupted: is_interrupted };
        let numbered = NumberedJobs::in_memory(pool, jobs.len() as u64);
        let numbered = numbered.saved_in(claim, OUTCOMES, HEAD, |run, fields| {
            classes.count(job(run)?, &Outcome::of_fields(fields)?);
            Some(())
        })?;
        numbered.each(
            |run| clean(run).map(|(clean, job)| clean.with(&job.faults)).context("a job without its run"),
            |run, outcome| {
                let (clean, job) = clean(run).context("a job without its run")?;
                classes.count(job, &outcome);
                let faults: Vec<_> = job.faults.iter().map(|fault| texts.of(fault)).collect();
                let Outcome { class, later_ns, reason } = &outcome;
                let [faults, reason] = [&faults.join(" "), reason].map(|text| field(text));
                let name = label(clean.execution_type());
                Ok(Some(format!("{name},{faults},{},{later_ns},{reason}", class.name())))
            },
        )?;
        Ok(jobs.len())
    }

    /// Returns the command that makes a run again.
    fn command_of(&self, clean: &CleanRun<'_>, faults: &[fault::Injected]) -> String {
        let (execution_type, repetitions) = (clean.execution_type(), clean.repetitions(faults));
        let faults: String =
            faults.iter().map(|fault| format!(" --fault {}", self.texts.of(fault))).collect();
        format!(
            "bench --setup {}{}{} --mode virtual --types {execution_type} --reps {repetitions} --seed {}{faults}",
            in_shell(self.options.setup.name()),
            self.options.drives.in_command(),
            self.application,
            self.options.seed
        )
    }
}
