//! The figures of a comparison: for other programs, and in a sentence.

use plc_node::ExecutionType;
use serde::Serialize;

use super::run::Run;
use crate::export_text::quoted;
use crate::figures::{millis, rounded};
use crate::progress::label;
use records::interval::Mean;

/// Version of the format of `--export-json`.
const SCHEMA_VERSION: u32 = 1;

/// The figures of `bench compare` for other programs.
#[derive(Clone, PartialEq, Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct ComparisonExport<'a> {
    /// Version of this format; it counts changes that break a reader.
    schema_version: u32,
    /// Each type of each run, in the order of the runs.
    figures: &'a [ComparedFigure],
}

impl<'a> ComparisonExport<'a> {
    pub(super) const fn of(figures: &'a [ComparedFigure]) -> Self {
        Self { schema_version: SCHEMA_VERSION, figures }
    }
}

/// A type of a run, compared with that of the first run. The first run and one without samples have no difference.
#[derive(Clone, PartialEq, Serialize, Debug)]
#[cfg_attr(test, derive(schemars::JsonSchema))]
pub(super) struct ComparedFigure {
    /// Number of the run in the comparison, from 1.
    run: usize,
    /// Name of the run.
    name: String,
    /// `rc`, `sm` or `cm`.
    #[serde(rename = "type")]
    #[cfg_attr(test, schemars(with = "String"))]
    execution_type: ExecutionType,
    /// Repetitions that ended as wanted.
    repetitions: usize,
    /// Mean execution time in ms.
    aet_ms: Option<f64>,
    /// Mean absolute deviation of the execution times in ms.
    mad_ms: Option<f64>,
    /// AET minus that of the first run, in ms.
    difference_ms: Option<f64>,
    /// Lower end of the 95 % interval of the difference, in ms; none with fewer than five repetitions in a run.
    difference_low_ms: Option<f64>,
    /// Upper end of this interval, in ms.
    difference_high_ms: Option<f64>,
    /// The difference in % of the first run's AET.
    difference_percent: Option<f64>,
    /// In what its conditions differ from those of the first run.
    other_conditions: Option<String>,
}

/// Columns of a comparison as CSV.
pub const CSV_HEADER: &str = "run,name,type,repetitions,aet_ms,mad_ms,difference_ms,difference_low_ms,difference_high_ms,\
    difference_percent,other_conditions";

/// Returns the figures of each type of each run, in order; `other_conditions` has an entry for each run.
pub(super) fn compared(runs: &[Run], other_conditions: &[Option<String>]) -> Vec<ComparedFigure> {
    let types = |(index, run): (usize, &Run)| {
        let first = runs.first().filter(|_| index > 0);
        ExecutionType::ALL
            .into_iter()
            .filter_map(|execution_type| {
                let conditions = other_conditions.get(index).cloned().flatten();
                figure(index + 1, run, first, execution_type, conditions)
            })
            .collect::<Vec<_>>()
    };
    runs.iter().enumerate().flat_map(types).collect()
}

fn figure(
    number: usize,
    run: &Run,
    first: Option<&Run>,
    execution_type: ExecutionType,
    other_conditions: Option<String>,
) -> Option<ComparedFigure> {
    let samples = |run: &Run| run.results.results.get(execution_type).map(|it| it.samples_ms.clone());
    let aet_ms = |run: &Run| run.results.figure(execution_type).map(|figure| figure.aet_ms);
    let own = samples(run)?;
    let first_ms = first.and_then(aet_ms);
    let difference_ms = aet_ms(run).zip(first_ms).map(|(own, first)| own - first);
    let means = first.and_then(samples).and_then(|first| Mean::of(&own).zip(Mean::of(&first)));
    let interval = means.map(|(own, first)| own.less(first).interval_ms());
    Some(ComparedFigure {
        run: number,
        name: run.name(),
        execution_type,
        repetitions: own.len(),
        aet_ms: aet_ms(run),
        mad_ms: run.results.type_figures(execution_type).and_then(|figures| figures.mad_ms),
        difference_ms,
        difference_low_ms: interval.map(|(low, _)| low),
        difference_high_ms: interval.map(|(_, high)| high),
        difference_percent: difference_ms.zip(first_ms).map(|(ms, first)| ms / first * 100.0),
        other_conditions,
    })
}

impl ComparedFigure {
    /// Returns the difference in words; `None` without one.
    fn clause(&self) -> Option<String> {
        let (ms, percent) = self.difference_ms.zip(self.difference_percent)?;
        let name = label(self.execution_type);
        let amount = format!("{} ms ({:.2} %)", millis(ms.abs()), rounded(percent.abs(), 2));
        let way = if ms < 0.0 { "shorter" } else { "longer" };
        Some(match self.difference_low_ms.zip(self.difference_high_ms) {
            Some((low, high)) if low <= 0.0 && high >= 0.0 => {
                format!("{name} shows no difference beyond chance")
            }
            Some(_) => format!("{name} takes {amount} {way}"),
            None => format!("{name} takes {amount} {way}, which may be chance"),
        })
    }
}

/// Returns a sentence for each run but the first: by how much its types differ.
pub(super) fn headlines(figures: &[ComparedFigure]) -> Vec<String> {
    let runs = figures.iter().map(|figure| figure.run).max().unwrap_or_default();
    let of_run = |run| {
        let own = figures.iter().filter(|figure| figure.run == run);
        let clauses: Vec<_> = own.filter_map(ComparedFigure::clause).collect();
        (!clauses.is_empty()).then(|| format!("Run {run} against run 1: {}.", clauses.join("; ")))
    };
    (2..=runs).filter_map(of_run).collect()
}

/// Formats the figures as CSV, a line for each type of each run; times in ms to a microsecond.
pub(super) fn csv(figures: &[ComparedFigure]) -> String {
    let number = |value: Option<f64>| value.map_or_else(String::new, |value| rounded(value, 3).to_string());
    let line = |figure: &ComparedFigure| {
        let fields = [
            figure.run.to_string(),
            quoted(&figure.name),
            figure.execution_type.to_string(),
            figure.repetitions.to_string(),
            number(figure.aet_ms),
            number(figure.mad_ms),
            number(figure.difference_ms),
            number(figure.difference_low_ms),
            number(figure.difference_high_ms),
            number(figure.difference_percent),
            quoted(figure.other_conditions.as_deref().unwrap_or_default()),
        ];
        fields.join(",") + "\n"
    };
    format!("{CSV_HEADER}\n{}", figures.iter().map(line).collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `INSTA_UPDATE=always` writes it again, as for snapshots.
    #[test]
    fn the_committed_schema_matches_the_export_of_a_comparison() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../schemas/comparison.schema.json");
        let schema =
            serde_json::to_string_pretty(&schemars::schema_for!(ComparisonExport<'_>)).unwrap() + "\n";
        if std::env::var("INSTA_UPDATE").is_ok_and(|update| update == "always") {
            std::fs::write(path, &schema).unwrap();
        }
        assert!(
            std::fs::read_to_string(path).unwrap_or_default() == schema,
            "the export changed: count SCHEMA_VERSION up where a reader breaks, then INSTA_UPDATE=always cargo test -p report"
        );
    }

    fn compared_figure(run: usize, ms: Option<f64>, interval: Option<(f64, f64)>) -> ComparedFigure {
        ComparedFigure {
            run,
            name: "a, b".to_owned(),
            execution_type: ExecutionType::Cm,
            repetitions: 5,
            aet_ms: Some(3_726.2),
            mad_ms: Some(3.7),
            difference_ms: ms,
            difference_low_ms: interval.map(|it| it.0),
            difference_high_ms: interval.map(|it| it.1),
            difference_percent: ms.map(|ms| ms / 37.2),
            other_conditions: None,
        }
    }

    #[test]
    fn a_headline_names_a_difference_in_ms_and_percent_or_that_it_may_be_chance() {
        let figures = [
            compared_figure(1, None, None),
            compared_figure(2, Some(4.0), Some((1.6, 6.3))),
            compared_figure(3, Some(-4.0), Some((-9.0, 1.0))),
            compared_figure(4, Some(-4.0), None),
        ];
        insta::assert_snapshot!(headlines(&figures).join("\n"), @"
        Run 2 against run 1: CM takes 4.0 ms (0.11 %) longer.
        Run 3 against run 1: CM shows no difference beyond chance.
        Run 4 against run 1: CM takes 4.0 ms (0.11 %) shorter, which may be chance.
        ");
    }

    #[test]
    fn csv_has_a_line_for_each_type_of_each_run() {
        let figures = [compared_figure(1, None, None), compared_figure(2, Some(4.0), Some((1.6, 6.3)))];
        insta::assert_snapshot!(csv(&figures), @r#"
        run,name,type,repetitions,aet_ms,mad_ms,difference_ms,difference_low_ms,difference_high_ms,difference_percent,other_conditions
        1,"a, b",cm,5,3726.2,3.7,,,,,
        2,"a, b",cm,5,3726.2,3.7,4,1.6,6.3,0.108,
        "#);
    }
}
