//! One skill from the moment the interpreter takes it up: where its motions come from and how far it is.

use core::time::Duration;

use protocol::Instant;
use protocol::image::{Command, ErrorNumber, Motion, MotionKind, SLOTS, Skill};

use super::event::Ending;
use crate::RobotConfig;
use crate::arm::{Joints, Violation};
use crate::motion::Segment;

/// Motions of a program that are checked in one cycle before it starts.
const CHECKS_PER_CYCLE: u32 = 4;

/// Where the motions of a skill come from.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Source {
    /// Slot 0 of the command image: a single motion of this kind.
    Single(MotionKind),
    /// The slots of the command image, filled again and again.
    Slots,
    /// The program store: the index of a program in it.
    Program(usize),
}

/// What a skill does at present.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) enum Phase {
    /// The interpreter works; the arm has not moved yet.
    Dispatch {
        /// When the motion may start.
        until: Instant,
    },
    /// On the path.
    Driving,
    /// At the end of the path, waiting until the arm has settled.
    Settling {
        /// When it has.
        until: Instant,
    },
    /// Stopping on the path to give up.
    Stopping(Ending),
}

/// A skill that is being executed.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Execution {
    pub(super) number: u16,
    pub(super) skill: Skill,
    pub(super) source: Source,
    /// When the command was first seen.
    pub(super) seen_at: Instant,
    pub(super) total: u32,
    pub(super) accepted: u32,
    /// The highest `written` seen: it only grows.
    written: u32,
    pub(super) phase: Phase,
    /// The motion that cannot be run, and why.
    pub(super) bad: Option<(u32, Violation)>,
    check: Check,
}

/// How far a program is checked before it starts.
#[derive(Clone, Copy, PartialEq, Debug)]
struct Check {
    next: u32,
    from: Joints,
}

/// Programs by number.
pub(super) type Programs = Vec<(u16, Vec<Motion>)>;

impl Execution {
    /// Takes up a command; the arm stands at `joints`.
    pub(super) fn new(
        command: &Command,
        seen_at: Instant,
        until: Instant,
        joints: &Joints,
        programs: &Programs,
    ) -> Result<Self, ErrorNumber> {
        let (source, total) = match command.skill {
            Skill::RunProgram => {
                let index = programs.iter().position(|(number, _)| *number == command.program);
                let index = index.ok_or(ErrorNumber::UnknownProgram)?;
                let motions = programs.get(index).map_or(0, |(_, motions)| motions.len());
                (Source::Program(index), u32::try_from(motions).unwrap_or(u32::MAX))
            }
            Skill::MoveContinuous => (Source::Slots, command.total),
            Skill::None | Skill::Unknown(_) => return Err(ErrorNumber::UnknownSkill),
            single => (Source::Single(u8::from(single).into()), command.total.min(1)),
        };
        if total == 0 {
            return Err(ErrorNumber::NoMotions);
        }
        if !(1..=100).contains(&command.override_percent) {
            return Err(ErrorNumber::OverrideOutOfRange);
        }
        let start = Instant::from_nanos(command.start_time_ns);
        Ok(Self {
            number: command.number,
            skill: command.skill,
            source,
            seen_at,
            total,
            accepted: 0,
            written: 0,
            phase: Phase::Dispatch { until: until.max(start) },
            bad: None,
            check: Check { next: 0, from: *joints },
        })
    }

    /// The next motion, if it is there and the queue has room for it.
    pub(super) fn next_motion(
        &mut self,
        command: Option<&Command>,
        executed: u32,
        programs: &Programs,
    ) -> Result<Option<Motion>, Violation> {
        let held = self.accepted.saturating_sub(executed);
        if let (Source::Slots, Some(command)) = (self.source, command) {
            let ahead = command.written.checked_sub(self.accepted);
            let lost = ahead.is_none_or(|ahead| ahead as usize > SLOTS);
            if lost || command.written < self.written || command.written > self.total {
                return Err(ErrorNumber::QueueOverrun.into());
            }
            self.written = command.written;
        }
        if self.accepted >= self.total || held as usize >= SLOTS {
            return Ok(None);
        }
        Ok(match (self.source, command) {
            (Source::Program(_), _) => self.programmed(self.accepted, programs),
            (Source::Slots, Some(command)) if self.accepted < command.written => {
                Some(*command.slot(self.accepted))
            }
            (Source::Single(kind), Some(command)) => {
                let motion = *command.slot(0);
                if motion.kind != kind {
                    return Err(ErrorNumber::UnknownMotionKind.into());
                }
                Some(motion)
            }
            _ => None,
        })
    }

    fn programmed(&self, index: u32, programs: &Programs) -> Option<Motion> {
        let Source::Program(program) = self.source else { return None };
        programs.get(program)?.1.get(index as usize).copied()
    }

    /// Checks some more motions of a program; true when there is nothing left to check.
    pub(super) fn check_program(&mut self, config: &RobotConfig, programs: &Programs) -> bool {
        for _ in 0..CHECKS_PER_CYCLE {
            let Some(motion) = self.programmed(self.check.next, programs) else { return true };
            match Segment::prepare(&motion, &self.check.from, config) {
                Ok(segment) => self.check = Check { next: self.check.next + 1, from: segment.end },
                Err(violation) => {
                    self.bad = Some((self.check.next, violation));
                    return true;
                }
            }
        }
        false
    }

    /// Whether all motions are on the path.
    pub(super) const fn is_complete(&self) -> bool {
        self.accepted == self.total
    }

    /// Time since the command was first seen.
    pub(super) fn elapsed(&self, at: Instant) -> Duration {
        at.since(self.seen_at)
    }
}
