//! The time law along one straight part of a path: from one speed to another over a given length, within limits.
//!
//! Everything about how speed changes is behind [`Profile`] and [`reachable_speed`]; the look-ahead knows no more.
//! The unit of length is the curve's own parameter: mm on a line, the share of the way point to point.

/// The limits of one motion, constant along it.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Limits {
    /// Highest speed, in units per second.
    pub speed: f64,
    /// Highest acceleration and deceleration, in units per second².
    pub acceleration: f64,
}

/// The highest speed that can be had `length` after (or before) a point that is passed at `speed`, the motion's own
/// limit of speed aside.
#[must_use]
pub fn reachable_speed(speed: f64, length: f64, limits: &Limits) -> f64 {
    (speed * speed + 2.0 * limits.acceleration * length).sqrt()
}

/// Speeding up, cruising, slowing down: acceleration-limited and time-optimal.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Profile {
    length: f64,
    from: f64,
    peak: f64,
    to: f64,
    acceleration: f64,
    /// Durations of the three phases, in s.
    up: f64,
    cruise: f64,
    down: f64,
}

impl Profile {
    /// Standing still at a point.
    pub const REST: Self = Self {
        length: 0.0,
        from: 0.0,
        peak: 0.0,
        to: 0.0,
        acceleration: 1.0,
        up: 0.0,
        cruise: 0.0,
        down: 0.0,
    };

    /// From speed `from` to speed `to` over `length`. Both must be reachable from each other; what rounding takes
    /// from that is made up by a deceleration that is as much higher.
    #[must_use]
    pub fn new(length: f64, from: f64, to: f64, limits: &Limits) -> Self {
        if length <= 0.0 {
            return Self { from, peak: from.max(to), to, ..Self::REST };
        }
        let fastest = from.max(to);
        let mut acceleration = limits.acceleration;
        let meeting = acceleration * length + (from * from + to * to) / 2.0;
        let peak = meeting.sqrt().min(limits.speed);
        let (peak, cruise_length) = if peak > fastest {
            (peak, (meeting - peak * peak) / acceleration)
        } else {
            let needed = (from * from - to * to).abs() / (2.0 * length);
            acceleration = acceleration.max(needed);
            (fastest, length - (from * from - to * to).abs() / (2.0 * acceleration))
        };
        Self {
            length,
            from,
            peak,
            to,
            acceleration,
            up: (peak - from) / acceleration,
            cruise: if peak > 0.0 { cruise_length.max(0.0) / peak } else { 0.0 },
            down: (peak - to) / acceleration,
        }
    }

    /// How long it takes, in s.
    #[must_use]
    pub fn duration(&self) -> f64 {
        self.up + self.cruise + self.down
    }

    /// When it starts to slow down, in s.
    #[must_use]
    pub fn braking_start(&self) -> f64 {
        self.up + self.cruise
    }

    /// Way and speed `time` seconds after the start; the end's from the end on.
    #[must_use]
    pub fn at(&self, time: f64) -> (f64, f64) {
        let a = self.acceleration;
        if time < self.up {
            let speed = self.from + a * time;
            ((self.from + speed) / 2.0 * time, speed)
        } else if time < self.up + self.cruise {
            ((self.from + self.peak) / 2.0 * self.up + self.peak * (time - self.up), self.peak)
        } else {
            // Counted back from the end, so that the end is met exactly.
            let left = (self.duration() - time).max(0.0);
            let speed = self.to + a * left;
            (self.length - (self.to + speed) / 2.0 * left, speed)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LIMITS: Limits = Limits { speed: 400.0, acceleration: 5000.0 };

    #[test]
    fn from_rest_to_rest_takes_length_over_speed_plus_speed_over_acceleration() {
        let profile = Profile::new(200.0, 0.0, 0.0, &LIMITS);
        assert!((profile.duration() - (200.0 / 400.0 + 400.0 / 5000.0)).abs() < 1e-12);
        assert!((profile.at(0.08).1 - 400.0).abs() < 1e-9);
    }

    #[test]
    fn a_short_way_never_comes_to_full_speed() {
        let profile = Profile::new(8.0, 0.0, 0.0, &LIMITS);
        assert!((profile.duration() - 2.0 * (8.0_f64 / 5000.0).sqrt()).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn way_and_speed_are_continuous_and_within_limits(
            length in 0.01..500.0_f64,
            from in 0.0..400.0_f64,
            share in 0.0..1.0_f64,
        ) {
            let lowest = (from * from - 2.0 * LIMITS.acceleration * length).max(0.0).sqrt();
            let to = lowest + share * (reachable_speed(from, length, &LIMITS).min(LIMITS.speed) - lowest);
            let profile = Profile::new(length, from, to, &LIMITS);
            let steps = 1000;
            let dt = profile.duration() / f64::from(steps);
            let (mut way, mut speed) = (0.0, from);
            for step in 1..=steps {
                let (next_way, next_speed) = profile.at(dt * f64::from(step));
                prop_assert!(next_speed <= LIMITS.speed + 1e-6);
                prop_assert!((next_speed - speed).abs() <= LIMITS.acceleration * dt * (1.0 + 1e-6) + 1e-9);
                prop_assert!((next_way - way - (speed + next_speed) / 2.0 * dt).abs() <= LIMITS.acceleration * dt * dt);
                (way, speed) = (next_way, next_speed);
            }
            prop_assert!((way - length).abs() < 1e-9 && (speed - to).abs() < 1e-9);
        }
    }
}
