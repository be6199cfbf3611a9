//! The nodes of a curve or a corner.

use core::ops::{Deref, DerefMut};
use std::sync::{Mutex, MutexGuard};

use super::chebyshev::POINTS;
use super::node::Node;

/// Largest number of pieces into which a curve is cut.
pub(super) const PIECES: usize = 40;

/// A piece of a curve that is shorter than this share of it needs few nodes: the speed has no time to change much.
const SHORT: f64 = 1.0 / 8.0;

/// In a short piece of a curve one point in [`STRIDE`] is a node, in a longer one one in [`LONG_STRIDE`]; in a whole
/// curve all are.
const STRIDE: usize = 4;
const LONG_STRIDE: usize = 2;
const _: () = assert!((POINTS - 1).is_multiple_of(STRIDE) && STRIDE.is_multiple_of(LONG_STRIDE));

/// Largest number of nodes of a curve.
const MOST_NODES: usize = PIECES * (POINTS - 1) / STRIDE
    + (1.0 / SHORT) as usize * (POINTS - 1) * (STRIDE - LONG_STRIDE) / (STRIDE * LONG_STRIDE)
    + 1;

/// Returns which points of a piece are nodes; `share` is that of the piece in the curve. The first point of a later
/// piece is the last one of the piece before.
pub(super) fn points_of(share: f64, is_first: bool) -> impl Iterator<Item = usize> {
    let stride = if share >= 1.0 {
        1
    } else if share >= SHORT {
        LONG_STRIDE
    } else {
        STRIDE
    };
    (0..POINTS).step_by(stride).skip(usize::from(!is_first))
}

/// Attempts of a thread to get the spare lists while another one takes or returns one, which takes some nanoseconds.
const ATTEMPTS: usize = 1_000;

/// Lists that are not in use, so that a robot cycle need not allocate one.
static SPARES: Mutex<Vec<Vec<Node>>> = Mutex::new(Vec::new());

/// The spare lists, without ever waiting for a thread that the system has stopped.
fn spares() -> Option<MutexGuard<'static, Vec<Vec<Node>>>> {
    (0..ATTEMPTS).find_map(|_| {
        let spares = SPARES.try_lock().ok();
        if spares.is_none() {
            core::hint::spin_loop();
        }
        spares
    })
}

/// Room for the nodes of a path as long as the path exists: this many of the spare lists belong to it.
#[derive(Debug)]
pub struct Room(usize);

impl Room {
    /// Allocates it, for as many lists as a path needs: for its queue of motions, their corners, and motions that take another
    /// shape.
    #[must_use]
    pub fn with_lists(lists: usize) -> Self {
        if let Ok(mut spares) = SPARES.lock() {
            spares.extend((0..lists).map(|_| Vec::with_capacity(MOST_NODES)));
            // As many again may be in use and come back.
            let used = spares.len().max(8 * lists);
            spares.reserve(used);
        }
        Self(lists)
    }

    /// No room: the nodes are allocated when there are some.
    #[must_use]
    pub const fn none() -> Self {
        Self(0)
    }
}

impl Drop for Room {
    fn drop(&mut self) {
        if self.0 > 0
            && let Ok(mut spares) = SPARES.lock()
        {
            let left = spares.len().saturating_sub(self.0);
            spares.truncate(left);
        }
    }
}

/// Nodes in order of the way. They are on the heap, so that a motion can be moved cheaply.
#[derive(PartialEq, Debug)]
pub struct Nodes(Vec<Node>);

impl Nodes {
    /// Empty, with room for the nodes of any curve.
    pub(super) fn new() -> Self {
        let spare = spares().and_then(|mut spares| spares.pop());
        Self(spare.unwrap_or_else(|| Vec::with_capacity(MOST_NODES)))
    }
}

impl Drop for Nodes {
    fn drop(&mut self) {
        if let Some(mut spares) = spares()
            && spares.len() < spares.capacity()
        {
            self.0.clear();
            spares.push(core::mem::take(&mut self.0));
        }
    }
}

impl Clone for Nodes {
    fn clone(&self) -> Self {
        self.iter().copied().collect()
    }
}

impl FromIterator<Node> for Nodes {
    fn from_iter<I: IntoIterator<Item = Node>>(nodes: I) -> Self {
        let mut all = Self::new();
        all.extend(nodes);
        all
    }
}

impl Deref for Nodes {
    type Target = Vec<Node>;

    fn deref(&self) -> &Vec<Node> {
        &self.0
    }
}

impl DerefMut for Nodes {
    fn deref_mut(&mut self) -> &mut Vec<Node> {
        &mut self.0
    }
}

#[cfg(test)]
mod tests {
    use super::super::node::Ratings;
    use super::*;
    use crate::AxisLimits;

    const LISTS: usize = 24;

    const LIMITS: AxisLimits = AxisLimits {
        lower: [-1.0; 6],
        upper: [1.0; 6],
        speed: [1.0; 6],
        acceleration: [1.0; 6],
        jerk: [1.0; 6],
    };

    #[test]
    fn lists_that_are_taken_again_are_empty_and_have_room_for_any_curve() {
        let node = Node::of_axes(0.0, 1.0, &[1.0; 6], &Ratings::of_axes(&LIMITS, 1.0, 1.0));
        let _room = Room::with_lists(LISTS);
        for _ in 0..2 {
            let taken: Vec<Nodes> = (0..2 * LISTS).map(|_| Nodes::new()).collect();
            for mut nodes in taken {
                assert!(
                    nodes.is_empty() && nodes.capacity() == MOST_NODES,
                    "{} of {}",
                    nodes.len(),
                    nodes.capacity()
                );
                nodes.extend([node; MOST_NODES]);
            }
        }
    }
}
