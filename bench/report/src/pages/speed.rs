//! Path speed over time, a panel per type on one time axis: shows why SM takes longer.

use plc_node::ExecutionType;
use plotters::element::{PathElement, Polygon};
use plotters::prelude::Color;

use super::end::End;
use super::first_look;
use crate::html::chart::{self, ChartAxes, Format, INK, MUTED, Panels, colour, px, stroke, text};
use crate::html::figure::Data;
use crate::progress::label;
use records::results::Results;
use records::trace::{RobotTick, Trace};

/// Height in pixels of a panel and of the line of text above it.
const PANEL: f64 = 130.0;
const TITLE: f64 = 40.0;

/// Returns when each motion was done, in s: a row for each motion, a column for each type.
pub(super) fn data(trace: &Trace) -> Data {
    let recordings = || {
        ExecutionType::ALL
            .into_iter()
            .filter_map(|execution_type| Some((execution_type, trace.types.get(execution_type)?)))
    };
    let columns: Vec<Vec<f64>> =
        recordings().map(|(_, recording)| ends(recording.robot_ticks()).collect()).collect();
    let motions = columns.iter().map(Vec::len).max().unwrap_or_default();
    let done = |column: &Vec<f64>, index: usize| {
        column.get(index).map_or_else(|| "–".to_owned(), |at_ms| format!("{:.3}", at_ms / 1e3))
    };
    let row = |index: usize| {
        let cells = columns.iter().map(|column| done(column, index));
        std::iter::once((index + 1).to_string()).chain(cells).collect()
    };
    let head = recordings().map(|(execution_type, _)| format!("{} done at, s", label(execution_type)));
    Data::new(std::iter::once("motion".to_owned()).chain(head).collect(), (0..motions).map(row).collect())
}

/// Draws the figure; `None` without ticks. `continuous` is the number of CM's skills.
pub(super) fn draw(
    trace: &Trace,
    results: &Results,
    continuous: Option<usize>,
    format: Format,
) -> anyhow::Result<Option<String>> {
    let panels: Vec<_> = ExecutionType::ALL
        .into_iter()
        .filter_map(|execution_type| Some((execution_type, trace.types.get(execution_type)?)))
        .filter(|(_, recording)| !recording.robot_ticks().is_empty())
        .collect();
    let ticks = || panels.iter().flat_map(|(_, recording)| recording.robot_ticks());
    let longest_s = ticks().map(|tick| tick.at_ms / 1e3).fold(0.0, f64::max);
    let fastest = ticks().map(|tick| f64::from(tick.sample.path_speed_mm_s)).fold(0.0, f64::max);
    if longest_s <= 0.0 {
        return Ok(None);
    }
    let layout = Panels { title: TITLE, panel: format.pick(PANEL, PANEL * 0.8) };
    let svg = layout.figure(format, &panels, |whole, panel, (execution_type, recording)| {
        let end = End::of(results, *execution_type, recording);
        let said = end.label(recording.end_ms() / 1e3);
        let how = format!("{}: {said}", how(*execution_type, continuous, format));
        title(whole, *execution_type, &how, panel.top, format)?;
        let ticks = recording.robot_ticks();
        let axes = ChartAxes {
            x: (0.0, longest_s * 1.01),
            y: (0.0, (fastest * 1.08).max(1.0)),
            x_title: panel.is_last.then_some("time since the PLC's start edge in s"),
            y_title: "mm/s",
            x_lines: false,
            labels: (format.pick(14, 7), 5),
            write: (&chart::short, &chart::whole),
        };
        let mut chart = axes.draw(format, &panel.area)?;
        for at_ms in ends(ticks) {
            let line = [(at_ms / 1e3, 0.0), (at_ms / 1e3, fastest * 1.08)];
            chart.plotting_area().draw(&PathElement::new(line, MUTED.mix(0.35).stroke_width(stroke(0.7))))?;
        }
        let curve: Vec<_> =
            ticks.iter().map(|tick| (tick.at_ms / 1e3, f64::from(tick.sample.path_speed_mm_s))).collect();
        let first = curve.first().map(|(x, _)| (*x, 0.0));
        let last = curve.last().map(|(x, _)| (*x, 0.0));
        let under: Vec<_> = first.into_iter().chain(curve.iter().copied()).chain(last).collect();
        chart.draw_series([Polygon::new(under, colour(*execution_type).mix(0.16))])?;
        chart.draw_series([PathElement::new(curve, colour(*execution_type).stroke_width(stroke(1.6)))])?;
        Ok(())
    })?;
    Ok(Some(svg))
}

/// Returns how a type runs the sequence, as long as there is room for.
fn how(execution_type: ExecutionType, continuous: Option<usize>, format: Format) -> String {
    let short = first_look::how(execution_type, continuous);
    match execution_type {
        ExecutionType::Rc => format.pick("the robot's own program, started by the PLC".to_owned(), short),
        ExecutionType::Sm => format.pick("one skill call a motion, each to an exact stop".to_owned(), short),
        ExecutionType::Cm => format.pick(format!("{short}, fed by the PLC through five slots"), short),
    }
}

fn title(
    area: &chart::Area<'_>,
    execution_type: ExecutionType,
    how: &str,
    top: f64,
    format: Format,
) -> anyhow::Result<()> {
    let y = px(top + 5.0);
    area.draw_text(&label(execution_type), &chart::name(15.0, colour(execution_type)), (px(2.0), y))?;
    let text_at = text(format.pick(13.0, 12.0), INK);
    area.draw_text(how, &text_at, (px(38.0), y + px(1.5)))?;
    Ok(())
}

/// Returns when each motion was done, in ms.
pub(super) fn ends(ticks: &[RobotTick]) -> impl Iterator<Item = f64> {
    let count = |tick: &RobotTick| (tick.sample.command, tick.sample.executed);
    ticks.windows(2).filter_map(move |pair| match pair {
        [before, after] if after.sample.executed > 0 && count(after) != count(before) => Some(after.at_ms),
        _ => None,
    })
}
