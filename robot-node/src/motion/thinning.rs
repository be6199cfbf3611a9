//! Thinning of the nodes of a part where a stretch has many parts: one in some becomes a knot, and each at which a limit is more
//! demanding than what the law finds there by the knots beside it.

use core::iter::zip;

use super::extremes::larger;
use super::node::{Node, Ratings, square};
use super::slopes::Slopes;

/// Demands of a node on the law, each larger where the arm must be slower: reciprocal of the highest square of the
/// speed, largest bend of a joint over the accelerations and over the jerks, largest twist of a joint over the jerks, bend and twist of
/// the tool's path, both over its limits. Joints differ in how fast their accelerations rise: one whose twist is small can have the
/// largest jerk.
type Demand = [f64; 6];

/// Factor by which a demand must exceed what those beside it let expect.
const EXCESS: f64 = 1.02;

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
            let here = self.node(node);
            let expected = self.expected([before, after], here.way);
            for (demand, expected) in zip(here.demand, expected) {
                if demand > highest * expected {
                    (highest, peak) = (demand / expected, Some((index, node, here)));
                }
            }
        }
        let Some((index, node, peak)) = peak else { return Some(()) };
        self.each_peak(span.start..index, [before, &peak], take)?;
        take(node)?;
        self.each_peak(index + 1..span.end, [&peak, after], take)
    }

    /// Returns the demands that the law finds at a way between two places: its derivatives there are cubics between theirs, which can lie
    /// well below the line.
    fn expected(&self, [before, after]: [&DemandAt; 2], way: f64) -> Demand {
        let length = after.way - before.way;
        let share = (way - before.way) / length;
        let line = between([&before.demand, &after.demand], share);
        let cubic = self.demand(line[0], &before.slopes.toward(&after.slopes, length, share));
        core::array::from_fn(|index| larger(SLIGHT * line[index], cubic[index]).min(line[index]))
    }

    fn node(&self, node: &Node) -> DemandAt {
        let slopes = Slopes::in_own_unit(node);
        DemandAt { way: node.way, demand: self.demand(1.0 / node.highest, &slopes), slopes }
    }

    /// Returns a place between two nodes, with the demands on the line between theirs.
    fn place(&self, way: f64) -> Option<DemandAt> {
        let next = self.nodes.partition_point(|node| node.way <= way).clamp(1, self.nodes.len().max(2) - 1);
        let (one, other) = (self.nodes.get(next - 1)?, self.nodes.get(next)?);
        let share = ((way - one.way) / (other.way - one.way)).clamp(0.0, 1.0);
        let slopes = Slopes::between(one, other, share, 1.0);
        let [from, to] = [one, other].map(|node| self.node(node).demand);
        Some(DemandAt { way, slopes, demand: between([&from, &to], share) })
    }

    fn demand(&self, slowest: f64, slopes: &Slopes) -> Demand {
        let mut most = [0.0; 3];
        for ((bend, twist), ramp_s) in zip(zip(slopes.bend, slopes.twist), self.ratings.ramp_s) {
            let [bend, twist] = [bend, twist].map(f64::abs);
            for (most, here) in zip(&mut most, [bend, bend * ramp_s, twist * ramp_s]) {
                *most = larger(*most, here);
            }
        }
        let [_, bend, twist] = slopes.tool.map(|vector| square(vector).sqrt());
        [slowest, most[0], most[1], most[2], bend, twist]
    }
}

/// Returns the demands on the line between two places.
fn between([from, to]: [&Demand; 2], share: f64) -> Demand {
    core::array::from_fn(|index| from[index] + share * (to[index] - from[index]))
}
