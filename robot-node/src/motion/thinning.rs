//! Thinning of the nodes of a part where a stretch has many parts: one in some becomes a knot, and each at which a limit is more
//! demanding than what the law finds there by the knots beside it.

use core::iter::zip;

use super::extremes::larger;
use super::node::{Node, Ratings, square};
use super::slopes::Slopes;
use crate::arm::Joints;

/// Demands of a node on the law, each larger where the arm must be slower: reciprocal of the highest square of the
/// speed, largest bend of a joint over the accelerations and over the jerks, largest twist of a joint over the jerks, bend and twist of
/// the tool's path, both over its limits. Joints differ in how fast their accelerations rise: one whose twist is small can have the
/// largest jerk.
type Demand = [f64; 6];

/// Share of a limit by which a node's demand must exceed what those beside it let expect: about half of the reserve. Points a fraction of
/// a millimetre apart have derivatives that differ by more, but by rounding alone, and use little of the limits.
const EXCESS: f64 = 0.02;

/// Least share of the line between the demands beside it that counts as expected: less demands nothing.
const SLIGHT: f64 = 0.1;

/// A place of a part with its derivatives and demands.
#[derive(Clone, Copy)]
struct DemandAt {
    way: f64,
    slopes: Slopes,
    demand: Demand,
}

/// Nodes of a part at which knots are placed.
#[derive(Clone, Copy)]
pub(super) struct Thinning<'n> {
    nodes: &'n [Node],
    ratings: &'n Ratings,
    /// One in so many stays.
    stride: usize,
    /// Where the part begins and ends, in its own unit.
    range: [f64; 2],
}

impl<'n> Thinning<'n> {
    pub(super) const fn new(nodes: &'n [Node], ratings: &'n Ratings, stride: usize, range: [f64; 2]) -> Self {
        Self { nodes, ratings, stride, range }
    }

    /// Calls `take` with each node that stays, in order.
    pub(super) fn each(&self, mut take: impl FnMut(&'n Node) -> Option<()>) -> Option<()> {
        let [from, to] = self.range;
        let begin = self.nodes.partition_point(|node| node.way <= from);
        let end = self.nodes.partition_point(|node| node.way < to).max(begin);
        let mut at = begin;
        let mut before = self.place(from)?;
        while at < end {
            // The next node that stays in any case, or the end of the part.
            let next = at.next_multiple_of(self.stride).min(end);
            let after = match self.nodes.get(next) {
                Some(node) if next < end => self.node(node),
                _ => self.place(to)?,
            };
            self.each_peak(at..next, [&before, &after], &mut take)?;
            if next < end {
                take(self.nodes.get(next)?)?;
            }
            (at, before) = (next + 1, after);
        }
        Some(())
    }

    /// Calls `take` with the nodes of a span that stay: that at which a demand exceeds most what those on both sides let expect, and
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
            let demand = self.demand(node);
            let shares = self.shares(node, &demand);
            if shares.iter().all(|share| *share <= highest) {
                continue;
            }
            let expected = self.expected([before, after], node.way);
            for ((demand, expected), share) in zip(zip(demand, expected), shares) {
                let excess = share * (1.0 - expected / demand);
                if excess > highest {
                    (highest, peak) = (excess, Some((index, node)));
                }
            }
        }
        let Some((index, node)) = peak else { return Some(()) };
        let peak = self.node(node);
        self.each_peak(span.start..index, [before, &peak], take)?;
        take(node)?;
        self.each_peak(index + 1..span.end, [&peak, after], take)
    }

    /// Returns the demands that the law finds at a way between two places: its second derivatives there are cubics between theirs, which can
    /// lie well below the line.
    fn expected(&self, [before, after]: [&DemandAt; 2], way: f64) -> Demand {
        let length = after.way - before.way;
        let share = (way - before.way) / length;
        let mut expected = between([&before.demand, &after.demand], share);
        let (joints, tool) = before.slopes.bends_toward(&after.slopes, length, share);
        let [bend, bend_ramp] = self.bends(joints);
        for (index, cubic) in [(1, bend), (2, bend_ramp), (4, square(tool).sqrt())] {
            let line = expected[index];
            expected[index] = larger(SLIGHT * line, cubic).min(line);
        }
        expected
    }

    fn node(&self, node: &Node) -> DemandAt {
        let slopes = Slopes::in_own_unit(node);
        DemandAt { way: node.way, demand: self.demand(node), slopes }
    }

    /// Returns a place between two nodes, with the demands on the line between theirs.
    fn place(&self, way: f64) -> Option<DemandAt> {
        let next = self.nodes.partition_point(|node| node.way <= way).clamp(1, self.nodes.len().max(2) - 1);
        let (one, other) = (self.nodes.get(next - 1)?, self.nodes.get(next)?);
        let share = ((way - one.way) / (other.way - one.way)).clamp(0.0, 1.0);
        let slopes = Slopes::between(one, other, share, 1.0);
        let [from, to] = [one, other].map(|node| self.demand(node));
        Some(DemandAt { way, slopes, demand: between([&from, &to], share) })
    }

    /// Returns the share of its limit that each demand of a node takes at most. The law is nowhere faster than programmed.
    fn shares(&self, node: &Node, [slowest, bend, _, twist, tool_bend, tool_twist]: &Demand) -> Demand {
        let programmed = node.programmed * node.programmed;
        let square = node.highest.min(programmed);
        let cube = square * square.sqrt();
        let slows = if slowest * programmed > 1.0 { 1.0 } else { 0.0 };
        let bends = bend * square;
        let shares = [
            slows,
            bends,
            bends,
            twist * cube,
            tool_bend * square,
            tool_twist * cube * self.ratings.tool_ramp_s,
        ];
        shares.map(|share| share.min(1.0))
    }

    fn demand(&self, node: &Node) -> Demand {
        let [bend, bend_ramp] = self.bends(node.bend.map(f64::from));
        let twists =
            zip(node.twist, self.ratings.ramp_s).map(|(twist, ramp_s)| f64::from(twist).abs() * ramp_s);
        let [_, tool_bend, tool_twist] = node.tool.map(|vector| square(vector.map(f64::from)).sqrt());
        [1.0 / node.highest, bend, bend_ramp, twists.fold(0.0, larger), tool_bend, tool_twist]
    }

    /// Returns the largest second derivative of a joint over the accelerations, and over the jerks.
    fn bends(&self, bends: Joints) -> [f64; 2] {
        zip(bends, self.ratings.ramp_s).fold([0.0; 2], |[most, most_ramp], (bend, ramp_s)| {
            [larger(most, bend.abs()), larger(most_ramp, bend.abs() * ramp_s)]
        })
    }
}

/// Returns the demands on the line between two places.
fn between([from, to]: [&Demand; 2], share: f64) -> Demand {
    core::array::from_fn(|index| from[index] + share * (to[index] - from[index]))
}
