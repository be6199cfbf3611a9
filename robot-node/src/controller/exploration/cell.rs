//! The PLC's blocks and the robot's controller, step by step.

use plc_node::function_blocks::{
    EnableOutputs, GroupContinue, GroupHalt, GroupInterrupt, GroupReset, GroupSetOverride, GroupStop,
    MoveContinuous, MoveTrajectory, Outputs, OverrideFactors, SkillState,
};
use plc_node::{AxesGroup, WaitLimits};

use super::*;

#[derive(Clone)]
pub(super) struct Explored {
    pub(super) controller: Controller,
    pub(super) at: Instant,
    pub(super) group: AxesGroup,
    motion: MoveContinuous,
    second: MoveContinuous,
    points: MoveTrajectory,
    stop: GroupStop,
    reset: GroupReset,
    interrupt: GroupInterrupt,
    go_on: GroupContinue,
    halt: GroupHalt,
    pub(super) set_override: GroupSetOverride,
    pub(super) velocity: Velocity,
    pub(super) lead: Lead,
    pub(super) overriding: EnableOutputs,
    execute: [bool; BLOCKS],
    pub(super) outputs: [Outputs; BLOCKS],
    /// Scans for which each block has been busy.
    busy: [u32; BLOCKS],
    enabled: bool,
    pub(super) connected: bool,
    /// The image that the robot had last, and the one before.
    pub(super) seen: Command,
    pub(super) seen_before: Command,
    pub(super) skills: Skills,
}

impl Explored {
    pub(super) fn new(skills: Skills) -> Self {
        Self {
            controller: Controller::new(skills.config(), Vec::new(), 1),
            at: Instant::ZERO,
            group: AxesGroup::new(WaitLimits { answer_scans: PATIENCE, silent_scans: u32::MAX }),
            motion: MoveContinuous::default(),
            second: MoveContinuous::default(),
            points: skills.trajectory(),
            stop: GroupStop::default(),
            reset: GroupReset::default(),
            interrupt: GroupInterrupt::default(),
            go_on: GroupContinue::default(),
            halt: GroupHalt::default(),
            set_override: GroupSetOverride::default(),
            velocity: Velocity::Full,
            lead: Lead::Free,
            overriding: EnableOutputs::default(),
            execute: [false; BLOCKS],
            outputs: [Outputs::default(); BLOCKS],
            busy: [0; BLOCKS],
            enabled: true,
            connected: true,
            seen: Command::default(),
            seen_before: Command::default(),
            skills,
        }
    }

    pub(super) fn joint_3(&self) -> f64 {
        self.controller.joints()[2]
    }

    /// Runs one scan and one robot cycle, and checks the rules.
    pub(super) fn step(&self, change: Change, source: &mut dyn MotionSource) -> Self {
        let mut next = self.clone();
        match change {
            Change::Nothing | Change::LostFrame | Change::OldFrame => {}
            Change::RestartPlc => next.restart_plc(),
            Change::RestartRobot => next.restart_robot(),
            Change::Execute(block) => next.execute[block] = true,
            Change::Override(velocity) => next.velocity = velocity,
            Change::Master(lead) => next.lead = lead,
            Change::Enable => next.enabled = !next.enabled,
            Change::Connection => next.connected = !next.connected,
        }
        if !next.connected {
            next.group.disarm();
            next.seen_before = Command::default();
        }
        next.group.read(next.connected.then_some(*next.controller.feedback()));
        next.group.set_control(Control::ENABLE, next.enabled && next.connected);
        let [execute_move, stop, reset, interrupt, resume, halt, second] = next.execute;
        let mode = next.skills.mode();
        next.outputs = [
            match next.skills {
                Skills::Points(..) => next.points.call(execute_move, source, mode, &mut next.group),
                _ => next.motion.call(execute_move, source, mode, &mut next.group),
            },
            next.stop.call(stop, &mut next.group),
            next.reset.call(reset, &mut next.group),
            next.interrupt.call(interrupt, &mut next.group),
            next.go_on.call(resume, &mut next.group),
            next.halt.call(halt, &mut next.group),
            next.second.call(second, source, mode, &mut next.group),
        ];
        next.overrides();
        for ((busy, execute), outputs) in next.busy.iter_mut().zip(&mut next.execute).zip(next.outputs) {
            *busy = if outputs.busy { (*busy + 1).min(PATIENCE + 1) } else { 0 };
            // The next scan takes it back.
            *execute &= outputs.busy;
        }
        if change == Change::OldFrame {
            // One of another command the node refuses by its life counter.
            if next.seen_before.number == next.seen.number {
                next.seen = next.seen_before;
            }
        } else if change != Change::LostFrame {
            next.seen_before = next.seen;
            next.seen = *next.group.command();
            next.plant_fault(source);
            if next.velocity == Velocity::Wrong {
                next.seen.override_percent = 200;
            }
            next.seen.control.set(Control::SYNC, next.lead != Lead::Free);
            next.seen.law_time_us = if next.lead == Lead::Ahead { u32::MAX } else { 0 };
        }
        next.at += next.controller.config.cycle;
        next.controller.tick(next.at, next.connected.then_some(&next.seen));
        next.controller.events.clear();
        next.keeps_the_rules(self);
        next
    }

    /// Calls the override's block. It knows nothing of a PLC that writes past it.
    fn overrides(&mut self) {
        let velocity = if self.velocity == Velocity::Stop { 0.0 } else { 1.0 };
        let factors = OverrideFactors { velocity, ..OverrideFactors::default() };
        // Old images would make it fail for no fault of its own.
        let meets_old_images = matches!(self.skills, Skills::Points(..));
        let is_called = self.connected && self.velocity != Velocity::Wrong && !meets_old_images;
        self.overriding = self.set_override.call(is_called, &factors, &mut self.group);
    }

    /// Returns the state of a block's skill.
    pub(super) const fn state(&self, block: usize) -> SkillState {
        match (block, self.skills) {
            (SECOND, _) => self.second.state(),
            (_, Skills::Points(..)) => self.points.state(),
            _ => self.motion.state(),
        }
    }

    /// Returns everything that decides what can follow, without running numbers and small differences of place and speed.
    pub(super) fn key(&self) -> impl std::hash::Hash + Eq + use<> {
        let Controller {
            state,
            last_number,
            pending,
            execution,
            reset_armed,
            hold,
            factor,
            wrong_override,
            interpolator,
            ..
        } = &self.controller;
        let feedback = self.controller.feedback();
        let number = self.group.command().number;
        let seen = self.seen.number == number;
        let skill = execution.as_ref().map(|execution| {
            let phase = match execution.phase {
                Phase::Dispatch { .. } => 0,
                Phase::Driving => 1,
                Phase::Arriving | Phase::Waiting { .. } => 2,
                Phase::Settling { .. } => 3,
                Phase::Stopping(Ending::Halted) => 4,
                Phase::Stopping(Ending::Cancelled) => 6,
                Phase::Meeting(_) => 7,
                Phase::Stopping(_) => 5,
            };
            (execution.number == number, execution.accepted, phase, execution.bad.is_some())
        });
        let robot = (
            u8::from(*state),
            last_number.map(|last| last == number),
            (pending.is_some(), *reset_armed, *hold, *factor == 0.0, *wrong_override),
            (skill, self.controller.press.as_ref().map(|press| press.phase as u8)),
            (feedback.status.0, feedback.number == number, self.executed_key(), u16::from(feedback.error)),
            (interpolator.path().is_finished(), self.executed_on_path_key(), interpolator.is_held()),
            ((self.joint_3() / self.skills.place_mm()).round() as i64, interpolator.is_at_rest()),
        );
        let command = self.group.command();
        let plc = (
            (command.control.0, command.total, command.written),
            (self.execute, self.outputs, self.busy, [MOVE, SECOND].map(|block| self.state(block))),
            (self.velocity, self.overriding, self.seen.override_percent, command.override_percent),
            (self.enabled, self.connected, seen, self.seen.control.0),
            (self.lead, self.seen.law_time_us, self.controller.master.map(|master| master.asks_for_rest())),
            self.points_key(),
        );
        (robot, plc)
    }

    /// Withdraws all requests, halts and resets: from every state the arm must come to rest and the robot become ready.
    pub(super) fn leads_back_to_ready(&self, source: &mut dyn MotionSource) -> Self {
        let mut now = self.clone();
        (now.connected, now.enabled, now.execute) = (true, true, [false; BLOCKS]);
        for _ in 0..3 {
            now = now.step(Change::Nothing, source);
        }
        // A block that waits for its turn would start its skill after the reset.
        if now.controller.state != State::Halted || [MOVE, SECOND].iter().any(|block| now.waits(*block)) {
            now = now.reaches_done(STOP, source);
        }
        assert!(now.controller.interpolator.is_at_rest());
        now = now.reaches_done(RESET, source);
        assert_eq!(now.controller.state, State::Ready, "Reset does not lead to Ready");
        assert!(!now.controller.feedback().status.contains(Status::ERROR));
        now
    }

    fn reaches_done(mut self, block: usize, source: &mut dyn MotionSource) -> Self {
        for _ in 0..4 * PATIENCE {
            self = self.step(Change::Execute(block), source);
            for _ in 0..40 {
                if !self.outputs[block].busy {
                    break;
                }
                self = self.step(Change::Nothing, source);
            }
            let done = self.outputs[block].done;
            self = self.step(Change::Nothing, source);
            if done {
                return self;
            }
        }
        panic!("block {block} does not come to Done: {:?}", self.controller.feedback());
    }
}
