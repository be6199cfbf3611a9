//! `bench`: see [`bench::command_line`].

#![warn(clippy::print_stdout, clippy::print_stderr)]

use std::process::ExitCode;

use bench::command_line::{self, Cli, Command};
#[cfg(all(feature = "real", target_os = "linux"))]
use bench::verbs::{doctor, overhead, scale, timing};
use bench::verbs::{from_capture, gate, history, import_samples, install, measure, new, report, study};
use clap::CommandFactory;
use node::{errln, screen};
use records::exit::Failure;
#[cfg(all(feature = "real", target_os = "linux"))]
use stands::rig;
use studies::{buses, calibrate, explore, judge, long, sensitivity, soak, sweep, trajectory};

fn main() -> ExitCode {
    #[cfg(all(feature = "real", target_os = "linux"))]
    if let Some(exit) = rig::run_as_node() {
        return exit;
    }
    #[cfg(all(feature = "real", target_os = "linux"))]
    if let Some(exit) = scale::run_as_robots() {
        return exit;
    }
    #[cfg(all(feature = "real", target_os = "linux"))]
    protocol_linux::exit_on_stop(records::exit::Exit::Interrupted as u8);
    screen::fit_terminal();
    let cli = command_line::parse(std::env::args_os());
    let outcome = match &cli.command {
        None => measure::run(&cli.run),
        Some(Command::Buses(options)) => buses::run(options, bench::COMMIT),
        Some(Command::Calibrate(options)) => calibrate::run(options, bench::COMMIT),
        Some(Command::Gate(options)) => gate::run(options),
        #[cfg(all(feature = "real", target_os = "linux"))]
        Some(Command::Emulate(command)) => {
            return node::exit_code(command.clone().execute(), robot_node::emulate::is_usage);
        }
        #[cfg(all(feature = "real", target_os = "linux"))]
        Some(Command::Io(command)) => {
            return node::exit_code(command.clone().execute(), plc_node::io::is_usage);
        }
        #[cfg(all(feature = "real", target_os = "linux"))]
        Some(Command::Overhead(options)) => overhead::run(options),
        Some(Command::Long(options)) => long::run(options),
        Some(Command::Trajectory(options)) => trajectory::run(options),
        Some(Command::FromCapture(options)) => from_capture::run(options),
        Some(Command::ImportSamples(options)) => import_samples::run(options),
        Some(Command::New(options)) => new::run(options),
        Some(Command::Report(options)) => report::run(options),
        Some(Command::Compare(options)) => report::compare(options),
        Some(Command::History(options)) => history::run(options),
        #[cfg(all(feature = "real", target_os = "linux"))]
        Some(Command::Doctor(options)) => doctor::run(options),
        #[cfg(all(feature = "real", target_os = "linux"))]
        Some(Command::Timing(options)) => timing::run(options),
        #[cfg(all(feature = "real", target_os = "linux"))]
        Some(Command::Scale(options)) => scale::run(options),
        Some(Command::Study(verb)) => study::run(verb),
        Some(Command::Sweep(options)) => sweep::run(options, bench::COMMIT),
        Some(Command::Sensitivity(options)) => sensitivity::run(options, bench::COMMIT),
        Some(Command::Judge(options)) => judge::run(options, bench::COMMIT),
        Some(Command::Explore(options)) => explore::run(options, bench::COMMIT),
        Some(Command::Soak(options)) => soak::run(options, bench::COMMIT),
        Some(Command::Completions(options)) => install::completions(options, Cli::command()),
        Some(Command::Man(options)) => install::man(options, Cli::command()),
    };
    match outcome {
        Ok(exit) => exit.into(),
        Err(Failure { exit, error }) => {
            errln!("error: {error:#}");
            exit.into()
        }
    }
}
