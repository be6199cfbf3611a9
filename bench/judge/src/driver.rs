//! Runs a case: the robot's controller in virtual time, fed every robot cycle as a PLC would, and judged.

use machine::{Duration, Instant};
use protocol::image::{Command, Control, Feedback, Motion, SLOTS, Skill, Slots, State, Status};
use robot_node::{ConfigError, Controller, Program};
use setup::{Refill, Setup};

use crate::case::{Case, Event, Execution, Intervention, Programmed, Run, RunPoints};
use crate::law::{Law, Seen};
use crate::violation::{Class, Violation};

/// Cycles after which the PLC loses its patience with a skill and halts it: 12 s at 4 ms.
const PATIENCE: u32 = 3_000;

/// Cycles that a halt may take besides [those that the deceleration takes](Law::halts_in): 20 s at 4 ms.
const HALTS_WITHIN: u32 = 5_000;

/// Cycles that are watched after a skill has ended: the arm must stand, and its last cycles must be within the limits.
const AFTERWARDS: u32 = 6;

/// Result of a case.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Outcome {
    /// The first law that was broken.
    pub violation: Option<Violation>,
    /// Robot cycles that were judged.
    pub cycles: u64,
    /// How long they would have taken.
    pub plant: Duration,
    /// Motions that were executed.
    pub motions: u64,
    /// Skills that ended as wanted, were aborted, ended by an error.
    pub ended: [u64; 3],
}

/// Runs a case; `setup` is the one that it names. Only the `classes` are looked for.
///
/// # Errors
///
/// The arm makes no sense.
pub fn run(case: &Case, setup: &Setup, classes: &[Class]) -> Result<Outcome, ConfigError> {
    let setup = &case.its_setup(setup);
    let config = case.robot(setup)?;
    let programs =
        case.runs.iter().enumerate().map(|(index, run)| (index as u16 + 1, program(run))).collect();
    let mut driver = Driver {
        cycle: config.cycle,
        refill: config.refill,
        takes_points: config.compact_points,
        points: None,
        controller: Controller::new(config, programs, case.seed),
        command: Command::default(),
        law: Law::new(case, setup, classes),
        at: Instant::ZERO,
        run_cycle: 0,
        is_connected: true,
        is_suspended: false,
        master: None,
        outcome: Outcome::default(),
    };
    for (index, run) in case.runs.iter().enumerate() {
        driver.reset();
        driver.perform(index as u16 + 1, run);
    }
    driver.outcome.plant = driver.at.since(Instant::ZERO);
    driver.outcome.violation = driver.law.found().cloned();
    Ok(driver.outcome)
}

fn program(run: &Run) -> Program {
    let motions = if run.execution == Execution::Program { run.motions.as_slice() } else { &[] };
    Program::from(motions.iter().map(Programmed::motion).collect::<Vec<Motion>>())
}

struct Driver {
    controller: Controller,
    command: Command,
    law: Law,
    at: Instant,
    cycle: Duration,
    refill: Refill,
    takes_points: bool,
    /// The points of the run, if it has that form.
    points: Option<RunPoints>,
    /// Cycles since the run began.
    run_cycle: u32,
    is_connected: bool,
    is_suspended: bool,
    master: Option<LeadingMaster>,
    outcome: Outcome,
}

/// A master that leads the arm.
#[derive(Clone, Copy)]
struct LeadingMaster {
    /// Share of the law's speed.
    share: f64,
    /// Where it is, in s.
    law_s: f64,
    /// Cycles without new set-points.
    starves: u16,
}

/// Robot cycles before it holds that a set-point is sent.
const LEAD_CYCLES: u32 = 5;

impl Driver {
    /// One robot cycle.
    fn tick(&mut self) {
        self.at += self.cycle;
        self.run_cycle += 1;
        self.command.life = self.command.life.wrapping_add(1);
        self.lead();
        let command = self.is_connected.then_some(&self.command);
        self.controller.tick(self.at, command);
        while self.controller.poll_event().is_some() {}
        self.outcome.cycles += 1;
        self.law.look(&Seen {
            command,
            feedback: self.controller.feedback(),
            joints: self.controller.joints(),
            accepted: self.controller.accepted(),
        });
    }

    /// Writes the master's set-point into the command.
    fn lead(&mut self) {
        let seconds = self.cycle.as_secs_f64();
        self.command.control.set(Control::SYNC, self.master.is_some());
        let Some(master) = &mut self.master else {
            (self.command.start_time_ns, self.command.law_time_us) = (0, 0);
            return;
        };
        master.law_s = (master.law_s + master.share * seconds).max(0.0);
        if let Some(left) = master.starves.checked_sub(1) {
            master.starves = left;
            return;
        }
        self.command.start_time_ns = (self.at + self.cycle * LEAD_CYCLES).as_nanos();
        self.command.law_time_us = (master.law_s * 1e6) as u32;
    }

    /// Has a master lead the arm from where it is.
    fn lead_with(&mut self, percent: u8) {
        let law_s = self.master.map_or_else(|| f64::from(self.feedback().law_time_us) / 1e6, |it| it.law_s);
        self.master = Some(LeadingMaster { share: f64::from(percent) / 100.0, law_s, starves: 0 });
    }

    const fn feedback(&self) -> &Feedback {
        self.controller.feedback()
    }

    /// Brings the robot to `Ready`, whatever was before.
    fn reset(&mut self) {
        (self.is_connected, self.is_suspended, self.master) = (true, false, None);
        for control in [Control::ENABLE | Control::RESUME, Control::ENABLE | Control::RESET, Control::ENABLE]
        {
            self.command.control = control;
            self.tick();
        }
        if self.feedback().state != State::Ready {
            self.law.is_stuck();
        }
    }

    fn perform(&mut self, number: u16, run: &Run) {
        self.run_cycle = 0;
        let mut events = run.events.as_slice();
        self.points = run.points().filter(|_| self.takes_points);
        match run.execution {
            Execution::Continuous | Execution::Trajectory => {
                let skill = if self.points.is_some() { Skill::MoveTrajectory } else { Skill::MoveContinuous };
                self.call(skill, number, run.execution, &run.motions);
                self.wait(&run.motions, &mut events);
            }
            Execution::Program => {
                self.call(Skill::RunProgram, number, Execution::Program, &run.motions);
                self.wait(&[], &mut events);
            }
            Execution::Single => {
                for motion in &run.motions {
                    let kind: u8 = protocol::image::MotionKind::from(motion.kind).into();
                    let motions = core::slice::from_ref(motion);
                    self.call(kind.into(), number, Execution::Single, motions);
                    self.command.set_slot(0, motion.motion());
                    self.command.written = 1;
                    self.wait(&[], &mut events);
                    let is_done = self.is_connected && self.feedback().status.contains(Status::DONE);
                    if !is_done || self.law.found().is_some() {
                        break;
                    }
                }
            }
        }
    }

    /// Calls a skill with a new command number.
    fn call(&mut self, skill: Skill, program: u16, execution: Execution, motions: &[Programmed]) {
        self.command.number += 1;
        // Each skill begins at 0.
        if let Some(master) = &mut self.master {
            master.law_s = 0.0;
        }
        self.command.skill = skill;
        self.command.program = program;
        // The slots of the skill before stay, unless the form changes.
        if let Some(points) = &self.points {
            self.command.slots = Slots::Points(points.empty());
        } else if self.command.slots.points().is_some() {
            self.command.slots = Slots::EMPTY;
        }
        (self.command.total, self.command.written) = (motions.len() as u32, 0);
        self.law.start(self.command.number, execution, motions);
    }

    /// Waits for the end of the skill, hands over motions as slots become free, and triggers the events.
    fn wait(&mut self, motions: &[Programmed], events: &mut &[Event]) {
        let ended = Status::DONE.0 | Status::ABORTED.0 | Status::ERROR.0;
        let called_in = self.run_cycle;
        let stuck_after = PATIENCE + HALTS_WITHIN + self.law.halts_in();
        while self.law.found().is_none() {
            let waited = self.run_cycle - called_in;
            self.happen(events);
            self.hand_over(motions);
            self.command.control = self.control(waited);
            self.tick();
            let feedback = self.feedback();
            if feedback.number == self.command.number && feedback.status.0 & ended != 0 {
                break;
            }
            if !self.is_connected && feedback.number != self.command.number {
                // The connection was lost before the call came to the robot.
                return;
            }
            if waited > stuck_after {
                self.law.is_stuck();
            }
        }
        let status = self.feedback().status;
        let how = [Status::DONE, Status::ABORTED, Status::ERROR].iter().position(|bit| status.contains(*bit));
        if let Some(ended) = how.and_then(|how| self.outcome.ended.get_mut(how)) {
            *ended += 1;
        }
        self.outcome.motions += u64::from(self.feedback().executed);
        if !status.contains(Status::DONE) || events.is_empty() {
            for _ in 0..AFTERWARDS {
                self.tick();
            }
        }
    }

    fn control(&self, waited: u32) -> Control {
        let mut control = Control::ENABLE | Control::EXECUTE;
        if waited > PATIENCE {
            control.set(Control::HALT, true);
        }
        control.set(Control::COMPACT, self.points.is_some());
        control.set(Control::SUSPEND, self.is_suspended);
        control.set(Control::RESUME, !self.is_suspended);
        for bit in [Control::HALT, Control::ENABLE] {
            let was = self.command.control.contains(bit);
            // A halt and a withdrawn enable stay until the reset.
            let is_kept = (bit == Control::HALT && was) || (bit == Control::ENABLE && !was);
            if is_kept {
                control.set(bit, was);
            }
        }
        control
    }

    fn happen(&mut self, events: &mut &[Event]) {
        while let Some((event, rest)) =
            events.split_first().filter(|(event, _)| event.cycle <= self.run_cycle)
        {
            *events = rest;
            match event.what {
                Intervention::Override(percent) => self.command.override_percent = percent,
                Intervention::Suspend => self.is_suspended = true,
                Intervention::Resume => self.is_suspended = false,
                Intervention::Halt => self.command.control.set(Control::HALT, true),
                Intervention::Disable => self.command.control.set(Control::ENABLE, false),
                Intervention::Disconnect => self.is_connected = false,
                Intervention::Lead(percent) => self.lead_with(percent),
                Intervention::Jump(millis) => {
                    if let Some(master) = &mut self.master {
                        master.law_s = (master.law_s + f64::from(millis) / 1e3).max(0.0);
                    }
                }
                Intervention::Starve(cycles) => {
                    if let Some(master) = &mut self.master {
                        master.starves = cycles;
                    }
                }
                Intervention::Free => self.master = None,
            }
        }
    }

    /// Writes the motions whose time has come into the slots that are free.
    fn hand_over(&mut self, motions: &[Programmed]) {
        let feedback = self.feedback();
        let free = match self.refill {
            _ if feedback.number != self.command.number => 0,
            Refill::Executed => feedback.executed,
            Refill::Accepted => feedback.accepted,
        };
        let places = self.points.as_ref().map_or(SLOTS, |points| points.head.capacity() as usize);
        while let Some(motion) = motions.get(self.command.written as usize) {
            let is_free = (self.command.written as usize) < free as usize + places;
            if !is_free || motion.written_in_cycle > self.run_cycle {
                break;
            }
            let written = self.command.written;
            let difference = self.points.as_ref().and_then(|run| run.differences.get(written as usize));
            match (&mut self.command.slots, difference) {
                (Slots::Points(points), Some(difference)) => points.set_difference(written, *difference),
                _ => self.command.set_slot(written, motion.motion()),
            }
            self.command.written += 1;
        }
    }
}
