//! Which motions of a plan go into which shared zone, found by following them as the arm does.

use arm::motion::{Blend, Curve, Robot, Segment};
use arm::{Installation, Joints};
use setup::Setup;

use super::volume::{ArmVolume, ZoneSet};
use crate::motion::Motion;
use crate::plan::{Plan, ZoneVisit};
use crate::reach::{Reached, robot_of};

/// Length of the steps in which a path is followed, in mm, and the least and the most of them.
const STEP_MM: f64 = 2.0;
const STEPS: [f64; 2] = [64.0, 2_000.0];

/// Steps in which a corner is followed, and the shares of its size in which the robot may round it: whole ones, and smaller ones
/// where the next motion comes late.
const CORNER_STEPS: u32 = 24;
const CORNER_SHARES: [f64; 4] = [1.0, 0.75, 0.5, 0.25];

/// The data of a station that a PLC needs for the shared zones of its cell, besides the visits of its plan.
#[derive(Clone, Debug)]
pub struct StationZones {
    /// Volume of its arm in the cell.
    pub volume: ArmVolume,
    /// Joints at the start of its application.
    pub start: Joints,
    /// The zones on its way from the end of the application to the start.
    pub from_end: ZoneSet,
}

/// Finds the visits of a plan, ordered by their motions, and the zones on the way from its end to its start.
pub(crate) fn find(
    volume: &ArmVolume,
    plan: &Plan,
    reached: &Reached,
    setup: &Setup,
) -> (Vec<ZoneVisit>, ZoneSet) {
    let Ok(installation) = Installation::from_setup(setup) else { return (Vec::new(), ZoneSet::ALL) };
    let follower = Follower::new(volume, setup, &installation);
    let zones = follower.zones(&plan.motions, &reached.start, &reached.targets);
    let end = reached.targets.last().unwrap_or(&reached.start);
    let back = follower.zones(&plan.to_start.from_end, end, &reached.back);
    let from_end = back.into_iter().fold(ZoneSet::NONE, ZoneSet::with);
    (visits(&zones, volume.zones()), from_end)
}

/// Gathers motions in a row that are in one zone to a visit.
fn visits(of_motions: &[ZoneSet], zones: usize) -> Vec<ZoneVisit> {
    let mut visits = Vec::new();
    for zone in 0..zones {
        let mut begun = None;
        for (index, set) in of_motions.iter().chain([&ZoneSet::NONE]).enumerate() {
            match (set.contains(zone), begun) {
                (true, None) => begun = Some(index),
                (false, Some(after)) => {
                    visits.push(ZoneVisit { zone, after, until: index });
                    begun = None;
                }
                _ => {}
            }
        }
    }
    visits.sort_by_key(|visit| (visit.after, visit.zone));
    visits
}

/// Follows motions with an arm.
struct Follower<'a> {
    volume: &'a ArmVolume,
    setup: &'a Setup,
    robot: Robot<'a>,
}

impl<'a> Follower<'a> {
    fn new(volume: &'a ArmVolume, setup: &'a Setup, installation: &'a Installation) -> Self {
        let robot = Robot { arm: volume.arm(), ..robot_of(setup, installation) };
        Self { volume, setup, robot }
    }

    /// Returns the zones of each motion from its exact start to its exact end, and with its corners.
    fn zones(&self, motions: &[Motion], start: &Joints, targets: &[Joints]) -> Vec<ZoneSet> {
        let mut zones = vec![ZoneSet::NONE; motions.len()];
        let starts = [start].into_iter().chain(targets);
        let mut before: Option<Segment> = None;
        for (index, (motion, from)) in motions.iter().zip(starts).enumerate() {
            let wire = motion.wire(self.setup);
            let Ok(alone) = Segment::prepare(&wire, from, self.robot) else {
                return vec![ZoneSet::ALL; motions.len()];
            };
            let mut own = self.of_segment(&alone, from);
            let mut on_path = alone;
            if let Some(last) = &before {
                if let Ok(bent) = Segment::prepare_after(Some(last), &wire, from, self.robot)
                    && bent.curve != on_path.curve
                {
                    own = own.with(self.of_segment(&bent, from));
                    on_path = bent;
                }
                let corner = self.of_corner(last, &on_path);
                own = own.with(corner);
                if let Some(earlier) = index.checked_sub(1).and_then(|earlier| zones.get_mut(earlier)) {
                    *earlier = earlier.with(corner).with(self.of_bend(last, &on_path, index, start, targets));
                }
            }
            if let Some(place) = zones.get_mut(index) {
                *place = place.with(own);
            }
            before = (wire.approximation > 0).then_some(on_path);
        }
        zones
    }

    fn of_segment(&self, segment: &Segment, from: &Joints) -> ZoneSet {
        if let Curve::Axes(line) = &segment.curve {
            return self.volume.between(&line.joints(0.0), &line.joints(1.0));
        }
        let length = segment.curve.length();
        let steps = (length / STEP_MM).ceil().clamp(STEPS[0], STEPS[1]);
        let mut near = *from;
        self.volume.along((0..=steps as u32).map(|step| {
            let joints = segment.curve.joints(f64::from(step) / steps * length, self.robot.arm, &near).ok();
            near = joints.unwrap_or(near);
            joints
        }))
    }

    /// Returns the zones of the corner between two motions, however small the robot rounds it.
    fn of_corner(&self, first: &Segment, second: &Segment) -> ZoneSet {
        let arm = self.robot.arm;
        let corners = CORNER_SHARES.iter().filter_map(|share| Blend::between(first, second, *share, arm));
        corners.fold(ZoneSet::NONE, |zones, corner| {
            let mut near = first.end;
            zones.with(self.volume.along((0..=CORNER_STEPS).map(|step| {
                let share = f64::from(step) / f64::from(CORNER_STEPS);
                let joints = corner.joints(first, second, share, arm, &near).ok();
                near = joints.unwrap_or(near);
                joints
            })))
        })
    }

    /// Returns the zones of a motion of a spline that its successor, motion `index`, bends.
    fn of_bend(
        &self,
        last: &Segment,
        next: &Segment,
        index: usize,
        start: &Joints,
        targets: &[Joints],
    ) -> ZoneSet {
        let (Curve::Spline(first), Curve::Spline(second)) = (&last.curve, &next.curve) else {
            return ZoneSet::NONE;
        };
        let from = index.checked_sub(2).and_then(|earlier| targets.get(earlier)).unwrap_or(start);
        let shape = first.with_neighbours(first.before(), Some(*second.to()));
        let bent = last.reshaped(shape, from, self.robot.arm);
        bent.map_or(ZoneSet::NONE, |bent| self.of_segment(&bent, from))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motions_in_a_row_are_one_visit_and_a_zone_that_was_left_is_visited_again() {
        let both = ZoneSet::of(0).with(ZoneSet::of(1));
        let of_motions = [ZoneSet::NONE, ZoneSet::of(1), both, ZoneSet::NONE, ZoneSet::of(0)];
        let visit = |zone, after, until| ZoneVisit { zone, after, until };
        assert_eq!(visits(&of_motions, 2), [visit(1, 1, 3), visit(0, 2, 3), visit(0, 4, 5)]);
    }
}
