//! What must hold after every step.

use plc_node::function_blocks::{EnableOutputs, SkillState};

use super::cell::Explored;
use super::*;

impl Explored {
    fn keeps_the_override(&self, before: &Self) {
        let EnableOutputs { busy, enabled, error, .. } = self.overriding;
        assert!(!error && (busy || !enabled), "{:?}", self.set_override);
        let (now, feedback) = (&self.controller, self.controller.feedback());
        assert_eq!(f64::from(feedback.override_percent), now.factor * 100.0);
        let wrong = self.connected && self.seen.override_percent > 100;
        assert!(!wrong || now.factor == before.controller.factor, "a wrong override changes nothing");
        let warns = feedback.status.contains(Status::WARNING);
        assert_eq!(warns, wrong && !feedback.status.contains(Status::ERROR), "{feedback:?}");
        let stood = before.controller.factor == 0.0 && before.controller.interpolator.is_at_rest();
        assert!(!stood || now.factor > 0.0 || now.interpolator.is_at_rest(), "it starts at override 0");
    }

    /// Checks that an arm that stands does so until its master passes, and that it tells its law time only to a master.
    fn keeps_to_the_master(&self, before: &Self) {
        let led = self.connected && self.seen.control.contains(Control::SYNC);
        assert_eq!(self.controller.master.is_some(), led);
        let (was, now) = (&before.controller, &self.controller);
        let stands = led && self.seen.law_time_us == 0 && was.interpolator.is_at_rest();
        assert!(!stands || now.interpolator.is_at_rest(), "it starts without its master");
        let [earlier, later] = [was.feedback().law_time_us, now.feedback().law_time_us];
        assert!(led || later == 0, "{later} us without a master");
        let goes_on = led && was.master.is_some() && was.execution.is_some() && now.execution.is_some();
        assert!(
            !goes_on
                || later >= earlier
                || was.execution.map(|skill| skill.number) != now.execution.map(|skill| skill.number)
        );
    }

    /// Checks that the blocks' outputs agree with the robot whose image they read in this step.
    fn keeps_the_blocks_promises(&self, before: &Self) {
        let seen = before.controller.feedback();
        let halted = self.outputs[HALT].done && !before.outputs[HALT].done;
        assert!(!halted || seen.state == State::Ready, "a halt needs no reset: {seen:?}");
        let runs_on = self.connected && before.controller.execution.is_some();
        let stops = self.group.command().control.contains(Control::HALT);
        for block in [MOVE, SECOND] {
            let now = self.outputs[block];
            assert!(!now.command_interrupted || seen.state == State::Suspended, "{seen:?}");
            let failed = now.error && before.outputs[block].busy;
            assert!(!failed || !runs_on || stops, "an error of the block leaves the arm moving: {seen:?}");
        }
    }

    /// Checks that two blocks of skills take their turns.
    fn keeps_the_turns(&self, before: &Self) {
        assert!(!(self.outputs[MOVE].active && self.outputs[SECOND].active), "two skills at once");
        for (block, other) in [(MOVE, SECOND), (SECOND, MOVE)] {
            let ends = [before.outputs[other], self.outputs[other]];
            let may_start = match self.skills.mode() {
                BufferMode::Buffered => ends.iter().any(|end| end.done),
                _ => ends.iter().any(|end| !end.busy),
            };
            let (was, is) = (before.state(block), self.state(block));
            let stood = matches!(was, SkillState::Ready | SkillState::Halted);
            assert!(
                !stood || is != SkillState::Suspended,
                "{was:?} → {is:?} is none of the skill's transitions"
            );
            assert!(
                !self.takes_its_turn(before, block) || may_start,
                "block {block} starts, the other one is {ends:?}"
            );
        }
        assert!(!(self.waits(MOVE) && self.waits(SECOND)), "each waits for the other one");
    }

    /// Returns whether a block waits for its turn.
    pub(super) fn waits(&self, block: usize) -> bool {
        self.outputs[block].busy && self.state(block) == SkillState::Ready
    }

    /// Returns whether a block that waited starts its skill.
    pub(super) fn takes_its_turn(&self, before: &Self, block: usize) -> bool {
        before.waits(block) && self.outputs[block].busy && !self.waits(block)
    }

    pub(super) fn keeps_the_rules(&self, before: &Self) {
        self.keeps_the_override(before);
        self.keeps_to_the_master(before);
        self.keeps_the_blocks_promises(before);
        self.keeps_the_turns(before);
        for outputs in self.outputs {
            let shown = [outputs.busy, outputs.done, outputs.command_aborted, outputs.error];
            assert!(shown.iter().filter(|shown| **shown).count() <= 1, "PLCopen: {outputs:?}");
            assert!(!outputs.active || outputs.busy, "PLCopen: {outputs:?}");
            assert!(!outputs.command_interrupted || (outputs.busy && !outputs.active), "{outputs:?}");
        }
        let feedback = self.controller.feedback();
        let ended = [Status::BUSY, Status::DONE, Status::ABORTED, Status::ERROR];
        let shown = ended.iter().filter(|status| feedback.status.contains(**status)).count();
        assert!(shown <= 1, "{feedback:?}");
        let moved = self.controller.joints() != before.controller.joints();
        let state = self.controller.state;
        let skill = before.controller.execution.is_some();
        assert!(!moved || skill, "the arm moves in {state:?} without a skill");
        if state != State::Running {
            assert!(self.controller.interpolator.is_at_rest(), "{state:?} and not at rest");
        }
        if matches!(state, State::Halted | State::Ready) {
            assert!(self.controller.execution.is_none(), "a skill in {state:?}");
        }
        let targets = self.skills.targets();
        let joint_3 = self.joint_3();
        let is = |target: f64| (joint_3 - target).abs() < 1e-4;
        let executed = feedback.executed as usize;
        assert!(feedback.executed <= feedback.accepted && executed <= targets.len(), "{feedback:?}");
        if feedback.status.contains(Status::BUSY) && feedback.number == before.controller.feedback().number {
            assert!(feedback.executed >= before.controller.feedback().executed, "a motion counts twice");
        }
        // Between the ends of the last executed motion and of the present one: none is left out, none runs again.
        let last = executed.checked_sub(1).filter(|last| !self.skills.presses(*last));
        let ends = last.map(|last| targets[last]).zip(targets.get(executed));
        if let (Some((from, to)), true) = (ends, feedback.status.contains(Status::BUSY)) {
            let (low, high) = (from.min(*to) - 1e-4, from.max(*to) + 1e-4);
            assert!((low..=high).contains(&joint_3), "at {joint_3} in motion {executed}: {feedback:?}");
        }
        if feedback.status.contains(Status::DONE) {
            assert!(
                executed == targets.len() && (is(targets[executed - 1]) || moved),
                "{feedback:?} at {joint_3}"
            );
        }
        if feedback.status.contains(Status::ERROR) && feedback.error == ErrorNumber::AxisLimit {
            assert_eq!((feedback.error_motion, feedback.executed), (5, 5));
            assert!(is(targets[4]), "not at the last good motion but at {joint_3}");
        }
        for block in [MOVE, SECOND] {
            if self.outputs[block].done && !before.outputs[block].done {
                assert_eq!(before.controller.feedback().executed as usize, targets.len());
            }
        }
    }
}
