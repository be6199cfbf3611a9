//! Thinning of the nodes of a part where a stretch has many parts: one in some becomes a knot, and each at which a limit is more
//! demanding than the line between the knots beside it.

use super::node::{Node, square};

/// Demands of a node on the law, each larger where the arm must be slower: reciprocal of the highest square of the
/// speed, largest bend and twist of a joint, bend and twist of the tool's path, all over the limits.
type Demand = [f64; 5];

/// Factor by which a demand must exceed the line between those beside it.
const EXCESS: f64 = 1.02;

/// A place of a part with its demands.
#[derive(Clone, Copy)]
struct DemandAt {
    way: f64,
    demand: Demand,
}

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
        let mut before = DemandAt { way: from, demand: self.demand_at(from) };
        while at < end {
            // The next node that stays in any case, or the end of the part.
            let next = at.next_multiple_of(self.stride).min(end);
            let after = match self.nodes.get(next) {
                Some(node) if next < end => DemandAt { way: node.way, demand: demand(node) },
                _ => DemandAt { way: to, demand: self.demand_at(to) },
            };
            self.each_peak(at..next, [&before, &after], &mut take)?;
            if next < end {
                take(self.nodes.get(next)?)?;
            }
            (at, before) = (next + 1, after);
        }
        Some(())
    }

    /// Calls `take` with the nodes of a span that stay: that at which a demand exceeds most the line between those on both sides, and
    /// likewise in the spans before and after it.
    fn each_peak(
        &self,
        span: core::ops::Range<usize>,
        [before, after]: [&DemandAt; 2],
        take: &mut impl FnMut(&'n Node) -> Option<()>,
    ) -> Option<()> {
        let (mut highest, mut peak) = (EXCESS, None);
        for index in span.clone() {
            let node = self.nodes.get(index)?;
            let here = DemandAt { way: node.way, demand: demand(node) };
            let share = (here.way - before.way) / (after.way - before.way);
            let line = between([&before.demand, &after.demand], share);
            for (demand, line) in here.demand.into_iter().zip(line) {
                if demand > highest * line {
                    (highest, peak) = (demand / line, Some((index, node, here)));
                }
            }
        }
        let Some((index, node, peak)) = peak else { return Some(()) };
        self.each_peak(span.start..index, [before, &peak], take)?;
        take(node)?;
        self.each_peak(index + 1..span.end, [&peak, after], take)
    }

    /// Returns the demand at a place between two nodes.
    fn demand_at(&self, way: f64) -> Demand {
        let next = self.nodes.partition_point(|node| node.way <= way).clamp(1, self.nodes.len().max(2) - 1);
        let (Some(one), Some(other)) = (self.nodes.get(next - 1), self.nodes.get(next)) else {
            return Demand::default();
        };
        let share = ((way - one.way) / (other.way - one.way)).clamp(0.0, 1.0);
        let [from, to] = [one, other].map(demand);
        between([&from, &to], share)
    }
}

/// Returns the demands on the line between two places.
fn between([from, to]: [&Demand; 2], share: f64) -> Demand {
    core::array::from_fn(|index| from[index] + share * (to[index] - from[index]))
}

fn demand(node: &Node) -> Demand {
    let most = |joints: &[f32]| f64::from(joints.iter().fold(0.0, |most: f32, joint| most.max(joint.abs())));
    let [_, bend, twist] = node.tool.map(|vector| square(vector.map(f64::from)).sqrt());
    [1.0 / node.highest, most(&node.bend), most(&node.twist), bend, twist]
}
