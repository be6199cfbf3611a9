//! Driving along the path, one robot cycle after another.
//!
//! With override, suspend and halt too the arm stays on its path exactly, also within a corner, and keeps every limit.
//! Where the law would take an axis a little beyond a limit, the arm goes slightly slower or faster than the law for a
//! moment, see [`Correction`]. Where the path cannot be driven on, the arm leaves it and brakes within the limits of its
//! axes.

use protocol::image::SLOTS;

use super::append::Appended;
use super::axis_monitor::AxisMonitor;
use super::correction::Correction;
use super::path::{Path, Place};
use super::segment::Segment;
use crate::arm::{Arm, Frame, Joints, Violation, length};

/// What rounding may add to the rating of an axis, as a share of it, before a cycle is corrected.
const ROUNDING: f64 = 1e-7;

/// How often a cycle is corrected: joints are not quite linear in the time.
const CORRECTIONS: usize = 3;

/// Step, as a share of the cycle, from which the slopes of the joints are taken.
const PROBE: f64 = 1e-3;

/// Largest correction, as a share of the cycle. What needs more is an error.
const MOST_CORRECTED: f64 = 0.1;

/// The place after a cycle, how much of the cycle is left behind the end of the path, and the joints there.
type Ahead = (Place, f64, Result<Joints, Violation>);

/// Outcome of one cycle.
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
    axes: AxisMonitor,
    correction: Correction,
    /// The law's seconds of the next cycle that pass before the arm starts from a rest.
    omitted_s: f64,
    /// The arm cannot go on along its path and brakes, or has braked.
    off_path: bool,
    /// The last cycle did not move the arm, or ended with the end of its path.
    is_at_rest: bool,
    /// The flange in the root.
    flange: Frame,
    /// The tool of the present motion, in the flange.
    tool_frame: Frame,
    tool: [f64; 3],
    tool_step: [f64; 3],
}

impl Interpolator {
    /// An arm that stands at `joints` and is interpolated every `cycle_s` seconds, with a queue of five motions.
    #[must_use]
    pub fn at_rest(arm: Arm, joints: Joints, cycle_s: f64) -> Self {
        Self::with_queue(arm, joints, cycle_s, SLOTS)
    }

    /// The same with a queue of this many motions.
    #[must_use]
    pub fn with_queue(arm: Arm, joints: Joints, cycle_s: f64, motions: usize) -> Self {
        let flange = arm.forward(&joints);
        Self {
            path: Path::at_rest(joints, cycle_s, motions),
            axes: AxisMonitor::at_rest(arm.limits(), &joints, cycle_s),
            correction: Correction::NONE,
            omitted_s: 0.0,
            arm,
            cycle_s,
            off_path: false,
            is_at_rest: true,
            flange,
            tool_frame: Frame::IDENTITY,
            tool: flange.position,
            tool_step: [0.0; 3],
        }
    }

    /// The joints now.
    #[must_use]
    pub const fn joints(&self) -> &Joints {
        self.axes.joints()
    }

    /// The flange in the root now.
    #[must_use]
    pub const fn flange(&self) -> &Frame {
        &self.flange
    }

    /// Speed of the tool over the last cycle, in mm/s.
    #[must_use]
    pub fn path_speed(&self) -> f64 {
        length(self.tool_step) / self.cycle_s
    }

    /// Whether the arm stands: it did not move in the last cycle, or came to the end of its path.
    #[must_use]
    pub fn is_at_rest(&self) -> bool {
        self.is_at_rest
    }

    /// The path.
    #[must_use]
    pub const fn path(&self) -> &Path {
        &self.path
    }

    /// Appends a motion to the path; see [`Path::append`].
    pub fn append(&mut self, segment: Segment, last: bool) -> Appended {
        self.path.append(segment, last, &self.arm)
    }

    /// Begins a batch; see [`Path::begin_batch`].
    pub fn begin_batch(&mut self) {
        self.path.begin_batch();
    }

    /// Appends a motion to the batch; see [`Path::append_to_batch`].
    pub fn append_to_batch(&mut self, segment: Segment, last: bool) {
        self.path.append_to_batch(segment, last, &self.arm);
    }

    /// Plans the batch; see [`Path::end_batch`].
    pub fn end_batch(&mut self) -> bool {
        self.path.end_batch()
    }

    /// No motion will follow; see [`Path::close`].
    pub fn close(&mut self) {
        self.path.close();
    }

    /// Removes all motions: the path starts anew where the arm is. The arm must be at rest.
    pub fn clear(&mut self) {
        self.path.clear(*self.axes.joints());
        self.correction = Correction::NONE;
        (self.off_path, self.is_at_rest) = (false, true);
        self.tool_step = [0.0; 3];
    }

    /// Removes all motions: the path starts anew at `joints`, to which something else than this interpolator has
    /// brought the arm.
    pub fn rest_at(&mut self, joints: &Joints) {
        if self.axes.joints() != joints || !self.axes.is_still() {
            self.axes = AxisMonitor::at_rest(self.arm.limits(), joints, self.cycle_s);
            self.flange = self.arm.forward(joints);
            self.tool = self.flange.origin_of(&self.tool_frame);
        }
        self.clear();
    }

    /// Stands still for a cycle, since there is nothing to drive. An arm that moves brakes within the limits of its
    /// axes.
    pub fn stand_still(&mut self) {
        if self.axes.is_still() {
            self.is_at_rest = true;
            self.tool_step = [0.0; 3];
        } else {
            self.go_to(&self.axes.braked());
        }
    }

    /// Lets the arm, which rests on its path, start within the next cycle: so many of the law's seconds of that cycle do not pass.
    pub const fn start_later(&mut self, law_s: f64) {
        self.omitted_s = law_s;
    }

    /// Drives one cycle with an override, 0…1, of the programmed speeds. At 0 the arm stops on its path as soon as its
    /// limits allow, and then [stands](Self::is_held) there; above 0 it goes on.
    ///
    /// # Errors
    ///
    /// The arm cannot go on although the checks of the motion passed, or the next cycle would exceed the ratings of an
    /// axis. The arm does not go there: it leaves the path and brakes, from this cycle on, until the path is
    /// [cleared](Self::clear).
    pub fn drive(&mut self, factor: f64) -> Result<Step, Violation> {
        self.take_up_tool();
        if self.off_path {
            self.stand_still();
            return Ok(Step { suppressed: None, ended: None });
        }
        self.path.set_override(factor, self.cycle_s);
        self.correction =
            if self.path.rests() { Correction::NONE } else { self.correction.faded(self.cycle_s) };
        if self.is_held() {
            self.stand_still();
            return Ok(Step { suppressed: None, ended: None });
        }
        let ((place, left, joints), keeps_ratings) = self.next_place();
        self.go_if_allowed(joints, keeps_ratings)?;
        self.omitted_s = 0.0;
        let suppressed = self.path.go_to(place);
        self.path.refine(self.cycle_s);
        Ok(Step { suppressed, ended: self.path.is_finished().then_some(left) })
    }

    /// Returns what is ahead, with the cycle corrected where an axis would not keep its ratings, and whether all axes keep them; what
    /// cannot be mended stays as planned.
    fn next_place(&mut self) -> (Ahead, bool) {
        let planned = self.no_faster_than_programmed();
        let (mut correction, mut next) = planned;
        for _ in 0..=CORRECTIONS {
            let (_, _, Ok(joints)) = &next else { break };
            if self.axes.keeps_ratings(joints, &self.arm, ROUNDING).is_ok() {
                self.correction = correction;
                return (next, true);
            }
            let probe = PROBE * self.cycle_s;
            let (_, _, Ok(later)) = self.place_with(correction.plus(probe)) else { break };
            let slopes = core::array::from_fn(|axis| (later[axis] - joints[axis]) / probe);
            let Some(seconds) = self.axes.least_shift(joints, &slopes, &self.arm) else { break };
            correction = correction.plus(seconds);
            if correction.share(self.cycle_s) > MOST_CORRECTED {
                break;
            }
            next = self.place_with(correction);
        }
        (planned.1, false)
    }

    /// Returns the correction that fades, and what is ahead with it. One that hurries ends where the arm would be faster than
    /// programmed, if the axes keep their ratings.
    fn no_faster_than_programmed(&self) -> (Correction, Ahead) {
        let planned = (self.correction, self.place_with(self.correction));
        if self.correction.seconds() <= 0.0 {
            return planned;
        }
        let most = self.path.most_more(self.cycle_s, &planned.1.0).max(0.0);
        if self.correction.seconds() <= most {
            return planned;
        }
        let correction = self.correction.with(most);
        let slower = self.place_with(correction);
        let keeps = |joints: &Joints| self.axes.keeps_ratings(joints, &self.arm, ROUNDING).is_ok();
        if slower.2.as_ref().is_ok_and(keeps) { (correction, slower) } else { planned }
    }

    fn place_with(&self, correction: Correction) -> Ahead {
        let (place, left) = self.path.ahead(self.cycle_s, correction.seconds() - self.omitted_s);
        (place, left, self.path.joints(place, &self.arm, self.axes.joints()))
    }

    /// Goes to joints that something else than the path gives, such as a force controller, with this tool. The path
    /// must be empty.
    ///
    /// # Errors
    ///
    /// As [`drive`](Self::drive), also if `joints` is an error.
    pub fn lead(&mut self, joints: Result<Joints, Violation>, tool_frame: &Frame) -> Result<(), Violation> {
        if *tool_frame != self.tool_frame {
            self.tool_frame = *tool_frame;
            self.tool = self.flange.origin_of(tool_frame);
        }
        if self.off_path {
            self.stand_still();
            return Ok(());
        }
        self.go_if_allowed(joints, false)
    }

    /// Goes to these joints, or leaves the path and brakes. `keeps_ratings` says that the axes are known to keep their ratings.
    fn go_if_allowed(
        &mut self,
        joints: Result<Joints, Violation>,
        keeps_ratings: bool,
    ) -> Result<(), Violation> {
        let check = |joints: &Joints| match keeps_ratings {
            true => self.arm.within_range(joints),
            false => self.axes.check(joints, &self.arm),
        };
        let allowed = joints.and_then(|joints| check(&joints).map(|()| joints));
        match allowed {
            Ok(joints) => {
                self.go_to(&joints);
                Ok(())
            }
            Err(violation) => {
                self.off_path = true;
                self.stand_still();
                Err(violation)
            }
        }
    }

    fn go_to(&mut self, joints: &Joints) {
        self.axes.go_to(joints);
        self.is_at_rest = self.axes.is_at_rest();
        self.flange = self.arm.forward(joints);
        let tool = self.flange.origin_of(&self.tool_frame);
        self.tool_step = core::array::from_fn(|i| tool[i] - self.tool[i]);
        self.tool = tool;
    }

    /// Whether the arm stands still on its path, stopped by override 0.
    #[must_use]
    pub fn is_held(&self) -> bool {
        self.path.is_held() && self.correction == Correction::NONE
    }

    /// Speed and acceleration of the tool are those of the present motion's own tool.
    fn take_up_tool(&mut self) {
        let present = self.path.current().map_or(self.tool_frame, |segment| segment.tool);
        if present != self.tool_frame {
            self.tool_frame = present;
            self.tool = self.flange.origin_of(&present);
        }
    }
}
