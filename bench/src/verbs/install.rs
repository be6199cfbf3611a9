//! `bench completions` and `bench man`: what a shell and `man` know about the three programs.

use std::path::PathBuf;

use anyhow::Context as _;
use clap::{Args, Command};
use clap_complete::Shell;

use records::exit::{Exit, Failure};
use report::outln;
use report::to_stdout;
use studies::directory;

/// Options of the completions.
#[derive(Args, Debug)]
pub struct CompletionsOptions {
    /// The shell.
    #[arg(value_enum)]
    pub shell: Shell,
    /// The program: bench, plc-node or robot-node.
    #[arg(long, value_name = "NAME", default_value = "bench", value_parser = ["bench", "plc-node", "robot-node"])]
    pub program: String,
}

/// Options of the manual pages.
#[derive(Args, Debug)]
pub struct ManOptions {
    /// The directory to write them into.
    #[arg(value_name = "DIR", default_value = "man")]
    pub directory: PathBuf,
}

/// Prints the completions of a program for a shell; `bench` is the bench's own command line.
///
/// # Errors
///
/// None is known.
pub fn completions(options: &CompletionsOptions, bench: Command) -> Result<Exit, Failure> {
    let programs = programs(bench).into_iter();
    for mut program in programs.filter(|program| program.get_name() == options.program) {
        let mut script = Vec::new();
        clap_complete::generate(options.shell, &mut program, &options.program, &mut script);
        to_stdout(format_args!("{}", String::from_utf8_lossy(&script)));
    }
    Ok(Exit::Pass)
}

/// Writes the manual pages of the three programs and of each of their commands.
///
/// # Errors
///
/// They cannot be written.
pub fn man(options: &ManOptions, bench: Command) -> Result<Exit, Failure> {
    let directory = &options.directory;
    directory::make(directory)?;
    for program in programs(bench) {
        clap_mangen::generate_to(program, directory)
            .with_context(|| format!("cannot write manual pages into {}", directory.display()))?;
    }
    outln!("Saved in {0}; `man {0}/bench.1` shows one.", directory.display());
    Ok(Exit::Pass)
}

fn programs(bench: Command) -> Vec<Command> {
    vec![
        bench,
        plc_node::command_line::command_line(),
        #[cfg(all(feature = "real", target_os = "linux"))]
        robot_node::process::command_line(),
    ]
}
