//! Where the motions of a sequence come from.

use core::fmt::Debug;

use planning::CompactPath;
use protocol::image::{Digest, Motion, PointDifference, PointHead, PointSum};

/// The motions of one sequence, in order.
///
/// A scan asks for at most five of them, and for each one once, in ascending order; after a restart again from the
/// first one. A source that reads from a file therefore needs a window only. It must not block: what it cannot give
/// at once it has to have read ahead.
pub trait MotionSource: Debug + Send {
    /// Returns the number of motions of the sequence: the paper's `totalNo`.
    fn total(&self) -> u32;

    /// Returns motion `index`, counted from 0; `None` past the end or if the source failed.
    fn get(&mut self, index: u32) -> Option<Motion>;

    /// Returns how many of the motions may be asked for at present: the PLC holds back those beyond a mark at which the arm waits
    /// for others.
    fn available(&self) -> u32 {
        self.total()
    }

    /// Returns what all points have in common, if the motions go to the robot as compact points.
    fn point_head(&self) -> Option<PointHead> {
        None
    }

    /// Returns the differences of point `index`, counted from 0, of a source with a [head](Self::point_head): that is asked for in place
    /// of the motion.
    fn difference(&mut self, _index: u32) -> Option<PointDifference> {
        None
    }
}

/// Motions that are all in memory.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct MotionList(Vec<Motion>);

impl MotionList {
    pub(crate) const fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub(crate) fn last_mut(&mut self) -> Option<&mut Motion> {
        self.0.last_mut()
    }
}

impl From<Vec<Motion>> for MotionList {
    fn from(motions: Vec<Motion>) -> Self {
        Self(motions)
    }
}

impl MotionSource for MotionList {
    fn total(&self) -> u32 {
        u32::try_from(self.0.len()).unwrap_or(u32::MAX)
    }

    fn get(&mut self, index: u32) -> Option<Motion> {
        self.0.get(usize::try_from(index).ok()?).copied()
    }
}

/// Compact points that are all in memory.
#[derive(Clone, PartialEq, Debug)]
pub struct PointList {
    path: CompactPath,
    /// Number of the point that follows the sum, and the sum of those before it.
    reached: (u32, PointSum),
}

impl From<CompactPath> for PointList {
    fn from(path: CompactPath) -> Self {
        Self { path, reached: (0, PointSum::default()) }
    }
}

impl MotionSource for PointList {
    fn total(&self) -> u32 {
        u32::try_from(self.path.differences.len()).unwrap_or(u32::MAX)
    }

    /// Returns the motion to point `index`. Motions that are asked for in order take the same time each.
    fn get(&mut self, index: u32) -> Option<Motion> {
        let mut reached = if self.reached.0 <= index { self.reached } else { (0, PointSum::default()) };
        while reached.0 <= index {
            reached.1.add(self.difference(reached.0)?);
            reached.0 += 1;
        }
        self.reached = reached;
        Some(reached.1.motion(&self.path.head))
    }

    fn point_head(&self) -> Option<PointHead> {
        Some(self.path.head)
    }

    fn difference(&mut self, index: u32) -> Option<PointDifference> {
        self.path.differences.get(usize::try_from(index).ok()?).copied()
    }
}

/// Returns the source of motions, which go as compact points where they are given as these too.
#[must_use]
pub fn motion_source(motions: Vec<Motion>, points: Option<CompactPath>) -> Box<dyn MotionSource> {
    match points {
        Some(points) => Box::new(PointList::from(points)),
        None => Box::new(MotionList::from(motions)),
    }
}

/// Motions `from` to `end` of a source, as a source of their own: one continuous motion of several.
#[derive(Debug)]
pub(crate) struct Section<'a> {
    pub(crate) source: &'a mut dyn MotionSource,
    pub(crate) from: u32,
    pub(crate) end: u32,
    /// Motions of the source that may be asked for.
    pub(crate) available: u32,
}

impl MotionSource for Section<'_> {
    fn total(&self) -> u32 {
        self.end.saturating_sub(self.from)
    }

    fn get(&mut self, index: u32) -> Option<Motion> {
        let index = self.from.checked_add(index).filter(|index| *index < self.end)?;
        self.source.get(index)
    }

    fn available(&self) -> u32 {
        self.available.min(self.end).saturating_sub(self.from)
    }

    /// Returns the head for the whole source only: a later part begins at another origin, so its motions go as they are.
    fn point_head(&self) -> Option<PointHead> {
        self.source.point_head().filter(|_| self.from == 0 && self.end == self.source.total())
    }

    fn difference(&mut self, index: u32) -> Option<PointDifference> {
        self.source.difference(index)
    }
}

/// A source with the digest of what it gave away since the last start.
#[derive(Debug)]
pub(crate) struct Digested {
    source: Box<dyn MotionSource>,
    given: Digest,
    /// Sum of the points that it gave away as differences.
    sum: PointSum,
}

impl Digested {
    pub(crate) fn new(source: Box<dyn MotionSource>) -> Self {
        Self { source, given: Digest::default(), sum: PointSum::default() }
    }

    /// Starts a run, which asks for the motions from the first one on.
    pub(crate) fn restart(&mut self) {
        (self.given, self.sum) = (Digest::default(), PointSum::default());
    }

    pub(crate) const fn given(&self) -> &Digest {
        &self.given
    }
}

impl MotionSource for Digested {
    fn total(&self) -> u32 {
        self.source.total()
    }

    fn get(&mut self, index: u32) -> Option<Motion> {
        let motion = self.source.get(index);
        motion.iter().for_each(|motion| self.given.add(motion));
        motion
    }

    fn point_head(&self) -> Option<PointHead> {
        self.source.point_head()
    }

    fn difference(&mut self, index: u32) -> Option<PointDifference> {
        let head = self.source.point_head()?;
        let difference = self.source.difference(index)?;
        self.sum.add(difference);
        self.given.add(&self.sum.motion(&head));
        Some(difference)
    }
}
