//! Configuration of a rig, and the nodes' command lines.

use std::ffi::OsString;
use std::path::PathBuf;
use std::time::Duration;

use capture_file::Retention;
use setup::{Cell, Cyclic, Setup};

use super::frames::FrameLog;
use super::layout::RigLayout;
use records::faults::Fault;
use records::feed::Feed;
use records::trace::tables;
use records::voice::Voice;

/// Configuration of a rig.
#[derive(Clone, Debug)]
pub struct RigConfig {
    /// A built-in setup's name, or the path of a file.
    pub setup: OsString,
    /// The connections.
    pub layout: RigLayout,
    /// The shortest watchdog time of the setup's connections.
    pub watchdog: Duration,
    /// How PROFINET's cyclic frames are sent, instead of the setup's choice.
    pub cyclic: Option<Cyclic>,
    /// Seed of the robot's interpreter.
    pub seed: u64,
    /// Directory for captures of both interfaces, from before the first frame on, and how much is kept.
    pub capture: Option<(PathBuf, Retention)>,
    /// Directory in which each node writes its recorded cycles; they record while [`Rig::record`](super::Rig::record)
    /// is on.
    pub trace: Option<PathBuf>,
    /// Log of the frames at both interfaces while cycles are recorded.
    pub frames: Option<FrameLog>,
    /// The live view.
    pub feed: Option<Feed>,
    /// Prints what the nodes wait for.
    pub voice: Option<Voice>,
    /// Whether the nodes write all their cycles, for the live view, and not only while [`Rig::record`](super::Rig::record) is
    /// on.
    pub writes_all: bool,
    /// Faults of the cable and of the nodes; `seed` decides which frames they hit.
    pub faults: Vec<Fault>,
    /// The program of both nodes; `None` for this program.
    pub program: Option<PathBuf>,
    /// Directory of exported code that takes the place of the PLC's function blocks.
    pub code: Option<PathBuf>,
    /// Exchange images without a bus protocol, for tests that are not about a bus.
    pub direct: bool,
}

impl RigConfig {
    /// Creates the configuration of a rig of this setup without captures, traces and faults. The nodes read the setup
    /// from `read_from`.
    pub fn new(setup: &Setup, read_from: impl Into<OsString>) -> Self {
        Self::of(RigLayout::of_one(), setup.bus.watchdog(), read_from.into())
    }

    /// Creates the same for a cell with several stations.
    pub fn of_cell(cell: &Cell, read_from: impl Into<OsString>) -> Self {
        let watchdogs = cell.stations.iter().map(|station| station.bus.watchdog());
        Self::of(RigLayout::of_cell(cell), watchdogs.min().unwrap_or_default(), read_from.into())
    }

    fn of(layout: RigLayout, watchdog: Duration, setup: OsString) -> Self {
        Self {
            setup,
            layout,
            watchdog,
            cyclic: None,
            seed: 1,
            capture: None,
            trace: None,
            frames: None,
            feed: None,
            voice: None,
            writes_all: false,
            faults: Vec::new(),
            program: None,
            code: None,
            direct: false,
        }
    }

    /// Returns the arguments of the PLC's node; `interface` is its option of this name.
    pub(super) fn plc_args(&self, interface: &str) -> Vec<OsString> {
        let mut args = self.args(interface, tables::PLC_ROWS);
        if let Some(directory) = &self.code {
            args.extend(["--program".into(), directory.into()]);
        }
        args
    }

    /// Returns the arguments of a robot's node.
    pub(super) fn robot_args(&self, interface: &str, index: usize, station: Option<&str>) -> Vec<OsString> {
        let rows = station.map_or_else(|| tables::ROBOT_ROWS.to_owned(), tables::robot_rows);
        let mut args = self.args(interface, &rows);
        // Each robot draws numbers of its own, and a single one those of the seed itself.
        let seed = self.seed.wrapping_add(index as u64);
        args.extend(["--seed".into(), seed.to_string().into()]);
        if let Some(station) = station {
            args.extend(["--station".into(), station.into()]);
        }
        args
    }

    fn args(&self, interface: &str, rows: &str) -> Vec<OsString> {
        let mut args: Vec<OsString> = ["run", "--json", "--interface", interface].map(OsString::from).into();
        args.extend(["--setup".into(), self.setup.clone()]);
        if let Some(cyclic) = self.cyclic {
            let name = match cyclic {
                Cyclic::Udp => "udp",
                Cyclic::Rt1 => "rt1",
            };
            args.extend(["--cyclic".into(), name.into()]);
        }
        if let Some(directory) = &self.trace {
            args.extend(["--trace-file".into(), directory.join(rows).into()]);
        }
        if self.direct {
            args.push("--direct".into());
        }
        args
    }
}
