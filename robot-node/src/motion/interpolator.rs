//! Driving along the path, one robot cycle after another.
//!
//! Override, suspend and halt slow the path's time down: the arm stays on its path exactly, also within a corner,
//! and every limit that the plan keeps is kept. Velocities follow the factor, accelerations its square.

use super::path::{Appended, Path};
use super::segment::Segment;
use crate::arm::{AXES, Arm, Frame, Joints, Violation, distance};

/// How finely the factor is found while it changes: to 2⁻¹² of its change.
const HALVINGS: usize = 12;

/// What came of one cycle.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Step {
    /// The motion, counted from 0, that has reached its decision point without a successor.
    pub suppressed: Option<u32>,
    /// Seconds of the cycle that were left when the path ended; none while there is path ahead.
    pub ended: Option<f64>,
}

/// The arm on its path.
#[derive(Clone, Debug)]
pub struct Interpolator {
    arm: Arm,
    path: Path,
    cycle_s: f64,
    /// Highest acceleration of the tool, in mm/s².
    tool_acceleration: f64,
    /// Seconds of path that the last cycle took, as a share of the cycle.
    factor: f64,
    joints: Joints,
    /// What the last cycle moved.
    joint_step: Joints,
    /// The tool of the present motion, in the flange.
    tool_frame: Frame,
    tool: [f64; 3],
    tool_step: [f64; 3],
}

impl Interpolator {
    /// An arm that stands at `joints` and is interpolated every `cycle_s` seconds.
    #[must_use]
    pub fn at_rest(arm: Arm, joints: Joints, cycle_s: f64, tool_acceleration: f64) -> Self {
        let tool = arm.forward(&joints).position;
        Self {
            path: Path::at_rest(joints),
            arm,
            cycle_s,
            tool_acceleration,
            factor: 1.0,
            joints,
            joint_step: [0.0; AXES],
            tool_frame: Frame::IDENTITY,
            tool,
            tool_step: [0.0; 3],
        }
    }

    /// The joints now.
    #[must_use]
    pub const fn joints(&self) -> &Joints {
        &self.joints
    }

    /// Speed of the tool over the last cycle, in mm/s.
    #[must_use]
    pub fn path_speed(&self) -> f64 {
        crate::arm::length(self.tool_step) / self.cycle_s
    }

    /// Whether the arm did not move in the last cycle.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        self.joint_step == [0.0; AXES]
    }

    /// The path.
    #[must_use]
    pub const fn path(&self) -> &Path {
        &self.path
    }

    /// Puts one more motion at the path's end; see [`Path::append`].
    pub fn append(&mut self, segment: Segment, last: bool) -> Appended {
        self.path.append(segment, last, &self.arm)
    }

    /// No motion will follow; see [`Path::close`].
    pub fn close(&mut self) {
        self.path.close();
    }

    /// Forgets the path. The arm must be at rest, or about to be: it stands still from here on.
    pub fn clear(&mut self) {
        self.path.clear(self.joints);
        self.factor = 1.0;
        self.stand_still();
    }

    /// Stands still for a cycle: nothing to drive, or not yet.
    pub fn stand_still(&mut self) {
        (self.joint_step, self.tool_step) = ([0.0; AXES], [0.0; 3]);
    }

    /// Drives one cycle at `target` (0…1) of the planned speed, or as near to it as the limits allow to change.
    pub fn drive(&mut self, target: f64) -> Result<Step, Violation> {
        self.take_up_tool();
        let standing = self.is_at_rest() && target > 0.0 && self.factor > 0.0;
        if standing || (self.factor - target).abs() < 1e-9 {
            // From rest, the plan's own acceleration is all there is to limit.
            self.factor = target;
        } else {
            self.factor = self.nearest_factor(target)?;
        }
        let (place, left) = self.path.ahead(self.factor * self.cycle_s);
        let joints = self.path.joints(place, &self.arm, &self.joints)?;
        let tool = self.tool_of(&joints);
        self.joint_step = core::array::from_fn(|axis| joints[axis] - self.joints[axis]);
        self.tool_step = core::array::from_fn(|i| tool[i] - self.tool[i]);
        (self.joints, self.tool) = (joints, tool);
        let suppressed = self.path.go_to(place);
        let ended = self.path.is_finished().then(|| left / self.factor.max(1e-9));
        Ok(Step { suppressed, ended })
    }

    /// Goes to joints that something else than the path leads to, such as a force, with this tool. The path must be
    /// empty; whoever leads keeps the limits.
    pub fn lead(&mut self, joints: Joints, tool_frame: &Frame) {
        if *tool_frame != self.tool_frame {
            self.tool_frame = *tool_frame;
            self.tool = self.tool_of(&self.joints);
        }
        let tool = self.tool_of(&joints);
        self.joint_step = core::array::from_fn(|axis| joints[axis] - self.joints[axis]);
        self.tool_step = core::array::from_fn(|i| tool[i] - self.tool[i]);
        (self.joints, self.tool) = (joints, tool);
    }

    /// Whether the path's time stands still.
    #[must_use]
    pub fn is_held(&self) -> bool {
        self.factor == 0.0
    }

    /// The factor nearest to `target` with which no joint, and not the tool, changes its speed by more than its
    /// acceleration allows in one cycle.
    fn nearest_factor(&self, target: f64) -> Result<f64, Violation> {
        if self.keeps_limits(target)? {
            return Ok(target);
        }
        let (mut kept, mut broken) = (self.factor, target);
        for _ in 0..HALVINGS {
            let middle = (kept + broken) / 2.0;
            if self.keeps_limits(middle)? { kept = middle } else { broken = middle }
        }
        Ok(kept)
    }

    fn keeps_limits(&self, factor: f64) -> Result<bool, Violation> {
        let (place, _) = self.path.ahead(factor * self.cycle_s);
        let joints = self.path.joints(place, &self.arm, &self.joints)?;
        let square = self.cycle_s * self.cycle_s;
        let change =
            core::array::from_fn(|axis| (joints[axis] - self.joints[axis] - self.joint_step[axis]) / square);
        let joints_keep = self.arm.limits().acceleration_load(&change).share <= 1.0;
        let on_a_line = self.path.current().is_some_and(|segment| segment.tool_acceleration.is_finite());
        if !joints_keep || !on_a_line {
            return Ok(joints_keep);
        }
        let tool = self.tool_of(&joints);
        let expected = core::array::from_fn(|i| self.tool[i] + self.tool_step[i]);
        Ok(distance(expected, tool) <= self.tool_acceleration * square)
    }

    /// Speed and acceleration of the tool are those of the present motion's own tool.
    fn take_up_tool(&mut self) {
        let present = self.path.current().map_or(self.tool_frame, |segment| segment.tool);
        if present != self.tool_frame {
            self.tool_frame = present;
            self.tool = self.tool_of(&self.joints);
        }
    }

    fn tool_of(&self, joints: &Joints) -> [f64; 3] {
        let flange = self.arm.forward(joints);
        if self.tool_frame == Frame::IDENTITY { flange.position } else { (flange * self.tool_frame).position }
    }
}
