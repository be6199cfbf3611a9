//! Results and reports as parts of the state.

use machine::Counters;
use node::report::{LatenessReport, NodeReport};
use plc_node::ExecutionType;

use super::state::{Node, Part, Row, Table};
use crate::figures::{millis, percent};
use records::cell_results::{CellResults, CellTypeResult};
use records::interval::{FEWEST, Mean};
use records::results::{Results, TypeResult};

/// Returns the table of the results so far.
pub(super) fn table(results: &Results) -> Part {
    let figures = |key: ExecutionType| {
        let TypeResult { samples_ms, aet_ms, mad_ms, .. } = results.results.get(key)?;
        Some((samples_ms.as_slice(), [*aet_ms, *mad_ms]))
    };
    table_of(figures, results.reps, results.aet_improvement)
}

/// Returns the table of a cell's results so far.
pub(super) fn cell_table(results: &CellResults) -> Part {
    let figures = |key: ExecutionType| {
        let CellTypeResult { samples_ms, aet_ms, mad_ms, .. } = results.results.get(key)?;
        Some((samples_ms.as_slice(), [*aet_ms, *mad_ms]))
    };
    table_of(figures, results.reps, results.aet_improvement)
}

/// Returns a table of the samples of each type, with AET and MAD in ms.
fn table_of<'a>(
    figures: impl Fn(ExecutionType) -> Option<(&'a [f64], [Option<f64>; 2])>,
    reps: u32,
    improvement: Option<f64>,
) -> Part {
    let row_of = |key: ExecutionType| figures(key).map(|(samples, aet_mad)| row(key, samples, aet_mad, reps));
    let table = Table {
        rows: ExecutionType::ALL.into_iter().filter_map(row_of).collect(),
        improvement: improvement.map(|share| percent(share, 1)).unwrap_or_default(),
    };
    Part { table: Some(table), ..Part::default() }
}

fn row(execution_type: ExecutionType, samples: &[f64], [aet_ms, mad_ms]: [Option<f64>; 2], reps: u32) -> Row {
    let text = |value: Option<f64>| value.map(millis).unwrap_or_default();
    let margin = match Mean::of(samples) {
        Some(mean) => format!("± {}", millis(mean.margin_ms())),
        None => format!("from {FEWEST} on"),
    };
    // One sample has no deviation.
    let mad_ms = mad_ms.filter(|_| samples.len() > 1);
    let ends = [f64::min, f64::max].map(|end| text(samples.iter().copied().reduce(end)));
    let [shortest, longest] = ends;
    let done = format!("{} of {reps}", samples.len());
    Row {
        key: execution_type.to_string(),
        cells: [done, text(aet_ms), margin, text(mad_ms), shortest, longest],
    }
}

/// Returns a node's figures.
pub(super) fn node(report: &NodeReport) -> Node {
    let LatenessReport { runs, missed, p50_us, p99_us, max_us, .. } = &report.cycle;
    let Counters { sent, received, skipped, lost, late, malformed, foreign } = report.bus;
    Node {
        lateness: octaves(&report.cycle),
        summary: format!(
            "{runs} cycles late by p50 {p50_us:.0} µs, p99 {p99_us:.0} µs, at most {max_us:.0} µs; {missed} missed"
        ),
        counters: vec![
            ("sent", sent),
            ("received", received),
            ("skipped", skipped),
            ("lost", lost),
            ("late or double", late),
            ("malformed", malformed),
            ("of other connections", foreign),
            ("altered images", report.images.altered),
            ("outdated images", report.images.outdated),
            ("refused by the kernel", report.send_errors),
        ],
    }
}

/// Returns the cycles by the octave of their lateness: lower bound in µs and number, without gaps.
fn octaves(cycle: &LatenessReport) -> Vec<(u64, u64)> {
    let mut octaves: Vec<(u64, u64)> = Vec::new();
    for (upper_us, count) in &cycle.buckets {
        // A bucket's bounds are whole nanoseconds; its upper one belongs to the next bucket.
        let inside_us = (upper_us * 31.0 / 32.0) as u64;
        let lower_us = if inside_us == 0 { 0 } else { 1 << inside_us.ilog2() };
        while let Some((last, _)) = octaves.last().copied().filter(|(last, _)| *last < lower_us) {
            octaves.push((if last == 0 { 1 } else { last * 2 }, 0));
        }
        match octaves.last_mut().filter(|(last, _)| *last == lower_us) {
            Some((_, sum)) => *sum += u64::from(*count),
            None => octaves.push((lower_us, u64::from(*count))),
        }
    }
    octaves
}

#[cfg(test)]
mod tests {
    use super::*;
    use records::mode::Mode;
    use records::schedule::Schedule;

    #[test]
    fn the_table_grows_with_the_repetitions_and_has_intervals_from_five_on() {
        let (setup, found) = planning::setup_with_application("A").unwrap();
        let schedule = Schedule::new(&[ExecutionType::Sm, ExecutionType::Cm], 25, 1);
        let mut results = Results::new(&setup, &found.application.name, Mode::Real, &schedule);
        let cells = |results: &Results, index: usize| {
            let Some(table) = table(results).table else { return (String::new(), String::new()) };
            (table.rows[index].cells.join(" | "), table.improvement)
        };
        assert_eq!(cells(&results, 0).0, "0 of 25 |  | from 5 on |  |  | ");
        let sm = results.results.sm.as_mut().unwrap();
        (sm.samples_ms, sm.aet_ms, sm.mad_ms) = (vec![1.0, 2.0, 3.0, 4.0, 5.0], Some(3.0), Some(1.2));
        results.aet_improvement = Some(0.4321);
        let (row, improvement) = cells(&results, 0);
        assert_eq!(row, "5 of 25 | 3.0 | ± 2.0 | 1.2 | 1.0 | 5.0");
        assert_eq!(improvement, "43.2 %");
    }

    #[test]
    fn the_histogram_has_every_octave_between_the_first_and_the_last() {
        let buckets = vec![(0.5, 3), (33.0, 10), (60.0, 5), (64.0, 2), (300.0, 1)];
        let cycle = LatenessReport { buckets, ..LatenessReport::default() };
        let found = octaves(&cycle);
        let all: Vec<_> =
            [0, 1, 2, 4, 8, 16, 32, 64, 128, 256].into_iter().zip([3, 0, 0, 0, 0, 10, 7, 0, 0, 1]).collect();
        // 33 µs is the upper bound of the bucket from 31.
        assert_eq!(found, all);
    }
}
