//! Where the arm stands before a run: how it gets there, and how the PLC knows that it is there.
//!
//! An application mostly names the start by a pose, and the arm may reach a pose with other joints, by a full turn of the
//! wrist for instance. So the PLC remembers the joints with which the robot got there first, and moves to those from then
//! on: all runs begin with the same joints.

use machine::Instant;
use planning::ToStart;
use protocol::image::{Feedback, Motion, MotionKind};

use crate::sequence::{Reach, Sequence, SkillProgress};
use crate::{AxesGroup, ExecutionType, MotionList};

/// How far each joint may be from where it was the first time, in degrees (mm): more than the image rounds away, less than
/// a drive's repeatability.
const TOLERANCE: f32 = 1e-3;

/// The start of the runs, and the way there.
#[derive(Debug)]
pub(super) struct StartPosition {
    from_anywhere: MotionList,
    from_end: MotionList,
    /// The joints of the start, in degrees (mm): the application's, or those with which the arm first got there.
    joints: Option<[f32; 6]>,
    /// The motions under way, as single skills.
    under_way: Sequence,
    is_from_end: bool,
    /// Set once the arm has set out on the way that was begun last.
    has_set_out: bool,
    /// Whether the arm was moved there. Until then the robot does not know the application's tool and base, in which it
    /// is to report its pose.
    was_moved: bool,
}

impl StartPosition {
    pub(super) fn new(to_start: ToStart<Motion>) -> Self {
        let from_anywhere: Vec<Motion> = to_start.from_anywhere.into_iter().collect();
        let known = from_anywhere.first().filter(|motion| motion.kind.has_joint_target());
        Self {
            joints: known.map(|motion| motion.target),
            from_anywhere: from_anywhere.into(),
            from_end: to_start.from_end.into(),
            under_way: Sequence::new(ExecutionType::Sm, 0, 1),
            is_from_end: false,
            has_set_out: false,
            was_moved: false,
        }
    }

    /// Returns whether the arm is at the start and was moved there at least once, or no start is known.
    pub(super) fn is_reached(&self, feedback: Option<&Feedback>) -> bool {
        if self.from_anywhere.is_empty() {
            return true;
        }
        let Some((start, now)) = self.joints.zip(feedback.map(|feedback| feedback.joints)) else {
            return false;
        };
        self.was_moved && start.iter().zip(now).all(|(start, now)| (start - now).abs() <= TOLERANCE)
    }

    /// Begins to move there. From the end of the sequence, the planned way is free of the application's obstacles; from
    /// other positions this is unknown.
    pub(super) fn begin(&mut self, is_at_end: bool) {
        self.under_way = Sequence::new(ExecutionType::Sm, 0, 1);
        self.is_from_end = is_at_end && !self.from_end.is_empty();
        self.has_set_out = false;
    }

    /// Returns whether the arm has set out on the way that was begun last.
    pub(super) const fn has_set_out(&self) -> bool {
        self.has_set_out
    }

    /// Returns whether the way that was begun last leads from the end of the sequence.
    pub(super) const fn comes_from_end(&self) -> bool {
        self.is_from_end
    }

    /// Runs one scan while the arm moves to the start.
    pub(super) fn scan(&mut self, now: Instant, group: &mut AxesGroup) -> SkillProgress {
        self.has_set_out = true;
        let motions = if self.is_from_end { &mut self.from_end } else { &mut self.from_anywhere };
        let progress = self.under_way.scan(now, motions, &[], Reach::END, group);
        if progress == SkillProgress::Done {
            self.was_moved = true;
            if self.joints.is_none() {
                self.remember(group.feedback());
            }
        }
        progress
    }

    fn remember(&mut self, feedback: Option<&Feedback>) {
        self.joints = feedback.map(|feedback| feedback.joints);
        let Some(target) = self.joints else { return };
        for motion in
            [&mut self.from_anywhere, &mut self.from_end].into_iter().filter_map(MotionList::last_mut)
        {
            *motion = Motion { kind: MotionKind::PtpJoint, target, configuration: None, ..*motion };
        }
    }
}
