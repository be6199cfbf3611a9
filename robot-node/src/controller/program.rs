//! The program store: the programs that the paper's RC runs.

use planning::{MarkSignal, Meeting, PROGRAM, Plan, ProgramSection, Stop, Switch};
use protocol::image::Motion;
use setup::Setup;

use super::press;
use crate::RobotConfig;
use crate::arm::{Joints, Violation};
use crate::motion::Segment;

/// A program: motions, and what it does between them.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Program {
    motions: Vec<Motion>,
    /// Its actions at its stops, in order, each with the number of motions before it.
    stops: Vec<(u32, StopStatement)>,
    /// Outputs that it clears before it begins.
    clears: u16,
    /// Result of the check when the program was loaded.
    checked: CheckedProgram,
}

/// Action of a program at a stop.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum StopStatement {
    /// Switches an output, and waits until that has taken effect.
    Switch(Switch),
    /// Switches an output of its own, and waits for inputs.
    Meet(MarkSignal),
}

/// Result of checking a program from the arm's home.
#[derive(Clone, PartialEq, Debug, Default)]
struct CheckedProgram {
    /// Where each motion ends that can be run.
    ends: Vec<Joints>,
    /// The first motion that cannot be run, and why.
    bad: Option<(u32, Violation)>,
}

/// Programs by number.
pub(super) type Programs = Vec<(u16, Program)>;

impl Program {
    /// Creates a program of these motions that stops at each stop that switches an output. At other stops the
    /// motion's own approximation distance applies.
    #[must_use]
    pub fn new(motions: Vec<Motion>, stops: &[Stop]) -> Self {
        let stop = |stop: &Stop| Some((stop.after, StopStatement::Switch(stop.then?)));
        Self { motions, stops: stops.iter().filter_map(stop).collect(), ..Self::default() }
    }

    /// Returns the program with marks at which it meets those of other robots by outputs, in order. It clears the outputs of `clears`
    /// before it begins.
    #[must_use]
    pub fn meeting(mut self, meetings: &[Meeting], clears: u16) -> Self {
        for meeting in meetings {
            let is_before = |(after, statement): &(u32, StopStatement)| {
                let is_first = meeting.after_action || matches!(statement, StopStatement::Meet(_));
                *after < meeting.after || *after == meeting.after && is_first
            };
            let at = self.stops.iter().take_while(|stop| is_before(stop)).count();
            self.stops.insert(at, (meeting.after, StopStatement::Meet(meeting.signal)));
        }
        Self { clears, ..self }
    }

    /// Returns the program of a robot that works alone: it waits for no other one.
    #[must_use]
    pub fn alone(mut self) -> Self {
        for (_, statement) in &mut self.stops {
            if let StopStatement::Meet(signal) = statement {
                *signal = signal.alone();
            }
        }
        self
    }

    /// Returns the programs that a robot stores for RC, by number: the plan as one, [`PROGRAM`], which meets others at its marks by
    /// outputs. Before each visit of a shared zone another one begins, numbered from there on, and the PLC switches what the end of
    /// the one before has to switch.
    #[must_use]
    pub fn stored(plan: &Plan, setup: &Setup) -> Vec<(u16, Self)> {
        Self::of_sections(&plan.wire_motions(setup), &plan.sections())
    }

    /// Returns the programs of sections, numbered from [`PROGRAM`].
    ///
    /// # Panics
    ///
    /// A section has motions beyond the end of `motions`.
    #[must_use]
    pub fn of_sections(motions: &[Motion], sections: &[ProgramSection]) -> Vec<(u16, Self)> {
        (PROGRAM..).zip(sections.iter().map(|section| Self::of_section(motions, section))).collect()
    }

    /// Returns the program of a section.
    ///
    /// # Panics
    ///
    /// The section has motions beyond the end of `motions`.
    #[must_use]
    pub fn of_section(motions: &[Motion], section: &ProgramSection) -> Self {
        Self::new(motions[section.motions.clone()].to_vec(), &section.stops)
            .meeting(&section.meetings, section.clears)
    }

    /// Checks all motions, from the arm's home: a program is checked when it is loaded, so that a start need not wait for it.
    pub(super) fn load(&mut self, config: &RobotConfig) {
        let mut found = CheckedProgram { ends: Vec::with_capacity(self.motions.len()), bad: None };
        let mut from = config.home;
        for (motion, index) in self.motions.iter().zip(0_u32..) {
            let checked = Segment::prepare(motion, &from, config);
            match checked.and_then(|segment| press::of(motion, &segment, config).map(|_| segment)) {
                Ok(segment) => {
                    from = segment.end;
                    found.ends.push(from);
                }
                Err(violation) => {
                    found.bad = Some((index, violation));
                    break;
                }
            }
        }
        self.checked = found;
    }

    /// Returns what the check at loading found for all motions from `next` on, if the arm comes to that motion as it did then: at
    /// these joints.
    pub(super) fn loaded(&self, next: u32, from: &Joints) -> Option<Option<(u32, Violation)>> {
        let before = usize::try_from(next.checked_sub(1)?).ok()?;
        (self.checked.ends.get(before)? == from).then_some(self.checked.bad)
    }

    /// Returns the number of motions.
    pub(super) fn total(&self) -> u32 {
        u32::try_from(self.motions.len()).unwrap_or(u32::MAX)
    }

    /// Returns motion `index`, counted from 0.
    pub(super) fn motion(&self, index: u32) -> Option<&Motion> {
        self.motions.get(usize::try_from(index).ok()?)
    }

    /// Returns after how many motions the program does its `passed + 1`st statement at a stop, and which.
    pub(super) fn stop(&self, passed: usize) -> Option<(u32, StopStatement)> {
        self.stops.get(passed).copied()
    }

    /// Returns the outputs that the program clears before it begins.
    pub(super) const fn clears(&self) -> u16 {
        self.clears
    }
}

impl From<Vec<Motion>> for Program {
    fn from(motions: Vec<Motion>) -> Self {
        Self { motions, ..Self::default() }
    }
}
