//! When each node's next timeout is due.

use alloc::vec;
use alloc::vec::Vec;

use machine::Instant;

/// No timeout is due, ever.
const NEVER: (Instant, usize) = (Instant::from_nanos(u64::MAX), usize::MAX);

/// The next timeout of each node, as a tree of which every parent is the earlier of its children: the first of all is at the
/// root, and a change costs one comparison for each doubling of the nodes. Of two at one instant the node with the smaller
/// number is first.
#[derive(Debug, Default)]
pub(super) struct Deadlines {
    /// The root is at 1; the children of `n` are at `2 n` and `2 n + 1`.
    tree: Vec<(Instant, usize)>,
    /// Where the leaves begin; a power of two.
    leaves: usize,
}

impl Deadlines {
    /// Makes room for so many nodes.
    pub(super) fn grow(&mut self, nodes: usize) {
        if nodes <= self.leaves {
            return;
        }
        let old: Vec<_> = self.tree.iter().skip(self.leaves).copied().collect();
        self.leaves = nodes.next_power_of_two();
        self.tree = vec![NEVER; 2 * self.leaves];
        for (node, (at, _)) in old.into_iter().enumerate() {
            self.set(node, Some(at).filter(|at| *at != NEVER.0));
        }
    }

    /// Sets when a node's timeout is due.
    #[inline]
    pub(super) fn set(&mut self, node: usize, due: Option<Instant>) {
        let mut place = self.leaves + node;
        let Some(leaf) = self.tree.get_mut(place) else { return };
        *leaf = due.map_or(NEVER, |due| (due, node));
        while place > 1 {
            let earlier = match (self.tree.get(place), self.tree.get(place ^ 1)) {
                (Some(one), Some(other)) => *one.min(other),
                _ => return,
            };
            place /= 2;
            if let Some(parent) = self.tree.get_mut(place) {
                *parent = earlier;
            }
        }
    }

    /// Returns the first timeout and its node.
    #[inline]
    pub(super) fn first(&self) -> Option<(Instant, usize)> {
        self.tree.get(1).copied().filter(|(_, node)| *node != NEVER.1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_first_is_the_earliest_and_of_two_at_once_the_node_with_the_smaller_number(
            changes in prop::collection::vec((0..9_usize, prop::option::of(0..5_u64)), 1..60),
        ) {
            let mut deadlines = Deadlines::default();
            let mut plain = Vec::new();
            for (node, due) in changes {
                if node >= plain.len() {
                    plain.resize(node + 1, None);
                    deadlines.grow(plain.len());
                }
                plain[node] = due.map(Instant::from_nanos);
                deadlines.set(node, plain[node]);
                let first = plain.iter().enumerate().filter_map(|(node, due)| Some(((*due)?, node))).min();
                prop_assert_eq!(deadlines.first(), first);
            }
        }
    }
}
