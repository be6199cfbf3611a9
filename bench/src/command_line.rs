//! The command line.

use clap::{Parser, Subcommand};

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
  bench --setup A                            two processes, real PROFINET, 75 runs in about six minutes
  bench --setup A --mode virtual             the same in virtual time, in about a second
  bench --setup A --cyclic rt1 --reps 3      cyclic frames in EtherType 0x8892 instead of UDP
  bench --setup C                            the same arm over EtherCAT
  bench --setup A --types rc,cm --export-json results.json
  bench --attach plc=10.0.0.1:7700,robot=10.0.0.2:7700    nodes that run already, on other machines
  bench --setup A --mode virtual --reps 3 --fault loss=0.001 --fault cut-at=20s..20.1s --capture on-failure
  bench new my-cell                          a cell of your own: my-cell/setup.toml and my-cell/application.toml
  bench --setup my-cell/setup.toml --mode virtual

Exit codes:
  0 pass   1 internal   2 usage   3 timing regression   4 a run failed   5 environment unusable
  6 rating exceeded   130 interrupted";

/// The version, with the commit that the program was built from if it is known.
const VERSION: &str = env!("SKILLBENCH_VERSION");

/// Everything but a measured run.
#[derive(Subcommand, Debug)]
pub enum Command {
    /// Compare the buses: execution and reaction times of the same arm and application over each, in virtual time.
    Buses(BusesOptions),
    /// Find the numbers of a setup that only published figures can determine: speed, skill overhead, interpreter quantum.
    Calibrate(CalibrateOptions),
    /// Run in virtual time and fail with exit code 3 where a figure differs from the committed baseline.
    Gate(GateOptions),
    /// Measure in real mode what captures and traces cost, recorded and unrecorded seconds in turn.
    #[cfg(all(feature = "real", target_os = "linux"))]
    Overhead(OverheadOptions),
    /// Run millions of motions as one MoveContinuousSkill in virtual time, and check that each arrives once and in order.
    Long(LongOptions),
    /// Measure a PLC and a robot of any make from a capture of their frames: PROFINET or EtherNet/IP.
    FromCapture(FromCaptureOptions),
    /// Make a run of the execution times that were read out of a PLC.
    ImportSamples(ImportOptions),
    /// Write the files of a cell of your own, with every key explained: a setup and an application.
    New(NewOptions),
    /// Draw the report of a run again.
    Report(ReportOptions),
    /// Compare runs with each other.
    Compare(CompareOptions),
    /// List the saved runs, with the trend of their figures.
    History(HistoryOptions),
    /// Test whether this machine can run real mode, and how well.
    #[cfg(all(feature = "real", target_os = "linux"))]
    Doctor(DoctorOptions),
    /// Be the device of a GSDML, EDS or ESI file, for tests of a controller; the same as `robot-node emulate`.
    #[cfg(all(feature = "real", target_os = "linux"))]
    Emulate(EmulateCommand),
    /// Measure how evenly the cyclic frames of each bus arrive, and compare with a bare loop on this host.
    #[cfg(all(feature = "real", target_os = "linux"))]
    Timing(TimingOptions),
    /// Measure the cost of a cycle by the number of stations, in virtual time or on a real network.
    #[cfg(all(feature = "real", target_os = "linux"))]
    Scale(ScaleOptions),
    /// Run a study of your own: a file says what varies, and each repetition becomes a row; on this machine or on a cluster.
    #[command(subcommand)]
    Study(StudyVerb),
    /// Show where one MoveContinuousSkill is slower than the robot's program: slots × bus cycle × length of motions.
    Sweep(SweepOptions),
    /// Show how the execution times change with the setup's assumptions: motions, path, acceleration, blending, overhead.
    Sensitivity(SensitivityOptions),
    /// Put one fault into a short run at every single frame, or pairs of faults, in virtual time, and class how the runs end.
    Explore(ExploreOptions),
    /// Live through hours of the plant in virtual time with faults all the time; memory must not grow.
    Soak(SoakOptions),
    /// Run random motion lists on the robot and check each robot cycle with independent laws and kinematics.
    Judge(JudgeOptions),
    /// Print completions for a shell: `bench completions bash >~/.local/share/bash-completion/completions/bench`.
    Completions(CompletionsOptions),
    /// Write manual pages of bench, plc-node and robot-node.
    Man(ManOptions),
}
