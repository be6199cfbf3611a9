//! A real run against its baseline. A host's stalls and its speed affect all execution types of a run equally, so of times only
//! ratios within the run are compared, each with the interval that repetitions as different as these allow. Skews and poses of
//! several arms are differences within one repetition, and are compared as medians.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::anyhow;
use node::screen;
use plc_node::ExecutionType;

use super::export::{GateExport, RatioRow};
use super::{Baseline, GateOptions, default_path, find};
use records::cell_results::CellResults;
use records::exit::{Exit, Failure};
use records::ratio::{Ratio, RatioVerdict};
use records::results::Results;
use records::run_directory::{self, SavedResults};
use report::out;
use report::progress::label;
use studies::outputs::{self, Own};

/// How much higher than in virtual time a ratio may be. Host and wire may cost that much; a scan more a skill call is
/// 0.2 % of SM, a lost blend 1 % of CM.
const TOLERANCE: f64 = 0.005;

/// Time by which arms may be farther apart than in virtual time at the start and at marks, in ms: one cycle of the robots (paper,
/// section 6.2).
const SKEW_ALLOWED_MS: f64 = 4.0;

/// Distance by which the relative pose of the arms may differ from the plan by more than in virtual time. The share of their cycles is in
/// the virtual figure.
const POSE_ALLOWED_MM: f64 = 0.1;

/// What is compared: a type's AET over another's.
const RATIOS: [(ExecutionType, ExecutionType); 2] =
    [(ExecutionType::Cm, ExecutionType::Rc), (ExecutionType::Sm, ExecutionType::Rc)];

/// One ratio of a run, or one skew or pose.
#[derive(Clone, PartialEq, Debug)]
struct Compared {
    name: String,
    /// Empty for a ratio.
    unit: &'static str,
    /// The baseline's.
    expected: f64,
    found: Ratio,
    at_most: f64,
}

/// Compares the run in `directory` with the baseline of its setup.
pub(super) fn run(options: &GateOptions, directory: &Path) -> Result<Exit, Failure> {
    let usage = |error: anyhow::Error| Failure::new(Exit::Usage, error);
    let saved = run_directory::saved(directory).map_err(Failure::of_saved_run)?;
    let (results, cell) = match saved {
        SavedResults::One(results) => (*results, None),
        SavedResults::Cell(cell) => (cell.of_station(0), Some(cell)),
    };
    if results.mode != "real" {
        let error = anyhow!(
            "{} is a {} run; `bench gate --setup {}` makes one of its own, and --run is for real ones",
            directory.display(),
            results.mode,
            results.setup
        );
        return Err(usage(error));
    }
    let (setup, application) = (&results.setup, &results.application);
    let path = options.baseline.clone().unwrap_or_else(|| default_path(setup));
    let Some((baseline, _)) = find(&path, options.baseline.is_none(), setup)? else {
        return Err(usage(anyhow!("there is no baseline {} for setup {setup}", path.display())));
    };
    baseline.is_for(setup, application).map_err(|refusal| refusal.at(&path))?;
    outputs::check(&options.exports.files(), &[("the baseline", Some(&path))], Own::default())?;
    options.exports.check_writable()?;
    let mut compared = compare(&baseline, &results).map_err(usage)?;
    compared.extend(cell.iter().flat_map(|cell| compare_in_step(&baseline, cell)));
    out!("{}", render(&results, &compared));
    let rows: Vec<_> = compared.iter().map(Compared::row).collect();
    options.exports.write(&outputs::json(&GateExport::of_ratios(&rows))?, &csv(&rows))?;
    let is_beyond = compared.iter().any(|compared| compared.verdict() == RatioVerdict::Beyond);
    Ok(if is_beyond { Exit::TimingRegression } else { Exit::Pass })
}

/// Columns of `--export-csv` with `--run`.
pub const CSV_HEADER: &str = "ratio,unit,baseline,now,low,high,at_most,verdict";

/// Formats each ratio as a line of CSV.
fn csv(rows: &[RatioRow<'_>]) -> String {
    let line = |RatioRow { ratio, unit, baseline, now, low, high, at_most, verdict }: &RatioRow<'_>| {
        format!("{ratio},{unit},{baseline:.6},{now:.6},{low:.6},{high:.6},{at_most:.6},{verdict}\n")
    };
    format!("{CSV_HEADER}\n{}", rows.iter().map(line).collect::<String>())
}

impl Compared {
    fn row(&self) -> RatioRow<'_> {
        RatioRow {
            ratio: &self.name,
            unit: self.unit,
            baseline: self.expected,
            now: self.found.ratio,
            low: self.found.low,
            high: self.found.high,
            at_most: self.at_most,
            verdict: match self.verdict() {
                RatioVerdict::Within => "within",
                RatioVerdict::Beyond => "beyond",
                RatioVerdict::Inconclusive => "inconclusive",
            },
        }
    }

    fn verdict(&self) -> RatioVerdict {
        self.found.against(self.at_most)
    }
}

/// Compares the ratios that both the baseline and the run have.
fn compare(baseline: &Baseline, results: &Results) -> anyhow::Result<Vec<Compared>> {
    let expected = |execution_type| {
        baseline.get(&format!("{} AET", label(execution_type))).map(|expected| expected.value)
    };
    let samples =
        |execution_type| results.results.get(execution_type).map(|result| result.samples_ms.as_slice());
    let compared = |(over, under): (ExecutionType, ExecutionType)| {
        let expected = expected(over)? / expected(under)?;
        Some(Compared {
            name: format!("{} / {}", label(over), label(under)),
            unit: "",
            expected,
            found: Ratio::of(samples(over)?, samples(under)?, results.seed)?,
            at_most: expected * (1.0 + TOLERANCE),
        })
    };
    let compared: Vec<_> = RATIOS.into_iter().filter_map(compared).collect();
    if compared.is_empty() {
        anyhow::bail!(
            "the run has no ratio to compare: it takes {} repetitions of RC and of CM or SM; run again with `--types rc,cm --reps {0}` or more",
            records::ratio::FEWEST
        );
    }
    Ok(compared)
}

/// Compares skews and poses of several arms that both the baseline and the run have. A real run has the pose of the repetition whose
/// trace it keeps.
fn compare_in_step(baseline: &Baseline, cell: &CellResults) -> Vec<Compared> {
    let mut compared = Vec::new();
    for execution_type in ExecutionType::ALL {
        let Some(result) = cell.results.get(execution_type) else { continue };
        let mut add = |figure: &str, unit, samples: Vec<f64>, allowed: f64| {
            let name = format!("{} {figure}", label(execution_type));
            // Fewer samples can show that the limit is kept, but not that the program broke it: a stall of the host may have.
            let largest = || samples.iter().copied().reduce(f64::max);
            let found = Ratio::median_of(&samples, cell.seed)
                .or_else(|| largest().map(|largest| Ratio { ratio: largest, low: 0.0, high: largest }));
            compared.extend(baseline.get(&name).zip(found).map(|(expected, found)| {
                let expected = expected.value;
                Compared { name, unit, expected, found, at_most: expected + allowed }
            }));
        };
        let in_ms = |micros: f64| micros / 1e3;
        let starts = result.start_skew_us.iter().flatten().copied().map(in_ms).collect();
        add("start skew", "ms", starts, SKEW_ALLOWED_MS);
        let marks = result.mark_skews_us().into_iter().map(in_ms).collect();
        add("mark skew", "ms", marks, SKEW_ALLOWED_MS);
        let poses = result.relative_pose_mm.iter().flatten().copied().collect();
        add("relative pose", "mm", poses, POSE_ALLOWED_MM);
    }
    compared
}

fn render(results: &Results, compared: &[Compared]) -> String {
    let about = format!(
        "Gate: setup {}, {}, a real run{}; ratios of AETs within it{}",
        results.setup,
        results.application,
        if results.is_of_older_version() { ", written by an older version" } else { "" },
        if compared.iter().any(|compared| !compared.unit.is_empty()) { ", and medians" } else { "" },
    );
    let mut table = screen::ruled();
    table.set_header(["", "baseline", "now", "95 % interval", "at most", ""]);
    for ratio in compared {
        let Compared { name, unit, expected, found, at_most } = ratio;
        let name = [name.as_str(), unit].join(" ");
        let interval = format!("{:.4} … {:.4}", found.low, found.high);
        let verdict = match ratio.verdict() {
            RatioVerdict::Within => "ok",
            RatioVerdict::Beyond if unit.is_empty() => "SLOWER",
            RatioVerdict::Beyond => "BEYOND",
            RatioVerdict::Inconclusive => "inconclusive",
        };
        let [expected, now, at_most] =
            [*expected, found.ratio, *at_most].map(|number| format!("{number:.4}"));
        table.add_row([name.trim_end().to_owned(), expected, now, interval, at_most, verdict.to_owned()]);
    }
    let table = screen::drawn(&screen::numbers_right(table));
    let mut text = format!("{}\n\n{table}\n", screen::wrapped(&about, 0, 2));
    for (over, under) in RATIOS {
        let name = format!("{} / {}", label(over), label(under));
        if !compared.iter().any(|ratio| ratio.name == name) {
            let fewest = records::ratio::FEWEST;
            let _ = writeln!(
                text,
                "{name} not compared: it takes {fewest} repetitions of each, and a baseline of both"
            );
        }
    }
    let any = |verdict| compared.iter().any(|ratio| ratio.verdict() == verdict);
    let is_slower = |ratio: &Compared| ratio.verdict() == RatioVerdict::Beyond && ratio.unit.is_empty();
    text.push_str(if compared.iter().any(is_slower) {
        "\nFail: the run is slower than its baseline by more than the interval can explain.\n"
    } else if any(RatioVerdict::Beyond) {
        "\nFail: the arms are farther apart than in the baseline by more than the interval can explain.\n"
    } else if any(RatioVerdict::Inconclusive) {
        "\nInconclusive: the repetitions differ too much to decide; make more of them, or stop what else runs here.\n"
    } else {
        "\nPass.\n"
    });
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use records::conditions::Measured;
    use records::digest::Digests;
    use records::mode::Mode;
    use records::schedule::Schedule;
    use std::time::Duration;

    /// Returns a run in which each type's repetitions lie evenly within ± `spread_ms` of its mean.
    fn results(means_ms: [f64; 3], spread_ms: f64) -> Results {
        let setup = setup::setup("A").unwrap();
        let mut results =
            Results::new(&setup, "pick-and-place", Mode::Real, &Schedule::new(&ExecutionType::ALL, 10, 1));
        results.digests = Some(Digests::default());
        for (execution_type, mean) in ExecutionType::ALL.into_iter().zip(means_ms) {
            for repetition in 0..10 {
                let ms = mean + spread_ms * (f64::from(repetition) / 4.5 - 1.0);
                let execution = Duration::from_secs_f64(ms / 1e3);
                results.record(execution_type, &Measured::lasting(execution)).unwrap();
            }
        }
        results
    }

    fn verdict(means_ms: [f64; 3], spread_ms: f64) -> String {
        let baseline = Baseline::of(&results([3_720.0, 6_480.0, 3_720.0], 0.0), None);
        let results = results(means_ms, spread_ms);
        render(&results, &compare(&baseline, &results).unwrap())
    }

    #[test]
    fn a_slower_host_passes_and_a_slower_cm_does_not() {
        assert!(verdict([3_757.0, 6_545.0, 3_757.0], 6.0).ends_with("Pass.\n"));
        insta::assert_snapshot!(verdict([3_720.0, 6_480.0, 3_760.0], 6.0), @"
        Gate: setup A, pick-and-place, a real run; ratios of AETs within it

        ──────────────────────────────────────────────────────────────────
                   baseline      now     95 % interval   at most
        ──────────────────────────────────────────────────────────────────
         CM / RC     1.0000   1.0108   1.0099 … 1.0117    1.0050   SLOWER
         SM / RC     1.7419   1.7419   1.7406 … 1.7432    1.7506       ok
        ──────────────────────────────────────────────────────────────────

        Fail: the run is slower than its baseline by more than the interval can explain.
        ");
    }

    #[test]
    fn what_the_repetitions_cannot_decide_is_inconclusive() {
        assert!(verdict([3_720.0, 6_480.0, 3_735.0], 60.0).contains("Inconclusive: "));
    }

    #[test]
    fn too_few_repetitions_are_no_ratio() {
        let baseline = Baseline::of(&results([3_720.0, 6_480.0, 3_720.0], 0.0), None);
        let mut few = results([3_720.0, 6_480.0, 3_720.0], 6.0);
        few.results.rc = None;
        insta::assert_snapshot!(compare(&baseline, &few).unwrap_err(), @"the run has no ratio to compare: it takes 5 repetitions of RC and of CM or SM; run again with `--types rc,cm --reps 5` or more");
    }

    #[test]
    fn arms_that_meet_a_cycle_later_pass_and_arms_that_meet_two_later_do_not() {
        let median = |unit, expected: f64, samples: &[f64], allowed| Compared {
            name: "CM mark skew".to_owned(),
            unit,
            expected,
            found: Ratio::median_of(samples, 1).unwrap(),
            at_most: expected + allowed,
        };
        // One repetition met a stall of the host.
        let a_cycle = median("ms", 3.0, &[6.0, 6.5, 6.0, 97.0, 6.5, 6.0, 6.0], SKEW_ALLOWED_MS);
        assert_eq!(a_cycle.verdict(), RatioVerdict::Within);
        let two = median("ms", 3.0, &[11.0, 11.5, 10.5, 11.0, 11.0], SKEW_ALLOWED_MS);
        insta::assert_snapshot!(render(&results([3_720.0, 6_480.0, 3_720.0], 6.0), &[two]), @"
        Gate: setup A, pick-and-place, a real run; ratios of AETs within it, and medians

        ─────────────────────────────────────────────────────────────────────────────
                           baseline       now       95 % interval   at most
        ─────────────────────────────────────────────────────────────────────────────
         CM mark skew ms     3.0000   11.0000   10.5000 … 11.5000    7.0000   BEYOND
        ─────────────────────────────────────────────────────────────────────────────
        CM / RC not compared: it takes 5 repetitions of each, and a baseline of both
        SM / RC not compared: it takes 5 repetitions of each, and a baseline of both

        Fail: the arms are farther apart than in the baseline by more than the interval can explain.
        ");
    }
}
