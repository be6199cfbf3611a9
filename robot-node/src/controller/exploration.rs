//! Robot and PLC together in every order of commands, losses of connection and faults, until no new state turns up.
//!
//! A step is one scan of the PLC's function blocks, and one robot cycle on the image that they wrote. Before each, one
//! thing may change: `Execute` of a block rises, and falls when the block has ended; the override, to 0, to 100 % or to
//! one that is none; `enable`; the connection; or the robot gets an old image once more, which is what a lost frame comes to. From every state all of them are tried. (All
//! orders of `Execute` alone are the affair of the blocks' own exploration.)
//!
//! States count as one when they differ in running numbers, or by less than [`Skills::place_mm`] in place and not in whether
//! the arm rests: with that the exploration closes. So it is exhaustive over the discrete states and their order, not
//! over places.

use std::collections::HashSet;

use core::time::Duration;

use plc_node::function_blocks::{
    EnableOutputs, GroupSetOverride, Halt, MoveContinuous, Outputs, OverrideFactors, Reset, Resume, Suspend,
};
use plc_node::{AxesGroup, MotionList, Patience};
use protocol::image::{Motion, MotionKind};

use super::execution::Phase;
use super::*;
use crate::ForceControl;
use crate::arm::Surface;

/// Scans that the PLC waits for an answer.
const PATIENCE: u32 = 4;

/// The blocks, and the index of each.
const BLOCKS: usize = 5;
const MOVE: usize = 0;
const HALT: usize = 1;
const RESET: usize = 2;
const SUSPEND: usize = 3;
const RESUME: usize = 4;

/// What changes before a step.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Change {
    Nothing,
    /// `Execute` of a block rises.
    Execute(usize),
    /// The velocity factor of the override.
    Override(Velocity),
    Enable,
    Connection,
    LostFrame,
}

/// What the PLC wants of the override.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
enum Velocity {
    Full,
    Stop,
    /// Above 100 %: a PLC writes it past its function block.
    Wrong,
}

const CHANGES: [Change; 12] = [
    Change::Nothing,
    Change::Execute(MOVE),
    Change::Execute(HALT),
    Change::Execute(RESET),
    Change::Execute(SUSPEND),
    Change::Execute(RESUME),
    Change::Override(Velocity::Full),
    Change::Override(Velocity::Stop),
    Change::Override(Velocity::Wrong),
    Change::Enable,
    Change::Connection,
    Change::LostFrame,
];

/// What MoveContinuous runs.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Skills {
    /// Three motions.
    Good,
    /// Six motions, the last one out of reach: it comes when the run is under way.
    Bad,
    /// A motion, a LIN force, a motion.
    Pressing,
}

/// Joint 3 at power-on, in mm.
const HOME: f64 = 175.0;

impl Skills {
    /// Joint 3 at the ends of the motions, in mm; of a LIN force where its line ends.
    fn targets(self) -> &'static [f64] {
        match self {
            Self::Good => &[HOME - 0.1, HOME - 0.2, HOME - 0.05],
            Self::Bad => &[HOME - 0.06, HOME - 0.12, HOME - 0.06, HOME - 0.12, HOME - 0.06, HOME + 100.0],
            Self::Pressing => &[HOME - 0.1, HOME - 1.0, HOME - 0.05],
        }
    }

    fn motions(self) -> Vec<Motion> {
        let config = config();
        let to = |joint_3: f64| {
            let mut target = config.home.map(|joint| joint as f32);
            target[2] = joint_3 as f32;
            let kind = MotionKind::PtpJoint;
            Motion { kind, target, velocity: 10_000, acceleration: 10_000, ..Motion::EMPTY }
        };
        let mut motions: Vec<Motion> = self.targets().iter().copied().map(to).collect();
        if self == Self::Pressing {
            let mut joints = config.home;
            joints[2] = self.targets()[1];
            let target = config.arm.forward(&joints).to_mm_deg().map(|coordinate| coordinate as f32);
            let (kind, auxiliary) = (MotionKind::LinForceCartesian, [0.0, 0.0, -25.0]);
            motions[1] =
                Motion { kind, target, auxiliary, velocity: 100, acceleration: 5_000, ..Motion::EMPTY };
        }
        motions
    }

    /// Places nearer to each other than this count as one. A force is approached slowly, so that there are many.
    const fn place_mm(self) -> f64 {
        match self {
            Self::Good | Self::Bad => 0.02,
            Self::Pressing => 0.15,
        }
    }

    /// Whether the change is tried on this skill: what a wrong override does depends on no motion.
    fn meets(self, change: Change) -> bool {
        self == Self::Good || change != Change::Override(Velocity::Wrong)
    }

    /// Whether motion `index` ends where the surface says, not where its target is.
    fn presses(self, index: usize) -> bool {
        self == Self::Pressing && index == 1
    }
}

fn config() -> RobotConfig {
    let setup = setup::setup("A").unwrap();
    let mut config = RobotConfig {
        interpreter_quantum: Duration::ZERO,
        skill_overhead: Duration::ZERO,
        ..RobotConfig::from_setup(&setup).unwrap()
    };
    let [x, y, z] = config.arm.forward(&config.home).position;
    config.surfaces = vec![Surface {
        point: [x, y, z - 0.3],
        normal: [0.0, 0.0, 1.0],
        radius_mm: f64::INFINITY,
        stiffness_n_per_mm: 50.0,
    }];
    // As short as can be: how far it has settled is no state of its own here.
    config.force = config.force.map(|force| ForceControl { settling: Duration::from_millis(4), ..force });
    config
}

#[derive(Clone)]
struct Explored {
    controller: Controller,
    at: Instant,
    group: AxesGroup,
    motion: MoveContinuous,
    halt: Halt,
    reset: Reset,
    suspend: Suspend,
    resume: Resume,
    set_override: GroupSetOverride,
    velocity: Velocity,
    overriding: EnableOutputs,
    execute: [bool; BLOCKS],
    outputs: [Outputs; BLOCKS],
    /// Scans for which each block has been busy.
    busy: [u32; BLOCKS],
    enabled: bool,
    connected: bool,
    /// The image that the robot had last.
    seen: Command,
    skills: Skills,
}

impl Explored {
    fn new(skills: Skills) -> Self {
        Self {
            controller: Controller::new(config(), Vec::new(), 1),
            at: Instant::ZERO,
            group: AxesGroup::new(Patience { answer_scans: PATIENCE, silent_scans: u32::MAX }),
            motion: MoveContinuous::default(),
            halt: Halt::default(),
            reset: Reset::default(),
            suspend: Suspend::default(),
            resume: Resume::default(),
            set_override: GroupSetOverride::default(),
            velocity: Velocity::Full,
            overriding: EnableOutputs::default(),
            execute: [false; BLOCKS],
            outputs: [Outputs::default(); BLOCKS],
            busy: [0; BLOCKS],
            enabled: true,
            connected: true,
            seen: Command::default(),
            skills,
        }
    }

    fn joint_3(&self) -> f64 {
        self.controller.joints()[2]
    }

    /// One scan and one robot cycle, checked against the rules.
    fn step(&self, change: Change, source: &mut MotionList) -> Self {
        let mut next = self.clone();
        match change {
            Change::Nothing | Change::LostFrame => {}
            Change::Execute(block) => next.execute[block] = true,
            Change::Override(velocity) => next.velocity = velocity,
            Change::Enable => next.enabled = !next.enabled,
            Change::Connection => next.connected = !next.connected,
        }
        if !next.connected {
            next.group.disarm();
        }
        next.group.read(next.connected.then_some(*next.controller.feedback()));
        next.group.set_control(Control::ENABLE, next.enabled && next.connected);
        let [execute_move, halt, reset, suspend, resume] = next.execute;
        next.outputs = [
            next.motion.call(execute_move, source, &mut next.group),
            next.halt.call(halt, &mut next.group),
            next.reset.call(reset, &mut next.group),
            next.suspend.call(suspend, &mut next.group),
            next.resume.call(resume, &mut next.group),
        ];
        next.overrides();
        for ((busy, execute), outputs) in next.busy.iter_mut().zip(&mut next.execute).zip(next.outputs) {
            *busy = if outputs.busy { (*busy + 1).min(PATIENCE + 1) } else { 0 };
            // The next scan takes it back.
            *execute &= outputs.busy;
        }
        if change != Change::LostFrame {
            next.seen = *next.group.command();
            if next.velocity == Velocity::Wrong {
                next.seen.override_percent = 200;
            }
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
        let is_called = self.connected && self.velocity != Velocity::Wrong;
        self.overriding = self.set_override.call(is_called, &factors, &mut self.group);
    }

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

    fn keeps_the_rules(&self, before: &Self) {
        self.keeps_the_override(before);
        for outputs in self.outputs {
            let shown = [outputs.busy, outputs.done, outputs.command_aborted, outputs.error];
            assert!(shown.iter().filter(|shown| **shown).count() <= 1, "PLCopen: {outputs:?}");
            assert!(!outputs.active || outputs.busy, "PLCopen: {outputs:?}");
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
        if self.outputs[MOVE].done && !before.outputs[MOVE].done {
            assert_eq!(before.controller.feedback().executed as usize, targets.len());
        }
    }

    /// All that decides what can come, but for running numbers and small differences of place and speed.
    fn key(&self) -> impl std::hash::Hash + Eq + use<> {
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
                Phase::Waiting { .. } => 2,
                Phase::Settling { .. } => 3,
                Phase::Stopping(Ending::Aborted) => 4,
                Phase::Stopping(_) => 5,
            };
            (execution.number == number, execution.accepted, phase, execution.bad.is_some())
        });
        let robot = (
            u8::from(*state),
            last_number.map(|last| last == number),
            (pending.is_some(), *reset_armed, *hold, *factor == 0.0, *wrong_override),
            (skill, self.controller.press.as_ref().map(|press| press.phase as u8)),
            (feedback.status.0, feedback.number == number, feedback.executed, u16::from(feedback.error)),
            (interpolator.path().is_finished(), interpolator.path().executed(), interpolator.is_held()),
            ((self.joint_3() / self.skills.place_mm()).round() as i64, interpolator.is_at_rest()),
        );
        let command = self.group.command();
        let plc = (
            (command.control.0, command.total, command.written),
            (self.execute, self.outputs, self.busy),
            (self.velocity, self.overriding, self.seen.override_percent, command.override_percent),
            (self.enabled, self.connected, seen, self.seen.control.0),
        );
        (robot, plc)
    }

    /// Takes everything back, halts and resets: the arm must rest and the robot be ready, from wherever it was.
    fn leads_back_to_ready(&self, source: &mut MotionList) -> Self {
        let mut now = self.clone();
        (now.connected, now.enabled, now.execute) = (true, true, [false; BLOCKS]);
        for _ in 0..3 {
            now = now.step(Change::Nothing, source);
        }
        if now.controller.state != State::Halted {
            now = now.reaches_done(HALT, source);
        }
        assert!(now.controller.interpolator.is_at_rest());
        now = now.reaches_done(RESET, source);
        assert_eq!(now.controller.state, State::Ready, "Reset does not lead to Ready");
        assert!(!now.controller.feedback().status.contains(Status::ERROR));
        now
    }

    fn reaches_done(mut self, block: usize, source: &mut MotionList) -> Self {
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

/// Explores everything that can come; returns how many states there are, and the ends that MoveContinuous came to.
fn explore(skills: Skills) -> (usize, HashSet<Outputs>, HashSet<u8>) {
    let mut source = MotionList::from(skills.motions());
    let start = Explored::new(skills);
    let mut found = HashSet::from([start.key()]);
    let (mut ends, mut states) = (HashSet::new(), HashSet::new());
    let mut open = vec![start];
    while let Some(state) = open.pop() {
        state.leads_back_to_ready(&mut source);
        for change in CHANGES.into_iter().filter(|change| skills.meets(*change)) {
            let next = state.step(change, &mut source);
            ends.insert(next.outputs[MOVE]);
            states.insert(u8::from(next.controller.state));
            if found.insert(next.key()) {
                open.push(next);
            }
        }
        assert!(found.len() < 2_000_000, "the exploration must end, and {} states are open", open.len());
    }
    (found.len(), ends, states)
}

#[test]
fn a_skill_of_good_motions_keeps_all_rules_in_every_order_of_commands_losses_and_faults() {
    let (found, ends, states) = explore(Skills::Good);
    println!("{found} states");
    assert!(ends.iter().any(|end| end.done) && ends.iter().any(|end| end.command_aborted));
    assert!(ends.iter().any(|end| end.error));
    assert_eq!(states.len(), 4, "Halted, Ready, Running and Suspended all turn up");
}

#[test]
fn so_does_a_stream_with_a_bad_motion_which_never_ends_as_done() {
    let (found, ends, _) = explore(Skills::Bad);
    println!("{found} states");
    assert!(!ends.iter().any(|end| end.done));
    assert!(ends.iter().any(|end| end.error_id == u16::from(ErrorNumber::AxisLimit)));
}

#[test]
fn so_does_a_skill_that_presses_and_nothing_but_a_skill_that_runs_moves_the_arm() {
    let (found, ends, states) = explore(Skills::Pressing);
    println!("{found} states");
    assert!(ends.iter().any(|end| end.done) && ends.iter().any(|end| end.command_aborted));
    assert_eq!(states.len(), 4);
}
