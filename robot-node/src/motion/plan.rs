//! The look-ahead: which speed at every junction, and which law in between.
//!
//! The path ahead is a row of parts, straight ones and corners by turns. It ends at rest. Backward over it goes the
//! highest speed from which the rest can still be driven; forward, from what the arm does now, the law of each part.
//!
//! An override lowers the speeds and nothing else: what is too fast for it is slowed down as fast as the limits allow.
//! At override 0 the arm stops as soon as it can, wherever that is. Within a part that is one change to rest; where a
//! part is too short for that, it slows down as far as it can and goes on in the next.

use super::profile::{Limits, Pace, Profile, fits, nearest_exit, reachable_speed};

/// Parts that a path has at most.
pub(super) const PARTS: usize = 16;

/// How far a law may end from the end of its part, as a share of its length, and still be said to end there.
const REST: f64 = 1e-9;

/// What float rounding may add to a speed before it counts as too high.
const ROUNDING: f64 = 1.0 + 1e-9;

/// One part of the path ahead, from where the arm is in it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Part {
    /// What is left of it, in its unit.
    pub(super) length: f64,
    pub(super) limits: Limits,
    /// The speed that an override is a share of.
    pub(super) programmed: f64,
    /// The speed in the next part's unit for each unit of speed in this one; 0 where the arm stops.
    pub(super) ratio: f64,
    pub(super) profile: Profile,
    /// When in that law the arm is where the part starts, in s.
    pub(super) time: f64,
}

/// Whether the arm, moving as it does now, can go on into these parts.
pub(super) fn is_feasible(parts: &[Part], pace: Pace) -> bool {
    let (Some(part), [exit, ..]) = (parts.first(), highest(parts, 1.0)) else { return true };
    // In the last moments of a part rounding leaves no other law than the present one. That one is always there.
    let left = part.profile.length() - part.profile.at(part.time).0;
    let ends_there =
        !part.profile.stops_short() && (left - part.length).abs() <= REST * part.profile.length();
    if ends_there && part.profile.exit() <= exit * ROUNDING {
        return true;
    }
    // A slower exit is none where the arm must not slow down for it, but speeding up can be left out.
    let slower = pace.settled_speed(&part.limits).min(exit);
    nearest_exit(pace, exit * ROUNDING, part.length, &part.limits, &[slower]).is_some()
}

/// Plans all parts anew from what the arm does in the first part's law. Returns false where that part keeps its law:
/// because nothing changes, or because none else leads to its end.
pub(super) fn plan(parts: &mut [Part], factor: f64) -> bool {
    let allowed = highest(parts, 1.0);
    let wanted = if factor < 1.0 { highest(parts, factor) } else { allowed };
    let mut pace = parts.first().map_or(Pace::REST, |part| part.profile.at(part.time).1);
    let mut is_new = true;
    for (index, (part, (allowed, wanted))) in parts.iter_mut().zip(allowed.iter().zip(&wanted)).enumerate() {
        if factor == 0.0 && fits(pace, 0.0, part.length, &part.limits) {
            part.take(Profile::stop(pace, &part.limits));
            return is_new;
        }
        let before = if index == 0 { part.profile.exit() } else { *allowed };
        let known = [before, *allowed, pace.settled_speed(&part.limits)];
        let exit = match nearest_exit(pace, *wanted, part.length, &part.limits, &known) {
            None if index == 0 => {
                is_new = false;
                part.profile.exit()
            }
            found => {
                let exit = found.unwrap_or(pace.speed);
                let limits = Limits { speed: part.speed(factor), ..part.limits };
                if !part.profile.leads_on(part.time, part.length, pace, exit, &limits) {
                    part.take(Profile::new(part.length, pace, exit, &limits));
                } else if index == 0 {
                    is_new = false;
                }
                exit
            }
        };
        pace = Pace::steady(exit * part.ratio);
    }
    is_new
}

/// How much lower limits may be than those of a part that goes on with another one as one part. Else both are planned
/// apart, with no acceleration where they meet.
const ALIKE: f64 = 0.9;

impl Part {
    /// Whether `next`, into which it goes on without a corner, can be planned as one part with it: the speed is the same,
    /// and little is lost by the lower acceleration and jerk of the two.
    pub(super) fn is_like(&self, next: &Self) -> bool {
        let is_near = |one: f64, other: f64| one.min(other) >= ALIKE * one.max(other);
        let (one, other) = (&self.limits, &next.limits);
        one.speed == other.speed
            && self.programmed == next.programmed
            && is_near(one.acceleration, other.acceleration)
            && is_near(one.jerk, other.jerk)
    }

    /// Makes it one part with the next one.
    pub(super) fn go_on(&mut self, next: &Self) {
        self.length += next.length;
        self.ratio = next.ratio;
        self.limits.acceleration = self.limits.acceleration.min(next.limits.acceleration);
        self.limits.jerk = self.limits.jerk.min(next.limits.jerk);
    }

    fn take(&mut self, profile: Profile) {
        (self.profile, self.time) = (profile, 0.0);
    }

    /// The highest speed with an override.
    fn speed(&self, factor: f64) -> f64 {
        self.limits.speed.min(self.programmed * factor)
    }
}

/// The highest speeds at the ends of all parts, backward over them.
fn highest(parts: &[Part], factor: f64) -> [f64; PARTS] {
    let mut exits = [0.0; PARTS];
    let mut next_entry = 0.0_f64;
    for (part, exit) in parts.iter().zip(&mut exits).rev() {
        let speed = part.speed(factor);
        *exit = if part.ratio > 0.0 { speed.min(next_entry / part.ratio) } else { 0.0 };
        next_entry = reachable_speed(*exit, part.length, &part.limits).min(speed);
    }
    exits
}
