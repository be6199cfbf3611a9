//! The arm as a chain of joints with bodies between them, from the setup's own kinematics, for pictures that move.
//!
//! A joint's frame is the one before it, shifted by the joint's offset and then moved by the joint. Bodies are rods with
//! round ends: the lengths are the setup's, the thickness is ours.

use robot_node::arm::{Frame, Rotation};
use serde::Serialize;
use setup::{Kinematics, Opw, Scara, Setup, ThreeParallel};

const X: [f64; 3] = [1.0, 0.0, 0.0];
const Y: [f64; 3] = [0.0, 1.0, 0.0];
const Z: [f64; 3] = [0.0, 0.0, 1.0];

/// An arm.
#[derive(Clone, Serialize, Debug)]
pub(super) struct Chain {
    /// Bodies that do not move, in the root's frame.
    pub(super) base: Vec<Rod>,
    /// The joints, from the root on.
    pub(super) joints: Vec<Joint>,
    /// Frame of the flange in that of the last joint.
    pub(super) flange: Placed,
    /// Frame of the tool's tip in that of the flange.
    pub(super) tool: Placed,
    /// Thickness of the arm in mm; smaller parts are drawn in proportion to it.
    pub(super) radius_mm: f64,
}

/// A joint, and the bodies that it moves.
#[derive(Clone, Serialize, Debug)]
pub(super) struct Joint {
    offset_mm: [f64; 3],
    axis: [f64; 3],
    is_linear: bool,
    /// The joint's value times this, less `zero`, is the movement along or about the axis.
    sign: f64,
    /// In degrees, or in mm.
    zero: f64,
    pub(super) bodies: Vec<Rod>,
}

/// A rod with round ends.
#[derive(Clone, Copy, Serialize, Debug)]
pub(super) struct Rod {
    pub(super) from: [f64; 3],
    pub(super) to: [f64; 3],
    pub(super) radius: f64,
}

/// A frame in another one.
#[derive(Clone, Copy, Serialize, Debug)]
pub(super) struct Placed {
    pub(super) at_mm: [f64; 3],
    /// Orientation: w, x, y, z.
    pub(super) quaternion: [f64; 4],
}

impl Placed {
    pub(super) fn new(frame: &Frame) -> Self {
        Self { at_mm: frame.position, quaternion: frame.rotation.quaternion() }
    }

    fn frame(&self) -> Frame {
        Frame { position: self.at_mm, rotation: Rotation::from_quaternion(self.quaternion) }
    }
}

impl Joint {
    const fn turning(offset_mm: [f64; 3], axis: [f64; 3]) -> Self {
        Self { offset_mm, axis, is_linear: false, sign: 1.0, zero: 0.0, bodies: Vec::new() }
    }

    fn moved(&self, value: f64) -> Frame {
        let by = value * self.sign - self.zero;
        let shift = if self.is_linear { self.axis.map(|part| part * by) } else { [0.0; 3] };
        let rotation = if self.is_linear { Rotation::IDENTITY } else { Rotation::about(self.axis, by) };
        let at = |index: usize| {
            self.offset_mm.get(index).copied().unwrap_or(0.0) + shift.get(index).copied().unwrap_or(0.0)
        };
        Frame { position: [at(0), at(1), at(2)], rotation }
    }
}

impl Chain {
    /// Returns the arm of a setup with this tool.
    pub(super) fn of(setup: &Setup, tool: &Frame) -> Self {
        let highest = setup.robot.axes.upper_deg.value.get(2).copied().unwrap_or(0.0);
        let mut chain = match &setup.robot.kinematics {
            Kinematics::Scara(arm) => scara(arm, highest),
            Kinematics::Opw(arm) => six_axes(arm),
            Kinematics::ThreeParallel(arm) => three_parallel(arm),
        };
        chain.tool = Placed::new(tool);
        chain
    }

    /// Returns the frames of the joints and of the tool's tip, in the root's frame.
    pub(super) fn frames(&self, values: &[f64]) -> (Vec<Frame>, Frame) {
        let mut at = Frame::IDENTITY;
        let mut frames = Vec::new();
        for (joint, value) in self.joints.iter().zip(values) {
            at = at * joint.moved(*value);
            frames.push(at);
        }
        (frames, at * self.flange.frame() * self.tool.frame())
    }
}

/// Builds the chain of a SCARA: the links lie above the stroke of the quill, which hangs from the second link.
fn scara(arm: &Scara, stroke_mm: f64) -> Chain {
    let [link_1, link_2, height] =
        [&arm.link_1_mm, &arm.link_2_mm, &arm.height_mm].map(|length| length.value);
    let radius = (link_1 + link_2) * 0.055;
    let plane = height + stroke_mm + radius * 1.6;
    let rod = |from, to, radius| Rod { from, to, radius };
    let mut joints = [
        Joint::turning([0.0; 3], Z),
        Joint::turning([link_1, 0.0, 0.0], Z),
        Joint { is_linear: true, ..Joint::turning([link_2, 0.0, height], Z) },
        Joint::turning([0.0; 3], Z),
    ];
    let bodies = [
        vec![rod([0.0, 0.0, plane], [link_1, 0.0, plane], radius)],
        vec![rod([0.0, 0.0, plane], [link_2, 0.0, plane], radius * 0.8)],
        vec![rod([0.0; 3], [0.0, 0.0, stroke_mm + radius * 3.0], radius * 0.35)],
        vec![rod([0.0, 0.0, radius * 0.5], [0.0, 0.0, radius * 0.9], radius * 0.45)],
    ];
    joints.iter_mut().zip(bodies).for_each(|(joint, bodies)| joint.bodies = bodies);
    Chain {
        base: vec![rod([0.0; 3], [0.0, 0.0, plane], radius * 1.15)],
        joints: joints.into(),
        flange: Placed::new(&Frame { position: [0.0; 3], rotation: Rotation::about(X, 180.0) }),
        tool: Placed::new(&Frame::IDENTITY),
        radius_mm: radius,
    }
}

fn six_axes(arm: &Opw) -> Chain {
    let [a1, a2, b, c1, c2, c3, c4] =
        [&arm.a1_mm, &arm.a2_mm, &arm.b_mm, &arm.c1_mm, &arm.c2_mm, &arm.c3_mm, &arm.c4_mm]
            .map(|length| length.value);
    let radius = (c2 + c3) * 0.085;
    let rod = |from, to, radius| Rod { from, to, radius };
    let across = |half: f64, radius| rod([0.0, -half, 0.0], [0.0, half, 0.0], radius);
    let offsets = [[0.0; 3], [a1, b, c1], [0.0, 0.0, c2], [a2, 0.0, c3], [0.0; 3], [0.0; 3]];
    let mut joints: Vec<_> = offsets
        .into_iter()
        .zip([Z, Y, Y, Z, Y, Z])
        .map(|(offset, axis)| Joint::turning(offset, axis))
        .collect();
    for ((joint, zero), sign) in joints.iter_mut().zip(arm.offsets_deg.value).zip(arm.signs.value) {
        (joint.zero, joint.sign) = (zero, f64::from(sign));
    }
    let bodies = [
        vec![rod([0.0, 0.0, c1 * 0.5], [a1, b, c1], radius * 1.1)],
        vec![across(radius * 0.6, radius * 1.2), rod([0.0; 3], [0.0, 0.0, c2], radius * 0.9)],
        vec![
            across(radius * 0.5, radius),
            rod([0.0; 3], [a2, 0.0, 0.0], radius * 0.8),
            rod([a2, 0.0, 0.0], [a2, 0.0, c3 * 0.45], radius * 0.75),
        ],
        vec![rod([0.0, 0.0, c3 * -0.55], [0.0; 3], radius * 0.6)],
        vec![across(radius * 0.35, radius * 0.65)],
        vec![rod([0.0; 3], [0.0, 0.0, c4 * 0.85], radius * 0.45)],
    ];
    joints.iter_mut().zip(bodies).for_each(|(joint, bodies)| joint.bodies = bodies);
    Chain {
        base: vec![rod([0.0; 3], [0.0, 0.0, c1 * 0.5], radius * 1.5)],
        joints,
        flange: Placed::new(&Frame { position: [0.0, 0.0, c4], rotation: Rotation::IDENTITY }),
        tool: Placed::new(&Frame::IDENTITY),
        radius_mm: radius,
    }
}

/// Builds the chain of an arm with three parallel axes: the upper arm lies beside axis 1, and the forearm back above it.
fn three_parallel(arm: &ThreeParallel) -> Chain {
    let [d1, a2, a3, d4, d5, d6] =
        [&arm.d1_mm, &arm.a2_mm, &arm.a3_mm, &arm.d4_mm, &arm.d5_mm, &arm.d6_mm].map(|length| length.value);
    let radius = (a2.abs() + a3.abs()) * 0.065;
    let rod = |from, to, radius| Rod { from, to, radius };
    // Across the arm is −y where its plane is that of x and z. Seen along −y, axes 2, 3 and 4 turn from x to z.
    const ACROSS: [f64; 3] = [0.0, -1.0, 0.0];
    let offsets =
        [[0.0; 3], [0.0, 0.0, d1], [a2, 0.0, 0.0], [a3, 0.0, 0.0], [0.0, -d4, 0.0], [0.0, 0.0, -d5]];
    let axes = [Z, ACROSS, ACROSS, ACROSS, [0.0, 0.0, -1.0], ACROSS];
    let mut joints: Vec<_> =
        offsets.into_iter().zip(axes).map(|(offset, axis)| Joint::turning(offset, axis)).collect();
    for ((joint, zero), sign) in joints.iter_mut().zip(arm.offsets_deg.value).zip(arm.signs.value) {
        (joint.zero, joint.sign) = (zero, f64::from(sign));
    }
    let side = -d4;
    let bodies = [
        vec![rod([0.0, 0.0, d1], [0.0, side, d1], radius * 1.1)],
        vec![
            rod([0.0, side, 0.0], [a2, side, 0.0], radius * 0.95),
            rod([a2, side, 0.0], [a2, 0.0, 0.0], radius),
        ],
        vec![rod([0.0; 3], [a3, 0.0, 0.0], radius * 0.75)],
        vec![rod([0.0; 3], [0.0, side, 0.0], radius * 0.7)],
        vec![rod([0.0; 3], [0.0, 0.0, -d5], radius * 0.7)],
        vec![rod([0.0; 3], [0.0, -d6 * 0.9, 0.0], radius * 0.6)],
    ];
    joints.iter_mut().zip(bodies).for_each(|(joint, bodies)| joint.bodies = bodies);
    Chain {
        base: vec![rod([0.0; 3], [0.0, 0.0, d1], radius * 1.3)],
        joints,
        // The flange looks across the arm, its y up at zero.
        flange: Placed::new(&Frame { position: [0.0, -d6, 0.0], rotation: Rotation::about(X, 90.0) }),
        tool: Placed::new(&Frame::IDENTITY),
        radius_mm: radius,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use robot_node::RobotConfig;
    use robot_node::arm::distance;

    #[test]
    fn the_drawn_arm_has_its_flange_where_the_robots_own_kinematics_have_it() {
        for name in ["A", "B", "D"] {
            let (mut setup, _) = planning::setup_with_application(name).unwrap();
            if let Kinematics::Opw(arm) = &mut setup.robot.kinematics {
                // No length is 0 and no sign 1 for all.
                (arm.a1_mm.value, arm.b_mm.value) = (12.0, -7.0);
                arm.signs.value = [1, -1, 1, -1, 1, -1];
            }
            let robot = RobotConfig::from_setup(&setup).unwrap();
            let tool = Frame::from_mm_deg([10.0, 20.0, 130.0, 30.0, 40.0, 50.0]);
            let chain = Chain::of(&setup, &tool);
            for index in 0..50_u8 {
                let shift = f64::from(index);
                let joints = [7.0, -11.0, 13.0, 17.0, -19.0, 23.0].map(|step| step * shift % 180.0);
                let expected = robot.arm.forward(&joints) * tool;
                let (frames, tip) = chain.frames(&joints);
                assert_eq!(frames.len(), robot.arm.axes(), "{name}");
                assert!(distance(tip.position, expected.position) < 1e-2, "{name} {joints:?}: {tip:?}");
                let lean =
                    [0, 1, 2].map(|axis| tip.rotation.z_axis()[axis] - expected.rotation.z_axis()[axis]);
                assert!(lean.iter().all(|part| part.abs() < 1e-4), "{name} {joints:?}");
            }
        }
    }
}
