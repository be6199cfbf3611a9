//! Both nodes in virtual time: the machines of a real run on a cable without time.
//!
//! The seed fixes everything that no setup says: what each node's clock shows at the start, how fast it runs within
//! `bus.clock_drift_ppm`, and where in its cycle each cyclic task starts.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::fmt;
use std::net::Ipv4Addr;
use std::path::PathBuf;
use std::rc::Rc;
use std::time::Duration;

use anyhow::{Context, bail};
use planning::{Application, PROGRAM, Stop};
use plc_node::{ExecutionType, MotionList, MotionSource, PlcConfig, PlcEvent, PlcNode};
use protocol::direct::Direct;
use protocol::fieldbus::{Fieldbus, LinkEvent};
use protocol::image::{Digest, Motion};
use protocol::profinet::ethernet::Mac;
use protocol::virtual_time::{Carrier, Clock, Event, Impairment, Pair, PairConfig, Side, Tapped};
use protocol::{Instant, Lateness};
use protocol_linux::capture::{Keep, Note};
use rand_core::SeedableRng;
use rand_pcg::Pcg64Mcg;
use robot_node::{Program, Quality, RobotConfig, RobotEvent, RobotNode};
use setup::{BusKind, Setup};

use crate::capture::{CableConfig, VirtualCapture};
use crate::cli::Mode;
use crate::faults::{self, Change, Fault, FaultReport};
use crate::plan::{Plan, Step, below};
use crate::results::{Results, Status};
use crate::stand::{Health, Measured, Stand};
use crate::trace::{Frame, Recording, Trace};
use crate::watch::{SharedFrames, Watch};

/// Locally administered addresses of the two stations.
const PLC_MAC: Mac = Mac([0x02, 0, 0, 0, 0, 1]);
const ROBOT_MAC: Mac = Mac([0x02, 0, 0, 0, 0, 2]);

/// Clocks show up to this at the start: two nodes are never switched on together.
const OFFSET: Duration = Duration::from_secs(1);

/// A connection that is not up by then never will be.
const CONNECT: Duration = Duration::from_secs(60);

/// A run that has not ended by then hangs; the PLC gives up a silent robot long before.
const LONGEST_RUN: Duration = Duration::from_secs(3_600);

/// The buses that a virtual run can run over.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum VirtualBus {
    /// The one that the setup names.
    OfSetup,
    /// A cable without a protocol, for tests that are not about a bus.
    Direct,
}

/// Two connected nodes in virtual time.
pub struct VirtualRun {
    cell: Box<dyn Cell>,
    trace: Trace,
    capture: Option<SharedCapture>,
}

/// What both nodes are to do, and the cell that the robot does it in.
pub(crate) struct Work {
    /// What SM and CM send.
    source: Box<dyn MotionSource>,
    /// What RC runs, in the robot's program store.
    program: Vec<Motion>,
    stops: Vec<Stop>,
    robot: RobotConfig,
}

impl Work {
    fn of(setup: &Setup, application: &Application) -> anyhow::Result<Self> {
        let work = Self::of_plan(setup, &planning::plan(application, setup)?)?;
        Ok(Self { robot: work.robot.in_cell_of(application), ..work })
    }

    /// A plan alone knows of no surfaces to press on.
    fn of_plan(setup: &Setup, plan: &planning::Plan) -> anyhow::Result<Self> {
        let program = plan.wire_motions(setup);
        let source = Box::new(MotionList::from(program.clone()));
        Ok(Self { program, stops: plan.stops(), ..Self::sent(setup, source)? })
    }

    /// Motions that the PLC sends, and none in the robot's program store.
    pub(crate) fn sent(setup: &Setup, source: Box<dyn MotionSource>) -> anyhow::Result<Self> {
        let robot = RobotConfig::from_setup(setup)?;
        Ok(Self { source, program: Vec::new(), stops: Vec::new(), robot })
    }
}

/// What a virtual run has besides its setup.
#[derive(Clone, Debug, Default)]
pub struct Extras {
    /// Faults of the cable and of the nodes.
    pub faults: Vec<Fault>,
    /// Where both ends are captured, and how much of it is kept.
    pub capture: Option<(PathBuf, Keep)>,
    /// Whether the frames of the recorded repetitions are kept, for a timeline.
    pub frames: bool,
}

/// What the faults and whoever listens in make of a pair.
struct Surroundings<'a> {
    faults: &'a [Fault],
    capture: Option<SharedCapture>,
    frames: Option<SharedFrames>,
}

/// The tap writes into it, the run says what happens to the cable, and ends it.
type SharedCapture = Rc<RefCell<Option<VirtualCapture>>>;

impl VirtualRun {
    /// Puts both nodes of a setup on a virtual cable and waits until the robot is ready.
    ///
    /// # Errors
    ///
    /// The setup does not describe a robot, or no connection comes about.
    pub fn start(
        setup: &Setup,
        application: &Application,
        seed: u64,
        bus: VirtualBus,
    ) -> anyhow::Result<Self> {
        Self::start_with(setup, application, seed, bus, &Extras::default())
    }

    /// The same with faults and captures.
    ///
    /// # Errors
    ///
    /// As [`VirtualRun::start`], or a capture cannot be made.
    pub fn start_with(
        setup: &Setup,
        application: &Application,
        seed: u64,
        bus: VirtualBus,
        extras: &Extras,
    ) -> anyhow::Result<Self> {
        Self::start_on(setup, Work::of(setup, application)?, seed, bus, extras)
    }

    /// The same for motions that were planned elsewhere.
    pub(crate) fn start_on(
        setup: &Setup,
        work: Work,
        seed: u64,
        bus: VirtualBus,
        extras: &Extras,
    ) -> anyhow::Result<Self> {
        let capture = extras.start_capture(setup)?;
        let frames = extras.frames.then(SharedFrames::default);
        let faults = &Surroundings { faults: &extras.faults, capture: capture.clone(), frames };
        let mut phases = Phases::new(setup, seed);
        let cell = match bus {
            VirtualBus::Direct => {
                let (plc, robot) = (phases.direct(setup, Side::A), phases.direct(setup, Side::B));
                cell(setup, work, &mut phases, plc, robot, None, faults)?
            }
            VirtualBus::OfSetup => match setup.bus.kind {
                BusKind::Profinet => {
                    let start = phases.first(Side::A, setup.bus.cycle_us.value);
                    let plc = plc_node::bus::profinet_controller(setup, PLC_MAC, seed, start)?;
                    let start = phases.first(Side::B, setup.bus.cycle_us.value);
                    let robot = robot_node::bus::profinet_device(setup, ROBOT_MAC, None, start)?;
                    cell(setup, work, &mut phases, plc, robot, None, faults)?
                }
                BusKind::EthernetIp => {
                    let start = phases.first(Side::A, setup.bus.cycle_us.value);
                    let plc = plc_node::bus::ethernet_ip_scanner(setup, PLC_MAC, seed, start)?;
                    let robot = robot_node::bus::ethernet_ip_adapter(setup, ROBOT_MAC, seed);
                    let address = Some(setup.bus.robot_address);
                    cell(setup, work, &mut phases, plc, robot, address, faults)?
                }
                other => bail!("bus.kind {other:?} is not implemented yet; Setup A uses profinet"),
            },
        };
        let mut run = Self { cell, trace: Trace::default(), capture };
        if let Err(error) = run.cell.connect() {
            // A run that failed is when the captures are wanted most.
            run.end_capture(true)?;
            return Err(error);
        }
        Ok(run)
    }

    /// Ends the captures, if there are any. Those that are kept in memory are written only where `wanted`.
    ///
    /// # Errors
    ///
    /// They could not be written.
    pub fn end_capture(&self, wanted: bool) -> anyhow::Result<()> {
        let capture = self.capture.as_ref().and_then(|capture| capture.borrow_mut().take());
        match capture.filter(|_| wanted) {
            Some(capture) => capture.finish().map_err(|(path, error)| {
                anyhow::Error::new(error).context(format!("cannot write the capture {}", path.display()))
            }),
            None => Ok(()),
        }
    }

    /// What happened in the first repetition of each type that was run so far.
    #[must_use]
    pub const fn trace(&self) -> &Trace {
        &self.trace
    }

    /// Sets the start edge of a run now; [`run_for`](Self::run_for) goes on with it.
    pub(crate) fn begin(&mut self, execution_type: ExecutionType) -> anyhow::Result<()> {
        self.cell.begin(execution_type)
    }

    /// Lets up to `time` of true time pass. What the PLC says first ends it early.
    pub(crate) fn run_for(&mut self, time: Duration) -> Option<PlcEvent> {
        self.cell.next_plc_event(self.cell.now() + time)
    }

    /// The motions that the PLC sent in this run, and those that the robot put on its path.
    pub(crate) fn digests(&self) -> [Digest; 2] {
        self.cell.digests()
    }

    /// True time since the nodes were switched on: what a plant would have taken.
    #[must_use]
    pub fn plant_time(&self) -> Duration {
        self.cell.now().since(Instant::ZERO)
    }
}

/// How much faster than the plant a virtual run was.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct PlantSpeed {
    /// What the plant would have taken.
    pub plant: Duration,
    /// What it took on this host.
    pub host: Duration,
}

impl fmt::Display for PlantSpeed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (plant, host) = (self.plant.as_secs_f64(), self.host.as_secs_f64());
        write!(f, "virtual: {plant:.1} s of the plant in {host:.2} s, {:.0} ×", plant / host)
    }
}

/// A whole run without progress, directory or interrupts.
///
/// # Errors
///
/// No connection comes about, or a repetition fails.
pub fn whole(setup: &Setup, application: &Application, plan: &Plan) -> anyhow::Result<Results> {
    run_whole(setup, &application.name, Work::of(setup, application)?, plan)
}

/// The same of an application that is planned already.
///
/// # Errors
///
/// As [`whole`].
pub fn whole_of(setup: &Setup, planned: &planning::Plan, plan: &Plan) -> anyhow::Result<Results> {
    run_whole(setup, &planned.name, Work::of_plan(setup, planned)?, plan)
}

fn run_whole(setup: &Setup, name: &str, work: Work, plan: &Plan) -> anyhow::Result<Results> {
    let mut results = Results::new(setup, name, Mode::Virtual, plan);
    let mut run = VirtualRun::start_on(setup, work, plan.seed, VirtualBus::OfSetup, &Extras::default())?;
    for step in plan.steps() {
        let measured = run.cell.execute(step, None)?;
        results.record(step.execution_type, &measured);
    }
    results.status = Status::Complete;
    results.set_health(&run.cell.health());
    Ok(results)
}

impl Stand for VirtualRun {
    async fn execute(&mut self, step: Step) -> anyhow::Result<Measured> {
        let is_first = step.repetition == 1;
        let recording =
            is_first.then(|| self.trace.types.entry(step.execution_type).insert(Recording::default()));
        self.cell.execute(step, recording)
    }

    fn health(&self) -> Health {
        self.cell.health()
    }
}

/// A pair of nodes on whichever bus.
trait Cell {
    fn connect(&mut self) -> anyhow::Result<()>;
    fn execute(&mut self, step: Step, recording: Option<&mut Recording>) -> anyhow::Result<Measured>;
    fn begin(&mut self, execution_type: ExecutionType) -> anyhow::Result<()>;
    fn next_plc_event(&mut self, until: Instant) -> Option<PlcEvent>;
    fn digests(&self) -> [Digest; 2];
    fn health(&self) -> Health;
    fn now(&self) -> Instant;
}

fn cell<P: Fieldbus + 'static, R: Fieldbus + 'static>(
    setup: &Setup,
    Work { source, program, stops, robot }: Work,
    phases: &mut Phases,
    plc_bus: P,
    robot_bus: R,
    robot_address: Option<Ipv4Addr>,
    Surroundings { faults, capture, frames }: &Surroundings<'_>,
) -> anyhow::Result<Box<dyn Cell>> {
    let plc_start = phases.first(Side::A, setup.plc.scan_cycle_us.value);
    let robot_start = phases.first(Side::B, setup.robot.cycle_us.value);
    let program = Program::new(program, &stops);
    let plc_config =
        PlcConfig { motions: source, stops, ..PlcConfig::from_setup(setup, Vec::new(), PROGRAM) };
    let plc = PlcNode::new(plc_config, plc_bus, plc_start);
    let robot = RobotNode::new(robot, vec![(PROGRAM, program)], robot_bus, phases.seed, robot_start);
    let delay = Duration::from_micros(setup.bus.cable_delay_us.value.into());
    let config = PairConfig {
        seed: phases.seed,
        clocks: phases.clocks,
        links: faults::links(faults, Impairment { delay, ..Impairment::default() }),
        addresses: [Some(setup.bus.plc_address), robot_address],
    };
    let mut pair = Pair::new(plc, robot, config);
    if capture.is_some() || frames.is_some() {
        let (capture, frames) = (capture.clone(), frames.clone());
        pair.set_tap(move |tapped| {
            if let Some(capture) = &capture
                && let Some(capture) = &mut *capture.borrow_mut()
            {
                capture.see(&tapped);
            }
            if let Some(frames) = &frames
                && let Some(frames) = &mut *frames.borrow_mut()
            {
                frames.push((tapped.at, frame(&tapped)));
            }
        });
    }
    Ok(Box::new(Nodes {
        pair,
        faults: faults.to_vec(),
        changes: faults::schedule(faults).into(),
        ready_at: None,
        capture: capture.clone(),
        frames: frames.clone(),
        quality: Quality::default(),
    }))
}

/// What a timeline shows of a frame; the time since the start edge is the watch's to say.
fn frame(tapped: &Tapped<'_>) -> Frame {
    Frame {
        at_us: 0.0,
        end: tapped.end,
        sent: tapped.end == tapped.from,
        carrier: match tapped.carrier {
            Carrier::Ethernet => "Ethernet",
            Carrier::Udp { .. } => "UDP",
            Carrier::Tcp { .. } => "TCP",
        },
        bytes: tapped.frame.len(),
        faulty: !tapped.fate.is_clean(),
    }
}

/// Both nodes on a cable, and what is going to happen to them.
pub(crate) struct Nodes<P: Fieldbus, R: Fieldbus> {
    pair: Pair<PlcNode<P>, RobotNode<R>>,
    faults: Vec<Fault>,
    /// Counted from `ready_at`.
    changes: VecDeque<(Duration, Change)>,
    ready_at: Option<Instant>,
    capture: Option<SharedCapture>,
    frames: Option<SharedFrames>,
    /// Of the present run, or of the last one.
    quality: Quality,
}

impl<P: Fieldbus, R: Fieldbus> Nodes<P, R> {
    pub(crate) const fn pair(&self) -> &Pair<PlcNode<P>, RobotNode<R>> {
        &self.pair
    }

    /// The PLC's next event, up to `until` of true time. What a station's owner does for it is done on the way, and
    /// so are the changes that faults make.
    pub(crate) fn next_event(&mut self, until: Instant) -> Option<PlcEvent> {
        loop {
            let next = self.ready_at.zip(self.changes.front()).map(|(ready, (after, _))| ready + *after);
            let change = next.filter(|at| *at <= until);
            if let Some(event) = next_plc_event(&mut self.pair, change.unwrap_or(until), &mut self.quality) {
                return Some(event);
            }
            change?;
            self.change();
        }
    }

    fn change(&mut self) {
        let Some((_, change)) = self.changes.pop_front() else { return };
        let lost =
            |pair: &Pair<_, _>| [Side::A, Side::B].map(|side| pair.link_counters(side).lost).iter().sum();
        let before: u64 = lost(&self.pair);
        match change {
            Change::Cut => self.pair.set_cut(true),
            Change::Mend => self.pair.set_cut(false),
            Change::Kill(side) => self.pair.kill(side),
        }
        let lost = lost(&self.pair) - before;
        let Some(capture) = &self.capture else { return };
        if let Some(capture) = &mut *capture.borrow_mut() {
            capture.note(match change {
                Change::Cut => Note::Cut { lost_under_way: lost },
                Change::Mend => Note::Mended,
                Change::Kill(side) => Note::Killed(side),
            });
        }
    }
}

impl Extras {
    fn start_capture(&self, setup: &Setup) -> anyhow::Result<Option<SharedCapture>> {
        let Some((directory, keep)) = &self.capture else { return Ok(None) };
        let delay = Duration::from_micros(setup.bus.cable_delay_us.value.into());
        let config = CableConfig { macs: [PLC_MAC, ROBOT_MAC], delay, about: faults::about(&self.faults) };
        let capture = VirtualCapture::create(directory, config, *keep)
            .with_context(|| format!("cannot make captures in {}", directory.display()))?;
        Ok(Some(Rc::new(RefCell::new(Some(capture)))))
    }
}

impl<P: Fieldbus, R: Fieldbus> Cell for Nodes<P, R> {
    fn connect(&mut self) -> anyhow::Result<()> {
        let until = self.pair.now() + CONNECT;
        while let Some(event) = self.next_plc_event(until) {
            match event {
                PlcEvent::Ready => {
                    self.ready_at = Some(self.pair.now());
                    return Ok(());
                }
                PlcEvent::Link(LinkEvent::Down(down)) => bail!("no connection to the robot: {down}"),
                _ => {}
            }
        }
        bail!("the robot was not ready within {} s of virtual time", CONNECT.as_secs())
    }

    fn execute(&mut self, step: Step, recording: Option<&mut Recording>) -> anyhow::Result<Measured> {
        let start = self.pair.now() + step.pause;
        while self.next_plc_event(start).is_some() {}
        self.begin(step.execution_type)?;
        let until = self.pair.now() + LONGEST_RUN;
        let mut watch = recording.map(|recording| Watch::new(recording, self.frames.clone()));
        while let Some(event) = match &mut watch {
            Some(watch) => watch.next_plc_event(self, until),
            None => self.next_plc_event(until),
        } {
            match event {
                PlcEvent::Finished(execution) => {
                    return Ok(Measured {
                        execution: Duration::from_nanos(execution.execution_time_ns),
                        robot_execution: Duration::from_nanos(execution.robot_execution_ns),
                        blends_suppressed: execution.blends_suppressed,
                        quality: Some(self.quality),
                    });
                }
                PlcEvent::Failed(failure) => return Err(failure.into()),
                PlcEvent::Link(_) | PlcEvent::Ready | PlcEvent::Started { .. } => {}
            }
        }
        bail!("the run did not end within {} s of virtual time", LONGEST_RUN.as_secs())
    }

    fn begin(&mut self, execution_type: ExecutionType) -> anyhow::Result<()> {
        self.quality = Quality::default();
        self.pair.command_a(|plc, now| plc.start(now, execution_type)).context("cannot start the run")
    }

    fn next_plc_event(&mut self, until: Instant) -> Option<PlcEvent> {
        self.next_event(until)
    }

    fn digests(&self) -> [Digest; 2] {
        [*self.pair.a().sent(), *self.pair.b().controller().accepted()]
    }

    fn health(&self) -> Health {
        let (plc, robot): (&Lateness, &Lateness) = (self.pair.a().lateness(), self.pair.b().lateness());
        Health {
            plc: plc.into(),
            robot: robot.into(),
            bus: self.pair.a().bus().counters(),
            robot_bus: self.pair.b().bus().counters(),
            connected_after: None,
            allocations: None,
            faults: (!self.faults.is_empty()).then(|| {
                FaultReport::new(&self.faults, [Side::A, Side::B].map(|side| self.pair.link_counters(side)))
            }),
        }
    }

    fn now(&self) -> Instant {
        self.pair.now()
    }
}

/// The PLC's next event, up to `until` of true time. What a station's owner does for it is done on the way, and what the
/// robot says of its motions is added to `quality`.
fn next_plc_event<P: Fieldbus, R: Fieldbus>(
    pair: &mut Pair<PlcNode<P>, RobotNode<R>>,
    until: Instant,
    quality: &mut Quality,
) -> Option<PlcEvent> {
    loop {
        match pair.next_event(until)? {
            Event::A(PlcEvent::Link(LinkEvent::SetAddress { address, .. })) => {
                pair.set_address(Side::A, Some(address));
                pair.command_a(|plc, now| plc.bus_mut().address_set(now, true));
            }
            Event::B(RobotEvent::Link(LinkEvent::SetAddress { address, .. })) => {
                pair.set_address(Side::B, Some(address));
                pair.command_b(|robot, now| robot.bus_mut().address_set(now, true));
            }
            Event::A(event) => return Some(event),
            Event::B(RobotEvent::SkillFinished { quality: of_skill, .. }) => {
                *quality = quality.then(of_skill);
            }
            Event::B(_) => {}
        }
    }
}

/// What the seed fixes.
struct Phases {
    seed: u64,
    random: Pcg64Mcg,
    clocks: [Clock; 2],
}

impl Phases {
    fn new(setup: &Setup, seed: u64) -> Self {
        let mut random = Pcg64Mcg::seed_from_u64(!seed);
        let drift = Duration::from_nanos(u64::from(setup.bus.clock_drift_ppm.value) * 1_000);
        let mut clock = || {
            let offset_ns = below(&mut random, OFFSET).as_nanos() as u64;
            let drift_ppb = below(&mut random, drift * 2).as_nanos() as i32 - drift.as_nanos() as i32;
            Clock { offset_ns, drift_ppb }
        };
        let clocks = [clock(), clock()];
        Self { seed, random, clocks }
    }

    /// When a task of this cycle runs first, on its side's own clock.
    fn first(&mut self, side: Side, cycle_us: u32) -> Instant {
        let [a, b] = self.clocks;
        let clock = if side == Side::A { a } else { b };
        let cycle = Duration::from_micros(cycle_us.into());
        clock.local_time(Instant::ZERO) + below(&mut self.random, cycle)
    }

    fn direct(&mut self, setup: &Setup, side: Side) -> Direct {
        let cycle = Duration::from_micros(setup.bus.cycle_us.value.into());
        Direct::new(
            self.first(side, setup.bus.cycle_us.value),
            cycle,
            cycle * setup.bus.watchdog_cycles.value,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_speed_is_told_in_seconds_of_the_plant_and_of_the_host_and_as_their_ratio() {
        let speed = PlantSpeed { plant: Duration::from_millis(348_400), host: Duration::from_millis(310) };
        assert_eq!(speed.to_string(), "virtual: 348.4 s of the plant in 0.31 s, 1124 ×");
    }
}
