//! A cell of a law, between two knots, as a function of time.

use super::node::Pace;

/// The course of the speed within a cell.
#[derive(Clone, Copy, PartialEq, Debug)]
enum Shape {
    /// The acceleration grows linearly with the way, by this per unit of way.
    Even(f64),
    /// With a constant jerk from rest.
    FromRest(f64),
    /// With a constant jerk to rest.
    ToRest(f64),
}

/// A cell of a law, between two knots.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Cell {
    pub(super) length: f64,
    /// Duration in s.
    pub(super) duration: f64,
    speed: f64,
    acceleration: f64,
    shape: Shape,
}

impl Cell {
    /// From one knot to the next, with the pace at both.
    pub(super) fn new(length: f64, from: Pace, to: Pace) -> Self {
        let [speed, exit] = [from, to].map(|pace| pace.square.max(0.0).sqrt());
        if from.is_rest() || to.is_rest() {
            let speed_there = speed.max(exit);
            let jerk = 2.0 / 9.0 * speed_there * speed_there * speed_there / (length * length);
            let shape = if from.is_rest() { Shape::FromRest(jerk) } else { Shape::ToRest(jerk) };
            let duration = 3.0 * length / speed_there;
            return Self { length, duration, speed, acceleration: from.acceleration, shape };
        }
        let mean = (speed + exit) / 2.0;
        let bend = (to.acceleration - from.acceleration) * length / (4.0 * mean * mean);
        let duration = length / mean * area_tangent(bend);
        let shape = Shape::Even((to.acceleration - from.acceleration) / length);
        Self { length, duration, speed, acceleration: from.acceleration, shape }
    }

    /// Way and pace after some time, in s.
    pub(super) fn at(&self, time: f64) -> (f64, Pace) {
        match self.shape {
            Shape::Even(change) => {
                let (sine, cosine) = hyperbolic(change, time);
                let way = self.speed * sine + self.acceleration * cosine;
                let growth = 1.0 + change * cosine;
                let speed = self.speed * growth + self.acceleration * sine;
                let acceleration = self.acceleration * growth + change * self.speed * sine;
                (way.min(self.length), Pace { square: speed * speed, acceleration })
            }
            Shape::FromRest(jerk) => {
                let speed = jerk / 2.0 * time * time;
                (speed * time / 3.0, Pace { square: speed * speed, acceleration: jerk * time })
            }
            Shape::ToRest(jerk) => {
                let left = (self.duration - time).max(0.0);
                let speed = jerk / 2.0 * left * left;
                (self.length - speed * left / 3.0, Pace { square: speed * speed, acceleration: -jerk * left })
            }
        }
    }

    /// The jerk after some time, with the pace then.
    pub(super) fn jerk(&self, pace: &Pace) -> f64 {
        match self.shape {
            Shape::Even(change) => change * pace.square.sqrt(),
            Shape::FromRest(jerk) | Shape::ToRest(jerk) => jerk,
        }
    }

    pub(super) const fn is_from_rest(&self) -> bool {
        matches!(self.shape, Shape::FromRest(_))
    }

    pub(super) const fn is_to_rest(&self) -> bool {
        matches!(self.shape, Shape::ToRest(_))
    }

    /// Returns the time in s from which the acceleration is negative up to the cell's end; none where it is not
    /// negative there.
    pub(super) fn brakes_from(&self) -> Option<f64> {
        let Shape::Even(change) = self.shape else {
            return matches!(self.shape, Shape::ToRest(_)).then_some(0.0);
        };
        let end = self.acceleration + change * self.length;
        if end >= 0.0 {
            None
        } else if self.acceleration <= 0.0 {
            Some(0.0)
        } else {
            // Where a = 0: tanh(√change·t)/√change = −a/(change·v), and change is negative here.
            let root = (-change).sqrt();
            Some((libm::atan(self.acceleration / (root * self.speed)) / root).min(self.duration))
        }
    }
}

/// artanh(√x)/√x, for a negative x as well.
fn area_tangent(x: f64) -> f64 {
    if x.abs() < 0.05 {
        // 1 + x/3 + x²/5 + …
        let mut sum = 0.0;
        for order in (0..11).rev() {
            sum = sum * x + 1.0 / f64::from(2 * order + 1);
        }
        sum
    } else if x > 0.0 {
        let root = x.min(1.0 - f64::EPSILON).sqrt();
        libm::atanh(root) / root
    } else {
        let root = (-x).sqrt();
        libm::atan(root) / root
    }
}

/// sinh(√x·t)/√x and (cosh(√x·t) − 1)/x, for a negative x as well.
fn hyperbolic(x: f64, time: f64) -> (f64, f64) {
    let square = x * time * time;
    if square.abs() < 1.0 {
        let (mut sine, mut cosine) = (0.0, 0.0);
        for order in (1..9).rev() {
            let order = f64::from(order);
            sine = (sine + 1.0) * square / ((2.0 * order) * (2.0 * order + 1.0));
            cosine = (cosine + 1.0) * square / ((2.0 * order + 1.0) * (2.0 * order + 2.0));
        }
        ((1.0 + sine) * time, (1.0 + cosine) * time * time / 2.0)
    } else if x > 0.0 {
        let root = x.sqrt();
        let angle = root * time;
        (libm::sinh(angle) / root, (libm::cosh(angle) - 1.0) / x)
    } else {
        let root = (-x).sqrt();
        let (sin, cos) = libm::sincos(root * time);
        (sin / root, (cos - 1.0) / x)
    }
}
