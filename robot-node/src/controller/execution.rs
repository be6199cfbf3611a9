//! One skill from the moment at which the interpreter accepts it: where its motions come from, and how far it is.

use core::time::Duration;

use machine::Instant;
use planning::MarkSignal;
use protocol::image::{Command, Control, ErrorNumber, Motion, MotionKind, SLOTS, Skill};

use super::compact::{Aimed, TakenPoints};
use super::event::Ending;
use super::program::{Programs, StopStatement};
use super::{HIGHEST_OVERRIDE, press};
use crate::RobotConfig;
use crate::arm::{Count, Joints, Violation};
use crate::motion::Segment;

/// Motions of a program that are checked in one cycle before it starts.
const CHECKS_PER_CYCLE: u32 = 4;

/// The same in a cycle that puts a motion on the path as well, which takes as long as two of them.
const CHECKS_BESIDE_A_MOTION: u32 = 2;

/// Where the motions of a skill come from.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) enum Source {
    /// Slot 0 of the command image: a single motion of this kind.
    Single(MotionKind),
    /// The slots of the command image, which the PLC refills.
    Slots,
    /// The compact points of the command image, which the PLC refills.
    Points(TakenPoints),
    /// The program store: the index of a program in it.
    Program(usize),
}

/// What a skill does at present.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) enum Phase {
    /// The interpreter works; the arm has not moved yet.
    Dispatch {
        /// When the motion may start, unless its start time is later.
        until: Instant,
    },
    /// On the path.
    Driving,
    /// At a stop of the program, before the drives have arrived there.
    Arriving,
    /// At a stop of the program, after an output was switched.
    Waiting {
        /// When the program goes on.
        until: Instant,
    },
    /// At a mark of the program, after its output was switched, until the inputs are there.
    Meeting(MarkSignal),
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
    /// Motions that were executed before the present path began.
    pub(super) executed_before: u32,
    /// Statements of the program at its stops that are done.
    stops_passed: usize,
    /// The highest `written` seen: it only grows.
    written: u32,
    /// Motions that came with the command.
    pub(super) written_at_start: u32,
    pub(super) phase: Phase,
    /// When it is to start; the clock's origin for at once.
    pub(super) start: Instant,
    /// The law that the arm had driven before, in s.
    pub(super) law_before_s: f64,
    /// Cycles that pass before the first motion, once it might start but for its start time.
    pub(super) cycles_to_start: u32,
    /// The motion that cannot be run, and why.
    pub(super) bad: Option<(u32, Violation)>,
    check: Check,
}

/// How far motions are checked before the start.
#[derive(Clone, Copy, PartialEq, Debug)]
struct Check {
    next: u32,
    from: Joints,
}

impl Execution {
    /// Takes up a command; the arm stands at `joints`.
    pub(super) fn new(
        command: &Command,
        seen_at: Instant,
        until: Instant,
        joints: &Joints,
        programs: &Programs,
        config: &RobotConfig,
    ) -> Result<Self, Violation> {
        let (source, total) = match command.skill {
            Skill::RunProgram => {
                let index = programs.iter().position(|(number, _)| *number == command.program);
                let index = index.ok_or(ErrorNumber::UnknownProgram)?;
                let motions = programs.get(index).map_or(0, |(_, program)| program.total());
                (Source::Program(index), motions)
            }
            Skill::MoveContinuous => (Source::Slots, command.total),
            Skill::MoveTrajectory => (Source::Points(TakenPoints::begin(command, config)?), command.total),
            skill => {
                let kind = skill.motion_kind().ok_or(ErrorNumber::UnknownSkill)?;
                // Slot 0 holds the motion of the skill before until `written` says that this one's is there.
                for (field, value) in [(Count::Total, command.total), (Count::Written, command.written)] {
                    if value != 1 {
                        return Err(Violation::NotOneMotion { field, value });
                    }
                }
                (Source::Single(kind), 1)
            }
        };
        if total == 0 {
            return Err(ErrorNumber::NoMotions.into());
        }
        if command.override_percent > HIGHEST_OVERRIDE {
            return Err(Violation::Override { percent: command.override_percent });
        }
        // Of a master's set-point it is the time at which that holds.
        let follows = command.control.contains(Control::SYNC);
        let start = if follows { Instant::ZERO } else { Instant::from_nanos(command.start_time_ns) };
        Ok(Self {
            number: command.number,
            skill: command.skill,
            source,
            seen_at,
            total,
            accepted: 0,
            executed_before: 0,
            stops_passed: 0,
            written: 0,
            written_at_start: match source {
                Source::Slots | Source::Points(_) => command.written,
                Source::Single(_) | Source::Program(_) => total,
            },
            phase: Phase::Dispatch { until },
            start,
            law_before_s: 0.0,
            cycles_to_start: 0,
            bad: None,
            check: Check { next: 0, from: *joints },
        })
    }

    /// Returns the next motion if it has arrived and the queue, of `room` motions, has room for it.
    pub(super) fn next_motion(
        &mut self,
        command: Option<&Command>,
        executed: u32,
        room: u32,
        programs: &Programs,
    ) -> Result<Option<Aimed>, Violation> {
        // The image holds the motions of the command that it names; another one was refused.
        let command = command.filter(|command| command.number == self.number);
        let held = self.accepted.saturating_sub(executed);
        let places = match &self.source {
            Source::Slots => Some(SLOTS as u32),
            Source::Points(points) => Some(points.capacity()),
            Source::Single(_) | Source::Program(_) => None,
        };
        if let (Some(places), Some(command)) = (places, command) {
            let ahead = command.written.checked_sub(self.accepted);
            let lost = ahead.is_none_or(|ahead| ahead > places);
            if lost || command.written < self.written || command.written > self.total {
                return Err(ErrorNumber::QueueOverrun.into());
            }
            self.written = command.written;
        }
        if self.accepted >= self.section_end(programs) || held >= room {
            return Ok(None);
        }
        if let (Source::Points(points), Some(command)) = (&mut self.source, command)
            && self.accepted < command.written
        {
            return Ok(points.take(command, self.accepted));
        }
        let motion = match (&self.source, command) {
            (Source::Program(_), _) => self.programmed(self.accepted, programs),
            (Source::Slots, Some(command)) if self.accepted < command.written => {
                Some(*command.slot(self.accepted))
            }
            (Source::Single(kind), Some(command)) => {
                let motion = *command.slot(0);
                if motion.kind != *kind {
                    return Err(Violation::Kind(motion.kind.into()));
                }
                Some(motion)
            }
            _ => None,
        };
        Ok(motion.map(|motion| (motion, motion.target.map(f64::from))))
    }

    pub(super) fn programmed(&self, index: u32, programs: &Programs) -> Option<Motion> {
        let Source::Program(program) = self.source else { return None };
        programs.get(program)?.1.motion(index).copied()
    }

    /// Returns what the check at loading found for the motions that are not checked yet, if that holds from where the arm comes to
    /// them.
    fn loaded(&self, programs: &Programs) -> Option<Option<(u32, Violation)>> {
        let Source::Program(program) = self.source else { return None };
        programs.get(program)?.1.loaded(self.check.next, &self.check.from)
    }

    /// Returns the place of the program's next stop, and what the program does there.
    fn stop(&self, programs: &Programs) -> Option<(u32, StopStatement)> {
        let Source::Program(program) = self.source else { return None };
        programs.get(program)?.1.stop(self.stops_passed)
    }

    /// Returns after how many motions the path ends, as far as it is known.
    pub(super) fn section_end(&self, programs: &Programs) -> u32 {
        self.stop(programs).map_or(self.total, |(after, _)| after.min(self.total))
    }

    /// Returns whether the program stops after all accepted motions, to do something.
    pub(super) fn stops_here(&self, programs: &Programs) -> bool {
        self.stop(programs).is_some_and(|(after, _)| after == self.accepted)
    }

    /// Returns what the program does now that all accepted motions are executed; each statement only once.
    pub(super) fn take_statement(&mut self, programs: &Programs) -> Option<StopStatement> {
        let (_, statement) = self.stop(programs).filter(|(after, _)| *after == self.accepted)?;
        self.stops_passed += 1;
        Some(statement)
    }

    /// Returns the outputs that the program clears before it begins.
    pub(super) fn clears(&self, programs: &Programs) -> u16 {
        let Source::Program(program) = self.source else { return 0 };
        programs.get(program).map_or(0, |(_, program)| program.clears())
    }

    /// Continues the check with the motion after the last accepted one, which ends at these joints.
    pub(super) const fn check_from(&mut self, end: Joints) {
        self.check = Check { next: self.accepted, from: end };
    }

    /// Checks some more motions that have arrived but are not on the path yet: those of a program, and those in the slots
    /// behind a LIN force, as if it ended at its target. `took_one` says that this cycle has put a motion on the path.
    /// Returns true when there is nothing left to check.
    pub(super) fn check_ahead(
        &mut self,
        took_one: bool,
        command: Option<&Command>,
        config: &RobotConfig,
        programs: &Programs,
    ) -> bool {
        let checks = if took_one { CHECKS_BESIDE_A_MOTION } else { CHECKS_PER_CYCLE };
        for _ in 0..checks {
            let next = self.check.next;
            if let Some(bad) = self.loaded(programs) {
                (self.bad, self.check.next) = (bad, self.total);
                return true;
            }
            let in_slots = self.source == Source::Slots && (self.accepted..self.written).contains(&next);
            let in_slot = command.filter(|command| in_slots && command.number == self.number);
            let in_slot = in_slot.map(|command| *command.slot(next));
            let Some(motion) = self.programmed(next, programs).or(in_slot) else { return true };
            let checked = Segment::prepare(&motion, &self.check.from, config);
            match checked.and_then(|segment| press::of(&motion, &segment, config).map(|_| segment)) {
                Ok(segment) => self.check = Check { next: self.check.next + 1, from: segment.end },
                Err(violation) => {
                    self.bad = Some((self.check.next, violation));
                    return true;
                }
            }
        }
        false
    }

    /// Returns whether motions are put on the path in this phase.
    pub(super) const fn takes_motions(&self) -> bool {
        !matches!(
            self.phase,
            Phase::Stopping(_) | Phase::Waiting { .. } | Phase::Meeting(_) | Phase::Arriving
        )
    }

    /// Returns whether all motions are on the path.
    pub(super) const fn is_complete(&self) -> bool {
        self.accepted == self.total
    }

    /// Returns the time since the command was first seen.
    pub(super) fn elapsed(&self, at: Instant) -> Duration {
        at.since(self.seen_at)
    }
}
