//! The program store: the programs that the paper's RC runs.

use planning::{PROGRAM, Plan, Stop, Switch};
use protocol::image::Motion;
use setup::Setup;

/// A program: motions, and switching of outputs between them.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Program {
    motions: Vec<Motion>,
    /// Stops with the output that each switches, in order.
    stops: Vec<Stop>,
}

/// Programs by number.
pub(super) type Programs = Vec<(u16, Program)>;

impl Program {
    /// Creates a program of these motions that stops at each stop that switches an output. At other stops the
    /// motion's own approximation distance applies.
    #[must_use]
    pub fn new(motions: Vec<Motion>, stops: &[Stop]) -> Self {
        let stops = stops.iter().filter(|stop| stop.then.is_some()).copied().collect();
        Self { motions, stops }
    }

    /// Returns the programs that a robot stores for RC, by number: the plan as one, [`PROGRAM`]. Where the arm waits for others, a
    /// program for each section between two waits, numbered from there on; the PLC then switches what a section's end has to
    /// switch.
    #[must_use]
    pub fn stored(plan: &Plan, setup: &Setup) -> Vec<(u16, Self)> {
        let (motions, stops) = (plan.wire_motions(setup), plan.stops());
        if plan.waits.is_empty() {
            return vec![(PROGRAM, Self::new(motions, &stops))];
        }
        let total = motions.len();
        let mut ends: Vec<_> =
            plan.waits.iter().map(|wait| wait.after).filter(|after| *after < total).collect();
        ends.push(total);
        ends.sort_unstable();
        ends.dedup();
        let starts = std::iter::once(0).chain(ends.iter().copied());
        let sections = starts.zip(ends.iter().copied()).filter(|(start, end)| start < end);
        let program = |(start, end): (usize, usize)| {
            let within = stops.iter().filter_map(|stop| {
                let after = usize::try_from(stop.after).ok()?;
                let in_section = u32::try_from(after.checked_sub(start)?).ok()?;
                (0 < in_section && after < end).then_some(Stop { after: in_section, ..*stop })
            });
            Self::new(motions[start..end].to_vec(), &within.collect::<Vec<_>>())
        };
        (PROGRAM..).zip(sections.map(program)).collect()
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
        Self { motions, stops: Vec::new() }
    }
}
