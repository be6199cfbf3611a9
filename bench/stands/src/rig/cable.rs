//! A cable to the robot of a station, in a network of its own: a veth pair, or with faults two of them with an impaired cable
//! between them.

use std::io;
use std::path::PathBuf;

use capture_file::{CaptureFile, Retention};
use protocol_linux::impaired::{AtCut, ImpairedCable, Observer};
use protocol_linux::namespace::{NamespaceError, NetworkNamespace};
use protocol_linux::{Interface, InterfaceError, RecorderError, veth};
use virtual_time::{LinkCounters, Side};

use super::RigError;
use super::frames::FrameLog;
use records::faults::{self, Fault};

/// Name of the robot's interface towards the PLC.
pub(super) const ROBOT: &str = "robot0";

/// Name of its second interface, where another robot comes after it in an EtherCAT line.
pub(super) const ONWARD: &str = "onward0";

/// Names of the near ends of the cables to both nodes, in the network of the impaired cable.
const TO_PLC: &str = "to-plc";
const TO_ROBOT: &str = "to-robot";

/// The end of a cable that is not the robot's: the PLC's interface, a port of a switch, or the second port of the robot before it
/// in a line.
#[derive(Clone, Copy, Debug)]
pub(super) struct FarEnd<'a> {
    pub(super) network: &'a NetworkNamespace,
    pub(super) interface: &'a str,
}

/// Outputs of a cable with faults: only its middle knows which fault met which frame.
#[derive(Clone, Debug, Default)]
pub(super) struct Observed<'a> {
    /// Files of the captures at the far end and at the robot's, and how much is kept.
    pub(super) captures: [Option<(PathBuf, Retention)>; 2],
    /// Log that collects frames while it wants them.
    pub(super) frames: Option<&'a FrameLog>,
}

/// The cable.
#[derive(Debug)]
pub(super) struct Cable {
    robot: NetworkNamespace,
    middle: Option<ImpairedCable>,
    pub(super) faults: Vec<Fault>,
}

impl Cable {
    /// Lays a cable without faults from `far` to a new network, and switches both ends on: otherwise the first node would find
    /// a cable without a carrier.
    pub(super) fn lay(far: FarEnd<'_>) -> Result<Self, RigError> {
        let robot = NetworkNamespace::new()?;
        veth::connect(far.network, far.interface, &robot, ROBOT)?;
        switch_on(far.network, far.interface)??;
        switch_on(&robot, ROBOT)??;
        Ok(Self { robot, middle: None, faults: Vec::new() })
    }

    /// Lays a cable with faults likewise; the seed decides which frames they hit.
    pub(super) fn lay_impaired(
        far: FarEnd<'_>,
        faults: &[Fault],
        at_cut: AtCut,
        seed: u64,
        observed: Observed<'_>,
    ) -> Result<Self, RigError> {
        let (robot, middle) = (NetworkNamespace::new()?, NetworkNamespace::new()?);
        for (network, end, near_end) in [(far.network, far.interface, TO_PLC), (&robot, ROBOT, TO_ROBOT)] {
            veth::connect(network, end, &middle, near_end)?;
            switch_on(network, end)??;
            switch_on(&middle, near_end)??;
            network.run(|| Interface::open(end)?.fill_in_checksums())??;
        }
        let about = faults::about(faults);
        let Observed { captures: [of_far, of_robot], frames } = observed;
        let observer = |end, interface, capture: Option<(PathBuf, Retention)>| {
            let capture = capture.map(|(path, retention)| create(path, interface, &about, retention));
            let see = frames.map(|frames| Box::new(frames.at(end)) as _);
            Ok::<_, RecorderError>(Observer { capture: capture.transpose()?, see })
        };
        let observers = [observer(Side::A, far.interface, of_far)?, observer(Side::B, ROBOT, of_robot)?];
        let plan = faults::impairment_plan(faults, seed);
        let start = || {
            let (to_plc, to_robot) = (Interface::open(TO_PLC)?, Interface::open(TO_ROBOT)?);
            Ok::<_, RigError>(ImpairedCable::start([&to_plc, &to_robot], &plan, at_cut, observers)?)
        };
        let cable = middle.run(start)??;
        Ok(Self { robot, middle: Some(cable), faults: faults.to_vec() })
    }

    /// Takes the power of the robot: its ports lose their links.
    pub(super) fn power_off(&self) -> Result<(), RigError> {
        let switch_off = || {
            for name in [ROBOT, ONWARD] {
                // Only a robot with another one after it has the second.
                if let Ok(interface) = Interface::open(name) {
                    interface.set_down()?;
                }
            }
            Ok::<_, InterfaceError>(())
        };
        Ok(self.robot.run(switch_off)??)
    }

    /// Returns the robot's network.
    pub(super) const fn robot(&self) -> &NetworkNamespace {
        &self.robot
    }

    /// Returns whether the cable writes its own captures and the log.
    pub(super) const fn is_impaired(&self) -> bool {
        self.middle.is_some()
    }

    /// Starts the times of faults: the robot is ready.
    pub(super) fn set_ready(&self) {
        self.middle.iter().for_each(ImpairedCable::set_ready);
    }

    /// Notes in the captures that the node at this end is killed.
    pub(super) fn note_killed(&self, node: Side) {
        self.middle.iter().for_each(|middle| middle.note_killed(node));
    }

    /// Returns what the faults did so far; `None` without faults.
    pub(super) fn counters(&self) -> Option<[LinkCounters; 2]> {
        self.middle.as_ref().map(ImpairedCable::counters)
    }

    /// Pauses the captures, or continues them.
    pub(super) fn pause(&self, paused: bool) {
        self.middle.iter().for_each(|middle| middle.pause(paused));
    }

    /// Ends the middle, so that the last frame is in the files. Returns what the faults did.
    pub(super) fn end(&mut self, keeps: bool) -> Result<Option<[LinkCounters; 2]>, RecorderError> {
        let stopped = self.middle.take().map(|middle| middle.stop(keeps)).transpose()?;
        Ok(stopped.map(|stopped| stopped.counters))
    }
}

fn create(
    path: PathBuf,
    interface: &str,
    about: &str,
    retention: Retention,
) -> Result<CaptureFile, RecorderError> {
    let file: io::Result<CaptureFile> = CaptureFile::create(&path, interface, about, retention);
    file.map_err(|reason| RecorderError::File { path, reason })
}

/// Switches an interface on.
pub(super) fn switch_on(
    network: &NetworkNamespace,
    name: &str,
) -> Result<Result<(), InterfaceError>, NamespaceError> {
    network.run(|| Interface::open(name)?.set_up())
}
