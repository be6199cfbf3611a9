//! The command `run` of both nodes: its options, and what happens before and after a node runs on its bus.
//!
//! ```text
//! RunOptions::prepare    signals, capabilities, the setup with its plan, the interface; cell_run does this for a setup of
//!                        several stations
//!   the node's own       its bus, from first_cycle on
//! Prepared::supervise    the cyclic thread, the source of its instructions, its messages
//! exit_code              the process's exit code
//! ```

use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context as _;
use machine::{Duration, Instant};
use planning::{Found, Plan};
use protocol::direct::Direct;
use protocol_linux::{FormerAddress, Interface, StopSignals, capabilities, clock};
use setup::{Cyclic, Setup};

use crate::Outcome;
use crate::address_check::{AddressCheckError, check_address};
use crate::cell_run_error::CellRunError;
use crate::interface_option::{BusName, InterfaceOption, InterfaceOptionError};
use crate::message::{CellText, Hello, NodeHost, PROTOCOL};
use crate::role::NodeRole;
use crate::station_file::StationFile;
use crate::station_message::Console;
use crate::supervise::{OperatingMode, Supervised, supervise};
use crate::token::{ControlToken, TokenError};
use crate::{Commands, ControlError, ControlPort, Node, NodeProcess, errln, trace_file};

/// Time between the start of the program and its first cycle.
const LEAD: Duration = Duration::from_millis(5);

/// UDP port of the connection without a bus protocol.
const DIRECT_PORT: u16 = 34_900;

/// Parses the address of a control port.
fn control_address(text: &str) -> Result<SocketAddr, String> {
    text.parse().map_err(|_| {
        format!("`{text}` is not ADDRESS:PORT with an IP address of this host; for example 127.0.0.1:7700")
    })
}

/// Options of `run` for both nodes.
#[derive(clap::Args, Debug)]
pub struct RunOptions {
    /// A built-in setup's name, or the path of a .toml file.
    #[arg(long, value_name = "NAME|PATH", default_value = "A")]
    pub setup: String,
    /// An application in place of the setup's: a built-in one's name, or the path of a .toml file.
    #[arg(long, value_name = "NAME|FILE")]
    pub application: Option<String>,
    /// The network interface that the other node is on: its name, or the IPv4 address that it has.
    ///
    /// It gets the address that the setup wants there; a PROFINET device gets its own from the controller. Several buses
    /// share it, or each has one of its own: profinet=IF,ethernet-ip=IF,ethercat=IF. A robot in an EtherCAT line has two: IN,OUT,
    /// the first towards the PLC and the second to the next robot.
    #[arg(long, value_name = "IF|ADDRESS|BUS=IF,...|IN,OUT")]
    pub interface: InterfaceOption,
    /// Transport of PROFINET's cyclic frames, in place of the setup's; a device takes what the controller asks for.
    #[arg(long, value_name = "udp|rt1")]
    pub cyclic: Option<Cyclic>,
    /// Let a bench control this node over TCP: `bench --attach plc=HOST:PORT,robot=HOST:PORT`.
    ///
    /// Where other hosts reach the address, the node and the bench need one --control-token.
    #[arg(long, value_name = "ADDRESS:PORT", conflicts_with = "json", value_parser = control_address)]
    pub control: Option<SocketAddr>,
    /// The file whose first line is the token that a bench must show.
    ///
    /// Without it SKILLBENCH_CONTROL_TOKEN is the token, if that is set.
    #[arg(long, value_name = "FILE", requires = "control")]
    pub control_token: Option<PathBuf>,
    /// Take instructions from standard input and answer in JSON.
    #[arg(long, hide = true)]
    pub json: bool,
    /// Exchange images without a bus protocol, for tests that are not about a bus.
    #[arg(long, hide = true)]
    pub direct: bool,
    /// Record cycles into this file while instructed to; those of several stations into NAME-STATION.EXTENSION.
    #[arg(long, hide = true)]
    pub trace_file: Option<PathBuf>,
}

/// What a node needs to start on its bus.
#[derive(Debug)]
pub struct Prepared {
    /// The setup, checked.
    pub setup: Setup,
    /// The application that it runs.
    pub application: Found,
    /// That application's motions.
    pub plan: Plan,
    /// The interface of its bus, and on EtherCAT the one to the next SubDevice of the line, if it was given; they are up.
    pub interfaces: Vec<Interface>,
    /// Where it keeps the name and the address that its bus sets permanently; `None` if it cannot.
    pub station_file: Option<StationFile>,
    pub(crate) signals: StopSignals,
    pub(crate) former_addresses: Vec<FormerAddress>,
}

/// A node's interfaces, and what it says of itself.
#[derive(Debug)]
pub(crate) struct NodeStart {
    pub(crate) setup: String,
    pub(crate) cell: CellText,
    /// Names of the stations; empty where there is only one.
    pub(crate) stations: Vec<String>,
    pub(crate) interfaces: Vec<Interface>,
    pub(crate) station_file: Option<StationFile>,
    pub(crate) signals: StopSignals,
    pub(crate) former_addresses: Vec<FormerAddress>,
}

impl RunOptions {
    /// Prepares a node: signals, capabilities, setup, plan and interface. Call it while the process has one thread.
    ///
    /// # Errors
    ///
    /// A setup or an application does not exist or is wrong ([`setup::Error`], [`planning::Error`]), or the host does
    /// not allow something.
    pub fn prepare(&self) -> anyhow::Result<Prepared> {
        self.prepare_on(|bus| self.find_interfaces(&[bus]))
    }

    /// Prepares a node in the same way, on the interfaces that it has on its bus.
    pub(crate) fn prepare_on(
        &self,
        interfaces: impl FnOnce(BusName) -> anyhow::Result<Vec<Interface>>,
    ) -> anyhow::Result<Prepared> {
        let signals = self.prepare_process()?;
        let (mut setup, application) =
            planning::setup_and_application(&self.setup, self.application.as_deref())?;
        if let Some(cyclic) = self.cyclic {
            setup.bus.set_cyclic(cyclic);
        }
        setup::check(&setup)?;
        let plan = application.plan(&setup)?;
        let interfaces = interfaces(setup.bus.kind.name())?;
        let former_addresses = set_up(&interfaces)?;
        Ok(Prepared { setup, application, plan, interfaces, station_file: None, signals, former_addresses })
    }

    /// Checks the control port, takes over the signals and raises the capabilities. Threads inherit both.
    pub(crate) fn prepare_process(&self) -> anyhow::Result<StopSignals> {
        if let Some(address) = self.control {
            ControlPort::check(address, ControlToken::find(self.control_token.as_deref())?.as_ref())?;
        }
        let signals = StopSignals::block().context("taking over SIGINT and SIGTERM")?;
        capabilities::raise().context("making use of the program's capabilities")?;
        Ok(signals)
    }

    /// Finds the interface of the only bus, or on EtherCAT the two ports of a SubDevice.
    pub(crate) fn find_ports_of(&self, bus: BusName) -> anyhow::Result<Vec<Interface>> {
        let names = self.interface.ports_of(bus)?;
        let found: Vec<_> = names.into_iter().map(Interface::find).collect::<Result<_, _>>()?;
        match found.as_slice() {
            [inward, outward] if inward.index() == outward.index() => {
                Err(InterfaceOptionError::OnePort(inward.name().to_owned()).into())
            }
            _ => Ok(found),
        }
    }

    /// Finds the interface of each bus, in their order.
    pub(crate) fn find_interfaces(&self, buses: &[BusName]) -> anyhow::Result<Vec<Interface>> {
        let names = self.interface.for_buses(buses)?;
        Ok(names.into_iter().map(Interface::find).collect::<Result<_, _>>()?)
    }

    /// Returns whether the node takes instructions, over TCP or from standard input.
    #[must_use]
    pub const fn takes_instructions(&self) -> bool {
        self.control.is_some() || self.json
    }
}

impl Prepared {
    /// Returns the interface of a node with one bus: the first.
    #[must_use]
    pub fn interface(&self) -> &Interface {
        &self.interfaces[0]
    }

    /// Returns a connection to the other node without a bus protocol, in use from `start` on.
    ///
    /// # Errors
    ///
    /// The setup's bus has no IP addresses, or the interface has another one or gets none.
    pub fn direct(&self, own: NodeRole, start: Instant) -> anyhow::Result<Direct> {
        self.take_address(own)?;
        let addresses = self.setup.bus.addresses().context("--direct needs a bus with IP addresses")?;
        let peer = match own {
            NodeRole::Plc => addresses.robot,
            NodeRole::Robot => addresses.plc,
        };
        let cycle = Duration::from_micros(self.setup.bus.cycle_us.value.into());
        let bus = Direct::new(start, cycle, self.setup.bus.watchdog());
        Ok(bus.over_udp(DIRECT_PORT, SocketAddrV4::new(peer, DIRECT_PORT)))
    }

    /// Gives the interface the IP address that this node has in the setup, if the bus has any.
    ///
    /// # Errors
    ///
    /// Another station on the cable has that address; the interface has another one, which may be the user's own connection;
    /// or it gets none.
    pub fn take_address(&self, own: NodeRole) -> anyhow::Result<()> {
        let Some(addresses) = self.setup.bus.addresses() else { return Ok(()) };
        let (key, address) = match own {
            NodeRole::Plc => ("bus.plc_address", addresses.plc),
            NodeRole::Robot => ("bus.robot_address", addresses.robot),
        };
        take_address(self.interface(), key, address, addresses.mask)
    }

    /// Runs `node` until it is asked to end or `mode` ends it. `endpoint` is its role on the bus, for its first message.
    ///
    /// # Errors
    ///
    /// The control port cannot be opened, or the cyclic thread does not start.
    pub fn supervise<N: Node, C: OperatingMode<N>>(
        self,
        options: &RunOptions,
        role: NodeRole,
        endpoint: &str,
        node: N,
        mode: &mut C,
    ) -> anyhow::Result<Outcome> {
        let Self { setup, application, interfaces, station_file, signals, former_addresses, .. } = self;
        let cell = CellText { setup: setup::setup_to_toml(&setup)?, application: application.text };
        let stations = Vec::new();
        let setup = setup.name;
        let start = NodeStart { setup, cell, stations, interfaces, station_file, signals, former_addresses };
        start.supervise(options, role, endpoint, node, mode)
    }
}

impl NodeStart {
    /// Starts the node and runs it until it is asked to end or `mode` ends it.
    pub(crate) fn supervise<N: Node, C: OperatingMode<N>>(
        self,
        options: &RunOptions,
        role: NodeRole,
        endpoint: &str,
        node: N,
        mode: &mut C,
    ) -> anyhow::Result<Outcome> {
        let Self { setup, cell, stations, interfaces, station_file, signals, former_addresses } = self;
        let listed =
            |what: fn(&Interface) -> String| interfaces.iter().map(what).collect::<Vec<_>>().join(", ");
        let hello = Hello {
            protocol: PROTOCOL,
            node: role,
            setup,
            bus: endpoint.to_owned(),
            interface: listed(|interface| interface.name().to_owned()),
            mac: listed(|interface| interface.mac().to_string()),
            warning: None,
            cell: Some(cell),
            host: Some(NodeHost::this()),
        };
        let (console, commands) = match options.control {
            Some(address) => {
                let token = ControlToken::find(options.control_token.as_deref())?;
                (Console::Text, Commands::Control(Box::new(ControlPort::listen(address, token)?)))
            }
            None if options.json => (Console::Json, Commands::Stdin),
            None => (Console::Text, Commands::None),
        };
        let traces = options.trace_file.as_deref().map(|path| trace_file::of_stations(path, &stations));
        let process = NodeProcess::start(node, interfaces, signals, commands, &traces.unwrap_or_default())?;
        let outcome = supervise(process, mode, Supervised { console, hello, stations, station_file });
        drop(former_addresses);
        Ok(outcome)
    }
}

/// Switches each interface on. Returns the addresses that they have, for the end of the node.
pub(crate) fn set_up(interfaces: &[Interface]) -> anyhow::Result<Vec<FormerAddress>> {
    interfaces.iter().try_for_each(Interface::set_up)?;
    Ok(interfaces.iter().map(FormerAddress::of).collect())
}

/// Gives an interface the IP address that a setup has for it under `key`.
///
/// # Errors
///
/// Another station on the cable has that address; the interface has another one, which may be the user's own connection; or
/// it gets none.
pub fn take_address(
    interface: &Interface,
    key: &'static str,
    address: Ipv4Addr,
    mask: Ipv4Addr,
) -> anyhow::Result<()> {
    if interface.address().is_none_or(|found| found == address) {
        match check_address(interface, address) {
            Ok(()) => {}
            Err(taken @ AddressCheckError::Taken(_)) => return Err(taken).context(key),
            // An address can be set where ARP cannot be read: EtherNet/IP needs no raw Ethernet.
            Err(error) => errln!("warning: it is unknown whether another station has {address}: {error}"),
        }
    }
    Ok(interface.take_address(key, address, mask)?)
}

/// Lets Ctrl-C and SIGTERM end the program with the exit code for them as long as there is nothing to end in order. Call it
/// first in `main`.
pub fn exit_on_stop() {
    protocol_linux::exit_on_stop(Outcome::Interrupted as u8);
}

/// Returns the time of the first cycle of a node that starts now.
#[must_use]
pub fn first_cycle() -> Instant {
    clock::now() + LEAD
}

/// Prints the error of a run, if it failed, and returns the process's exit code, as [`crate::exit_code`] does.
pub fn exit_code(
    outcome: anyhow::Result<Outcome>,
    is_usage: impl FnOnce(&anyhow::Error) -> bool,
) -> ExitCode {
    let is_of_options = |error: &anyhow::Error| {
        error.is::<TokenError>()
            || error.is::<InterfaceOptionError>()
            || error.is::<CellRunError>()
            || matches!(error.downcast_ref(), Some(ControlError::NoToken(_)))
    };
    crate::exit_code(outcome, |error| is_of_options(error) || is_usage(error))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_address_of_a_control_port_needs_its_port() {
        assert_eq!(control_address("127.0.0.1:7700"), Ok("127.0.0.1:7700".parse().unwrap()));
        for text in ["127.0.0.1", "localhost:7700", "7700", ""] {
            let error = control_address(text).unwrap_err();
            assert!(
                error.starts_with(&format!("`{text}` is not ADDRESS:PORT"))
                    && error.contains("127.0.0.1:7700")
            );
        }
    }
}
