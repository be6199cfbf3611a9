//! The program store: the programs that the paper's RC runs.

use planning::{Stop, Switch};
use protocol::image::Motion;

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
