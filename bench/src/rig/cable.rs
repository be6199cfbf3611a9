//! The cable: two networks without a name, a veth pair between them, and whoever listens in.

use std::io;
use std::path::PathBuf;

use protocol_linux::capture::Keep;
use protocol_linux::namespace::{NamespaceError, NetworkNamespace};
use protocol_linux::{Interface, InterfaceError, Recorder, veth};

use super::RigError;
use crate::capture::{PLC_FILE, ROBOT_FILE};

/// Name of the PLC's interface, in a network where it is the only one.
pub(super) const PLC: &str = "plc0";
/// Name of the robot's interface.
pub(super) const ROBOT: &str = "robot0";

#[derive(Debug)]
pub(super) struct Cable {
    plc: NetworkNamespace,
    robot: NetworkNamespace,
    recorders: Vec<Recorder>,
    discarded: bool,
}

impl Cable {
    /// Lays it, switches both ends on and starts the capture.
    pub(super) fn lay(capture: Option<&(PathBuf, Keep)>) -> Result<Self, RigError> {
        let (plc, robot) = (NetworkNamespace::new()?, NetworkNamespace::new()?);
        veth::connect(&plc, PLC, &robot, ROBOT)?;
        // Both ends, since a node that is first would otherwise find a cable without a carrier.
        switch_on(&plc, PLC)??;
        switch_on(&robot, ROBOT)??;
        let mut recorders = Vec::new();
        if let Some((directory, keep)) = capture {
            for (network, interface, file) in [(&plc, PLC, PLC_FILE), (&robot, ROBOT, ROBOT_FILE)] {
                let path = directory.join(file);
                recorders.push(network.run(|| Recorder::start(interface, &path, "", *keep))??);
            }
        }
        Ok(Self { plc, robot, recorders, discarded: false })
    }

    pub(super) const fn plc(&self) -> &NetworkNamespace {
        &self.plc
    }

    pub(super) const fn robot(&self) -> &NetworkNamespace {
        &self.robot
    }

    pub(super) fn pause_capture(&self, paused: bool) -> io::Result<()> {
        self.recorders.iter().try_for_each(|recorder| recorder.pause(paused))
    }

    pub(super) const fn discard_capture(&mut self) {
        self.discarded = true;
    }

    /// Ends the capture, if there is one, so that the last frame is in the file.
    pub(super) fn end_capture(&mut self) -> Result<(), RigError> {
        let ended: Vec<_> = self
            .recorders
            .drain(..)
            .map(|recorder| if self.discarded { recorder.discard() } else { recorder.stop().map(drop) })
            .collect();
        Ok(ended.into_iter().collect::<Result<_, _>>()?)
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
