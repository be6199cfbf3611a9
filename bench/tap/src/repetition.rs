//! Repetitions of RC, SM and CM among the skills, by the plan.
//!
//! RC is one `RunProgram`, CM one `MoveContinuous` for each continuous motion of the plan, SM a skill for each motion. A move to the
//! start between two repetitions is none of these.

use machine::Lateness;
use planning::Switch;
use plc_node::ExecutionType;
use protocol::image::{Motion, Skill};
use records::results::PerType;

use crate::expected::ExpectedRun;
use crate::pace::tick;
use crate::pattern::{Matched, Pattern};
use crate::skill::{SkillEnd, SkillRecord};

/// Largest difference of equal coordinates in mm or degrees: what a PLC's single precision may lose.
const EQUAL: f32 = 0.01;

/// Repetitions and failures that are kept; more are only counted.
const MAX_KEPT: usize = 100_000;

/// A repetition.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct Repetition {
    pub(crate) execution_type: ExecutionType,
    pub(crate) commanded_ns: u64,
    pub(crate) time_ns: u64,
    /// Sum of the robot's own measures.
    pub(crate) robot_ns: u64,
    pub(crate) blends_suppressed: u32,
    pub(crate) uncertainty_ns: u64,
}

/// A repetition that failed.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct FailedRun {
    pub(crate) execution_type: ExecutionType,
    pub(crate) commanded_ns: u64,
    pub(crate) error: String,
}

/// Times and slots of the skills of a type, in all its repetitions.
#[derive(Clone, Default, Debug)]
pub(crate) struct TypeTraits {
    /// Time from the command to the first feedback with its number, and to the first in which the arm moves.
    pub(crate) seen: Lateness,
    pub(crate) moved: Lateness,
    pub(crate) slots_used: u32,
    pub(crate) starved: u32,
    /// Repetitions whose end the PLC did not answer: they end with the feedback.
    pub(crate) unanswered: u32,
    /// Repetitions that were left before their end, or had begun before the capture.
    pub(crate) incomplete: u32,
}

/// A repetition whose skills are done, and whose output at the end is still to be switched.
#[derive(Debug)]
struct Switching {
    execution_type: ExecutionType,
    skills: Vec<SkillRecord>,
    switch: Switch,
}

/// The repetitions among the skills.
#[derive(Debug)]
pub(crate) struct Repetitions {
    last_switch: Option<Switch>,
    rc: Pattern<(), SkillRecord>,
    sm: Pattern<Motion, SkillRecord>,
    cm: Pattern<u32, SkillRecord>,
    switching: Option<Switching>,
    pub(crate) finished: Vec<Repetition>,
    pub(crate) failed: Vec<FailedRun>,
    pub(crate) traits: PerType<TypeTraits>,
    /// Single motions that are not part of the plan: moves to the start.
    pub(crate) other_motions: u32,
    /// Motions of a `MoveContinuous` that the plan does not have.
    pub(crate) other_total: Option<u32>,
    /// Repetitions beyond those that are kept.
    pub(crate) not_kept: u64,
}

impl Repetitions {
    pub(crate) fn new(expected: &ExpectedRun) -> Self {
        Self {
            last_switch: expected.last_switch,
            rc: Pattern::new(vec![()], |_, _| true),
            sm: Pattern::new(expected.motions.clone(), is_same_motion),
            cm: Pattern::new(expected.continuous.clone(), PartialEq::eq),
            switching: None,
            finished: Vec::new(),
            failed: Vec::new(),
            traits: PerType::default(),
            other_motions: 0,
            other_total: None,
            not_kept: 0,
        }
    }

    /// Takes the outputs of a command: they may end a repetition.
    pub(crate) fn handle_outputs(&mut self, now_ns: u64, outputs: u16) {
        let is_switched = |switching: &mut Switching| switching.switch.applied_to(outputs) == outputs;
        if let Some(Switching { execution_type, skills, switch }) = self.switching.take_if(is_switched) {
            let wait_ns = u64::try_from(switch.wait.as_nanos()).unwrap_or(u64::MAX);
            self.finish(execution_type, &skills, now_ns.saturating_add(wait_ns));
        }
    }

    /// Takes a skill that has ended.
    pub(crate) fn handle_skill(&mut self, record: SkillRecord) {
        self.end_without_switch();
        let Some(execution_type) = type_of(record.skill) else { return };
        for other in ExecutionType::ALL.into_iter().filter(|other| *other != execution_type) {
            self.leave(other);
        }
        let matched = match execution_type {
            ExecutionType::Rc => self.rc.add(&(), record),
            ExecutionType::Sm => self.sm.add(&record.first, record),
            ExecutionType::Cm => self.cm.add(&record.total, record),
        };
        let Matched { complete, is_part, has_left } = matched;
        self.traits_of(execution_type).incomplete += u32::from(has_left);
        if !is_part {
            match execution_type {
                ExecutionType::Cm => self.other_total = Some(record.total),
                _ => self.other_motions = self.other_motions.saturating_add(1),
            }
            return;
        }
        if record.end != SkillEnd::Done {
            self.fail(execution_type, &record, complete);
            return;
        }
        let Some(skills) = complete else { return };
        let switch = self.last_switch.filter(|_| execution_type != ExecutionType::Rc);
        match switch {
            Some(switch) => self.switching = Some(Switching { execution_type, skills, switch }),
            None => self.finish(execution_type, &skills, record.end_ns()),
        }
    }

    /// Ends the capture.
    pub(crate) fn end(&mut self) {
        self.end_without_switch();
        ExecutionType::ALL.into_iter().for_each(|execution_type| self.leave(execution_type));
    }

    fn traits_of(&mut self, execution_type: ExecutionType) -> &mut TypeTraits {
        self.traits.entry(execution_type).get_or_insert_default()
    }

    /// Leaves the sequence of a type, if one has begun.
    fn leave(&mut self, execution_type: ExecutionType) {
        if self.forget(execution_type) {
            self.traits_of(execution_type).incomplete += 1;
        }
    }

    fn forget(&mut self, execution_type: ExecutionType) -> bool {
        match execution_type {
            ExecutionType::Rc => self.rc.leave(),
            ExecutionType::Sm => self.sm.leave(),
            ExecutionType::Cm => self.cm.leave(),
        }
    }

    /// Ends a repetition whose output was not switched: its last skill is its end.
    fn end_without_switch(&mut self) {
        if let Some(Switching { execution_type, skills, .. }) = self.switching.take() {
            let ended_ns = skills.last().map_or(0, SkillRecord::end_ns);
            self.finish(execution_type, &skills, ended_ns);
        }
    }

    fn fail(
        &mut self,
        execution_type: ExecutionType,
        record: &SkillRecord,
        complete: Option<Vec<SkillRecord>>,
    ) {
        let number = match (&complete, execution_type) {
            (Some(skills), _) => skills.len(),
            (None, ExecutionType::Rc) => 1,
            (None, ExecutionType::Sm) => self.sm.len(),
            (None, ExecutionType::Cm) => self.cm.len(),
        };
        self.forget(execution_type);
        if matches!(record.end, SkillEnd::Unfinished | SkillEnd::Replaced) {
            self.traits_of(execution_type).incomplete += 1;
            return;
        }
        let error = match record.end {
            SkillEnd::Failed(error) => {
                format!("skill {number} failed with error {}: {error}", u16::from(error))
            }
            _ => format!("skill {number} was aborted"),
        };
        if self.failed.len() < MAX_KEPT {
            self.failed.push(FailedRun { execution_type, commanded_ns: record.commanded_ns, error });
        } else {
            self.not_kept += 1;
        }
    }

    fn finish(&mut self, execution_type: ExecutionType, skills: &[SkillRecord], ended_ns: u64) {
        let (Some(first), Some(last)) = (skills.first(), skills.last()) else { return };
        let traits = self.traits.entry(execution_type).get_or_insert_default();
        for skill in skills {
            let after = |at: Option<u64>| at.map(|at| tick(at.saturating_sub(skill.commanded_ns)));
            after(skill.seen_ns).iter().for_each(|seen| traits.seen.record(seen));
            after(skill.moved_ns).iter().for_each(|moved| traits.moved.record(moved));
            traits.slots_used = traits.slots_used.max(skill.slots_used);
            traits.starved = traits.starved.saturating_add(skill.starved);
        }
        traits.unanswered += u32::from(last.acknowledged_ns.is_none());
        if self.finished.len() >= MAX_KEPT {
            self.not_kept += 1;
            return;
        }
        self.finished.push(Repetition {
            execution_type,
            commanded_ns: first.commanded_ns,
            time_ns: ended_ns.saturating_sub(first.commanded_ns),
            robot_ns: skills.iter().fold(0, |sum, skill| sum.saturating_add(skill.robot_ns)),
            blends_suppressed: skills.iter().map(|skill| u32::from(skill.blends_suppressed)).sum(),
            // The first skill has that of the start, the last that of the end.
            uncertainty_ns: first.uncertainty_ns.max(last.uncertainty_ns),
        });
    }
}

/// Returns the type that uses a skill; `None` for a skill that no type has.
const fn type_of(skill: Skill) -> Option<ExecutionType> {
    match skill {
        Skill::RunProgram => Some(ExecutionType::Rc),
        Skill::MoveContinuous | Skill::MoveTrajectory => Some(ExecutionType::Cm),
        Skill::None | Skill::Unknown(_) => None,
        _ => Some(ExecutionType::Sm),
    }
}

fn is_same_motion(own: &Motion, other: &Motion) -> bool {
    let mut coordinates = own.target.iter().zip(&other.target);
    own.kind == other.kind && coordinates.all(|(own, other)| (own - other).abs() <= EQUAL)
}

#[cfg(test)]
mod tests {
    use super::*;
    use protocol::image::{ErrorNumber, MotionKind};
    use std::time::Duration;

    fn motion(x: f32) -> Motion {
        Motion { kind: MotionKind::LinCartesian, target: [x; 6], ..Motion::EMPTY }
    }

    fn record(skill: Skill, at: u64, x: f32, total: u32) -> SkillRecord {
        SkillRecord {
            skill,
            total,
            first: motion(x),
            commanded_ns: at,
            seen_ns: Some(at + 2),
            moved_ns: Some(at + 3),
            ended_ns: at + 9,
            acknowledged_ns: Some(at + 10),
            end: SkillEnd::Done,
            blends_suppressed: 1,
            robot_ns: 9,
            slots_used: 5,
            starved: 0,
            uncertainty_ns: 1,
        }
    }

    fn of_three(last_switch: Option<Switch>) -> Repetitions {
        let motions = [1.0, 2.0, 3.0].map(motion).to_vec();
        Repetitions::new(&ExpectedRun { motions, continuous: vec![2, 1], last_switch })
    }

    fn times(repetitions: &Repetitions) -> Vec<(ExecutionType, u64, u64)> {
        let of = |one: &Repetition| (one.execution_type, one.commanded_ns, one.time_ns);
        repetitions.finished.iter().map(of).collect()
    }

    #[test]
    fn types_are_told_apart_by_their_skills_and_a_move_to_the_start_is_of_none() {
        let mut repetitions = of_three(None);
        let lin = Skill::MoveLinCartesian;
        repetitions.handle_skill(record(Skill::RunProgram, 100, 0.0, 0));
        for (at, x) in [(200, 7.0), (220, 1.005), (240, 2.0), (260, 3.0)] {
            repetitions.handle_skill(record(lin, at, x, 1));
        }
        repetitions.handle_skill(record(Skill::MoveContinuous, 300, 1.0, 2));
        repetitions.handle_skill(record(Skill::MoveContinuous, 320, 3.0, 1));
        use ExecutionType::{Cm, Rc, Sm};
        assert_eq!(times(&repetitions), [(Rc, 100, 10), (Sm, 220, 50), (Cm, 300, 30)]);
        assert_eq!((repetitions.other_motions, repetitions.other_total), (1, None));
        assert_eq!(repetitions.finished[1].blends_suppressed, 3);
    }

    #[test]
    fn an_output_at_the_end_and_its_wait_belong_to_the_repetition() {
        let switch = Switch { output: 2, set: true, wait: Duration::from_nanos(500) };
        let mut repetitions = of_three(Some(switch));
        repetitions.handle_outputs(1, 0b100);
        for (at, x) in [(220, 1.0), (240, 2.0), (260, 3.0)] {
            repetitions.handle_skill(record(Skill::MoveLinCartesian, at, x, 1));
        }
        repetitions.handle_outputs(271, 0b011);
        assert_eq!(times(&repetitions), []);
        repetitions.handle_outputs(272, 0b111);
        assert_eq!(times(&repetitions), [(ExecutionType::Sm, 220, 552)]);
    }

    #[test]
    fn a_failed_or_cut_repetition_is_named_and_not_measured() {
        let mut repetitions = of_three(None);
        let lin = Skill::MoveLinCartesian;
        repetitions.handle_skill(record(lin, 220, 1.0, 1));
        let end = SkillEnd::Failed(ErrorNumber::from(14));
        repetitions.handle_skill(SkillRecord { end, ..record(lin, 240, 2.0, 1) });
        assert!(repetitions.failed[0].error.starts_with("skill 2 failed with error 14: "));
        repetitions.handle_skill(record(lin, 260, 1.0, 1));
        repetitions.handle_skill(record(Skill::MoveContinuous, 300, 1.0, 4));
        repetitions.handle_skill(SkillRecord {
            end: SkillEnd::Unfinished,
            ..record(Skill::RunProgram, 400, 0.0, 0)
        });
        repetitions.end();
        assert_eq!(times(&repetitions), []);
        let incomplete = |one| repetitions.traits.get(one).map(|traits: &TypeTraits| traits.incomplete);
        use ExecutionType::{Rc, Sm};
        assert_eq!((incomplete(Sm), incomplete(Rc), repetitions.other_total), (Some(1), Some(1), Some(4)));
    }
}
