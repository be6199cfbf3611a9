//! `bench overhead`: the cost of recording. It runs the sequence repeatedly in real mode, switches captures and traces on
//! and off meanwhile, and compares the lateness of the cycles. With `--live` it switches a live view with one open page
//! instead.
//!
//! One second of cycles has one figure, the 99th percentile of its lateness. Recorded and unrecorded seconds come in
//! pairs, in an order drawn from the seed, and are compared pair by pair: a drift of the host affects both equally, and
//! a stall affects only one of many pairs. A pair is left out if the hypervisor ran other machines during it, by the
//! kernel's count of stolen time. Pairs of whole repetitions would take four to eight times as long, and a shared
//! host is seldom in the same state for so long.

mod page;

use std::fmt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Context as _;
use capture_file::Retention;
use clap::Args;
use node::report::LatenessReport;
use page::Watched;
use planning::Found;
use plc_node::ExecutionType;
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use setup::Setup;

use records::exit::{Exit, Failure};
use records::host::ProcessorTime;
use records::occupied::{Files, Occupied};
use records::ratio::{Ratio, RatioVerdict, median};
use report::errln;
use report::figures::signed;
use report::outln;
use stands::rig::{self, Rig, RigConfig, RigError};
use studies::directory;
use studies::event_loop::{event_loop, interrupt, interrupted};
use studies::setup_option::SetupOption;

/// Largest allowed ratio of the p99 lateness with and without recording.
const LIMIT: f64 = 1.05;

/// Shortest lateness in µs that is compared: a shorter one counts as this. It is a thousandth of the usual bus cycle; a
/// twentieth of less is shorter than a bucket of the histogram and than reading the clock takes.
const SHORTEST_US: f64 = 1.0;

/// Time over which cycles are counted: some hundred cycles, so that the 99th percentile is not a single one.
const COUNTED: Duration = Duration::from_secs(1);

/// Time after switching recording on or off in which cycles are not counted: starting and stopping listeners is not
/// part of recording.
const SETTLING: Duration = Duration::from_millis(100);

/// Pairs between two lines of progress, after that for the first.
const PROGRESS_EVERY: u32 = 10;

/// A pair with more ticks of stolen time is left out. One tick may consist of time stolen before; and its 10 ms delay
/// no more cycles of a second than the percentile leaves out.
const STOLEN_TICKS: u64 = 1;

/// The files that `--out` keeps.
const RECORDINGS: Files<'_> =
    Files { inputs: &[], results: &["plc.pcapng", "robot.pcapng", "trace-plc.rows", "trace-robot.rows"] };

/// Options of the measurement.
#[derive(Args, Debug)]
pub struct OverheadOptions {
    /// Which setup.
    #[command(flatten)]
    pub setup: SetupOption,
    /// Pairs of seconds, one recorded and one not.
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(5..=100_000))]
    pub pairs: u32,
    /// Execution type to run, over and over.
    #[arg(long = "type", value_name = "TYPE", default_value = "cm")]
    pub execution_type: ExecutionType,
    /// Measure a live view with one page that watches it, instead of captures and traces. The page draws nothing: a browser
    /// that draws on the measuring machine costs it cores besides.
    #[arg(long)]
    pub live: bool,
    /// Seed of the order within the pairs and of the intervals.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Directory to keep the recordings in, which has none yet [default: they are removed].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}

impl OverheadOptions {
    /// Returns what the seconds with a cost are.
    const fn what(&self) -> &'static str {
        if self.live { "watched" } else { "recorded" }
    }
}

/// The p99 lateness in µs of a node's cycles in two consecutive seconds.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct Pair {
    /// In the recorded second.
    pub recorded_us: f64,
    /// In the other one.
    pub unrecorded_us: f64,
}

/// Cost of recording for one node.
#[derive(Clone, PartialEq, Debug)]
pub struct Cost {
    node: &'static str,
    /// What the seconds with a cost are: recorded or watched.
    what: &'static str,
    recorded_us: f64,
    unrecorded_us: f64,
    ratio: Option<Ratio>,
}

impl Cost {
    /// Compares a node's seconds, pair by pair.
    #[must_use]
    pub fn new(node: &'static str, what: &'static str, pairs: &[Pair], seed: u64) -> Self {
        let compared = |pair: &Pair| (pair.recorded_us.max(SHORTEST_US), pair.unrecorded_us.max(SHORTEST_US));
        Self {
            node,
            what,
            recorded_us: median(pairs.iter().map(|pair| pair.recorded_us)),
            unrecorded_us: median(pairs.iter().map(|pair| pair.unrecorded_us)),
            ratio: Ratio::median_of_pairs(&pairs.iter().map(compared).collect::<Vec<_>>(), seed),
        }
    }

    /// Returns whether recording stays within its limit.
    #[must_use]
    pub fn verdict(&self) -> RatioVerdict {
        self.ratio.map_or(RatioVerdict::Inconclusive, |ratio| ratio.against(LIMIT))
    }
}

impl fmt::Display for Cost {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (with, without) = (self.recorded_us, self.unrecorded_us);
        if with.is_nan() {
            write!(f, "{:5}  no pair that says anything", self.node)?;
        } else {
            write!(f, "{:5}  p99 {with:7.1} µs {}, {without:7.1} µs not", self.node, self.what)?;
        }
        if let Some(Ratio { ratio, low, high }) = self.ratio {
            let [ratio, low, high] = [ratio, low, high].map(|ratio| signed((ratio - 1.0) * 100.0));
            write!(f, ": {ratio} %, 95 % of {low} … {high} %")?;
        }
        let verdict = match self.verdict() {
            RatioVerdict::Within => "pass",
            RatioVerdict::Beyond => "fail",
            RatioVerdict::Inconclusive => "inconclusive, more --pairs narrow the interval",
        };
        write!(f, "; {verdict}")
    }
}

/// Measures and prints the cost of recording.
///
/// # Errors
///
/// The setup or the computer does not allow it, or a repetition fails.
pub fn run(options: &OverheadOptions) -> Result<Exit, Failure> {
    if let Some(directory) = &options.out {
        Occupied::check(directory, RECORDINGS).map_err(anyhow::Error::from)?;
    }
    rig::enter_user_namespace()?;
    let (setup, found) = options.setup.load()?;
    found.plan(&setup)?;
    let (directory, temporary) = match &options.out {
        Some(kept) => (kept.clone(), None),
        None => {
            // Its name cannot be foreseen by other users, and only this one can read it.
            let made = tempfile::Builder::new().prefix("bench-overhead-").tempdir();
            let made = made.context("cannot make a directory for the recordings")?;
            (made.path().to_owned(), Some(made))
        }
    };
    directory::make(&directory)?;
    let runtime = event_loop()?;
    let mut seen = SeenOverhead::default();
    let ended = runtime.block_on(async {
        let interrupt = interrupt()?;
        tokio::select! {
            biased;
            () = interrupt => Ok(true),
            ended = measure(options, &setup, &found, &directory, &mut seen) => ended.map(|()| false),
        }
    });
    // Printed even after an error: an hour of pairs must not be lost because of the last one.
    let costs = seen.print(options, &setup);
    if let Some(temporary) = temporary {
        temporary.close().context("cannot remove the recordings")?;
    }
    if ended? {
        return Ok(interrupted(seen.pairs(), options.pairs as usize, "pairs"));
    }
    let fails = costs.iter().any(|cost| cost.verdict() == RatioVerdict::Beyond);
    Ok(if fails { Exit::TimingRegression } else { Exit::Pass })
}

/// The pairs so far.
#[derive(Default)]
struct SeenOverhead {
    plc: Vec<Pair>,
    robot: Vec<Pair>,
    /// Number of pairs left out.
    left_out: u32,
}

impl SeenOverhead {
    fn pairs(&self) -> usize {
        self.plc.len() + self.left_out as usize
    }

    /// Prints the cost of recording for both nodes, if there is at least one pair.
    fn print(&self, options: &OverheadOptions, setup: &Setup) -> [Cost; 2] {
        let costs = [("PLC", &self.plc), ("robot", &self.robot)]
            .map(|(node, pairs)| Cost::new(node, options.what(), pairs, options.seed));
        let pairs = self.pairs();
        if pairs == 0 {
            return costs;
        }
        outln!(
            "Setup {}, seconds of {} in pairs: {pairs}; limit {:+.0} % of the p99 cycle lateness, where less than \
             {SHORTEST_US} µs counts as {SHORTEST_US} µs; medians of the seconds, and of the pairs' ratios:",
            setup.name,
            options.execution_type,
            (LIMIT - 1.0) * 100.0
        );
        costs.iter().for_each(|cost| outln!("  {cost}"));
        if self.left_out > 0 {
            outln!("  {} of the pairs are left out: the host ran others meanwhile.", self.left_out);
        }
        costs
    }
}

/// Measures pair after pair and adds each to the pairs so far.
async fn measure(
    options: &OverheadOptions,
    setup: &Setup,
    found: &Found,
    directory: &Path,
    seen: &mut SeenOverhead,
) -> Result<(), Failure> {
    let unusable = |error: RigError| Failure::new(error.exit(), error);
    let watched = || Watched::start(setup, found, options.execution_type, directory);
    let watched = options.live.then(watched).transpose()?;
    let config = RigConfig {
        seed: options.seed,
        capture: (!options.live).then(|| (directory.to_owned(), Retention::All)),
        feed: watched.as_ref().map(Watched::feed),
        trace: Some(directory.to_owned()),
        ..RigConfig::new(setup, options.setup.name())
    };
    let mut rig = Rig::start(&config).await.map_err(|error| Failure::new(error.exit_at_start(), error))?;
    let failed = |error: RigError| Failure::new(Exit::RunFailed, error);
    // The very first run warms the nodes up.
    rig.execute(options.execution_type, None).await.map_err(failed)?;
    let mut random = Pcg64Mcg::seed_from_u64(options.seed);
    for number in 1..=options.pairs {
        let recorded_first = random.next_u32().is_multiple_of(2);
        let (mut pair, mut whole, stolen) = ([Pair::default(); 2], true, stolen_ticks());
        for recorded in [recorded_first, !recorded_first] {
            rig.pause_capture(!recorded).context("cannot pause the capture")?;
            rig.record(recorded).await.map_err(unusable)?;
            rig.keep_running(options.execution_type, SETTLING).await.map_err(failed)?;
            let before = rig.reports();
            rig.keep_running(options.execution_type, COUNTED).await.map_err(failed)?;
            let after = rig.reports();
            let robots = [before.robot(), after.robot()];
            let cycles = [(&before.plc.cycle, &after.plc.cycle), (&robots[0].cycle, &robots[1].cycle)];
            for (pair, (before, after)) in pair.iter_mut().zip(cycles) {
                let of = if recorded { &mut pair.recorded_us } else { &mut pair.unrecorded_us };
                match p99_us(before, after) {
                    Some(p99) => *of = p99,
                    None => whole = false,
                }
            }
        }
        if whole && stolen_ticks().saturating_sub(stolen) <= STOLEN_TICKS {
            let [plc, robot] = pair;
            seen.plc.push(plc);
            seen.robot.push(robot);
        } else {
            seen.left_out += 1;
        }
        if number == 1 || number % PROGRESS_EVERY == 0 {
            let left = (COUNTED + SETTLING) * 2 * (options.pairs - number);
            errln!("{number} of {} pairs, {} s left", options.pairs, left.as_secs());
        }
    }
    rig.stop().await.map(drop).map_err(unusable)?;
    Ok(watched.map_or(Ok(()), Watched::end)?)
}

/// Returns the processor time stolen by other virtual machines so far; 0 if the kernel does not provide it.
fn stolen_ticks() -> u64 {
    ProcessorTime::now().map_or(0, |time| time.stolen)
}

/// Returns the 99th percentile of the runs between two reports, in µs, assuming that runs are evenly distributed
/// within a bucket.
fn p99_us(before: &LatenessReport, after: &LatenessReport) -> Option<f64> {
    let LatenessReport { runs, buckets, .. } = after.since(before);
    let (wanted, mut seen) = (runs as f64 * 0.99, 0.0);
    for (upper, count) in buckets {
        let count = f64::from(count);
        if seen + count >= wanted {
            // The width of a bucket is a sixteenth of its lower bound.
            let lower = upper * 16.0 / 17.0;
            return Some(lower + (upper - lower) * (wanted - seen) / count);
        }
        seen += count;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(buckets: &[(f64, u32)]) -> LatenessReport {
        LatenessReport { buckets: buckets.to_vec(), ..LatenessReport::default() }
    }

    #[test]
    fn the_percentile_is_that_of_the_runs_between_two_reports() {
        let before = report(&[(10.0, 1_000), (500.0, 900)]);
        let after = report(&[(10.0, 1_980), (34.0, 20), (500.0, 900)]);
        // 990 of the 1000 new runs: all of the first bucket's 980 and half of the second, which spans 32 to 34.
        assert_eq!(p99_us(&before, &after), Some(33.0));
        assert_eq!(p99_us(&after, &after), None);
    }

    #[test]
    fn a_lateness_too_short_to_compare_costs_nothing_and_one_that_grows_beyond_it_does() {
        let cost = |with: f64| {
            let pair = |index: u32| Pair {
                recorded_us: with + f64::from(index % 3) / 10.0,
                unrecorded_us: 0.25 + f64::from(index / 3 % 3) / 10.0,
            };
            Cost::new("PLC", "watched", &(0..25).map(pair).collect::<Vec<_>>(), 1).verdict()
        };
        assert_eq!(cost(0.4), RatioVerdict::Within);
        assert_eq!(cost(1.2), RatioVerdict::Beyond);
    }

    #[test]
    fn a_cost_is_printed_with_its_interval_and_its_verdict() {
        let cost = |with: f64| {
            // A stall of the host affects every tenth pair, alternately the recorded and the unrecorded second.
            let stall = |index: u32, stalled: u32| if index % 20 == stalled { 4_000.0 } else { 0.0 };
            let pair = |index| Pair {
                recorded_us: with + f64::from(index % 5) + stall(index, 3),
                unrecorded_us: 100.0 + f64::from(index / 5) + stall(index, 13),
            };
            Cost::new("PLC", "recorded", &(0..25).map(pair).collect::<Vec<_>>(), 1)
        };
        assert_eq!(cost(100.0).verdict(), RatioVerdict::Within);
        assert_eq!(cost(120.0).verdict(), RatioVerdict::Beyond);
        assert_eq!(cost(105.0).verdict(), RatioVerdict::Inconclusive);
        let said = cost(120.0).to_string();
        assert!(
            said.starts_with("PLC    p99   122.0 µs recorded,   102.0 µs not: +19.6 %, 95 % of"),
            "{said}"
        );
        assert!(said.ends_with("; fail"), "{said}");
        let nothing = Cost::new("robot", "watched", &[], 1).to_string();
        assert_eq!(
            nothing,
            "robot  no pair that says anything; inconclusive, more --pairs narrow the interval"
        );
    }
}
