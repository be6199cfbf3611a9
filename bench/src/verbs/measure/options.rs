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
    /// Execution types to run, interleaved in this order; commas or blanks between them.
    #[arg(long, value_name = "TYPE", num_args = 1.., default_value = "rc,sm,cm")]
    pub types: Vec<List<ExecutionType>>,
    /// Seed of the pauses between runs, and in virtual mode of the clocks and phases.
    #[arg(long, value_name = "N", default_value_t = SEED)]
    pub seed: u64,
    /// Run directory; it must hold no file of a run yet, such as a setup.toml [default: runs/TIME-SETUP-MODE].
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Files besides the run directory.
    #[command(flatten)]
    pub exports: Exports,
    /// Transport of PROFINET's cyclic frames, in place of the setup's.
    #[arg(long, value_enum)]
    pub cyclic: Option<Cyclic>,
    /// What moves the robot's joints.
    #[command(flatten)]
    pub drives: DrivesOption,
    /// Record the frames at both ends to DIR/plc.pcapng and DIR/robot.pcapng; with several stations those at both ends of each
    /// station's cable to DIR/plc-STATION.pcapng and DIR/robot-STATION.pcapng.
    #[arg(long, value_enum, default_value_t = Capture::Never)]
    pub capture: Capture,
    /// Measure on nodes that run already, `run --control ADDRESS:PORT`: in containers, on other machines, or the PLC's
    /// alone where the robot is real. Real mode only; they are started with the same --setup.
    #[arg(long, value_name = "plc=HOST:PORT[,robot=HOST:PORT|,STATION=HOST:PORT,...]")]
    pub attach: Option<Attach>,
    /// The file whose first line is the token of the nodes' control ports; without it SKILLBENCH_CONTROL_TOKEN, if that is
    /// set.
    #[arg(long, value_name = "FILE", requires = "attach")]
    pub control_token: Option<PathBuf>,
    /// Write a timeline of the first repetition of each type, as DIR/trace.json; ui.perfetto.dev opens it.
    #[arg(long)]
    pub trace: bool,
    /// Write the arm's joints, the way of its tool and its path speed, actual and programmed, in the first repetition of
    /// each type, as DIR/motion.mcap; Foxglove and Rerun open it. Only in a bench that was built with `--features mcap`.
    #[arg(long)]
    pub mcap: bool,
    /// Override in whole % of every programmed speed, 0 to 100, and when after the start of each repetition it changes: 50,
    /// 50@2s or 80,0@2s,100@3s. At 0 the arm stops on its path; a change keeps every limit.
    #[arg(long = "override", value_name = "PERCENT[@TIME],...")]
    pub overrides: Option<OverrideSchedule>,
    /// Inject a fault; can be given several times: loss=0.001, duplicate=0.01, corrupt=0.001@memory or
    /// corrupt=0.001@wire, reorder=0.01@2ms, delay=100us, jitter=50us, each of these also in one direction, as to-robot:loss=0.001 or to-plc:loss=0.001;
    /// cut-at=2s..2.1s, kill-robot-at=2s, kill-plc-at=2s; of one frame to-robot:lose-frame=17, to-plc:double-frame=17,
    /// to-plc:hold-frame=17@2ms, to-robot:flip-frame=17.93@memory, to-robot:flip-frame=17@wire; in virtual mode
    /// to-robot:cut-frame=17@10ms, to-robot:restart-robot=17@100ms, to-plc:restart-plc=17@100ms; with drives, of that of an axis drive-fault=3@2s, drive-stop=3@2s, drive-block=3@2s..2.5s. Times count from the moment that the robot is ready; the same
    /// seed gives the same faults. With several stations, before a fault stands its station, as in left/to-robot:loss=0.001;
    /// kill-plc-at has none.
    #[arg(long, value_name = "FAULT", num_args = 1..)]
    pub fault: Vec<List<Fault>>,
    /// Execute exported code in the place of the PLC's function blocks, in both modes: the directory that `plc-node export --for
    /// st` wrote, where the code may be edited.
    #[arg(long, value_name = "DIR", conflicts_with = "attach")]
    pub plc_program: Option<PathBuf>,
    /// Serve a page that shows the run while it is going on: the arm, slots and speed of the repetition that runs, the table as it
    /// grows, lateness of the cycles, counters, alarms and faults. Real mode only, and only for this machine's loopback.
    #[arg(long, value_name = "ADDRESS:PORT", num_args = 0..=1, default_missing_value = live::DEFAULT)]
    pub live: Option<LiveAddress>,
    /// Leave out parts of the run directory, for many runs: a run without all three takes a hundredth of the room. Commas or
    /// blanks between them.
    #[arg(long, value_name = "PART", num_args = 1..)]
    pub without: Vec<List<RunPart>>,
    /// Print the table only: no progress, no warnings, no sentences. A run that does not pass is explained all the same.
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
