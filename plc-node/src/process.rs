//! The PLC node as a process: its command line, its messages, and the PLC on a real bus.
//!
//! By hand it runs a number of repetitions and prints them. With `--control` or `--json` it says what happens in one line
//! of JSON a message, and runs one repetition for each instruction that comes over TCP or on standard input. Of its other
//! commands `plc-node plan` needs no bus, and `plc-node discover` only asks who is on one.

use std::ffi::OsString;
use std::fmt;
use std::process::ExitCode;

use clap::Parser;
use machine::{Duration, Instant, Lateness};
use node::Node;
use node::role::NodeRole;
use node::run::{Prepared, RunOptions};
use node::supervise::{Next, OperatingMode, Outcome};
use planning::PROGRAM;
use protocol::fieldbus::{Counters, Fieldbus, LinkEvent};
use serde::{Deserialize, Serialize};
use setup::BusKind;

use crate::discover::DiscoverCommand;
use crate::plan_command::PlanCommand;
use crate::{
    Execution, ExecutionType, Override, OverrideError, OverrideSchedule, PlcConfig, PlcEvent, PlcNode,
    Sample, StartError, bus,
};

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
    Run(Box<Run>),
    /// Plan an application and print its motions: labels, zones and why they have their size.
    Plan(PlanCommand),
    /// List the PROFINET and EtherNet/IP devices on a network interface.
    Discover(DiscoverCommand),
}

#[derive(clap::Args, Debug)]
struct Run {
    #[command(flatten)]
    options: RunOptions,
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
    /// Override in % of every programmed speed, 0 to 100, and when after the start of each repetition it changes: 50,
    /// 50@2s or 80,0@2s,100@3s. At 0 the arm stops on its path.
    #[arg(long = "override", value_name = "PERCENT[@TIME],...", conflicts_with = "control")]
    overrides: Option<OverrideSchedule>,
}

/// What only a PLC says.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PlcMessage {
    /// The arm does not stand where a run starts and is moved there.
    MovingToStart,
    /// The robot is connected and ready, and the arm where a run starts: a run may start.
    Ready,
    /// The start edge of a run was set.
    Started {
        /// How the sequence is run.
        execution_type: ExecutionType,
        /// Start of the scan with the start edge, in ns of `CLOCK_MONOTONIC`.
        at_ns: u64,
    },
    /// The run ended as wanted.
    Finished(Execution),
    /// The run ended otherwise, or was not started.
    Failed {
        /// How the sequence was to be run.
        execution_type: ExecutionType,
        /// Why not, in words.
        reason: String,
    },
    /// An instruction was not followed; what runs goes on.
    Refused {
        /// Why not, in words.
        reason: String,
    },
}

impl fmt::Display for PlcMessage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::MovingToStart => f.write_str("moving the arm to the application's start"),
            Self::Ready => f.write_str("robot ready"),
            Self::Started { execution_type, .. } => write!(f, "{execution_type} started"),
            Self::Finished(run) => {
                let ms = |ns: u64| ns as f64 / 1e6;
                let Execution { execution_type, motions, blends_suppressed, frames, .. } = run;
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
            Self::Refused { reason } => write!(f, "refused: {reason}"),
        }
    }
}

/// What only a PLC is told.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PlcInstruction {
    /// Run the sequence once.
    Start {
        /// How.
        execution_type: ExecutionType,
        /// What becomes of the override meanwhile; without it the override stays as it is.
        #[serde(default, rename = "override", skip_serializing_if = "Option::is_none")]
        overrides: Option<OverrideSchedule>,
    },
    /// Set the override, in a run or between two.
    SetOverride {
        /// In percent of every programmed speed, 0 to 100; 0 stops the arm on its path.
        percent: f64,
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
    node::run::exit_code(outcome, |error| error.is::<bus::BusError>())
}

impl Run {
    fn execute(self) -> anyhow::Result<Outcome> {
        let prepared = self.options.prepare()?;
        let (setup, plan, interface) = (&prepared.setup, &prepared.plan, &prepared.interface);
        // A PLC has its address from its project. Taking another one away could cut the user's own connection.
        interface.take_address("bus.plc_address", setup.bus.plc_address, setup.bus.subnet_mask)?;
        // On a real clock the scan takes what it takes.
        let config = PlcConfig {
            scan_cost: Duration::ZERO,
            to_start: plan.wire_to_start(setup),
            stops: plan.stops(),
            ..PlcConfig::from_setup(setup, plan.wire_motions(setup), PROGRAM)
        };
        let start = node::run::first_cycle();
        // The clock makes every start of this PLC a new one to the robot.
        let nonce = start.as_nanos();
        if self.options.direct {
            let bus = prepared.direct(setup.bus.robot_address, start);
            let node = PlcNode::new(config, bus, start);
            return self.supervise(prepared, "images without a protocol", node);
        }
        match setup.bus.kind {
            BusKind::Profinet => {
                let bus = bus::profinet_controller(setup, interface.mac(), nonce, start)?;
                let node = PlcNode::new(config, bus, start);
                self.supervise(prepared, "PROFINET IO-Controller", node)
            }
            BusKind::EthernetIp => {
                let bus = bus::ethernet_ip_scanner(setup, interface.mac(), nonce, start)?;
                let node = PlcNode::new(config, bus, start);
                self.supervise(prepared, "EtherNet/IP scanner", node)
            }
            other => Err(prepared.no_endpoint(other)),
        }
    }

    fn supervise<B: Fieldbus + Send + fmt::Debug + 'static>(
        &self,
        prepared: Prepared,
        endpoint: &str,
        node: PlcNode<B>,
    ) -> anyhow::Result<Outcome> {
        if self.options.takes_instructions() {
            prepared.supervise(&self.options, NodeRole::Plc, endpoint, node, &mut OnInstruction::default())
        } else {
            let mut standalone = Standalone::new(&self.types, self.reps, self.overrides);
            prepared.supervise(&self.options, NodeRole::Plc, endpoint, node, &mut standalone)
        }
    }
}

/// What the owner of a PLC may want of it.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum PlcOrder {
    /// Run the sequence once, with this schedule of overrides.
    Start(ExecutionType, Option<OverrideSchedule>),
    /// Set the override, in percent.
    SetOverride(f64),
    /// Give the run up.
    Abort,
}

/// An order that a PLC does not follow.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum PlcRefusal {
    /// A run is not started.
    Start(ExecutionType, StartError),
    /// The override stays as it is.
    Override(OverrideError),
}

impl From<PlcInstruction> for PlcOrder {
    fn from(instruction: PlcInstruction) -> Self {
        match instruction {
            PlcInstruction::Start { execution_type, overrides } => Self::Start(execution_type, overrides),
            PlcInstruction::SetOverride { percent } => Self::SetOverride(percent),
            PlcInstruction::Abort => Self::Abort,
        }
    }
}

impl<B: Fieldbus + Send + fmt::Debug + 'static> Node for PlcNode<B> {
    type Order = PlcOrder;
    type Answer = PlcRefusal;
    type Sample = (Instant, Sample);

    fn link_event(event: &PlcEvent) -> Option<LinkEvent> {
        match event {
            PlcEvent::Link(event) => Some(*event),
            _ => None,
        }
    }

    fn order(&mut self, now: Instant, order: PlcOrder) -> Option<Self::Answer> {
        match order {
            PlcOrder::Start(execution_type, overrides) => {
                let started = self.start(now, execution_type);
                if started.is_ok() {
                    self.schedule_overrides(overrides);
                }
                started.err().map(|error| PlcRefusal::Start(execution_type, error))
            }
            PlcOrder::SetOverride(percent) => match Override::from_percent(percent) {
                Ok(to) => {
                    self.set_override(now, to);
                    None
                }
                Err(error) => Some(PlcRefusal::Override(error)),
            },
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
        PlcEvent::MovingToStart => PlcMessage::MovingToStart,
        PlcEvent::Ready => PlcMessage::Ready,
        PlcEvent::Started { execution_type, at } => {
            PlcMessage::Started { execution_type: *execution_type, at_ns: at.as_nanos() }
        }
        PlcEvent::Finished(run) => PlcMessage::Finished(*run),
        PlcEvent::Failed(failure) => {
            PlcMessage::Failed { execution_type: failure.execution_type, reason: failure.cause.to_string() }
        }
    })
}

fn refusal(refusal: PlcRefusal) -> PlcMessage {
    match refusal {
        PlcRefusal::Start(execution_type, error) => {
            PlcMessage::Failed { execution_type, reason: error.to_string() }
        }
        PlcRefusal::Override(error) => PlcMessage::Refused { reason: error.to_string() },
    }
}

/// Does what it is told.
#[derive(Default)]
struct OnInstruction {
    /// The robot was ready when it was last heard of: a controller that comes later missed that.
    ready: bool,
}

impl<B: Fieldbus + Send + fmt::Debug + 'static> OperatingMode<PlcNode<B>> for OnInstruction {
    type Message = PlcMessage;
    type Instruction = PlcInstruction;

    fn event(&mut self, event: PlcEvent) -> (Option<PlcMessage>, Next<PlcOrder>) {
        self.ready = matches!(event, PlcEvent::Ready);
        (message(&event), Next::Wait)
    }

    fn link(&mut self, event: LinkEvent) -> Next<PlcOrder> {
        self.ready &= !matches!(event, LinkEvent::Down(_));
        Next::Wait
    }

    fn greeting(&self) -> Option<PlcMessage> {
        self.ready.then_some(PlcMessage::Ready)
    }

    fn controller_left(&mut self) -> Next<PlcOrder> {
        Next::Order(PlcOrder::Abort)
    }

    fn answer(&mut self, answer: PlcRefusal) -> (PlcMessage, Next<PlcOrder>) {
        let is_unready =
            matches!(answer, PlcRefusal::Start(_, StartError::NotConnected | StartError::NotReady { .. }));
        self.ready &= !is_unready;
        (refusal(answer), Next::Wait)
    }

    fn instruction(&mut self, instruction: PlcInstruction) -> PlcOrder {
        instruction.into()
    }
}

/// Runs its repetitions and ends.
struct Standalone {
    /// The runs to come, the next one last.
    runs: Vec<ExecutionType>,
    overrides: Option<OverrideSchedule>,
}

impl Standalone {
    fn new(types: &[ExecutionType], reps: u32, overrides: Option<OverrideSchedule>) -> Self {
        let mut runs: Vec<_> = (0..reps).flat_map(|_| types.iter().copied()).collect();
        runs.reverse();
        Self { runs, overrides }
    }

    fn next(&mut self) -> Next<PlcOrder> {
        let start = |run| Next::Order(PlcOrder::Start(run, self.overrides));
        self.runs.pop().map_or(Next::End(Outcome::Done), start)
    }
}

impl<B: Fieldbus + Send + fmt::Debug + 'static> OperatingMode<PlcNode<B>> for Standalone {
    type Message = PlcMessage;
    type Instruction = PlcInstruction;

    fn event(&mut self, event: PlcEvent) -> (Option<PlcMessage>, Next<PlcOrder>) {
        let next = match event {
            PlcEvent::Ready => self.next(),
            PlcEvent::Failed(_) => Next::End(Outcome::RunFailed),
            PlcEvent::Link(_)
            | PlcEvent::MovingToStart
            | PlcEvent::Started { .. }
            | PlcEvent::Finished(_) => Next::Wait,
        };
        (message(&event), next)
    }

    fn answer(&mut self, answer: PlcRefusal) -> (PlcMessage, Next<PlcOrder>) {
        (refusal(answer), Next::End(Outcome::RunFailed))
    }

    fn instruction(&mut self, instruction: PlcInstruction) -> PlcOrder {
        instruction.into()
    }
}
