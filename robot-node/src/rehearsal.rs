//! The controller without a bus: what it does with an application's motions if it gets all of them at once and nothing
//! disturbs it. A measured run is compared with it. Drives, where the robot has some, are rehearsed too.

use core::time::Duration;

use machine::Instant;
use planning::{CompactPath, Stop};
use protocol::image::{Command, CompactPoints, Control, Motion, SLOTS, Skill, Slots, State};
use setup::Refill;

use crate::arm::Joints;
use crate::{Account, Controller, DriveSegment, Ending, Program, Quality, RobotConfig, RobotEvent};

/// Number of the rehearsed program.
const PROGRAM: u16 = 1;

/// Longest time of a skill at 100 %; one that has not ended by then hangs.
const LONGEST: Duration = Duration::from_secs(4 * 3_600);

/// How the motions are called.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Calls {
    /// All by one program of the robot.
    Program,
    /// Each by a skill of its own.
    Singles,
    /// Those up to each stop by one MoveContinuousSkill.
    Continuous,
}

/// What the arm did.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Rehearsed {
    /// The robot's account of all skills.
    pub account: Account,
    /// How well the arm moved.
    pub quality: Quality,
    /// Pose of the tool in the base at the end, as the image has it: mm and degrees.
    pub end_pose: [f32; 6],
}

impl Rehearsed {
    /// Returns what the arm did here and then there.
    #[must_use]
    pub fn then(self, other: Self) -> Self {
        Self {
            account: self.account.then(other.account),
            quality: self.quality.then(other.quality),
            end_pose: other.end_pose,
        }
    }
}

/// A motion that the arm does not execute.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
#[error("the arm alone does not get beyond motion {motion}, counted from 0: {ending:?}")]
pub struct RehearsalError {
    /// The first motion of the skill that did not end as commanded.
    pub motion: usize,
    /// How it ended; `None` if it did not end.
    pub ending: Option<Ending>,
}

/// Executes the motions on an arm that stands at `start` at an override in %, with an interpreter that notices each call at
/// once.
///
/// # Errors
///
/// A skill did not end as commanded.
pub fn rehearse(
    config: &RobotConfig,
    start: Joints,
    motions: &[Motion],
    stops: &[Stop],
    calls: Calls,
    override_percent: u8,
) -> Result<Rehearsed, RehearsalError> {
    rehearse_watched(config, start, motions, stops, (calls, override_percent), &mut |_| {})
}

/// Executes motions like [`rehearse`], and shows the controller to `watch` after each of its cycles.
///
/// # Errors
///
/// The same as for [`rehearse`].
pub fn rehearse_watched(
    config: &RobotConfig,
    start: Joints,
    motions: &[Motion],
    stops: &[Stop],
    (calls, override_percent): (Calls, u8),
    watch: &mut dyn FnMut(&Controller),
) -> Result<Rehearsed, RehearsalError> {
    let program = Program::new(motions.to_vec(), stops);
    let mut stage = Stage::new(at_once(config, start), program, override_percent);
    match calls {
        Calls::Program => stage.call(0, Given::Motions(motions), Skill::RunProgram, watch)?,
        Calls::Singles => {
            for (index, motion) in motions.iter().enumerate() {
                // A single motion ends in an exact stop.
                let motion = Motion { approximation: 0, ..*motion };
                stage.call(index, Given::Motions(&[motion]), u8::from(motion.kind).into(), watch)?;
            }
        }
        Calls::Continuous => {
            let mut from = 0;
            let ends = stops.iter().map(|stop| stop.after as usize).chain([motions.len()]);
            for end in ends {
                if let Some(section) = motions.get(from..end).filter(|section| !section.is_empty()) {
                    stage.call(from, Given::Motions(section), Skill::MoveContinuous, watch)?;
                    from = end;
                }
            }
        }
    }
    Ok(stage.done)
}

/// Executes compact points as one MoveTrajectorySkill, on an arm that stands at `start` at an override in %.
///
/// # Errors
///
/// The skill did not end as commanded.
pub fn rehearse_points(
    config: &RobotConfig,
    start: Joints,
    points: &CompactPath,
    override_percent: u8,
) -> Result<Rehearsed, RehearsalError> {
    let mut stage = Stage::new(at_once(config, start), Program::default(), override_percent);
    stage.call(0, Given::Points(points), Skill::MoveTrajectory, &mut |_| {})?;
    Ok(stage.done)
}

/// Executes a stored program as [`Calls::Program`] does. At its marks it waits for nobody.
///
/// # Errors
///
/// The same as for [`rehearse`].
pub fn rehearse_program(
    config: &RobotConfig,
    start: Joints,
    program: Program,
    override_percent: u8,
) -> Result<Rehearsed, RehearsalError> {
    let mut stage = Stage::new(at_once(config, start), program.alone(), override_percent);
    stage.call(0, Given::Motions(&[]), Skill::RunProgram, &mut |_| {})?;
    Ok(stage.done)
}

/// Returns the time on its law of each part of the motions, which an arm that first stands at `start` executes as one
/// MoveContinuousSkill: what the master of arms that move together counts. `ends` are the numbers of motions before the end of
/// each part, in order.
///
/// # Errors
///
/// A part did not end as commanded.
pub fn law_times(
    config: &RobotConfig,
    start: Joints,
    motions: &[Motion],
    ends: &[usize],
) -> Result<Vec<Duration>, RehearsalError> {
    let mut stage = Stage::new(at_once(config, start), Program::new(motions.to_vec(), &[]), 100);
    stage.leads = true;
    let mut from = 0;
    let mut times = Vec::with_capacity(ends.len());
    for end in ends {
        let part = motions.get(from..*end).unwrap_or_default();
        if part.is_empty() {
            times.push(Duration::ZERO);
            continue;
        }
        stage.call(from, Given::Motions(part), Skill::MoveContinuous, &mut |_| {})?;
        times.push(Duration::from_micros(stage.controller.feedback().law_time_us.into()));
        from = *end;
    }
    Ok(times)
}

/// Returns the robot at `start`, with an interpreter that notices each call at once.
fn at_once(config: &RobotConfig, start: Joints) -> RobotConfig {
    RobotConfig {
        home: start,
        interpreter_quantum: Duration::ZERO,
        start_quantum: Duration::ZERO,
        continuous_start_cycles: 0,
        ..config.clone()
    }
}

/// Motions or points of a skill.
#[derive(Clone, Copy)]
enum Given<'a> {
    Motions(&'a [Motion]),
    Points(&'a CompactPath),
}

impl Given<'_> {
    /// Returns the number of motions.
    fn total(self) -> u32 {
        let total = match self {
            Self::Motions(motions) => motions.len(),
            Self::Points(points) => points.differences.len(),
        };
        u32::try_from(total).unwrap_or(u32::MAX)
    }

    /// Prepares the slots, and returns how many motions they hold.
    fn prepare(self, command: &mut Command) -> u32 {
        let Self::Points(points) = self else { return SLOTS as u32 };
        command.control.set(Control::COMPACT, true);
        command.slots = Slots::Points(CompactPoints::new(points.head));
        points.head.capacity()
    }

    /// Writes a motion into its place.
    fn write(self, command: &mut Command, index: u32) {
        match (self, &mut command.slots) {
            (Self::Motions(motions), _) => {
                motions.get(index as usize).into_iter().for_each(|motion| command.set_slot(index, *motion));
            }
            (Self::Points(points), Slots::Points(image)) => {
                let difference = points.differences.get(index as usize);
                difference.into_iter().for_each(|it| image.set_difference(index, *it));
            }
            (Self::Points(_), Slots::Motions(_)) => {}
        }
    }
}

/// The controller, and what it did so far.
struct Stage {
    controller: Controller,
    drives: Option<DriveSegment>,
    command: Command,
    cycle: Duration,
    at: Instant,
    /// Set where a master leads the arm, which is always ahead of it: the feedback has the law's time then.
    leads: bool,
    refill: Refill,
    done: Rehearsed,
}

impl Stage {
    fn new(config: RobotConfig, program: Program, override_percent: u8) -> Self {
        let (cycle, at) = (config.cycle, Instant::ZERO);
        let drives = DriveSegment::of(&config, at);
        let patience = config.servo.switch_on;
        let refill = config.refill;
        let controller = Controller::new(config, vec![(PROGRAM, program)], 0);
        let mut command = Command { program: PROGRAM, override_percent, ..Command::default() };
        command.control = Control::ENABLE | Control::RESET;
        let done = Rehearsed { account: Account::default(), quality: Quality::default(), end_pose: [0.0; 6] };
        let mut stage = Self { controller, drives, command, cycle, at, leads: false, refill, done };
        stage.tick();
        while stage.controller.feedback().state != State::Ready && stage.at < Instant::ZERO + patience {
            stage.at += cycle;
            stage.tick();
        }
        stage
    }

    /// Runs one cycle.
    fn tick(&mut self) {
        let Self { controller, drives, command, at, .. } = self;
        controller.tick(*at, Some(command));
        let Some(drives) = drives else { return };
        if controller.take_drive_reset() {
            drives.reset();
        }
        controller.take_drives(drives.exchange(*at, controller.joints()));
    }

    /// Executes one skill; `first` is the number of its first motion.
    fn call(
        &mut self,
        first: usize,
        given: Given<'_>,
        skill: Skill,
        watch: &mut dyn FnMut(&Controller),
    ) -> Result<(), RehearsalError> {
        let command = &mut self.command;
        command.control = Control::ENABLE | Control::EXECUTE;
        if self.leads {
            command.control.set(Control::SYNC, true);
            command.law_time_us = u32::MAX;
        }
        command.number = command.number.wrapping_add(1).max(1);
        (command.skill, command.written) = (skill, 0);
        command.total = given.total();
        let capacity = given.prepare(command);
        let until = self.at + LONGEST * 100 / u32::from(command.override_percent.max(1));
        while self.at < until {
            let Self { controller, command, cycle, at, .. } = self;
            let feedback = controller.feedback();
            let free = match self.refill {
                _ if feedback.number != command.number => 0,
                Refill::Executed => feedback.executed,
                Refill::Accepted => feedback.accepted,
            };
            let written = command.total.min(free.saturating_add(capacity));
            for index in command.written..written {
                given.write(command, index);
            }
            command.written = written;
            *at += *cycle;
            self.tick();
            watch(&self.controller);
            while let Some(event) = self.controller.poll_event() {
                let done = &mut self.done;
                if let RobotEvent::SkillFinished { ending, quality, account, .. } = event {
                    done.account = done.account.then(account);
                    done.quality = done.quality.then(quality);
                    done.end_pose = self.controller.feedback().pose;
                    let is_done = ending == Ending::Done;
                    return if is_done {
                        Ok(())
                    } else {
                        Err(RehearsalError { motion: first, ending: Some(ending) })
                    };
                }
            }
        }
        Err(RehearsalError { motion: first, ending: None })
    }
}
