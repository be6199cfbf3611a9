//! Steps I and II: the motions of a path from its process frames, and its linear pre- and post-movement.

use protocol::image::MotionKind;

use crate::application::{Application, Place, Segment, Step};
use crate::geometry::{Point, Pose};
use crate::motion::{Motion, Role};
use crate::refusal::{LEAST_TURN_DEG, Refusal};
use crate::step_base::StepBase;

/// A path as far as it could be planned.
pub(crate) struct Path {
    /// Its motions, labelled as the step is.
    pub(crate) motions: Vec<Motion>,
    /// Why it ends early.
    pub(crate) refusal: Option<Refusal>,
}

impl Path {
    /// Plans step I: the motions of the segments, in this cell of the grids.
    pub(crate) fn plan(
        application: &Application,
        (step, base): (&Step, StepBase),
        start: Pose,
        segments: &[Segment],
        cell: usize,
    ) -> Self {
        let mut motions = Vec::with_capacity(segments.len());
        let refusal = segments
            .iter()
            .try_for_each(|segment| append((application, base), segment, start, cell, &mut motions))
            .err();
        for motion in &mut motions {
            motion.accurate_path = step.labels.accurate_path;
            motion.speed_mm_s = step.speed_mm_s;
        }
        for index in 1..motions.len() {
            if let Ok([one, next]) = motions.get_disjoint_mut([index - 1, index]) {
                one.bend_into(next);
            }
        }
        Self { motions, refusal }
    }

    /// Plans step II: the pre-movement straight into the path's first direction; `None` if its length is 0.
    pub(crate) fn pre_movement(&self, length_mm: f64) -> Result<Option<Motion>, Refusal> {
        let Some(first) = self.motions.first().filter(|_| length_mm > 0.0) else {
            return self.refusal.clone().filter(|_| length_mm > 0.0).map_or(Ok(None), Err);
        };
        let direction = first.first_direction().ok_or_else(|| no_direction(first, "approach_mm"))?;
        let start = first.start.at(first.start.point - direction * length_mm);
        Ok(Some(Motion::straight(Role::PreMovement, MotionKind::LinCartesian, start, first.start)))
    }

    /// Plans step II: the post-movement straight on in the path's last direction; after a force, whose line ends in
    /// contact, straight back.
    pub(crate) fn post_movement(&self, length_mm: f64) -> Result<Option<Motion>, Refusal> {
        let Some(last) = self.motions.last().filter(|_| length_mm > 0.0) else {
            return Ok(None);
        };
        let direction = last.last_direction().ok_or_else(|| no_direction(last, "retreat_mm"))?;
        let onwards = if last.kind.has_force() { -length_mm } else { length_mm };
        let target = last.target.at(last.target.point + direction * onwards);
        Ok(Some(Motion::straight(Role::PostMovement, MotionKind::LinCartesian, last.target, target)))
    }
}

fn no_direction(motion: &Motion, key: &'static str) -> Refusal {
    let length_mm = motion.length_mm;
    if motion.turn_deg < LEAST_TURN_DEG {
        Refusal::ZeroLength { length_mm }
    } else {
        Refusal::NoDirection { key, length_mm }
    }
}

/// Appends the motions of one segment, which begins where the last motion ends.
fn append(
    (application, base): (&Application, StepBase),
    segment: &Segment,
    start: Pose,
    cell: usize,
    motions: &mut Vec<Motion>,
) -> Result<(), Refusal> {
    let pose = |place: &Place| base.pose(application, place, cell);
    let from = motions.last().map_or(start, |last| last.target);
    match segment {
        Segment::Line(to) => {
            let line = Motion::straight(Role::Path, MotionKind::LinCartesian, from, pose(to));
            motions.push(Motion { configuration: to.configuration, ..line });
        }
        Segment::Circle { through, to } => {
            let (through, to) = (pose(through).point, pose(to));
            motions.push(Motion::circle(Role::Path, from, through, to)?);
        }
        Segment::Spline(places) => {
            let mut from = from;
            for place in places {
                let to = pose(place);
                let piece = Motion::straight(Role::Path, MotionKind::Spline, from, to);
                motions.push(Motion { configuration: place.configuration, ..piece });
                from = to;
            }
        }
        Segment::Press { to, force_n } => {
            let force = Point::from(*force_n).length();
            if !(force.is_finite() && force > 0.0) {
                return Err(Refusal::NoForce { force_n: *force_n });
            }
            let motion = Motion::straight(Role::Path, MotionKind::LinForceCartesian, from, pose(to));
            motions.push(Motion { auxiliary: base.direction(*force_n), ..motion });
        }
    }
    Ok(())
}
