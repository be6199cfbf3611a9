//! The figure of a cell's first repetitions: when each arm moves, and when it waits at a mark for the others.

use plc_node::ExecutionType;
use plotters::element::{PathElement, Rectangle};
use plotters::prelude::Color;

use crate::figures::rounded;
use crate::html::chart::{self, ChartAxes, Format, INK, Panels, colour, px, stroke};
use crate::html::figure::Data;
use crate::progress::label;
use records::cell_results::CellResults;
use records::cell_stop::STANDS_MM_S;
use records::trace::{CellTrace, Recording};

/// Height of an arm's row and of the line of text above a panel, in pixels.
const ROW: f64 = 34.0;
const TITLE: f64 = 30.0;

/// Letters of a name that fit beside the axis.
const LETTERS: usize = 6;

/// A stretch of time, in s.
type Stretch = (f64, f64);

/// Returns the stretches in which a condition holds.
fn stretches(samples: impl Iterator<Item = (f64, bool)>) -> Vec<Stretch> {
    let mut all: Vec<Stretch> = Vec::new();
    let (mut open, mut last) = (None, 0.0);
    for (at, holds) in samples {
        match (open, holds) {
            (None, true) => open = Some(at),
            (Some(from), false) => {
                all.push((from, at));
                open = None;
            }
            _ => {}
        }
        last = at;
    }
    all.extend(open.map(|from| (from, last)));
    all
}

fn moves(recording: &Recording) -> Vec<Stretch> {
    let ticks = recording.robot_ticks().iter().filter(|tick| tick.at_ms >= 0.0);
    stretches(ticks.map(|tick| (tick.at_ms / 1e3, tick.sample.path_speed_mm_s >= STANDS_MM_S)))
}

fn waits(recording: &Recording) -> Vec<Stretch> {
    let scans = recording.plc_scans().iter();
    stretches(scans.map(|scan| (scan.at_us as f64 / 1e6, scan.sample.marks_come > scan.sample.marks_passed)))
}

/// Returns when an arm passes its marks, in s.
fn passes(recording: &Recording) -> Vec<f64> {
    let scans = recording.plc_scans();
    let passed = |pair: &&[records::trace::PlcScan]| {
        pair.first().zip(pair.last()).is_some_and(|(a, b)| a.sample.marks_passed < b.sample.marks_passed)
    };
    let at = |pair: &[records::trace::PlcScan]| pair.last().map(|scan| scan.at_us as f64 / 1e6);
    scans.windows(2).filter(passed).filter_map(at).collect()
}

/// Returns the types that are recorded at every station, with the recordings.
fn recorded(trace: &CellTrace) -> Vec<(ExecutionType, Vec<&Recording>)> {
    let of_type = |one: ExecutionType| {
        let all: Option<Vec<_>> = trace.stations.iter().map(|trace| trace.types.get(one)).collect();
        all.filter(|all| !all.is_empty()).map(|all| (one, all))
    };
    ExecutionType::ALL.into_iter().filter_map(of_type).collect()
}

/// Returns how long each arm moves and waits.
pub(super) fn data(results: &CellResults, trace: &CellTrace) -> Data {
    let sum = |all: Vec<Stretch>| {
        let seconds: f64 = all.iter().map(|(from, to)| to - from).sum();
        format!("{:.2}", rounded(seconds, 2))
    };
    let rows = recorded(trace).into_iter().flat_map(|(execution_type, recordings)| {
        let rows = results.stations.iter().zip(recordings).map(move |(station, recording)| {
            let name = format!("{} {}", label(execution_type), station.name);
            let of_robot =
                |shown: String| if recording.robot_ticks().is_empty() { "–".to_owned() } else { shown };
            let of_plc =
                |shown: String| if recording.plc_scans().is_empty() { "–".to_owned() } else { shown };
            let (moving, waiting) = (of_robot(sum(moves(recording))), of_plc(sum(waits(recording))));
            vec![name, moving, waiting, of_plc(passes(recording).len().to_string())]
        });
        rows.collect::<Vec<_>>()
    });
    let head = ["first repetition", "moves, s", "waits at marks, s", "marks passed"];
    Data::new(head.map(str::to_owned).to_vec(), rows.collect())
}

/// Draws the figure; `None` without recordings.
pub(super) fn draw(
    results: &CellResults,
    trace: &CellTrace,
    format: Format,
) -> anyhow::Result<Option<String>> {
    let panels = recorded(trace);
    let ends = panels.iter().flat_map(|(_, all)| all.iter().map(|recording| recording.end_ms() / 1e3));
    let longest_s = ends.fold(0.0, f64::max);
    if longest_s <= 0.0 {
        return Ok(None);
    }
    let arms = results.stations.len() as f64;
    let name_of = |at: &f64| {
        let index = (arms - 1.0 - at).round();
        let is_arm = (at - at.round()).abs() < 1e-6 && index >= 0.0;
        let station = is_arm.then(|| results.stations.get(index as usize)).flatten();
        station.map_or_else(String::new, |station| station.name.chars().take(LETTERS).collect())
    };
    let layout = Panels { title: TITLE, panel: ROW * arms + 12.0 };
    let svg = layout.figure(format, &panels, |whole, panel, (execution_type, recordings)| {
        whole.draw_text(
            &label(*execution_type),
            &chart::name(15.0, colour(*execution_type)),
            (px(2.0), px(panel.top + 8.0)),
        )?;
        let axes = ChartAxes {
            x: (0.0, longest_s * 1.01),
            y: (-0.6, arms - 0.4),
            x_title: panel.is_last.then_some("time since the PLC's start edge in s"),
            y_title: "",
            x_lines: true,
            labels: (format.pick(14, 7), results.stations.len() + 1),
            write: (&chart::short, &name_of),
        };
        let mut chart = axes.draw(format, &panel.area)?;
        for (index, recording) in recordings.iter().enumerate() {
            let row = arms - 1.0 - index as f64;
            let own = colour(*execution_type);
            let bar = |(from, to): Stretch, half: f64, style| {
                Rectangle::new([(from, row - half), (to, row + half)], style)
            };
            let moving = moves(recording).into_iter().map(|it| bar(it, 0.3, own.mix(0.85).filled()));
            chart.draw_series(moving)?;
            let waiting = waits(recording).into_iter().map(|it| bar(it, 0.12, own.mix(0.35).filled()));
            chart.draw_series(waiting)?;
            let line = |at: f64| {
                PathElement::new(
                    vec![(at, row - 0.42), (at, row + 0.42)],
                    INK.mix(0.8).stroke_width(stroke(1.4)),
                )
            };
            chart.draw_series(passes(recording).into_iter().map(line))?;
        }
        Ok(())
    })?;
    Ok(Some(svg))
}

#[cfg(test)]
mod tests {
    use super::*;
    use records::trace::PlcScan;

    #[test]
    fn an_arm_waits_from_its_mark_until_it_passes() {
        let mut recording = Recording::default();
        for (millis, come, passed) in [(0, 0, 0), (1, 1, 0), (2, 1, 0), (3, 1, 1), (4, 2, 2), (5, 3, 2)] {
            let sample =
                plc_node::Sample { marks_come: come, marks_passed: passed, ..plc_node::Sample::default() };
            recording.plc(PlcScan { at_us: millis * 1_000, true_ns: 0, sample });
        }
        assert_eq!(waits(&recording), [(0.001, 0.003), (0.005, 0.005)]);
        assert_eq!(passes(&recording), [0.003, 0.004]);
    }
}
