//! The knots of a stretch of path from where the arm is, or rests, to the next rest.

use core::ops::Range;

use super::capacity::Capacity;
use super::knot::{Knot, Rates};
use super::node::{Node, Pace, Ratings};
use super::slopes::Slopes;
use super::thinning::Thinning;

/// Number of parts of a stretch from which on short ones have as few cells as their length needs: the planning of a deep queue must
/// not take longer because its motions are short.
const MANY_PARTS: usize = 16;

/// Number of cells of such a stretch, about.
const CELLS_OF_MANY: f64 = 64.0;

/// In such a stretch one node in so many stays at most: in a curve the first one of each of its pieces, in a corner more, since it bends
/// most in its middle.
const WIDEST_STRIDE: usize = 16;
const WIDEST_CORNER_STRIDE: usize = 4;

/// Number of coarser steps over the nodes that are tried.
const STRIDES: usize = 8;

/// Largest length of a cell between two knots, as a share of the stretch.
const LONGEST: f64 = 1.0 / 8.0;

/// The part of a motion or of a corner that belongs to the stretch.
#[derive(Clone, Copy)]
pub(super) struct Part<'a> {
    pub(super) nodes: &'a [Node],
    pub(super) ratings: &'a Ratings,
    /// Where the stretch enters and leaves it, in its own unit.
    pub(super) from: f64,
    pub(super) to: f64,
    /// Its own units per unit of the stretch.
    pub(super) unit: f64,
    /// The number of its motion, and whether it is the corner after that motion.
    pub(super) motion: u32,
    pub(super) in_blend: bool,
}

impl Part<'_> {
    /// Returns its length in the unit of the stretch.
    pub(super) fn length(&self) -> f64 {
        (self.to - self.from).max(0.0) / self.unit
    }

    /// The knot at a place of its own unit, which is at `way` of the stretch.
    pub(super) fn knot(&self, own_way: f64, way: f64, rates: &Rates) -> Option<Knot> {
        let (one, other, share) = self.nodes_around(own_way)?;
        Some(Knot::between(one, other, share, rates, way, self.unit))
    }

    /// Returns the derivatives at a place of its own unit, in that unit.
    pub(super) fn slopes(&self, own_way: f64) -> Option<Slopes> {
        let (one, other, share) = self.nodes_around(own_way)?;
        Some(Slopes::between(one, other, share, 1.0))
    }

    /// Returns the speed that is programmed at a place of its own unit, in that unit.
    pub(super) fn programmed(&self, own_way: f64) -> Option<f64> {
        let (one, other, share) = self.nodes_around(own_way)?;
        Some(one.programmed + share * (other.programmed - one.programmed))
    }

    /// The nodes before and behind a place of its own unit, and the share of the way between them.
    fn nodes_around(&self, own_way: f64) -> Option<(&Node, &Node, f64)> {
        let next = self.nodes.partition_point(|node| node.way <= own_way).clamp(1, self.nodes.len() - 1);
        let (one, other) = (self.nodes.get(next - 1)?, self.nodes.get(next)?);
        let share = ((own_way - one.way) / (other.way - one.way)).clamp(0.0, 1.0);
        Some((one, other, share))
    }
}

/// Returns the stride over the nodes of a part in a stretch of many parts, by its share of the stretch.
fn few(part: &Part<'_>, length: f64) -> usize {
    let widest = if part.in_blend { WIDEST_CORNER_STRIDE } else { WIDEST_STRIDE };
    let cells = (CELLS_OF_MANY * part.length() / length).ceil().max(1.0);
    ((WIDEST_STRIDE as f64 / cells) as usize).clamp(1, widest)
}

/// Largest ratio of the lengths of two neighbouring cells, about: in a longer one the speed would change too much.
const GRADING: f64 = 3.0;

/// The knots, and where each part begins.
#[derive(Debug)]
pub(super) struct Grid {
    /// With room for the most knots. On the heap, as all lists of knots: they are too large for a stack.
    pub(super) knots: Vec<Knot>,
    /// The derivatives in the middle of each cell.
    pub(super) middles: Vec<Slopes>,
    /// The knots at nodes and borders, before long cells are cut.
    rough: Vec<Knot>,
    /// The knots at the borders once more, with the limits and derivatives of the part that ends there; the third
    /// derivative may jump at a border.
    pub(super) ends: Vec<Knot>,
    /// The knot at which a part begins.
    pub(super) begins: Vec<usize>,
    capacity: Capacity,
    /// Set where the last stretch had more parts or knots than there is room for.
    pub(super) lacks_room: bool,
}

/// Adds an item; none if there are `most` already.
fn push<T>(items: &mut Vec<T>, item: T, most: usize) -> Option<()> {
    if items.len() >= most {
        return None;
    }
    items.push(item);
    Some(())
}

impl Grid {
    /// Creates a grid with room for the stretches of a queue.
    pub(super) fn with_room(capacity: Capacity) -> Self {
        let [knots, rough] = [0; 2].map(|_| Vec::with_capacity(capacity.knots));
        let middles = Vec::with_capacity(capacity.knots);
        let (ends, begins) = (Vec::with_capacity(capacity.parts), Vec::with_capacity(capacity.parts));
        Self { knots, middles, rough, ends, begins, capacity, lacks_room: false }
    }

    /// Takes the knots of these parts; none if there is no way to go or there are too many nodes.
    pub(super) fn fill(&mut self, parts: &[Part<'_>], pace: &Pace) -> Option<()> {
        let nodes: usize = parts.iter().map(|part| part.nodes.len() + 2).sum();
        let Capacity { parts: most_parts, knots, .. } = self.capacity;
        self.lacks_room = parts.len() > most_parts;
        if self.lacks_room {
            return None;
        }
        let stride = nodes.div_ceil(knots - 2 * most_parts - 16);
        let stride = if parts.len() > MANY_PARTS { 1 } else { stride };
        // How many cells are cut is not known in advance.
        let taken = (stride..stride + STRIDES).find_map(|stride| self.take_nodes(parts, pace, stride));
        self.lacks_room = taken.is_none() && self.rough.len().max(self.knots.len()) >= knots;
        taken
    }

    /// Takes one node in `stride`; none if they are too many.
    fn take_nodes(&mut self, parts: &[Part<'_>], pace: &Pace, stride: usize) -> Option<()> {
        self.rough.clear();
        self.ends.clear();
        self.begins.clear();
        let length: f64 = parts.iter().map(Part::length).sum();
        let mut begin = 0.0;
        for part in parts {
            let rates = Rates::of(part.ratings);
            self.begin_part(part.knot(part.from, begin, &rates)?)?;
            let is_thinned = parts.len() > MANY_PARTS;
            let stride = if is_thinned { stride * few(part, length) } else { stride };
            self.take_part((part, &rates), begin, length, (stride, is_thinned))?;
            begin += part.length();
        }
        if self.rough.len() < 2 {
            return None;
        }
        self.grade(pace.brakes_within())?;
        self.refine_end();
        if pace.is_rest() {
            self.refine_start();
        }
        (self.knots.len() > 2).then_some(())
    }

    fn begin_part(&mut self, first: Knot) -> Option<()> {
        match self.rough.last_mut() {
            Some(last) => {
                push(&mut self.ends, *last, self.capacity.parts)?;
                let highest = first.highest.min(last.highest);
                let programmed = first.programmed.min(last.programmed);
                *last = first;
                (last.highest, last.programmed) = (highest, programmed);
            }
            None => self.rough.push(first),
        }
        push(&mut self.begins, self.rough.len() - 1, self.capacity.parts)
    }

    /// Takes the nodes of a part that begins at `begin`, after its first knot. No cell is longer than [`LONGEST`] of the whole
    /// `length`. Where nodes are `thinned`, those stay in which a limit peaks.
    fn take_part(
        &mut self,
        (part, rates): (&Part<'_>, &Rates),
        begin: f64,
        length: f64,
        (stride, is_thinned): (usize, bool),
    ) -> Option<()> {
        let (longest, least) = (LONGEST * length, 1e-9 * length);
        let end = begin + part.length();
        let add_node = |node: &Node| {
            let way = begin + (node.way - part.from) / part.unit;
            let is_inner = way > begin + least && way < end - least;
            if is_inner { self.add_place((part, rates), begin, longest, (way, Some(node))) } else { Some(()) }
        };
        if is_thinned {
            Thinning::new(part.nodes, part.ratings, stride, [part.from, part.to]).each(add_node)?;
        } else {
            part.nodes.iter().step_by(stride).try_for_each(add_node)?;
        }
        self.add_place((part, rates), begin, longest, (end, None))
    }

    /// Adds a knot at a node or a place of a part that begins at `begin`, and cuts a cell before it that is too long.
    fn add_place(
        &mut self,
        (part, rates): (&Part<'_>, &Rates),
        begin: f64,
        longest: f64,
        (way, node): (f64, Option<&Node>),
    ) -> Option<()> {
        let before = self.rough.last()?.way;
        let cells = ((way - before) / longest).ceil().max(1.0);
        for cell in 1..cells as usize {
            let between = before + (way - before) * cell as f64 / cells;
            let own = part.from + (between - begin) * part.unit;
            push(&mut self.rough, part.knot(own, between, rates)?, self.capacity.knots)?;
        }
        let knot = match node {
            Some(node) => Knot::new(node, rates, way, part.unit),
            None => part.knot(part.from + (way - begin) * part.unit, way, rates)?,
        };
        push(&mut self.rough, knot, self.capacity.knots)
    }

    /// The knot at the end of a cell with the limits of the part that ends there, if one does.
    fn end_of(&self, cell: usize) -> Option<&Knot> {
        let part = self.begins.iter().position(|begin| *begin == cell + 1)?;
        self.ends.get(part.checked_sub(1)?)
    }

    /// Cuts cells that are much longer than their neighbours, as there are beside a short corner between long motions.
    fn grade(&mut self, first_cell: f64) -> Option<()> {
        let Self { knots, rough, ends, begins, capacity, .. } = self;
        knots.clear();
        let length_of = |cell: usize| Some(rough.get(cell + 1)?.way - rough.get(cell)?.way);
        // The number of the part, counted from 1, that begins next.
        let mut part = 1;
        for (index, knot) in rough.iter().enumerate() {
            let begins_here = index > 0 && begins.get(part) == Some(&index);
            if begins_here {
                begins[part] = knots.len();
                part += 1;
            }
            push(knots, *knot, capacity.knots)?;
            let (Some(length), Some(next)) = (length_of(index), rough.get(index + 1)) else { break };
            let is_last_of_part = begins.get(part) == Some(&(index + 1));
            let next = ends.get(part - 1).filter(|_| is_last_of_part).unwrap_or(next);
            let least = 1e-6 * length;
            let before = index.checked_sub(1).and_then(length_of).unwrap_or(first_cell / GRADING).max(least);
            let after = length_of(index + 1).map_or(f64::INFINITY, |after| after.max(least));
            let mut cut = |way: f64| push(knots, knot.toward(next, way / length), capacity.knots);
            let (mut step, mut way) = (GRADING * before, GRADING * before);
            while way < length / 2.0 {
                cut(way)?;
                step *= GRADING;
                way += step;
            }
            // From the other end the longest cut comes first.
            let (mut step, mut way) = (GRADING * after, GRADING * after);
            let mut cuts = 0;
            while way < length / 2.0 {
                step *= GRADING;
                way += step;
                cuts += 1;
            }
            for _ in 0..cuts {
                way -= step;
                step /= GRADING;
                cut(length - way)?;
            }
        }
        Some(())
    }

    /// Adds a knot where the acceleration has risen as far as it will after a rest, in place of those before it: up to there the jerk
    /// alone counts, which is constant in a cell beside a rest.
    fn refine_start(&mut self) {
        let last = self.knots.len() - 1;
        let (first, end) = (self.knots[0], self.knots[last].way);
        let Ramp { way: ramp, to_speed } = Ramp::of(&first, end - first.way, 1.0);
        let before = self.knots[1..last].iter().take_while(|knot| knot.way - first.way < ramp).count();
        let next = self.end_of(before).copied().unwrap_or(self.knots[before + 1]);
        let from = self.knots[before];
        let share = (first.way + ramp - from.way) / (next.way - from.way);
        let knot = from.toward(&next, share);
        if (before == 0 && share >= WIDEST) || !self.can_replace(1..1 + before, &first, &knot) {
            return;
        }
        self.replace(1..1 + before, knot);
        // A knot close behind it makes a cell that is too short beside it.
        let is_inner = self.knots.len() > 4 && !self.begins.contains(&2);
        if is_inner && self.knots[2].way - first.way < 1.7 * ramp {
            self.remove(2);
        }
        to_speed.into_iter().for_each(|way| self.add(first.way + way));
    }

    /// The same before the rest at the end.
    fn refine_end(&mut self) {
        let last = self.knots.len() - 1;
        let (end, begin) = (self.knots[last], self.knots[0].way);
        let Ramp { way: ramp, to_speed } = Ramp::of(&end, end.way - begin, -1.0);
        let behind = self.knots[1..last].iter().rev().take_while(|knot| end.way - knot.way < ramp).count();
        let (from, next) = (self.knots[last - behind - 1], self.knots[last - behind]);
        let share = 1.0 - (ramp - (end.way - next.way)) / (next.way - from.way);
        let knot = from.toward(&next, share);
        let inner = last - behind..last;
        if (behind == 0 && share <= 1.0 - WIDEST) || !self.can_replace(inner.clone(), &knot, &end) {
            return;
        }
        self.replace(inner, knot);
        let last = self.knots.len() - 1;
        let is_inner = last > 3 && !self.begins.contains(&(last - 2));
        if is_inner && end.way - self.knots[last - 2].way < 1.7 * ramp {
            self.remove(last - 2);
        }
        to_speed.into_iter().for_each(|way| self.add(end.way - way));
    }

    /// Whether no part begins at these knots, and nothing is there that two others do not let expect.
    fn can_replace(&self, knots: Range<usize>, from: &Knot, to: &Knot) -> bool {
        !self.begins.iter().any(|begin| knots.contains(begin))
            && self.knots[knots].iter().all(|knot| knot.is_between(from, to))
    }

    /// Adds a knot at a place, if none is near.
    fn add(&mut self, way: f64) {
        let next = self.knots.partition_point(|knot| knot.way <= way);
        let Some(before) = next.checked_sub(1) else { return };
        let (Some(one), Some(other)) = (self.knots.get(before), self.knots.get(next)) else { return };
        let share = (way - one.way) / (other.way - one.way);
        if (NEAREST..1.0 - NEAREST).contains(&share) {
            let knot = one.toward(self.end_of(before).unwrap_or(other), share);
            self.replace(next..next, knot);
        }
    }

    /// Puts a knot in the place of those with these indices, of which no part begins at one.
    fn replace(&mut self, knots: Range<usize>, knot: Knot) {
        if self.knots.len() - knots.len() < self.capacity.knots {
            let shifted = |begin: &&mut usize| **begin >= knots.start;
            let removed = knots.len();
            self.begins.iter_mut().filter(shifted).for_each(|begin| *begin = *begin + 1 - removed);
            self.knots.splice(knots, [knot]);
        }
    }

    fn remove(&mut self, index: usize) {
        self.knots.remove(index);
        self.begins.iter_mut().filter(|begin| **begin > index).for_each(|begin| *begin -= 1);
    }
}

/// Share of a stretch from rest to rest on which the acceleration rises if the jerk alone counts: a quarter of the time.
const RISING: f64 = 1.0 / 12.0;

/// Least share of a cell at which a knot is added, from either side, and the largest beside a rest.
const NEAREST: f64 = 0.05;
const WIDEST: f64 = 0.6;

/// Ways from a rest at which a law changes.
struct Ramp {
    /// Until the acceleration has risen fully, or as far as the whole stretch or the highest speed lets it.
    way: f64,
    /// Where the speed rules: while the acceleration falls again, and where the speed is reached.
    to_speed: Option<f64>,
}

impl Ramp {
    /// Those beside a rest of a stretch; `sign` is that of the acceleration.
    fn of(rest: &Knot, stretch: f64, sign: f64) -> Self {
        let (acceleration, jerk) = (rest.acceleration_at_rest(sign), rest.jerk_at_rest());
        let by_acceleration = acceleration * acceleration * acceleration / (6.0 * jerk * jerk);
        let by_length = RISING * stretch;
        // With v² the highest speed: half of it is reached after √(v/jerk) on v·√(v/jerk)/6, the rest on five times that way.
        let speed = rest.highest.sqrt();
        let by_speed = speed * (speed / jerk).sqrt() / 6.0;
        let way = by_acceleration.min(by_length).min(by_speed);
        Self { way, to_speed: (way == by_speed).then_some(6.0 * way) }
    }
}
