//! Why there is no corner between two motions: where on it, and what is in the way.

use super::blend::{Blend, entering_zone, wanted_zone};
use super::nodes::Nodes;
use super::segment::Segment;
use crate::{Arm, TURNED_OVER_DEG, Violation};

/// Number of steps in which the corner is followed.
const STEPS: u32 = 256;

/// What keeps the arm from following a corner.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Hindrance {
    /// Share of the corner that the arm can follow, 0…1.
    pub share: f64,
    /// Why no farther.
    pub violation: Violation,
}

impl Blend {
    /// Follows the corner that two motions have by the approximation distance of the first one, and returns where the arm
    /// cannot; none where it can, so that something else prevents the corner. For messages: [`Blend::between`] decides.
    #[must_use]
    pub fn hindrance(first: &Segment, second: &Segment, arm: &Arm) -> Option<Hindrance> {
        let blend = Self {
            from_zone: wanted_zone(first, arm),
            to_zone: entering_zone(second, first.approximation_mm, arm),
            distance_mm: first.approximation_mm,
            ratings: first.ratings,
            nodes: Nodes::new(),
        };
        let start = first.curve.length() - blend.from_zone;
        let mut near = first.curve.joints(start, arm, &first.end).unwrap_or(first.end);
        let mut share = 0.0;
        let mut found: Option<Hindrance> = None;
        for step in 0..=STEPS {
            let next = f64::from(step) / f64::from(STEPS);
            match blend.joints(first, second, next, arm, &near) {
                Ok(joints) => {
                    let (axis, turn_deg) = arm.largest_turn(&near, &joints);
                    if step > 0 && turn_deg > TURNED_OVER_DEG && found.is_none() {
                        let (way, length) = (share, 1.0);
                        let violation = Violation::Configuration { axis, turn_deg, way, length };
                        return Some(Hindrance { share, violation });
                    }
                    if found.is_some() {
                        break;
                    }
                    (near, share) = (joints, next);
                }
                // Behind the first place more may be missing.
                Err(violation) => match &mut found {
                    Some(worst) if violation.number() == worst.violation.number() => {
                        let missing = |it: &Violation| it.missing().map_or(0.0, |it| it.0);
                        if missing(&violation) > missing(&worst.violation) {
                            worst.violation = violation;
                        }
                    }
                    Some(_) => break,
                    None => found = Some(Hindrance { share, violation }),
                },
            }
        }
        found
    }
}
