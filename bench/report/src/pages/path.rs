//! The tool's path from above and from the side, with the targets and their approximation distances.

mod labels;

use std::collections::BTreeMap;

use planning::Application;
use plc_node::ExecutionType;
use plotters::element::{Circle, PathElement};
use plotters::prelude::Color;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use protocol::image::Motion;
use setup::Setup;

use super::race::numbering::Numbering;
use crate::html::chart::{self, ChartAxes, Format, INK, MUTED, PAPER, colour, px, stroke, text};
use crate::html::figure::Data;
use labels::{Placed, labels, written};
use records::trace::{Recording, Trace};

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
struct DrawnTarget {
    number: usize,
    at: [f64; 3],
    approximation: f64,
}

/// Returns the targets and their approximation distances, in mm.
pub(super) fn data(setup: Option<&Setup>, application: Option<&Application>) -> Data {
    let row = |DrawnTarget { number, at, approximation }: DrawnTarget| {
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
    let mut targets = targets(setup, application);
    targets.truncate(recorded(trace));
    let content = Content { paths, targets };
    if content.paths.iter().all(|(_, path)| path.is_empty()) {
        return Ok(None);
    }
    let inner = format.width() - format.margin() - ChartAxes::RIGHT;
    let extents: Vec<_> =
        VIEWS.iter().map(|view| (content.extent(view.x.0), content.extent(view.y.0))).collect();
    // The same scale on both axes, so that angles are shown correctly.
    let heights: Vec<f64> = extents
        .iter()
        .map(|(x, y)| (y.1 - y.0) / (x.1 - x.0) * inner + ChartAxes::below(true) + 6.0)
        .collect();
    let height = heights.iter().sum::<f64>() + TITLE * VIEWS.len() as f64;
    let svg = chart::figure(format, height, |area| {
        let mut top = 0.0;
        for ((view, (x, y)), panel) in VIEWS.iter().zip(&extents).zip(&heights) {
            area.draw_text(view.title, &text(14.0, INK), (px(2.0), px(top + 14.0)))?;
            let part = area.clone().shrink((0, px(top + TITLE)), (area.dim_in_pixel().0, stroke(*panel)));
            let axes = ChartAxes {
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

/// Returns how many motions the recordings show: those that were begun in the longest one, or all if one shows the end of
/// its repetition.
fn recorded(trace: &Trace) -> usize {
    let recordings =
        || ExecutionType::ALL.into_iter().filter_map(|execution_type| trace.types.get(execution_type));
    let begun = |recording: &Recording| {
        let mut numbering = Numbering::default();
        let done = recording.robot_ticks().iter().map(|tick| numbering.done(&tick.sample)).max();
        done.unwrap_or(0) as usize + 1
    };
    if recordings().all(Recording::is_cut_off) {
        recordings().map(begun).max().unwrap_or(usize::MAX)
    } else {
        usize::MAX
    }
}

/// Distance in mm from one row to the next, beside what the speed explains, from which on the tool did not move there: another
/// tool was taken, whose tip is elsewhere.
const TOOL_CHANGE_MM: f64 = 2.0;

/// Returns the recorded path of the tool in mm, in pieces between which another tool was taken.
fn path(trace: &Trace, execution_type: ExecutionType) -> Vec<Vec<[f64; 3]>> {
    let ticks = trace.types.get(execution_type).map_or(&[][..], |recording| recording.robot_ticks());
    // Before its first motion, the robot reports its pose in an undefined base.
    let ticks = ticks.iter().skip_while(|tick| tick.sample.path_speed_mm_s == 0.0);
    let mut pieces: Vec<Vec<[f64; 3]>> = Vec::new();
    let mut before: Option<(f64, f64, [f64; 3])> = None;
    for tick in ticks {
        let at = [0, 1, 2].map(|axis| f64::from(tick.sample.pose.get(axis).copied().unwrap_or(0.0)));
        let speed = f64::from(tick.sample.path_speed_mm_s);
        let is_motion = before.is_some_and(|(at_ms, old_speed, from)| {
            // The speed may have been higher between two rows.
            let most = 2.0 * speed.max(old_speed) * (tick.at_ms - at_ms) / 1e3 + TOOL_CHANGE_MM;
            length(from, at) <= most
        });
        match pieces.last_mut().filter(|_| is_motion) {
            Some(piece) => piece.push(at),
            None => pieces.push(vec![at]),
        }
        before = Some((tick.at_ms, speed, at));
    }
    pieces
}

/// Returns the distance of two points.
fn length(from: [f64; 3], to: [f64; 3]) -> f64 {
    from.iter().zip(to).map(|(from, to)| (to - from) * (to - from)).sum::<f64>().sqrt()
}

/// What both views show, in mm.
struct Content {
    paths: [(ExecutionType, Vec<Vec<[f64; 3]>>); 3],
    targets: Vec<DrawnTarget>,
}

impl Content {
    /// Returns the ends of a coordinate's axis, with room beyond the paths.
    fn extent(&self, axis: usize) -> (f64, f64) {
        let points = || self.paths.iter().flat_map(|(_, path)| path.iter().flatten());
        let values = || points().filter_map(|point| point.get(axis).copied());
        let (low, high) =
            (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
        let lack = (LEAST - (high - low)).max(0.0) / 2.0;
        let room = ((high - low) * 0.05).max(12.0);
        (low - lack - room, high + lack + room)
    }

    /// Draws the zones, the paths and the targets of a view.
    fn draw(&self, chart: &mut chart::Chart<'_, '_>, view: &View, mm_per_px: f64) -> anyhow::Result<()> {
        let places = places(&self.targets, view);
        for (at, approximation) in zones(&places) {
            let radius = stroke(approximation / mm_per_px);
            chart.draw_series([Circle::new(at, radius, MUTED.mix(0.13).filled())])?;
        }
        for (execution_type, path) in &self.paths {
            let (width, strength) = match execution_type {
                ExecutionType::Sm => (7.0, 0.4),
                ExecutionType::Rc => (4.0, 0.5),
                ExecutionType::Cm => (1.5, 1.0),
            };
            for piece in path {
                let line = thinned(piece.iter().map(|point| view.flat(point)), mm_per_px * 0.35);
                let style = colour(*execution_type).mix(strength).stroke_width(stroke(width));
                chart.draw_series([PathElement::new(line, style)])?;
            }
        }
        for (at, _) in places {
            // The backend draws the outline of a circle without a width.
            for (radius, colour) in [(3.6, INK), (2.3, PAPER)] {
                chart.draw_series([Circle::new(at, px(radius), colour.filled())])?;
            }
        }
        Ok(())
    }

    /// Draws the targets' numbers beside them, as far as there is room.
    fn draw_numbers(
        &self,
        chart: &chart::Chart<'_, '_>,
        part: &chart::Area<'_>,
        view: &View,
        mm_per_px: f64,
        format: Format,
    ) -> anyhow::Result<()> {
        let size = format.pick(12.0, 11.0);
        let mut placed = Placed::new(size);
        for (numbers, (x, y)) in labels(&self.targets, |point| view.flat(point), mm_per_px * 14.0) {
            let (x, y) = chart.backend_coord(&(x, y));
            let (left, above) = part.get_base_pixel();
            let (x, y) = (x - left, y - above - px(15.0));
            let style = text(size, INK);
            // At the right edge the numbers would leave the figure.
            let is_at_edge = x > px(format.width() * 0.88);
            let (x, side) = if is_at_edge { (x - px(7.0), HPos::Right) } else { (x + px(7.0), HPos::Left) };
            let label = written(&numbers);
            let corner = (f64::from(x) / px(1.0) as f64, f64::from(y) / px(1.0) as f64);
            if placed.place(&label, corner, is_at_edge) {
                part.draw_text(&label, &style.pos(Pos::new(side, VPos::Top)), (x, y))?;
            }
        }
        Ok(())
    }
}

fn targets(setup: Option<&Setup>, application: Option<&Application>) -> Vec<DrawnTarget> {
    let (Some(setup), Some(application)) = (setup, application) else { return Vec::new() };
    let Ok(plan) = planning::plan(application, setup) else { return Vec::new() };
    let motions = plan.wire_motions(setup);
    let target = |(index, motion): (usize, &Motion)| {
        let [x, y, z, ..] = motion.target.map(f64::from);
        DrawnTarget { number: index + 1, at: [x, y, z], approximation: motion.approximation_mm() }
    };
    motions.iter().enumerate().map(target).collect()
}

/// Returns where a view shows targets, each place once, with the largest approximation distance there, in mm.
fn places(targets: &[DrawnTarget], view: &View) -> Vec<((f64, f64), f64)> {
    // Targets that are less than a hundredth of a millimetre apart are at one place.
    let hundredths = |mm: f64| (mm * 100.0).round() as i64;
    let mut places: BTreeMap<(i64, i64), ((f64, f64), f64)> = BTreeMap::new();
    for target in targets {
        let at = view.flat(&target.at);
        let (_, largest) = places.entry((hundredths(at.0), hundredths(at.1))).or_insert((at, 0.0));
        *largest = largest.max(target.approximation);
    }
    places.into_values().collect()
}

/// Returns the zones about the places. Of those about almost the same place only the first is kept: one above another they
/// would become opaque.
fn zones(places: &[((f64, f64), f64)]) -> Vec<((f64, f64), f64)> {
    let mut kept: Vec<((f64, f64), f64)> = Vec::new();
    for (at, radius) in places.iter().filter(|(_, radius)| *radius > 0.0) {
        let is_shown = |(other, others_radius): &((f64, f64), f64)| {
            radius <= others_radius && libm::hypot(at.0 - other.0, at.1 - other.1) < radius / 2.0
        };
        if !kept.iter().any(is_shown) {
            kept.push((*at, *radius));
        }
    }
    kept
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
    use records::results::PerType;
    use records::trace::{PlcScan, RobotTick};

    fn target(number: usize, at: [f64; 3], approximation: f64) -> DrawnTarget {
        DrawnTarget { number, at, approximation }
    }

    #[test]
    fn a_place_that_many_motions_go_to_is_drawn_once_with_its_largest_zone() {
        let [side, plan] = VIEWS;
        let targets = [
            target(1, [0.0, -60.0, 70.0], 5.0),
            target(2, [0.0, -60.0, 30.0], 0.0),
            target(3, [0.001, -60.0, 70.0], 10.0),
        ];
        assert_eq!(places(&targets, &side), [((0.0, 30.0), 0.0), ((0.0, 70.0), 10.0)]);
        assert_eq!(places(&targets, &plan), [((0.0, -60.0), 10.0)]);
    }

    #[test]
    fn zones_about_almost_the_same_place_do_not_lie_on_each_other() {
        let row: Vec<_> = (0..100).map(|index| ((f64::from(index) * 0.5, 0.0), 10.0)).collect();
        let kept = zones(&row);
        let covers = |zone: &&((f64, f64), f64)| (zone.0.0 - 25.0).abs() < 10.0;
        assert!((1..=4).contains(&kept.iter().filter(covers).count()), "{kept:?}");
        let two_sizes = [((0.0, 0.0), 5.0), ((1.0, 0.0), 10.0), ((2.0, 0.0), 0.0)];
        assert_eq!(zones(&two_sizes), two_sizes[..2], "the larger one shows more");
    }

    /// Returns a recording of CM of so many seconds in which each command has ten motions, one a second.
    fn recorded_for(seconds: u32) -> Trace {
        let mut recording = Recording::default();
        for second in 0..=seconds {
            let (command, executed) = ((second / 10) as u16, second % 10);
            let sample = robot_node::Sample { command, executed, ..robot_node::Sample::default() };
            recording.robot(RobotTick { at_ms: f64::from(second) * 1e3, true_ns: 0, sample });
            recording.plc(PlcScan {
                at_us: i64::from(second) * 1_000_000,
                true_ns: 0,
                sample: plc_node::Sample::default(),
            });
        }
        Trace { types: PerType { cm: Some(recording), ..PerType::default() } }
    }

    #[test]
    fn of_a_recording_that_ends_early_only_the_motions_that_were_begun_have_their_targets() {
        assert_eq!(recorded(&recorded_for(60)), usize::MAX);
        // Twelve commands of nine motions each, and the first motion of the next one.
        assert_eq!(recorded(&recorded_for(200)), 12 * 9 + 1);
        assert_eq!(recorded(&Trace::default()), usize::MAX);
    }

    #[test]
    fn another_tool_ends_a_piece_of_the_path_and_is_not_drawn_as_a_motion() {
        let mut recording = Recording::default();
        for cycle in 0..20_u16 {
            // 4 mm in each cycle of 4 ms at 1000 mm/s; with the eleventh row the tip is 80 mm lower.
            let z = if cycle < 10 { 100.0 } else { 20.0 };
            let pose = [f32::from(cycle) * 4.0, 0.0, z, 0.0, 0.0, 180.0];
            let sample =
                robot_node::Sample { pose, path_speed_mm_s: 1_000.0, ..robot_node::Sample::default() };
            recording.robot(RobotTick { at_ms: f64::from(cycle) * 4.0, true_ns: 0, sample });
        }
        let trace = Trace { types: PerType { cm: Some(recording), ..PerType::default() } };
        let pieces = path(&trace, ExecutionType::Cm);
        assert_eq!(pieces.iter().map(Vec::len).collect::<Vec<_>>(), [10, 10]);
    }

    #[test]
    fn a_thinned_line_keeps_its_ends() {
        let points = (0..=100).map(|index| (f64::from(index) * 0.1, 0.0));
        let line = thinned(points, 3.0);
        assert_eq!((line.first(), line.last()), (Some(&(0.0, 0.0)), Some(&(10.0, 0.0))));
        assert!(line.len() < 7, "{line:?}");
    }
}
