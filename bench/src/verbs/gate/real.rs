//! A real run against its baseline. A host's stalls and its speed affect all execution types of a run equally, so only
//! ratios within the run are compared, each with the interval that repetitions as different as these allow.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::anyhow;
use plc_node::ExecutionType;

use super::export::{GateExport, RatioRow};
use super::{Baseline, GateOptions, default_path, find};
use records::exit::{Exit, Failure};
use records::ratio::{Ratio, RatioVerdict};
use records::results::Results;
use records::run_directory;
use report::out;
use report::progress::label;
use studies::outputs::{self, Own};

/// How much higher than in virtual time a ratio may be. Host and wire may cost that much; a scan more a skill call is
/// 0.2 % of SM, a lost blend 1 % of CM.
const TOLERANCE: f64 = 0.005;

/// What is compared: a type's AET over another's.
const RATIOS: [(ExecutionType, ExecutionType); 2] =
    [(ExecutionType::Cm, ExecutionType::Rc), (ExecutionType::Sm, ExecutionType::Rc)];

/// One ratio of a run.
#[derive(Clone, PartialEq, Debug)]
struct Compared {
    name: String,
    /// The baseline's.
    expected: f64,
    found: Ratio,
}

/// Compares the run in `directory` with the baseline of its setup.
pub(super) fn run(options: &GateOptions, directory: &Path) -> Result<Exit, Failure> {
    let usage = |error: anyhow::Error| Failure::new(Exit::Usage, error);
    let results = run_directory::results(directory).map_err(Failure::of_saved_run)?;
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
    let compared = compare(&baseline, &results).map_err(usage)?;
    out!("{}", render(&results, &compared));
    let rows: Vec<_> = compared.iter().map(Compared::row).collect();
    options.exports.write(&outputs::json(&GateExport::of_ratios(&rows))?, &csv(&rows))?;
    let is_beyond = compared.iter().any(|compared| compared.verdict() == RatioVerdict::Beyond);
    Ok(if is_beyond { Exit::TimingRegression } else { Exit::Pass })
}

/// Columns of `--export-csv` with `--run`.
pub const CSV_HEADER: &str = "ratio,baseline,now,low,high,at_most,verdict";

/// Formats each ratio as a line of CSV.
fn csv(rows: &[RatioRow<'_>]) -> String {
    let line = |RatioRow { ratio, baseline, now, low, high, at_most, verdict }: &RatioRow<'_>| {
        format!("{ratio},{baseline:.6},{now:.6},{low:.6},{high:.6},{at_most:.6},{verdict}\n")
    };
    format!("{CSV_HEADER}\n{}", rows.iter().map(line).collect::<String>())
}

impl Compared {
    fn row(&self) -> RatioRow<'_> {
        RatioRow {
            ratio: &self.name,
            baseline: self.expected,
            now: self.found.ratio,
            low: self.found.low,
            high: self.found.high,
            at_most: self.limit(),
            verdict: match self.verdict() {
                RatioVerdict::Within => "within",
                RatioVerdict::Beyond => "beyond",
                RatioVerdict::Inconclusive => "inconclusive",
            },
        }
    }

    fn limit(&self) -> f64 {
        self.expected * (1.0 + TOLERANCE)
    }

    fn verdict(&self) -> RatioVerdict {
        self.found.against(self.limit())
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
        Some(Compared {
            name: format!("{} / {}", label(over), label(under)),
            expected: expected(over)? / expected(under)?,
            found: Ratio::of(samples(over)?, samples(under)?, results.seed)?,
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

fn render(results: &Results, compared: &[Compared]) -> String {
    let mut text = format!(
        "Gate: setup {}, {}, a real run{}; ratios of AETs within it\n\n{:<10}{:>10}{:>10}{:>22}{:>10}\n",
        results.setup,
        results.application,
        if results.is_of_older_version() { ", written by an older version" } else { "" },
        "",
        "baseline",
        "now",
        "95 % interval",
        "at most"
    );
    for ratio in compared {
        let Compared { name, expected, found } = ratio;
        let interval = format!("{:.4} … {:.4}", found.low, found.high);
        let verdict = match ratio.verdict() {
            RatioVerdict::Within => "ok",
            RatioVerdict::Beyond => "SLOWER",
            RatioVerdict::Inconclusive => "inconclusive",
        };
        let _ = writeln!(
            text,
            "{name:<10}{expected:>10.4}{:>10.4}{interval:>22}{:>10.4}  {verdict}",
            found.ratio,
            ratio.limit()
        );
    }
    for (over, under) in RATIOS {
        let name = format!("{} / {}", label(over), label(under));
        if !compared.iter().any(|ratio| ratio.name == name) {
            let fewest = records::ratio::FEWEST;
            let _ = writeln!(
                text,
                "{name:<10}not compared: it takes {fewest} repetitions of each, and a baseline of both"
            );
        }
    }
    let any = |verdict| compared.iter().any(|ratio| ratio.verdict() == verdict);
    text.push_str(if any(RatioVerdict::Beyond) {
        "\nFail: the run is slower than its baseline by more than the interval can explain.\n"
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

                    baseline       now         95 % interval   at most
        CM / RC       1.0000    1.0108       1.0099 … 1.0117    1.0050  SLOWER
        SM / RC       1.7419    1.7419       1.7406 … 1.7432    1.7506  ok

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
}
