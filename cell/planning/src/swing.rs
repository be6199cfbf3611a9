//! The course of the tool point to point, as the arm of a setup drives it.
//!
//! Ways are planned with a bound on how far a PTP leaves its chord, which the application states as `ptp_radius_mm`. Where
//! that is too large, or where axis 1 turns by more than half a turn, the tool leaves the chord farther. Here the joints say
//! where it goes: they travel evenly from start to target.

use arm::{Frame, Installation, Joints};
use setup::Setup;

use crate::application::{Application, Obstacle, Ways};
use crate::check::nearer_mm;
use crate::clearance::Leg;
use crate::geometry::Point;
use crate::motion::Motion;
use crate::out_of_reach::{SwingsTooNear, motion_in_words};
use crate::plan::Plan;
use crate::reach::{Reached, frame_of};
use crate::refusal::LEAST_MM;

/// Largest change of a joint between two points of a course, in degrees (mm). The tool of an arm of 1 m leaves the straight
/// line between them by about LEAST_MM.
const STEP: f64 = 0.5;

/// Largest number of points of a course.
const MOST_STEPS: f64 = 2_000.0;

/// Checks that every PTP of a plan keeps the clearance of the application from its obstacles, between the joints that the
/// arm has there.
///
/// # Errors
///
/// The first motion that comes nearer.
pub(crate) fn keep_clear(
    application: &Application,
    plan: &Plan,
    reached: &Reached,
    setup: &Setup,
) -> Result<(), SwingsTooNear> {
    // A setup that describes no arm reaches nothing.
    let (Some(ways), Ok(installation)) = (&application.ways, Installation::from_setup(setup)) else {
        return Ok(());
    };
    let ends = || reached.targets.iter().chain(&reached.back);
    let joints = std::iter::once(&reached.start).chain(ends()).zip(ends());
    let motions = plan.motions.iter().chain(&plan.to_start.from_end).enumerate();
    for ((index, motion), (from, to)) in motions.zip(joints) {
        if application.obstacles.is_empty() || !motion.kind.is_point_to_point() {
            continue;
        }
        let legs = legs(motion, [from, to], &installation);
        for obstacle in &application.obstacles {
            let Err(nearest_mm) = keeps_clear(&legs, obstacle, ways) else { continue };
            let number = if index < plan.motions.len() { index + 1 } else { 0 };
            return Err(SwingsTooNear {
                motion: motion_in_words(number, &motion.name),
                obstacle: obstacle.name.clone(),
                nearest_mm,
                clearance_mm: ways.clearance_mm,
                ptp_radius_mm: ways.ptp_radius_mm,
            });
        }
    }
    Ok(())
}

/// Returns the course of the tool between two positions of the joints, in the base of the motion.
fn legs(motion: &Motion, [from, to]: [&Joints; 2], installation: &Installation) -> Vec<Leg> {
    let Installation { arm, tools, bases, .. } = installation;
    let [tool, base] = [frame_of(tools, motion.tool), frame_of(bases, motion.base)]
        .map(|frame| frame.unwrap_or(Frame::IDENTITY));
    let into_base = base.inverse();
    let largest = from.iter().zip(to).map(|(from, to)| (to - from).abs()).fold(0.0, f64::max);
    let steps = (largest / STEP).ceil().clamp(1.0, MOST_STEPS);
    let at = |step: u32| {
        let share = f64::from(step) / steps;
        let joints: Joints = std::array::from_fn(|axis| from[axis] + share * (to[axis] - from[axis]));
        Point::from(into_base.point(arm.forward(&joints).origin_of(&tool)))
    };
    let points: Vec<Point> = (0..=steps as u32).map(at).collect();
    points.windows(2).filter_map(|pair| <[Point; 2]>::try_from(pair).ok()).map(Leg::straight).collect()
}

/// Checks that a course keeps the clearance from an obstacle, but for what the wire rounds; otherwise returns the least
/// distance of its points, in mm.
fn keeps_clear(legs: &[Leg], obstacle: &Obstacle, ways: &Ways) -> Result<(), f64> {
    let distance_mm = (ways.clearance_mm - LEAST_MM).max(0.0);
    if nearer_mm(legs, &obstacle.space, distance_mm, [0.0; 2]) <= LEAST_MM {
        return Ok(());
    }
    let distances = legs.iter().map(|leg| obstacle.space.distance_mm(leg.to));
    Err(distances.fold(f64::INFINITY, f64::min))
}
