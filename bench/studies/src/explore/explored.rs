//! The nodes that faults are put into, in virtual time: a robot that works alone, or a cell of several stations.

mod alone;
mod cell;

pub(super) use alone::LoneRobot;
pub(super) use cell::ExploredCell;

use super::fault::Extent;
use records::faults::Fault;
use records::schedule::Step;
use stands::virtual_run::NeverEnded;

/// Something that runs of one seed are made of.
pub(super) trait FaultTarget: Sync {
    /// Switches the nodes on, which do not know each other yet.
    fn switch_on<'r>(&'r self, seed: u64, faults: &'r [Fault]) -> anyhow::Result<Box<dyn ExploredRun + 'r>>;

    /// Returns whether the reason of a failed run says where it failed.
    fn is_located(&self, reason: &str) -> bool;
}

/// Runs of it one after the other, each of which is compared with the plan.
pub(super) trait ExploredRun {
    /// Waits until the nodes are connected and ready.
    fn connect(&mut self) -> anyhow::Result<()>;

    /// Executes a step of a schedule.
    fn execute(&mut self, step: Step) -> RunEnd;

    /// Waits until the nodes are ready again after a run that failed.
    fn recover(&mut self) -> anyhow::Result<()>;

    /// Returns what faults can be drawn from, for each station.
    fn extents(&self) -> Vec<Extent>;

    /// Returns the law of the cell that was broken so far, if any.
    fn broken_law(&self) -> Option<String>;

    /// Returns what was run, with the rehearsals that the runs so far were compared with.
    fn rehearsed(&self) -> Box<dyn FaultTarget>;
}

/// End of a run.
#[derive(Debug)]
pub(super) enum RunEnd {
    /// It passed, in this time in ns.
    Passed(u64),
    /// It passed, but a fault of a drive moved an arm off its path, and the verification says so.
    OffPath(anyhow::Error),
    /// It passed, and differs from the plan.
    Altered(anyhow::Error),
    /// It failed with this reason.
    Failed(anyhow::Error),
    /// It did not end.
    NeverEnded(anyhow::Error),
}

impl RunEnd {
    /// Takes a run that did not pass.
    pub(super) fn failed(reason: anyhow::Error) -> Self {
        if reason.is::<NeverEnded>() { Self::NeverEnded(reason) } else { Self::Failed(reason) }
    }

    /// Returns why it did not pass; `None` if it passed as planned.
    pub(super) fn into_error(self) -> Option<anyhow::Error> {
        match self {
            Self::Passed(_) => None,
            Self::OffPath(error) | Self::Altered(error) | Self::Failed(error) | Self::NeverEnded(error) => {
                Some(error)
            }
        }
    }
}
