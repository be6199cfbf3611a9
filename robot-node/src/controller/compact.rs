//! The compact points of a MoveTrajectorySkill: the head with which it began, and the sum of the points taken so far.

use protocol::image::{Command, ErrorNumber, Finding, Motion, PointHead, PointSum};

use crate::RobotConfig;
use crate::arm::Violation;

/// Index of the finding for a command without `COMPACT`.
const NOT_COMPACT: u8 = 4;

/// A motion with its target in double precision: where points are counted in steps, single precision is coarser than they are.
pub(super) type Aimed = (Motion, [f64; 6]);

/// Points of the skill under way.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct TakenPoints {
    head: PointHead,
    sum: PointSum,
}

impl TakenPoints {
    /// Takes up the head of a command.
    pub(super) fn begin(command: &Command, config: &RobotConfig) -> Result<Self, Violation> {
        if !config.compact_points {
            return Err(ErrorNumber::CompactNotServed.into());
        }
        let Some(points) = command.slots.points() else {
            return Err(Violation::PointHead(Finding::new(NOT_COMPACT, 0.0, 0.0, 0.0)));
        };
        match points.head.check() {
            Ok(()) => Ok(Self { head: points.head, sum: PointSum::default() }),
            Err((ErrorNumber::PointHead, finding)) => Err(Violation::PointHead(finding)),
            Err((number, _)) => Err(number.into()),
        }
    }

    /// Returns how many points the image holds.
    pub(super) const fn capacity(&self) -> u32 {
        self.head.capacity()
    }

    /// Takes the next point, number `index`, from the image; `None` where it holds none.
    pub(super) fn take(&mut self, command: &Command, index: u32) -> Option<Aimed> {
        let points = command.slots.points()?;
        self.sum.add(self.head.difference_in(&points.ring, index));
        Some((self.sum.motion(&self.head), self.sum.target(&self.head)))
    }
}
