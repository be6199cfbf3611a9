//! The cable: two networks without a name, a veth pair between them, and whoever listens in.

use std::path::Path;

use protocol_linux::namespace::{NamespaceError, NetworkNamespace};
use protocol_linux::{Interface, InterfaceError, Recorder, veth};

use super::RigError;

/// Name of the PLC's interface, in a network where it is the only one.
pub(super) const PLC: &str = "plc0";
/// Name of the robot's interface.
pub(super) const ROBOT: &str = "robot0";

#[derive(Debug)]
pub(super) struct Cable {
    plc: NetworkNamespace,
    robot: NetworkNamespace,
    recorder: Option<Recorder>,
}

impl Cable {
    /// Lays it, switches both ends on and starts the capture.
    pub(super) fn lay(capture: Option<&Path>) -> Result<Self, RigError> {
        let (plc, robot) = (NetworkNamespace::new()?, NetworkNamespace::new()?);
        veth::connect(&plc, PLC, &robot, ROBOT)?;
        // Both ends, since a node that is first would otherwise find a cable without a carrier.
        switch_on(&plc, PLC)??;
        switch_on(&robot, ROBOT)??;
        let recorder = match capture {
            Some(path) => Some(plc.run(|| Recorder::start(PLC, path))??),
            None => None,
        };
        Ok(Self { plc, robot, recorder })
    }

    pub(super) const fn plc(&self) -> &NetworkNamespace {
        &self.plc
    }

    pub(super) const fn robot(&self) -> &NetworkNamespace {
        &self.robot
    }

    /// Ends the capture, if there is one, so that the last frame is in the file.
    pub(super) fn end_capture(&mut self) -> Result<(), RigError> {
        if let Some(recorder) = self.recorder.take() {
            recorder.stop()?;
        }
        Ok(())
    }
}

impl Drop for Cable {
    fn drop(&mut self) {
        // A run that failed is when the capture is wanted most.
        let _ = self.end_capture();
    }
}

fn switch_on(network: &NetworkNamespace, name: &str) -> Result<Result<(), InterfaceError>, NamespaceError> {
    network.run(|| Interface::open(name)?.set_up())
}
