//! The tool's path from above and from the side, with the targets and their approximation distances.

use planning::Application;
use plc_node::ExecutionType;
use plotters::element::{Circle, PathElement};
use plotters::prelude::Color;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use protocol::image::Motion;
use setup::Setup;

use crate::output::html::chart::{self, Axes, Format, INK, MUTED, PAPER, colour, px, stroke, text};
use crate::output::html::figure::Data;
use crate::records::trace::Trace;

/// One of the two views: the coordinates on its axes.
struct View {
    title: &'static str,
    x: (usize, &'static str),
    y: (usize, &'static str),
}

impl View {
    /// Returns a point as this view shows it.
    fn flat(&self, point: &[f64; 3]) -> (f64, f64) {
        let axis = |index: usize| point.get(index).copied().unwrap_or_default();
        (axis(self.x.0), axis(self.y.0))
    }
}

const VIEWS: [View; 2] = [
    View { title: "Side view", x: (0, "x in mm"), y: (2, "z in mm") },
    View { title: "Plan view", x: (0, "x in mm"), y: (1, "y in mm") },
];

/// Height of a view's title in pixels.
const TITLE: f64 = 54.0;

/// Smallest extent of an axis in mm, so that a path in a plane looks plane.
const LEAST: f64 = 40.0;

/// A target and its approximation distance, in mm.
struct Target {
    number: usize,
    at: [f64; 3],
    approximation: f64,
}

/// Returns the targets and their approximation distances, in mm.
pub(super) fn data(setup: Option<&Setup>, application: Option<&Application>) -> Data {
    let row = |Target { number, at, approximation }: Target| {
        let figures = at.into_iter().chain([approximation]).map(|value| chart::short(&value));
        std::iter::once(number.to_string()).chain(figures).collect()
    };
    let head = ["target", "x, mm", "y, mm", "z, mm", "approximation, mm"].map(str::to_owned);
    Data::new(head.into(), targets(setup, application).into_iter().map(row).collect())
}

/// Draws both views; `None` without ticks.
pub(super) fn draw(
    trace: &Trace,
    setup: Option<&Setup>,
    application: Option<&Application>,
    format: Format,
) -> anyhow::Result<Option<String>> {
    // Where paths coincide, the lower one is drawn wider.
    let paths = [ExecutionType::Sm, ExecutionType::Rc, ExecutionType::Cm]
        .map(|execution_type| (execution_type, path(trace, execution_type)));
    let content = Content { paths, targets: targets(setup, application) };
    if content.paths.iter().all(|(_, path)| path.is_empty()) {
        return Ok(None);
    }
    let inner = format.width() - format.margin() - Axes::RIGHT;
    let extents: Vec<_> =
        VIEWS.iter().map(|view| (content.extent(view.x.0), content.extent(view.y.0))).collect();
    // The same scale on both axes, so that angles are shown correctly.
    let heights: Vec<f64> =
        extents.iter().map(|(x, y)| (y.1 - y.0) / (x.1 - x.0) * inner + Axes::below(true) + 6.0).collect();
    let height = heights.iter().sum::<f64>() + TITLE * VIEWS.len() as f64;
    let svg = chart::figure(format, height, |area| {
        let mut top = 0.0;
        for ((view, (x, y)), panel) in VIEWS.iter().zip(&extents).zip(&heights) {
            area.draw_text(view.title, &text(14.0, INK), (px(2.0), px(top + 14.0)))?;
            let part = area.clone().shrink((0, px(top + TITLE)), (area.dim_in_pixel().0, stroke(*panel)));
            let axes = Axes {
                x: *x,
                y: *y,
                x_title: Some(view.x.1),
                y_title: view.y.1,
                x_lines: true,
                labels: (format.pick(12, 6), format.pick(6, 4)),
                write: (&chart::whole, &chart::whole),
            };
            let mut chart = axes.draw(format, &part)?;
            let mm_per_px = (x.1 - x.0) / inner;
            content.draw(&mut chart, view, mm_per_px)?;
            content.draw_numbers(&chart, &part, view, mm_per_px, format)?;
            top += TITLE + panel;
        }
        Ok(())
    })?;
    Ok(Some(svg))
}

/// Returns the recorded path of the tool, in mm.
fn path(trace: &Trace, execution_type: ExecutionType) -> Vec<[f64; 3]> {
    let ticks = trace.types.get(execution_type).map_or(&[][..], |recording| recording.robot_ticks());
    ticks
        .iter()
        // Before its first motion, the robot reports its pose in an undefined base.
        .skip_while(|tick| tick.sample.path_speed_mm_s == 0.0)
        .map(|tick| [0, 1, 2].map(|axis| f64::from(tick.sample.pose.get(axis).copied().unwrap_or(0.0))))
        .collect()
}

/// What both views show, in mm.
struct Content {
    paths: [(ExecutionType, Vec<[f64; 3]>); 3],
    targets: Vec<Target>,
}

impl Content {
    /// Returns the ends of a coordinate's axis, with room beyond the paths.
    fn extent(&self, axis: usize) -> (f64, f64) {
        let points = || self.paths.iter().flat_map(|(_, path)| path);
        let values = || points().filter_map(|point| point.get(axis).copied());
        let (low, high) =
            (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
        let lack = (LEAST - (high - low)).max(0.0) / 2.0;
        let room = ((high - low) * 0.05).max(12.0);
        (low - lack - room, high + lack + room)
    }

    /// Draws the zones, the paths and the targets of a view.
    fn draw(&self, chart: &mut chart::Chart<'_, '_>, view: &View, mm_per_px: f64) -> anyhow::Result<()> {
        for Target { at, approximation, .. } in
            self.targets.iter().filter(|target| target.approximation > 0.0)
        {
            let radius = stroke(approximation / mm_per_px);
            let zone = Circle::new(view.flat(at), radius, MUTED.mix(0.13).filled());
            chart.draw_series([zone])?;
        }
        for (execution_type, path) in &self.paths {
            let (width, strength) = match execution_type {
                ExecutionType::Sm => (7.0, 0.4),
                ExecutionType::Rc => (4.0, 0.5),
                ExecutionType::Cm => (1.5, 1.0),
            };
            let line = thinned(path.iter().map(|point| view.flat(point)), mm_per_px * 0.35);
            let style = colour(*execution_type).mix(strength).stroke_width(stroke(width));
            chart.draw_series([PathElement::new(line, style)])?;
        }
        for target in &self.targets {
            // The backend draws the outline of a circle without a width.
            for (radius, colour) in [(3.6, INK), (2.3, PAPER)] {
                chart.draw_series([Circle::new(view.flat(&target.at), px(radius), colour.filled())])?;
            }
        }
        Ok(())
    }

    /// Draws the targets' numbers beside them.
    fn draw_numbers(
        &self,
        chart: &chart::Chart<'_, '_>,
        part: &chart::Area<'_>,
        view: &View,
        mm_per_px: f64,
        format: Format,
    ) -> anyhow::Result<()> {
        for (numbers, (x, y)) in labels(&self.targets, |point| view.flat(point), mm_per_px * 14.0) {
            let (x, y) = chart.backend_coord(&(x, y));
            let (left, above) = part.get_base_pixel();
            let (x, y) = (x - left, y - above - px(15.0));
            let style = text(format.pick(12.0, 11.0), INK);
            // At the right edge the numbers would leave the figure.
            let (x, side) = if x > px(format.width() * 0.88) {
                (x - px(7.0), HPos::Right)
            } else {
                (x + px(7.0), HPos::Left)
            };
            part.draw_text(&ranges(&numbers), &style.pos(Pos::new(side, VPos::Top)), (x, y))?;
        }
        Ok(())
    }
}

fn targets(setup: Option<&Setup>, application: Option<&Application>) -> Vec<Target> {
    let (Some(setup), Some(application)) = (setup, application) else { return Vec::new() };
    let Ok(plan) = planning::plan(application, setup) else { return Vec::new() };
    let motions = plan.wire_motions(setup);
    let target = |(index, motion): (usize, &Motion)| {
        let [x, y, z, ..] = motion.target.map(f64::from);
        Target { number: index + 1, at: [x, y, z], approximation: motion.approximation_mm() }
    };
    motions.iter().enumerate().map(target).collect()
}

/// Returns the targets' numbers and positions; numbers at the same position are combined.
fn labels(
    targets: &[Target],
    flat: impl Fn(&[f64; 3]) -> (f64, f64),
    near: f64,
) -> Vec<(Vec<usize>, (f64, f64))> {
    let mut labels: Vec<(Vec<usize>, (f64, f64))> = Vec::new();
    for target in targets {
        let at = flat(&target.at);
        let is_near = |other: &(f64, f64)| (other.0 - at.0).abs() < near && (other.1 - at.1).abs() < near;
        match labels.iter_mut().find(|(_, other)| is_near(other)) {
            Some((numbers, _)) => numbers.push(target.number),
            None => labels.push((vec![target.number], at)),
        }
    }
    labels
}

/// Formats ascending numbers as text: `1, 3–5`.
fn ranges(numbers: &[usize]) -> String {
    let runs = numbers.chunk_by(|before, after| before + 1 == *after);
    let written = runs.map(|run| match run {
        [first, .., last] if last - first > 1 => format!("{first}–{last}"),
        few => few.iter().map(ToString::to_string).collect::<Vec<_>>().join(", "),
    });
    written.collect::<Vec<_>>().join(", ")
}

/// Returns the points that are further than `least` from the previous one; always keeps the last one.
fn thinned(points: impl Iterator<Item = (f64, f64)>, least: f64) -> Vec<(f64, f64)> {
    let mut kept: Vec<(f64, f64)> = Vec::new();
    let mut last = None;
    for point in points {
        last = Some(point);
        let is_far = |before: &(f64, f64)| libm::hypot(point.0 - before.0, point.1 - before.1) >= least;
        if kept.last().is_none_or(is_far) {
            kept.push(point);
        }
    }
    kept.extend(last);
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motion_numbers_in_a_row_are_written_as_a_range() {
        assert_eq!(ranges(&[1, 2, 3, 4, 5]), "1–5");
        assert_eq!(ranges(&[6, 12]), "6, 12");
        assert_eq!(ranges(&[2, 3, 7, 8, 9]), "2, 3, 7–9");
    }

    #[test]
    fn a_thinned_line_keeps_its_ends() {
        let points = (0..=100).map(|index| (f64::from(index) * 0.1, 0.0));
        let line = thinned(points, 3.0);
        assert_eq!((line.first(), line.last()), (Some(&(0.0, 0.0)), Some(&(10.0, 0.0))));
        assert!(line.len() < 7, "{line:?}");
    }
}
