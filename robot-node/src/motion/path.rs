//! The queue of motions as one path with one speed along it.
//!
//! Each motion is a *straight* part and the corner into the next one; both are driven by a [`Profile`]. What is driven
//! stays as it was: a plan that is changed by one more motion, or by another override, starts at the present way,
//! speed and acceleration.

use std::collections::VecDeque;

use arrayvec::ArrayVec;

use super::blend::{BORDER_SLOPE, Blend};
use super::plan::{self, PARTS, Part};
use super::profile::{Pace, Profile};
use super::segment::Segment;
use crate::arm::{Arm, Joints, Violation};

/// Five motions that wait or run, and those whose corner is still being left.
const CAPACITY: usize = PARTS / 2;

/// A place on the path, by time.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Place {
    /// Which motion of the queue.
    index: usize,
    /// In the corner after its straight part.
    pub(super) in_blend: bool,
    /// Seconds since the start of that part's law.
    pub(super) time: f64,
}

impl Place {
    const START: Self = Self { index: 0, in_blend: false, time: 0.0 };
}

/// A law, and where in its part it starts. Parts that go on as one curve have one law, of which each drives its own
/// time.
#[derive(Clone, Copy, Debug)]
pub(super) struct Law {
    /// Where the profile starts, in the part's unit; before the part, where it starts in an earlier one.
    pub(super) from: f64,
    pub(super) profile: Profile,
    /// When the profile enters the part and when it leaves it, in s.
    entry: f64,
    exit: f64,
}

impl Law {
    pub(super) const fn at_rest(from: f64) -> Self {
        Self { from, profile: Profile::REST, entry: 0.0, exit: 0.0 }
    }

    /// Way in the part and pace, `time` seconds after the part is entered.
    pub(super) fn at(&self, time: f64) -> (f64, Pace) {
        let (way, pace) = self.profile.at(self.entry + time);
        (self.from + way, pace)
    }

    fn way(&self, time: f64) -> f64 {
        self.at(time).0
    }

    /// How long the part takes, in s.
    fn duration(&self) -> f64 {
        self.exit - self.entry
    }

    /// Whether it stands still within the part.
    fn stops_short(&self) -> bool {
        self.profile.stops_short() && self.exit >= self.profile.duration()
    }
}

/// A corner and how it is passed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corner {
    pub(super) blend: Blend,
    pub(super) law: Law,
}

#[derive(Clone, Debug)]
pub(super) struct Planned {
    pub(super) segment: Segment,
    /// Where its end would be left for a corner at the earliest, counted from the end.
    pub(super) zone: f64,
    /// It will stop at its end, whatever comes.
    pub(super) stops: bool,
    /// Where the corner before it ends, in its curve's unit; 0 without one.
    pub(super) start: f64,
    pub(super) straight: Law,
    pub(super) corner: Option<Corner>,
    /// The next motion goes on as one curve with this one: no corner, no stop.
    pub(super) goes_on: bool,
}

impl Planned {
    const fn law(&self, in_blend: bool) -> &Law {
        match &self.corner {
            Some(corner) if in_blend => &corner.law,
            _ => &self.straight,
        }
    }

    const fn law_mut(&mut self, in_blend: bool) -> &mut Law {
        match &mut self.corner {
            Some(corner) if in_blend => &mut corner.law,
            _ => &mut self.straight,
        }
    }

    pub(super) fn blend(&self) -> Option<Blend> {
        self.corner.map(|corner| corner.blend)
    }
}

/// The motions that are accepted and not yet left behind.
#[derive(Debug)]
pub struct Path {
    pub(super) queue: VecDeque<Planned>,
    pub(super) place: Place,
    /// The override, 0…1.
    factor: f64,
    /// The joints at the start of the first motion.
    pub(super) start: Joints,
    pub(super) end: Joints,
    left_behind: u32,
}

impl Clone for Path {
    /// With room for as many motions, as the first one has: appending must not allocate.
    fn clone(&self) -> Self {
        let mut queue = VecDeque::with_capacity(CAPACITY);
        queue.extend(self.queue.iter().cloned());
        Self { queue, ..*self }
    }
}

impl Path {
    /// A path that ends where the arm stands.
    #[must_use]
    pub fn at_rest(joints: Joints) -> Self {
        Self {
            queue: VecDeque::with_capacity(CAPACITY),
            place: Place::START,
            factor: 1.0,
            start: joints,
            end: joints,
            left_behind: 0,
        }
    }

    /// Forgets all motions; the arm stands at `joints`.
    pub fn clear(&mut self, joints: Joints) {
        self.queue.clear();
        (self.place, self.left_behind) = (Place::START, 0);
        (self.start, self.end) = (joints, joints);
    }

    /// The joints at the end of all motions.
    #[must_use]
    pub const fn end(&self) -> &Joints {
        &self.end
    }

    /// Whether the end of all motions is reached.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.queue.is_empty()
    }

    /// The motion that the arm is in.
    #[must_use]
    pub fn current(&self) -> Option<&Segment> {
        self.queue.front().map(|planned| &planned.segment)
    }

    /// Both motions of the corner that the arm is in; none on a straight part.
    #[must_use]
    pub fn corner(&self) -> Option<[&Segment; 2]> {
        let (first, second) = (self.queue.front()?, self.queue.get(1)?);
        self.place.in_blend.then_some([&first.segment, &second.segment])
    }

    /// Motions that are executed since the last [`clear`](Self::clear). With a blend the middle of the corner, the
    /// point nearest to the target, is where a motion ends.
    #[must_use]
    pub fn executed(&self) -> u32 {
        let corner = self.queue.front().and_then(|front| front.corner).filter(|_| self.place.in_blend);
        self.left_behind + u32::from(corner.is_some_and(|corner| corner.law.way(self.place.time) >= 0.5))
    }

    /// Whether the arm stands still on its path, because the override is 0, and stays there until it is not.
    #[must_use]
    pub fn is_held(&self) -> bool {
        self.queue.front().is_some_and(|front| {
            let law = front.law(self.place.in_blend);
            law.stops_short() && self.place.time >= law.duration()
        })
    }

    /// Changes the override, 0…1: the share of the programmed speeds. At 0 the arm stops on the path as soon as the
    /// limits allow.
    pub fn set_override(&mut self, factor: f64) {
        // In the last moments of a stop no other law may lead on from it. Once the arm stands, one does.
        let stands = factor > 0.0 && self.is_held();
        if factor != self.factor || stands {
            self.factor = factor;
            self.plan();
        }
    }

    /// How far the path is driven `seconds` from now, and what is left of them if it ends before.
    #[must_use]
    pub fn ahead(&self, mut seconds: f64) -> (Place, f64) {
        let mut place = self.place;
        while let Some(planned) = self.queue.get(place.index) {
            let law = planned.law(place.in_blend);
            let duration = law.duration();
            if place.time + seconds < duration {
                place.time += seconds;
                return (place, 0.0);
            }
            if law.stops_short() {
                place.time = duration;
                return (place, 0.0);
            }
            seconds = (place.time + seconds - duration).max(0.0);
            place = if planned.corner.is_some() && !place.in_blend {
                Place { in_blend: true, time: 0.0, ..place }
            } else {
                Place { index: place.index + 1, in_blend: false, time: 0.0 }
            };
        }
        (place, seconds)
    }

    /// The joints at a place that [`ahead`](Self::ahead) gave; `near` is a point of the path close by.
    pub fn joints(&self, place: Place, arm: &Arm, near: &Joints) -> Result<Joints, Violation> {
        let Some(planned) = self.queue.get(place.index) else { return Ok(self.end) };
        let way = planned.law(place.in_blend).way(place.time);
        match (planned.blend(), self.queue.get(place.index + 1)) {
            (Some(blend), Some(next)) if place.in_blend => {
                blend.joints(&planned.segment, &next.segment, way, arm, near)
            }
            _ => planned.segment.curve.joints(way, arm, near),
        }
    }

    /// Goes to a place that [`ahead`](Self::ahead) gave. Returns the number, counted from 0, of the motion that
    /// thereby has reached its decision point without a successor: its blend is suppressed.
    pub fn go_to(&mut self, place: Place) -> Option<u32> {
        for _ in 0..place.index {
            if let Some(left) = self.queue.pop_front() {
                self.start = left.segment.end;
            }
            self.left_behind += 1;
        }
        self.place = Place { index: 0, ..place };
        self.decide()
    }

    /// The start of braking or of the zone, whichever is first, is where a motion must know what follows.
    fn decide(&mut self) -> Option<u32> {
        let time = self.place.time;
        let [front] = self.queue.make_contiguous() else { return None };
        if front.stops || self.place.in_blend {
            return None;
        }
        let Law { profile, entry, .. } = front.straight;
        let in_zone = front.straight.way(time) >= front.segment.curve.length() - front.zone;
        let brakes = !profile.stops_short() && entry + time >= profile.braking_start();
        if !brakes && !in_zone {
            return None;
        }
        front.stops = true;
        Some(self.left_behind)
    }

    /// What is ahead, part by part.
    fn ahead_of_now(&self) -> Ahead {
        let mut ahead = Ahead { pace: Pace::REST, parts: ArrayVec::new(), pieces: ArrayVec::new() };
        let mut goes_on = false;
        for (index, planned) in self.queue.iter().enumerate() {
            let in_blend = index == 0 && self.place.in_blend;
            let (time, Planned { segment, straight, .. }) =
                (if index == 0 { self.place.time } else { 0.0 }, planned);
            if index == 0 {
                ahead.pace = planned.law(in_blend).at(time).1;
            }
            let (zone, ratio) = match planned.blend() {
                Some(blend) => (blend.from_zone, 1.0 / (BORDER_SLOPE * blend.from_zone)),
                None => (0.0, if planned.goes_on { 1.0 } else { 0.0 }),
            };
            if !in_blend {
                let start = if index == 0 { straight.way(time) } else { planned.start };
                let (length, limits) = ((segment.curve.length() - zone - start).max(0.0), segment.limits);
                let part = Part {
                    length,
                    limits,
                    programmed: limits.speed,
                    ratio,
                    profile: straight.profile,
                    time: straight.entry + time,
                };
                ahead.add(part, start, goes_on);
            }
            goes_on = planned.goes_on;
            if let Some(Corner { blend, law }) = &planned.corner {
                let start = if in_blend { law.way(time) } else { 0.0 };
                let part = Part {
                    length: (1.0 - start).max(0.0),
                    limits: blend.limits,
                    programmed: blend.programmed_rate,
                    ratio: BORDER_SLOPE * blend.to_zone,
                    profile: law.profile,
                    time: law.entry + if in_blend { time } else { 0.0 },
                };
                ahead.add(part, start, false);
            }
        }
        ahead
    }

    /// Plans what is ahead anew if the arm can go on into it; returns false, and changes nothing, if it cannot.
    pub(super) fn plan_if_feasible(&mut self) -> bool {
        let ahead = self.ahead_of_now();
        let is_feasible = plan::is_feasible(&ahead.parts, ahead.pace);
        if is_feasible {
            self.take_plan(ahead);
        }
        is_feasible
    }

    /// Plans what is ahead anew, from what the arm does now.
    pub(super) fn plan(&mut self) {
        self.take_plan(self.ahead_of_now());
    }

    fn take_plan(&mut self, Ahead { mut parts, pieces, .. }: Ahead) {
        let is_new = plan::plan(&mut parts, self.factor);
        let in_blend = self.place.in_blend;
        let mut pieces = pieces.iter();
        let mut take = |law: &mut Law| {
            let Some(piece) = pieces.next() else { return };
            if piece.part > 0 || is_new {
                *law = piece.law(&parts[piece.part]);
            }
        };
        for (index, planned) in self.queue.iter_mut().enumerate() {
            if !(index == 0 && in_blend) {
                take(&mut planned.straight);
            }
            if planned.corner.is_some() {
                take(planned.law_mut(true));
            }
        }
        if is_new {
            self.place.time = 0.0;
        }
    }
}

/// The path ahead as it is planned.
struct Ahead {
    /// How the arm moves now.
    pace: Pace,
    parts: ArrayVec<Part, PARTS>,
    pieces: ArrayVec<Piece, PARTS>,
}

impl Ahead {
    /// Adds what is left of a straight part or of a corner from `start` on; to the part before, where it goes on with that.
    fn add(&mut self, part: Part, start: f64, goes_on: bool) {
        if self.pieces.is_full() {
            return;
        }
        let mut before = 0.0;
        match self.parts.last_mut() {
            Some(last) if goes_on && last.is_like(&part) => {
                before = last.length;
                last.go_on(&part);
            }
            _ => self.parts.push(part),
        }
        self.pieces.push(Piece { part: self.parts.len() - 1, before, start, length: part.length });
    }
}

/// A straight part or a corner as a piece of what is planned as one part.
struct Piece {
    part: usize,
    /// How much of that part is before it.
    before: f64,
    /// Where it starts, in its own unit.
    start: f64,
    length: f64,
}

impl Piece {
    /// Its law within that of the part.
    fn law(&self, part: &Part) -> Law {
        let Part { profile, time, .. } = *part;
        let begin = profile.at(time).0;
        let entry = if self.before == 0.0 { time } else { profile.time_at(begin + self.before) };
        let is_last = self.before + self.length >= part.length;
        let exit =
            if is_last { profile.duration() } else { profile.time_at(begin + self.before + self.length) };
        Law { from: self.start - self.before - begin, profile, entry, exit }
    }
}
