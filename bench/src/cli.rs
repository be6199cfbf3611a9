//! The command line.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use plc_node::ExecutionType;

use crate::doctor::DoctorOptions;
use crate::export::Exports;
use crate::faults::Fault;
use crate::gate::GateOptions;
use crate::history::HistoryOptions;
use crate::long::LongOptions;
use crate::overhead::OverheadOptions;
use crate::report::{CompareOptions, ReportOptions};
use crate::rig::Attach;
use crate::sensitivity::SensitivityOptions;
use crate::sweep::SweepOptions;
use crate::timing::TimingOptions;

/// The seed of runs that name none.
const SEED: u64 = 1;

/// Repetitions of each type in the paper (section 6.2).
const REPETITIONS: u32 = 25;

/// Measures skill-based robot control over a real fieldbus: the same sequence as a robot program (RC), as single
/// skills from the PLC (SM) and as one MoveContinuousSkill from the PLC (CM).
#[derive(Parser, Debug)]
#[command(
    name = "bench",
    version,
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
  bench --setup A --types rc,cm --export-json results.json
  bench --attach plc=10.0.0.1:7700,robot=10.0.0.2:7700    nodes that run already, on other machines
  bench --setup A --mode virtual --reps 3 --fault loss=0.001 --fault cut-at=20s..20.1s --capture on-failure
  bench --setup my-cell.toml --mode virtual  a setup of your own; start from bench/setups/A.toml

Exit codes:
  0 pass   1 internal   2 usage   3 timing regression   4 a run failed   5 environment unusable   130 interrupted";

/// Everything but a measured run.
#[derive(Subcommand, Debug)]
pub enum Command {
    /// Find the numbers of a setup that only a published figure can fix: speed, skill overhead, interpreter quantum.
    Calibrate(CalibrateOptions),
    /// Run in virtual time and fail with exit code 3 where a figure differs from the committed baseline.
    Gate(GateOptions),
    /// Measure in real mode what captures and traces cost, recorded and unrecorded seconds in turn.
    Overhead(OverheadOptions),
    /// Run millions of motions as one MoveContinuousSkill in virtual time, and check that each arrives once and in order.
    Long(LongOptions),
    /// Draw the report of a run again.
    Report(ReportOptions),
    /// Set runs beside each other.
    Compare(CompareOptions),
    /// List the runs that are kept, with the trend of their figures.
    History(HistoryOptions),
    /// Look whether this machine can do real mode, and how well.
    Doctor(DoctorOptions),
    /// Measure how evenly cyclic EtherNet/IP frames come, beside a bare loop on this host and a peer.
    Timing(TimingOptions),
    /// See where one MoveContinuousSkill loses to the robot's program: slots × bus cycle × length of motions.
    Sweep(SweepOptions),
    /// See how the execution times move with what the setup assumes: motions, ways, acceleration, blending, overhead.
    Sensitivity(SensitivityOptions),
}

/// Options of a measured run.
#[derive(Args, Debug)]
pub struct RunOptions {
    /// A built-in setup's name, or the path of a .toml file.
    #[arg(long, value_name = "NAME|PATH", default_value = "A")]
    pub setup: String,
    /// Two processes on a real network, or both nodes in virtual time.
    #[arg(long, value_enum, default_value_t = Mode::Real)]
    pub mode: Mode,
    /// Repetitions of each execution type.
    #[arg(long, value_name = "N", default_value_t = REPETITIONS, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub reps: u32,
    /// Execution types to run, interleaved in this order.
    #[arg(long, value_name = "TYPES", value_delimiter = ',', default_value = "rc,sm,cm")]
    pub types: Vec<ExecutionType>,
    /// Seed of the pauses between runs, and in virtual mode of the clocks and phases.
    #[arg(long, value_name = "N", default_value_t = SEED)]
    pub seed: u64,
    /// Run directory; it must not hold a run yet [default: runs/TIME-SETUP-MODE].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Files besides the run directory.
    #[command(flatten)]
    pub exports: Exports,
    /// How PROFINET's cyclic frames travel, instead of what the setup says.
    #[arg(long, value_enum)]
    pub cyclic: Option<Cyclic>,
    /// Keep what passes the interfaces, as DIR/plc.pcapng and DIR/robot.pcapng.
    #[arg(long, value_enum, default_value_t = Capture::Never)]
    pub capture: Capture,
    /// Measure on nodes that run already, `run --control ADDRESS:PORT`: in containers, on other machines, or the PLC's
    /// alone where the robot is real. Real mode only; they are started with the same --setup.
    #[arg(long, value_name = "plc=HOST:PORT[,robot=HOST:PORT]")]
    pub attach: Option<Attach>,
    /// Write a timeline of the first repetition of each type, as DIR/trace.json; ui.perfetto.dev opens it.
    #[arg(long)]
    pub trace: bool,
    /// Write the arm's joints, the way of its tool and its path speed, actual and programmed, in the first repetition of
    /// each type, as DIR/motion.mcap; Foxglove and Rerun open it. Only in a bench that was built with `--features mcap`.
    #[arg(long)]
    pub mcap: bool,
    /// Put a fault into the cable, any number of times: loss=0.001, delay=100us, to-robot:jitter=50us,
    /// duplicate=0.01, corrupt=0.001, reorder=0.01@2ms, cut-at=2s..2.1s, kill-robot-at=2s. Times count from the
    /// moment that the robot is ready; the same seed gives the same faults.
    #[arg(long, value_name = "FAULT")]
    pub fault: Vec<Fault>,
    /// Print the table only: no progress, no warnings.
    #[arg(long, short)]
    pub quiet: bool,
}

/// Options of a calibration.
#[derive(Args, Debug)]
pub struct CalibrateOptions {
    /// A built-in setup's name, or the path of a .toml file.
    #[arg(long, value_name = "NAME|PATH", default_value = "A")]
    pub setup: String,
    /// Repetitions of each execution type that a step averages over.
    #[arg(long, value_name = "N", default_value_t = REPETITIONS, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub reps: u32,
    /// Seed of the clocks and phases.
    #[arg(long, value_name = "N", default_value_t = SEED)]
    pub seed: u64,
}

/// On which clock a run runs.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
pub enum Mode {
    /// Two processes, real sockets, the machine's clock.
    Real,
    /// Both nodes in this process, in virtual time; needs no permission.
    Virtual,
}

impl Mode {
    /// The name that options, results and run directories use.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Real => "real",
            Self::Virtual => "virtual",
        }
    }
}

/// When a capture is kept.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
pub enum Capture {
    /// Of every run.
    Always,
    /// Of runs in which a repetition failed: how the connection was made (the first MiB of each end), and the last
    /// 64 MiB of each end before the failure.
    OnFailure,
    /// Nothing is recorded.
    Never,
}

/// How PROFINET's cyclic frames travel.
#[derive(Clone, Copy, PartialEq, Eq, Debug, ValueEnum)]
pub enum Cyclic {
    /// RT_CLASS_UDP: UDP port 34962.
    Udp,
    /// RT_CLASS_1: EtherType 0x8892.
    Rt1,
}

impl From<Cyclic> for setup::Cyclic {
    fn from(cyclic: Cyclic) -> Self {
        match cyclic {
            Cyclic::Udp => Self::Udp,
            Cyclic::Rt1 => Self::Rt1,
        }
    }
}
