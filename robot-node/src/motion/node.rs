//! A place of a part with the limits there, and how fast the arm passes it.

pub(super) use ::arm::motion::node::{Node, Ratings, Vector, square};

/// Motion along a part at a place: the square of the speed, and the acceleration.
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub(super) struct Pace {
    pub(super) square: f64,
    pub(super) acceleration: f64,
}

impl Pace {
    pub(super) const REST: Self = Self { square: 0.0, acceleration: 0.0 };

    pub(super) fn is_rest(&self) -> bool {
        self.square == 0.0
    }

    /// Returns the distance in which the arm stops if it goes on braking like this; infinite where it does not brake.
    pub(super) fn brakes_within(&self) -> f64 {
        if self.acceleration < 0.0 { -self.square / (2.0 * self.acceleration) } else { f64::INFINITY }
    }
}
