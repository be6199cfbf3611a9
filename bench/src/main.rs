//! `bench`: see [`bench::cli`].

use std::process::ExitCode;

use bench::cli::{CalibrateOptions, Cli, Command, Mode, RunOptions};
use bench::exit::{Exit, Failure};
use bench::{calibrate, gate, long, measure, report, rig};
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
        Some(Command::Long(options)) => long::run(options),
        Some(Command::Report(options)) => report::run(options),
        Some(Command::Compare(options)) => report::compare(options),
    };
    match outcome {
        Ok(exit) => exit.into(),
        Err(Failure { exit, error }) => {
            eprintln!("error: {error:#}");
            exit.into()
        }
    }
}

fn measure(options: &RunOptions) -> Result<Exit, Failure> {
    if options.mode == Mode::Real {
        // The kernel allows it only while this process has one thread.
        rig::enter_user_namespace().map_err(|error| Failure::new(error.exit(), error))?;
    }
    measure::run(options)
}

fn calibrate(options: &CalibrateOptions) -> Result<Exit, Failure> {
    let (setup, found) = planning::setup_with_application(&options.setup)?;
    found.plan(&setup)?;
    let progress = |text: &str| eprintln!("{text}");
    let found = calibrate::calibrate(&setup, &found.application, options.reps, options.seed, progress)?;
    print!("{}", found.report());
    Ok(Exit::Pass)
}
