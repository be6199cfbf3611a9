//! The command `run` of both nodes: its options, and what comes before and after a node on its bus.
//!
//! ```text
//! RunOptions::prepare    signals, capabilities, the setup with its plan, the interface
//!   the node's own       its bus, from first_cycle on
//! Prepared::supervise    the cyclic thread, whoever leads it, what is said of it
//! exit_code              what the process ends with
//! ```

use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context as _;
use machine::{Duration, Instant};
use planning::{Found, Plan};
use protocol::direct::Direct;
use protocol_linux::{Interface, StopSignals, capabilities, clock};
use setup::{BusKind, Cyclic, Setup};

use crate::message::{Console, Hello};
use crate::supervise::{Conductor, Outcome, supervise};
use crate::{Commands, ControlPort, Node, NodeProcess, errln};

/// Time that the program has to get going before its first cycle.
const LEAD: Duration = Duration::from_millis(5);

/// UDP port of the cable without a protocol.
const DIRECT_PORT: u16 = 34_900;

/// Options of `run` that both nodes have.
#[derive(clap::Args, Debug)]
pub struct RunOptions {
    /// A built-in setup's name, or the path of a .toml file.
    #[arg(long, value_name = "NAME|PATH", default_value = "A")]
    pub setup: String,
    /// The network interface that the other node is on: its name, or the IPv4 address that it has. It gets the address
    /// that the setup wants there; a PROFINET device gets its own from the controller.
    #[arg(long, value_name = "IF|ADDRESS")]
    pub interface: String,
    /// How PROFINET's cyclic frames travel, instead of what the setup says; a device takes what the controller asks for.
    #[arg(long, value_name = "udp|rt1")]
    pub cyclic: Option<Cyclic>,
    /// Let a bench control this node over TCP: `bench --attach plc=HOST:PORT,robot=HOST:PORT`. There is no password, so
    /// give an address that only the bench reaches.
    #[arg(long, value_name = "ADDRESS:PORT", conflicts_with = "json")]
    pub control: Option<SocketAddr>,
    /// Take instructions from standard input and answer in JSON.
    #[arg(long, hide = true)]
    pub json: bool,
    /// Exchange images without a protocol, for tests that are not about a bus.
    #[arg(long, hide = true)]
    pub direct: bool,
    /// Record cycles into this file, while instructions ask for it.
    #[arg(long, hide = true)]
    pub trace_file: Option<PathBuf>,
}

/// What a node needs before it can be on its bus.
#[derive(Debug)]
pub struct Prepared {
    /// The setup, checked.
    pub setup: Setup,
    /// The application that it runs.
    pub application: Found,
    /// That application's motions.
    pub plan: Plan,
    /// Where the other node is; up.
    pub interface: Interface,
    signals: StopSignals,
}

impl RunOptions {
    /// Makes everything ready. Call it before the process has a second thread.
    ///
    /// # Errors
    ///
    /// A setup or an application that is not there or is wrong ([`setup::Error`], [`planning::Error`]), or what the host
    /// does not allow.
    pub fn prepare(&self) -> anyhow::Result<Prepared> {
        // Threads inherit which signals are blocked, and the capabilities.
        let signals = StopSignals::block().context("taking over SIGINT and SIGTERM")?;
        capabilities::raise().context("making use of the program's capabilities")?;
        let (mut setup, application) = planning::setup_with_application(&self.setup)?;
        if let (Some(cyclic), Some(profinet)) = (self.cyclic, &mut setup.bus.profinet) {
            profinet.cyclic = cyclic;
        }
        setup::check(&setup)?;
        let plan = application.plan(&setup)?;
        let interface = Interface::find(&self.interface)?;
        interface.set_up()?;
        Ok(Prepared { setup, application, plan, interface, signals })
    }

    /// Whether somebody leads the node, over TCP or on its standard input.
    #[must_use]
    pub const fn is_led(&self) -> bool {
        self.control.is_some() || self.json
    }
}

impl Prepared {
    /// A cable without a protocol to `peer`, in use from `start` on.
    #[must_use]
    pub fn direct(&self, peer: Ipv4Addr, start: Instant) -> Direct {
        let cycle = Duration::from_micros(self.setup.bus.cycle_us.value.into());
        let bus = Direct::new(start, cycle, self.setup.bus.watchdog());
        bus.over_udp(DIRECT_PORT, SocketAddrV4::new(peer, DIRECT_PORT))
    }

    /// What a node says that has no endpoint for the setup's bus.
    #[must_use]
    pub fn no_endpoint(&self, bus: BusKind) -> anyhow::Error {
        anyhow::anyhow!(
            "setup {} wants bus.kind {bus:?}, which does not run over a real network yet; profinet and ethernet_ip do",
            self.setup.name
        )
    }

    /// Runs a node, which `endpoint` says what it is on its bus, until it is ended or `conductor` ends it.
    ///
    /// # Errors
    ///
    /// The control port cannot be opened, or the cyclic thread does not start.
    pub fn supervise<N: Node, C: Conductor<N>>(
        self,
        options: &RunOptions,
        name: &str,
        endpoint: &str,
        node: N,
        conductor: &mut C,
    ) -> anyhow::Result<Outcome> {
        let Self { setup, interface, signals, .. } = self;
        let hello = Hello {
            node: name.to_owned(),
            setup: setup.name,
            bus: endpoint.to_owned(),
            interface: interface.name().to_owned(),
            mac: interface.mac().to_string(),
            warning: None,
        };
        let (console, commands) = match options.control {
            Some(address) => (Console::ShortText, Commands::Control(ControlPort::listen(address)?)),
            None if options.json => (Console::Json, Commands::Stdin),
            None => (Console::ShortText, Commands::None),
        };
        let trace = options.trace_file.as_deref();
        let process = NodeProcess::start(node, interface, signals, commands, trace)?;
        Ok(supervise(process, conductor, console, hello))
    }
}

/// When a node's first cycle is that starts now.
#[must_use]
pub fn first_cycle() -> Instant {
    clock::now() + LEAD
}

/// What the process ends with, after it has said what went wrong. `is_usage` tells which errors of the node's own are the
/// user's to put right, as a setup's and an application's are; all others are the host's.
pub fn exit_code(
    outcome: anyhow::Result<Outcome>,
    is_usage: impl FnOnce(&anyhow::Error) -> bool,
) -> ExitCode {
    let outcome = outcome.unwrap_or_else(|error| {
        errln!("error: {error:#}");
        if error.is::<setup::Error>() || error.is::<planning::Error>() || is_usage(&error) {
            Outcome::Usage
        } else {
            Outcome::EnvironmentUnusable
        }
    });
    outcome.into()
}
