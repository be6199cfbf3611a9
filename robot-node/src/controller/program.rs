//! The program store: the programs that the paper's RC runs.

use planning::{PROGRAM, Plan, ProgramSection, Stop, Switch};
use protocol::image::Motion;
use setup::Setup;

use super::press;
use crate::RobotConfig;
use crate::arm::{Joints, Violation};
use crate::motion::Segment;

/// A program: motions, and switching of outputs between them.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Program {
    motions: Vec<Motion>,
    /// Stops with the output that each switches, in order.
    stops: Vec<Stop>,
    /// Result of the check when the program was loaded.
    checked: CheckedProgram,
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
        let stops = stops.iter().filter(|stop| stop.then.is_some()).copied().collect();
        Self { motions, stops, ..Self::default() }
    }

    /// Returns the programs that a robot stores for RC, by number: the plan as one, [`PROGRAM`]. Where the arm waits for others, a
    /// program for each section between two waits, numbered from there on; the PLC then switches what a section's end has to
    /// switch.
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
        let program =
            |section: &ProgramSection| Self::new(motions[section.motions.clone()].to_vec(), &section.stops);
        (PROGRAM..).zip(sections.iter().map(program)).collect()
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

    /// Returns after how many motions the program stops for the `passed + 1`st time, and what it switches there.
    pub(super) fn stop(&self, passed: usize) -> Option<(u32, Switch)> {
        let stop = self.stops.get(passed)?;
        Some((stop.after, stop.then?))
    }
}

impl From<Vec<Motion>> for Program {
    fn from(motions: Vec<Motion>) -> Self {
        Self { motions, ..Self::default() }
    }
}
