//! `bench`: see [`bench::cli`].

use std::process::ExitCode;

use bench::cli::{CalibrateOptions, Cli, Command};
use bench::exit::{Exit, Failure};
use bench::{calibrate, gate, measure};
use clap::Parser;

fn main() -> ExitCode {
    let cli = Cli::parse();
    let outcome = match &cli.command {
        None => measure::run(&cli.run),
        Some(Command::Calibrate(options)) => calibrate(options),
        Some(Command::Gate(options)) => gate::run(options),
    };
    match outcome {
        Ok(exit) => exit.into(),
        Err(Failure { exit, error }) => {
            eprintln!("error: {error:#}");
            exit.into()
        }
    }
}

fn calibrate(options: &CalibrateOptions) -> Result<Exit, Failure> {
    let (setup, application) = setup::setup_with_application(&options.setup)?;
    let progress = |text: &str| eprintln!("{text}");
    let found = calibrate::calibrate(&setup, &application, options.reps, options.seed, progress)?;
    print!("{}", found.report());
    Ok(Exit::Pass)
}
