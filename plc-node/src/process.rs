//! The PLC node as a process: its command line, its messages, and the PLC on a real bus.
//!
//! By hand it runs a number of repetitions and prints them. With `--control` or `--json` it says what happens in one line
//! of JSON a message, and runs one repetition for each instruction that comes over TCP or on standard input. Of its other
//! commands `plc-node plan` needs no bus, and `plc-node discover` only asks who is on one.

use std::ffi::OsString;
use std::fmt;
use std::net::{SocketAddr, SocketAddrV4};
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context as _;
use clap::Parser;
use planning::PROGRAM;
use protocol::direct::Direct;
use protocol::fieldbus::{Counters, Fieldbus, LinkEvent};
use protocol::{Duration, Instant, Lateness};
use protocol_linux::message::{Console, Hello};
use protocol_linux::report::BusReport;
use protocol_linux::supervise::{Conductor, Next, Outcome, supervise};
use protocol_linux::{
    Commands, ControlPort, Interface, Node, NodeProcess, StopSignals, Udp, Wire, capabilities, clock,
};
use serde::{Deserialize, Serialize};
use setup::{BusKind, Cyclic, Setup};

use crate::discover::DiscoverCommand;
use crate::plan_command::PlanCommand;
use crate::{ExecutionType, PlcConfig, PlcEvent, PlcNode, Sample, StartError, bus};

/// Time that the program has to get going before its first scan.
const LEAD: Duration = Duration::from_millis(5);

/// UDP port of the cable without a protocol.
const DIRECT_PORT: u16 = 34_900;

/// The PLC of a setup on a real bus: connects to the robot and runs the application.
#[derive(Parser, Debug)]
#[command(name = "plc-node", version)]
struct Cli {
    #[command(subcommand)]
    command: Subcommand,
}

#[derive(clap::Subcommand, Debug)]
enum Subcommand {
    /// Connect to the robot and run the application.
    Run(Run),
    /// Plan an application and print its motions: labels, zones and why they have their size.
    Plan(PlanCommand),
    /// List the PROFINET and EtherNet/IP devices on a network interface.
    Discover(DiscoverCommand),
}

#[derive(clap::Args, Debug)]
struct Run {
    /// A built-in setup's name, or the path of a .toml file.
    #[arg(long, value_name = "NAME|PATH", default_value = "A")]
    setup: String,
    /// The network interface that the robot is on: its name, or the IPv4 address that it has.
    #[arg(long, value_name = "IF|ADDRESS")]
    interface: String,
    /// How PROFINET's cyclic frames travel, instead of what the setup says.
    #[arg(long, value_name = "udp|rt1")]
    cyclic: Option<Cyclic>,
    /// Repetitions of each execution type.
    #[arg(long, value_name = "N", default_value_t = 1, conflicts_with = "control", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    reps: u32,
    /// Execution types to run, interleaved in this order.
    #[arg(
        long,
        value_name = "TYPES",
        value_delimiter = ',',
        default_value = "rc,sm,cm",
        conflicts_with = "control"
    )]
    types: Vec<ExecutionType>,
    /// Let a bench control this node over TCP: `bench --attach plc=HOST:PORT`. There is no password, so give an
    /// address that only the bench reaches.
    #[arg(long, value_name = "ADDRESS:PORT", conflicts_with = "json")]
    control: Option<SocketAddr>,
    /// Take instructions from standard input and answer in JSON.
    #[arg(long, hide = true)]
    json: bool,
    /// Exchange images without a protocol, for tests that are not about a bus.
    #[arg(long, hide = true)]
    direct: bool,
    /// Record scans into this file, while instructions ask for it.
    #[arg(long, hide = true)]
    trace_file: Option<PathBuf>,
}

/// What only a PLC says.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PlcMessage {
    /// The robot is connected and ready: a run may start.
    Ready,
    /// The start edge of a run was set.
    Started {
        /// How the sequence is run.
        execution_type: ExecutionType,
        /// Start of the scan with the start edge, in ns of `CLOCK_MONOTONIC`.
        at_ns: u64,
    },
    /// The run ended as wanted.
    Finished(FinishedRun),
    /// The run ended otherwise, or was not started.
    Failed {
        /// How the sequence was to be run.
        execution_type: ExecutionType,
        /// Why not, in words.
        reason: String,
    },
}

/// A finished run: [`crate::Execution`].
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
pub struct FinishedRun {
    /// How the sequence was run.
    pub execution_type: ExecutionType,
    /// From the start edge to the end seen, on the PLC, in ns.
    pub execution_time_ns: u64,
    /// The robot's own measure, in ns.
    pub robot_execution_ns: u64,
    /// Motions that the robot counted as executed.
    pub motions: u32,
    /// Motions that were run to a stop because the next one was not there in time.
    pub blends_suppressed: u32,
    /// Scans from the one with the start edge to the one that saw the end.
    pub scans: u64,
    /// Frames of the bus during the run.
    pub frames: BusReport,
}

impl fmt::Display for PlcMessage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ready => f.write_str("robot ready"),
            Self::Started { execution_type, .. } => write!(f, "{execution_type} started"),
            Self::Finished(run) => {
                let ms = |ns: u64| ns as f64 / 1e6;
                let FinishedRun { execution_type, motions, blends_suppressed, frames, .. } = run;
                write!(
                    f,
                    "{execution_type} {:9.3} ms, by the robot's clock {:9.3} ms; {motions} motions, \
                     {blends_suppressed} blends suppressed, {} frames lost",
                    ms(run.execution_time_ns),
                    ms(run.robot_execution_ns),
                    frames.lost
                )
            }
            Self::Failed { execution_type, reason } => write!(f, "{execution_type} failed: {reason}"),
        }
    }
}

/// What only a PLC is told.
#[derive(Clone, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PlcInstruction {
    /// Run the sequence once.
    Start {
        /// How.
        execution_type: ExecutionType,
    },
    /// Give the run up.
    Abort,
}

/// The process: parses `args`, with the program's name first, and runs until it is done.
pub fn main(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    let cli = Cli::try_parse_from(args).unwrap_or_else(|error| error.exit());
    let outcome = match cli.command {
        Subcommand::Run(run) => run.execute(),
        Subcommand::Plan(plan) => plan.execute(),
        Subcommand::Discover(discover) => discover.execute(),
    };
    match outcome {
        Ok(outcome) => outcome.into(),
        Err(error) => {
            eprintln!("error: {error:#}");
            // What is wrong with a setup or an application is for the user to put right; all else is the host's.
            let usage =
                error.is::<setup::Error>() || error.is::<planning::Error>() || error.is::<bus::BusError>();
            if usage { Outcome::Usage } else { Outcome::EnvironmentUnusable }.into()
        }
    }
}

impl Run {
    fn execute(self) -> anyhow::Result<Outcome> {
        // Before any thread is there: threads inherit which signals are blocked, and the capabilities.
        let signals = StopSignals::block().context("taking over SIGINT and SIGTERM")?;
        capabilities::raise().context("making use of the program's capabilities")?;
        let (mut setup, application) = planning::setup_with_application(&self.setup)?;
        if let (Some(cyclic), Some(profinet)) = (self.cyclic, &mut setup.bus.profinet) {
            profinet.cyclic = cyclic;
        }
        setup::check(&setup)?;
        let plan = application.plan(&setup)?;
        let motions = plan.wire_motions(&setup);
        let interface = Interface::find(&self.interface)?;
        interface.set_up()?;
        // A PLC has its address from its project. Taking another one away could cut the user's own connection.
        interface.take_address("bus.plc_address", setup.bus.plc_address, setup.bus.subnet_mask)?;
        // On a real clock the scan takes what it takes.
        let config = PlcConfig {
            scan_cost: Duration::ZERO,
            stops: plan.stops(),
            ..PlcConfig::from_setup(&setup, motions, PROGRAM)
        };
        let start = clock::now() + LEAD;
        if self.direct {
            let wires = vec![Wire::udp(&interface, Udp { port: DIRECT_PORT })?];
            let cycle = micros(setup.bus.cycle_us.value);
            let bus = Direct::new(start, cycle, cycle * setup.bus.watchdog_cycles.value)
                .over_udp(DIRECT_PORT, SocketAddrV4::new(setup.bus.robot_address, DIRECT_PORT));
            let node = PlcNode::new(config, bus, start);
            return self.supervise(&setup, node, "images without a protocol", interface, wires, signals);
        }
        match setup.bus.kind {
            BusKind::Profinet => {
                let wires = Wire::profinet(&interface)?;
                // The clock makes every start of this PLC a new one to the robot.
                let bus = bus::profinet_controller(&setup, interface.mac(), start.as_nanos(), start)?;
                let node = PlcNode::new(config, bus, start);
                self.supervise(&setup, node, "PROFINET IO-Controller", interface, wires, signals)
            }
            BusKind::EthernetIp => {
                let wires = Wire::ethernet_ip(&interface)?;
                let bus = bus::ethernet_ip_scanner(&setup, interface.mac(), start.as_nanos(), start)?;
                let node = PlcNode::new(config, bus, start);
                self.supervise(&setup, node, "EtherNet/IP scanner", interface, wires, signals)
            }
            other => anyhow::bail!("bus.kind {other:?} does not run over a real network yet; Setup A does"),
        }
    }

    fn supervise<B: Fieldbus + Send + fmt::Debug + 'static>(
        &self,
        setup: &Setup,
        node: PlcNode<B>,
        bus: &str,
        interface: Interface,
        wires: Vec<Wire>,
        signals: StopSignals,
    ) -> anyhow::Result<Outcome> {
        let hello = Hello {
            node: "plc-node".to_owned(),
            setup: setup.name.clone(),
            bus: bus.to_owned(),
            interface: interface.name().to_owned(),
            mac: interface.mac().to_string(),
            warning: None,
        };
        let trace = self.trace_file.as_deref();
        let start = |commands| NodeProcess::start(node, interface, wires, signals, commands, trace);
        Ok(match self.control {
            Some(address) => {
                let commands = Commands::Control(ControlPort::listen(address)?);
                supervise(start(commands)?, &mut Told::default(), Console::Words, hello)
            }
            None if self.json => {
                supervise(start(Commands::Stdin)?, &mut Told::default(), Console::Json, hello)
            }
            None => {
                let mut alone = Alone::new(&self.types, self.reps);
                supervise(start(Commands::None)?, &mut alone, Console::Words, hello)
            }
        })
    }
}

fn micros(value: u32) -> Duration {
    Duration::from_micros(value.into())
}

/// What the owner of a PLC may want of it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum PlcOrder {
    /// Run the sequence once.
    Start(ExecutionType),
    /// Give the run up.
    Abort,
}

impl From<PlcInstruction> for PlcOrder {
    fn from(instruction: PlcInstruction) -> Self {
        match instruction {
            PlcInstruction::Start { execution_type } => Self::Start(execution_type),
            PlcInstruction::Abort => Self::Abort,
        }
    }
}

impl<B: Fieldbus + Send + fmt::Debug + 'static> Node for PlcNode<B> {
    type Order = PlcOrder;
    type Answer = (ExecutionType, StartError);
    type Sample = (Instant, Sample);

    fn link_event(event: &PlcEvent) -> Option<LinkEvent> {
        match event {
            PlcEvent::Link(event) => Some(*event),
            _ => None,
        }
    }

    fn order(&mut self, now: Instant, order: PlcOrder) -> Option<Self::Answer> {
        match order {
            PlcOrder::Start(execution_type) => {
                self.start(now, execution_type).err().map(|error| (execution_type, error))
            }
            PlcOrder::Abort => {
                self.abort(now);
                None
            }
        }
    }

    fn address_set(&mut self, now: Instant, done: bool) {
        self.bus_mut().address_set(now, done);
    }

    fn explain(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        self.bus().explain(words)
    }

    fn disconnect(&mut self, now: Instant) {
        Self::disconnect(self, now);
    }

    fn lateness(&self) -> &Lateness {
        Self::lateness(self)
    }

    fn counters(&self) -> Counters {
        self.bus().counters()
    }

    fn cycle_number(&self) -> u64 {
        Self::sample(self).scans
    }

    fn sample(&self, now: Instant) -> Self::Sample {
        (now, Self::sample(self))
    }

    fn write_sample((at, sample): &Self::Sample, line: &mut String) {
        use fmt::Write as _;
        let Sample { scans, number, total, written, queue_fill, .. } = sample;
        let _ = write!(line, "{},{scans},{number},{total},{written},{queue_fill}", at.as_nanos());
    }
}

fn message(event: &PlcEvent) -> Option<PlcMessage> {
    Some(match event {
        PlcEvent::Link(_) => return None,
        PlcEvent::Ready => PlcMessage::Ready,
        PlcEvent::Started { execution_type, at } => {
            PlcMessage::Started { execution_type: *execution_type, at_ns: at.as_nanos() }
        }
        PlcEvent::Finished(run) => PlcMessage::Finished(FinishedRun {
            execution_type: run.execution_type,
            execution_time_ns: run.execution_time_ns,
            robot_execution_ns: run.robot_execution_ns,
            motions: run.motions,
            blends_suppressed: run.blends_suppressed,
            scans: run.scans,
            frames: run.frames.into(),
        }),
        PlcEvent::Failed(failure) => {
            PlcMessage::Failed { execution_type: failure.execution_type, reason: failure.cause.to_string() }
        }
    })
}

fn refusal((execution_type, error): (ExecutionType, StartError)) -> PlcMessage {
    PlcMessage::Failed { execution_type, reason: error.to_string() }
}

/// Does what it is told.
#[derive(Default)]
struct Told {
    /// The robot was ready when it was last heard of: a controller that comes later missed that.
    ready: bool,
}

impl<B: Fieldbus + Send + fmt::Debug + 'static> Conductor<PlcNode<B>> for Told {
    type Message = PlcMessage;
    type Instruction = PlcInstruction;

    fn event(&mut self, event: PlcEvent) -> (Option<PlcMessage>, Next<PlcOrder>) {
        self.ready = matches!(event, PlcEvent::Ready | PlcEvent::Finished(_));
        (message(&event), Next::Wait)
    }

    fn link(&mut self, event: LinkEvent) -> Next<PlcOrder> {
        self.ready &= !matches!(event, LinkEvent::Down(_));
        Next::Wait
    }

    fn greeting(&self) -> Option<PlcMessage> {
        self.ready.then_some(PlcMessage::Ready)
    }

    fn deserted(&mut self) -> Next<PlcOrder> {
        Next::Order(PlcOrder::Abort)
    }

    fn answer(&mut self, answer: (ExecutionType, StartError)) -> (PlcMessage, Next<PlcOrder>) {
        self.ready &= !matches!(answer.1, StartError::NotConnected | StartError::NotReady { .. });
        (refusal(answer), Next::Wait)
    }

    fn instruction(&mut self, instruction: PlcInstruction) -> PlcOrder {
        instruction.into()
    }
}

/// Runs its repetitions and ends.
struct Alone {
    /// The runs to come, the next one last.
    runs: Vec<ExecutionType>,
}

impl Alone {
    fn new(types: &[ExecutionType], reps: u32) -> Self {
        let mut runs: Vec<_> = (0..reps).flat_map(|_| types.iter().copied()).collect();
        runs.reverse();
        Self { runs }
    }

    fn next(&mut self) -> Next<PlcOrder> {
        self.runs.pop().map_or(Next::End(Outcome::Done), |run| Next::Order(PlcOrder::Start(run)))
    }
}

impl<B: Fieldbus + Send + fmt::Debug + 'static> Conductor<PlcNode<B>> for Alone {
    type Message = PlcMessage;
    type Instruction = PlcInstruction;

    fn event(&mut self, event: PlcEvent) -> (Option<PlcMessage>, Next<PlcOrder>) {
        let next = match event {
            PlcEvent::Ready | PlcEvent::Finished(_) => self.next(),
            PlcEvent::Failed(_) => Next::End(Outcome::RunFailed),
            PlcEvent::Link(_) | PlcEvent::Started { .. } => Next::Wait,
        };
        (message(&event), next)
    }

    fn answer(&mut self, answer: (ExecutionType, StartError)) -> (PlcMessage, Next<PlcOrder>) {
        (refusal(answer), Next::End(Outcome::RunFailed))
    }

    fn instruction(&mut self, instruction: PlcInstruction) -> PlcOrder {
        instruction.into()
    }
}
