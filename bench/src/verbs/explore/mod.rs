//! `bench explore`: one fault at every single frame of a short run, in virtual time, and how each of these runs ends.

use std::any::Any;
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};

use anyhow::Context as _;
use clap::Args;
use node::list::{List, flat};
use node::screen;
use planning::Application;
use plc_node::ExecutionType;
use setup::Setup;

use super::jobs;
use super::setup_option::SetupOption;
use crate::outln;
use crate::output::exit::{Exit, Failure};
use crate::output::progress::label;
use crate::records::faults::Fault;
use crate::records::mode::Mode;
use crate::records::schedule::{Schedule, Step};
use crate::stands::verification::{Difference, Verification};
use crate::stands::virtual_run::{Extras, VirtualBus, VirtualRun};

/// Reasons of failed runs that are shown.
const REASONS: usize = 12;

/// Options of the exploration.
#[derive(Args, Debug)]
#[command(after_help = "\
Examples:
  bench explore                               every frame of RC, SM and CM on Setup A: some 60,000 runs
  bench explore --setup B --types cm --every 10

Each run that does not pass is a command that runs again, such as
  bench --setup A --mode virtual --types cm --reps 1 --fault to-robot:lose-frame=117")]
pub struct ExploreOptions {
    /// Which setup.
    #[command(flatten)]
    pub setup: SetupOption,
    /// A built-in application's name, or the path of a .toml file, in place of the setup's.
    #[arg(long, value_name = "NAME|FILE")]
    pub application: Option<String>,
    /// Which execution types.
    #[arg(long, value_name = "TYPE,...", default_value = "rc,sm,cm", num_args = 1..)]
    pub types: Vec<List<ExecutionType>>,
    /// Test only every Nth frame of each direction.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..))]
    pub every: u64,
    /// Seed of clocks, phases and pauses.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// How long a frame is held back, in ms.
    #[arg(long, value_name = "MS", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub hold_ms: u32,
    /// Print the table only: no progress.
    #[arg(long, short)]
    pub quiet: bool,
}

/// What happens to one frame.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
enum What {
    Lose,
    Double,
    Hold,
}

impl What {
    const ALL: [Self; 3] = [Self::Lose, Self::Double, Self::Hold];

    const fn name(self) -> &'static str {
        match self {
            Self::Lose => "lost",
            Self::Double => "twice",
            Self::Hold => "held back",
        }
    }

    /// Returns the fault as `--fault` takes it. Direction 0 is to the robot.
    fn at(self, direction: usize, frame: u64, hold_ms: u32) -> String {
        let to = if direction == 0 { "to-robot" } else { "to-plc" };
        match self {
            Self::Lose => format!("{to}:lose-frame={frame}"),
            Self::Double => format!("{to}:double-frame={frame}"),
            Self::Hold => format!("{to}:hold-frame={frame}@{hold_ms}ms"),
        }
    }
}

/// One run to be made.
struct Job {
    clean: usize,
    what: What,
    fault: String,
}

/// How a run ended.
enum End {
    /// It passed; the value is its time minus that of the run without a fault, in ns.
    Passed { later_ns: i64 },
    /// It failed, with this reason.
    Refused(String),
    /// It ended, but the verification found a difference from the plan.
    Altered(String),
    /// The program panicked.
    Panicked(String),
}

/// The run of a type without a fault, which the others are compared with.
struct Clean {
    step: Step,
    verification: Verification,
    execution_ns: u64,
    frames: [u64; 2],
}

/// Counts of one type and fault.
#[derive(Default)]
struct Row {
    runs: u32,
    same: u32,
    other_time: u32,
    earliest_ns: i64,
    latest_ns: i64,
    refused: u32,
    altered: u32,
    panicked: u32,
}

/// Runs all faults and prints how the runs ended.
///
/// # Errors
///
/// The setup cannot be read, or a run without faults does not pass.
pub fn run(options: &ExploreOptions) -> Result<Exit, Failure> {
    let (setup, found) = options.setup.load_with(options.application.as_deref())?;
    let cleans: Vec<_> = flat(&options.types)
        .into_iter()
        .map(|of| Clean::of(&setup, &found.application, of, options.seed))
        .collect::<Result<_, _>>()?;
    let jobs = jobs_of(&cleans, options);
    let ends = jobs::run("explore", options.quiet, &jobs, |job| {
        let clean = cleans.get(job.clean).context("a job without its run")?;
        Ok(clean.with(&setup, &found.application, options.seed, &job.fault))
    })?;
    let (rows, reasons) = classes(&cleans, &jobs, &ends);
    outln!("{}", render(&setup, &cleans, &rows));
    tell_reasons(&reasons, options);
    let is_wrong = rows.values().any(|row| row.altered + row.panicked > 0);
    Ok(if is_wrong { Exit::RunFailed } else { Exit::Pass })
}

fn jobs_of(cleans: &[Clean], options: &ExploreOptions) -> Vec<Job> {
    let mut jobs = Vec::new();
    for (index, clean) in cleans.iter().enumerate() {
        for what in What::ALL {
            for (direction, frames) in clean.frames.into_iter().enumerate() {
                let numbers = (1..=frames).step_by(usize::try_from(options.every).unwrap_or(usize::MAX));
                jobs.extend(numbers.map(|frame| {
                    let fault = what.at(direction, frame, options.hold_ms);
                    Job { clean: index, what, fault }
                }));
            }
        }
    }
    jobs
}

impl Clean {
    fn of(setup: &Setup, application: &Application, of: ExecutionType, seed: u64) -> anyhow::Result<Self> {
        let step = Schedule::new(&[of], 1, seed).steps().next().context("a schedule without a run")?;
        let mut verification = Verification::new(setup, application, Mode::Virtual, &[])?;
        let mut run = VirtualRun::start(setup, application, seed, VirtualBus::OfSetup)?;
        let measured = run.execute_unrecorded(step)?;
        verification.check(&measured)?;
        let execution_ns = measured.execution.execution_time_ns;
        Ok(Self { step, verification, execution_ns, frames: run.frames_sent() })
    }

    /// Makes the run with this fault.
    fn with(&self, setup: &Setup, application: &Application, seed: u64, fault: &str) -> End {
        let ended = catch_unwind(AssertUnwindSafe(|| {
            let fault: Fault = fault.parse()?;
            let faults = vec![fault];
            let extras = Extras { faults: faults.clone(), ..Extras::default() };
            let mut run = VirtualRun::start_with(setup, application, seed, VirtualBus::OfSetup, &extras)?;
            let measured = run.execute_unrecorded(self.step)?;
            // A frame that is held back may delay a call.
            self.verification.clone().check(&measured).or_else(|_| {
                Verification::new(setup, application, Mode::Virtual, &faults)?.check(&measured)
            })?;
            anyhow::Ok(measured.execution.execution_time_ns)
        }));
        let signed = |nanos: u64| i64::try_from(nanos).unwrap_or(i64::MAX);
        match ended {
            Ok(Ok(execution_ns)) => {
                End::Passed { later_ns: signed(execution_ns) - signed(self.execution_ns) }
            }
            Ok(Err(error)) if error.is::<Difference>() => End::Altered(format!("{error:#}")),
            Ok(Err(error)) => End::Refused(format!("{error:#}")),
            Err(panic) => End::Panicked(text_of(panic.as_ref())),
        }
    }
}

fn text_of(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().cloned();
    text.or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_owned()))
        .unwrap_or_else(|| "a panic without a text".to_owned())
}

/// Reasons of runs that did not pass: how many have it, and the first one's type and fault.
type Reasons<'a> = BTreeMap<String, (u32, ExecutionType, &'a str)>;

fn classes<'a>(
    cleans: &[Clean],
    jobs: &'a [Job],
    ends: &[End],
) -> (BTreeMap<(usize, What), Row>, Reasons<'a>) {
    let (mut rows, mut reasons) = (BTreeMap::<(usize, What), Row>::new(), Reasons::new());
    for (job, end) in jobs.iter().zip(ends) {
        let row = rows.entry((job.clean, job.what)).or_default();
        row.runs += 1;
        let (count, reason) = match end {
            End::Passed { later_ns: 0 } => (&mut row.same, None),
            End::Passed { later_ns } => {
                row.earliest_ns = row.earliest_ns.min(*later_ns);
                row.latest_ns = row.latest_ns.max(*later_ns);
                (&mut row.other_time, None)
            }
            End::Refused(reason) => (&mut row.refused, Some(reason)),
            End::Altered(reason) => (&mut row.altered, Some(reason)),
            End::Panicked(reason) => (&mut row.panicked, Some(reason)),
        };
        *count += 1;
        if let (Some(reason), Some(clean)) = (reason, cleans.get(job.clean)) {
            // One reason differs from the next by its numbers.
            let kind: String =
                reason.chars().map(|letter| if letter.is_ascii_digit() { '#' } else { letter }).collect();
            let first = (0, clean.step.execution_type, job.fault.as_str());
            reasons.entry(kind).or_insert(first).0 += 1;
        }
    }
    (rows, reasons)
}

fn render(setup: &Setup, cleans: &[Clean], rows: &BTreeMap<(usize, What), Row>) -> String {
    let mut table = screen::ruled();
    table.set_header([
        "type",
        "one frame is",
        "runs",
        "same time",
        "other time",
        "by ms",
        "refused",
        "altered",
        "panicked",
    ]);
    for ((clean, what), row) in rows {
        let Some(clean) = cleans.get(*clean) else { continue };
        let ms = |nanos: i64| format!("{:+.1}", nanos as f64 / 1e6).replace('-', "−");
        let by = if row.other_time == 0 {
            String::new()
        } else {
            format!("{} … {}", ms(row.earliest_ns), ms(row.latest_ns))
        };
        table.add_row([
            label(clean.step.execution_type),
            what.name().to_owned(),
            row.runs.to_string(),
            row.same.to_string(),
            row.other_time.to_string(),
            by,
            row.refused.to_string(),
            row.altered.to_string(),
            row.panicked.to_string(),
        ]);
    }
    let title = format!("Setup {}: one fault at a time, in virtual time", setup.name);
    format!("{title}\n\n{}", screen::drawn(&screen::numbers_right(table)))
}

/// Prints why runs did not pass, each reason with a command that runs its first one again.
fn tell_reasons(reasons: &Reasons<'_>, options: &ExploreOptions) {
    let mut sorted: Vec<_> = reasons.iter().collect();
    sorted.sort_by_key(|(_, (count, ..))| std::cmp::Reverse(*count));
    for (reason, (count, of, fault)) in sorted.iter().take(REASONS) {
        let application =
            options.application.as_ref().map_or_else(String::new, |name| format!(" --application {name}"));
        outln!(
            "\n{count} × {reason}\n  bench --setup {}{application} --mode virtual --types {of} --reps 1 --seed {} --fault {fault}",
            options.setup.name(),
            options.seed
        );
    }
    if sorted.len() > REASONS {
        outln!("\nand {} more reasons", sorted.len() - REASONS);
    }
}
