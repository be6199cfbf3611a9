//! How long it takes to come to a stop, and how near to it the tool is within a cycle.

use super::{Among, Law, PLACE_MM};

/// The most cycles that a halt is waited for: a motion without a deceleration is refused before it moves.
const LONGEST_HALT: f64 = 1e6;

impl Law {
    /// How many cycles it takes to take back an acceleration of these motions.
    pub(super) fn settling_cycles(&self) -> u32 {
        let least = |is_point_to_point: bool, rated: f64| {
            let jerks = self.ways.iter().filter(|way| way.kind.is_point_to_point() == is_point_to_point);
            jerks.filter_map(|way| way.jerk).fold(rated, f64::min)
        };
        let hardest = |is_point_to_point: bool| {
            let ways = self.ways.iter().filter(|way| way.kind.is_point_to_point() == is_point_to_point);
            ways.fold(0.0, |most: f64, way| most.max(way.acceleration).max(way.deceleration))
        };
        // Point to point both are shares of what is rated: by that a ramp takes as many cycles as differences tell.
        let by_tool = hardest(false) / least(false, self.path_jerk) / self.cycle_s;
        let rated = (0..self.axes).map(|axis| self.differences[1][axis] / self.differences[2][axis]);
        let by_joints = rated.fold(0.0, f64::max) * hardest(true) / least(true, 1.0);
        self.settles_in_rated.max(by_tool.max(by_joints).ceil() as u32 + 3)
    }

    /// How many cycles it takes to stop from the highest programmed speed with the programmed deceleration, where a bend or another
    /// joint is in the way perhaps twice as many.
    #[must_use]
    pub fn halts_in(&self) -> u32 {
        let [speeds, accelerations, _] = &self.differences;
        let rated = (0..self.axes).map(|axis| speeds[axis] / accelerations[axis]).fold(0.0, f64::max);
        let cycles = self.ways.iter().map(|way| {
            let longest = if way.kind.is_point_to_point() { rated } else { 1.0 / self.cycle_s };
            longest * way.velocity / way.deceleration
        });
        (2.0 * cycles.fold(0.0, f64::max)).min(LONGEST_HALT).ceil() as u32 + 2 * self.settles_in
    }

    /// How far a tool is within a cycle from a stop at most, in mm, by these motions.
    pub(super) fn near_stop_mm(&self, among: Among) -> f64 {
        let ways = self.ways_among(among);
        if ways.is_empty() || ways.iter().any(|way| way.kind.is_point_to_point()) {
            return self.near_stop_by_joints_mm();
        }
        let acceleration =
            ways.iter().fold(0.0, |most, way| way.acceleration.max(way.deceleration).max(most));
        acceleration * self.cycle_s * self.cycle_s / 2.0 + PLACE_MM
    }

    /// The same where the joints alone hold the tool.
    pub(super) fn near_stop_by_joints_mm(&self) -> f64 {
        self.tool_acceleration_by_joints * self.cycle_s * self.cycle_s / 2.0 + PLACE_MM
    }
}
