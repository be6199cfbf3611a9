//! AET over the runs, a panel per type.

use plc_node::ExecutionType;
use plotters::element::{Circle, PathElement, Text};
use plotters::prelude::Color;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::Entry;
use report::figures::signed;
use report::html::chart::{
    self, Area, Chart, ChartAxes, Format, INK, MUTED, PAPER, Panel, Panels, colour, px, stroke, text,
};
use report::progress::label;

/// Most runs of a figure: more cannot be told apart on a phone.
pub(super) const MOST: usize = 60;

/// Height in pixels of a panel and of the line of text above it.
const PANEL: f64 = 126.0;
const TITLE: f64 = 30.0;

/// A run of the figure.
#[derive(Clone, Copy)]
pub(super) struct Run<'a> {
    /// Its number, counted from 1.
    pub(super) number: usize,
    pub(super) entry: &'a Entry,
}

impl Run<'_> {
    /// Returns the AET of a type, and the ends of its interval, in ms; where there is none, the AET itself.
    fn figures(&self, execution_type: ExecutionType) -> Option<(f64, (f64, f64))> {
        let aet_ms = self.entry.figures.get(execution_type)?.aet_ms;
        let interval = self.entry.interval_ms.get(execution_type);
        Some((aet_ms, interval.copied().unwrap_or((aet_ms, aet_ms))))
    }
}

/// A run's AET of a type, as it is drawn.
#[derive(Clone, Copy)]
struct HistoryPoint<'a> {
    run: Run<'a>,
    aet_ms: f64,
    /// Ends of its interval, in ms.
    ends_ms: (f64, f64),
    /// Index of the point that it is compared with.
    before: Option<usize>,
    /// AET of the last run that this one is joined with, in ms.
    last_ms: f64,
}

impl HistoryPoint<'_> {
    /// Returns all points of a type.
    fn all<'a>(runs: &[Run<'a>], execution_type: ExecutionType) -> Vec<HistoryPoint<'a>> {
        let mut points: Vec<HistoryPoint<'a>> = Vec::new();
        for run in runs {
            let Some((aet_ms, ends_ms)) = run.figures(execution_type) else { continue };
            let name = run.entry.compared_with.get(execution_type);
            let before = points.iter().rposition(|point| Some(&point.run.entry.run) == name);
            points.push(HistoryPoint { run: *run, aet_ms, ends_ms, before, last_ms: aet_ms });
        }
        // The last point of a line leads to all others, from each to the one before.
        for index in (0..points.len()).rev() {
            let Some(HistoryPoint { before: Some(before), last_ms, .. }) = points.get(index).copied() else {
                continue;
            };
            if let Some(before) = points.get_mut(before) {
                before.last_ms = last_ms;
            }
        }
        points
    }

    fn x(&self) -> f64 {
        self.run.number as f64
    }

    fn y(&self) -> f64 {
        self.aet_ms - self.last_ms
    }

    fn ends(&self) -> (f64, f64) {
        (self.ends_ms.0 - self.last_ms, self.ends_ms.1 - self.last_ms)
    }
}

/// Draws the last runs; `None` without figures.
pub(super) fn draw(runs: &[Run<'_>], format: Format) -> anyhow::Result<Option<String>> {
    let runs = runs.get(runs.len().saturating_sub(MOST)..).unwrap_or(runs);
    let types: Vec<_> = ExecutionType::ALL
        .into_iter()
        .map(|execution_type| (execution_type, HistoryPoint::all(runs, execution_type)))
        .filter(|(_, points)| !points.is_empty())
        .collect();
    if types.is_empty() {
        return Ok(None);
    }
    let layout = Panels { title: TITLE, panel: format.pick(PANEL, PANEL * 0.9) };
    let svg = layout.figure(format, &types, |whole, panel, (execution_type, points)| {
        draw_type(whole, panel, runs, (*execution_type, points), format)
    })?;
    let of_type = |(execution_type, points): &(ExecutionType, Vec<HistoryPoint<'_>>)| {
        points.iter().flat_map(|point| tooltips(point, *execution_type)).collect::<Vec<_>>()
    };
    Ok(Some(chart::with_tooltips(&svg, types.iter().flat_map(of_type))))
}

fn draw_type(
    whole: &Area<'_>,
    panel: &Panel<'_>,
    runs: &[Run<'_>],
    (execution_type, points): (ExecutionType, &[HistoryPoint<'_>]),
    format: Format,
) -> anyhow::Result<()> {
    let ink = colour(execution_type);
    whole.draw_text(&label(execution_type), &chart::name(15.0, ink), (px(2.0), px(panel.top + 8.0)))?;
    let about = "AET minus that of the line's last run, in ms";
    whole.draw_text(about, &text(format.pick(13.0, 12.0), INK), (px(38.0), px(panel.top + 9.5)))?;

    let (low, high) = points
        .iter()
        .map(HistoryPoint::ends)
        .fold((0.0_f64, 0.0_f64), |(low, high), ends| (low.min(ends.0), high.max(ends.1)));
    let span = (high - low).max(1.0);
    // Above the highest interval there is room for the labels.
    let (bottom, top) = (low - 0.1 * span, high + 0.3 * span);
    let number = |run: Option<&Run<'_>>| run.map_or(1.0, |run| run.number as f64);
    let axes = ChartAxes {
        x: (number(runs.first()) - 0.5, number(runs.last()) + 0.5),
        y: (bottom, top),
        x_title: panel.is_last.then_some("run"),
        y_title: "",
        x_lines: false,
        labels: (runs.len().min(format.pick(16, 8)), 4),
        write: (&whole_only, &difference),
    };
    let mut chart = axes.draw(format, &panel.area)?;
    draw_changes(&mut chart, runs, execution_type, (bottom, top), format)?;
    for point in points {
        let (x, ends) = (point.x(), point.ends());
        let joined =
            point.before.and_then(|before| points.get(before)).map(|before| (before.x(), before.y()));
        let line = joined.map(|from| [from, (x, point.y())]);
        for ends in line.into_iter().chain([[(x, ends.0), (x, ends.1)]]) {
            chart.draw_series([PathElement::new(ends, ink.stroke_width(stroke(1.4)))])?;
        }
    }
    for point in points {
        let at = (point.x(), point.y());
        let radius = px(if runs.len() > 30 { 2.6 } else { 4.0 });
        if point.run.entry.is_whole() {
            chart.draw_series([Circle::new(at, radius, ink.filled())])?;
        } else {
            chart.draw_series([Circle::new(at, radius, PAPER.filled())])?;
            chart.draw_series([Circle::new(at, radius, ink.stroke_width(stroke(1.6)))])?;
        }
    }
    Ok(())
}

/// Draws an upright line through each run whose AET changed, and the change above it where there is room.
fn draw_changes(
    chart: &mut Chart<'_, '_>,
    runs: &[Run<'_>],
    execution_type: ExecutionType,
    (bottom, top): (f64, f64),
    format: Format,
) -> anyhow::Result<()> {
    let size = format.pick(12.0, 11.0);
    let room = format.width() - format.margin() - ChartAxes::RIGHT;
    let first = runs.first().map_or(0, |run| run.number);
    let mut free_from = 0.0;
    for run in runs {
        let Some((ms, _)) = run.entry.change(execution_type) else { continue };
        let x = run.number as f64;
        let line = PathElement::new(vec![(x, bottom), (x, top)], MUTED.stroke_width(stroke(1.0)));
        chart.draw_series([line])?;
        let label = signed(ms);
        let width = size * 0.62 * label.chars().count() as f64 + 8.0;
        let at = room * (x - first as f64 + 0.5) / runs.len() as f64;
        // Beside the line, on the side that has more room.
        let (side, gap, from) =
            if at + width < room { (HPos::Left, 4.0, at) } else { (HPos::Right, -4.0, at - width) };
        if from < free_from {
            continue;
        }
        free_from = from + width;
        let style = chart::name(size, INK).pos(Pos::new(side, VPos::Top));
        let beside = x + gap / room * runs.len() as f64;
        chart.draw_series([Text::new(label, (beside, top), style)])?;
    }
    Ok(())
}

/// Returns a tooltip for each circle of a point.
fn tooltips(point: &HistoryPoint<'_>, execution_type: ExecutionType) -> Vec<String> {
    let HistoryPoint { run, aet_ms, ends_ms: (low, high), .. } = point;
    let count = run.entry.repetitions.get(execution_type).copied().unwrap_or_default();
    let interval = if low < high { format!(" ± {:.1}", (high - low) / 2.0) } else { String::new() };
    let change = run.entry.change(execution_type).map(|(ms, _)| format!("; change {} ms", signed(ms)));
    let told = format!(
        "Run {}, {}: {aet_ms:.1}{interval} ms, n = {count}{}",
        run.number,
        label(execution_type),
        change.unwrap_or_default()
    );
    vec![told; if run.entry.is_whole() { 1 } else { 2 }]
}

fn whole_only(value: &f64) -> String {
    if (value - value.round()).abs() < 1e-6 { chart::whole(value) } else { String::new() }
}

/// Formats a difference in ms, or in s if it is large: the label must fit beside the axis of a phone.
fn difference(value: &f64) -> String {
    let sign = if *value > 1e-9 { "+" } else { "" };
    match value.abs() < 1e3 {
        true => format!("{sign}{}", chart::short(value)),
        false => format!("{sign}{} s", chart::short(&(value / 1e3))),
    }
}
