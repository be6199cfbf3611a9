//! Stands: what a measurement runs on in each mode. A stand executes a sequence and returns how long it took.
//!
//! ```text
//! rig          a process for each node on a real network, or nodes that already run (attach); on Linux, with the feature `real`
//! virtual_run  all nodes in virtual time
//! cell_stand   the same for a cell with several stations; cell_measured is what a run of it was
//! planned_cell the robot in its cell and the motions of an application; planned_path: what it drives alone
//! relative_pose how far two arms' tools are from where the plan has them to each other
//! verification compares each repetition with the plan; reaction_limits computes what the cycles alone take
//! capture      the frames of a virtual cable as packets of a network; frame_name names them by their protocol
//! ```

mod attach;
pub mod capture;
pub mod cell_measured;
pub mod cell_stand;
pub mod cell_verification;
mod frame_name;
pub mod planned_cell;
pub mod planned_path;
pub mod planned_station;
pub mod reaction_limits;
pub mod relative_pose;
#[cfg(all(feature = "real", target_os = "linux"))]
pub mod rig;
mod unreported;
pub mod verification;
pub mod virtual_run;

pub use attach::{Attach, AttachError};
pub use unreported::Unreported;

use std::path::Path;

use ::node::token::ControlToken;
use capture_file::Retention;
use planning::Application;
use plc_node::ExportedCode;
use setup::Setup;

use records::attached::Attached;
use records::conditions::{Health, Measured};
use records::exit::{Exit, Failure};
use records::faults::{self, Fault};
use records::feed::Feed;
use records::plant_speed::PlantSpeed;
use records::schedule::Step;
use records::trace::Trace;
use records::voice::Voice;

/// A connected PLC and robot, in real or virtual time.
pub trait Stand: Sized {
    /// Connects both nodes and waits until the robot is ready.
    ///
    /// # Errors
    ///
    /// The setup describes no robot, this computer lacks what the stand needs, or the connection cannot be
    /// established.
    fn start(config: &StandConfig<'_>) -> impl Future<Output = Result<Self, Failure>>;

    /// Returns what the host refused the threads that run the nodes; `None` if no thread has to keep time.
    fn refused(&self) -> Option<Vec<String>> {
        None
    }

    /// Returns the nodes that ran already; `None` for those that the stand started.
    fn attached(&self) -> Option<Attached> {
        None
    }

    /// Waits for the step's pause, runs the sequence once and returns its measurement. An error is a failed
    /// repetition.
    fn execute(&mut self, step: Step) -> impl Future<Output = anyhow::Result<Measured>>;

    /// Returns the lateness of the cycles and the bus counters since the start.
    fn health(&self) -> Health;

    /// Ends both nodes and the captures. Captures held in memory are written only if `keeps_capture`.
    fn finish(self, keeps_capture: bool) -> impl Future<Output = Finished>;
}

/// Configuration of a stand.
#[derive(Clone, Copy, Debug)]
pub struct StandConfig<'a> {
    /// The cell.
    pub setup: &'a Setup,
    /// The robot's task in the cell.
    pub application: &'a Application,
    /// The application's file, which running nodes must have too.
    pub application_text: &'a str,
    /// Seed of clocks, phases and faults.
    pub seed: u64,
    /// The run directory: node processes read the setup from it; captures and traces are written to it.
    pub directory: &'a Path,
    /// How much of a capture is kept; `None` for no captures.
    pub capture: Option<Retention>,
    /// Whether the frames of recorded repetitions are kept, for a timeline.
    pub frames: bool,
    /// Exported code in the place of the PLC's function blocks, and the directory that it was read from.
    pub code: Option<(&'a Path, &'a ExportedCode)>,
    /// Faults of the cable and of the nodes.
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

/// Returns the failure of a run whose own faults may have kept it from beginning.
fn under_faults(error: anyhow::Error, faults: &[Fault]) -> Failure {
    let asked = faults::listed(faults);
    Failure::new(Exit::RunFailed, error.context(format!("the run did not begin with its faults ({asked})")))
}

/// What a stand returns when it ends.
#[derive(Debug)]
pub struct Finished {
    /// What both nodes did in the recorded repetitions; `None` if nothing was recorded, an error if it cannot be
    /// read.
    pub trace: anyhow::Result<Option<Trace>>,
    /// The conditions up to the end; `None` if the last ones that the stand returned are final. An error if a node
    /// did not end in order.
    pub health: Result<Option<Health>, Failure>,
    /// Whether writing the captures succeeded.
    pub capture: anyhow::Result<()>,
    /// How much faster than the plant the run was, if its time was virtual.
    pub speed: Option<PlantSpeed>,
}
