//! A motor with its position control, simulated. Between two targets the demand moves at a constant speed for one
//! interpolation period; the motor follows it within its speed and the acceleration that its torque gives.

use machine::Duration;

/// Share of the acceleration with which the motor brakes as it catches up; the rest is for changes of the demand.
const CATCH_UP_SHARE: f64 = 0.5;

/// Position and speed of a shaft.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Motor {
    /// In increments.
    position: f64,
    /// In increments/s.
    speed: f64,
    /// Highest speed in increments/s.
    max_speed: f64,
    /// Whether something holds the shaft.
    pub(crate) blocked: bool,
    /// Whether the last step was shorter than the demand asked for.
    limited: bool,
    /// Where the shaft should be now, in increments.
    demand: f64,
    /// The target to which the demand moves.
    target: i32,
    /// Time until the demand is at the target.
    left: Duration,
}

impl Motor {
    pub(crate) const fn new(position: i32, max_speed: f64) -> Self {
        Self {
            position: position as f64,
            speed: 0.0,
            max_speed,
            blocked: false,
            limited: false,
            demand: position as f64,
            target: position,
            left: Duration::ZERO,
        }
    }

    /// Returns the position, rounded to the nearest increment.
    pub(crate) fn position(&self) -> i32 {
        nearest(self.position)
    }

    /// Returns the speed in increments/s.
    pub(crate) const fn speed(&self) -> f64 {
        self.speed
    }

    /// Returns where the shaft should be now, rounded to the nearest increment.
    pub(crate) fn demand(&self) -> i32 {
        nearest(self.demand)
    }

    /// Returns the following error: demand minus position, in increments.
    pub(crate) fn following_error(&self) -> i32 {
        nearest(self.demand).wrapping_sub(self.position())
    }

    pub(crate) fn stands_still(&self) -> bool {
        self.speed == 0.0
    }

    pub(crate) const fn is_limited(&self) -> bool {
        self.limited
    }

    /// Follows the demand for `time`, with at most this acceleration in increments/s²; a new target comes each `period`.
    pub(crate) fn follow(&mut self, target: i32, period: Duration, time: Duration, acceleration: f64) {
        if target != self.target {
            (self.target, self.left) = (target, period);
        }
        let time_s = time.as_secs_f64();
        let lag = self.demand - self.position;
        let step = (f64::from(target) - self.demand) * time_s / self.left.max(time).as_secs_f64();
        self.left = self.left.saturating_sub(time);
        self.demand += step;
        let catch_up = stopping_speed(lag.abs(), acceleration * CATCH_UP_SHARE, time_s);
        let wanted = step / time_s + (lag / time_s).clamp(-catch_up, catch_up);
        let change = acceleration * time_s;
        let reached = wanted.clamp(self.speed - change, self.speed + change);
        self.speed = reached.clamp(-self.max_speed, self.max_speed);
        self.limited = self.blocked || self.speed != wanted;
        self.advance(time);
    }

    /// Reduces the speed by this deceleration, in increments/s².
    pub(crate) fn brake(&mut self, deceleration: f64, time: Duration) {
        let change = deceleration * time.as_secs_f64();
        self.speed = if self.speed.abs() <= change { 0.0 } else { self.speed - change * self.speed.signum() };
        self.limited = false;
        self.advance(time);
        self.demand = self.position;
    }

    /// Stops at once: the brake holds the shaft.
    pub(crate) const fn hold(&mut self) {
        self.speed = 0.0;
        self.limited = false;
        self.demand = self.position;
    }

    fn advance(&mut self, time: Duration) {
        if self.blocked {
            self.speed = 0.0;
        }
        self.position += self.speed * time.as_secs_f64();
    }
}

/// Returns the highest speed from which steps of `time_s` with this deceleration end within `way`.
fn stopping_speed(way: f64, deceleration: f64, time_s: f64) -> f64 {
    let half = deceleration * time_s / 2.0;
    libm::sqrt(half * half + 2.0 * deceleration * way) - half
}

/// Returns the nearest increment.
fn nearest(position: f64) -> i32 {
    // `as` saturates, and truncates the fraction: half is added before.
    let half = if position < 0.0 { -0.5 } else { 0.5 };
    (position + half) as i32
}
