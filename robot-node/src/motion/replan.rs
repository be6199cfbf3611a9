//! Planning the law anew after a change of the path: from which place on, and over which parts.

use std::collections::VecDeque;

use arrayvec::ArrayVec;

use super::blend::{BORDER_SLOPE, Blend};
use super::capacity::MOST_PARTS;
use super::grid::Part;
use super::law::Law;
use super::node::Pace;
use super::path::{Path, Planned};
use super::piece::{Course, Piece, Spot};
use super::segment::Segment;

/// Largest number of places, at which the arm begins to slow down, that are tried as the start of a new plan.
const BRAKING_PLACES: usize = 3;

/// Knots ahead that are tried, by their distances: at first the next ones, then ever later ones, so that only an arm that can do
/// nothing else stops where it was told to go on.
const LATER_KNOTS: [usize; 9] = [1, 2, 3, 5, 8, 12, 18, 27, 40];

impl Path {
    /// Plans the path anew after a place from which on it has changed. Returns false and leaves the law as it is where
    /// no law continues the present motion of the arm.
    pub(super) fn plan(&mut self, changed: &Spot) -> bool {
        let first = self.first_begin(changed).filter(|first| first.spot <= *changed);
        let Some(first) = first else { return self.plan_later(0, changed) };
        let mut next = self.pieces.len().checked_sub(self.braking.0 + 1);
        for _ in 0..BRAKING_PLACES {
            let Some(near) = next.and_then(|piece| self.slows_from(piece, &first, changed)) else { break };
            if self.plan_from(&near) {
                return true;
            }
            next = self.slowed_before(near.pieces);
        }
        self.plan_from(&first) || self.plan_later(first.pieces, changed)
    }

    /// Plans the path anew from one of the next knots: where no law continues the present motion, one may from there.
    fn plan_later(&mut self, from: usize, changed: &Spot) -> bool {
        LATER_KNOTS
            .iter()
            .any(|ahead| self.begin_at(from + ahead, changed).is_some_and(|begin| self.plan_from(&begin)))
    }

    /// Returns a plan's begin at this piece; none where that is behind a place.
    fn begin_at(&self, piece: usize, changed: &Spot) -> Option<Begin> {
        let (spot, pace) = self.pieces.get(piece)?.at(0.0);
        (spot <= *changed).then_some(Begin { pieces: piece, time: self.time, spot, pace })
    }

    fn plan_from(&mut self, begin: &Begin) -> bool {
        let mut start = (begin.spot, begin.pace);
        let mut is_first = true;
        // One stretch after another; the first one may fail.
        loop {
            let mut stretch = Stretch::default();
            if stretch.take(&self.queue, self.left_behind, start.0).is_none() {
                return false;
            }
            let Stretch { parts, next } = &stretch;
            let mut law = self.law.take().unwrap_or_else(|| Box::new(Law::with_room(self.capacity)));
            let found = law.find(parts, start.1);
            let kept = if is_first { begin.pieces } else { self.pieces.len() };
            let has_room = kept + found.map_or(0, |()| law.cells()) <= self.capacity.pieces
                && (found.is_some() || !law.lacks_room());
            if is_first {
                // From a rest there is always a law, and a ramp of the override is over.
                let is_possible = has_room
                    && (start.1.is_rest()
                        || found.is_some()
                            && (self.scale.is_steady() || {
                                let kept = self.pieces.iter().take(begin.pieces).copied();
                                let mut course = Course::new(kept.chain(pieces(&law, parts)), begin.time);
                                self.keeps_limits(self.scale.ahead(), &mut course)
                            }));
                if !is_possible {
                    self.law = Some(law);
                    return false;
                }
                (self.time, is_first) = (begin.time, false);
                if begin.pieces == 0 {
                    self.spot = begin.spot;
                }
                self.pieces.truncate(begin.pieces);
                self.refinement.keep(begin.pieces);
            }
            // Without room the arm would reach an end that is none: its axes are compared with their ratings, and it brakes.
            if found.is_some() && has_room {
                self.pieces.extend(pieces(&law, parts));
            }
            self.law = Some(law);
            match next {
                Some(spot) => start = (*spot, Pace::REST),
                None => break,
            }
        }
        self.find_braking();
        true
    }

    /// Returns the earliest begin of a plan: the rest before a place, or the present place. None where the present
    /// motion cannot be changed at once.
    fn first_begin(&self, changed: &Spot) -> Option<Begin> {
        // A stretch that the arm has not reached.
        let mut first = changed.motion;
        while first > self.left_behind {
            let before = self.queue.get((first - 1 - self.left_behind) as usize)?;
            if before.corner.is_none() && !before.goes_on {
                break;
            }
            first -= 1;
        }
        if first > self.left_behind {
            let pieces = self.pieces.iter().take_while(|piece| piece.start.motion < first).count();
            let spot = Spot { motion: first, in_blend: false, way: 0.0 };
            if pieces > 0 {
                return Some(Begin { pieces, time: self.time, spot, pace: Pace::REST });
            }
        }
        let at_rest = Begin { pieces: 0, time: 0.0, spot: self.spot, pace: Pace::REST };
        let Some(front) = self.pieces.front() else { return Some(at_rest) };
        if self.time >= front.cell.duration && self.pieces.len() == 1 {
            return Some(at_rest);
        }
        let (spot, pace) = front.at(self.time);
        if pace.is_rest() {
            Some(Begin { spot, ..at_rest })
        } else if front.cell.is_from_rest() {
            // A cell that begins with a constant jerk is driven to its end.
            let (spot, pace) = front.at(front.cell.duration);
            Some(Begin { pieces: 1, time: self.time, spot, pace })
        } else if front.cell.is_to_rest() {
            None
        } else {
            Some(Begin { pieces: 0, time: 0.0, spot, pace })
        }
    }

    /// Returns where the arm begins to slow down before a piece, if that is not behind a place: if the path behind that
    /// place changes, the law changes from there on. None where that is no later than `first`.
    fn slows_from(&self, piece: usize, first: &Begin, changed: &Spot) -> Option<Begin> {
        let mut piece = piece;
        while piece > first.pieces {
            let (start, before) = (self.pieces.get(piece)?, self.pieces.get(piece - 1)?);
            if start.start <= *changed && !before.falls() {
                // The last cell before may become longer.
                return if piece > first.pieces + 1 { self.begin_at(piece - 1, changed) } else { None };
            }
            piece -= 1;
        }
        None
    }

    /// Returns the last piece before this one in which the acceleration falls; none where there is none.
    fn slowed_before(&self, piece: usize) -> Option<usize> {
        (0..piece).rev().find(|before| self.pieces.get(*before).is_some_and(Piece::falls))
    }

    pub(super) fn find_braking(&mut self) {
        self.braking = (0, f64::INFINITY);
        for piece in self.pieces.iter().rev() {
            match piece.cell.brakes_from() {
                Some(0.0) => self.braking.0 += 1,
                Some(time) => {
                    self.braking.1 = time;
                    return;
                }
                None => return,
            }
        }
    }
}

/// A stretch of the path: its parts up to the next rest.
#[derive(Default)]
pub(super) struct Stretch<'q> {
    pub(super) parts: ArrayVec<Part<'q>, MOST_PARTS>,
    /// The spot after that rest, if the path continues.
    pub(super) next: Option<Spot>,
}

impl<'q> Stretch<'q> {
    /// Takes the parts from a spot on. None where there are more than any queue has.
    pub(super) fn take(&mut self, queue: &'q VecDeque<Planned>, left_behind: u32, from: Spot) -> Option<()> {
        let mut unit = 1.0;
        let first = (from.motion - left_behind) as usize;
        for (index, planned) in queue.iter().enumerate().skip(first) {
            let motion = left_behind + index as u32;
            let here = (index == first).then_some(from);
            let Segment { curve, nodes, ratings, .. } = &planned.segment;
            let corner = planned.corner.as_ref();
            if !here.is_some_and(|spot| spot.in_blend) {
                let start = here.map_or(planned.start, |spot| spot.way);
                let end = curve.length() - corner.map_or(0.0, |corner| corner.from_zone);
                if end - start > 1e-12 * end {
                    let part = Part { nodes, ratings, from: start, to: end, unit, motion, in_blend: false };
                    self.parts.try_push(part).ok()?;
                }
            }
            if let Some(Blend { from_zone, to_zone, nodes, ratings, .. }) = corner {
                let start = here.filter(|spot| spot.in_blend).map_or(0.0, |spot| spot.way);
                // The unit of the stretch is that of the first part.
                let is_first = here.is_some_and(|spot| spot.in_blend);
                let rate = if is_first { 1.0 } else { unit / (BORDER_SLOPE * from_zone) };
                let part = Part { nodes, ratings, from: start, to: 1.0, unit: rate, motion, in_blend: true };
                self.parts.try_push(part).ok()?;
                unit = rate * BORDER_SLOPE * to_zone;
            } else if !planned.goes_on {
                let is_last = index + 1 == queue.len();
                let next = Spot { motion: motion + 1, in_blend: false, way: 0.0 };
                self.next = (!is_last).then_some(next);
                return Some(());
            }
        }
        Some(())
    }
}

/// Where a plan begins.
struct Begin {
    /// Pieces of the law that are kept.
    pieces: usize,
    /// Seconds since the start of the first piece.
    time: f64,
    /// Where the first new piece begins, and the pace there.
    spot: Spot,
    pace: Pace,
}

/// The pieces of a law that was found for these parts.
pub(super) fn pieces<'l>(law: &'l Law, parts: &'l [Part<'_>]) -> impl Iterator<Item = Piece> + 'l {
    parts.iter().zip(law.begins()).enumerate().flat_map(move |(index, (part, begin))| {
        let end = law.begins().get(index + 1).copied().unwrap_or(law.cells());
        let mut own = part.from;
        (*begin..end).map(move |knot| {
            let cell = law.cell(knot);
            let start = Spot { motion: part.motion, in_blend: part.in_blend, way: own };
            own += cell.length * part.unit;
            Piece { cell, start, unit: part.unit }
        })
    })
}
