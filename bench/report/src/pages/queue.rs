//! Number of filled slots of the image while a skill runs.

use plc_node::ExecutionType;
use plotters::element::{PathElement, Polygon};
use plotters::prelude::Color;

use crate::html::chart::{self, ChartAxes, Format, INK, Panels, colour, px, stroke};
use crate::html::figure::Data;
use crate::progress::label;
use records::trace::{Recording, Trace};

/// Height of a panel and of the line of text above it, in pixels.
const PANEL: f64 = 96.0;
const TITLE: f64 = 30.0;

/// Slots of the image.
const SLOTS: f64 = protocol::image::SLOTS as f64;

/// Returns the share of the scans in which so many motions were in the slots.
pub(super) fn data(trace: &Trace) -> Data {
    let recordings = || {
        [ExecutionType::Sm, ExecutionType::Cm]
            .into_iter()
            .filter_map(|execution_type| Some((execution_type, trace.types.get(execution_type)?)))
    };
    let share = |recording: &Recording, count: u32| {
        let scans = recording.plc_scans();
        let with = scans.iter().filter(|scan| scan.sample.in_slots == count).count();
        format!("{:.1}", with as f64 / scans.len().max(1) as f64 * 100.0)
    };
    let row = |count: u32| {
        let cells = recordings().map(|(_, recording)| share(recording, count));
        std::iter::once(count.to_string()).chain(cells).collect()
    };
    let head = recordings().map(|(execution_type, _)| format!("{}, % of the scans", label(execution_type)));
    let head = std::iter::once("motions in the slots".to_owned()).chain(head).collect();
    let most = recordings().map(|(_, recording)| most_in_slots(recording)).max().unwrap_or(0);
    Data::new(head, (0..=most.max(SLOTS as u32)).map(row).collect())
}

/// Draws the figure; `None` without scans. RC is left out, because its program is already in the robot.
pub(super) fn draw(trace: &Trace, format: Format) -> anyhow::Result<Option<String>> {
    let panels: Vec<_> = [ExecutionType::Sm, ExecutionType::Cm]
        .into_iter()
        .filter_map(|execution_type| Some((execution_type, trace.types.get(execution_type)?)))
        .filter(|(_, recording)| !recording.plc_scans().is_empty())
        .collect();
    let ends =
        panels.iter().filter_map(|(_, recording)| Some(recording.plc_scans().last()?.at_us as f64 / 1e6));
    let longest_s = ends.fold(0.0, f64::max);
    if longest_s <= 0.0 {
        return Ok(None);
    }
    let in_robot = panels.iter().flat_map(|(_, recording)| held(recording)).map(|(_, held)| held);
    let most = panels.iter().map(|(_, recording)| f64::from(most_in_slots(recording))).chain(in_robot);
    let most = most.fold(SLOTS, f64::max);
    let layout = Panels { title: TITLE, panel: PANEL };
    let svg = layout.figure(format, &panels, |whole, panel, (execution_type, recording)| {
        whole.draw_text(
            &label(*execution_type),
            &chart::name(15.0, colour(*execution_type)),
            (px(2.0), px(panel.top + 8.0)),
        )?;
        let axes = ChartAxes {
            x: (0.0, longest_s * 1.01),
            y: (0.0, most + 0.08 * SLOTS),
            x_title: panel.is_last.then_some("time since the PLC's start edge in s"),
            y_title: "",
            x_lines: true,
            labels: (format.pick(14, 7), 6),
            write: (&chart::short, &chart::whole),
        };
        let mut chart = axes.draw(format, &panel.area)?;
        let slots =
            steps(recording.plc_scans().iter().map(|scan| (scan.at_us as f64 / 1e6, scan.sample.in_slots)));
        let (first, last) = (slots.first().map(|at| (at.0, 0.0)), slots.last().map(|at| (at.0, 0.0)));
        let under: Vec<_> = first.into_iter().chain(slots.iter().copied()).chain(last).collect();
        chart.draw_series([Polygon::new(under, colour(*execution_type).mix(0.16))])?;
        chart.draw_series([PathElement::new(slots, colour(*execution_type).stroke_width(stroke(1.6)))])?;
        chart.draw_series([PathElement::new(held(recording), INK.mix(0.75).stroke_width(stroke(1.0)))])?;
        Ok(())
    })?;
    Ok(Some(svg))
}

/// Returns the largest number of motions in the slots: more than five where they are refilled by what is accepted.
fn most_in_slots(recording: &Recording) -> u32 {
    recording.plc_scans().iter().map(|scan| scan.sample.in_slots).max().unwrap_or(0)
}

/// Returns the motions that the robot has accepted and not executed yet.
fn held(recording: &Recording) -> Vec<(f64, f64)> {
    steps(recording.robot_ticks().iter().map(|tick| (tick.at_ms / 1e3, tick.sample.queued())))
}

/// Returns a count over time as a line with steps.
fn steps(counts: impl Iterator<Item = (f64, u32)>) -> Vec<(f64, f64)> {
    let mut line: Vec<(f64, f64)> = Vec::new();
    let mut end = None;
    for (at, count) in counts {
        let count = f64::from(count);
        match line.last().copied() {
            Some((_, before)) if before == count => {}
            Some((_, before)) => line.extend([(at, before), (at, count)]),
            None => line.push((at, count)),
        }
        end = Some((at, count));
    }
    line.extend(end);
    line
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_count_over_time_is_drawn_with_a_point_before_and_after_each_step() {
        let counts = [(0.0, 0), (1.0, 0), (2.0, 5), (3.0, 5), (4.0, 4)];
        let line = [(0.0, 0.0), (2.0, 0.0), (2.0, 5.0), (4.0, 5.0), (4.0, 4.0), (4.0, 4.0)];
        assert_eq!(steps(counts.into_iter()), line);
    }
}
