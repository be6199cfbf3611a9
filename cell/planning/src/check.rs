//! Checks of a motion: its length, its speeds against the robot's, and obstacles.
//!
//! The motions of a path keep the application's clearance from every obstacle, as ways do, and half the approximation
//! distance more where a blend may cut a corner: not at an exact stop, and an accurate path has no blends. A path cannot come nearer to an obstacle
//! than this, so a thing that a tool must touch is not entered as an obstacle.

use protocol::image::PathForm;

use crate::clearance::Leg;
use crate::geometry::{Cuboid, Point};
use crate::motion::{Motion, Role};
use crate::planner::Planner;
use crate::refusal::{LEAST_MM, LEAST_TURN_DEG, Refusal};

impl Planner<'_> {
    /// Checks a motion, without what a way has kept free of obstacles already; `blends` are whether its start and its
    /// target may be blended.
    pub(crate) fn check(&self, motion: &Motion, blends: [bool; 2]) -> Result<(), Refusal> {
        // Joints and configuration can change where the tool stands.
        let asks_of_the_arm = motion.joints_deg.is_some() || motion.configuration.is_some();
        let may_stand = motion.kind.is_point_to_point() && asks_of_the_arm;
        if motion.length_mm < LEAST_MM && motion.turn_deg < LEAST_TURN_DEG && !may_stand {
            return Err(Refusal::ZeroLength { length_mm: motion.length_mm });
        }
        let may_turn_on_the_spot = match motion.kind.path() {
            Some(PathForm::Axes) => true,
            Some(PathForm::Line) => !motion.kind.has_force(),
            Some(PathForm::Circle | PathForm::Spline) | None => false,
        };
        let way_mm = (motion.target.point - motion.start.point).length();
        if way_mm < LEAST_MM && !may_turn_on_the_spot {
            return Err(Refusal::TurnOnTheSpot { way_mm });
        }
        self.check_speed(motion)?;
        self.not_enclosed(motion.target.point, &format!("the target of `{}`", motion.name))?;
        if motion.role.is_secondary() { Ok(()) } else { self.check_obstacles(motion, blends) }
    }

    /// Checks that a path keeps clear of the obstacles, as it is in a continuous motion and as a single skill.
    pub(crate) fn check_obstacles(&self, motion: &Motion, blends: [bool; 2]) -> Result<(), Refusal> {
        let Some(ways) = self.application.ways.filter(|_| !self.application.obstacles.is_empty()) else {
            return Ok(());
        };
        let legs = motion.legs();
        let zones_mm = self.zones_mm(motion, blends);
        // As a single skill every piece of a spline is a straight line.
        let alone = [motion.chord()];
        let courses = [&legs[..], if motion.kind.path() == Some(PathForm::Spline) { &alone } else { &[] }];
        for (obstacle, legs) in
            self.application.obstacles.iter().flat_map(|obstacle| courses.map(|legs| (obstacle, legs)))
        {
            let inside_mm = nearer_mm(legs, &obstacle.space, 0.0, [0.0; 2]);
            if inside_mm > LEAST_MM {
                return Err(Refusal::Through { obstacle: obstacle.name.clone(), inside_mm });
            }
            let near_mm = nearer_mm(legs, &obstacle.space, ways.clearance_mm, zones_mm);
            if near_mm > LEAST_MM {
                let clearance_mm = ways.clearance_mm;
                return Err(Refusal::PathTooNear { obstacle: obstacle.name.clone(), near_mm, clearance_mm });
            }
        }
        Ok(())
    }

    /// Returns the distances from a motion's start and from its target, in mm, within which blends may cut its corners.
    /// Where a pre- or post-movement goes straight on, nothing is cut.
    fn zones_mm(&self, motion: &Motion, [at_start, at_end]: [bool; 2]) -> [f64; 2] {
        let cuts = match motion.role {
            Role::PreMovement => [at_start, false],
            Role::PostMovement => [false, at_end],
            _ if motion.accurate_path => [false; 2],
            _ => [at_start, at_end],
        };
        cuts.map(|cuts| if cuts { self.sizes.approximation_mm } else { 0.0 })
    }

    fn check_speed(&self, motion: &Motion) -> Result<(), Refusal> {
        let within = |quantity, value: f64, highest: f64, unit| {
            let fits = value > 0.0 && value <= highest;
            if fits { Ok(()) } else { Err(Refusal::OutOfRange { quantity, value, highest, unit }) }
        };
        within("speed", motion.speed_percent, 100.0, "%")?;
        let robot = &self.setup.robot;
        if let Some(speed) = motion.speed_mm_s {
            within("speed", speed, robot.path_velocity_mm_s.value, "mm/s")?;
        }
        // A distance that the wire rounds to zero counts as zero.
        let wire = motion.wire(self.setup);
        let programmed = &self.setup.motions;
        if wire.velocity == 0 {
            within("setup's velocity_percent, in steps of the wire,", 0.0, 100.0, "%")?;
        }
        if wire.acceleration == 0 {
            within(
                "setup's acceleration_percent",
                programmed.acceleration_percent.value.min(0.0),
                100.0,
                "%",
            )?;
        }
        Ok(())
    }

    pub(crate) fn not_enclosed(&self, point: Point, target: &str) -> Result<(), Refusal> {
        for obstacle in &self.application.obstacles {
            let depth_mm = obstacle.space.depth_mm(point);
            if depth_mm > 0.0 {
                let obstacle = obstacle.name.clone();
                return Err(Refusal::Enclosed { target: target.to_owned(), obstacle, depth_mm });
            }
        }
        Ok(())
    }
}

/// Returns how much of a path, in mm, is nearer to the box than `distance_mm`. Within the zones at the ends of the path
/// the limit is half a zone more.
pub(crate) fn nearer_mm(legs: &[Leg], space: &Cuboid, distance_mm: f64, zones_mm: [f64; 2]) -> f64 {
    let lengths = || legs.iter().map(|leg| (leg.to - leg.from).length());
    let whole_mm: f64 = lengths().sum();
    let mut passed_mm = 0.0;
    let mut near_mm = 0.0;
    for (leg, length) in legs.iter().zip(lengths()) {
        if length == 0.0 {
            continue;
        }
        let share = |way_mm: f64| ((way_mm - passed_mm) / length).clamp(0.0, 1.0);
        let near = |distance, shares| leg.nearer(space, distance, shares).map_or(0.0, |(from, to)| to - from);
        let [first, last] = zones_mm;
        let at_start = near(distance_mm + first / 2.0, (0.0, share(first)));
        let at_end = near(distance_mm + last / 2.0, (share(whole_mm - last), 1.0));
        near_mm += near(distance_mm, (0.0, 1.0)).max(at_start).max(at_end) * length;
        passed_mm += length;
    }
    near_mm
}
