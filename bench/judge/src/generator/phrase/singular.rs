//! Lines and turns past positions in which the arm loses a direction: where one joint moves far for a moment.

use super::super::arm::anywhere;
use super::super::dice::Dice;
use super::Walk;
use crate::case::{Kind, Programmed};
use crate::kinematics::{Joints, Links, Pose};

/// Draws of joints that pass as near as wanted: most arms have some.
const DRAWS: usize = 400;

/// Distances at which the wrist passes the place where it must not be beside the shoulder's axis, in mm.
const BESIDE_SHOULDER_MM: [f64; 2] = [5.0, 90.0];

/// Angles by which the wrist may be bent, in degrees.
const BESIDE_WRIST_DEG: [f64; 2] = [0.5, 30.0];

/// Angles by which a tool turns at one place, in degrees.
const TURN_DEG: [f64; 2] = [10.0, 150.0];

impl Walk<'_> {
    /// A line whose middle is beside the place where the wrist is on the shoulder's axis. An arm that does not get there
    /// passes it as it can.
    pub(super) fn past_shoulder(&mut self, dice: &mut Dice, motions: &mut Vec<Programmed>) {
        let mut middle = self.joints;
        for _ in 0..DRAWS {
            middle = anywhere(dice, self.arm);
            let off = self.off_shoulder(&middle);
            if off.is_none_or(|off| (BESIDE_SHOULDER_MM[0]..BESIDE_SHOULDER_MM[1]).contains(&off)) {
                break;
            }
        }
        self.through(dice, motions, middle, true);
    }

    /// A line, or a turn at one place, beside a straight wrist.
    pub(super) fn past_wrist(&mut self, dice: &mut Dice, motions: &mut Vec<Programmed>) {
        let mut middle = anywhere(dice, self.arm);
        if let (_, Some(wrist)) = self.configuration() {
            let bent = dice.scale(BESIDE_WRIST_DEG[0], BESIDE_WRIST_DEG[1]);
            let bent = if dice.chance(0.5) { bent } else { -bent };
            let (lower, upper) = (self.arm.lower_deg[wrist], self.arm.upper_deg[wrist]);
            middle[wrist] = (self.zero_of(wrist) + bent).clamp(lower, upper);
        }
        let is_line = dice.chance(0.5);
        self.through(dice, motions, middle, is_line);
    }

    /// A turn of the tool at one place.
    pub(super) fn turn(&mut self, dice: &mut Dice, motions: &mut Vec<Programmed>) {
        let middle = self.joints;
        self.through(dice, motions, middle, false);
    }

    /// Goes to joints, from there to one end of a line or of a turn at one place, and then to the other end.
    fn through(&mut self, dice: &mut Dice, motions: &mut Vec<Programmed>, middle: Joints, is_line: bool) {
        self.go_to(dice, motions, middle);
        let pose = self.arm.links.flange(&middle);
        let (way, turned) = match is_line {
            true => (dice.scale(10.0, 500.0), if dice.chance(0.5) { 0.0 } else { dice.scale(1.0, 90.0) }),
            false => (0.0, dice.scale(TURN_DEG[0], TURN_DEG[1])),
        };
        let direction = dice.direction();
        let axis = if self.arm.links.axes() == 4 { [0.0, 0.0, 1.0] } else { dice.direction() };
        // The tool stays where it is in a turn, and turns where it is on a line.
        let tool = self.frames[0][usize::from(self.tool)];
        for share in [-0.5, 0.5] {
            let mut end = pose.then(&tool).turned_by(axis.map(|part| share * turned * part));
            for (place, part) in end.at.iter_mut().zip(direction) {
                *place += share * way * part;
            }
            let target = self.target_of(&end.then(&tool.inverse()));
            self.cartesian(dice, motions, Kind::Lin, target, [0.0; 3]);
        }
    }

    /// Returns the wrist's distance from where it must not be beside the axis of the shoulder, in mm; none for an arm without such a
    /// place.
    fn off_shoulder(&self, joints: &Joints) -> Option<f64> {
        let (before_flange, radius) = match self.arm.links {
            Links::Scara { .. } => return None,
            Links::SixAxes { c4_mm, b_mm, .. } => (c4_mm, b_mm),
            Links::ThreeParallel { d_mm: [_, d4, _, d6], .. } => (d6, d4),
        };
        let [x, y, _] = self.arm.links.flange(joints).then(&Pose::shifted([0.0, 0.0, -before_flange])).at;
        Some((libm::hypot(x, y) - radius.abs()).abs())
    }
}
