//! Where the motions of a sequence come from.

use core::fmt::Debug;

use protocol::image::{Digest, Motion};

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
}

/// A source with the digest of what it gave away since the last start.
#[derive(Debug)]
pub(crate) struct Digested {
    source: Box<dyn MotionSource>,
    given: Digest,
}

impl Digested {
    pub(crate) fn new(source: Box<dyn MotionSource>) -> Self {
        Self { source, given: Digest::default() }
    }

    /// Starts a run, which asks for the motions from the first one on.
    pub(crate) fn restart(&mut self) {
        self.given = Digest::default();
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
}
