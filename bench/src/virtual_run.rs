//! Both nodes in virtual time: the machines of a real run on a cable without time.
//!
//! The seed fixes everything that no setup says: what each node's clock shows at the start, how fast it runs within
//! `bus.clock_drift_ppm`, and where in its cycle each cyclic task starts.

use std::net::Ipv4Addr;
use std::time::Duration;

use anyhow::{Context, bail};
use planning::{Application, PROGRAM};
use plc_node::{ExecutionType, MotionList, MotionSource, PlcConfig, PlcEvent, PlcNode};
use protocol::direct::Direct;
use protocol::fieldbus::{Fieldbus, LinkEvent};
use protocol::image::{Digest, Motion};
use protocol::profinet::ethernet::Mac;
use protocol::virtual_time::{Clock, Event, Impairment, Pair, PairConfig, Side};
use protocol::{Instant, Lateness};
use rand_core::SeedableRng;
use rand_pcg::Pcg64Mcg;
use robot_node::{RobotConfig, RobotEvent, RobotNode};
use setup::{BusKind, Setup};

use crate::cli::Mode;
use crate::plan::{Plan, Step, below};
use crate::results::{Results, Status};
use crate::stand::{Health, Measured, Stand};
use crate::trace::{Recording, Trace};
use crate::watch::Watch;

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
}

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
        let motions = planning::plan(application, setup)?.wire_motions(setup);
        let source = MotionList::from(motions.clone());
        Self::with_motions(setup, Motions { source: Box::new(source), program: motions }, seed, bus)
    }

    /// The same for motions that were planned elsewhere.
    pub(crate) fn with_motions(
        setup: &Setup,
        motions: Motions,
        seed: u64,
        bus: VirtualBus,
    ) -> anyhow::Result<Self> {
        let mut phases = Phases::new(setup, seed);
        let mut cell = match bus {
            VirtualBus::Direct => {
                let (plc, robot) = (phases.direct(setup, Side::A), phases.direct(setup, Side::B));
                cell(setup, motions, &mut phases, plc, robot, None)?
            }
            VirtualBus::OfSetup => match setup.bus.kind {
                BusKind::Profinet => {
                    let start = phases.first(Side::A, setup.bus.cycle_us.value);
                    let plc = plc_node::bus::profinet_controller(setup, PLC_MAC, seed, start)?;
                    let start = phases.first(Side::B, setup.bus.cycle_us.value);
                    let robot = robot_node::bus::profinet_device(setup, ROBOT_MAC, None, start)?;
                    cell(setup, motions, &mut phases, plc, robot, None)?
                }
                BusKind::EthernetIp => {
                    let start = phases.first(Side::A, setup.bus.cycle_us.value);
                    let plc = plc_node::bus::ethernet_ip_scanner(setup, PLC_MAC, seed, start)?;
                    let robot = robot_node::bus::ethernet_ip_adapter(setup, ROBOT_MAC, seed);
                    let address = Some(setup.bus.robot_address);
                    cell(setup, motions, &mut phases, plc, robot, address)?
                }
                other => bail!("bus.kind {other:?} is not implemented yet; Setup A uses profinet"),
            },
        };
        cell.connect()?;
        Ok(Self { cell, trace: Trace::default() })
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

/// A whole run without progress, directory or interrupts.
///
/// # Errors
///
/// No connection comes about, or a repetition fails.
pub fn whole(setup: &Setup, application: &Application, plan: &Plan) -> anyhow::Result<Results> {
    let mut results = Results::new(setup, &application.name, Mode::Virtual, plan);
    let mut run = VirtualRun::start(setup, application, plan.seed, VirtualBus::OfSetup)?;
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

/// What the nodes are given to run.
pub(crate) struct Motions {
    /// What SM and CM send.
    pub(crate) source: Box<dyn MotionSource>,
    /// What RC runs, in the robot's program store.
    pub(crate) program: Vec<Motion>,
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
    motions: Motions,
    phases: &mut Phases,
    plc_bus: P,
    robot_bus: R,
    robot_address: Option<Ipv4Addr>,
) -> anyhow::Result<Box<dyn Cell>> {
    let plc_start = phases.first(Side::A, setup.plc.scan_cycle_us.value);
    let robot_start = phases.first(Side::B, setup.robot.cycle_us.value);
    let Motions { source, program } = motions;
    let plc_config = PlcConfig { motions: source, ..PlcConfig::from_setup(setup, Vec::new(), PROGRAM) };
    let plc = PlcNode::new(plc_config, plc_bus, plc_start);
    let robot_config = RobotConfig::from_setup(setup)?;
    let robot = RobotNode::new(robot_config, vec![(PROGRAM, program)], robot_bus, phases.seed, robot_start);
    let delay = Duration::from_micros(setup.bus.cable_delay_us.value.into());
    let config = PairConfig {
        seed: phases.seed,
        clocks: phases.clocks,
        links: [Impairment { delay, ..Impairment::default() }; 2],
        addresses: [Some(setup.bus.plc_address), robot_address],
    };
    Ok(Box::new(Pair::new(plc, robot, config)))
}

impl<P: Fieldbus, R: Fieldbus> Cell for Pair<PlcNode<P>, RobotNode<R>> {
    fn connect(&mut self) -> anyhow::Result<()> {
        let until = self.now() + CONNECT;
        while let Some(event) = next_plc_event(self, until) {
            match event {
                PlcEvent::Ready => return Ok(()),
                PlcEvent::Link(LinkEvent::Down(down)) => bail!("no connection to the robot: {down}"),
                _ => {}
            }
        }
        bail!("the robot was not ready within {} s of virtual time", CONNECT.as_secs())
    }

    fn execute(&mut self, step: Step, recording: Option<&mut Recording>) -> anyhow::Result<Measured> {
        let start = self.now() + step.pause;
        while next_plc_event(self, start).is_some() {}
        self.begin(step.execution_type)?;
        let until = self.now() + LONGEST_RUN;
        let mut watch = recording.map(Watch::new);
        while let Some(event) = match &mut watch {
            Some(watch) => watch.next_plc_event(self, until),
            None => next_plc_event(self, until),
        } {
            match event {
                PlcEvent::Finished(execution) => {
                    return Ok(Measured {
                        execution: Duration::from_nanos(execution.execution_time_ns),
                        robot_execution: Duration::from_nanos(execution.robot_execution_ns),
                        blends_suppressed: execution.blends_suppressed,
                    });
                }
                PlcEvent::Failed(failure) => return Err(failure.into()),
                PlcEvent::Link(_) | PlcEvent::Ready | PlcEvent::Started { .. } => {}
            }
        }
        bail!("the run did not end within {} s of virtual time", LONGEST_RUN.as_secs())
    }

    fn begin(&mut self, execution_type: ExecutionType) -> anyhow::Result<()> {
        self.command_a(|plc, now| plc.start(now, execution_type)).context("cannot start the run")
    }

    fn next_plc_event(&mut self, until: Instant) -> Option<PlcEvent> {
        next_plc_event(self, until)
    }

    fn digests(&self) -> [Digest; 2] {
        [*self.a().sent(), *self.b().controller().accepted()]
    }

    fn health(&self) -> Health {
        let (plc, robot): (&Lateness, &Lateness) = (self.a().lateness(), self.b().lateness());
        Health {
            plc: plc.into(),
            robot: robot.into(),
            bus: self.a().bus().counters(),
            robot_bus: self.b().bus().counters(),
            connected_after: None,
            allocations: None,
        }
    }

    fn now(&self) -> Instant {
        Self::now(self)
    }
}

/// The PLC's next event, up to `until` of true time. What a station's owner does for it is done on the way.
pub(crate) fn next_plc_event<P: Fieldbus, R: Fieldbus>(
    pair: &mut Pair<PlcNode<P>, RobotNode<R>>,
    until: Instant,
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
