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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Speed, acceleration and jerk by differences of the way, `step` seconds apart.
    fn differences(cell: &Cell, time: f64, step: f64) -> [f64; 2] {
        let [before, here, after] = [time - step, time, time + step].map(|time| cell.at(time).0);
        [(after - before) / (2.0 * step), (after - 2.0 * here + before) / (step * step)]
    }

    /// Drives along a cell from its start to its end: speed and acceleration are those of the way, the jerk that of the
    /// acceleration.
    fn drives(cell: &Cell, from: Pace, to: Pace) -> Result<(), TestCaseError> {
        let (fast, steep) = (from.square.max(to.square), from.acceleration.abs().max(to.acceleration.abs()));
        let same = |one: f64, other: f64, most: f64| (one - other).abs() <= most;
        for (time, way, pace) in [(0.0, 0.0, from), (cell.duration, cell.length, to)] {
            let (found, there) = cell.at(time);
            prop_assert!(same(found, way, 1e-9 * cell.length), "{found} for {way}");
            prop_assert!(same(there.square, pace.square, 1e-8 * fast), "{there:?} for {pace:?}");
            prop_assert!(same(there.acceleration, pace.acceleration, 1e-8 * steep), "{there:?} for {pace:?}");
        }
        let step = cell.duration / 1_000.0;
        for part in 1..10 {
            let time = cell.duration * f64::from(part) / 10.0;
            let (way, pace) = cell.at(time);
            prop_assert!((0.0..=cell.length).contains(&way), "{way}");
            let [speed, acceleration] = differences(cell, time, step);
            let hurry = cell.length / cell.duration;
            prop_assert!(
                same(speed, pace.square.sqrt(), 1e-3 * (hurry + fast.sqrt())),
                "{speed} for {pace:?}"
            );
            let most = 1e-3 * (steep + hurry / cell.duration);
            prop_assert!(same(acceleration, pace.acceleration, most), "{acceleration} for {pace:?}");
            let jerk =
                (cell.at(time + step).1.acceleration - cell.at(time - step).1.acceleration) / (2.0 * step);
            let most = 1e-3 * (steep / cell.duration + jerk.abs());
            prop_assert!(same(jerk, cell.jerk(&pace), most), "{jerk} for {}", cell.jerk(&pace));
        }
        Ok(())
    }

    /// The acceleration is negative behind the time from which the cell brakes, and not before it.
    fn brakes(cell: &Cell, to: Pace) -> Result<(), TestCaseError> {
        let Some(from) = cell.brakes_from() else {
            prop_assert!(to.acceleration >= 0.0);
            return Ok(());
        };
        prop_assert!((0.0..=cell.duration).contains(&from));
        for part in 0..=20 {
            let time = cell.duration * f64::from(part) / 20.0;
            let acceleration = cell.at(time).1.acceleration;
            let tolerance = 1e-9 * (1.0 + to.acceleration.abs());
            prop_assert!(time <= from || acceleration < tolerance, "{acceleration} behind {from} s");
            prop_assert!(time >= from || acceleration > -tolerance, "{acceleration} before {from} s");
        }
        Ok(())
    }

    proptest! {
        #[test]
        fn the_pace_in_a_cell_is_that_of_its_way(
            length in 0.01..100.0_f64,
            speed in 0.1..100.0_f64,
            one in -5.0..5.0_f64,
            other in -5.0..5.0_f64,
        ) {
            // In the unit in which length and speed are 1 the square of the speed is 1 + 2·one·s + (other − one)·s².
            let square = |way: f64| 1.0 + way * (2.0 * one + way * (other - one));
            if (0..=50).any(|part| square(f64::from(part) / 50.0) < 1e-2) {
                return Ok(());
            }
            let unit = speed * speed / length;
            let from = Pace { square: speed * speed, acceleration: one * unit };
            let to = Pace { square: square(1.0) * speed * speed, acceleration: other * unit };
            let cell = Cell::new(length, from, to);
            prop_assert!(!cell.is_from_rest() && !cell.is_to_rest());
            drives(&cell, from, to)?;
            brakes(&cell, to)?;
        }

        #[test]
        fn beside_a_rest_the_jerk_is_constant(length in 0.01..100.0_f64, speed in 0.1..100.0_f64) {
            // From rest the way grows as jerk·t³/6.
            let seconds = 3.0 * length / speed;
            let moving = Pace { square: speed * speed, acceleration: 2.0 * speed / seconds };
            let start = Cell::new(length, Pace::REST, moving);
            prop_assert!(start.is_from_rest() && !start.is_to_rest() && start.brakes_from().is_none());
            prop_assert!((start.duration - seconds).abs() < 1e-9 * seconds);
            drives(&start, Pace::REST, moving)?;
            let moving = Pace { acceleration: -moving.acceleration, ..moving };
            let end = Cell::new(length, moving, Pace::REST);
            prop_assert!(end.is_to_rest() && !end.is_from_rest());
            prop_assert_eq!(end.brakes_from(), Some(0.0));
            drives(&end, moving, Pace::REST)?;
            prop_assert_eq!(end.at(2.0 * seconds), (length, Pace { square: 0.0, acceleration: -0.0 }));
        }
    }

    #[test]
    fn a_cell_is_not_left_by_more_than_its_length() {
        let pace = Pace { square: 4.0, acceleration: 0.0 };
        let cell = Cell::new(6.0, pace, pace);
        assert_eq!((cell.duration, cell.at(1.5).0, cell.at(4.0).0), (3.0, 3.0, 6.0));
        assert_eq!(cell.brakes_from(), None, "a constant speed");
    }
}
