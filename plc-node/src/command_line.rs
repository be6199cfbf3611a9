//! The command line of `plc-node`. Of its commands `plan`, `export` and `describe` need no bus, and `discover` only asks who is on one.

use std::ffi::OsString;
use std::process::ExitCode;

use clap::{CommandFactory, Parser};
use node::{arguments, screen};

use crate::describe::DescribeCommand;
#[cfg(all(feature = "real", target_os = "linux"))]
use crate::discover::DiscoverCommand;
use crate::export_command::ExportCommand;
#[cfg(all(feature = "real", target_os = "linux"))]
use crate::io::{IoCommand, is_usage as is_usage_of_io};
use crate::plan_command::PlanCommand;
#[cfg(all(feature = "real", target_os = "linux"))]
use crate::process::Run;
#[cfg(all(feature = "real", target_os = "linux"))]
use crate::set_station::{FlashCommand, SetIpCommand, SetNameCommand};
#[cfg(all(feature = "real", target_os = "linux"))]
use crate::station_error::is_usage as is_usage_of_station;

/// The PLC of a setup on a real bus: connects to the robot and runs the application.
#[derive(Parser, Debug)]
#[command(name = "plc-node", version = node::version())]
struct Cli {
    #[command(subcommand)]
    command: Subcommand,
}

#[derive(clap::Subcommand, Debug)]
enum Subcommand {
    /// Connect to the robot and run the application.
    #[cfg(all(feature = "real", target_os = "linux"))]
    Run(Box<Run>),
    /// Plan an application and print its motions with their labels and zones, and the reason for each zone's size.
    Plan(PlanCommand),
    /// Export the PLC's function blocks and the planned motions as code for another PLC.
    Export(ExportCommand),
    /// List what a device file offers: GSDML, EDS or ESI.
    Describe(DescribeCommand),
    /// Drive the device of a GSDML, EDS or ESI: its inputs, outputs and parameters by name.
    #[cfg(all(feature = "real", target_os = "linux"))]
    Io(Box<IoCommand>),
    /// Give a PROFINET station another name.
    #[cfg(all(feature = "real", target_os = "linux"))]
    SetName(SetNameCommand),
    /// Give a PROFINET station another IP address.
    #[cfg(all(feature = "real", target_os = "linux"))]
    SetIp(SetIpCommand),
    /// Let a PROFINET station flash its lamp.
    #[cfg(all(feature = "real", target_os = "linux"))]
    Flash(FlashCommand),
    /// List the PROFINET, EtherNet/IP and EtherCAT devices on a network interface.
    #[cfg(all(feature = "real", target_os = "linux"))]
    Discover(DiscoverCommand),
}

/// Returns the command line, for its completions and manual page.
#[must_use]
pub fn command_line() -> clap::Command {
    Cli::command()
}

/// Runs the process: parses `args`, with the program's name first, and runs until it is done.
pub fn main(args: impl IntoIterator<Item = OsString>) -> ExitCode {
    #[cfg(all(feature = "real", target_os = "linux"))]
    node::run::exit_on_stop();
    screen::fit_terminal();
    let cli: Cli = arguments::parse(args);
    match cli.command {
        Subcommand::Plan(plan) => node::exit_code(plan.execute(), |_| false),
        Subcommand::Describe(file) => node::exit_code(file.execute(), node::device_options::is_usage),
        Subcommand::Export(export) => node::exit_code(export.execute(), crate::export_command::is_usage),
        #[cfg(all(feature = "real", target_os = "linux"))]
        Subcommand::Io(io) => node::exit_code(io.execute(), is_usage_of_io),
        #[cfg(all(feature = "real", target_os = "linux"))]
        Subcommand::SetName(command) => node::exit_code(command.execute(), is_usage_of_station),
        #[cfg(all(feature = "real", target_os = "linux"))]
        Subcommand::SetIp(command) => node::exit_code(command.execute(), is_usage_of_station),
        #[cfg(all(feature = "real", target_os = "linux"))]
        Subcommand::Flash(command) => node::exit_code(command.execute(), is_usage_of_station),
        #[cfg(all(feature = "real", target_os = "linux"))]
        Subcommand::Run(run) => {
            node::run::exit_code(run.execute(), |error| error.is::<crate::bus::BusError>())
        }
        #[cfg(all(feature = "real", target_os = "linux"))]
        Subcommand::Discover(discover) => node::run::exit_code(discover.execute(), |_| false),
    }
}
