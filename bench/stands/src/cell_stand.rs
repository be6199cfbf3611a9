//! The stand of a measurement of a cell with several stations: like a [`Stand`](crate::Stand), with all stations of a run.

use std::path::Path;

use ::node::token::ControlToken;
use capture_file::Retention;
use setup::Cell;

use crate::Attach;
use crate::cell_measured::{CellHealth, CellMeasured};
use crate::planned_station::PlannedStation;
use records::cell_results::CellAttached;
use records::exit::Failure;
use records::faults::Fault;
use records::feed::Feed;
use records::schedule::Step;
use records::trace::{CellTrace, Recording};
use records::voice::Voice;

/// A connected PLC and its robots, in real or virtual time.
pub trait CellStand: Sized {
    /// Connects all nodes and waits until the robots are ready.
    ///
    /// # Errors
    ///
    /// This computer lacks what the stand needs, or a connection cannot be established.
    fn start(config: &CellConfig<'_>) -> impl Future<Output = Result<Self, Failure>>;

    /// Returns what the host refused the threads that run the nodes; `None` if no thread has to keep time.
    fn refused(&self) -> Option<Vec<String>> {
        None
    }

    /// Returns the nodes that ran already; `None` for those that the stand started.
    fn attached(&self) -> Option<CellAttached> {
        None
    }

    /// Waits for the step's pause, runs all sequences once and returns what was measured. An error is a failed repetition.
    fn execute(&mut self, step: Step) -> impl Future<Output = anyhow::Result<CellMeasured>>;

    /// Returns the conditions since the start.
    fn health(&self) -> CellHealth;

    /// Returns the recording of each station in the last run, in the order of the setup; empty if nothing was recorded.
    fn recordings(&self) -> &[Recording] {
        &[]
    }

    /// Ends all nodes and the captures. Captures held in memory are written only if `keeps_capture`.
    fn finish(self, keeps_capture: bool) -> impl Future<Output = CellFinished>;
}

/// Returned by a stand when it ends.
#[derive(Debug)]
pub struct CellFinished {
    /// Traces that the nodes wrote of the first repetition of each type; `None` if the stand has returned its recordings, an error
    /// if they cannot be read.
    pub trace: anyhow::Result<Option<CellTrace>>,
    /// The conditions up to the end; `None` if the last ones that the stand returned are final. An error if a node did not end
    /// in order, or a capture could not be written.
    pub health: Result<Option<CellHealth>, Failure>,
}

/// Configuration of the stand of a cell.
#[derive(Clone, Copy, Debug)]
pub struct CellConfig<'a> {
    /// The cell.
    pub cell: &'a Cell,
    /// Its stations, planned.
    pub stations: &'a [PlannedStation],
    /// The text of each station's application, which running nodes must have too.
    pub texts: &'a [String],
    /// The texts of all applications, as the PLC has them.
    pub applications: &'a str,
    /// Seed of clocks, phases and faults.
    pub seed: u64,
    /// The run directory: node processes read the setup from it; captures are written to it.
    pub directory: &'a Path,
    /// Retained part of a capture; `None` for no captures.
    pub capture: Option<Retention>,
    /// Faults of the cables and of the nodes.
    pub faults: &'a [Fault],
    /// The live view.
    pub feed: Option<&'a Feed>,
    /// Prints what the nodes wait for.
    pub voice: Option<&'a Voice>,
    /// Nodes that already run.
    pub attach: Option<&'a Attach>,
    /// Token of the control ports of these nodes.
    pub token: Option<&'a ControlToken>,
}
