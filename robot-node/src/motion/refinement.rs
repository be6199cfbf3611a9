//! How far the refinement of a path's law is, and which of its pieces it is about.

use super::capacity::Capacity;
use super::law::Law;
use super::piece::Spot;

/// The law that is refined.
#[derive(Debug)]
pub(super) struct Refinement {
    /// None in the copy of a path, which refines nothing.
    pub(super) law: Option<Box<Law>>,
    pub(super) state: State,
    /// Whether a motion was planned in this cycle, which takes long enough.
    pub(super) has_planned: bool,
    /// The number of the motion that begins behind the last stretch that was looked at.
    pub(super) done: u32,
    /// From how many pieces of the next stretch no law went on.
    pub(super) failures: usize,
}

/// How far it is.
#[derive(Clone, Copy, Debug)]
pub(super) enum State {
    Idle,
    /// A motion was planned.
    Planned,
    Refining(Range),
    Ready(Range),
}

/// What is refined: pieces of the path by their numbers, and where they begin.
#[derive(Clone, Copy, Debug)]
pub(super) struct Range {
    pub(super) begin: usize,
    pub(super) end: usize,
    pub(super) spot: Spot,
}

impl Refinement {
    pub(super) fn with_room(capacity: Capacity) -> Self {
        Self { law: Some(Box::new(Law::with_room(capacity))), ..Self::none() }
    }

    pub(super) const fn none() -> Self {
        Self { law: None, state: State::Idle, has_planned: false, done: 0, failures: 0 }
    }

    /// The path is empty.
    pub(super) fn clear(&mut self) {
        (self.state, self.done, self.failures) = (State::Idle, 0, 0);
    }

    /// The stretch that ends before this motion was looked at.
    pub(super) const fn note_looked_at(&mut self, next_motion: u32) {
        (self.done, self.failures) = (next_motion, 0);
    }

    /// All pieces of the path but the first ones are planned anew.
    pub(super) fn keep(&mut self, pieces: usize) {
        self.has_planned = true;
        match self.state {
            State::Refining(range) | State::Ready(range) if range.end <= pieces => {}
            _ => (self.state, self.failures) = (State::Planned, 0),
        }
    }

    /// The arm has left so many pieces of the path.
    pub(super) fn leave(&mut self, pieces: usize) {
        if let State::Refining(range) | State::Ready(range) = &mut self.state {
            if range.begin > pieces {
                (range.begin, range.end) = (range.begin - pieces, range.end - pieces);
            } else if pieces > 0 {
                // Too late: the arm is in a piece that changes.
                self.state = State::Planned;
            }
        }
    }
}
