//! The queue of motions as one path with one speed along it.
//!
//! Each motion is a *straight* part, driven by a [`Profile`], and the corner into the next one, passed at a constant
//! rate. The look-ahead goes backward over the queue, which ends at rest, then forward from what the arm does now.
//! What is driven stays as it was: a plan that is changed by one more motion starts at the present way and speed.

use std::collections::VecDeque;

use super::blend::{self, BORDER_SLOPE, Blend};
use super::curve::Curve;
use super::curved;
use super::profile::{Profile, reachable_speed};
use super::segment::Segment;
use crate::arm::{Arm, Joints, Violation};

/// Five motions that wait or run, and those whose corner is still being left.
const CAPACITY: usize = 8;

/// What float rounding may add to a speed before it counts as too high.
const ROUNDING: f64 = 1.0 + 1e-9;

/// A place on the path, by time.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Place {
    /// Which motion of the queue.
    index: usize,
    /// In the corner after its straight part.
    in_blend: bool,
    /// Seconds since the start of that part.
    time: f64,
}

impl Place {
    const START: Self = Self { index: 0, in_blend: false, time: 0.0 };
}

/// What came of one more motion.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Appended {
    /// It is on the path.
    Planned,
    /// It is on the path, but came too late for the corner before it, which is an exact stop.
    Late,
}

/// Whether a plan must be checked against the present speed.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Feasibility {
    /// A new corner may be too slow for it.
    Open,
    /// The arm was going to stop where this plan stops.
    Known,
}

#[derive(Clone, Debug)]
struct Planned {
    segment: Segment,
    /// Where its end would be left for a corner at the earliest, counted from the end.
    zone: f64,
    /// It will stop at its end, whatever comes.
    stops: bool,
    /// Where its straight part starts, in the curve's unit.
    from: f64,
    profile: Profile,
    blend: Option<Blend>,
    /// The next motion goes on as one curve with this one: no corner, no stop.
    goes_on: bool,
}

impl Planned {
    fn straight_length(&self) -> f64 {
        let zone = self.blend.map_or(0.0, |blend| blend.from_zone);
        (self.segment.curve.length() - zone - self.from).max(0.0)
    }
}

/// The motions that are accepted and not yet left behind.
#[derive(Clone, Debug)]
pub struct Path {
    queue: VecDeque<Planned>,
    place: Place,
    /// The joints at the start of the first motion.
    start: Joints,
    end: Joints,
    left_behind: u32,
}

impl Path {
    /// A path that ends where the arm stands.
    #[must_use]
    pub fn at_rest(joints: Joints) -> Self {
        Self {
            queue: VecDeque::with_capacity(CAPACITY),
            place: Place::START,
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
        let rate = self.queue.front().and_then(|front| front.blend).map_or(0.0, |blend| blend.rate);
        self.left_behind + u32::from(self.place.in_blend && self.place.time * rate >= 0.5)
    }

    /// Puts one more motion, which starts at [`end`](Self::end), at the end of the path. `last` says that none
    /// follows.
    pub fn append(&mut self, segment: Segment, last: bool, arm: &Arm) -> Appended {
        self.end = segment.end;
        let before = self.queue.len().checked_sub(1);
        self.queue.push_back(Planned {
            segment,
            zone: blend::wanted_zone(&segment, arm),
            stops: last || segment.approximation_mm == 0.0,
            from: 0.0,
            profile: Profile::REST,
            blend: None,
            goes_on: false,
        });
        self.take_up_speed();
        let open = before.filter(|before| self.queue.get(*before).is_some_and(|planned| !planned.stops));
        let Some(before) = open else {
            self.plan(Feasibility::Known);
            return Appended::Planned;
        };
        if let Some(appended) = self.go_on(before, arm) {
            return appended;
        }
        for share in [1.0, 0.5, 0.25] {
            let blend = match (self.queue.get(before), self.queue.back()) {
                (Some(before), Some(last)) => Blend::between(&before.segment, &last.segment, share, arm),
                _ => None,
            };
            self.set_blend(before, blend);
            if blend.is_none() {
                self.plan(Feasibility::Known);
                return Appended::Planned;
            }
            if self.plan(Feasibility::Open) {
                return Appended::Planned;
            }
        }
        self.set_blend(before, None);
        self.stop_after(before);
        self.plan(Feasibility::Known);
        Appended::Late
    }

    /// Makes the last motion and the one before it pieces of one spline, if both are motions of one. Both take their
    /// shape from each other, which is only possible until the arm comes to the first one.
    fn go_on(&mut self, before: usize, arm: &Arm) -> Option<Appended> {
        let (one, next) = (self.queue.get(before)?, self.queue.back()?);
        let (Curve::Spline(first), Curve::Spline(second)) = (&one.segment.curve, &next.segment.curve) else {
            return None;
        };
        let is_ahead = if before == 0 {
            !self.place.in_blend && one.from == 0.0 && self.place.time == 0.0 && one.profile.at(0.0).1 == 0.0
        } else {
            before > usize::from(self.place.in_blend)
        };
        let separate = (one.segment, next.segment);
        let joined = (is_ahead && first.goes_on_to(second)).then(|| {
            let shapes = (
                first.with_neighbours(first.before(), Some(*second.to())),
                second.with_neighbours(Some(*first.from()), None),
            );
            let corner = before.checked_sub(1).and_then(|index| self.queue.get(index));
            let start = corner.map_or(self.start, |corner| corner.segment.end);
            let one = curved::reshaped(&separate.0, shapes.0, &start, arm)?;
            let next = curved::reshaped(&separate.1, shapes.1, &one.end, arm)?;
            let old = corner.and_then(|corner| corner.blend);
            let new = corner
                .filter(|_| old.is_some())
                .and_then(|corner| Blend::between(&corner.segment, &one, 1.0, arm));
            Some(((one, next), old, new))
        });
        if let Some((pieces, old, new)) = joined.flatten() {
            self.set_pieces(before, pieces, true);
            if let Some(corner) = before.checked_sub(1).filter(|_| old.is_some()) {
                self.set_blend(corner, new);
            }
            if self.plan(Feasibility::Open) {
                return Some(Appended::Planned);
            }
            self.set_pieces(before, separate, false);
            if let Some(corner) = before.checked_sub(1).filter(|_| old.is_some()) {
                self.set_blend(corner, old);
            }
        }
        self.stop_after(before);
        self.plan(Feasibility::Known);
        Some(if is_ahead { Appended::Planned } else { Appended::Late })
    }

    fn set_pieces(&mut self, before: usize, pieces: (Segment, Segment), goes_on: bool) {
        self.end = pieces.1.end;
        if let Some(planned) = self.queue.get_mut(before) {
            (planned.segment, planned.goes_on) = (pieces.0, goes_on);
        }
        if let Some(planned) = self.queue.back_mut() {
            planned.segment = pieces.1;
        }
    }

    /// No motion will follow: the last one stops at its end, and that is as wanted.
    pub fn close(&mut self) {
        if let Some(last) = self.queue.back_mut() {
            last.stops = true;
        }
    }

    /// How far the path is driven `seconds` from now, and what is left of them if it ends before.
    #[must_use]
    pub fn ahead(&self, mut seconds: f64) -> (Place, f64) {
        let mut place = self.place;
        while let Some(planned) = self.queue.get(place.index) {
            let duration = match planned.blend {
                Some(blend) if place.in_blend => 1.0 / blend.rate,
                _ => planned.profile.duration(),
            };
            if place.time + seconds < duration {
                place.time += seconds;
                return (place, 0.0);
            }
            seconds = (place.time + seconds - duration).max(0.0);
            place = if planned.blend.is_some() && !place.in_blend {
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
        match (planned.blend, self.queue.get(place.index + 1)) {
            (Some(blend), Some(next)) if place.in_blend => {
                blend.joints(&planned.segment, &next.segment, place.time * blend.rate, arm, near)
            }
            _ => planned.segment.curve.joints(planned.from + planned.profile.at(place.time).0, arm, near),
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
        let way = front.from + front.profile.at(time).0;
        let in_zone = way >= front.segment.curve.length() - front.zone;
        if time < front.profile.braking_start() && !in_zone {
            return None;
        }
        front.stops = true;
        Some(self.left_behind)
    }

    /// Makes the present way and speed the start of the straight part, so that it can be planned anew.
    fn take_up_speed(&mut self) {
        if self.place.in_blend || self.place.time == 0.0 {
            return;
        }
        if let Some(front) = self.queue.front_mut() {
            let (way, speed) = front.profile.at(self.place.time);
            front.from += way;
            front.profile = Profile::new(0.0, speed, speed, &front.segment.limits);
            self.place.time = 0.0;
        }
    }

    fn set_blend(&mut self, index: usize, blend: Option<Blend>) {
        if let Some(planned) = self.queue.get_mut(index) {
            planned.blend = blend;
        }
        if let Some(next) = self.queue.get_mut(index + 1) {
            next.from = blend.map_or(0.0, |blend| blend.to_zone);
        }
    }

    fn stop_after(&mut self, index: usize) {
        if let Some(planned) = self.queue.get_mut(index) {
            planned.stops = true;
        }
    }

    /// Chooses the speed at every junction that is ahead: backward from the stop at the end, then forward from the
    /// present speed. Returns false, and changes nothing, if the arm is too fast for it already.
    fn plan(&mut self, feasibility: Feasibility) -> bool {
        let first = usize::from(self.place.in_blend);
        let (mut exits, mut entry_limit) = ([0.0; CAPACITY], 0.0_f64);
        for (index, planned) in self.queue.iter().enumerate().skip(first).rev() {
            let without_corner =
                if planned.goes_on { entry_limit.min(planned.segment.limits.speed) } else { 0.0 };
            let exit = planned.blend.map_or(without_corner, |blend| {
                BORDER_SLOPE
                    * blend.from_zone
                    * blend.max_rate.min(entry_limit / (BORDER_SLOPE * blend.to_zone))
            });
            if let Some(slot) = exits.get_mut(index) {
                *slot = exit;
            }
            let limits = &planned.segment.limits;
            entry_limit = reachable_speed(exit, planned.straight_length(), limits).min(limits.speed);
        }
        let mut speed = match self.queue.front() {
            Some(Planned { blend: Some(blend), .. }) if self.place.in_blend => {
                BORDER_SLOPE * blend.to_zone * blend.rate
            }
            Some(front) => front.profile.at(0.0).1,
            None => return true,
        };
        if feasibility == Feasibility::Open && speed > entry_limit * ROUNDING {
            return false;
        }
        for (planned, exit) in self.queue.iter_mut().zip(exits).skip(first) {
            let length = planned.straight_length();
            let exit = exit.min(reachable_speed(speed, length, &planned.segment.limits));
            planned.profile = Profile::new(length, speed, exit, &planned.segment.limits);
            speed = match &mut planned.blend {
                Some(blend) => {
                    blend.rate = exit / (BORDER_SLOPE * blend.from_zone);
                    BORDER_SLOPE * blend.to_zone * blend.rate
                }
                None if planned.goes_on => exit,
                None => 0.0,
            };
        }
        true
    }
}
