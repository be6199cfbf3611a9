//! Rows of points that lie close together.

use super::{Dice, Kind, Programmed, Walk};
use crate::case::Run;
use crate::kinematics::length;

/// Share of a random direction that each step adds to the direction of the one before it.
const BEND: f64 = 0.2;

impl Walk<'_> {
    /// Draws points that go on in bends, alike in all but their targets, on the grid that compact points carry exactly.
    pub(in super::super) fn points(&mut self, dice: &mut Dice, motions: &mut Vec<Programmed>, count: usize) {
        let frame = |dice: &mut Dice| dice.pick(&[(0_u8, 2), (1, 1), (2, 1)]).unwrap_or(0);
        (self.tool, self.base) = (frame(dice), frame(dice));
        let kind = if dice.chance(0.5) { Kind::Lin } else { Kind::Spline };
        let way = dice.scale(0.1, 10.0);
        let [velocity, acceleration] = self.pace(dice, way);
        let approximation = if dice.chance(0.75) { self.zone(dice) } else { 0 };
        let turn = if dice.chance(0.3) { dice.direction().map(|part| part * way / 20.0) } else { [0.0; 3] };
        let mut direction = dice.direction();
        for _ in 0..count {
            let bend = dice.direction();
            direction = core::array::from_fn(|i| direction[i] + BEND * bend[i]);
            let to_one = length(direction).recip();
            direction = direction.map(|part| part * to_one);
            let mut flange = self.flange.turned_by(turn);
            flange.at = core::array::from_fn(|i| self.flange.at[i] + way * direction[i]);
            let target = self.target_of(&flange).map(on_grid);
            self.add(
                motions,
                Programmed { velocity, acceleration, approximation, ..self.motion(kind, target) },
            );
        }
    }
}

fn on_grid(coordinate: f32) -> f32 {
    let per_unit = Run::POINTS_PER_UNIT;
    // Adding 0.0 makes zero of the negative zero.
    (libm::round(f64::from(coordinate) * per_unit) / per_unit + 0.0) as f32
}
