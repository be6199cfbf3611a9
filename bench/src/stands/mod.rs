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

use crate::records::conditions::{Health, Measured};
use crate::records::schedule::Step;

/// A PLC and a robot, connected, on a real or on a virtual clock.
pub trait Stand {
    /// Waits out the step's pause, runs the sequence once and says how it went. An error is a failed repetition.
    fn execute(&mut self, step: Step) -> impl Future<Output = anyhow::Result<Measured>>;

    /// How late the cycles ran and what went over the bus, since the start.
    fn health(&self) -> Health;
}
