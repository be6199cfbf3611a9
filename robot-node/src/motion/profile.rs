//! The time law along one part of a path: from one speed to another over a given length, within limits of speed,
//! acceleration and jerk.
//!
//! [`Change`] goes from one speed to another in the shortest time: the acceleration ramps up, stays, ramps down.
//! [`Profile`] is a change to a peak speed, a cruise and a change to the speed at the end. It ends without
//! acceleration, so that parts can follow each other; it may start with one, so that a plan can be made anew at any
//! moment. For these ends it is time-optimal.
//!
//! The unit of length is the part's own parameter: mm on a line, the share of the way point to point, the share of
//! its time in a corner.

/// What rounding may add to a way before it counts as too long for its part, as a share of it.
const ROUNDING: f64 = 1e-9;

/// How near a law that is searched for comes to its length, as a share of it.
const ACCURACY: f64 = 1e-13;

/// Steps in which a speed is searched for; each at least halves what is left.
const STEPS: usize = 80;

/// The limits of one part of a path, constant along it.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Limits {
    /// Highest speed, in units per second.
    pub speed: f64,
    /// Highest acceleration and deceleration, in units per second².
    pub acceleration: f64,
    /// Highest jerk, in units per second³.
    pub jerk: f64,
}

/// How the arm moves along a part at one moment.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Pace {
    /// In units per second.
    pub speed: f64,
    /// In units per second².
    pub acceleration: f64,
}

impl Pace {
    /// Standing still.
    pub const REST: Self = Self::steady(0.0);

    /// At a constant speed.
    #[must_use]
    pub const fn steady(speed: f64) -> Self {
        Self { speed, acceleration: 0.0 }
    }

    /// The speed that is had when the acceleration is taken back as fast as possible.
    #[must_use]
    pub fn settled_speed(&self, limits: &Limits) -> f64 {
        self.speed + self.acceleration * self.acceleration.abs() / (2.0 * limits.jerk)
    }
}

/// The shortest change from one pace to a constant speed.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Change {
    from: Pace,
    to: f64,
    /// Signed: positive to speed up.
    jerk: f64,
    /// Durations of the three phases, in s: jerk, none, jerk the other way.
    phases: [f64; 3],
}

impl Change {
    /// From a pace to a constant speed.
    #[must_use]
    pub fn new(from: Pace, to: f64, limits: &Limits) -> Self {
        let settled = from.settled_speed(limits);
        let sign = if to >= settled { 1.0 } else { -1.0 };
        let (start, change) = (sign * from.acceleration, sign * (to - from.speed));
        let most = limits.acceleration.max(start.abs());
        // Up to the highest acceleration and back to none, if nothing is in between.
        let highest = (limits.jerk * change + start * start / 2.0).max(0.0).sqrt().max(start);
        let (highest, hold) = if highest > most {
            let without_hold = (2.0 * most * most - start * start) / (2.0 * limits.jerk);
            (most, (change - without_hold).max(0.0) / most)
        } else {
            (highest, 0.0)
        };
        let phases = [(highest - start) / limits.jerk, hold, highest / limits.jerk];
        Self { from, to, jerk: sign * limits.jerk, phases }
    }

    /// How long it takes, in s.
    #[must_use]
    pub fn duration(&self) -> f64 {
        self.phases.iter().sum()
    }

    /// How far it goes.
    #[must_use]
    pub fn way(&self) -> f64 {
        if self.from.acceleration == 0.0 {
            // Both ramps are alike, and so the mean speed is in the middle.
            return (self.from.speed + self.to) / 2.0 * self.duration();
        }
        let [up, hold, down] = self.phases;
        let (first, pace) = after(self.from, self.jerk, up);
        let (second, pace) = after(pace, 0.0, hold);
        first + second + after(pace, -self.jerk, down).0
    }

    /// Way and pace `time` seconds after the start.
    #[must_use]
    pub fn at(&self, time: f64) -> (f64, Pace) {
        let [up, hold, down] = self.phases;
        if time <= up {
            return after(self.from, self.jerk, time);
        }
        let (first, pace) = after(self.from, self.jerk, up);
        if time <= up + hold {
            let (second, pace) = after(pace, 0.0, time - up);
            return (first + second, pace);
        }
        let left = self.duration() - time;
        if left <= 0.0 {
            return (self.way(), Pace::steady(self.to));
        }
        let (second, pace) = after(pace, 0.0, hold);
        let (third, pace) = after(pace, -self.jerk, down - left);
        (first + second + third, pace)
    }
}

/// Way and pace after `time` seconds of constant jerk.
fn after(from: Pace, jerk: f64, time: f64) -> (f64, Pace) {
    let Pace { speed, acceleration } = from;
    let way = ((jerk / 6.0 * time + acceleration / 2.0) * time + speed) * time;
    let speed = (jerk / 2.0 * time + acceleration) * time + speed;
    (way, Pace { speed, acceleration: acceleration + jerk * time })
}

/// Whether a change to `to` fits into `length`.
#[must_use]
pub(super) fn fits(from: Pace, to: f64, length: f64, limits: &Limits) -> bool {
    Change::new(from, to, limits).way() <= length * (1.0 + ROUNDING)
}

/// The highest speed that can be had `length` after (or before) a point that is passed at a constant `speed`, the
/// part's own limit of speed aside.
#[must_use]
pub fn reachable_speed(speed: f64, length: f64, limits: &Limits) -> f64 {
    if length <= 0.0 {
        return speed;
    }
    let Limits { acceleration, jerk, .. } = *limits;
    // With phases of constant acceleration: a quadratic equation of the change.
    let ramp = acceleration / jerk;
    let half = speed + ramp * acceleration / 2.0;
    let rest = 2.0 * acceleration * (speed * ramp - length);
    let change = -rest / (half + (half * half - rest).max(0.0).sqrt());
    if change >= acceleration * ramp {
        return speed + change;
    }
    // Without: x³ + 2·speed·x = length·√jerk of its root x. From above, Newton's method comes down to it.
    let known = length * jerk.sqrt();
    let mut root = libm::cbrt(known).min(if speed > 0.0 { known / (2.0 * speed) } else { f64::INFINITY });
    for _ in 0..8 {
        let square = root * root;
        root -= ((square + 2.0 * speed) * root - known) / (3.0 * square + 2.0 * speed);
    }
    speed + root * root
}

/// The speed nearest to `wanted` that can be had at the end of `length`: `wanted` itself, or between it and the first
/// of the `known` ones that can. None if none can.
#[must_use]
pub(super) fn nearest_exit(
    from: Pace,
    wanted: f64,
    length: f64,
    limits: &Limits,
    known: &[f64],
) -> Option<f64> {
    if from.acceleration == 0.0 && wanted >= from.speed {
        return Some(wanted.min(reachable_speed(from.speed, length, limits)));
    }
    if fits(from, wanted, length, limits) {
        return Some(wanted);
    }
    let mut kept = *known.iter().find(|speed| fits(from, **speed, length, limits))?;
    let mut broken = wanted;
    for _ in 0..STEPS {
        let middle = (kept + broken) / 2.0;
        if middle == kept || middle == broken {
            break;
        }
        if fits(from, middle, length, limits) { kept = middle } else { broken = middle }
    }
    Some(kept)
}

/// A change to the peak speed, a cruise, a change to the speed at the end.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Profile {
    length: f64,
    up: Change,
    /// How long the peak speed is held, in s.
    cruise: f64,
    down: Change,
    /// What rounding left too long is spread evenly: the way of the law times this is the way.
    scale: f64,
    /// It stands still at its end, which is not the end of its part.
    stops_short: bool,
    /// The highest speed that it was made for.
    limit: f64,
}

impl Profile {
    /// Standing still at a point.
    pub const REST: Self = {
        let change = Change { from: Pace::REST, to: 0.0, jerk: 1.0, phases: [0.0; 3] };
        Self {
            length: 0.0,
            up: change,
            cruise: 0.0,
            down: change,
            scale: 1.0,
            stops_short: false,
            limit: 0.0,
        }
    };

    /// From a pace to the constant speed `to` over `length`, which [`Change`] must fit into.
    #[must_use]
    pub fn new(length: f64, from: Pace, to: f64, limits: &Limits) -> Self {
        let with_peak = |peak| {
            let (up, down) = (Change::new(from, peak, limits), Change::new(Pace::steady(peak), to, limits));
            (up.way() + down.way(), up, down)
        };
        let highest = limits.speed.max(to);
        let mut best = with_peak(highest);
        // Only the highest speed is held.
        let mut cruise = if best.0 < length { (length - best.0) / highest } else { 0.0 };
        if best.0 > length {
            // Where the acceleration is taken back at once, the rest is longer the higher the peak. Below, the arm
            // already slows down: the bracket holds nevertheless, from the end's speed on.
            let settled = from.settled_speed(limits);
            let starts_settled =
                settled > to && settled < highest && with_peak(settled).0 <= length * (1.0 + ROUNDING);
            let lowest = if starts_settled { settled } else { to };
            let top = if !starts_settled && settled > to { settled.min(highest) } else { highest };
            best = longest(length, lowest, top, with_peak);
            cruise = 0.0;
        }
        let (way, up, down) = best;
        let scale = if cruise == 0.0 && way > 0.0 { length / way } else { 1.0 };
        Self { length, up, cruise, down, scale, stops_short: false, limit: limits.speed }
    }

    /// To rest as fast as possible, wherever that is.
    #[must_use]
    pub fn stop(from: Pace, limits: &Limits) -> Self {
        let up = Change::new(from, 0.0, limits);
        Self { length: up.way(), up, stops_short: true, ..Self::REST }
    }

    /// Whether what is left of it after `time` is the law for this task as well.
    #[must_use]
    pub(super) fn leads_on(&self, time: f64, length: f64, from: Pace, to: f64, limits: &Limits) -> bool {
        let (way, pace) = self.at(time);
        !self.stops_short
            && self.limit == limits.speed
            && self.down.to == to
            && pace == from
            && (self.length - way - length).abs() <= length * ROUNDING
    }

    /// Whether it stands still at its end, wherever in its part that is.
    #[must_use]
    pub const fn stops_short(&self) -> bool {
        self.stops_short
    }

    /// How far it goes.
    #[must_use]
    pub const fn length(&self) -> f64 {
        self.length
    }

    /// How long it takes, in s.
    #[must_use]
    pub fn duration(&self) -> f64 {
        self.braking_start() + self.down.duration()
    }

    /// When it starts to change from its peak speed to that at its end, in s.
    #[must_use]
    pub fn braking_start(&self) -> f64 {
        self.up.duration() + self.cruise
    }

    /// When it is at `way`, in s.
    #[must_use]
    pub fn time_at(&self, way: f64) -> f64 {
        let (mut early, mut late) = (0.0, self.duration());
        let mut time = late * (way / self.length).clamp(0.0, 1.0);
        // Newton's method within a bracket.
        for _ in 0..STEPS {
            let (at, pace) = self.at(time);
            let off = at - way;
            if off.abs() <= self.length * ACCURACY {
                break;
            }
            *if off > 0.0 { &mut late } else { &mut early } = time;
            let next = time - off / pace.speed;
            time = if next > early && next < late { next } else { (early + late) / 2.0 };
        }
        time
    }

    /// The speed at its end.
    #[must_use]
    pub const fn exit(&self) -> f64 {
        self.down.to
    }

    /// Way and pace `time` seconds after the start; the end's from the end on.
    #[must_use]
    pub fn at(&self, time: f64) -> (f64, Pace) {
        let (up, braking) = (self.up.duration(), self.braking_start());
        if time <= up {
            let (way, pace) = self.up.at(time);
            (way * self.scale, pace)
        } else if time < braking {
            (self.up.way() + self.up.to * (time - up), Pace::steady(self.up.to))
        } else {
            // Counted back from the end, so that the end is met exactly.
            let (way, pace) = self.down.at(time - braking);
            (self.length - (self.down.way() - way) * self.scale, pace)
        }
    }
}

type Law = (f64, Change, Change);

/// The law whose way is `length`, with a peak between `lowest`, whose law is not longer, and `highest`, whose is longer.
fn longest(length: f64, lowest: f64, highest: f64, law: impl Fn(f64) -> Law) -> Law {
    // The way grows with the root of what the peak is above the lowest one: over that root it is nearly straight.
    let at = |root: f64| law(lowest + root * root);
    let (mut inside, mut outside) = (0.0, (highest - lowest).max(0.0).sqrt());
    let mut best = at(inside);
    let (mut under, mut over) = (best.0 - length, at(outside).0 - length);
    if under >= 0.0 {
        return best;
    }
    // Ridders' method: it halves the bracket at least, and soon doubles the digits.
    for _ in 0..STEPS {
        let middle = (inside + outside) / 2.0;
        let halfway = at(middle);
        let off = halfway.0 - length;
        let root = middle - (middle - inside) * off / (off * off - under * over).sqrt();
        let next = at(root);
        let next_off = next.0 - length;
        for (law, off) in [(halfway, off), (next, next_off)] {
            if off.abs() < (best.0 - length).abs() {
                best = law;
            }
        }
        if (best.0 - length).abs() <= length * ACCURACY || middle == inside || middle == outside {
            break;
        }
        for (root, off) in [(middle, off), (root, next_off)] {
            // Of two points on one side, the one that is nearer to the other side counts.
            let (low, high) = (inside.min(outside), inside.max(outside));
            if !(low..=high).contains(&root) {
                continue;
            }
            if off < 0.0 {
                (inside, under) = (root, off);
            } else {
                (outside, over) = (root, off);
            }
        }
    }
    best
}

#[cfg(test)]
mod tests;
