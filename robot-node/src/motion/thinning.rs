//! Thinning of the nodes of a part where a stretch has many parts: one in some becomes a knot, and each at which a limit is more
//! demanding than at the knots beside it.

use super::node::{Node, square};

/// Demands of a node on the law, each larger where the arm must be slower: reciprocal of the highest square of the
/// speed, largest bend and twist of a joint, bend and twist of the tool's path, all over the limits.
type Demand = [f64; 5];

/// Factor by which a demand must exceed those beside it.
const EXCESS: f64 = 1.01;

/// Nodes of a part at which knots are placed.
#[derive(Clone, Copy)]
pub(super) struct Thinning<'n> {
    nodes: &'n [Node],
    /// One in so many stays.
    stride: usize,
    /// Where the part begins and ends, in its own unit.
    range: [f64; 2],
}

impl<'n> Thinning<'n> {
    pub(super) const fn new(nodes: &'n [Node], stride: usize, range: [f64; 2]) -> Self {
        Self { nodes, stride, range }
    }

    /// Calls `take` with each node that stays, in order.
    pub(super) fn each(&self, mut take: impl FnMut(&'n Node) -> Option<()>) -> Option<()> {
        let [from, to] = self.range;
        let begin = self.nodes.partition_point(|node| node.way <= from);
        let end = self.nodes.partition_point(|node| node.way < to).max(begin);
        let mut at = begin;
        let mut before = self.demand_at(from);
        while at < end {
            // The next node that stays in any case, or the end of the part.
            let next = at.next_multiple_of(self.stride).min(end);
            let after = match self.nodes.get(next) {
                Some(node) if next < end => demand(node),
                _ => self.demand_at(to),
            };
            self.each_peak(at..next, [&before, &after], &mut take)?;
            if next < end {
                take(self.nodes.get(next)?)?;
            }
            (at, before) = (next + 1, after);
        }
        Some(())
    }

    /// Calls `take` with the nodes of a span at which a demand is highest, if it exceeds those on both sides.
    fn each_peak(
        &self,
        span: core::ops::Range<usize>,
        [before, after]: [&Demand; 2],
        take: &mut impl FnMut(&'n Node) -> Option<()>,
    ) -> Option<()> {
        let mut highest: Demand = core::array::from_fn(|index| EXCESS * before[index].max(after[index]));
        let mut peaks = [usize::MAX; 5];
        for index in span.clone() {
            let here = demand(self.nodes.get(index)?);
            for ((most, peak), value) in highest.iter_mut().zip(&mut peaks).zip(here) {
                if value > *most {
                    (*most, *peak) = (value, index);
                }
            }
        }
        for index in span {
            if peaks.contains(&index) {
                take(self.nodes.get(index)?)?;
            }
        }
        Some(())
    }

    /// Returns the demand at a place between two nodes.
    fn demand_at(&self, way: f64) -> Demand {
        let next = self.nodes.partition_point(|node| node.way <= way).clamp(1, self.nodes.len().max(2) - 1);
        let (Some(one), Some(other)) = (self.nodes.get(next - 1), self.nodes.get(next)) else {
            return Demand::default();
        };
        let share = ((way - one.way) / (other.way - one.way)).clamp(0.0, 1.0);
        let [from, to] = [one, other].map(demand);
        core::array::from_fn(|index| from[index] + share * (to[index] - from[index]))
    }
}

fn demand(node: &Node) -> Demand {
    let most = |joints: &[f32]| f64::from(joints.iter().fold(0.0, |most: f32, joint| most.max(joint.abs())));
    let [_, bend, twist] = node.tool.map(|vector| square(vector.map(f64::from)).sqrt());
    [1.0 / node.highest, most(&node.bend), most(&node.twist), bend, twist]
}
