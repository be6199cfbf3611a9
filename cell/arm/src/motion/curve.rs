//! The geometry of one motion, without time: where the arm is after a way `s` along it.

use super::arc::Arc;
use super::flange::Flange;
use super::spline::Spline;
use crate::{Arm, Frame, Joints, LEAST_WAY_MM, Rotation, Violation, distance};

/// Largest distance of a line from the line that it continues, in mm and in degrees, at the end of the shorter one: the
/// rounding of coordinates in single precision.
const STRAIGHT_MM: f64 = 1e-4;
const STRAIGHT_DEG: f64 = 1e-4;

/// Largest difference of the directions, and of the turns per mm in degrees: near a singular position a small one moves
/// the joints far.
const KINK: f64 = 5e-5;

/// The way of the tool, or of the joints, from one point to the next. Each kind of motion has a variant.
#[expect(
    clippy::large_enum_variant,
    reason = "kept in queues of fixed size; nothing is allocated while it runs"
)]
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Curve {
    /// A straight line of the tool, orientation turning evenly about one axis.
    Line(Line),
    /// A circle of the tool through an intermediate point.
    Arc(Arc),
    /// A piece of a spline of the tool.
    Spline(Spline),
    /// All axes, point to point.
    Axes(AxisLine),
}

/// A straight line of the tool in the root. Its parameter is the way in mm; where the tool only turns, a degree
/// counts as a millimetre.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Line {
    from: Frame,
    to: Frame,
    length: f64,
    axis: [f64; 3],
    angle: f64,
    flange: Flange,
}

/// All axes together from joints to joints. Its parameter is the share of the way, 0…1.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct AxisLine {
    from: Joints,
    to: Joints,
}

impl Line {
    /// From tool pose to tool pose, both in the root.
    #[must_use]
    pub fn new(from: Frame, to: Frame, flange: Flange) -> Self {
        let (axis, angle) = (from.rotation.inverse() * to.rotation).axis_angle();
        let way = distance(from.position, to.position);
        // Single precision on the wire leaves some micrometres, by which nothing may be divided.
        let length = if way < 1e-3 { angle } else { way };
        let length = if length < 1e-3 { 0.0 } else { length };
        Self { from, to, length, axis, angle, flange }
    }

    /// The tool in the root after `way`.
    #[must_use]
    pub fn tool(&self, way: f64) -> Frame {
        let rotation = if self.angle == 0.0 {
            self.to.rotation
        } else {
            self.from.rotation * Rotation::about(self.axis, self.share(way) * self.angle)
        };
        Frame { position: self.position(way), rotation }
    }

    /// Where the tool is after `way`.
    fn position(&self, way: f64) -> [f64; 3] {
        let (share, from, to) = (self.share(way), &self.from.position, &self.to.position);
        core::array::from_fn(|i| from[i] + share * (to[i] - from[i]))
    }

    fn share(&self, way: f64) -> f64 {
        if self.length > 0.0 { way / self.length } else { 1.0 }
    }

    /// Returns whether the next one continues it as one line: the same tool, direction and turn per mm, except for the
    /// rounding on the wire.
    #[must_use]
    pub fn goes_on_to(&self, next: &Self) -> bool {
        let by_mm = |line: &Self| {
            let way = distance(line.from.position, line.to.position);
            let place =
                core::array::from_fn::<_, 3, _>(|i| (line.to.position[i] - line.from.position[i]) / way);
            (way, place, line.axis.map(|part| part * line.angle / way))
        };
        let ((one, direction, turn), (other, next_direction, next_turn)) = (by_mm(self), by_mm(next));
        let shorter = one.min(other);
        let (kink, turned) = (distance(direction, next_direction), distance(turn, next_turn));
        self.flange == next.flange
            && shorter >= LEAST_WAY_MM
            && kink <= KINK.min(STRAIGHT_MM / shorter)
            && turned <= KINK.min(STRAIGHT_DEG / shorter)
    }

    /// Returns where the arm is after `way` on the line that continues this one, and on the next one from its start.
    ///
    /// # Errors
    ///
    /// The arm cannot be at one of these places.
    pub(super) fn beyond(
        &self,
        next: &Self,
        way: f64,
        arm: &Arm,
        near: &Joints,
    ) -> Result<[Joints; 2], Violation> {
        let joints = |tool: Frame| arm.inverse(&self.flange.when_tool_at(tool), near);
        Ok([joints(self.tool(self.length + way))?, joints(next.tool(way))?])
    }

    /// Whether neither place nor orientation changes.
    #[must_use]
    pub fn is_a_point(&self) -> bool {
        self.length == 0.0
    }

    /// The tool in the root at the end.
    #[must_use]
    pub const fn end(&self) -> &Frame {
        &self.to
    }

    /// How the flange follows from the tool.
    #[must_use]
    #[inline]
    pub const fn flange(&self) -> &Flange {
        &self.flange
    }
}

impl AxisLine {
    /// From joints to joints.
    #[must_use]
    pub const fn new(from: Joints, to: Joints) -> Self {
        Self { from, to }
    }

    /// The joints after a share of the way.
    #[must_use]
    #[inline]
    pub fn joints(&self, share: f64) -> Joints {
        core::array::from_fn(|i| self.from[i] + share * (self.to[i] - self.from[i]))
    }

    /// The whole way of each joint.
    #[must_use]
    #[inline]
    pub fn way(&self) -> Joints {
        core::array::from_fn(|i| self.to[i] - self.from[i])
    }
}

impl Curve {
    /// Length in the curve's own unit: mm on a line, 1 point to point, 0 where nothing moves.
    #[must_use]
    #[inline]
    pub fn length(&self) -> f64 {
        match self {
            Self::Line(line) => line.length,
            Self::Arc(arc) => arc.length(),
            Self::Spline(spline) => spline.length(),
            Self::Axes(axes) => {
                if axes.way().iter().any(|way| way.abs() > 1e-6) {
                    1.0
                } else {
                    0.0
                }
            }
        }
    }

    /// The joints after `way`, in the configuration of `near`, a point of the curve close by.
    #[inline]
    pub fn joints(&self, way: f64, arm: &Arm, near: &Joints) -> Result<Joints, Violation> {
        let (tool, flange) = match self {
            Self::Line(line) => (line.tool(way), &line.flange),
            Self::Arc(arc) => (arc.tool(way), arc.flange()),
            Self::Spline(spline) => (spline.tool(way), spline.flange()),
            Self::Axes(axes) => return Ok(axes.joints(way)),
        };
        arm.follow(&flange.when_tool_at(tool), near)
    }

    /// How the flange follows from the tool; none point to point.
    #[must_use]
    #[inline]
    pub const fn flange(&self) -> Option<&Flange> {
        match self {
            Self::Line(line) => Some(&line.flange),
            Self::Arc(arc) => Some(arc.flange()),
            Self::Spline(spline) => Some(spline.flange()),
            Self::Axes(_) => None,
        }
    }

    /// The tool in the root after each of some ways, and how the flange follows from it; none point to point, where only the
    /// joints are given.
    pub(super) fn tools<const N: usize>(&self, ways: &[f64; N]) -> Option<([Frame; N], &Flange)> {
        let tools = match self {
            Self::Line(line) => ways.map(|way| line.tool(way)),
            Self::Arc(arc) => ways.map(|way| arc.tool(way)),
            Self::Spline(spline) => spline.tools(ways),
            Self::Axes(_) => return None,
        };
        self.flange().map(|flange| (tools, flange))
    }

    /// The tool in the root at the end; none point to point.
    pub(super) const fn end_tool(&self) -> Option<&Frame> {
        match self {
            Self::Line(line) => Some(line.end()),
            Self::Arc(arc) => Some(arc.to()),
            Self::Spline(spline) => Some(spline.to()),
            Self::Axes(_) => None,
        }
    }

    /// Returns by how many degrees the tool turns from start to target, by the shorter way; 0 point to point.
    #[must_use]
    pub fn turn_deg(&self) -> f64 {
        match self {
            Self::Line(line) => line.angle,
            Self::Arc(arc) => arc.turn_deg(),
            Self::Spline(spline) => spline.from().rotation.turn_to(spline.to().rotation),
            Self::Axes(_) => 0.0,
        }
    }

    /// Where the tool is in the root after `way`, without its orientation; none point to point.
    #[must_use]
    pub fn position(&self, way: f64) -> Option<[f64; 3]> {
        match self {
            Self::Line(line) => Some(line.position(way)),
            Self::Arc(arc) => Some(arc.position(way)),
            Self::Spline(spline) => Some(spline.position(way)),
            Self::Axes(_) => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(from: [f64; 6], to: [f64; 6]) -> Line {
        Line::new(Frame::from_mm_deg(from), Frame::from_mm_deg(to), Flange::of_tool(&Frame::IDENTITY))
    }

    /// A line of 100 mm along x, and one behind it that is so long, ends beside it and turns the tool.
    fn lines(long: f64, beside: f64, turn: f64) -> [Line; 2] {
        let middle = [100.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        [line([0.0; 6], middle), line(middle, [100.0 + long, beside, 0.0, turn, 0.0, 0.0])]
    }

    #[test]
    fn a_line_goes_on_while_neither_its_direction_nor_its_turn_changes_by_more_than_rounding() {
        // The shorter the next one, the more its direction may be off by rounding, but only so much.
        for (long, most) in
            [(400.0, 1e-6), (50.0, 2e-6), (4.0, 2.5e-5), (2.5, 4e-5), (1.0, 5e-5), (0.1, 5e-5)]
        {
            let goes_on = |beside: f64, turn: f64| {
                let [one, next] = lines(long, beside, turn);
                one.goes_on_to(&next)
            };
            assert!(goes_on(0.0, 0.0), "{long} mm");
            assert!(
                goes_on(0.95 * most * long, 0.0) && !goes_on(1.05 * most * long, 0.0),
                "a kink at {long} mm"
            );
            assert!(
                goes_on(0.0, 0.95 * most * long) && !goes_on(0.0, 1.05 * most * long),
                "a turn at {long} mm"
            );
        }
        let [one, next] = lines(5e-4, 0.0, 0.0);
        assert!(!one.goes_on_to(&next), "it is too short to have a direction");
        let turned = [100.0, 0.0, 0.0, 20.0, 0.0, 0.0];
        let (one, next) = (line([0.0; 6], turned), line(turned, [150.0, 0.0, 0.0, 30.0, 0.0, 0.0]));
        assert!(one.goes_on_to(&next), "both turn as fast");
        let other =
            Line { flange: Flange::of_tool(&Frame::from_mm_deg([0.0, 0.0, 5.0, 0.0, 0.0, 0.0])), ..next };
        assert!(!one.goes_on_to(&other), "another tool");
    }

    #[test]
    fn a_tool_that_only_turns_has_degrees_for_millimetres_and_one_that_does_neither_is_a_point() {
        let turned = line([0.0; 6], [0.0, 0.0, 0.0, 30.0, 0.0, 0.0]);
        assert!((turned.length - 30.0).abs() < 1e-9 && !turned.is_a_point());
        assert!((line([0.0; 6], [9e-4, 0.0, 0.0, 30.0, 0.0, 0.0]).length - 30.0).abs() < 1e-9);
        assert!((line([0.0; 6], [2e-3, 0.0, 0.0, 30.0, 0.0, 0.0]).length - 2e-3).abs() < 1e-9);
        assert!(line([0.0; 6], [9e-4, 0.0, 0.0, 5e-4, 0.0, 0.0]).is_a_point());
        assert!(!line([0.0; 6], [0.0, 0.0, 0.0, 2e-3, 0.0, 0.0]).is_a_point());
    }

    #[test]
    fn each_curve_tells_where_it_ends_and_how_far_the_tool_turns() {
        let [from, through, to] =
            [[0.0; 6], [5.0, 5.0, 0.0, 0.0, 0.0, 0.0], [10.0, 0.0, 0.0, 40.0, 0.0, 0.0]]
                .map(Frame::from_mm_deg);
        let flange = Flange::of_tool(&Frame::IDENTITY);
        let curves = [
            Curve::Line(Line::new(from, to, flange)),
            Curve::Arc(Arc::new(from, through.position, to, flange).expect("a circle")),
            Curve::Spline(Spline::new(from, to, flange)),
        ];
        for curve in curves {
            assert_eq!(curve.end_tool(), Some(&to));
            assert!((curve.turn_deg() - 40.0).abs() < 1e-9, "{}", curve.turn_deg());
            let end = curve.position(curve.length()).expect("the tool is led");
            assert!(distance(end, to.position) < 1e-9, "{end:?}");
        }
        let axes = Curve::Axes(AxisLine::new([0.0; 6], [10.0; 6]));
        assert_eq!((axes.end_tool(), axes.turn_deg(), axes.position(0.5)), (None, 0.0, None));
    }
}
