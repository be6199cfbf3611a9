//! Step III: a way for a secondary motion that is free of obstacles.
//!
//! Obstacles are axis-aligned boxes. A way is free if the straight tool path keeps from every box a distance made up
//! of three parts:
//!
//! - the clearance, which tool and part need;
//! - half the approximation distance r, within r of an end that is blended: every point of the triangle that a blend cuts
//!   off a corner is at most r/2 away from the corner's legs;
//! - the bow of a PTP. Its joints travel evenly, so its path p(s), s = 0…1, leaves the chord by at most
//!   max|p″| · s·(1 − s)/2: most in the middle, nothing at the ends. The application names the radius R of an arc. Over a
//!   chord of length L it turns by 2φ with sin φ = L/2R, so |p″| is R·(2φ)², and the bound is R·φ²/2 in the middle: for
//!   a short chord L²/8R, for half a circle a quarter more than R. A chord longer than 2R has no such arc; the half circle
//!   over it is taken. The vertical axis of a SCARA is a joint of its own, so its PTP bows sideways only. The bound is
//!   taken as it is at each point of the chord: with the largest of each eighth, ways over an obstacle were 10 mm higher
//!   than need be.
//!
//! Candidates are tried in this order, and the first free one is used: the straight way; one intermediate position over
//! the obstacle, the end or the start, at the lowest free height; two of them, above the start and above the end.
//! Candidates with legs that are too short for a full blend come last. A way over intermediate positions keeps these
//! distances from the faces of the box along each axis, which past an edge is more room; if there is none, from its nearest
//! point, as the straight way does. If the cycle has crossed an obstacle before, its
//! intermediate position is used again if the way is hardly longer.

use std::cell::Cell;

use crate::application::{Obstacle, Ways};
use crate::clearance::{Leg, Measure};
use crate::geometry::Point;
use crate::refusal::{LEAST_MM, Refusal};

/// How far above the ceiling a free height is searched for the text of the refusal, in mm.
const LOOK_ABOVE_MM: f64 = 2000.0;

/// Largest number of heights that are tried for one way, so that planning stays bounded.
const MOST_HEIGHTS: u32 = 2000;

/// A way from one point to another.
#[derive(Clone, PartialEq, Debug)]
pub(crate) enum Way {
    /// Straight.
    Direct,
    /// Over an obstacle.
    Over {
        /// The intermediate positions: one, or two.
        points: [Option<Point>; 2],
        /// Index of the obstacle.
        obstacle: usize,
        /// Whether another way of the cycle has this intermediate position.
        again: bool,
    },
}

/// The space in which ways are searched.
pub(crate) struct Space<'a> {
    pub(crate) obstacles: &'a [Obstacle],
    pub(crate) ways: &'a Ways,
    /// The setup's or the application's approximation distance, in mm.
    pub(crate) approximation_mm: f64,
    /// Whether a PTP bows in the horizontal plane alone.
    pub(crate) bows_sideways: bool,
    /// Whether the way's start and its end may be blended with other motions.
    pub(crate) blends: [bool; 2],
}

/// A leg of a way, and the distances in mm that its ends keep from an obstacle.
type Part = (Leg, [f64; 2]);

impl Space<'_> {
    /// Returns the distance in mm that the end of a leg keeps from an obstacle.
    fn distance_mm(&self, is_blended: bool) -> f64 {
        self.ways.clearance_mm + if is_blended { self.approximation_mm / 2.0 } else { 0.0 }
    }

    /// Returns the legs of a way over these points: it is blended at each intermediate one.
    fn parts(&self, points: &[Point]) -> impl Iterator<Item = Part> {
        let ends_mm = self.blends.map(|is_blended| self.distance_mm(is_blended));
        let (between_mm, last) = (self.distance_mm(true), points.len().saturating_sub(2));
        let pairs = points.iter().zip(points.iter().skip(1)).enumerate();
        pairs.map(move |(number, (&from, &to))| {
            let at_start_mm = if number == 0 { ends_mm[0] } else { between_mm };
            let at_end_mm = if number == last { ends_mm[1] } else { between_mm };
            (self.leg(from, to), [at_start_mm, at_end_mm])
        })
    }

    /// Finds the way from one point to another; `crossings` are the intermediate positions that the cycle has so far.
    pub(crate) fn way(&self, from: Point, to: Point, crossings: &[Point]) -> Result<Way, Refusal> {
        let straight = [from, to];
        let Some(obstacle) = self.parts(&straight).find_map(|part| self.blocks(part, Measure::Nearest))
        else {
            return Ok(Way::Direct);
        };
        self.ends_are_free(from, to)?;
        let middle = self.middle(from, to);
        let lowest = |measure| self.lowest(from, to, middle, self.ways.ceiling_mm, measure);
        let fresh = lowest(Measure::Faces).or_else(|| lowest(Measure::Nearest));
        let again = crossings
            .iter()
            .copied()
            .find(|&via| self.is_free(&[from, via, to], &Cell::new(obstacle), Measure::Faces))
            .filter(|&via| match fresh {
                Some([Some(new), None]) => {
                    let longest = length(&[from, new, to]) * (1.0 + self.ways.detour_percent / 100.0);
                    length(&[from, via, to]) <= longest
                }
                _ => true,
            });
        match (again, fresh) {
            (Some(via), _) => Ok(Way::Over { points: [Some(via), None], obstacle, again: true }),
            (None, Some(points)) => Ok(Way::Over { points, obstacle, again: false }),
            (None, None) => Err(self.no_way(from, to, middle, obstacle)),
        }
    }

    /// Returns the refusal that names the obstacle which leaves no way, and how much is missing.
    fn no_way(&self, from: Point, to: Point, middle: Point, first: usize) -> Refusal {
        let ceiling_mm = self.ways.ceiling_mm;
        // A way with fewer intermediate positions may need more than the lowest ceiling that does.
        let step = self.ways.height_step_mm;
        let above = |count: u32| ((ceiling_mm / step).floor() + f64::from(count)) * step;
        let mut higher = (1..MOST_HEIGHTS).map(above).take_while(|&z| z <= ceiling_mm + LOOK_ABOVE_MM);
        let needs_mm =
            higher.find(|&ceiling| self.lowest(from, to, middle, ceiling, Measure::Nearest).is_some());
        let via = Point::new(middle.x, middle.y, ceiling_mm);
        let points = [from, via, to];
        let parts = || self.parts(&points);
        let at_the_ceiling = parts().find_map(|part| self.blocks(part, Measure::Nearest));
        let index = if needs_mm.is_some() { first } else { at_the_ceiling.unwrap_or(first) };
        let obstacle = self.obstacles.get(index);
        let too_near = |obstacle: &Obstacle, (leg, _): Part| {
            let inside = leg.nearer(&obstacle.space, self.distance_mm(true), (0.0, 1.0));
            inside.map_or(0.0, |(enters, leaves)| (leaves - enters) * (leg.to - leg.from).length())
        };
        Refusal::NoWay {
            obstacle: obstacle.map_or_else(String::new, |obstacle| obstacle.name.clone()),
            top_mm: obstacle.map_or(0.0, |obstacle| obstacle.space.upper.z),
            needs_mm,
            inside_mm: obstacle.map_or(0.0, |obstacle| parts().map(|part| too_near(obstacle, part)).sum()),
            ceiling_mm,
        }
    }

    /// Returns the first obstacle to which a leg comes too near.
    fn blocks(&self, part: Part, measure: Measure) -> Option<usize> {
        self.obstacles.iter().position(|obstacle| self.is_too_near(obstacle, part, measure))
    }

    fn is_too_near(&self, obstacle: &Obstacle, (leg, at_ends_mm): Part, measure: Measure) -> bool {
        leg.is_too_near(&obstacle.space, self.ways.clearance_mm, at_ends_mm, self.approximation_mm, measure)
    }

    /// Returns the straight way with the deviation that a PTP may have from it.
    fn leg(&self, from: Point, to: Point) -> Leg {
        let bow = self.bow_mm(from, to);
        let (bow_mm, sideways_mm) = if self.bows_sideways { (0.0, bow) } else { (bow, 0.0) };
        Leg { from, to, bow_mm, sideways_mm }
    }

    /// Returns how far a PTP may deviate from the straight way in its middle, in mm.
    fn bow_mm(&self, from: Point, to: Point) -> f64 {
        let chord = self.chord(from, to);
        let radius_mm = self.ways.ptp_radius_mm.max(chord.length() / 2.0);
        let sine = (chord.length() / (2.0 * radius_mm)).min(1.0);
        let per_sine = if sine > 0.0 { libm::asin(sine) / sine } else { 1.0 };
        chord.dot(chord) / (8.0 * radius_mm) * per_sine * per_sine
    }

    /// Returns the vector over which a PTP bows.
    fn chord(&self, from: Point, to: Point) -> Point {
        let chord = to - from;
        if self.bows_sideways { Point { z: 0.0, ..chord } } else { chord }
    }

    /// Returns whether all legs are free. It first tests the obstacle that blocked the previous candidate, because this
    /// one mostly blocks the next candidate too.
    fn is_free(&self, points: &[Point], before: &Cell<usize>, measure: Measure) -> bool {
        self.parts(points).all(|part| {
            if self
                .obstacles
                .get(before.get())
                .is_some_and(|obstacle| self.is_too_near(obstacle, part, measure))
            {
                return false;
            }
            let blocking = self.blocks(part, measure);
            before.set(blocking.unwrap_or(before.get()));
            blocking.is_none()
        })
    }

    /// Checks that both ends of the way are allowed; otherwise no intermediate position helps.
    fn ends_are_free(&self, from: Point, to: Point) -> Result<(), Refusal> {
        let [at_start, at_end] = self.blends;
        for (target, point, is_blended) in
            [("the start of the way", from, at_start), ("the end of the way", to, at_end)]
        {
            let distance_mm = self.distance_mm(is_blended);
            for obstacle in self.obstacles {
                let missing_mm = distance_mm - obstacle.space.distance_mm(point);
                if missing_mm > 0.0 {
                    return Err(Refusal::TooNear {
                        target: target.to_owned(),
                        obstacle: obstacle.name.clone(),
                        missing_mm,
                        distance_mm,
                    });
                }
            }
        }
        Ok(())
    }

    /// Returns the middle of the blocked part of the straight way, rounded to whole millimetres so that a person can read
    /// and teach it.
    fn middle(&self, from: Point, to: Point) -> Point {
        // The bow of a short chord is enough here: this only says where an intermediate position is tried.
        let chord = self.chord(from, to);
        let most = self.distance_mm(true) + chord.dot(chord) / (8.0 * self.ways.ptp_radius_mm);
        let inside = self.obstacles.iter().filter_map(|obstacle| obstacle.space.grown(most).inside(from, to));
        let (first, last) = inside.fold((1.0_f64, 0.0_f64), |(first, last), (enters, leaves)| {
            (first.min(enters), last.max(leaves))
        });
        let middle = from.toward(to, f64::midpoint(first, last));
        Point::new(middle.x.round(), middle.y.round(), middle.z)
    }

    /// Returns the free way with the fewest intermediate positions at the lowest height.
    fn lowest(
        &self,
        from: Point,
        to: Point,
        middle: Point,
        ceiling: f64,
        measure: Measure,
    ) -> Option<[Option<Point>; 2]> {
        let step = self.ways.height_step_mm;
        let floor = from.z.min(to.z);
        let first = (floor / step).ceil();
        let heights = || {
            (0..MOST_HEIGHTS)
                .map(move |count| (first + f64::from(count)) * step)
                .take_while(|&z| z <= ceiling)
        };
        let above = |point: Point, z: f64| Point::new(point.x, point.y, z);
        let before = Cell::new(0);
        let one = |shortest: f64| {
            let vias = heights().flat_map(|z| [middle, to, from].map(|place| above(place, z)));
            vias.map(|via| [from, via, to])
                .find(|way| longer(way, shortest) && self.is_free(way, &before, measure))
        };
        let two = |shortest: f64| {
            let vias = heights().filter(|&z| z > from.z.max(to.z));
            let ways = vias.map(|z| [from, above(from, z), above(to, z), to]);
            ways.into_iter().find(|way| longer(way, shortest) && self.is_free(way, &before, measure))
        };
        // First candidates whose legs are long enough for their blends.
        let legs = [2.0 * self.approximation_mm, LEAST_MM];
        let single = legs.into_iter().find_map(one).map(|[_, via, _]| [Some(via), None]);
        single.or_else(|| legs.into_iter().find_map(two).map(|[_, up, down, _]| [Some(up), Some(down)]))
    }
}

/// Returns whether every leg of a way is at least this long, in mm.
fn longer(points: &[Point], shortest: f64) -> bool {
    points.iter().zip(points.iter().skip(1)).all(|(from, to)| (*to - *from).length() >= shortest)
}

fn length(points: &[Point]) -> f64 {
    points.iter().zip(points.iter().skip(1)).map(|(from, to)| (*to - *from).length()).sum()
}

#[cfg(test)]
mod tests;
