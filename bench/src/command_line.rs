//! The command line.

use std::ffi::OsString;

use clap::{Parser, Subcommand};
use node::{arguments, screen};

#[cfg(all(feature = "real", target_os = "linux"))]
use crate::verbs::doctor::DoctorOptions;
use crate::verbs::from_capture::FromCaptureOptions;
use crate::verbs::gate::GateOptions;
use crate::verbs::history::HistoryOptions;
use crate::verbs::import_samples::ImportOptions;
use crate::verbs::install::{CompletionsOptions, ManOptions};
use crate::verbs::measure::RunOptions;
use crate::verbs::new::NewOptions;
#[cfg(all(feature = "real", target_os = "linux"))]
use crate::verbs::overhead::OverheadOptions;
use crate::verbs::report::{CompareOptions, ReportOptions};
#[cfg(all(feature = "real", target_os = "linux"))]
use crate::verbs::scale::ScaleOptions;
#[cfg(all(feature = "real", target_os = "linux"))]
use crate::verbs::timing::TimingOptions;
#[cfg(all(feature = "real", target_os = "linux"))]
use plc_node::io::IoCommand;
#[cfg(all(feature = "real", target_os = "linux"))]
use robot_node::emulate::EmulateCommand;
use studies::buses::BusesOptions;
use studies::calibrate::CalibrateOptions;
use studies::engine::StudyVerb;
use studies::explore::ExploreOptions;
use studies::judge::JudgeOptions;
use studies::long::LongOptions;
use studies::sensitivity::SensitivityOptions;
use studies::soak::SoakOptions;
use studies::sweep::SweepOptions;
use studies::trajectory::TrajectoryOptions;

/// Measures skill-based robot control over a real fieldbus: the same sequence as a robot program (RC), as single
/// skills from the PLC (SM) and as one MoveContinuousSkill from the PLC (CM).
#[derive(Parser, Debug)]
#[command(
    name = "bench",
    version = VERSION,
    args_conflicts_with_subcommands = true,
    after_help = EXAMPLES,
)]
pub struct Cli {
    /// Without a subcommand the setup is run and measured.
    #[command(flatten)]
    pub run: RunOptions,
    /// Everything but a measured run.
    #[command(subcommand)]
    pub command: Option<Command>,
}

const EXAMPLES: &str = "\
Examples:
  bench --setup A
      two processes, real PROFINET, 75 runs in about six minutes
  bench --setup A --mode virtual
      the same in virtual time, in about a second
  bench --setup A --cyclic rt1 --reps 3
      cyclic frames in EtherType 0x8892 instead of UDP
  bench --setup C
      the same arm over EtherCAT
  bench --setup A --types rc,cm --export-json results.json
  bench --attach plc=10.0.0.1:7700,robot=10.0.0.2:7700
      nodes that run already, on other machines
  bench --setup A --mode virtual --reps 3 --fault loss=0.001,cut-at=20s..20.1s
  bench new my-cell
      a cell of your own: my-cell/setup.toml and my-cell/application.toml
  bench --setup my-cell/setup.toml --mode virtual

Exit codes:
  0 pass   1 internal   2 usage   3 timing regression   4 a run failed
  5 environment unusable   6 rating exceeded   130 interrupted";

/// Commands in groups, each under a heading.
const GROUPS: [(&str, &[&str]); 6] = [
    ("First commands:", &["new", "doctor", "help"]),
    ("Saved-run commands:", &["report", "compare", "history", "gate", "from-capture", "import-samples"]),
    (
        "Study commands, in virtual time:",
        &["buses", "sweep", "sensitivity", "calibrate", "trajectory", "study"],
    ),
    ("Test commands:", &["explore", "soak", "judge", "long", "timing", "overhead", "scale"]),
    ("Device commands, on a real network:", &["emulate", "io"]),
    ("Installation commands:", &["completions", "man"]),
];

/// Largest width of the list of commands in characters.
const HELP_WIDTH: usize = 80;

/// Column of the descriptions in the list of commands.
const DESCRIPTIONS: usize = 18;

/// Parses the program's arguments. Prints help, or what is wrong, and ends the program where there is nothing to run.
#[must_use]
pub fn parse(arguments: impl IntoIterator<Item = OsString>) -> Cli {
    arguments::parse_with(arguments, |command| with_groups(command, screen::text_width()))
}

/// Lists the commands in groups in the program's own help, for a terminal of this width.
fn with_groups(mut command: clap::Command, width: usize) -> clap::Command {
    command.build();
    let mut list = String::new();
    for (heading, names) in GROUPS {
        list.push_str(heading);
        list.push('\n');
        for name in names {
            let Some(verb) = command.find_subcommand(name) else { continue };
            let about = verb.get_about().map(ToString::to_string).unwrap_or_default();
            let about = screen::wrapped_within(&about, DESCRIPTIONS, DESCRIPTIONS, width.min(HELP_WIDTH));
            let about = about.get(DESCRIPTIONS..).unwrap_or_default();
            list.push_str(&format!("  {name:<width$}{about}\n", width = DESCRIPTIONS - 2));
        }
        list.push('\n');
    }
    let template = format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{list}Options:\n{{options}}{{after-help}}"
    );
    command.help_template(template)
}

/// The version, with the commit that the program was built from if it is known.
const VERSION: &str = env!("SKILLBENCH_VERSION");

/// Everything but a measured run.
#[derive(Subcommand, Debug)]
pub enum Command {
    /// Compare the buses: execution and reaction times of the same cell over each.
    Buses(BusesOptions),
    /// Fit the numbers of a setup that only published figures determine: speed, overhead, quantum.
    Calibrate(CalibrateOptions),
    /// Run, and fail with exit code 3 where a figure differs from its baseline.
    Gate(GateOptions),
    /// Measure the cost of captures and traces in real mode.
    #[cfg(all(feature = "real", target_os = "linux"))]
    Overhead(OverheadOptions),
    /// Run millions of motions as one MoveContinuousSkill, and check that each arrives once and in order.
    Long(LongOptions),
    /// Drive a finely planned path, and show its speed, its deviation and what limits them.
    Trajectory(TrajectoryOptions),
    /// Measure a PLC and a robot of any make from a capture of their frames.
    FromCapture(FromCaptureOptions),
    /// Make a run of execution times that were read out of a PLC.
    ImportSamples(ImportOptions),
    /// Write a setup and an application of your own, with every key explained.
    New(NewOptions),
    /// Draw the report of a saved run again.
    Report(ReportOptions),
    /// Compare runs with each other.
    Compare(CompareOptions),
    /// List the saved runs, with the trend of their figures.
    History(HistoryOptions),
    /// Test whether this machine can run real mode, and how well.
    #[cfg(all(feature = "real", target_os = "linux"))]
    Doctor(DoctorOptions),
    /// Be the device of a GSDML, EDS or ESI file, as `robot-node emulate` does.
    #[cfg(all(feature = "real", target_os = "linux"))]
    Emulate(EmulateCommand),
    /// Drive the device of a GSDML, EDS or ESI file, as `plc-node io` does.
    #[cfg(all(feature = "real", target_os = "linux"))]
    Io(Box<IoCommand>),
    /// Measure how evenly cyclic frames arrive, beside a bare loop on this host.
    #[cfg(all(feature = "real", target_os = "linux"))]
    Timing(TimingOptions),
    /// Measure the cost of a cycle by the number of stations.
    #[cfg(all(feature = "real", target_os = "linux"))]
    Scale(ScaleOptions),
    /// Run a study of your own, from a file of what varies; on one machine or a cluster.
    #[command(subcommand)]
    Study(StudyVerb),
    /// Show where CM is slower than RC: slots × bus cycle × length of motions.
    Sweep(SweepOptions),
    /// Show how the execution times change with the setup's assumptions.
    Sensitivity(SensitivityOptions),
    /// Inject a fault, or a pair, at every single frame of a short run, and classify how the runs end.
    Explore(ExploreOptions),
    /// Simulate hours of operation with faults; memory must not grow.
    Soak(SoakOptions),
    /// Run random motion lists, and check each robot cycle with independent laws and kinematics.
    Judge(JudgeOptions),
    /// Print completions for a shell.
    ///
    /// For example `bench completions bash >~/.local/share/bash-completion/completions/bench`.
    Completions(CompletionsOptions),
    /// Write manual pages of bench, plc-node and robot-node.
    Man(ManOptions),
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory as _;

    #[test]
    fn every_command_is_in_one_group_of_the_help() {
        let mut command = Cli::command();
        command.build();
        let grouped: Vec<_> = GROUPS.iter().flat_map(|(_, names)| names.iter().copied()).collect();
        for verb in command.get_subcommands().map(clap::Command::get_name) {
            assert_eq!(grouped.iter().filter(|name| **name == verb).count(), 1, "{verb}");
        }
    }

    #[cfg(all(feature = "real", target_os = "linux"))]
    #[test]
    fn no_line_of_any_help_is_wider_than_its_terminal() {
        fn check(command: &clap::Command, path: &str, width: usize) {
            for help in [command.clone().render_help(), command.clone().render_long_help()] {
                // A value without a blank is not broken; 80 columns hold each.
                let is_checked = |line: &&str| width >= 80 || line.trim().contains(' ');
                for line in help.to_string().lines().filter(is_checked) {
                    assert!(line.chars().count() <= width, "{path}: {line}");
                }
            }
            for verb in command.get_subcommands() {
                check(verb, &format!("{path} {}", verb.get_name()), width);
            }
        }
        let programs =
            || [Cli::command(), plc_node::command_line::command_line(), robot_node::process::command_line()];
        // Subcommands take the width over when the command is built, and the groups build it.
        let within = |program: clap::Command, width: usize| {
            let program = program.term_width(width);
            let is_bench = program.get_name() == "bench";
            let command = if is_bench { with_groups(program, width) } else { program };
            arguments::usage_within(command, width)
        };
        for (program, width) in [60, 80].into_iter().flat_map(|width| programs().map(|it| (it, width))) {
            let name = program.get_name().to_owned();
            check(&within(program, width), &name, width);
        }
        for program in programs() {
            let name = program.get_name().to_owned();
            let command = within(program, 80);
            for verb in ["run", "io"].iter().filter_map(|verb| command.find_subcommand(verb)) {
                let [short, long] = [verb.clone().render_help(), verb.clone().render_long_help()];
                let [short, long] = [short, long].map(|help| help.to_string().lines().count());
                assert!(
                    4 * short <= 3 * long,
                    "{name} {}: -h has {short} lines, --help {long}",
                    verb.get_name()
                );
            }
        }
        let mut program = with_groups(Cli::command().term_width(80), 80);
        let [short, long] = [program.render_help(), program.render_long_help()].map(|help| help.to_string());
        let [short, long] = [short, long].map(|help| help.lines().count());
        assert!(3 * short <= 2 * long, "-h has {short} lines, --help {long}");
    }
}
