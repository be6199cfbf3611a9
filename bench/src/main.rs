//! `bench`: see [`bench::cli`].

#![warn(clippy::print_stdout, clippy::print_stderr)]

use std::process::ExitCode;

use bench::cli::{CalibrateOptions, Cli, Command, Mode, RunOptions};
use bench::exit::{Exit, Failure};
use bench::out;
use bench::output::errln;
use bench::{
    calibrate, doctor, gate, history, long, measure, overhead, report, rig, sensitivity, sweep, timing,
};
use clap::Parser;

fn main() -> ExitCode {
    if let Some(exit) = rig::run_as_node() {
        return exit;
    }
    let cli = Cli::parse();
    let outcome = match &cli.command {
        None => measure(&cli.run),
        Some(Command::Calibrate(options)) => calibrate(options),
        Some(Command::Gate(options)) => gate::run(options),
        Some(Command::Overhead(options)) => match rig::enter_user_namespace() {
            Ok(()) => overhead::run(options),
            Err(error) => Err(Failure::new(error.exit(), error)),
        },
        Some(Command::Long(options)) => long::run(options),
        Some(Command::Report(options)) => report::run(options),
        Some(Command::Compare(options)) => report::compare(options),
        Some(Command::History(options)) => history::run(options),
        Some(Command::Doctor(options)) => doctor::run(options),
        Some(Command::Timing(options)) => timing::run(options),
        Some(Command::Sweep(options)) => sweep::run(options),
        Some(Command::Sensitivity(options)) => sensitivity::run(options),
    };
    match outcome {
        Ok(exit) => exit.into(),
        Err(Failure { exit, error }) => {
            errln!("error: {error:#}");
            exit.into()
        }
    }
}

fn measure(options: &RunOptions) -> Result<Exit, Failure> {
    if options.mode == Mode::Real && options.attach.is_none() {
        // The kernel allows it only while this process has one thread.
        rig::enter_user_namespace().map_err(|error| Failure::new(error.exit(), error))?;
    }
    measure::run(options)
}

fn calibrate(options: &CalibrateOptions) -> Result<Exit, Failure> {
    let (setup, found) = planning::setup_with_application(&options.setup)?;
    found.plan(&setup)?;
    let progress = |text: &str| errln!("{text}");
    let found = calibrate::calibrate(&setup, &found.application, options.reps, options.seed, progress)?;
    out!("{}", found.report());
    Ok(Exit::Pass)
}
