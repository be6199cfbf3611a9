//! The robot node as a process: its command line, its messages, and the robot on a real bus.
//!
//! It waits for a PLC and does what that one says, until it is ended. With `--control` or `--json` it says what happens in
//! one line of JSON a message.

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
use protocol_linux::supervise::{Conductor, Next, Outcome, supervise};
use protocol_linux::{
    Commands, ControlPort, Interface, Node, NodeProcess, StopSignals, Udp, Wire, capabilities, clock,
};
use serde::{Deserialize, Serialize};
use setup::{BusKind, Cyclic, Setup};

use crate::controller::Ending;
use crate::{ConfigError, Program, Quality, RobotConfig, RobotEvent, RobotNode, Sample, bus};

/// Time that the program has to get going before the robot's first cycle.
const LEAD: Duration = Duration::from_millis(5);

/// UDP port of the cable without a protocol.
const DIRECT_PORT: u16 = 34_900;

/// The robot of a setup on a real bus: waits for a PLC and executes its skills.
#[derive(Parser, Debug)]
#[command(name = "robot-node", version)]
struct Cli {
    #[command(subcommand)]
    command: Subcommand,
}

#[derive(clap::Subcommand, Debug)]
enum Subcommand {
    /// Wait for a PLC and execute its skills.
    Run(Run),
}

#[derive(clap::Args, Debug)]
struct Run {
    /// A built-in setup's name, or the path of a .toml file.
    #[arg(long, value_name = "NAME|PATH", default_value = "A")]
    setup: String,
    /// The network interface that the PLC is on: its name, or the IPv4 address that it has. Over PROFINET the PLC gives it an IP address, in place of the one
    /// it has; otherwise it gets the setup's.
    #[arg(long, value_name = "IF|ADDRESS")]
    interface: String,
    /// How PROFINET's cyclic frames travel. A device takes what the controller asks for; this only checks the setup.
    #[arg(long, value_name = "udp|rt1", hide = true)]
    cyclic: Option<Cyclic>,
    /// Seed of the moments at which the interpreter notices a command.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Let a bench control this node over TCP: `bench --attach robot=HOST:PORT`. There is no password, so give an
    /// address that only the bench reaches.
    #[arg(long, value_name = "ADDRESS:PORT", conflicts_with = "json")]
    control: Option<SocketAddr>,
    /// Take instructions from standard input and answer in JSON.
    #[arg(long, hide = true)]
    json: bool,
    /// Exchange images without a protocol, for tests that are not about a bus.
    #[arg(long, hide = true)]
    direct: bool,
    /// Record cycles into this file, while instructions ask for it.
    #[arg(long, hide = true)]
    trace_file: Option<PathBuf>,
}

/// What only a robot says.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RobotMessage {
    /// A skill ended as wanted.
    Executed {
        /// Its command number.
        number: u16,
        /// Motions that were executed.
        motions: u32,
        /// From the cycle that saw the command to the one that reports the end, in ns.
        execution_ns: u64,
        /// How well the arm moved meanwhile.
        quality: Quality,
    },
    /// A skill ended otherwise, or a command or a motion was refused.
    Trouble {
        /// The command's number.
        number: u16,
        /// Why, in words.
        reason: String,
    },
}

impl fmt::Display for RobotMessage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Executed { number, motions, execution_ns, quality } => {
                let (ms, stops) = (*execution_ns as f64 / 1e6, quality.stops());
                write!(f, "command {number}: {motions} motions in {ms:.3} ms, {stops} stops between them")
            }
            Self::Trouble { number, reason } => write!(f, "command {number}: {reason}"),
        }
    }
}

/// What only a robot is told: nothing.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
pub enum RobotInstruction {}

/// The process: parses `args`, with the program's name first, and runs until it is ended.
pub fn main(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    let cli = Cli::try_parse_from(args).unwrap_or_else(|error| error.exit());
    let Subcommand::Run(run) = cli.command;
    match run.execute() {
        Ok(outcome) => outcome.into(),
        Err(error) => {
            eprintln!("error: {error:#}");
            // What is wrong with a setup or an application is for the user to put right; all else is the host's.
            let usage = error.is::<setup::Error>()
                || error.is::<planning::Error>()
                || error.is::<bus::BusError>()
                || error.is::<ConfigError>();
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
        let program = Program::new(plan.wire_motions(&setup), &plan.stops());
        let interface = Interface::find(&self.interface)?;
        interface.set_up()?;
        let config = RobotConfig::from_setup(&setup)?.in_cell_of(&application.application);
        let programs = vec![(PROGRAM, program)];
        let start = clock::now() + LEAD;
        if self.direct {
            interface.set_address(setup.bus.robot_address, setup.bus.subnet_mask)?;
            let wires = vec![Wire::udp(&interface, Udp { port: DIRECT_PORT })?];
            let cycle = Duration::from_micros(setup.bus.cycle_us.value.into());
            let bus = Direct::new(start, cycle, cycle * setup.bus.watchdog_cycles.value)
                .over_udp(DIRECT_PORT, SocketAddrV4::new(setup.bus.plc_address, DIRECT_PORT));
            let node = RobotNode::new(config, programs, bus, self.seed, start);
            return self.supervise(&setup, node, "images without a protocol", interface, wires, signals);
        }
        match setup.bus.kind {
            BusKind::Profinet => {
                let wires = Wire::profinet(&interface)?;
                let bus = bus::profinet_device(&setup, interface.mac(), interface.address(), start)?;
                let node = RobotNode::new(config, programs, bus, self.seed, start);
                self.supervise(&setup, node, "PROFINET IO-Device", interface, wires, signals)
            }
            BusKind::EthernetIp => {
                // An adapter has its address from its project: there is no DCP that gives it one.
                interface.take_address(
                    "bus.robot_address",
                    setup.bus.robot_address,
                    setup.bus.subnet_mask,
                )?;
                let wires = Wire::ethernet_ip(&interface)?;
                let bus = bus::ethernet_ip_adapter(&setup, interface.mac(), start.as_nanos());
                let node = RobotNode::new(config, programs, bus, self.seed, start);
                self.supervise(&setup, node, "EtherNet/IP adapter", interface, wires, signals)
            }
            other => anyhow::bail!("bus.kind {other:?} does not run over a real network yet; Setup A does"),
        }
    }

    fn supervise<B: Fieldbus + Send + 'static>(
        &self,
        setup: &Setup,
        node: RobotNode<B>,
        bus: &str,
        interface: Interface,
        wires: Vec<Wire>,
        signals: StopSignals,
    ) -> anyhow::Result<Outcome> {
        let hello = Hello {
            node: "robot-node".to_owned(),
            setup: setup.name.clone(),
            bus: bus.to_owned(),
            interface: interface.name().to_owned(),
            mac: interface.mac().to_string(),
            warning: None,
        };
        let (console, commands) = match self.control {
            Some(address) => (Console::Words, Commands::Control(ControlPort::listen(address)?)),
            None if self.json => (Console::Json, Commands::Stdin),
            None => (Console::Words, Commands::None),
        };
        let trace = self.trace_file.as_deref();
        let process = NodeProcess::start(node, interface, wires, signals, commands, trace)?;
        Ok(supervise(process, &mut Served, console, hello))
    }
}

impl<B: Fieldbus + Send + 'static> Node for RobotNode<B> {
    type Order = RobotInstruction;
    type Answer = std::convert::Infallible;
    type Sample = Sample;

    fn link_event(event: &RobotEvent) -> Option<LinkEvent> {
        match event {
            RobotEvent::Link(event) => Some(*event),
            _ => None,
        }
    }

    fn order(&mut self, _now: Instant, order: RobotInstruction) -> Option<Self::Answer> {
        match order {}
    }

    fn address_set(&mut self, now: Instant, done: bool) {
        self.bus_mut().address_set(now, done);
    }

    fn disconnect(&mut self, now: Instant) {
        self.bus_mut().disconnect(now);
    }

    fn lateness(&self) -> &Lateness {
        Self::lateness(self)
    }

    fn counters(&self) -> Counters {
        self.bus().counters()
    }

    fn cycle_number(&self) -> u64 {
        Self::sample(self).at.as_nanos()
    }

    fn sample(&self, _now: Instant) -> Sample {
        Self::sample(self)
    }

    fn write_sample(sample: &Sample, line: &mut String) {
        use fmt::Write as _;
        let Sample { at, state, number, executed, accepted, queued, blends_suppressed, .. } = sample;
        let _ = write!(
            line,
            "{},{state:?},{number},{executed},{accepted},{queued},{blends_suppressed},{:.3}",
            at.as_nanos(),
            sample.path_speed_mm_s
        );
        for value in sample.pose.iter().chain(&sample.joints) {
            let _ = write!(line, ",{value:.4}");
        }
    }
}

/// Does what the PLC says, and tells what came of it.
struct Served;

impl<B: Fieldbus + Send + 'static> Conductor<RobotNode<B>> for Served {
    type Message = RobotMessage;
    type Instruction = RobotInstruction;

    fn event(&mut self, event: RobotEvent) -> (Option<RobotMessage>, Next<RobotInstruction>) {
        let message = match event {
            RobotEvent::SkillFinished {
                number, ending: Ending::Done, executed, execution, quality, ..
            } => {
                let execution_ns = u64::try_from(execution.as_nanos()).unwrap_or(u64::MAX);
                Some(RobotMessage::Executed { number, motions: executed, execution_ns, quality })
            }
            RobotEvent::SkillFinished { number, ending: Ending::Aborted, executed, .. } => {
                let reason = format!("given up after {executed} motions: the PLC halted it, or is gone");
                Some(RobotMessage::Trouble { number, reason })
            }
            RobotEvent::SkillFinished {
                number, ending: Ending::Fault { error, motion, finding }, ..
            } => {
                let reason = format!("motion {motion}, counted from 0: {}", finding.in_words(error));
                Some(RobotMessage::Trouble { number, reason })
            }
            RobotEvent::Refused { number, error, motion, cause } => {
                let reason = format!("refused, motion {motion}, counted from 0: {error}: {cause}");
                Some(RobotMessage::Trouble { number, reason })
            }
            RobotEvent::Link(_)
            | RobotEvent::State(_)
            | RobotEvent::SkillStarted { .. }
            | RobotEvent::BlendSuppressed { .. } => None,
        };
        (message, Next::Wait)
    }

    fn answer(&mut self, answer: std::convert::Infallible) -> (RobotMessage, Next<RobotInstruction>) {
        match answer {}
    }

    fn instruction(&mut self, instruction: RobotInstruction) -> RobotInstruction {
        instruction
    }
}
