//! The rig's network: the PLC in one namespace, each robot in another, cables between them, switches where several share an
//! interface of the PLC, and recorders.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Instant;

use capture_file::Retention;
use protocol_linux::impaired::AtCut;
use protocol_linux::namespace::NetworkNamespace;
use protocol_linux::{Interface, Recorder, bridge, veth};
use virtual_time::{LinkCounters, Side};

use super::RigError;
use super::cable::{Cable, FarEnd, ONWARD, Observed, ROBOT, switch_on};
use super::frames::FrameLog;
use super::layout::RigLayout;
use super::rig_node::RigNode;
use records::faults::{Fault, FaultReport};

/// Name of a switch, in a network of its own.
const SWITCH: &str = "switch";

/// Name of the port of a switch that the PLC is at.
const TO_PLC: &str = "to-plc";

/// Returns the name of an interface of the PLC.
pub(super) fn plc_interface(index: usize) -> String {
    format!("plc{index}")
}

/// Connections, captures and faults of a network.
#[derive(Clone, Copy, Debug)]
pub(super) struct NetworkOptions<'a> {
    /// The connections.
    pub(super) layout: &'a RigLayout,
    /// Directory for captures at all nodes, from the first frame on, and how much is kept.
    pub(super) capture: Option<&'a (PathBuf, Retention)>,
    /// Faults to inject.
    pub(super) faults: &'a [Fault],
    /// Seed that decides which frames they hit.
    pub(super) seed: u64,
    /// Log that collects the frames of a single cable while [`RigNetwork::watch`] is on.
    pub(super) frames: Option<&'a FrameLog>,
}

/// The network.
#[derive(Debug)]
pub(super) struct RigNetwork {
    layout: RigLayout,
    plc: NetworkNamespace,
    /// Networks of the switches, which exist as long as this.
    switches: Vec<NetworkNamespace>,
    /// The cable of each station.
    cables: Vec<Cable>,
    recorders: Vec<Recorder>,
    frames: Option<FrameLog>,
    /// Recorders that feed the log.
    watchers: Vec<Recorder>,
    discarded: bool,
    /// When the robots were ready.
    ready: Option<Instant>,
}

impl RigNetwork {
    /// Creates the network, brings all ends up and starts the captures.
    pub(super) fn set_up(options: NetworkOptions<'_>) -> Result<Self, RigError> {
        let mut network = Self {
            layout: options.layout.clone(),
            plc: NetworkNamespace::new()?,
            switches: Vec::new(),
            cables: Vec::new(),
            recorders: Vec::new(),
            frames: options.frames.cloned(),
            watchers: Vec::new(),
            discarded: false,
            ready: None,
        };
        let layout = options.layout;
        let mut cables: Vec<Option<Cable>> = (0..layout.robots()).map(|_| None).collect();
        for interface in 0..layout.interfaces() {
            let stations: Vec<_> = layout.stations_on(interface).collect();
            let laid = match stations.as_slice() {
                [station] => vec![network.connect(interface, *station, options)?],
                stations => network.connect_by_switch(interface, stations, options)?,
            };
            for (station, cable) in stations.into_iter().zip(laid) {
                network.connect_line((station, cable), &mut cables, options)?;
            }
        }
        network.cables = cables.into_iter().flatten().collect();
        Ok(network)
    }

    /// Connects a robot to an interface of the PLC by a cable.
    fn connect(
        &mut self,
        interface: usize,
        station: usize,
        options: NetworkOptions<'_>,
    ) -> Result<Cable, RigError> {
        let name = plc_interface(interface);
        let (cable, recorders) = lay(FarEnd { network: &self.plc, interface: &name }, station, options)?;
        self.recorders.extend(recorders);
        Ok(cable)
    }

    /// Takes the cable of a station, and lays those of the stations after it in a line.
    fn connect_line(
        &mut self,
        (mut station, mut cable): (usize, Cable),
        cables: &mut [Option<Cable>],
        options: NetworkOptions<'_>,
    ) -> Result<(), RigError> {
        while let Some(next) = options.layout.after(station) {
            let far = FarEnd { network: cable.robot(), interface: ONWARD };
            let (onward, recorders) = lay(far, next, options)?;
            self.recorders.extend(recorders);
            if let Some(place) = cables.get_mut(station) {
                *place = Some(std::mem::replace(&mut cable, onward));
            }
            station = next;
        }
        if let Some(place) = cables.get_mut(station) {
            *place = Some(cable);
        }
        Ok(())
    }

    /// Connects robots to an interface of the PLC by a switch.
    fn connect_by_switch(
        &mut self,
        interface: usize,
        stations: &[usize],
        options: NetworkOptions<'_>,
    ) -> Result<Vec<Cable>, RigError> {
        let name = plc_interface(interface);
        let switch = NetworkNamespace::new()?;
        switch.run(|| bridge::new(SWITCH))??;
        switch_on(&switch, SWITCH)??;
        veth::connect(&self.plc, &name, &switch, TO_PLC)?;
        switch_on(&self.plc, &name)??;
        let mut cables = Vec::with_capacity(stations.len());
        for station in stations {
            let port = format!("port{station}");
            let (cable, recorders) = lay(FarEnd { network: &switch, interface: &port }, *station, options)?;
            self.recorders.extend(recorders);
            add_port(&switch, &port)?;
            cables.push(cable);
        }
        if cables.iter().any(Cable::is_impaired) {
            // What the switch passes on to an impaired cable needs its checksums.
            self.plc.run(|| Interface::open(&name)?.fill_in_checksums())??;
        }
        switch_on(&switch, TO_PLC)??;
        add_port(&switch, TO_PLC)?;
        self.switches.push(switch);
        Ok(cables)
    }

    pub(super) const fn plc(&self) -> &NetworkNamespace {
        &self.plc
    }

    /// Returns the networks of the robots, in the order of their stations.
    pub(super) fn robots(&self) -> impl Iterator<Item = &NetworkNamespace> {
        self.cables.iter().map(Cable::robot)
    }

    /// Starts the times of faults: the robots are ready.
    pub(super) fn set_ready(&mut self) {
        self.ready = Some(Instant::now());
        self.cables.iter().for_each(Cable::set_ready);
    }

    /// Takes the power of a robot that has ended, if it passes frames on: the loops at its neighbours close.
    pub(super) fn power_off(&self, station: usize) {
        if let Some(cable) = self.cables.get(station).filter(|_| self.layout.has_chip(station)) {
            // Where that fails, its neighbours wait in vain for what comes back from it.
            let _ = cable.power_off();
        }
    }

    /// Notes in the captures that a node is killed.
    pub(super) fn note_killed(&self, node: RigNode) {
        match node {
            RigNode::Plc => self.cables.iter().for_each(|cable| cable.note_killed(Side::A)),
            RigNode::Robot(station) => {
                self.cables.get(station).into_iter().for_each(|cable| cable.note_killed(Side::B));
            }
        }
    }

    /// Returns the result of the faults of all cables so far; `None` without faults.
    pub(super) fn fault_report(&self) -> Option<FaultReport> {
        self.report(self.cables.iter().map(Cable::counters).collect())
    }

    fn report(&self, counters: Vec<Option<[LinkCounters; 2]>>) -> Option<FaultReport> {
        let since_ready = self.ready.map(|ready| ready.elapsed());
        let impaired = self.cables.iter().zip(counters).filter_map(|(cable, links)| Some((cable, links?)));
        let reports = impaired.map(|(cable, links)| FaultReport::new(&cable.faults, links, since_ready));
        reports.reduce(FaultReport::and)
    }

    pub(super) fn pause_capture(&self, paused: bool) -> io::Result<()> {
        self.cables.iter().for_each(|cable| cable.pause(paused));
        self.recorders.iter().try_for_each(|recorder| recorder.pause(paused))
    }

    /// Starts or stops feeding frames to the log. Without faults, recorders listen only while it is on.
    pub(super) fn watch(&mut self, on: bool) -> Result<(), RigError> {
        let (Some(frames), [cable]) = (&self.frames, self.cables.as_slice()) else { return Ok(()) };
        if !on {
            // Frames up to now are recorded before the log stops collecting.
            let stopped = all(self.watchers.drain(..).map(|watcher| watcher.stop().map(drop)));
            frames.want(false);
            return Ok(stopped?);
        }
        frames.want(true);
        if !cable.is_impaired() && self.watchers.is_empty() {
            let plc = plc_interface(0);
            let ends = [(&self.plc, plc.as_str(), Side::A), (cable.robot(), ROBOT, Side::B)];
            for (network, interface, end) in ends {
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
        let keeps = !self.discarded;
        let middles: Vec<_> = self.cables.iter_mut().map(|cable| cable.end(keeps)).collect();
        watched?;
        let counters = middles.into_iter().collect::<Result<Vec<_>, _>>()?;
        ended?;
        Ok(self.report(counters))
    }
}

impl Drop for RigNetwork {
    fn drop(&mut self) {
        // A run that failed is when the capture is wanted most.
        let _ = self.end_capture();
    }
}

/// Lays the cable of a station and records both of its ends; a cable with faults writes its own captures.
fn lay(
    far: FarEnd<'_>,
    station: usize,
    options: NetworkOptions<'_>,
) -> Result<(Cable, Vec<Recorder>), RigError> {
    let NetworkOptions { layout, capture, faults, seed, frames } = options;
    let faults = layout.faults_of(station, faults);
    let captures = layout
        .captures(station)
        .map(|name| capture.map(|(directory, retention)| (Path::join(directory, name), *retention)));
    if faults.is_empty() {
        let cable = Cable::lay(far)?;
        let ends = [(far.network, far.interface), (cable.robot(), ROBOT)];
        let recorders = ends.into_iter().zip(captures).filter_map(|(end, file)| Some(record(end, file?)));
        let recorders = recorders.collect::<Result<_, _>>()?;
        return Ok((cable, recorders));
    }
    let at_cut = if layout.has_chip(station) { AtCut::LosesCarrier } else { AtCut::KeepsCarrier };
    // Each cable draws numbers of its own; that of a single robot has those of the seed itself.
    let seed = seed.wrapping_add(station as u64);
    let cable = Cable::lay_impaired(far, &faults, at_cut, seed, Observed { captures, frames })?;
    Ok((cable, Vec::new()))
}

/// Starts a capture at an end of a cable.
fn record(
    (network, interface): (&NetworkNamespace, &str),
    (path, retention): (PathBuf, Retention),
) -> Result<Recorder, RigError> {
    network.run(|| Ok::<_, RigError>(Recorder::start(&Interface::open(interface)?, &path, "", retention)?))?
}

fn add_port(switch: &NetworkNamespace, port: &str) -> Result<(), RigError> {
    let add = || Ok::<_, RigError>(bridge::add_port(&Interface::open(SWITCH)?, &Interface::open(port)?)?);
    switch.run(add)?
}

/// Waits for all results and returns the first error.
fn all<E>(results: impl Iterator<Item = Result<(), E>>) -> Result<(), E> {
    results.fold(Ok(()), Result::and)
}
