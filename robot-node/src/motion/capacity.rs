//! Room for a path, from the number of motions that its queue holds.

use protocol::image::SLOTS;

/// The deepest queue. The setup's check refuses a deeper one.
pub const MOST_MOTIONS: usize = 200;

/// Room for each motion more than the five slots: its straight part and its corner, the knots of both at the widest stride, and
/// lists of nodes for both and for a shape that replaces one.
const MORE_PARTS: usize = 2;
const MORE_KNOTS: usize = 16;
const MORE_LISTS: usize = 3;

/// Largest number of parts of a stretch: those of the deepest queue.
pub(super) const MOST_PARTS: usize = Capacity::of(MOST_MOTIONS).parts;

/// Largest sizes of what a path holds. They are allocated once; what does not fit is not planned, and nothing is left out.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Capacity {
    /// Motions that wait or run.
    pub(super) motions: usize,
    /// Parts of a stretch.
    pub(super) parts: usize,
    /// Knots of a stretch. A longer one leaves out nodes.
    pub(super) knots: usize,
    /// Pieces of all stretches.
    pub(super) pieces: usize,
    /// Lists of nodes.
    pub(super) lists: usize,
}

impl Capacity {
    /// Returns the sizes for a queue of this many motions, at least the five slots.
    pub(super) const fn of(motions: usize) -> Self {
        let motions = if motions > MOST_MOTIONS { MOST_MOTIONS } else { motions };
        let more = motions.saturating_sub(SLOTS);
        let knots = 1024 + MORE_KNOTS * more;
        Self {
            motions: SLOTS + more,
            parts: 16 + MORE_PARTS * more,
            knots,
            pieces: 4 * knots,
            lists: 24 + MORE_LISTS * more,
        }
    }

    /// Returns whether the queue is deeper than the slots of the image.
    pub(super) const fn is_deep(&self) -> bool {
        self.motions > SLOTS
    }
}

impl Default for Capacity {
    fn default() -> Self {
        Self::of(SLOTS)
    }
}
