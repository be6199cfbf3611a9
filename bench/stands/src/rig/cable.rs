//! The cable: two unnamed networks, a veth pair between them, and recorders. If faults are requested, there are two
//! veth pairs with an impaired cable between them.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Instant;

use capture_file::{CaptureFile, Retention};
use protocol_linux::impaired::{ImpairedCable, Observer};
use protocol_linux::namespace::{NamespaceError, NetworkNamespace};
use protocol_linux::{Interface, InterfaceError, Recorder, RecorderError, veth};
use virtual_time::{LinkCounters, Side};

use super::RigError;
use super::frames::FrameLog;
use crate::capture::{PLC_FILE, ROBOT_FILE};
use records::faults::{self, Fault, FaultReport};

/// Name of the PLC's interface, the only one in its network.
pub(super) const PLC: &str = "plc0";
/// Name of the robot's interface.
pub(super) const ROBOT: &str = "robot0";

/// Names of the near ends of the cables to both nodes, in the network of the impaired cable.
const TO_PLC: &str = "to-plc";
const TO_ROBOT: &str = "to-robot";

/// What a cable records and which faults it has.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct CableOptions<'a> {
    /// Directory for captures of both ends, from the first frame on, and how much is kept.
    pub(super) capture: Option<&'a (PathBuf, Retention)>,
    /// Faults to inject.
    pub(super) faults: &'a [Fault],
    /// Seed that decides which frames they hit.
    pub(super) seed: u64,
    /// Log that collects frames while [`Cable::watch`] is on.
    pub(super) frames: Option<&'a FrameLog>,
}

#[derive(Debug)]
pub(super) struct Cable {
    plc: NetworkNamespace,
    robot: NetworkNamespace,
    middle: Option<ImpairedCable>,
    faults: Vec<Fault>,
    recorders: Vec<Recorder>,
    frames: Option<FrameLog>,
    /// Recorders that feed the log.
    watchers: Vec<Recorder>,
    discarded: bool,
    /// When the robot was ready.
    ready: Option<Instant>,
}

impl Cable {
    /// Creates the cable, brings both ends up and starts the captures.
    pub(super) fn set_up(options: CableOptions<'_>) -> Result<Self, RigError> {
        let (plc, robot) = (NetworkNamespace::new()?, NetworkNamespace::new()?);
        let mut cable = Self {
            plc,
            robot,
            middle: None,
            faults: options.faults.to_vec(),
            recorders: Vec::new(),
            frames: options.frames.cloned(),
            watchers: Vec::new(),
            discarded: false,
            ready: None,
        };
        if options.faults.is_empty() {
            cable.set_up_clean(options)?;
        } else {
            cable.set_up_impaired(options)?;
        }
        Ok(cable)
    }

    fn set_up_clean(&mut self, CableOptions { capture, .. }: CableOptions<'_>) -> Result<(), RigError> {
        veth::connect(&self.plc, PLC, &self.robot, ROBOT)?;
        // Both ends, since otherwise the first node would find a cable without a carrier.
        switch_on(&self.plc, PLC)??;
        switch_on(&self.robot, ROBOT)??;
        if let Some((directory, retention)) = capture {
            for (network, interface, file) in [(&self.plc, PLC, PLC_FILE), (&self.robot, ROBOT, ROBOT_FILE)] {
                let path = directory.join(file);
                let start = || {
                    Ok::<_, RigError>(Recorder::start(&Interface::open(interface)?, &path, "", *retention)?)
                };
                self.recorders.push(network.run(start)??);
            }
        }
        Ok(())
    }

    /// Creates the cable with faults. It also writes the captures, since only its middle knows which fault met which
    /// frame.
    fn set_up_impaired(&mut self, options: CableOptions<'_>) -> Result<(), RigError> {
        let CableOptions { capture, faults, seed, frames } = options;
        let middle = NetworkNamespace::new()?;
        for (network, end, near_end) in [(&self.plc, PLC, TO_PLC), (&self.robot, ROBOT, TO_ROBOT)] {
            veth::connect(network, end, &middle, near_end)?;
            switch_on(network, end)??;
            switch_on(&middle, near_end)??;
            network.run(|| Interface::open(end)?.fill_in_checksums())??;
        }
        let about = faults::about(faults);
        let observer = |end, interface, file| {
            let capture = capture
                .map(|(directory, retention)| create(&directory.join(file), interface, &about, *retention));
            let see = frames.map(|frames| Box::new(frames.at(end)) as _);
            Ok::<_, RecorderError>(Observer { capture: capture.transpose()?, see })
        };
        let observers = [observer(Side::A, PLC, PLC_FILE)?, observer(Side::B, ROBOT, ROBOT_FILE)?];
        let plan = faults::impairment_plan(faults, seed);
        let start = || {
            let (to_plc, to_robot) = (Interface::open(TO_PLC)?, Interface::open(TO_ROBOT)?);
            Ok::<_, RigError>(ImpairedCable::start([&to_plc, &to_robot], &plan, observers)?)
        };
        self.middle = Some(middle.run(start)??);
        Ok(())
    }

    pub(super) const fn plc(&self) -> &NetworkNamespace {
        &self.plc
    }

    pub(super) const fn robot(&self) -> &NetworkNamespace {
        &self.robot
    }

    /// Starts the times of faults: the robot is ready.
    pub(super) fn set_ready(&mut self) {
        self.ready = Some(Instant::now());
        if let Some(middle) = &self.middle {
            middle.set_ready();
        }
    }

    /// Notes in both captures that a node is killed.
    pub(super) fn note_killed(&self, node: Side) {
        if let Some(middle) = &self.middle {
            middle.note_killed(node);
        }
    }

    /// Returns the result of the faults so far; `None` without faults.
    pub(super) fn fault_report(&self) -> Option<FaultReport> {
        self.middle.as_ref().map(|middle| self.report(middle.counters()))
    }

    fn report(&self, links: [LinkCounters; 2]) -> FaultReport {
        FaultReport::new(&self.faults, links, self.ready.map(|ready| ready.elapsed()))
    }

    pub(super) fn pause_capture(&self, paused: bool) -> io::Result<()> {
        if let Some(middle) = &self.middle {
            middle.pause(paused);
        }
        self.recorders.iter().try_for_each(|recorder| recorder.pause(paused))
    }

    /// Starts or stops feeding frames to the log. Without faults, recorders listen only while it is on.
    pub(super) fn watch(&mut self, on: bool) -> Result<(), RigError> {
        let Some(frames) = &self.frames else { return Ok(()) };
        if !on {
            // Frames up to now are recorded before the log stops collecting.
            let stopped = all(self.watchers.drain(..).map(|watcher| watcher.stop().map(drop)));
            frames.want(false);
            return Ok(stopped?);
        }
        frames.want(true);
        if self.middle.is_none() && self.watchers.is_empty() {
            for (network, interface, end) in [(&self.plc, PLC, Side::A), (&self.robot, ROBOT, Side::B)] {
                let see = frames.at(end);
                let start = || Ok::<_, RigError>(Recorder::watch(&Interface::open(interface)?, see)?);
                self.watchers.push(network.run(start)??);
            }
        }
        Ok(())
    }

    pub(super) const fn discard_capture(&mut self) {
        self.discarded = true;
    }

    /// Stops the recorders, so that the last frame is in the file. Returns the result of the faults so far.
    pub(super) fn end_capture(&mut self) -> Result<Option<FaultReport>, RigError> {
        let watched = self.watch(false);
        let end =
            |recorder: Recorder| if self.discarded { recorder.discard() } else { recorder.stop().map(drop) };
        let ended = all(self.recorders.drain(..).map(end));
        let middle = self.middle.take().map(|middle| middle.stop(!self.discarded)).transpose();
        watched?;
        let faults = middle?.map(|stopped| self.report(stopped.counters));
        ended?;
        Ok(faults)
    }
}

impl Drop for Cable {
    fn drop(&mut self) {
        // A run that failed is when the capture is wanted most.
        let _ = self.end_capture();
    }
}

/// Waits for all results and returns the first error.
fn all<E>(results: impl Iterator<Item = Result<(), E>>) -> Result<(), E> {
    results.fold(Ok(()), Result::and)
}

fn create(
    path: &Path,
    interface: &str,
    about: &str,
    retention: Retention,
) -> Result<CaptureFile, RecorderError> {
    CaptureFile::create(path, interface, about, retention)
        .map_err(|reason| RecorderError::File { path: path.to_owned(), reason })
}

fn switch_on(network: &NetworkNamespace, name: &str) -> Result<Result<(), InterfaceError>, NamespaceError> {
    network.run(|| Interface::open(name)?.set_up())
}
