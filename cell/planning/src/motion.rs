//! A planned motion and its geometry.

use protocol::image::{Configuration, MotionKind, PathForm};

use crate::application::Place;
use crate::geometry::{Point, Pose};
use crate::refusal::{LEAST_MM, Refusal};

/// What a motion is for.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Role {
    /// Part of a process step's path (step I).
    Path,
    /// The linear pre-movement of a path (step II).
    PreMovement,
    /// The linear post-movement of a path (step II).
    PostMovement,
    /// A secondary motion to where the next path or its pre-movement begins (step III).
    Way,
    /// A secondary motion to an intermediate position over an obstacle (step III).
    Crossing,
    /// A motion to where the tool stands before the first step: no part of the sequence.
    ToStart,
}

impl Role {
    /// Returns the step of the paper's section 4 that makes such motions; empty for a motion that is not part of the
    /// sequence.
    #[must_use]
    pub const fn step(self) -> &'static str {
        match self {
            Self::Path => "I",
            Self::PreMovement | Self::PostMovement => "II",
            Self::Way | Self::Crossing => "III",
            Self::ToStart => "",
        }
    }

    /// Returns whether it is a secondary motion, which may take any free path.
    #[must_use]
    pub const fn is_secondary(self) -> bool {
        matches!(self, Self::Way | Self::Crossing | Self::ToStart)
    }
}

/// One planned motion.
#[derive(Clone, PartialEq, Debug)]
pub struct Motion {
    /// Its name: its kind and its step.
    pub name: String,
    /// Index of its step.
    pub step: usize,
    /// What it is for.
    pub role: Role,
    /// Its kind: how it moves to its target.
    pub kind: MotionKind,
    /// Whether its label is *accurate path*.
    pub accurate_path: bool,
    /// Where it begins.
    pub start: Pose,
    /// Where it ends.
    pub target: Pose,
    /// Its target as joints in degrees (mm), for [`MotionKind::PtpJoint`].
    pub joints_deg: Option<[f64; 6]>,
    /// The configuration in which the arm reaches its target; none as near as possible to where it comes from.
    pub configuration: Option<Configuration>,
    /// The intermediate point in mm of a circle, or the force in N; zero otherwise.
    pub auxiliary: [f64; 3],
    /// The points before the start and after the target of a spline, if the motion continues through them: they bend it.
    pub spline_neighbours: [Option<Point>; 2],
    /// Length of its path in mm; for a PTP and a spline, of the straight line.
    pub length_mm: f64,
    /// How far the tool turns, in degrees.
    pub turn_deg: f64,
    /// The direction in which it leaves its start; unknown for a PTP and a spline, whose course the robot determines.
    pub leaves: Option<Point>,
    /// The direction in which it arrives; unknown for a PTP and a spline.
    pub arrives: Option<Point>,
    /// Highest speed in mm/s that its step allows.
    pub speed_mm_s: Option<f64>,
    /// Share of the setup's programmed speed, in %.
    pub speed_percent: f64,
    /// Approximation distance in mm: how far from the target it may leave its path for the next one. 0 stops exactly.
    pub zone_mm: f64,
    /// Tool frame.
    pub tool: u8,
    /// Base frame.
    pub base: u8,
}

/// Configuration of the arm at the target of a PTP; any, if none is given.
#[derive(Clone, Copy, Default, Debug)]
pub(crate) struct Arrival {
    pub(crate) joints_deg: Option<[f64; 6]>,
    pub(crate) configuration: Option<Configuration>,
}

impl Arrival {
    /// Returns what is known of the arm after a motion: what that asked for, or else the configuration of before, which a motion
    /// keeps.
    pub(crate) const fn then(self, motion: &Motion) -> Self {
        let Motion { joints_deg, configuration, .. } = *motion;
        match (joints_deg, configuration) {
            (None, None) => Self { joints_deg: None, ..self },
            _ => Self { joints_deg, configuration },
        }
    }

    /// Returns whether an arm of which this is known may have to move for what is wanted at the same pose.
    pub(crate) fn may_differ_from(self, wanted: Self) -> bool {
        let is_other = |wanted: Configuration| match self.configuration {
            Some(known) => {
                known.status != wanted.status || (wanted.turn.is_some() && known.turn != wanted.turn)
            }
            None => true,
        };
        let joints = self.joints_deg.zip(wanted.joints_deg);
        joints.is_some_and(|(known, wanted)| known != wanted) || wanted.configuration.is_some_and(is_other)
    }
}

impl From<&Place> for Arrival {
    fn from(place: &Place) -> Self {
        Self { joints_deg: place.joints_deg, configuration: place.configuration }
    }
}

impl Motion {
    /// Creates a motion along a straight line, of any kind but a circle.
    pub(crate) fn straight(role: Role, kind: MotionKind, start: Pose, target: Pose) -> Self {
        let way = target.point - start.point;
        let known = kind.path() == Some(PathForm::Line);
        let direction = if known { way.direction() } else { None };
        Self {
            name: String::new(),
            step: 0,
            role,
            kind,
            accurate_path: false,
            start,
            target,
            joints_deg: None,
            configuration: None,
            auxiliary: [0.0; 3],
            spline_neighbours: [None; 2],
            length_mm: way.length(),
            turn_deg: start.turn_deg(target),
            leaves: direction,
            arrives: direction,
            speed_mm_s: None,
            speed_percent: 100.0,
            zone_mm: 0.0,
            tool: 0,
            base: 0,
        }
    }

    /// Creates a PTP; to the joints of the target's frame, if the frame has them.
    pub(crate) fn point_to_point(role: Role, start: Pose, target: Pose, arrival: Arrival) -> Self {
        let Arrival { joints_deg, configuration } = arrival;
        let kind = if joints_deg.is_some() { MotionKind::PtpJoint } else { MotionKind::PtpCartesian };
        Self { joints_deg, configuration, ..Self::straight(role, kind, start, target) }
    }

    /// Creates a circle from the start through a point to the target.
    pub(crate) fn circle(role: Role, start: Pose, through: Point, target: Pose) -> Result<Self, Refusal> {
        let (to_end, to_through) = (target.point - start.point, through - start.point);
        let area = to_through.cross(to_end);
        let chord = to_end.length();
        let off_mm = if chord < LEAST_MM { 0.0 } else { area.length() / chord };
        let Some(normal) = area.direction().filter(|_| off_mm >= LEAST_MM) else {
            return Err(Refusal::Collinear { off_mm });
        };
        // The centre from the start, by the circumcircle of the triangle start, through, end.
        let square = 2.0 * area.dot(area);
        let centre = (to_end.cross(area) * to_through.dot(to_through)
            + area.cross(to_through) * to_end.dot(to_end))
            * (1.0 / square);
        let (to_start, to_target) = (Point::default() - centre, to_end - centre);
        // Along `normal` the circle turns from start through the intermediate point to the end.
        let along = |radius: Point| normal.cross(radius).direction();
        let mut swept = to_start.angle_deg(to_target);
        if to_start.cross(to_target).dot(normal) < 0.0 {
            swept = 360.0 - swept;
        }
        Ok(Self {
            auxiliary: through.coordinates(),
            length_mm: centre.length() * swept.to_radians(),
            leaves: along(to_start),
            arrives: along(to_target),
            ..Self::straight(role, MotionKind::Circular, start, target)
        })
    }

    /// Returns whether the tool goes straight without turning, so that a blend with another such motion in the same
    /// direction leaves neither path.
    pub(crate) fn keeps_straight(&self) -> bool {
        self.kind.path() == Some(PathForm::Line) && self.turn_deg < 1e-6
    }

    /// Returns the direction in which a pre-movement enters this path.
    pub(crate) fn first_direction(&self) -> Option<Point> {
        self.leaves.or_else(|| (self.target.point - self.start.point).direction())
    }

    /// Returns the direction in which a post-movement goes on from this path.
    pub(crate) fn last_direction(&self) -> Option<Point> {
        self.arrives.or_else(|| (self.target.point - self.start.point).direction())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f64, y: f64) -> Pose {
        Pose::new([x, y, 5.0, 0.0, 0.0, 180.0])
    }

    #[test]
    fn a_circle_knows_its_length_and_its_tangents_also_past_half_a_turn() {
        let half = Motion::circle(Role::Path, at(0.0, 0.0), at(10.0, 10.0).point, at(20.0, 0.0)).unwrap();
        assert!((half.length_mm - 10.0 * std::f64::consts::PI).abs() < 1e-9);
        assert!((half.leaves.unwrap() - Point::new(0.0, 1.0, 0.0)).length() < 1e-9);
        assert!((half.arrives.unwrap() - Point::new(0.0, -1.0, 0.0)).length() < 1e-9);

        let most = Motion::circle(Role::Path, at(0.0, 0.0), at(20.0, 0.0).point, at(10.0, -10.0)).unwrap();
        assert!((most.length_mm - 15.0 * std::f64::consts::PI).abs() < 1e-9, "{}", most.length_mm);
        assert!((most.arrives.unwrap() - Point::new(-1.0, 0.0, 0.0)).length() < 1e-9);
    }

    #[test]
    fn the_course_of_a_circle_lies_on_it_and_ends_at_its_target() {
        for (through, to) in [((10.0, 10.0), (20.0, 0.0)), ((20.0, 0.0), (10.0, -10.0))] {
            let circle =
                Motion::circle(Role::Path, at(0.0, 0.0), at(through.0, through.1).point, at(to.0, to.1))
                    .unwrap();
            let centre = at(10.0, 0.0).point;
            let legs = circle.legs();
            let is_on_it = |point: Point| ((point - centre).length() - 10.0).abs() < 1e-6;
            assert!(legs.iter().all(|leg| is_on_it(leg.from) && is_on_it(leg.to)), "{legs:?}");
            assert!((legs.last().unwrap().to - circle.target.point).length() < 1e-6);
        }
    }

    #[test]
    fn three_points_on_a_line_are_no_circle_and_neither_is_a_start_that_is_the_end() {
        let line = Motion::circle(Role::Path, at(0.0, 0.0), at(10.0, 0.001).point, at(20.0, 0.0));
        assert!(matches!(line, Err(Refusal::Collinear { off_mm }) if off_mm < 0.0011));
        let closed = Motion::circle(Role::Path, at(0.0, 0.0), at(10.0, 0.0).point, at(0.0, 0.0));
        assert_eq!(closed, Err(Refusal::Collinear { off_mm: 0.0 }));
    }
}
