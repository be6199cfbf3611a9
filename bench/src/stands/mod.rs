//! What a measurement runs on, whichever the mode: something that executes a sequence and says how long it took.
//!
//! ```text
//! rig          two processes on a real network, or nodes that run already
//! virtual_run  both nodes in virtual time
//! capture      what passes a virtual cable, as the packets of a network
//! ```

pub mod capture;
pub mod rig;
pub mod virtual_run;

use std::path::Path;

use planning::Application;
use protocol_linux::capture::Keep;
use setup::Setup;

use crate::output::exit::Failure;
use crate::records::conditions::{Health, Measured};
use crate::records::faults::Fault;
use crate::records::schedule::Step;
use crate::records::trace::Trace;

/// A PLC and a robot, connected, on a real or on a virtual clock.
pub trait Stand: Sized {
    /// Connects both nodes and waits until the robot is ready.
    ///
    /// # Errors
    ///
    /// The setup describes no robot, this machine lacks what the stand needs, or no connection comes about.
    fn start(config: &StandConfig<'_>) -> impl Future<Output = Result<Self, Failure>>;

    /// What the host refused the threads that run the nodes, in words; none where no thread has to keep time.
    fn refused(&self) -> Option<Vec<String>> {
        None
    }

    /// Waits out the step's pause, runs the sequence once and says how it went. An error is a failed repetition.
    fn execute(&mut self, step: Step) -> impl Future<Output = anyhow::Result<Measured>>;

    /// How late the cycles ran and what went over the bus, since the start.
    fn health(&self) -> Health;

    /// Ends both nodes and the captures. Those that are in memory are written only where `keeps_capture`.
    fn finish(self, keeps_capture: bool) -> impl Future<Output = Finished>;
}

/// What a stand is made of.
#[derive(Clone, Copy, Debug)]
pub struct StandConfig<'a> {
    /// The cell.
    pub setup: &'a Setup,
    /// What the robot does in it.
    pub application: &'a Application,
    /// Seed of clocks, phases and faults.
    pub seed: u64,
    /// The run directory: nodes that are processes read the setup there, captures and traces go there.
    pub directory: &'a Path,
    /// How much of what passes both ends is captured; none where nothing is.
    pub capture: Option<Keep>,
    /// Whether the frames of the recorded repetitions are kept, for a timeline.
    pub frames: bool,
    /// Faults of the cable and of the nodes.
    pub faults: &'a [Fault],
    /// Nodes that run already.
    pub attach: Option<&'a rig::Attach>,
}

/// What is left of a stand.
#[derive(Debug)]
pub struct Finished {
    /// What both nodes did in the recorded repetitions; none where nobody recorded, an error where it cannot be read.
    pub trace: anyhow::Result<Option<Trace>>,
    /// The conditions up to the end; none where the last ones that the stand gave are final. An error where a node did
    /// not end in order.
    pub health: Result<Option<Health>, Failure>,
    /// Whether the captures were written.
    pub capture: anyhow::Result<()>,
    /// A sentence for whoever watches.
    pub remark: Option<String>,
}
