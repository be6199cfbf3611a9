//! The queue of motions as one path with one speed along it.
//!
//! Each motion is a *straight* part and the corner into the next one. From one rest to the next, the parts make a
//! stretch, which has one [`Law`] over all of them. One more motion changes the law only from the place on where the
//! arm would have begun to brake for the former end, or from the present place, speed and acceleration. The override is
//! a [`TimeScale`] and changes no law.

use std::collections::VecDeque;

use super::blend::Blend;
use super::capacity::Capacity;
use super::grid::Part;
use super::law::Law;
use super::node::Pace;
use super::nodes::Room;
use super::piece::{Piece, Spot};
use super::refinement::Refinement;
use super::segment::Segment;
use super::time_scale::TimeScale;
use crate::arm::{Arm, Frame, Joints, Violation};

/// A place on the path, by time: a cell of its law, and the seconds since its start.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Place {
    cell: usize,
    time: f64,
    /// Time to go there, in s.
    seconds: f64,
    /// Whether the arm comes to rest on the way there: from the rest on the override may change at once.
    settled: bool,
}

#[derive(Clone, Debug)]
pub(super) struct Planned {
    pub(super) segment: Segment,
    /// Length before its end on which it may be left for a corner.
    pub(super) zone: f64,
    /// Whether it stops at its end, whatever follows.
    pub(super) stops: bool,
    /// Where the corner before it ends, in its curve's unit; 0 without one.
    pub(super) start: f64,
    pub(super) corner: Option<Blend>,
    /// Whether the next motion is one curve with this one: no corner, no stop.
    pub(super) goes_on: bool,
}

/// Changes of a batch so far, and the path before it.
#[derive(Clone, Debug)]
pub(super) struct Batch {
    pub(super) motions: usize,
    pub(super) end: Joints,
    /// The two motions before the batch, whose end it may change: the last one first.
    pub(super) last: [Option<Planned>; 2],
    /// The first place of the path that has changed.
    pub(super) changed: Option<Spot>,
    /// Set where a motion came too late for the one before it.
    pub(super) is_late: bool,
}

/// The motions that are accepted and not yet left behind.
#[derive(Debug)]
pub struct Path {
    /// The robot's cycle, in s.
    pub(super) cycle_s: f64,
    pub(super) capacity: Capacity,
    pub(super) queue: VecDeque<Planned>,
    /// The motions that this cycle has appended and not yet planned.
    pub(super) batch: Option<Batch>,
    /// The law from the present piece to the end.
    pub(super) pieces: VecDeque<Piece>,
    /// Memory for planning the law of one stretch; taken out meanwhile.
    pub(super) law: Option<Box<Law>>,
    pub(super) refinement: Refinement,
    /// Seconds since the start of the first piece.
    pub(super) time: f64,
    /// The place of the arm.
    pub(super) spot: Spot,
    /// The number of pieces at the end of the law in which the arm only brakes, and the time in the piece before from
    /// which it brakes.
    pub(super) braking: (usize, f64),
    /// The override, 0…1, and the one in effect, which follows it.
    pub(super) factor: f64,
    pub(super) scale: TimeScale,
    /// The joints at the start of the first motion.
    pub(super) start: Joints,
    pub(super) end: Joints,
    pub(super) left_behind: u32,
    /// Seconds of all laws that the arm has driven, of former paths too.
    driven_s: f64,
    /// The tool, and the inverse of the base, of the motion at whose end the path ended.
    last_frames: Option<(Frame, Frame)>,
    /// Room for the nodes of the queue, which are dropped before it.
    _room: Room,
}

impl Clone for Path {
    /// A copy has no room of its own: it allocates what it needs. It drives on with the law that there is.
    fn clone(&self) -> Self {
        let Self {
            cycle_s,
            capacity,
            time,
            spot,
            braking,
            factor,
            scale,
            start,
            end,
            left_behind,
            driven_s,
            last_frames,
            ..
        } = *self;
        let (queue, pieces) = (self.queue.clone(), self.pieces.clone());
        let (law, refinement, _room) = (None, Refinement::none(), Room::none());
        Self {
            cycle_s,
            capacity,
            queue,
            batch: None,
            pieces,
            law,
            refinement,
            time,
            spot,
            braking,
            factor,
            scale,
            start,
            end,
            left_behind,
            driven_s,
            last_frames,
            _room,
        }
    }
}

impl Path {
    /// A path that ends where the arm stands, and is followed in cycles of `cycle_s` seconds. It has room for this many motions
    /// that wait or run, at most [`MOST_MOTIONS`](super::MOST_MOTIONS), and for those whose corner is still being left.
    #[must_use]
    pub fn at_rest(joints: Joints, cycle_s: f64, motions: usize) -> Self {
        let capacity = Capacity::of(motions);
        Self {
            cycle_s,
            capacity,
            batch: None,
            queue: VecDeque::with_capacity(capacity.parts / 2),
            pieces: VecDeque::with_capacity(capacity.pieces),
            law: Some(Box::new(Law::with_room(capacity))),
            refinement: Refinement::with_room(capacity),
            time: 0.0,
            spot: Spot { motion: 0, in_blend: false, way: 0.0 },
            braking: (0, 0.0),
            factor: 1.0,
            scale: TimeScale::steady(1.0),
            start: joints,
            end: joints,
            left_behind: 0,
            driven_s: 0.0,
            last_frames: None,
            _room: Room::with_lists(capacity.lists),
        }
    }

    /// Forgets all motions; the arm stands at `joints`.
    pub fn clear(&mut self, joints: Joints) {
        self.queue.clear();
        self.pieces.clear();
        self.refinement.clear();
        (self.time, self.left_behind) = (0.0, 0);
        self.spot = Spot { motion: 0, in_blend: false, way: 0.0 };
        self.scale = TimeScale::steady(self.factor);
        (self.start, self.end) = (joints, joints);
    }

    /// The joints at the end of all motions.
    #[must_use]
    pub const fn end(&self) -> &Joints {
        &self.end
    }

    /// Returns true if a deep queue has no room for the pieces of another motion: it waits until the arm has left some. The five slots always
    /// have room.
    #[must_use]
    pub fn is_full(&self) -> bool {
        let Capacity { knots, pieces, .. } = self.capacity;
        self.capacity.is_deep() && self.pieces.len() + 2 * knots > pieces
    }

    /// Whether the end of all motions is reached.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.queue.is_empty()
    }

    /// Returns the tool of the motion that the arm left last, in the flange, and the inverse of its base. The arm may have
    /// passed that motion within one cycle, so that it was never the present one.
    #[must_use]
    pub const fn last_frames(&self) -> Option<(Frame, Frame)> {
        self.last_frames
    }

    /// Returns the seconds of the law that the arm has driven so far, on this path and on those before. At rest, at override 0 and
    /// without a path none pass. What was driven counts as it was driven, whatever is planned later.
    #[must_use]
    pub const fn driven_s(&self) -> f64 {
        self.driven_s
    }

    /// The motion that the arm is in.
    #[must_use]
    pub fn current(&self) -> Option<&Segment> {
        self.queue.front().map(|planned| &planned.segment)
    }

    /// Whether the arm is in the corner after its motion.
    pub(super) const fn in_blend(&self) -> bool {
        self.spot.in_blend
    }

    /// Whether the arm rests where its motion begins.
    pub(super) fn is_at_start(&self) -> bool {
        !self.spot.in_blend && self.spot.way == 0.0 && self.rests()
    }

    /// Whether the law has the arm at rest here.
    #[must_use]
    pub fn rests(&self) -> bool {
        self.pieces.front().is_none_or(|piece| piece.at(self.time).1.is_rest())
    }

    /// Both motions of the corner that the arm is in; none on a straight part.
    #[must_use]
    pub fn corner(&self) -> Option<[&Segment; 2]> {
        let (first, second) = (self.queue.front()?, self.queue.get(1)?);
        self.spot.in_blend.then_some([&first.segment, &second.segment])
    }

    /// Where on both motions of the corner the arm is, and the highest speeds that are programmed for them, in the units
    /// of their curves (mm and mm/s, point to point shares of the way); none on a straight part.
    #[must_use]
    pub fn corner_ways(&self) -> Option<[(f64, f64); 2]> {
        let (first, second) = (self.queue.front()?, self.queue.get(1)?);
        let blend = first.corner.as_ref().filter(|_| self.spot.in_blend)?;
        let (from, to) = blend.ways_at(&first.segment, self.spot.way);
        Some([(from, first.segment.programmed_speed()), (to, second.segment.programmed_speed())])
    }

    /// Motions that are executed since the last [`clear`](Self::clear). With a blend the middle of the corner, the
    /// point nearest to the target, is where a motion ends.
    #[must_use]
    pub fn executed(&self) -> u32 {
        self.left_behind + u32::from(self.spot.in_blend && self.spot.way >= 0.5)
    }

    /// Whether the arm stands still on its path, because the override is 0, and stays there until it is not.
    #[must_use]
    pub fn is_held(&self) -> bool {
        self.scale.is_steadily(0.0) && self.factor == 0.0 && !self.queue.is_empty()
    }

    /// The part that the arm is in, where it is in that, and how fast by the law.
    pub(super) fn here(&self) -> Option<(Part<'_>, Spot, Pace)> {
        let (spot, pace) = self.pieces.front()?.at(self.time);
        Some((self.part(&spot)?, spot, pace))
    }

    /// The part of a place.
    pub(super) fn part(&self, spot: &Spot) -> Option<Part<'_>> {
        let planned = self.queue.get(spot.motion.checked_sub(self.left_behind)? as usize)?;
        let (nodes, ratings) = match &planned.corner {
            Some(blend) if spot.in_blend => (&blend.nodes[..], &blend.ratings),
            _ => (&planned.segment.nodes[..], &planned.segment.ratings),
        };
        let Spot { motion, in_blend, way } = *spot;
        Some(Part { nodes, ratings, from: way, to: way, unit: 1.0, motion, in_blend })
    }

    /// Returns the place on the path after `seconds`, and the rest of the seconds if the path ends before. The law's time
    /// passes by `more_s` more than the override lets it.
    #[must_use]
    pub fn ahead(&self, seconds: f64, more_s: f64) -> (Place, f64) {
        let law_s = (self.scale.law_seconds(seconds) + more_s).max(0.0);
        let mut time = self.time + law_s;
        let (mut left, mut settled) = (None, false);
        for (cell, piece) in self.pieces.iter().enumerate() {
            if time < piece.cell.duration {
                return (Place { cell, time, seconds, settled }, 0.0);
            }
            time -= piece.cell.duration;
            if piece.cell.is_to_rest() && !self.scale.is_steadily(self.factor) && !settled {
                // From the rest on the override is in effect.
                let rest = self.scale.seconds_until(law_s - time, seconds);
                time = (seconds - rest) * self.factor;
                (left, settled) = (Some(seconds - rest), true);
            }
        }
        let share = self.scale.target();
        let left = left.unwrap_or(if share > 0.0 { time / share } else { 0.0 });
        (Place { cell: self.pieces.len(), time: 0.0, seconds, settled }, left.clamp(0.0, seconds))
    }

    /// Returns how many more of the law's seconds than the override lets pass may pass on the way to a place that
    /// [`ahead`](Self::ahead) gave, so that the arm is not faster there than programmed.
    pub(super) fn most_more(&self, seconds: f64, place: &Place) -> f64 {
        let faster = |piece: &Piece, time: f64| {
            let (spot, pace) = piece.at(time);
            Some(self.part(&spot)?.programmed(spot.way)? / pace.square.max(0.0).sqrt())
        };
        let here = self.pieces.front().and_then(|piece| faster(piece, self.time));
        let there = self.pieces.get(place.cell).and_then(|piece| faster(piece, place.time));
        let least = [here, there].into_iter().flatten().fold(f64::INFINITY, f64::min);
        (least - 1.0) * self.scale.law_seconds(seconds)
    }

    /// The joints at a place that [`ahead`](Self::ahead) gave; `near` is a point of the path close by.
    pub fn joints(&self, place: Place, arm: &Arm, near: &Joints) -> Result<Joints, Violation> {
        let Some(piece) = self.pieces.get(place.cell) else { return Ok(self.end) };
        let (spot, _) = piece.at(place.time);
        let index = (spot.motion - self.left_behind) as usize;
        let Some(planned) = self.queue.get(index) else { return Ok(self.end) };
        match (&planned.corner, self.queue.get(index + 1)) {
            (Some(blend), Some(next)) if spot.in_blend => {
                blend.joints(&planned.segment, &next.segment, spot.way, arm, near)
            }
            _ => planned.segment.curve.joints(spot.way, arm, near),
        }
    }

    /// Goes to a place that [`ahead`](Self::ahead) gave. Returns the number, counted from 0, of the motion that
    /// thereby has reached its decision point without a successor: its blend is suppressed.
    pub fn go_to(&mut self, place: Place) -> Option<u32> {
        let left = place.cell.min(self.pieces.len());
        let passed: f64 = self.pieces.drain(..left).map(|piece| piece.cell.duration).sum();
        self.driven_s += passed + place.time - self.time;
        self.refinement.leave(left);
        self.time = place.time;
        self.scale.advance(place.seconds);
        if place.settled {
            self.scale = TimeScale::steady(self.factor);
        }
        match self.pieces.front() {
            Some(piece) => {
                self.spot = piece.at(place.time).0;
                let index = self.spot.motion - self.left_behind;
                (0..index).for_each(|_| self.leave_motion());
            }
            None => {
                while !self.queue.is_empty() {
                    self.leave_motion();
                }
                self.spot = Spot { motion: self.left_behind, in_blend: false, way: 0.0 };
            }
        }
        self.decide()
    }

    fn leave_motion(&mut self) {
        if let Some(left) = self.queue.pop_front() {
            self.start = left.segment.end;
            self.last_frames = Some((left.segment.tool, left.segment.base_inverse));
        }
        self.left_behind += 1;
    }

    /// Stops the last motion at its end where the arm begins to brake or reaches the zone without a successor,
    /// whichever is first.
    fn decide(&mut self) -> Option<u32> {
        if self.queue.len() != 1 {
            return None;
        }
        let (cells, time) = self.braking;
        let brakes = self.pieces.len() <= cells || (self.pieces.len() == cells + 1 && self.time >= time);
        let front = self.queue.front_mut()?;
        let in_zone = self.spot.way >= front.segment.curve.length() - front.zone;
        if front.stops || self.spot.in_blend || !(brakes || in_zone) {
            return None;
        }
        front.stops = true;
        Some(self.left_behind)
    }
}
