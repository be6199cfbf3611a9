//! Options of a measured run.

use std::path::PathBuf;
use std::str::FromStr;

use capture_file::Retention;
use clap::{Args, ValueEnum};
use node::list::{List, flat};
use plc_node::{ExecutionType, OverrideSchedule};

use records::faults::Fault;
use records::mode::Mode;
use records::schedule::{REPETITIONS, SEED};
use report::export::Exports;
use report::live::{self, LiveAddress};
use report::pages::WantedPages;
use stands::Attach;
use studies::setup_option::{DrivesOption, SetupOption};

/// Options of a measured run.
#[derive(Args, Debug)]
pub struct RunOptions {
    /// Which setup.
    #[command(flatten)]
    pub setup: SetupOption,
    /// An application in place of the setup's: a built-in one's name, or the path of a .toml file.
    #[arg(long, value_name = "NAME|FILE")]
    pub application: Option<String>,
    /// A process for each node on a real network, or all nodes in virtual time.
    #[arg(long, value_enum, default_value_t = Mode::Real)]
    pub mode: Mode,
    /// Repetitions of each execution type.
    #[arg(long, value_name = "N", default_value_t = REPETITIONS, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub reps: u32,
    /// Execution types to run, interleaved in this order.
    ///
    /// Commas or blanks are between them.
    #[arg(long, value_name = "TYPE", num_args = 1.., default_value = "rc,sm,cm")]
    pub types: Vec<List<ExecutionType>>,
    /// Seed of the pauses between runs, and in virtual mode of the clocks and phases.
    #[arg(long, hide_short_help = true, value_name = "N", default_value_t = SEED)]
    pub seed: u64,
    /// Run directory, without files of another run [default: runs/TIME-SETUP-MODE].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Files besides the run directory.
    #[command(flatten)]
    pub exports: Exports,
    /// Transport of PROFINET's cyclic frames, in place of the setup's.
    #[arg(long, hide_short_help = true, value_enum)]
    pub cyclic: Option<Cyclic>,
    /// What moves the robot's joints.
    #[command(flatten)]
    pub drives: DrivesOption,
    /// Record the frames at both ends of the cable.
    ///
    /// They are in DIR/plc.pcapng and DIR/robot.pcapng; with several stations in DIR/plc-STATION.pcapng and
    /// DIR/robot-STATION.pcapng.
    #[arg(long, value_enum, default_value_t = Capture::Never)]
    pub capture: Capture,
    /// Measure on nodes that run already.
    ///
    /// They were started by `run --control ADDRESS:PORT` with the same --setup: in containers, on other machines, or the PLC's
    /// alone where the robot is real. With several stations, a robot has the name of its station. Real mode only.
    #[arg(long, value_name = "plc=HOST:PORT[,robot=HOST:PORT]")]
    pub attach: Option<Attach>,
    /// The file with the token of the nodes' control ports in its first line.
    ///
    /// Without it, the token is SKILLBENCH_CONTROL_TOKEN, if that is set.
    #[arg(long, hide_short_help = true, value_name = "FILE", requires = "attach")]
    pub control_token: Option<PathBuf>,
    /// Write a timeline of the first repetition of each type, as DIR/trace.json; ui.perfetto.dev opens it.
    #[arg(long, hide_short_help = true)]
    pub trace: bool,
    /// Write the arm's motion as DIR/motion.mcap; Foxglove and Rerun open it.
    ///
    /// It has the joints, the path of the tool and the path speed, actual and programmed, in the first repetition of each type.
    /// Only in a bench that was built with `--features mcap`.
    #[arg(long, hide_short_help = true)]
    pub mcap: bool,
    /// Override in whole % of every programmed speed, and when it changes.
    ///
    /// It is 0 to 100; times count from the start of each repetition: 50, 50@2s or 80,0@2s,100@3s. At 0 the arm stops on its
    /// path; a change keeps every limit.
    #[arg(long = "override", value_name = "PERCENT[@TIME],...")]
    pub overrides: Option<OverrideSchedule>,
    /// Faults to inject; the help is made from their list.
    #[arg(long, value_name = "FAULT", num_args = 1.., help = "Inject a fault; can be given several times", long_help = records::faults::help())]
    pub fault: Vec<List<Fault>>,
    /// Execute exported code in place of the PLC's function blocks.
    ///
    /// It is the directory that `plc-node export --for st` wrote; the code there may be edited.
    #[arg(long, hide_short_help = true, value_name = "DIR", conflicts_with = "attach")]
    pub plc_program: Option<PathBuf>,
    /// Serve a page that shows the run while it is going on.
    ///
    /// It shows the arm, slots and speed of the present repetition, the table as it grows, lateness of the cycles, counters, alarms
    /// and faults. Real mode only, and only for this machine's loopback.
    #[arg(long, value_name = "ADDRESS:PORT", num_args = 0..=1, default_missing_value = live::DEFAULT)]
    pub live: Option<LiveAddress>,
    /// Leave out parts of the run directory, for many runs: report, race, traces.
    ///
    /// A run without all three takes a hundredth of the room. Commas or blanks are between them.
    #[arg(long, hide_short_help = true, value_name = "PART", num_args = 1..)]
    pub without: Vec<List<RunPart>>,
    /// Print the table only: no progress, no warnings, no sentences.
    ///
    /// A run that does not pass is explained all the same.
    #[arg(long, short)]
    pub quiet: bool,
}

impl RunOptions {
    /// Returns the pages that are written.
    #[must_use]
    pub fn pages(&self) -> WantedPages {
        WantedPages { report: !self.leaves_out(RunPart::Report), race: !self.leaves_out(RunPart::Race) }
    }

    /// Returns whether a part of the run directory is left out.
    #[must_use]
    pub fn leaves_out(&self, part: RunPart) -> bool {
        flat(&self.without).contains(&part)
    }
}

/// A part of the run directory that a run can leave out.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum RunPart {
    /// `report.html`.
    Report,
    /// `race.html`.
    Race,
    /// `trace-*.csv`, from which both pages draw curves.
    Traces,
}

/// Not a part of the run directory.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
#[error("`{0}`: must be report, race or traces")]
pub struct UnknownRunPart(String);

impl FromStr for RunPart {
    type Err = UnknownRunPart;

    fn from_str(text: &str) -> Result<Self, UnknownRunPart> {
        match text {
            "report" => Ok(Self::Report),
            "race" => Ok(Self::Race),
            "traces" => Ok(Self::Traces),
            other => Err(UnknownRunPart(other.to_owned())),
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

impl Capture {
    /// Returns how much of a capture is kept; `None` if nothing is recorded.
    #[must_use]
    pub const fn retention(self) -> Option<Retention> {
        match self {
            Self::Always => Some(Retention::All),
            Self::OnFailure => Some(Retention::FirstAndLast),
            Self::Never => None,
        }
    }
}

/// Transport of PROFINET's cyclic frames.
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
