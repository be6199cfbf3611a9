//! A run against its baseline, figure by figure.

use std::fmt::Write as _;

use super::baseline::{self, Baseline, Expected};
use node::screen;
use records::results::Results;
use records::schedule::repetitions;
use report::export_text::quoted;
use report::figures::signed_to;
use studies::outputs::csv_number;

/// How one figure compares.
#[derive(Clone, PartialEq, Debug)]
pub struct FigureChange {
    /// The baseline's value; `None` for a figure that the baseline does not have.
    pub expected: Option<Expected>,
    /// The run's value; `None` for a figure that the run does not have. Its tolerance is not used.
    pub found: Option<Expected>,
}

impl FigureChange {
    /// Returns the run's value minus the baseline's, in the figure's unit.
    #[must_use]
    pub fn difference(&self) -> Option<f64> {
        Some(self.found.as_ref()?.value - self.expected.as_ref()?.value)
    }

    /// Returns whether the figure is there on both sides and within its tolerance.
    #[must_use]
    pub fn is_within(&self) -> bool {
        // Values have three decimals; errors of floating point in their difference do not count.
        let within = |difference: f64, expected: &Expected| difference.abs() <= expected.tolerance + 1e-9;
        self.difference().zip(self.expected.as_ref()).is_some_and(|(by, expected)| within(by, expected))
    }

    /// Returns the row of the printed table.
    fn cells(&self) -> [String; 6] {
        let side = |side: &Option<Expected>| {
            side.as_ref().map_or_else(|| "–".to_owned(), |side| format!("{:.3}", side.value))
        };
        let name =
            self.expected.as_ref().or(self.found.as_ref()).map_or(("", ""), |any| (&any.figure, &any.unit));
        let difference = self.difference().map_or_else(|| "–".to_owned(), |by| signed_to(by, 3));
        let tolerance = self.expected.as_ref().map_or_else(String::new, |any| format!("± {}", any.tolerance));
        let verdict = if self.is_within() { "ok" } else { "CHANGED" };
        let name = [name.0, name.1].join(" ").trim_end().to_owned();
        [name, side(&self.expected), side(&self.found), difference, tolerance, verdict.to_owned()]
    }

    fn sentence(&self) -> String {
        match (&self.expected, &self.found) {
            (Some(Expected { figure, unit, value, tolerance }), Some(found)) => {
                let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
                let by = found.value - value;
                let way = if by > 0.0 { "more" } else { "less" };
                format!(
                    "{figure}: {:.3}{unit} {way} ({:.3} instead of {value:.3}{unit}, tolerance {tolerance}{unit})",
                    by.abs(),
                    found.value
                )
            }
            (None, Some(found)) => format!("{}: the baseline does not have it", found.figure),
            (Some(expected), None) => format!("{}: the run does not have it", expected.figure),
            (None, None) => String::new(),
        }
    }
}

/// A figure for other programs. Values, difference and tolerance are in the unit.
#[derive(serde::Serialize)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct GateRow<'a> {
    /// Name of the figure.
    figure: &'a str,
    /// Unit; empty for a count.
    unit: &'a str,
    /// Value in the baseline; none if the baseline does not have the figure.
    baseline: Option<f64>,
    /// Value of this run; none if the run does not have the figure.
    now: Option<f64>,
    /// Value of this run minus that of the baseline.
    difference: Option<f64>,
    /// Largest difference that passes.
    tolerance: Option<f64>,
    /// True if the difference passes.
    is_within: bool,
}

/// Columns of `--export-csv`.
pub const CSV_HEADER: &str = "figure,unit,baseline,now,difference,tolerance,is_within";

/// How a run compares with its baseline.
#[derive(Clone, PartialEq, Debug)]
pub struct Verdict {
    /// All figures of either side, in the baseline's order.
    pub changes: Vec<FigureChange>,
}

impl Verdict {
    /// Compares a run with its baseline.
    #[must_use]
    pub fn new(baseline: &Baseline, results: &Results) -> Self {
        Self::of(baseline, &baseline::figures(results))
    }

    /// Compares the figures of a run with its baseline.
    #[must_use]
    pub fn of(baseline: &Baseline, found: &[Expected]) -> Self {
        let found_figure = |name: &str| found.iter().find(|found| found.figure == name).cloned();
        let known = baseline.figures.iter().map(|expected| FigureChange {
            found: found_figure(&expected.figure),
            expected: Some(expected.clone()),
        });
        let unknown = found.iter().filter(|found| baseline.get(&found.figure).is_none());
        let unknown = unknown.map(|found| FigureChange { expected: None, found: Some(found.clone()) });
        Self { changes: known.chain(unknown).collect() }
    }

    /// Returns whether every figure is within its tolerance.
    #[must_use]
    pub fn is_pass(&self) -> bool {
        self.changes.iter().all(FigureChange::is_within)
    }

    /// Returns each figure with its baseline.
    pub(super) fn rows(&self) -> Vec<GateRow<'_>> {
        fn row(change: &FigureChange) -> GateRow<'_> {
            let any = change.expected.as_ref().or(change.found.as_ref());
            GateRow {
                figure: any.map_or("", |any| any.figure.as_str()),
                unit: any.map_or("", |any| any.unit.as_str()),
                baseline: change.expected.as_ref().map(|it| it.value),
                now: change.found.as_ref().map(|it| it.value),
                difference: change.difference(),
                tolerance: change.expected.as_ref().map(|it| it.tolerance),
                is_within: change.is_within(),
            }
        }
        self.changes.iter().map(row).collect()
    }

    /// Formats each figure with its baseline as a line of CSV.
    #[must_use]
    pub fn csv(&self) -> String {
        let line = |row: GateRow<'_>| {
            let GateRow { figure, unit, baseline, now, difference, tolerance, is_within } = row;
            let [baseline, now, difference] = [baseline, now, difference].map(|value| csv_number(value, 3));
            let tolerance = tolerance.map_or_else(String::new, |it| it.to_string());
            let [figure, unit] = [figure, unit].map(quoted);
            format!("{figure},{unit},{baseline},{now},{difference},{tolerance},{is_within}\n")
        };
        let lines: String = self.rows().into_iter().map(line).collect();
        format!("{CSV_HEADER}\n{lines}")
    }

    /// Formats the comparison as the gate prints it.
    #[must_use]
    pub fn render(&self, baseline: &Baseline, origin: &str) -> String {
        let Baseline { setup, application, reps, seed, .. } = baseline;
        let about = format!(
            "Gate: setup {setup}, {application}, {} of each type in virtual time, seed {seed}",
            repetitions(*reps)
        );
        let mut table = screen::ruled();
        table.set_header(["", "baseline", "now", "difference", "allowed", ""]);
        table.add_rows(self.changes.iter().map(FigureChange::cells));
        let table = screen::drawn(&screen::numbers_right(table));
        let mut text = format!("{}\nBaseline: {origin}\n\n{table}\n", screen::wrapped(&about, 0, 2));
        let beyond: Vec<_> = self.changes.iter().filter(|change| !change.is_within()).collect();
        if beyond.is_empty() {
            let _ = writeln!(text, "\nPass: all {} figures are within their tolerances.", self.changes.len());
            return text;
        }
        let _ = writeln!(
            text,
            "\nFail: {} of {} figures differ by more than their tolerance.",
            beyond.len(),
            self.changes.len()
        );
        for change in beyond {
            let _ = writeln!(text, "  {}", change.sentence());
        }
        text.push_str(
            "If this is meant, take it over by `bench gate --update` and commit the baseline with the reason.\n",
        );
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plc_node::ExecutionType;
    use records::conditions::Measured;
    use records::mode::Mode;
    use records::results::Frames;
    use records::schedule::Schedule;
    use std::time::Duration;

    fn results(sm_ms: u64) -> Results {
        let setup = setup::setup("A").unwrap();
        let plan = Schedule::new(&ExecutionType::ALL, 2, 7);
        let mut results = Results::new(&setup, "pick-and-place", Mode::Virtual, &plan);
        for (execution_type, millis) in
            [(ExecutionType::Rc, 3_725), (ExecutionType::Sm, sm_ms), (ExecutionType::Cm, 3_729)]
        {
            for millis in [millis - 3, millis + 3] {
                let execution = Duration::from_millis(millis);
                results.record(execution_type, &Measured::lasting(execution)).unwrap();
            }
        }
        results.bus = Frames { frames_sent: 6 * sm_ms, frames_received: 6 * sm_ms, ..Frames::default() };
        results
    }

    #[test]
    fn a_run_like_the_baseline_passes() {
        let baseline = Baseline::of(&results(6_477), None);
        let verdict = Verdict::new(&baseline, &results(6_477));
        assert!(verdict.is_pass());
        insta::assert_snapshot!(verdict.render(&baseline, "bench/baselines/A.json"), @"
        Gate: setup A, pick-and-place, 2 repetitions of each type in virtual time, seed 7
        Baseline: bench/baselines/A.json

        ────────────────────────────────────────────────────────────────────────────────
                                       baseline         now   difference   allowed
        ────────────────────────────────────────────────────────────────────────────────
         RC AET ms                     3725.000    3725.000       +0.000     ± 0.5   ok
         RC MAD ms                        3.000       3.000       +0.000     ± 0.5   ok
         SM AET ms                     6477.000    6477.000       +0.000     ± 0.5   ok
         SM MAD ms                        3.000       3.000       +0.000     ± 0.5   ok
         CM AET ms                     3729.000    3729.000       +0.000     ± 0.5   ok
         CM MAD ms                        3.000       3.000       +0.000     ± 0.5   ok
         CM − RC ms                       4.000       4.000       +0.000     ± 0.5   ok
         cyclic frames a repetition   12954.000   12954.000       +0.000       ± 1   ok
        ────────────────────────────────────────────────────────────────────────────────

        Pass: all 8 figures are within their tolerances.
        ");
    }

    #[test]
    fn a_figure_beyond_its_tolerance_or_on_one_side_only_fails_and_is_named() {
        let mut baseline = Baseline::of(&results(6_477), None);
        baseline.figures.retain(|expected| expected.figure != "CM MAD");
        let mut gone = baseline.figures.last().unwrap().clone();
        gone.figure = "blends".to_owned();
        baseline.figures.push(gone);
        let verdict = Verdict::new(&baseline, &results(6_490));
        assert!(!verdict.is_pass());
        insta::assert_snapshot!(verdict.render(&baseline, "the one built in"), @"
        Gate: setup A, pick-and-place, 2 repetitions of each type in virtual time, seed 7
        Baseline: the one built in

        ─────────────────────────────────────────────────────────────────────────────────────
                                       baseline         now   difference   allowed
        ─────────────────────────────────────────────────────────────────────────────────────
         RC AET ms                     3725.000    3725.000       +0.000     ± 0.5        ok
         RC MAD ms                        3.000       3.000       +0.000     ± 0.5        ok
         SM AET ms                     6477.000    6490.000      +13.000     ± 0.5   CHANGED
         SM MAD ms                        3.000       3.000       +0.000     ± 0.5        ok
         CM AET ms                     3729.000    3729.000       +0.000     ± 0.5        ok
         CM − RC ms                       4.000       4.000       +0.000     ± 0.5        ok
         cyclic frames a repetition   12954.000   12980.000      +26.000       ± 1   CHANGED
         blends                       12954.000           –            –       ± 1   CHANGED
         CM MAD ms                            –       3.000            –             CHANGED
        ─────────────────────────────────────────────────────────────────────────────────────

        Fail: 4 of 9 figures differ by more than their tolerance.
          SM AET: 13.000 ms more (6490.000 instead of 6477.000 ms, tolerance 0.5 ms)
          cyclic frames a repetition: 26.000 more (12980.000 instead of 12954.000, tolerance 1)
          blends: the run does not have it
          CM MAD: the baseline does not have it
        If this is meant, take it over by `bench gate --update` and commit the baseline with the reason.
        ");
    }

    #[test]
    fn a_difference_of_just_the_tolerance_is_within_it() {
        let expected =
            |value| Expected { figure: "RC AET".to_owned(), unit: "ms".to_owned(), value, tolerance: 0.5 };
        let change =
            |by: f64| FigureChange { expected: Some(expected(3725.1)), found: Some(expected(3725.1 + by)) };
        assert!(change(0.5).is_within() && change(-0.5).is_within());
        assert!(!change(0.501).is_within() && !change(-0.501).is_within());
    }
}
