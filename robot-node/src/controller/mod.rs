//! The robot controller: dispatches skills from the command image and runs their motions.
//!
//! States and transitions are those of OPC UA Part 10 programs:
//!
//! ```text
//! Halted --reset--> Ready --execute--> Running --suspend--> Suspended
//!    ^                ^ '- done, cancel ---'  ^--- resume ------'
//!    '-- halt, enable taken back, connection lost, error: stop on the path first
//! ```
//!
//! A skill takes time besides its motion. The interpreter notices a command after a time that is evenly distributed over
//! its quantum and drawn again for every call: it is not synchronised with the interpolation, so a call may come at any
//! phase. (On a fixed grid the calls of one run would all meet it at one phase and pay one quantum in all; the paper's
//! MAD of single skills, which grows with the number of calls, contradicts that.) Half of the overhead passes before the
//! motion, and half after it until the arm has settled; only the sum can be identified from the paper. Motions within a
//! program or a MoveContinuous have neither. A MoveContinuous may need some cycles more than a program before its first
//! motion.
//!
//! At a mark a stored program switches an output of its own, and waits until the inputs from the other arms are as it; the PLC passes
//! them on. Before it begins it clears its own.
//!
//! Both a program of the robot and the PLC, by a change of a bit of its own outputs, switch the robot's digital outputs,
//! which the PLC reads as inputs. The last change counts. A lost connection switches nothing: a gripper must not drop its
//! part.

mod account;
mod compact;
mod drives;
mod event;
mod execution;
#[cfg(test)]
mod exploration;
mod master;
mod press;
mod pressing;
mod program;
mod report;
mod running;
mod taking;

use std::collections::VecDeque;

use machine::Instant;
use planning::MarkSignal;
use protocol::image::{Command, Control, Digest, ErrorNumber, Feedback, Finding, Skill, State, Status};
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;
use setup::Drives;

pub use account::Account;
pub use drives::{DriveError, DrivePower, DriveReport};
pub use event::{Ending, ImageFault, RobotEvent};
use execution::Execution;
use master::Master;
pub use program::Program;
use program::Programs;

use crate::RobotConfig;
use crate::arm::{AXES, Frame, Joints, Violation};
use crate::motion::Interpolator;
use crate::quality::Observer;

/// Events that wait for the owner; it takes them after every call.
const EVENTS: usize = 64;

/// How many values a random word has.
const RANDOM_WORDS: f64 = (1_u64 << 32) as f64;

/// The highest override, in %.
const HIGHEST_OVERRIDE: u8 = 100;

/// A command that the interpreter has not noticed yet.
#[derive(Clone, Copy, PartialEq, Debug)]
struct Pending {
    number: u16,
    seen_at: Instant,
    noticed_at: Instant,
}

/// The robot controller. Its owner calls [`tick`](Self::tick) once every robot cycle.
#[derive(Clone, Debug)]
pub struct Controller {
    config: RobotConfig,
    programs: Programs,
    random: Pcg64Mcg,
    interpolator: Interpolator,
    observer: Observer,
    state: State,
    /// The last command number that was accepted or refused; `None` until the first image of a connection, whose number
    /// is an old one.
    last_number: Option<u16>,
    pending: Option<Pending>,
    execution: Option<Execution>,
    /// The LIN force that waits for its turn, runs, or holds its force.
    press: Option<press::Press>,
    /// Force of the surfaces on the tool, in N along the root's axes, as of the last tick.
    contact: [f64; 3],
    /// The robot's digital outputs.
    outputs: u16,
    /// The PLC's digital outputs as last seen on this connection.
    plc_outputs: Option<u16>,
    /// The motions that the skill, or the last one, put on the path.
    accepted: Digest,
    /// What the skill did so far.
    account: Account,
    /// `reset` counts once each time it is set.
    reset_armed: bool,
    hold: bool,
    /// The override, 0…1.
    factor: f64,
    /// The master that the arm follows, if there is one.
    master: Option<Master>,
    /// The law's time of the skill that the arm has driven, in s; after its end that of its end.
    progress_s: f64,
    /// The override in the command image, if it is above 100 %.
    wrong_override: Option<u8>,
    /// Why all images of the PLC are refused on this connection, if they are.
    refused_images: Option<ImageFault>,
    /// The same as the owner knows it: the end of a connection does not change it.
    reported_images: Option<ImageFault>,
    /// What the drives last reported; `None` for joints that are at once where they are set.
    drives: Option<DriveReport>,
    /// Why the drives did not follow in the last cycle.
    drive_error: Option<DriveError>,
    /// Since when a reset waits for the drives; `None` while none does.
    awaits_drives: Option<Instant>,
    /// Since when the set-points rest and a drive has not arrived; `None` while all have.
    away_since: Option<Instant>,
    /// The drives are to leave their fault.
    resets_drives: bool,
    tool: Frame,
    base_inverse: Frame,
    feedback: Feedback,
    /// The joints that the feedback shows.
    reported: Joints,
    events: VecDeque<RobotEvent>,
}

impl Controller {
    /// Creates a controller with its programs by number. `seed` feeds the interpreter's random phase.
    #[must_use]
    pub fn new(config: RobotConfig, programs: Vec<(u16, Program)>, seed: u64) -> Self {
        let mut programs = programs;
        programs.iter_mut().for_each(|(_, program)| program.load(&config));
        let cycle_s = config.cycle.as_secs_f64();
        let motions = taking::most_known(&config) as usize;
        let interpolator = Interpolator::with_queue(config.arm.clone(), config.home, cycle_s, motions);
        let observer = match config.drives {
            Some(_) => Observer::of_drives(&config.arm, &config.home, cycle_s, 1.0 / Drives::INCREMENTS),
            None => Observer::at_rest(&config.arm, &config.home, cycle_s),
        };
        let drives =
            config.drives.map(|_| DriveReport { joints: config.home, power: DrivePower::Off { axis: 0 } });
        let (queue_depth, services) = taking::served(&config);
        let mut controller = Self {
            config,
            programs,
            random: Pcg64Mcg::seed_from_u64(seed),
            interpolator,
            observer,
            state: State::Halted,
            last_number: None,
            pending: None,
            execution: None,
            press: None,
            contact: [0.0; 3],
            outputs: 0,
            plc_outputs: None,
            accepted: Digest::default(),
            account: Account::default(),
            reset_armed: true,
            hold: false,
            factor: 1.0,
            master: None,
            progress_s: 0.0,
            wrong_override: None,
            refused_images: None,
            reported_images: None,
            drives,
            drive_error: None,
            awaits_drives: None,
            away_since: None,
            resets_drives: false,
            tool: Frame::IDENTITY,
            base_inverse: Frame::IDENTITY,
            feedback: Feedback { queue_depth, services, ..Feedback::default() },
            reported: [0.0; AXES],
            events: VecDeque::with_capacity(EVENTS),
        };
        controller.report_position();
        controller
    }

    /// Returns the joints that the feedback shows, in degrees (mm), as exact as the controller has them.
    #[must_use]
    pub const fn reported_joints(&self) -> &Joints {
        &self.reported
    }

    /// Returns how much of the law's time of the current skill, or of the last one, the arm has driven, in s.
    #[must_use]
    pub const fn progress_s(&self) -> f64 {
        self.progress_s
    }

    /// Returns the feedback image as of the last tick.
    #[must_use]
    pub const fn feedback(&self) -> &Feedback {
        &self.feedback
    }

    /// Returns the digest of the motions of the skill, or of the last one, in the order in which they were added to the
    /// path.
    #[must_use]
    pub const fn accepted(&self) -> &Digest {
        &self.accepted
    }

    /// Returns the joints that are set now, in degrees (mm).
    #[must_use]
    pub const fn joints(&self) -> &Joints {
        self.interpolator.joints()
    }

    /// Returns whether an event is waiting.
    #[must_use]
    pub fn has_event(&self) -> bool {
        !self.events.is_empty()
    }

    /// Returns the next event.
    pub fn poll_event(&mut self) -> Option<RobotEvent> {
        self.events.pop_front()
    }

    /// Reports that all images of the PLC are refused, so that none can be followed: the feedback then warns.
    pub fn refuse_images(&mut self, fault: ImageFault) {
        self.refused_images = Some(fault);
        self.report_images(Some(fault));
    }

    /// Returns why all images of the PLC are refused, if they are.
    #[must_use]
    pub const fn refused_images(&self) -> Option<ImageFault> {
        self.refused_images
    }

    /// Reports that an image of the PLC was accepted.
    pub fn accept_images(&mut self) {
        self.refused_images = None;
        self.report_images(None);
    }

    /// Forgets on what ground images are refused, since the connection has ended. That is not a recovery: the owner learns of
    /// one when an image is accepted.
    pub const fn forget_images(&mut self) {
        self.refused_images = None;
    }

    fn report_images(&mut self, fault: Option<ImageFault>) {
        let before = core::mem::replace(&mut self.reported_images, fault);
        if before == fault {
            return;
        }
        for (fault, is_refused) in [(before, false), (fault, true)] {
            if let Some(fault) = fault {
                self.event(RobotEvent::ImagesRefused { fault, is_refused });
            }
        }
    }

    /// Runs one robot cycle at the instant `at`, with the present command image, or `None` without a connection.
    pub fn tick(&mut self, at: Instant, command: Option<&Command>) {
        let was = self.state;
        self.follow_drives(at);
        match command {
            Some(command) => self.read(at, command),
            None => self.without_connection(at),
        }
        if self.execution.is_some() {
            self.execute(at, command);
        } else {
            self.rest();
        }
        if self.state != was {
            self.event(RobotEvent::State(self.state));
        }
        self.report(at, command);
    }

    fn without_connection(&mut self, at: Instant) {
        (self.last_number, self.plc_outputs, self.wrong_override) = (None, None, None);
        self.leave_master();
        self.reset_armed = true;
        self.give_up(at, Ending::plain(ErrorNumber::ConnectionLost, self.feedback.executed));
    }

    /// Follows the control bits. Of those that contradict each other the one that stops wins.
    fn read(&mut self, at: Instant, command: &Command) {
        let control = command.control;
        let enabled = control.contains(Control::ENABLE);
        self.reset_armed |= !control.contains(Control::RESET);
        if !enabled {
            self.give_up(at, Ending::plain(ErrorNumber::Disabled, self.feedback.executed));
        } else if control.contains(Control::HALT) {
            self.give_up(at, Ending::Halted);
        } else {
            if control.contains(Control::CANCEL) {
                self.give_up(at, Ending::Cancelled);
            }
            if control.contains(Control::RESET) && self.reset_armed {
                self.reset(at);
            }
        }
        if control.contains(Control::SUSPEND) {
            self.hold = true;
        } else if control.contains(Control::RESUME) || self.execution.is_none() {
            self.hold = false;
        }
        self.take_override(command.override_percent);
        self.take_master(at, command);
        let before = self.plc_outputs.replace(command.outputs).unwrap_or(command.outputs);
        let changed = before ^ command.outputs;
        self.outputs = self.outputs & !changed | command.outputs & changed;
        let last = *self.last_number.get_or_insert(command.number);
        let is_called = control.contains(Control::EXECUTE) && !control.contains(Control::CANCEL);
        if is_called && command.number != last {
            self.notice(at, command);
        } else {
            self.pending = None;
        }
    }

    /// Takes the override over. One above the highest is refused, once, and the last one stands.
    fn take_override(&mut self, percent: u8) {
        if percent <= HIGHEST_OVERRIDE {
            self.factor = f64::from(percent) / 100.0;
            self.feedback.override_percent = percent;
            self.wrong_override = None;
        } else if self.wrong_override.replace(percent) != Some(percent)
            && let Some(Execution { number, .. }) = self.execution
        {
            self.refuse_motion(number, self.feedback.executed, Violation::Override { percent });
        }
    }

    /// Takes back an error, and leaves `Halted` once the arm stands and its drives are on.
    fn reset(&mut self, at: Instant) {
        if self.execution.is_some() {
            return;
        }
        self.reset_armed = false;
        if self.drives_are_on() {
            self.make_ready();
        } else {
            (self.awaits_drives, self.resets_drives) = (Some(at), true);
        }
    }

    fn make_ready(&mut self) {
        self.state = State::Ready;
        self.feedback.error = ErrorNumber::None;
        self.feedback.error_motion = 0;
        self.feedback.finding = Finding::NONE;
        self.feedback.status.set(Status::ERROR, false);
        self.feedback.status.set(Status::ABORTED, false);
    }

    /// Handles a command that is not accepted yet: the interpreter needs its time to notice it.
    fn notice(&mut self, at: Instant, command: &Command) {
        if self.state != State::Ready {
            self.last_number = Some(command.number);
            return self.refuse(command.number, 0, ErrorNumber::NotReady.into());
        }
        let pending = match self.pending {
            Some(pending) if pending.number == command.number => pending,
            _ => {
                let quantum = self.config.interpreter_quantum;
                let mut noticed_at = at + quantum.mul_f64(f64::from(self.random.next_u32()) / RANDOM_WORDS);
                let start = self.config.start_quantum;
                let is_start = matches!(
                    command.skill,
                    Skill::RunProgram | Skill::MoveContinuous | Skill::MoveTrajectory
                );
                if is_start && !start.is_zero() {
                    noticed_at += start.mul_f64(f64::from(self.random.next_u32()) / RANDOM_WORDS);
                }
                Pending { number: command.number, seen_at: at, noticed_at }
            }
        };
        self.pending = Some(pending);
        if at < pending.noticed_at {
            return;
        }
        if !self.interpolator.is_at_rest() {
            // The arm held a force against a moving surface, or braked: the motion starts where the arm stands.
            self.press = None;
            return;
        }
        (self.pending, self.last_number) = (None, Some(command.number));
        let until = pending.noticed_at + self.config.skill_overhead / 2;
        let joints = *self.interpolator.joints();
        self.feedback = Feedback { number: command.number, ..self.cleared_feedback() };
        match Execution::new(command, pending.seen_at, until, &joints, &self.programs, &self.config) {
            Ok(mut execution) => {
                if matches!(command.skill, Skill::MoveContinuous | Skill::MoveTrajectory) {
                    execution.cycles_to_start = self.config.continuous_start_cycles;
                }
                self.interpolator.clear();
                self.begin_master(at, command);
                self.outputs &= !execution.clears(&self.programs);
                execution.law_before_s = self.interpolator.path().driven_s();
                self.progress_s = 0.0;
                self.accepted = Digest::default();
                self.account = Account::begin(*self.actual_joints());
                self.hold = command.control.contains(Control::SUSPEND);
                self.execution = Some(execution);
                self.state = State::Running;
                self.event(RobotEvent::SkillStarted { number: command.number, skill: command.skill });
            }
            Err(violation) => {
                (self.state, self.press) = (State::Halted, None);
                self.refuse(command.number, 0, violation);
            }
        }
    }

    /// Returns the outputs by which the stored program meets others, while it stands at a mark.
    #[must_use]
    pub fn meets(&self) -> Option<MarkSignal> {
        match self.execution?.phase {
            execution::Phase::Meeting(signal) => Some(signal),
            _ => None,
        }
    }

    /// Returns the skill that runs, if one does.
    #[must_use]
    pub fn skill(&self) -> Option<Skill> {
        self.execution.map(|execution| execution.skill)
    }
}
