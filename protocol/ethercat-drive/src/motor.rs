//! A motor with its position control, simulated. It moves at a constant speed and reaches each target at the end of
//! one interpolation period, or as soon as it can if that speed is too high for it.

use machine::Duration;

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
    /// Whether the last step was too short to reach the target in time.
    limited: bool,
    /// The target to which it moves.
    target: i32,
    /// Time until it has to be there.
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
            target: position,
            left: Duration::ZERO,
        }
    }

    /// Returns the position, rounded to the nearest increment.
    pub(crate) fn position(&self) -> i32 {
        // `as` saturates, and truncates the fraction: half is added before.
        let half = if self.position < 0.0 { -0.5 } else { 0.5 };
        (self.position + half) as i32
    }

    pub(crate) fn stands_still(&self) -> bool {
        self.speed == 0.0
    }

    pub(crate) const fn is_limited(&self) -> bool {
        self.limited
    }

    /// Moves towards a target for `time`; a new target comes each `period`.
    pub(crate) fn follow(&mut self, target: i32, period: Duration, time: Duration) {
        if target != self.target {
            (self.target, self.left) = (target, period);
        }
        let wanted = (f64::from(target) - self.position) / self.left.max(time).as_secs_f64();
        self.left = self.left.saturating_sub(time);
        self.speed = wanted.clamp(-self.max_speed, self.max_speed);
        self.limited = self.blocked || self.speed != wanted;
        self.advance(time);
    }

    /// Reduces the speed by this deceleration, in increments/s².
    pub(crate) fn brake(&mut self, deceleration: f64, time: Duration) {
        let less = deceleration * time.as_secs_f64();
        self.speed = if self.speed.abs() <= less { 0.0 } else { self.speed - less * self.speed.signum() };
        self.limited = false;
        self.advance(time);
    }

    /// Stops at once: the brake holds the shaft.
    pub(crate) const fn hold(&mut self) {
        self.speed = 0.0;
        self.limited = false;
    }

    fn advance(&mut self, time: Duration) {
        if self.blocked {
            self.speed = 0.0;
        }
        self.position += self.speed * time.as_secs_f64();
    }
}
