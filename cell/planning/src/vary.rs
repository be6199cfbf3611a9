//! The same application in another size, and the same plan in other pieces, for studies of their effect.

use std::ops::Range;

use protocol::image::MotionKind;

use crate::application::{Application, Course, Place, Segment};
use crate::geometry::Point;
use crate::motion::{Motion, Role};
use crate::plan::{Continuous, Plan};

impl Application {
    /// Returns the same application with every path `factor` times as long. The place of the tool at the start does not
    /// move; all other places move towards it or away from it. Orientations, joints and clearances stay as they are.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        let start = self.start.0.pose.point;
        let about = |point: Point| start + (point - start) * factor;
        let place = |place: &Place| Place { pose: place.pose.at(about(place.pose.point)), ..place.clone() };
        let segment = |segment: &Segment| match segment {
            Segment::Line(to) => Segment::Line(place(to)),
            Segment::Circle { through, to } => Segment::Circle { through: place(through), to: place(to) },
            Segment::Spline(places) => Segment::Spline(places.iter().map(place).collect()),
            Segment::Press { to, force_n } => Segment::Press { to: place(to), force_n: *force_n },
        };
        let mut scaled = self.clone();
        for step in &mut scaled.steps {
            step.course = match &step.course {
                Course::Reach(to) => Course::Reach(place(to)),
                Course::Follow { from, segments, approach_mm, retreat_mm } => Course::Follow {
                    from: from.as_ref().map(place),
                    segments: segments.iter().map(segment).collect(),
                    approach_mm: approach_mm * factor,
                    retreat_mm: retreat_mm * factor,
                },
            };
        }
        for grid in &mut scaled.grids {
            grid.pitch_mm = grid.pitch_mm.map(|pitch| pitch * factor);
        }
        for obstacle in &mut scaled.obstacles {
            let space = &mut obstacle.space;
            (space.lower, space.upper) = (about(space.lower), about(space.upper));
        }
        if let Some(ways) = &mut scaled.ways {
            // The ceiling is a height, and the heights of intermediate positions are multiples of the raster.
            ways.ceiling_mm = about(Point::new(start.x, start.y, ways.ceiling_mm)).z;
            ways.ptp_radius_mm *= factor;
        }
        scaled
    }
}

impl Plan {
    /// Returns the length of all motions in mm; of a PTP and a spline the straight line counts.
    #[must_use]
    pub fn length_mm(&self) -> f64 {
        self.motions.iter().map(|motion| motion.length_mm).sum()
    }

    /// Returns the same path in more motions: every straight motion becomes `pieces` motions of equal length, with zones
    /// between them of at most `approximation_mm` and half a piece. A LIN keeps its course; a PTP then follows its chord.
    /// Circles, splines and motions to named joints stay whole. The plan's reasons are left out, since they belong to the
    /// original motions.
    #[must_use]
    pub fn divided(&self, pieces: u32, approximation_mm: f64) -> Self {
        self.with_motions(|motion, into| {
            let is_straight = match motion.kind {
                MotionKind::LinCartesian => true,
                MotionKind::PtpCartesian => motion.joints_deg.is_none() && motion.turn_deg < 1e-6,
                MotionKind::PtpJoint | MotionKind::Circular | MotionKind::Spline => false,
                MotionKind::LinForceCartesian | MotionKind::None | MotionKind::Unknown(_) => false,
            };
            if !is_straight || pieces < 2 {
                return into.push(motion.clone());
            }
            let way = |piece: u32| {
                let share = f64::from(piece) / f64::from(pieces);
                motion.start.at(motion.start.point.toward(motion.target.point, share))
            };
            for piece in 1..=pieces {
                let last = piece == pieces;
                let straight = Motion::straight(motion.role, motion.kind, way(piece - 1), way(piece));
                let zone = if last { motion.zone_mm } else { approximation_mm };
                into.push(Motion {
                    name: format!("{} {piece}/{pieces}", motion.name),
                    target: if last { motion.target } else { straight.target },
                    zone_mm: zone.min(straight.length_mm / 2.0),
                    start: straight.start,
                    length_mm: straight.length_mm,
                    leaves: straight.leaves,
                    arrives: straight.arrives,
                    configuration: motion.configuration.filter(|_| last),
                    ..motion.clone()
                });
            }
        })
    }

    /// Returns the same path in fewer motions: a pre-movement and the line after it become one motion, and so do a line
    /// and its post-movement. The plan's reasons are left out, since they belong to the original motions.
    #[must_use]
    pub fn joined(&self) -> Self {
        self.with_motions(|motion, into| {
            let goes_on = |last: &&mut Motion| {
                let roles = (last.role, motion.role);
                matches!(roles, (Role::PreMovement, Role::Path) | (Role::Path, Role::PostMovement))
                    && last.step == motion.step
                    && last.keeps_straight()
                    && motion.keeps_straight()
                    && last.speed_mm_s == motion.speed_mm_s
                    && last.arrives.zip(motion.leaves).is_some_and(|(one, other)| one.angle_deg(other) < 0.01)
            };
            match into.last_mut().filter(goes_on) {
                Some(last) => {
                    last.target = motion.target;
                    last.length_mm += motion.length_mm;
                    last.zone_mm = motion.zone_mm;
                    last.configuration = motion.configuration;
                    last.accurate_path |= motion.accurate_path;
                }
                None => into.push(motion.clone()),
            }
        })
    }

    /// Replaces each motion by those that `replace` appends; each continuous motion still covers the same path.
    fn with_motions(&self, mut replace: impl FnMut(&Motion, &mut Vec<Motion>)) -> Self {
        // Visits of shared zones are those of the original motions too.
        let mut plan = Self {
            motions: Vec::new(),
            continuous: Vec::new(),
            reasons: Vec::new(),
            visits: Vec::new(),
            ..self.clone()
        };
        let mut waits = plan.waits.iter_mut().peekable();
        while waits.next_if(|wait| wait.after == 0).is_some() {}
        for continuous in &self.continuous {
            // A motion is only joined with one of its own continuous motion.
            let mut motions = Vec::new();
            let replaced = self.motions.get(continuous.motions.clone()).unwrap_or_default();
            for (index, motion) in continuous.motions.clone().zip(replaced) {
                replace(motion, &mut motions);
                while let Some(wait) = waits.next_if(|wait| wait.after == index + 1) {
                    wait.after = plan.motions.len() + motions.len();
                }
            }
            let range: Range<usize> = plan.motions.len()..plan.motions.len() + motions.len();
            plan.motions.append(&mut motions);
            plan.continuous.push(Continuous { motions: range, then: continuous.then.clone() });
        }
        plan.cycles.truncate(1);
        plan
    }
}
