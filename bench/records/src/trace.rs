//! What both nodes did during one run of each type, tick by tick; [`tables`] stores it in files.
//!
//! Times count from the PLC's start edge, in virtual mode in true time.

pub mod place;
pub mod tables;

use std::time::Duration;

use machine::Instant;
use plc_node::ExecutionType;
use virtual_time::Side;

use crate::counted::counted;
use crate::results::PerType;

/// Time of a run, by the clock that both nodes of a real run share.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Window {
    /// Its execution type.
    pub execution_type: ExecutionType,
    /// Time of the scan with the start edge, in ns.
    pub start_ns: u64,
    /// Its length in ns; `None` if it failed.
    pub length_ns: Option<u64>,
}

impl Window {
    /// Returns whether an instant is in it.
    fn has(&self, at_ns: u64) -> bool {
        let since = at_ns.checked_sub(self.start_ns).map(Duration::from_nanos);
        let length = self.length_ns.map_or(RECORDED, Duration::from_nanos);
        since.is_some_and(|since| since <= length.min(RECORDED))
    }
}

/// The part of a repetition that is recorded. A minute of the timeline takes about 30 MB, and a repetition of
/// `palletising` lasts up to half an hour.
pub const RECORDED: Duration = Duration::from_secs(120);

/// A recording whose last scan is later than [`RECORDED`] minus this does not show the end of its repetition: the PLC
/// scans far more often.
const LAST_SCAN_WITHIN: Duration = Duration::from_millis(100);

/// Capacity for a minute of each, allocated before the repetition starts.
const ROBOT_ROOM: usize = 15_000;
const PLC_ROOM: usize = 60_000;

/// One interpolation cycle of the robot.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct RobotTick {
    /// Time since the start edge, in ms.
    pub at_ms: f64,
    /// True time of the network in virtual time, the host's monotonic clock in real time: comparable between nodes. In ns; 0 in a
    /// trace of an older version.
    pub true_ns: u64,
    /// What the robot did.
    pub sample: robot_node::Sample,
}

/// One scan of the PLC.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct PlcScan {
    /// Time since the scan with the start edge, in µs.
    pub at_us: i64,
    /// When it began, as for the robot.
    pub true_ns: u64,
    /// What the PLC did.
    pub sample: plc_node::Sample,
}

/// A frame at one end of the cable.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Frame {
    /// Time since the start edge, in µs.
    pub at_us: f64,
    /// The end of the cable; A is the PLC's.
    pub end: Side,
    /// Whether it was sent at this end; otherwise it was received.
    pub sent: bool,
    /// What it is, such as `cyclic data`.
    pub name: &'static str,
    /// Length of the frame, without the headers around it, in bytes.
    pub bytes: usize,
    /// Whether the cable impaired it.
    pub faulty: bool,
}

/// Recording of the first [`RECORDED`] of one run.
#[derive(Clone, PartialEq, Debug)]
pub struct Recording {
    robot: Vec<RobotTick>,
    plc: Vec<PlcScan>,
    /// Kept in memory only, for a timeline.
    frames: Vec<Frame>,
}

impl Default for Recording {
    fn default() -> Self {
        Self { robot: Vec::with_capacity(ROBOT_ROOM), plc: Vec::with_capacity(PLC_ROOM), frames: Vec::new() }
    }
}

impl Recording {
    /// Removes everything, to record another repetition.
    pub fn clear(&mut self) {
        self.robot.clear();
        self.plc.clear();
        self.frames.clear();
    }

    /// Adds a tick of the recorded time.
    pub fn robot(&mut self, tick: RobotTick) {
        if tick.at_ms <= RECORDED.as_secs_f64() * 1e3 {
            self.robot.push(tick);
        }
    }

    /// Adds a scan of the recorded time.
    pub fn plc(&mut self, scan: PlcScan) {
        if i128::from(scan.at_us) <= RECORDED.as_micros() as i128 {
            self.plc.push(scan);
        }
    }

    /// Adds a frame of the recorded time.
    pub fn frame(&mut self, frame: Frame) {
        if frame.at_us <= RECORDED.as_secs_f64() * 1e6 {
            self.frames.push(frame);
        }
    }

    /// Returns whether the recording ends before its repetition did.
    #[must_use]
    pub fn is_cut_off(&self) -> bool {
        let least = (RECORDED - LAST_SCAN_WITHIN).as_micros() as i128;
        self.plc.last().is_some_and(|scan| i128::from(scan.at_us) >= least)
    }

    /// Returns when it ends, in ms since the start edge: at the PLC's last scan, since the PLC measures the execution and a robot
    /// goes on for a while after a PLC that failed; without a scan at the robot's last tick.
    #[must_use]
    pub fn end_ms(&self) -> f64 {
        let last_tick = || self.robot.last().map_or(0.0, |tick| tick.at_ms);
        self.plc.last().map_or_else(last_tick, |scan| scan.at_us as f64 / 1e3)
    }

    /// Returns how many of the PLC's scans, and of the robot's cycles, have no row between the first and the last one. A
    /// cycle that the host let pass has none either.
    #[must_use]
    pub fn gaps(&self) -> [u64; 2] {
        let pairs = self.plc.windows(2).map(|pair| match pair {
            [scan, next] => next.sample.scan.saturating_sub(scan.sample.scan).saturating_sub(1),
            _ => 0,
        });
        let steps =
            || self.robot.windows(2).filter_map(|pair| Some(pair.last()?.at_ms - pair.first()?.at_ms));
        let cycle_ms = steps().filter(|step| *step > 0.0).fold(f64::INFINITY, f64::min);
        let robot = steps().map(|step| (step / cycle_ms).round() - 1.0).filter(|more| *more >= 1.0);
        [pairs.sum(), robot.sum::<f64>() as u64]
    }

    /// Returns the frames at both ends in order; none if they were not recorded, or if the recording was read from
    /// the tables.
    #[must_use]
    pub fn frames(&self) -> &[Frame] {
        &self.frames
    }

    /// Returns the robot's ticks in order.
    #[must_use]
    pub fn robot_ticks(&self) -> &[RobotTick] {
        &self.robot
    }

    /// Returns the PLC's scans in order.
    #[must_use]
    pub fn plc_scans(&self) -> &[PlcScan] {
        &self.plc
    }
}

/// A recording per type: of its first repetition.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Trace {
    /// The recordings.
    pub types: PerType<Recording>,
}

/// A trace of each station of a cell, in the order of the setup.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct CellTrace {
    /// The traces.
    pub stations: Vec<Trace>,
}

impl CellTrace {
    /// Takes the recordings of a repetition of a type, one for each station.
    pub fn set(&mut self, execution_type: ExecutionType, recordings: &[Recording]) {
        self.stations.resize_with(recordings.len(), Trace::default);
        for (trace, recording) in self.stations.iter_mut().zip(recordings) {
            *trace.types.entry(execution_type) = Some(recording.clone());
        }
    }
}

impl Trace {
    /// Returns what the recordings lack, as sentences; none if they are complete.
    #[must_use]
    pub fn incomplete(&self) -> Option<String> {
        let gaps = ExecutionType::ALL.into_iter().filter_map(|execution_type| {
            let [scans, cycles] = self.types.get(execution_type)?.gaps();
            let name = execution_type.to_string().to_uppercase();
            let scans = (scans > 0).then(|| format!("{} of the PLC", counted(scans, "scan")));
            let cycles = (cycles > 0).then(|| format!("{} of the robot", counted(cycles, "cycle")));
            let lacking: Vec<_> = scans.into_iter().chain(cycles).collect();
            (!lacking.is_empty()).then(|| format!("The recording of {name} lacks {}.", lacking.join(" and ")))
        });
        let sentences: Vec<_> = self.cut_off().into_iter().chain(gaps).collect();
        (!sentences.is_empty()).then(|| sentences.join(" "))
    }

    /// Returns a sentence that names the recordings that end before their repetitions did; none if there are none.
    fn cut_off(&self) -> Option<String> {
        let is_cut_off = |execution_type: &ExecutionType| {
            self.types.get(*execution_type).is_some_and(Recording::is_cut_off)
        };
        let types: Vec<_> = ExecutionType::ALL
            .into_iter()
            .filter(is_cut_off)
            .map(|execution_type| execution_type.to_string().to_uppercase())
            .collect();
        (!types.is_empty()).then(|| {
            format!(
                "The recordings of {} end {} s after the start edge, before the repetition did.",
                types.join(", "),
                RECORDED.as_secs()
            )
        })
    }

    /// Assigns frames to the runs in which they passed, by the clock that both nodes of a real run share.
    pub fn add_frames(&mut self, windows: &[Window], frames: Vec<(Instant, Frame)>) {
        for (at, frame) in frames {
            let at_ns = at.as_nanos();
            let Some(window) = windows.iter().rev().find(|window| window.has(at_ns)) else { continue };
            if let Some(recording) = self.types.entry(window.execution_type) {
                recording.frame(Frame { at_us: (at_ns - window.start_ns) as f64 / 1e3, ..frame });
            }
        }
    }
}

impl Recording {
    const fn empty() -> Self {
        Self { robot: Vec::new(), plc: Vec::new(), frames: Vec::new() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tick(at_ms: f64) -> RobotTick {
        RobotTick { at_ms, true_ns: 0, sample: robot_node::Sample::default() }
    }

    fn scan(at_us: i64, scan: u64) -> PlcScan {
        PlcScan { at_us, true_ns: 0, sample: plc_node::Sample { scan, ..plc_node::Sample::default() } }
    }

    #[test]
    fn a_recording_goes_on_after_a_minute_and_says_where_it_ends_before_its_repetition() {
        let mut trace = Trace::default();
        for (execution_type, length_s) in
            [(ExecutionType::Rc, 119), (ExecutionType::Sm, 3_600), (ExecutionType::Cm, 121)]
        {
            let recording = trace.types.entry(execution_type).insert(Recording::default());
            (0..length_s * 1_000).for_each(|millis| recording.plc(scan(millis * 1_000, 0)));
        }
        let seconds = |execution_type| trace.types.get(execution_type).unwrap().end_ms() / 1e3;
        assert_eq!(ExecutionType::ALL.map(seconds), [118.999, 120.0, 120.0]);
        let said = trace.incomplete().unwrap();
        assert_eq!(
            said,
            "The recordings of SM, CM end 120 s after the start edge, before the repetition did."
        );
        trace.types = PerType { rc: trace.types.rc, ..PerType::default() };
        assert_eq!(trace.incomplete(), None);
    }

    #[test]
    fn a_recording_without_some_of_its_rows_says_how_many() {
        let mut recording = Recording::default();
        for number in (0..90).filter(|number| !(20..25).contains(number)) {
            recording.plc(scan(number as i64 * 1_000, number));
            if number % 4 == 0 {
                recording.robot(tick(number as f64));
            }
        }
        assert_eq!(recording.gaps(), [5, 2]);
        let trace = Trace { types: PerType { cm: Some(recording), ..PerType::default() } };
        let said = trace.incomplete().unwrap();
        assert_eq!(said, "The recording of CM lacks 5 scans of the PLC and 2 cycles of the robot.");
    }

    #[test]
    fn a_recording_names_only_the_node_whose_rows_it_lacks() {
        let lacking = |scans: &[u64], cycles: &[u64]| {
            let mut recording = Recording::default();
            for number in (0..90).filter(|number| !scans.contains(number)) {
                recording.plc(scan(number as i64 * 1_000, number));
            }
            for number in (0..22).filter(|number| !cycles.contains(number)) {
                recording.robot(tick(number as f64 * 4.0));
            }
            Trace { types: PerType { cm: Some(recording), ..PerType::default() } }.incomplete()
        };
        assert_eq!(lacking(&[], &[]), None);
        assert_eq!(
            lacking(&[], &[3, 4, 5, 6, 7]).unwrap(),
            "The recording of CM lacks 5 cycles of the robot."
        );
        assert_eq!(lacking(&[20], &[]).unwrap(), "The recording of CM lacks 1 scan of the PLC.");
    }

    #[test]
    fn a_window_of_a_real_run_is_as_long_as_a_recording_at_most() {
        let window = Window { execution_type: ExecutionType::Sm, start_ns: 5, length_ns: None };
        let end_ns = RECORDED.as_nanos() as u64 + 5;
        assert_eq!([4, 5, end_ns, end_ns + 1].map(|at_ns| window.has(at_ns)), [false, true, true, false]);
    }
}
