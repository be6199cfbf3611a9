//! The course of the tool in a planned motion, approximated by straight legs.
//!
//! A circle is cut so fine that its legs are off it by [`SAGITTA_MM`]. A spline has the shape that the robot node gives it:
//! a piece between two targets blends the parabola through the three targets around its start with the one around its end,
//!
//! ```text
//! r(τ) = start + τ·(end − start) − u²·τ·(1 − τ)·(a + (b − a)·(3τ² − 2τ³))
//! ```
//!
//! with a and b half of the second derivative of either parabola by u, which grows by √(distance) from target to target.
//! Without a target before or after, the parabola of the other end is all there is; with neither, the piece is straight.
//! As a single skill every piece is straight, so a course follows the chord as well.

use protocol::image::PathForm;

use crate::clearance::Leg;
use crate::geometry::Point;
use crate::motion::Motion;

/// How far a leg of a circle is off it, in mm.
const SAGITTA_MM: f64 = 0.02;

/// Largest number of legs of a circle.
const MOST_LEGS: f64 = 512.0;

/// Legs of a piece of a spline.
const SPLINE_LEGS: u32 = 64;

/// Largest change of direction in degrees between two chords of a spline; at a larger one the spline stops.
const TURNS_BACK_DEG: f64 = 160.0;

impl Motion {
    /// Returns points of the path from start to target, as the robot node follows it in a continuous motion.
    #[must_use]
    pub fn course(&self) -> Vec<Point> {
        let legs = self.legs();
        let start = legs.first().map(|leg| leg.from);
        start.into_iter().chain(legs.iter().map(|leg| leg.to)).collect()
    }

    /// Returns the path of a continuous motion as legs.
    pub(crate) fn legs(&self) -> Vec<Leg> {
        match self.kind.path() {
            Some(PathForm::Circle) => self.legs_of_circle().unwrap_or_else(|| vec![self.chord()]),
            Some(PathForm::Spline) => self.legs_of_spline(),
            Some(PathForm::Axes | PathForm::Line) | None => vec![self.chord()],
        }
    }

    /// Returns the straight line from start to target.
    pub(crate) const fn chord(&self) -> Leg {
        Leg::straight([self.start.point, self.target.point])
    }

    fn legs_of_circle(&self) -> Option<Vec<Leg>> {
        let (start, leaves) = (self.start.point, self.leaves?);
        let chord = self.target.point - start;
        let normal = (Point::from(self.auxiliary) - start).cross(chord).direction()?;
        let inwards = normal.cross(leaves);
        // A chord over the angle φ is 2·r²·(1 − cos φ) in square and reaches r·(1 − cos φ) inwards.
        let radius = chord.dot(chord) / (2.0 * chord.dot(inwards));
        // A leg over the angle φ is off its arc by r·(1 − cos φ/2), which is r·φ²/8 and less.
        let finest = (8.0 * SAGITTA_MM / radius).sqrt();
        let swept = self.length_mm / radius;
        let count = (swept / finest).ceil().clamp(1.0, MOST_LEGS);
        let step = swept / count;
        let bow_mm = radius * step * step / 8.0;
        let at = |number: f64| {
            let (sine, cosine) = libm::sincos(step * number);
            start + leaves * (radius * sine) + inwards * (radius * (1.0 - cosine))
        };
        let numbers = (0..count as u32).map(f64::from);
        Some(numbers.map(|it| Leg { from: at(it), to: at(it + 1.0), bow_mm, sideways_mm: 0.0 }).collect())
    }

    fn legs_of_spline(&self) -> Vec<Leg> {
        let (start, end) = (self.start.point, self.target.point);
        let [before, after] = self.spline_neighbours;
        let (along, u) = (end - start, self.length_mm.sqrt());
        // Half of the second derivative by u of the parabola through the piece's ends and one more target.
        let bend = |other: Point, near: Point, sign: f64| {
            let other_u = (other - near).length().sqrt();
            let slope = (other - near) * (sign / other_u);
            (slope - along * (1.0 / u)) * (sign / (u + other_u))
        };
        let at_start = before.map(|before| bend(before, start, -1.0));
        let at_end = after.map(|after| bend(after, end, 1.0));
        let (Some(first), Some(last)) = (at_start.or(at_end), at_end.or(at_start)) else {
            return vec![self.chord()];
        };
        let (first, rest) = (first * (u * u), (last - first) * (u * u));
        let at = |share: f64| {
            let weight = share * share * (3.0 - 2.0 * share);
            start + along * share - (first + rest * weight) * (share * (1.0 - share))
        };
        // r″ = 2·first + rest·(−18τ + 60τ² − 40τ³), whose factor is between −1.6 and 3.6.
        let most = 2.0 * first.length() + 3.6 * rest.length();
        let legs = f64::from(SPLINE_LEGS);
        let bow_mm = most / (8.0 * legs * legs);
        (0..SPLINE_LEGS)
            .map(f64::from)
            .map(|it| Leg { from: at(it / legs), to: at((it + 1.0) / legs), bow_mm, sideways_mm: 0.0 })
            .collect()
    }

    /// Joins this motion and the next one into one spline, if the robot continues from one to the other.
    pub(crate) fn bend_into(&mut self, next: &mut Self) {
        let are_splines = [self.kind, next.kind].iter().all(|kind| kind.path() == Some(PathForm::Spline));
        let (one, other) = (self.target.point - self.start.point, next.target.point - next.start.point);
        if are_splines && self.tool == next.tool && one.angle_deg(other) < TURNS_BACK_DEG {
            self.spline_neighbours[1] = Some(next.target.point);
            next.spline_neighbours[0] = Some(self.start.point);
        }
    }
}
