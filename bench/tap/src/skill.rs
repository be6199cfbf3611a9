//! The skills of one PLC and one robot: when each was commanded, seen, moved and done.

use protocol::image::{Command, Control, ErrorNumber, Feedback, Motion, Skill, Status};

/// Time in ns after the end of a skill in which a PLC takes `EXECUTE` back: the longest scan of a PLC that commands robots, several
/// times.
const MAX_ACKNOWLEDGE_NS: u64 = 50_000_000;

/// End of a skill.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum SkillEnd {
    /// With `DONE`.
    Done,
    /// With `ABORTED`.
    Aborted,
    /// With an error, or refused with one.
    Failed(ErrorNumber),
    /// The next command came before its end was captured.
    Replaced,
    /// The capture ends before it does.
    Unfinished,
}

/// A skill that has ended. Times are in ns since the first packet.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct SkillRecord {
    pub(crate) skill: Skill,
    /// Motions in all.
    pub(crate) total: u32,
    /// Its first motion.
    pub(crate) first: Motion,
    /// First frame with its command.
    pub(crate) commanded_ns: u64,
    /// First feedback with its number.
    pub(crate) seen_ns: Option<u64>,
    /// First feedback in which the arm moves.
    pub(crate) moved_ns: Option<u64>,
    /// First feedback in which it has ended.
    pub(crate) ended_ns: u64,
    /// First command without `EXECUTE` after that, or the next one with it: the PLC has seen the end. `None` if the PLC leaves
    /// `EXECUTE` set.
    pub(crate) acknowledged_ns: Option<u64>,
    pub(crate) end: SkillEnd,
    pub(crate) blends_suppressed: u16,
    /// The robot's own measure.
    pub(crate) robot_ns: u64,
    /// Most motions that were written and not executed.
    pub(crate) slots_used: u32,
    /// Feedbacks in which all written motions were executed and others were still to come.
    pub(crate) starved: u32,
    /// Time between the frames before and at the start, and before and at the end: by so much the times may be later.
    pub(crate) uncertainty_ns: u64,
}

impl SkillRecord {
    /// Returns when the PLC has seen the end; the end itself, if the PLC leaves `EXECUTE` set.
    pub(crate) fn end_ns(&self) -> u64 {
        self.acknowledged_ns.unwrap_or(self.ended_ns)
    }
}

/// The skills of one PLC and one robot, frame by frame.
#[derive(Clone, Default, Debug)]
pub(crate) struct SkillWatch {
    current: Option<SkillRecord>,
    /// The last skill, until the PLC has seen its end.
    ended: Option<SkillRecord>,
    /// Time from the end of a skill to the PLC's answer: sum in ns, and how often it answered.
    answers_ns: u64,
    answers: u64,
    /// Number of the last command with `EXECUTE`.
    number: Option<u16>,
    has_command: bool,
    last_command_ns: u64,
    last_feedback: Option<Feedback>,
    /// Skills under way when the capture began.
    under_way: u32,
}

impl SkillWatch {
    /// Takes a command; returns the skill whose end it acknowledges, or that it replaces.
    pub(crate) fn handle_command(&mut self, now_ns: u64, command: &Command) -> Option<SkillRecord> {
        let gap_ns = now_ns.saturating_sub(self.last_command_ns);
        let is_first = !std::mem::replace(&mut self.has_command, true);
        self.last_command_ns = now_ns;
        if let Some(current) = self.current.as_mut().filter(|_| self.number == Some(command.number)) {
            let executed = self.last_feedback.filter(|feedback| feedback.number == command.number);
            let executed = executed.map_or(0, |feedback| feedback.executed);
            current.slots_used = current.slots_used.max(command.written.saturating_sub(executed));
        }
        let acknowledged = self.acknowledged(now_ns, gap_ns, command);
        let is_new = command.control.contains(Control::EXECUTE) && self.number != Some(command.number);
        if !is_new {
            return acknowledged;
        }
        self.number = Some(command.number);
        let before = self.current.take().map(|current| SkillRecord {
            ended_ns: now_ns,
            end: SkillEnd::Replaced,
            ..current
        });
        if is_first {
            // Its start was before the capture.
            let is_busy = self.last_feedback.is_none_or(|feedback| feedback.status.contains(Status::BUSY));
            self.under_way += u32::from(is_busy);
            return acknowledged.or(before);
        }
        self.current = Some(SkillRecord {
            skill: command.skill,
            total: command.total,
            first: *command.slot(0),
            commanded_ns: now_ns,
            seen_ns: None,
            moved_ns: None,
            ended_ns: now_ns,
            acknowledged_ns: None,
            end: SkillEnd::Unfinished,
            blends_suppressed: 0,
            robot_ns: 0,
            slots_used: command.written,
            starved: 0,
            uncertainty_ns: gap_ns,
        });
        acknowledged.or(before)
    }

    /// Returns the skill that has ended once a command shows that the PLC has seen it, or has not for long.
    fn acknowledged(&mut self, now_ns: u64, gap_ns: u64, command: &Command) -> Option<SkillRecord> {
        let after_ns = now_ns.saturating_sub(self.ended?.ended_ns);
        if after_ns > MAX_ACKNOWLEDGE_NS {
            return self.ended.take();
        }
        let is_held = command.control.contains(Control::EXECUTE) && self.number == Some(command.number);
        let ended = self.ended.take_if(|_| !is_held)?;
        self.answers_ns = self.answers_ns.saturating_add(after_ns);
        self.answers += 1;
        let uncertainty_ns = ended.uncertainty_ns.saturating_add(gap_ns);
        Some(SkillRecord { acknowledged_ns: Some(now_ns), uncertainty_ns, ..ended })
    }

    /// Takes a feedback. A skill that it ends is returned by a later command.
    pub(crate) fn handle_feedback(&mut self, now_ns: u64, feedback: &Feedback) {
        let before = self.last_feedback.replace(*feedback);
        let Some(current) = self.current.as_mut().filter(|_| self.number == Some(feedback.number)) else {
            return;
        };
        let is_of_earlier = before.is_some_and(|before| before.number == feedback.number);
        if current.seen_ns.is_none() && is_of_earlier && !feedback.status.contains(Status::BUSY) {
            // The number of an earlier command, which this one has again.
            return;
        }
        current.seen_ns.get_or_insert(now_ns);
        if !feedback.status.contains(Status::AT_REST) {
            current.moved_ns.get_or_insert(now_ns);
        }
        current.blends_suppressed = feedback.blends_suppressed;
        let end = if feedback.status.contains(Status::DONE) {
            SkillEnd::Done
        } else if feedback.status.contains(Status::ABORTED) {
            SkillEnd::Aborted
        } else if feedback.status.contains(Status::ERROR) {
            SkillEnd::Failed(feedback.error)
        } else {
            let is_starved = feedback.executed < current.total && feedback.accepted == feedback.executed;
            current.starved += u32::from(is_starved && feedback.executed > 0);
            return;
        };
        self.ended = self.current.take().map(|current| SkillRecord {
            end,
            ended_ns: now_ns,
            robot_ns: feedback.execution_ns,
            ..current
        });
    }

    /// Returns the last skill at the end of the capture. If the PLC's answer to its end was not captured, it is taken to have
    /// come as late as the earlier ones did on average.
    pub(crate) fn finish(&mut self) -> Option<SkillRecord> {
        let usual_ns = self.answers_ns.checked_div(self.answers);
        let ended = self.ended.take().map(|ended| SkillRecord {
            acknowledged_ns: usual_ns.map(|usual| ended.ended_ns.saturating_add(usual)),
            uncertainty_ns: ended.uncertainty_ns.saturating_add(usual_ns.unwrap_or_default()),
            ..ended
        });
        ended.or_else(|| self.current.take())
    }

    /// Returns how many skills were under way when the capture began.
    pub(crate) const fn under_way(&self) -> u32 {
        self.under_way
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn command(number: u16, is_on: bool) -> Command {
        let control = if is_on { Control::ENABLE | Control::EXECUTE } else { Control::ENABLE };
        Command { control, number, skill: Skill::MoveContinuous, total: 7, written: 5, ..Command::default() }
    }

    fn feedback(number: u16, status: Status, executed: u32) -> Feedback {
        Feedback { number, status, executed, accepted: executed + 5, execution_ns: 42, ..Feedback::default() }
    }

    #[test]
    fn a_skill_lasts_from_its_command_to_the_answer_to_its_end() {
        let mut watch = SkillWatch::default();
        let rest = Status::AT_REST;
        watch.handle_feedback(90, &feedback(3, rest | Status::DONE, 7));
        assert_eq!(watch.handle_command(95, &command(3, false)), None);
        assert_eq!(watch.handle_command(100, &command(4, true)), None);
        watch.handle_feedback(102, &feedback(3, rest | Status::DONE, 7));
        watch.handle_feedback(104, &feedback(4, rest | Status::BUSY, 0));
        watch.handle_feedback(108, &feedback(4, Status::BUSY, 0));
        assert_eq!(watch.handle_command(109, &Command { written: 6, ..command(4, true) }), None);
        watch.handle_feedback(150, &feedback(4, rest | Status::DONE, 7));
        assert_eq!(watch.handle_command(151, &command(4, true)), None);
        let ended = watch.handle_command(153, &command(4, false)).unwrap();
        let times = [Some(ended.commanded_ns), ended.seen_ns, ended.moved_ns, Some(ended.ended_ns)];
        assert_eq!(times, [Some(100), Some(104), Some(108), Some(150)]);
        assert_eq!((ended.end, ended.robot_ns, ended.slots_used), (SkillEnd::Done, 42, 6));
        assert_eq!((ended.acknowledged_ns, ended.uncertainty_ns), (Some(153), 5 + 2));
    }

    #[test]
    fn a_plc_that_leaves_execute_set_has_no_answer() {
        let mut watch = SkillWatch::default();
        watch.handle_command(1, &command(1, false));
        watch.handle_command(2, &command(2, true));
        watch.handle_feedback(3, &feedback(2, Status::DONE, 7));
        assert_eq!(watch.handle_command(40_000_000, &command(2, true)), None);
        let ended = watch.handle_command(60_000_000, &command(2, true)).unwrap();
        assert_eq!((ended.ended_ns, ended.acknowledged_ns), (3, None));
    }

    #[test]
    fn the_next_command_answers_the_end_of_the_last_one() {
        let mut watch = SkillWatch::default();
        watch.handle_command(1, &command(1, false));
        watch.handle_command(2, &command(2, true));
        watch.handle_feedback(3, &feedback(2, Status::DONE, 7));
        let ended = watch.handle_command(5, &command(3, true)).unwrap();
        assert_eq!((ended.end, ended.acknowledged_ns), (SkillEnd::Done, Some(5)));
        assert_eq!(watch.finish().unwrap().commanded_ns, 5);
    }

    #[test]
    fn an_answer_after_the_end_of_the_capture_comes_as_late_as_the_earlier_ones() {
        let mut watch = SkillWatch::default();
        watch.handle_command(1, &command(1, false));
        for (number, at) in [(2, 100), (3, 200)] {
            watch.handle_command(at, &command(number, true));
            watch.handle_feedback(at + 50, &feedback(number, Status::DONE, 7));
            watch.handle_command(at + 50 + u64::from(number), &command(number, false));
        }
        watch.handle_command(300, &command(4, true));
        watch.handle_feedback(350, &feedback(4, Status::DONE, 7));
        assert_eq!(watch.finish().unwrap().acknowledged_ns, Some(352));
    }

    #[test]
    fn a_skill_that_the_capture_meets_under_way_is_counted_and_not_measured() {
        let mut watch = SkillWatch::default();
        assert_eq!(watch.handle_command(1, &command(9, true)), None);
        watch.handle_feedback(50, &feedback(9, Status::DONE, 7));
        assert_eq!(watch.handle_command(51, &command(9, false)), None);
        assert_eq!((watch.under_way(), watch.finish()), (1, None));
    }

    #[test]
    fn a_command_before_the_end_of_the_last_one_replaces_it() {
        let mut watch = SkillWatch::default();
        watch.handle_command(1, &command(1, false));
        watch.handle_command(2, &command(2, true));
        let replaced = watch.handle_command(3, &command(3, true)).unwrap();
        assert_eq!(replaced.end, SkillEnd::Replaced);
        assert_eq!(watch.finish().unwrap().end, SkillEnd::Unfinished);
    }
}
