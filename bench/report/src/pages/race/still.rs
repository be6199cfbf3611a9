//! The picture of the race that opens it from the report: the arms at the moment at which the first of them is done, or at
//! which the first recording ends where none is done.

use plotters::element::{Circle, PathElement, Polygon};
use plotters::prelude::{Color, RGBColor};
use robot_node::arm::Frame;

use super::super::end::End;
use super::Race;
use super::chain::Rod;
use super::lane::Lane;
use crate::html::chart::{self, AXIS, Area, Format, INK, MUTED, px, stroke, text};

/// Turn of the view about the vertical and its tilt, in degrees.
const TURN: f64 = 58.0;
const TILT: f64 = 22.0;

/// Height of the text above an arm, in pixels.
const TITLE: f64 = 46.0;

/// Points of a path that are drawn at most.
const POINTS: usize = 250;

/// A view without perspective: from mm in the root's frame to pixels.
struct View {
    /// Right and up in the picture.
    right: [f64; 3],
    up: [f64; 3],
    scale: f64,
    middle: (f64, f64),
    /// The middle of the picture, in pixels.
    at: (f64, f64),
}

impl View {
    /// Creates a view from the side of the targets in which all these points, with this margin, fit into a picture of
    /// this size.
    fn of(
        points: &[[f64; 3]],
        around_mm: f64,
        towards: [f64; 3],
        (width, height): (f64, f64),
        top: f64,
    ) -> Self {
        let turn = libm::atan2(towards[1], towards[0]) + TURN.to_radians();
        let (sine, cosine) = (libm::sin(turn), libm::cos(turn));
        let (rise, level) = (libm::sin(TILT.to_radians()), libm::cos(TILT.to_radians()));
        let right = [-sine, cosine, 0.0];
        let up = [-cosine * rise, -sine * rise, level];
        let range = |axis: &[f64; 3]| {
            let along = points.iter().map(|point| dot(axis, point));
            along.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), at| {
                (low.min(at - around_mm), high.max(at + around_mm))
            })
        };
        let (x, y) = (range(&right), range(&up));
        let scale = (width / (x.1 - x.0).max(1.0)).min(height / (y.1 - y.0).max(1.0));
        Self {
            right,
            up,
            scale,
            middle: ((x.0 + x.1) / 2.0, (y.0 + y.1) / 2.0),
            at: (width / 2.0, top + height / 2.0),
        }
    }

    fn pixels(&self, point: &[f64; 3]) -> (i32, i32) {
        let x = (dot(&self.right, point) - self.middle.0) * self.scale + self.at.0;
        let y = self.at.1 - (dot(&self.up, point) - self.middle.1) * self.scale;
        (px(x), px(y))
    }
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

impl Race {
    /// Draws the arms next to each other.
    pub(in super::super) fn still(&self, format: Format) -> anyhow::Result<String> {
        let width = format.width() / self.lanes.len().max(1) as f64;
        let height = format.pick(300.0, 170.0);
        let at_ms = self.moment_ms();
        let paths: Vec<_> = self.joints.iter().map(|joints| self.path(joints)).collect();
        let corners = self.scene.cell.obstacles.iter().flat_map(|obstacle| obstacle.corners);
        let points: Vec<_> =
            paths.iter().flatten().map(|(_, point)| *point).chain(self.reach()).chain(corners).collect();
        let towards = middle(paths.iter().flatten().map(|(_, point)| *point));
        let inner = (width * 0.9, height - TITLE - 14.0);
        let view = View::of(&points, self.scene.arm.radius_mm * 1.3, towards, inner, TITLE + 2.0);
        chart::figure(format, height, |whole| {
            for (index, ((lane, joints), path)) in self.lanes.iter().zip(&self.joints).zip(&paths).enumerate()
            {
                let left = px(width * index as f64 + width * 0.05);
                let area = whole.clone().shrink((left, 0), (stroke(width * 0.9), stroke(height)));
                let colour = colour_of(&lane.key);
                area.draw_text(
                    &lane.name,
                    &chart::name(format.pick(17.0, 14.0), colour),
                    (px(0.0), px(4.0)),
                )?;
                let said = self.said(index, at_ms, format);
                area.draw_text(&said, &text(format.pick(13.0, 11.0), INK), (px(0.0), px(26.0)))?;
                self.surroundings(&area, &view)?;
                let line = |points: Vec<_>, style| area.draw(&PathElement::new(points, style));
                line(
                    path.iter().map(|(_, point)| view.pixels(point)).collect(),
                    colour.mix(0.35).stroke_width(stroke(1.0)),
                )?;
                let done = path.iter().filter(|(at, _)| *at <= at_ms);
                line(
                    done.map(|(_, point)| view.pixels(point)).collect(),
                    colour.stroke_width(stroke(format.pick(2.6, 2.0))),
                )?;
                let now = joints.iter().take_while(|(at, _)| *at <= at_ms).last().or(joints.first());
                if let Some((_, joints)) = now {
                    self.arm_at(&area, &view, joints, colour)?;
                }
            }
            Ok(())
        })
    }

    /// Returns the moment that the picture shows, in ms: the first arm is done, or the first recording ends if none is.
    fn moment_ms(&self) -> f64 {
        let earliest = |lanes: &mut dyn Iterator<Item = &Lane>| {
            lanes.map(|lane| lane.end_ms).fold(f64::INFINITY, f64::min)
        };
        match earliest(&mut self.done()) {
            f64::INFINITY => earliest(&mut self.lanes.iter()),
            done_ms => done_ms,
        }
    }

    /// Returns what happens at the moment of the picture.
    pub(in super::super) fn moment(&self) -> &'static str {
        if self.done().next().is_some() { "the first arm is done" } else { "the first recording ends" }
    }

    fn done(&self) -> impl Iterator<Item = &Lane> {
        self.lanes.iter().filter(|lane| lane.end == End::Done)
    }

    fn said(&self, index: usize, at_ms: f64, format: Format) -> String {
        let Some(lane) = self.lanes.get(index) else { return String::new() };
        // Within a cycle of the PLC they end together.
        if lane.end_ms <= at_ms + 1.0 {
            let end_s = lane.end_s();
            match lane.end {
                End::Done => return format!("done: {end_s:.2} s"),
                End::Failed | End::Interrupted => return lane.end.label(end_s),
                End::CutOff | End::Unfinished => {}
            }
        }
        let done = lane.done.iter().rev().find(|(at, _)| *at <= at_ms).map_or(0, |(_, done)| *done);
        let all = lane.done.last().map_or(0, |(_, done)| *done);
        if lane.end != End::Done || done >= all {
            return format.pick(format!("{done} motions done"), format!("{done} done"));
        }
        format.pick(format!("{done} of {all} motions done"), format!("{done} of {all} done"))
    }

    /// Returns the way of the tool with its times, in the root's frame, thinned.
    fn path(&self, joints: &[(f64, [f64; 6])]) -> Vec<(f64, [f64; 3])> {
        let every = joints.len().div_ceil(POINTS).max(1);
        let point = |(at, joints): &(f64, [f64; 6])| (*at, self.scene.arm.frames(joints).1.position);
        joints.iter().step_by(every).chain(joints.last()).map(point).collect()
    }

    /// Returns the points that the arm's bodies reach, the base among them.
    fn reach(&self) -> Vec<[f64; 3]> {
        let mut points: Vec<_> = self.scene.arm.base.iter().flat_map(ends).collect();
        for joints in &self.joints {
            let every = joints.len().div_ceil(POINTS).max(1);
            for (_, joints) in joints.iter().step_by(every) {
                let (frames, _) = self.scene.arm.frames(joints);
                let bodies = frames.iter().zip(&self.scene.arm.joints);
                points.extend(bodies.flat_map(|(frame, joint)| {
                    joint.bodies.iter().flat_map(ends).map(|point| frame.point(point)).collect::<Vec<_>>()
                }));
            }
        }
        points
    }

    fn surroundings(&self, area: &Area<'_>, view: &View) -> anyhow::Result<()> {
        // The faces of a box by its corners' numbers.
        const FACES: [[usize; 4]; 6] =
            [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
        for obstacle in &self.scene.cell.obstacles {
            for face in FACES {
                let corners = face.iter().filter_map(|corner| obstacle.corners.get(*corner));
                let points: Vec<_> = corners.map(|corner| view.pixels(corner)).collect();
                area.draw(&Polygon::new(points, MUTED.mix(0.07)))?;
            }
        }
        for target in &self.scene.cell.targets {
            area.draw(&Circle::new(view.pixels(target), px(2.0), MUTED.mix(0.6).filled()))?;
        }
        Ok(())
    }

    fn arm_at(
        &self,
        area: &Area<'_>,
        view: &View,
        joints: &[f64; 6],
        colour: RGBColor,
    ) -> anyhow::Result<()> {
        let (frames, tip) = self.scene.arm.frames(joints);
        let body = |frame: &Frame, rod: &Rod, colour: RGBColor| {
            let width = stroke((rod.radius * 2.0 * view.scale).max(2.0));
            let [from, to] = ends(rod).map(|point| view.pixels(&frame.point(point)));
            // A thick line has no round ends.
            for end in [from, to] {
                area.draw(&Circle::new(end, width / 2, colour.filled()))?;
            }
            area.draw(&PathElement::new([from, to], colour.stroke_width(width)))?;
            anyhow::Ok(())
        };
        for rod in &self.scene.arm.base {
            body(&Frame::IDENTITY, rod, AXIS)?;
        }
        for (index, (frame, joint)) in frames.iter().zip(&self.scene.arm.joints).enumerate() {
            for rod in &joint.bodies {
                body(frame, rod, if index % 2 == 0 { MUTED } else { AXIS })?;
            }
        }
        if let Some(wrist) = frames.last() {
            let rod = Rod { from: wrist.position, to: tip.position, radius: self.scene.arm.radius_mm * 0.2 };
            body(&Frame::IDENTITY, &rod, colour)?;
        }
        area.draw(&Circle::new(view.pixels(&tip.position), px(4.0), colour.filled()))?;
        Ok(())
    }
}

fn ends(rod: &Rod) -> [[f64; 3]; 2] {
    [rod.from, rod.to]
}

fn middle(points: impl Iterator<Item = [f64; 3]>) -> [f64; 3] {
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    for point in points {
        sum.iter_mut().zip(point).for_each(|(sum, part)| *sum += part);
        count += 1.0;
    }
    sum.map(|part| part / f64::max(count, 1.0))
}

fn colour_of(key: &str) -> RGBColor {
    plc_node::ExecutionType::ALL
        .into_iter()
        .find(|execution_type| execution_type.to_string() == key)
        .map_or(INK, chart::colour)
}
