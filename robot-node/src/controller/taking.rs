//! Taking motions: from the slots that the PLC writes, or from a program.
//!
//! With a queue of five motions one a cycle is taken: checking it is what takes longest in a cycle, and motions last longer. With a
//! deeper one a cycle takes all that the slots hold, or ten compact points, and plans once after the last.

use arrayvec::ArrayVec;
use protocol::image::{Command, Motion, MotionKind, SLOTS, Services};
use setup::{LookAhead, MOST_QUEUE_MOTIONS};

use super::compact::Aimed;
use super::execution::{Execution, Phase, Source};
use super::program::Programs;
use super::{Controller, press};
use crate::RobotConfig;
use crate::arm::Violation;
use crate::motion::{Appended, MOST_MOTIONS, Segment};

const _: () = assert!(MOST_MOTIONS == MOST_QUEUE_MOTIONS as usize);

/// Motions that a cycle takes at most: more points than slots, since points are short.
const MOST_TAKEN: usize = 2 * SLOTS;

/// A motion that has passed the checks of its geometry.
type Prepared = (Motion, Segment, Option<press::Press>);

/// Returns the largest number of motions that any skill knows ahead.
pub(super) fn most_known(config: &RobotConfig) -> u32 {
    let of_programs = match config.program_look_ahead {
        LookAhead::Motions(motions) => motions,
        LookAhead::Block(_) => MOST_QUEUE_MOTIONS,
    };
    of_programs.max(config.queue_motions)
}

/// Returns the depth of the queue and the services that the feedback shows. A queue of five is that of the slots, as for a robot that
/// knows no other.
pub(super) fn served(config: &RobotConfig) -> (u16, Services) {
    if config.queue_motions as usize <= SLOTS {
        return (0, Services::SYNC);
    }
    let depth = u16::try_from(config.queue_motions).unwrap_or(u16::MAX);
    let mut services = Services::SYNC | Services::KEEPS_ACCEPTED;
    services.set(Services::COMPACT, config.compact_points);
    (depth, services)
}

impl Execution {
    /// Returns how many motions it may know that are not executed.
    pub(super) fn look_ahead(&self, config: &RobotConfig, programs: &Programs) -> u32 {
        match (&self.source, config.program_look_ahead) {
            (Source::Single(_), _) => SLOTS as u32,
            (Source::Slots | Source::Points(_), _) => config.queue_motions,
            (Source::Program(_), LookAhead::Motions(motions)) => motions,
            (Source::Program(_), LookAhead::Block(_)) => {
                let is_spline = |index: u32| {
                    self.programmed(index, programs).is_some_and(|motion| motion.kind == MotionKind::Spline)
                };
                // The next motion continues a spline, or is its last neighbour.
                let before = self.accepted.checked_sub(1);
                let goes_on = is_spline(self.accepted) && before.is_some_and(is_spline);
                if goes_on { MOST_QUEUE_MOTIONS } else { SLOTS as u32 }
            }
        }
    }

    /// Returns whether a cycle takes more than one motion.
    fn takes_many(&self, config: &RobotConfig, programs: &Programs) -> bool {
        self.look_ahead(config, programs) as usize > SLOTS
    }

    /// Returns whether the start waits for motions that came with the command. What comes later is not waited for.
    pub(super) fn may_start_with_more(
        &self,
        took_one: bool,
        config: &RobotConfig,
        programs: &Programs,
    ) -> bool {
        let most = if matches!(self.source, Source::Points(_)) { config.queue_motions } else { SLOTS as u32 };
        let came = self.written_at_start.min(most).min(self.total);
        let waits = !self.takes_many(config, programs) || self.accepted < came;
        took_one && waits && !self.is_complete()
    }
}

impl Controller {
    /// Takes motions, if the queue has room. Returns whether there was one.
    pub(super) fn take_motions(&mut self, execution: &mut Execution, command: Option<&Command>) -> bool {
        // Where a LIN force ends is known when it has ended.
        if self.is_pressing(press::Phase::Waiting) || self.is_pressing(press::Phase::Pressing) {
            return false;
        }
        if execution.takes_many(&self.config, &self.programs) {
            return self.take_all(execution, command);
        }
        match self.next_prepared(execution, command) {
            Ok(None) => return false,
            Ok(Some((_, prepared))) => self.take_one(execution, prepared),
            Err(violation) => self.reject(execution, violation),
        }
        true
    }

    /// Takes all that the slots hold, and plans once after the last. Returns whether there was one.
    fn take_all(&mut self, execution: &mut Execution, command: Option<&Command>) -> bool {
        let (accepted_before, source_before) = (execution.accepted, execution.source);
        let most = if matches!(execution.source, Source::Points(_)) { MOST_TAKEN } else { SLOTS };
        let mut taken = ArrayVec::<Aimed, MOST_TAKEN>::new();
        let mut ended = None;
        self.interpolator.begin_batch();
        while taken.len() < most && ended.is_none() {
            match self.next_prepared(execution, command) {
                Ok(Some((aimed, (_, segment, None)))) => {
                    execution.accepted += 1;
                    let last = execution.accepted == execution.section_end(&self.programs);
                    self.interpolator.append_to_batch(segment, last);
                    taken.push(aimed);
                }
                Ok(next) => ended = Some(Ok(next.map(|(_, prepared)| prepared))),
                Err(violation) => ended = Some(Err(violation)),
            }
        }
        if self.interpolator.end_batch() {
            taken.iter().for_each(|(motion, _)| self.accepted.add(motion));
            self.press = if taken.is_empty() { self.press.take() } else { None };
        } else {
            execution.accepted = accepted_before;
            if !self.interpolator.path().rests() {
                // No law leads on from here: from a later place one may, and at the end of the known motions the arm rests. To try one
                // motion after another would take longer than a cycle.
                execution.source = source_before;
                return false;
            }
            for aimed in &taken {
                match self.prepare(aimed) {
                    Ok(prepared) => self.take_one(execution, prepared),
                    Err(violation) => {
                        self.reject(execution, violation);
                        return true;
                    }
                }
            }
        }
        match ended {
            Some(Ok(Some(prepared))) if taken.is_empty() => self.take_one(execution, prepared),
            Some(Err(violation)) => self.reject(execution, violation),
            _ => return !taken.is_empty(),
        }
        true
    }

    /// Returns the next motion with its geometry, if it has arrived and the queue has room for it.
    fn next_prepared(
        &self,
        execution: &mut Execution,
        command: Option<&Command>,
    ) -> Result<Option<(Aimed, Prepared)>, Violation> {
        let executed = self.executed(execution);
        let room = match self.interpolator.path().is_full() {
            true => 0,
            false => execution.look_ahead(&self.config, &self.programs),
        };
        let next = execution.next_motion(command, executed, room, &self.programs)?;
        next.map(|aimed| Ok((aimed, self.prepare(&aimed)?))).transpose()
    }

    fn prepare(&self, (motion, target): &Aimed) -> Result<Prepared, Violation> {
        let segment = self.interpolator.path().prepare_to(*target, motion, &self.config)?;
        let press = press::of(motion, &segment, &self.config)?;
        Ok((*motion, segment, press))
    }

    /// Puts one motion on the path and plans.
    fn take_one(&mut self, execution: &mut Execution, (motion, segment, press): Prepared) {
        execution.accepted += 1;
        self.accepted.add(&motion);
        if press.is_some() {
            execution.check_from(segment.end);
            self.press = press;
            self.interpolator.close();
            return;
        }
        self.press = None;
        let last = execution.accepted == execution.section_end(&self.programs);
        let appended = self.interpolator.append(segment, last);
        if appended == Appended::Late {
            self.suppressed(execution.accepted.saturating_sub(2));
        }
    }

    /// Stops after the motions before one that cannot be run.
    fn reject(&mut self, execution: &mut Execution, violation: Violation) {
        execution.bad = Some((execution.accepted, violation));
        if execution.phase == Phase::Driving {
            self.refuse_motion(execution.number, execution.accepted, violation);
        }
        self.interpolator.close();
    }
}
