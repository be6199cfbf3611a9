//! The robot node as a process: its command line, its messages, and the robot on a real bus.
//!
//! It waits for a PLC and executes its skills until it is ended. With `--control` or `--json` it prints its messages as
//! JSON, one per line.

mod in_line;

use std::convert::Infallible;
use std::ffi::OsString;
use std::fmt;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::{CommandFactory, Parser};
use machine::{Instant, InterfaceId, Lateness, LinkStatus};
use node::Outcome;
use node::address_check::{AddressCheckError, check_address};
use node::errln;
use node::role::NodeRole;
use node::run::{Prepared, RunOptions};
use node::station_file::{Address, Station, StationFile, StationFileError};
use node::supervise::{Next, OperatingMode};
use node::{Node, Waiting, arguments, screen};
use protocol::fieldbus::{Counters, Fieldbus, LinkEvent, ToStore};
use protocol::image::Checks;
use protocol_linux::OpenPort;
use serde::{Deserialize, Serialize};
use setup::BusKind;

use crate::controller::Ending;
use crate::emulate::{self, EmulateCommand};
use crate::export_command::{self, ExportCommand};
use crate::{
    Account, ConfigError, Disturbance, ImageFault, Program, Quality, RobotConfig, RobotEvent, RobotInLine,
    RobotNode, Sample, StartOutOfReach, WaitingFor, bus,
};

/// The robot of a setup on a real bus: waits for a PLC and executes its skills.
#[derive(Parser, Debug)]
#[command(name = "robot-node", version = node::version())]
struct Cli {
    #[command(subcommand)]
    command: Subcommand,
}

#[derive(clap::Subcommand, Debug)]
enum Subcommand {
    /// Wait for a PLC and execute its skills.
    Run(Run),
    /// Be the device of a GSDML, EDS or ESI file, for tests of a controller.
    Emulate(EmulateCommand),
    /// Export the second layer and the planned program as code for another robot.
    Export(ExportCommand),
}

#[derive(clap::Args, Debug)]
struct Run {
    #[command(flatten)]
    options: RunOptions,
    /// The station of the setup that this robot is, where the setup has several.
    #[arg(long, value_name = "NAME")]
    station: Option<String>,
    /// Seed of the moments at which the interpreter notices a command.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Where name, address and I&M1 to 4 that PROFINET sets permanently are kept, as a device keeps them in its memory. Without
    /// it, station-IF.json in the user's state directory, except for a node that a bench started.
    #[arg(long, value_name = "FILE")]
    station_file: Option<PathBuf>,
}

/// What only a robot says.
#[derive(Clone, PartialEq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(clippy::large_enum_variant, reason = "a message is sent as soon as it is made")]
pub enum RobotMessage {
    /// A skill ended as wanted.
    Executed {
        /// Its command number.
        number: u16,
        /// Motions that were executed.
        motions: u32,
        /// From the cycle that saw the command to the one that reports the end, in ns.
        execution_ns: u64,
        /// When its first motion began, in ns of `CLOCK_MONOTONIC`; `None` if the arm did not move, and from a node of an older
        /// version.
        #[serde(default)]
        began_ns: Option<u64>,
        /// How well the arm moved meanwhile.
        quality: Quality,
        /// What it did.
        account: Account,
    },
    /// Whether all images of the PLC have wrong checks; sent when this changes, and not when a connection ends.
    ImagesAltered(bool),
    /// Whether all images of the PLC are refused because of their life counters; sent when this changes, and not when a
    /// connection ends.
    ImagesOutdated(bool),
    /// The PLC's life counter has never moved on this connection.
    LifeStill,
    /// The drives do not follow the set-points any more: why, in words.
    DrivesFailed(String),
    /// A skill ended otherwise, or a command or a motion was refused.
    Trouble {
        /// The command's number.
        number: u16,
        /// Why, in words.
        reason: String,
    },
    /// An instruction was refused; everything goes on.
    Refused {
        /// Why not, in words.
        reason: String,
    },
}

impl fmt::Display for RobotMessage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Executed { number, motions, execution_ns, quality, .. } => {
                let (ms, stops) = (*execution_ns as f64 / 1e6, quality.stops());
                match motions {
                    1 => write!(f, "command {number}: 1 motion in {ms:.3} ms"),
                    _ => write!(f, "command {number}: {motions} motions in {ms:.3} ms, stops between them: {stops}"),
                }
            }
            Self::ImagesAltered(true) => f.write_str(
                "warning: every image of the PLC has a wrong check and is refused: bytes are altered on the way, or the PLC \
                 computes the check otherwise; 0 there means no check",
            ),
            Self::ImagesOutdated(true) => f.write_str(
                "warning: every image of the PLC is refused, its life counter runs backwards or too fast: frames are old, or \
                 `plc.scan_cycle_us` is not the PLC's scan",
            ),
            Self::LifeStill => f.write_str(
                "warning: the PLC's life counter does not move, so old images cannot be recognised: add 1 in each scan",
            ),
            Self::ImagesOutdated(false) | Self::ImagesAltered(false) => f.write_str("the PLC's images are accepted again"),
            Self::DrivesFailed(reason) => f.write_str(reason),
            Self::Trouble { number, reason } => write!(f, "command {number}: {reason}"),
            Self::Refused { reason } => write!(f, "refused: {reason}"),
        }
    }
}

/// What only a robot is told.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum RobotInstruction {
    /// Something happens to a drive. A robot without it does nothing.
    Disturb {
        /// Of which axis, from 1.
        axis: u8,
        /// What.
        disturbance: Disturbance,
    },
}

/// Returns the command line, for its completions and manual page.
#[must_use]
pub fn command_line() -> clap::Command {
    Cli::command()
}

/// Runs the process: parses `args`, with the program's name first, and runs until it is ended.
pub fn main(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    node::run::exit_on_stop();
    screen::fit_terminal();
    let cli: Cli = arguments::parse(args);
    let run = match cli.command {
        Subcommand::Run(run) => run,
        Subcommand::Emulate(emulate) => return node::exit_code(emulate.execute(), emulate::is_usage),
        Subcommand::Export(export) => return node::exit_code(export.execute(), export_command::is_usage),
    };
    let is_usage = |error: &anyhow::Error| {
        error.is::<ConfigError>() || error.is::<StartOutOfReach>() || error.is::<StationFileError>()
    };
    node::run::exit_code(run.execute(), is_usage)
}

impl Run {
    fn execute(self) -> anyhow::Result<Outcome> {
        let mut prepared = self.options.prepare_station(self.station.as_deref())?;
        let stored = self.find_station(&mut prepared)?;
        let (setup, plan, interface) = (&prepared.setup, &prepared.plan, prepared.interface());
        let to_start = plan.wire_to_start(setup);
        let config =
            RobotConfig::from_setup(setup)?.in_cell_of(&prepared.application.application, &to_start)?;
        let programs = Program::stored(plan, setup);
        let start = node::run::first_cycle();
        if self.options.direct {
            let bus = prepared.direct(NodeRole::Robot, start)?;
            let node = RobotNode::new(config, programs, bus, self.seed, start);
            return self.supervise(prepared, "images without a protocol", node);
        }
        if bus::address_from_project(&setup.bus.kind).is_some() {
            prepared.take_address(NodeRole::Robot)?;
        }
        let mut endpoint = bus::role(&setup.bus.kind).to_owned();
        if let (Some(file), Some(station)) = (&prepared.station_file, &stored)
            && (station.name.is_some() || station.address.is_some())
        {
            endpoint.push_str(&format!(", {station}: stored in {}", file.path().display()));
        }
        let (mac, address) = (interface.mac(), interface.address());
        let host = bus::Host { mac, address, gateway: interface.gateway() };
        let mut bus = bus::open_station(&setup.bus, host, stored, start.as_nanos(), || start);
        if let bus::RobotBus::EthernetIp(adapter) = &mut bus
            && OpenPort::open(interface, machine::arp::ETHERNET).is_err()
        {
            // EtherNet/IP runs without the privilege that ARP needs.
            adapter.stop_conflict_detection();
        }
        let bus = match (bus, prepared.interfaces.as_slice()) {
            (bus::RobotBus::Ethercat(sub_device), [_, onward]) => {
                endpoint.push_str(&format!(", on to the next one by {}", onward.name()));
                let node = RobotNode::new(config, programs, sub_device, self.seed, start);
                return self.supervise(prepared, &endpoint, RobotInLine::new(node));
            }
            (bus, _) => bus,
        };
        let node = RobotNode::new(config, programs, bus, self.seed, start);
        self.supervise(prepared, &endpoint, node)
    }

    /// Finds the file of the station, if its bus sets names and addresses permanently. Returns what it holds, and gives the
    /// interface the address that is stored.
    fn find_station(&self, prepared: &mut Prepared) -> anyhow::Result<Option<Station>> {
        let is_device = matches!(prepared.setup.bus.kind, BusKind::Profinet(..)) && !self.options.direct;
        let of_interface =
            || StationFile::of_interface(prepared.interface().name()).filter(|_| !self.options.json);
        let named = self.station_file.clone().map(StationFile::at);
        let Some(file) = named.or_else(of_interface).filter(|_| is_device) else { return Ok(None) };
        let station = match file.load() {
            // A user's own state directory may be closed to it, for instance where `HOME` is another user's.
            Err(error @ StationFileError::Read { .. }) if self.station_file.is_none() => {
                errln!("warning: {error}: nothing can be set permanently; name a file by --station-file");
                return Ok(None);
            }
            loaded => loaded?,
        };
        if let Some(Address { ip, mask, gateway }) = station.address {
            match check_address(prepared.interface(), ip) {
                // It starts without an address, and its controller learns of the conflict when it sets one.
                Err(taken @ AddressCheckError::Taken(_)) => errln!("warning: {taken}"),
                _ => {
                    prepared.interface().set_address(ip, mask)?;
                    prepared.interface().set_gateway(gateway)?;
                }
            }
        }
        prepared.station_file = Some(file);
        Ok(Some(station))
    }

    fn supervise<N: Node<Event = RobotEvent, Order = RobotInstruction, Answer = Infallible>>(
        &self,
        prepared: Prepared,
        endpoint: &str,
        node: N,
    ) -> anyhow::Result<Outcome> {
        prepared.supervise(&self.options, NodeRole::Robot, endpoint, node, &mut OnInstruction)
    }
}

impl<B: Fieldbus + Send + 'static> Node for RobotNode<B> {
    type Order = RobotInstruction;
    type Answer = Infallible;
    type Sample = Sample;

    fn link_event(event: &RobotEvent) -> Option<LinkEvent> {
        match event {
            RobotEvent::Link(event) => Some(*event),
            _ => None,
        }
    }

    fn waiting(event: &RobotEvent) -> Option<Waiting> {
        let RobotEvent::Waiting { for_what, seconds } = event else { return None };
        let for_what = for_what.to_string();
        Some(Waiting { seconds: *seconds, for_what, is_for_connection: false, is_owed: false })
    }

    fn order(&mut self, _now: Instant, order: RobotInstruction) -> Option<Self::Answer> {
        let RobotInstruction::Disturb { axis, disturbance } = order;
        self.disturb_drive(axis, disturbance);
        None
    }

    fn address_set(&mut self, now: Instant, _on: InterfaceId, done: bool) {
        self.bus_mut().address_set(now, done);
    }

    fn to_store(&self) -> ToStore<'_> {
        self.bus().to_store()
    }

    fn stored(&mut self, now: Instant, done: bool) {
        self.bus_mut().stored(now, done);
    }

    fn wants_link(&self) -> bool {
        self.bus().wants_link()
    }

    fn set_link(&mut self, status: &LinkStatus) {
        self.bus_mut().set_link(status);
    }

    fn explain(&self, _event: &RobotEvent, words: &mut dyn fmt::Write) -> fmt::Result {
        self.bus().explain(words)
    }

    /// An end of any cause: the bus knows whose connection it was.
    fn may_explain(event: &RobotEvent) -> bool {
        matches!(event, RobotEvent::Link(LinkEvent::Down(_)))
    }

    fn remark(&self, _event: &RobotEvent, words: &mut dyn fmt::Write) -> fmt::Result {
        self.bus().remark(words)
    }

    fn may_remark(event: &RobotEvent) -> bool {
        matches!(
            event,
            RobotEvent::Waiting { for_what: WaitingFor::Plc, .. } | RobotEvent::Link(LinkEvent::Foreign(_))
        )
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

    fn checks(&self) -> Checks {
        Self::checks(self)
    }

    fn cycle_number(&self) -> u64 {
        self.ticked_at().as_nanos()
    }

    fn sample(&self, _station: usize, _now: Instant) -> (Instant, Sample) {
        (self.ticked_at(), Self::sample(self))
    }
}

/// Executes the PLC's skills and reports the results.
struct OnInstruction;

impl<N: Node<Event = RobotEvent, Order = RobotInstruction, Answer = Infallible>> OperatingMode<N>
    for OnInstruction
{
    type Message = RobotMessage;
    type Instruction = RobotInstruction;

    fn event(&mut self, event: RobotEvent) -> (Option<RobotMessage>, Next<RobotInstruction>) {
        let message = match event {
            RobotEvent::SkillFinished {
                number,
                ending: Ending::Done,
                executed,
                execution,
                began,
                quality,
                account,
                ..
            } => {
                let execution_ns = u64::try_from(execution.as_nanos()).unwrap_or(u64::MAX);
                let (motions, began_ns) = (executed, began.map(Instant::as_nanos));
                Some(RobotMessage::Executed { number, motions, execution_ns, began_ns, quality, account })
            }
            RobotEvent::SkillFinished {
                number,
                ending: Ending::Halted | Ending::Cancelled,
                executed,
                ..
            } => {
                let reason = format!("aborted after {executed} motions: the PLC halted it, or is gone");
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
            RobotEvent::DrivesFailed(error) => Some(RobotMessage::DrivesFailed(error.to_string())),
            RobotEvent::ImagesRefused { fault: ImageFault::Altered, is_refused } => {
                Some(RobotMessage::ImagesAltered(is_refused))
            }
            RobotEvent::ImagesRefused { fault: ImageFault::Outdated, is_refused } => {
                Some(RobotMessage::ImagesOutdated(is_refused))
            }
            RobotEvent::LifeStill => Some(RobotMessage::LifeStill),
            RobotEvent::Link(_)
            | RobotEvent::Waiting { .. }
            | RobotEvent::State(_)
            | RobotEvent::SkillStarted { .. }
            | RobotEvent::BlendSuppressed { .. } => None,
        };
        (message, Next::Wait)
    }

    fn answer(&mut self, answer: Infallible) -> (RobotMessage, Next<RobotInstruction>) {
        match answer {}
    }

    fn instruction(&mut self, instruction: RobotInstruction) -> RobotInstruction {
        instruction
    }

    fn refuse(&self, reason: String) -> RobotMessage {
        RobotMessage::Refused { reason }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_single_motion_is_told_without_stops_and_several_with_theirs() {
        let told = |motions| {
            let (quality, account) = (Quality::default(), Account::default());
            let execution_ns = 516_000_000;
            RobotMessage::Executed { number: 3, motions, execution_ns, began_ns: None, quality, account }
                .to_string()
        };
        assert_eq!(told(1), "command 3: 1 motion in 516.000 ms");
        assert_eq!(told(13), "command 3: 13 motions in 516.000 ms, stops between them: 0");
    }
}
