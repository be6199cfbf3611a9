//! Runs as compact points.

use protocol::image::{CompactPoints, PointDifference, PointHead, PointSum};

use super::{Execution, Programmed, Run};

/// Steps in one unit of the [grid](Run::POINTS_PER_UNIT).
const RESOLUTION: u16 = 625;

/// The compact points of a run.
#[derive(Clone, PartialEq, Debug)]
pub struct RunPoints {
    /// Head of all points; the first one is the origin.
    pub head: PointHead,
    /// Each point's difference from the one before it.
    pub differences: Vec<PointDifference>,
}

impl Run {
    /// Points in a millimetre, or a degree, on which targets are single precision numbers and whole steps as well.
    pub const POINTS_PER_UNIT: f64 = 32.0;

    /// Returns the run as compact points: none if it is to run in another way, or if the points do not carry its motions exactly.
    #[must_use]
    pub fn points(&self) -> Option<RunPoints> {
        let first = self.motions.first().filter(|_| self.execution == Execution::Trajectory)?;
        let turns = self.motions.iter().any(|motion| motion.target[3..] != first.target[3..]);
        let head = PointHead::of(&first.motion(), RESOLUTION, if turns { 6 } else { 3 });
        head.check().ok()?;
        let mut sum = PointSum::default();
        let difference = |programmed: &Programmed| {
            let motion = programmed.motion();
            let target = motion.target.map(f64::from);
            let difference = sum.advance(&head, target).ok()?;
            // Zero has two signs in the digest of motions.
            let is_exact = sum.target(&head).map(f64::to_bits) == target.map(f64::to_bits);
            (is_exact && sum.motion(&head) == motion).then_some(difference)
        };
        let differences = self.motions.iter().map(difference).collect::<Option<_>>()?;
        Some(RunPoints { head, differences })
    }
}

impl RunPoints {
    /// Returns the form of the image before any point is in it.
    pub(crate) const fn empty(&self) -> CompactPoints {
        CompactPoints::new(self.head)
    }
}
