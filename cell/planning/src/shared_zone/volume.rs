//! The volume of an arm in the cell, and the shared zones that it is in.

use std::fmt;

use arm::motion::curve::AxisLine;
use arm::{Arm, Frame, Installation, Joints, MOST_POINTS};
use setup::{Cell, SharedZone, Station};

use crate::geometry::{Cuboid, Point};

/// Most shared zones of a cell: a [`ZoneSet`] has a bit for each.
pub const MOST_ZONES: usize = 32;

/// Most tools whose tips are followed: the numbers that a motion can carry.
const MOST_TOOLS: usize = 16;

/// Largest change of a joint between two places of a way, in degrees (mm).
const STEP: f64 = 0.5;

/// Most places of a way.
const MOST_STEPS: f64 = 2_000.0;

/// Error of a place by rounding on the wire and in the image, in mm.
const ROUNDING_MM: f64 = 0.1;

/// Largest ratio of the way between two neighbouring places to the straight line.
const BENT: f64 = 1.02;

/// Most cuts of a link until its distance from a box is known.
const CUTS: u32 = 48;

/// A set of shared zones, by their numbers in the setup, from 0.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Debug)]
pub struct ZoneSet(u32);

impl ZoneSet {
    /// No zone.
    pub const NONE: Self = Self(0);
    /// Every zone.
    pub const ALL: Self = Self(u32::MAX);

    /// Returns the set of one zone; empty for a number that no zone has.
    #[must_use]
    pub fn of(zone: usize) -> Self {
        u32::try_from(zone).ok().and_then(|zone| 1_u32.checked_shl(zone)).map_or(Self::NONE, Self)
    }

    /// Returns whether it contains a zone.
    #[must_use]
    pub fn contains(self, zone: usize) -> bool {
        self.meets(Self::of(zone))
    }

    /// Returns whether both have a zone in common.
    #[must_use]
    pub const fn meets(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }

    /// Returns whether it has no zone.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Returns the zones of both.
    #[must_use]
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Returns its zones that the other one does not have.
    #[must_use]
    pub const fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// Returns the numbers of its zones, in ascending order.
    pub fn zones(self) -> impl Iterator<Item = usize> {
        (0..MOST_ZONES).filter(move |zone| self.contains(*zone))
    }
}

/// The points of an arm in the cell: a body lies between each and the next one of the chain, and from the flange to each tip.
#[derive(Clone, Copy)]
struct Bodies {
    points: [Point; MOST_POINTS + MOST_TOOLS],
    chain: usize,
    count: usize,
}

impl Bodies {
    fn points(&self) -> &[Point] {
        self.points.get(..self.count).unwrap_or_default()
    }

    /// Returns the axes of the capsules.
    fn axes(&self) -> impl Iterator<Item = [Point; 2]> {
        let (chain, tips) = self.points().split_at(self.chain.min(self.count));
        let links = chain.iter().zip(chain.iter().skip(1)).map(|(from, to)| [*from, *to]);
        links.chain(tips.iter().filter_map(|tip| Some([*chain.last()?, *tip])))
    }

    /// Returns how far its points are from those of another place of the arm, at most.
    fn farthest_from(&self, other: &Self) -> f64 {
        let apart = self.points().iter().zip(other.points()).map(|(one, other)| (*one - *other).length());
        apart.fold(0.0, f64::max)
    }
}

/// The volume of an arm: capsules about the lines from joint to joint and to the tips of its tools, and the shared zones of the
/// cell that it may be in.
#[derive(Clone)]
pub struct ArmVolume {
    arm: Arm,
    /// Place of its root in the cell.
    root: Frame,
    /// Tools from the flange.
    tools: Vec<Frame>,
    radius_mm: f64,
    zones: Vec<Cuboid>,
}

impl fmt::Debug for ArmVolume {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ArmVolume")
            .field("radius_mm", &self.radius_mm)
            .field("zones", &self.zones)
            .finish_non_exhaustive()
    }
}

impl ArmVolume {
    /// Creates the volume of the arm of a station with the tools of these numbers; `None` if its setup describes no arm. An arm whose
    /// setup gives no radius counts as a line.
    #[must_use]
    pub fn new(cell: &Cell, station: &Station, tools: &[u8]) -> Option<Self> {
        let Installation { arm, tools: listed, .. } =
            Installation::from_setup(&cell.setup_of(station)).ok()?;
        let tools = tools.iter().filter_map(|number| listed.get(usize::from(*number)).copied().flatten());
        Some(Self {
            arm,
            root: Frame::from_mm_deg(station.root_mm_deg.value),
            tools: tools.take(MOST_TOOLS).collect(),
            radius_mm: station.robot.link_radius_mm.as_ref().map_or(0.0, |radius| radius.value),
            zones: cell.shared_zones.iter().map(space).take(MOST_ZONES).collect(),
        })
    }

    /// Returns the number of zones of the cell.
    #[must_use]
    pub fn zones(&self) -> usize {
        self.zones.len()
    }

    /// Returns the arm.
    pub(crate) const fn arm(&self) -> &Arm {
        &self.arm
    }

    /// Returns the zones that the arm is in with these joints.
    #[must_use]
    pub fn at(&self, joints: &Joints) -> ZoneSet {
        self.touched(&self.bodies(joints), ROUNDING_MM)
    }

    /// Returns the zones that the arm comes into while its joints travel evenly from one position to another.
    #[must_use]
    pub fn between(&self, from: &Joints, to: &Joints) -> ZoneSet {
        let line = AxisLine::new(*from, *to);
        let largest = from.iter().zip(to).map(|(from, to)| (to - from).abs()).fold(0.0, f64::max);
        let steps = (largest / STEP).ceil().clamp(1.0, MOST_STEPS);
        self.along((0..=steps as u32).map(|step| Some(line.joints(f64::from(step) / steps))))
    }

    /// Returns the zones that the arm comes into on a way through these positions, which lie close to each other. Where one of
    /// them is not known, that is every zone.
    pub(crate) fn along(&self, way: impl Iterator<Item = Option<Joints>>) -> ZoneSet {
        let (mut zones, mut before) = (ZoneSet::NONE, None::<Bodies>);
        for joints in way {
            let Some(joints) = joints else { return ZoneSet::ALL };
            let bodies = self.bodies(&joints);
            // Whatever is between two places is near one of them.
            let reserve = before.map_or(0.0, |before| BENT * before.farthest_from(&bodies) / 2.0);
            zones = zones.with(self.touched(&bodies, ROUNDING_MM + reserve));
            if let Some(before) = before.filter(|_| reserve > 0.0) {
                zones = zones.with(self.touched(&before, ROUNDING_MM + reserve));
            }
            before = Some(bodies);
        }
        zones
    }

    /// Returns the distance between this arm and another one in these joints, in mm; negative where they would be in each other.
    pub(crate) fn distance_mm(&self, joints: &Joints, other: &Self, others: &Joints) -> f64 {
        let (one, two) = (self.bodies(joints), other.bodies(others));
        let pairs = one.axes().flat_map(|one| two.axes().map(move |two| between_segments(one, two)));
        pairs.fold(f64::INFINITY, f64::min) - self.radius_mm - other.radius_mm
    }

    fn bodies(&self, joints: &Joints) -> Bodies {
        let (skeleton, flange) = (self.arm.skeleton(joints), self.arm.forward(joints));
        let in_cell = |point: [f64; 3]| Point::from(self.root.point(point));
        let mut bodies = Bodies {
            points: [Point::default(); MOST_POINTS + MOST_TOOLS],
            chain: skeleton.points().len(),
            count: 0,
        };
        let tips = self.tools.iter().map(|tool| flange.origin_of(tool));
        let points = skeleton.points().iter().copied().chain(tips);
        for (place, point) in bodies.points.iter_mut().zip(points) {
            *place = in_cell(point);
            bodies.count += 1;
        }
        bodies
    }

    fn touched(&self, bodies: &Bodies, reserve_mm: f64) -> ZoneSet {
        let limit = self.radius_mm + reserve_mm;
        let is_in = |zone: &Cuboid| bodies.axes().any(|[from, to]| is_nearer(zone, from, to, limit));
        let zones = self.zones.iter().enumerate().filter(|(_, zone)| is_in(zone));
        zones.fold(ZoneSet::NONE, |set, (number, _)| set.with(ZoneSet::of(number)))
    }
}

fn space(zone: &SharedZone) -> Cuboid {
    let lower = Point::from(zone.corner_mm.value);
    Cuboid { lower, upper: lower + Point::from(zone.size_mm.value) }
}

/// Returns whether a line comes nearer to a box than `limit_mm`, or as near. The distance along a line is convex, and changes by no
/// more than the way.
fn is_nearer(zone: &Cuboid, from: Point, to: Point, limit_mm: f64) -> bool {
    let length = (to - from).length();
    let gap = |share: f64| zone.distance_mm(from.toward(to, share)) - limit_mm;
    let (mut begin, mut end) = (0.0, 1.0);
    for _ in 0..CUTS {
        let middle = gap(f64::midpoint(begin, end));
        if middle <= 0.0 {
            return true;
        }
        if middle > length * (end - begin) / 2.0 {
            return false;
        }
        let third = (end - begin) / 3.0;
        let (one, other) = (begin + third, end - third);
        if gap(one) <= gap(other) { end = other } else { begin = one }
    }
    // Nothing of the line is left between the cuts that could be farther in.
    true
}

/// Returns the distance between two lines, in mm.
fn between_segments([a, b]: [Point; 2], [c, d]: [Point; 2]) -> f64 {
    // Convex in both shares: the nearest point of the other line, from each of thirds.
    let from_second = |share: f64| {
        let (at, way) = (c.toward(d, share), b - a);
        let square = way.dot(way);
        let on_first = if square > 0.0 { ((at - a).dot(way) / square).clamp(0.0, 1.0) } else { 0.0 };
        (at - a.toward(b, on_first)).length()
    };
    let (mut begin, mut end) = (0.0, 1.0);
    for _ in 0..CUTS {
        let third = (end - begin) / 3.0;
        let (one, other) = (begin + third, end - third);
        if from_second(one) <= from_second(other) { end = other } else { begin = one }
    }
    from_second(f64::midpoint(begin, end)).min(from_second(0.0)).min(from_second(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = Point> {
        prop::array::uniform3(-300.0..300.0_f64).prop_map(Point::from)
    }

    proptest! {
        #[test]
        fn a_line_is_nearer_to_a_box_where_one_of_its_points_is(
            from in point(), to in point(), lower in point(),
            size in prop::array::uniform3(1.0..200.0_f64),
            limit in 0.0..80.0_f64,
        ) {
            let zone = Cuboid { lower, upper: lower + size.into() };
            let nearest = (0..=2_000)
                .map(|step| zone.distance_mm(from.toward(to, f64::from(step) / 2_000.0)))
                .fold(f64::INFINITY, f64::min);
            // Between two of the points the distance falls by half of their distance at most.
            let missed = (to - from).length() / 4_000.0;
            let found = is_nearer(&zone, from, to, limit);
            prop_assert!(!found || nearest <= limit + missed + 1e-6, "{nearest} {limit}");
            prop_assert!(found || nearest >= limit - 1e-6, "{nearest} {limit}");
        }

        #[test]
        fn two_lines_are_as_far_apart_as_their_nearest_points(
            a in point(), b in point(), c in point(), d in point(),
        ) {
            let mut nearest = f64::INFINITY;
            for one in 0..=100 {
                for other in 0..=100 {
                    let apart = a.toward(b, f64::from(one) / 100.0) - c.toward(d, f64::from(other) / 100.0);
                    nearest = nearest.min(apart.length());
                }
            }
            let found = between_segments([a, b], [c, d]);
            prop_assert!(found <= nearest + 1e-6 && found > nearest - 12.0, "{found} {nearest}");
        }
    }

    #[test]
    fn a_set_has_the_zones_that_were_put_into_it() {
        let set = ZoneSet::of(0).with(ZoneSet::of(31)).with(ZoneSet::of(32));
        assert_eq!(set.zones().collect::<Vec<_>>(), [0, 31]);
        assert!(set.contains(31) && !set.contains(32) && ZoneSet::ALL.meets(set));
        assert!(set.without(set).is_empty());
    }
}
