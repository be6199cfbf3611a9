//! When the faults of a virtual run change the cable, a node or a drive: at a time, or with a frame.

use std::time::Duration;

use machine::Instant;
use virtual_time::Side;

use records::faults::{self, AtFrame, Change, Fault};

/// Changes that are still to come.
#[derive(Debug)]
pub(super) struct Changes {
    /// Those at a time after the robot is ready, until it is.
    after_ready: Vec<(Duration, Change)>,
    /// When the robot was ready.
    ready: Option<Instant>,
    /// Those at an instant of true time, the next one last.
    due: Vec<(Instant, Change)>,
    /// Those with a frame.
    at_frames: Vec<AtFrame>,
    /// How many cuts of the cable last.
    cuts: u32,
}

impl Changes {
    pub(super) fn of(faults: &[Fault]) -> Self {
        let at_frames = faults::at_frames(faults).collect();
        Self { after_ready: faults::changes(faults), ready: None, due: Vec::new(), at_frames, cuts: 0 }
    }

    /// Starts the time that changes count from: the robot is ready.
    pub(super) fn ready(&mut self, now: Instant) {
        self.ready = Some(now);
        for (after, change) in std::mem::take(&mut self.after_ready) {
            self.push(now + after, change);
        }
    }

    /// Returns the time since the robot was ready; `None` before.
    pub(super) fn since_ready(&self, now: Instant) -> Option<Duration> {
        self.ready.map(|ready| now.since(ready))
    }

    fn push(&mut self, at: Instant, change: Change) {
        let later = self.due.partition_point(|(other, _)| *other > at);
        self.due.insert(later, (at, change));
    }

    /// Returns the instant of the next change that has one.
    pub(super) fn next(&self) -> Option<Instant> {
        self.due.last().map(|(at, _)| *at)
    }

    /// Takes the next change that has an instant.
    pub(super) fn take(&mut self) -> Option<Change> {
        self.due.pop().map(|(_, change)| change)
    }

    /// Returns the next frame of this side with which a change begins.
    pub(super) fn next_frame(&self, side: Side) -> Option<u64> {
        let of = self.at_frames.iter().filter(|at| at.from == side);
        of.map(|at| at.frame).min()
    }

    /// Takes a change that begins with one of the frames that were put in, so many by each side.
    pub(super) fn take_at(&mut self, now: Instant, sent: impl Fn(Side) -> u64) -> Option<Change> {
        let reached = self.at_frames.iter().position(|at| at.frame <= sent(at.from))?;
        let AtFrame { first, then, after, .. } = self.at_frames.swap_remove(reached);
        self.push(now + after, then);
        Some(first)
    }

    /// Counts a cut or its end; returns whether the cable is cut now.
    pub(super) const fn count_cut(&mut self, begins: bool) -> bool {
        self.cuts = if begins { self.cuts + 1 } else { self.cuts.saturating_sub(1) };
        self.cuts > 0
    }
}
