//! A trace as a timeline in Chrome's Trace Event Format, which Perfetto and chrome://tracing open.
//!
//! The first repetitions of all types follow each other, 100 ms apart. Of a long one only the beginning is recorded; a
//! mark shows where that ends. Each part of the cell is a process, with a track for each kind of event:
//!
//! ```text
//! run     the running type
//! PLC     scans · its command · motions in the slots · motions written
//! cable   what each end sends and receives
//! robot   ticks · state · the command being executed · the motion being executed · path speed · queue
//! ```
//!
//! In a cell with several stations all share the first track, and each has the others: `PLC left`, `cable left`, `robot left`; the PLC's
//! have also the marks at which the arm waits.

use plc_node::ExecutionType;
use serde::Serialize;
use virtual_time::Side;

use records::trace::place::Place;
use records::trace::{Recording, Trace};

/// The timeline, in the run directory.
pub const FILE: &str = "trace.json";

/// Gap between two repetitions, in µs.
const GAP_US: f64 = 100_000.0;

const RUN: u32 = 1;

/// Processes of a station.
#[derive(Clone, Copy, Debug)]
struct Processes {
    plc: u32,
    robot: u32,
    cable: u32,
}

impl Processes {
    const ONE: Self = Self { plc: 2, robot: 3, cable: 4 };

    const fn of_station(index: u32) -> Self {
        let Self { plc, robot, cable } = Self::ONE;
        Self { plc: plc + 3 * index, robot: robot + 3 * index, cable: cable + 3 * index }
    }
}

/// A station and its trace.
#[derive(Clone, Copy, Debug)]
pub struct TimelineStation<'a> {
    /// Its name; empty for the only one.
    pub name: &'a str,
    /// Its trace.
    pub trace: &'a Trace,
    /// The names of its motions.
    pub motions: &'a [&'a str],
    /// The numbers of the marks at which it waits, in order.
    pub marks: &'a [u32],
}

/// Tracks of a process.
const REPETITIONS: u32 = 1;
const GAPS: u32 = 2;
const CYCLES: u32 = 1;
const COMMAND: u32 = 2;
const STATE: u32 = 3;
const MOTION: u32 = 4;
const REFUSED: u32 = 5;
const MARKS: u32 = 6;

/// One event, with the format's names of its fields.
#[derive(Serialize, Debug)]
struct TraceEvent {
    name: String,
    /// Kind of event: X a span, i an instant, C a counter, M a name.
    ph: &'static str,
    /// In µs.
    ts: f64,
    #[serde(skip_serializing_if = "Option::is_none")]
    dur: Option<f64>,
    pid: u32,
    tid: u32,
    /// An instant's scope: t is its track.
    #[serde(skip_serializing_if = "Option::is_none")]
    s: Option<&'static str>,
    #[serde(skip_serializing_if = "serde_json::Map::is_empty")]
    args: serde_json::Map<String, serde_json::Value>,
}

impl TraceEvent {
    fn new(ph: &'static str, name: impl Into<String>, (pid, tid): (u32, u32), ts: f64) -> Self {
        // Times are accurate to a nanosecond; more digits are rounding noise.
        let ts = (ts * 1e3).round() / 1e3;
        Self { name: name.into(), ph, ts, dur: None, pid, tid, s: None, args: serde_json::Map::new() }
    }

    fn with(mut self, key: &str, value: impl Into<serde_json::Value>) -> Self {
        self.args.insert(key.to_owned(), value.into());
        self
    }
}

#[derive(Serialize, Debug)]
#[serde(rename_all = "camelCase")]
struct Timeline {
    display_time_unit: &'static str,
    trace_events: Vec<TraceEvent>,
}

/// Returns the timeline of a trace. `motions` are the names of the sequence's motions.
///
/// # Errors
///
/// None is known; the serialiser's interface allows for one.
pub fn json(trace: &Trace, motions: &[&str]) -> serde_json::Result<String> {
    json_of(&[TimelineStation { name: "", trace, motions, marks: &[] }])
}

/// Returns one timeline of all stations of a cell.
///
/// # Errors
///
/// None is known; the serialiser's interface allows for one.
pub fn json_of(stations: &[TimelineStation<'_>]) -> serde_json::Result<String> {
    let mut events = names();
    for (index, station) in (0..).zip(stations) {
        events.extend(names_of(Processes::of_station(index), station));
    }
    let mut start = 0.0;
    for execution_type in ExecutionType::ALL {
        let recorded: Vec<_> = (0..)
            .zip(stations)
            .filter_map(|(index, station)| {
                Some((Processes::of_station(index), station, station.trace.types.get(execution_type)?))
            })
            .collect();
        if recorded.is_empty() {
            continue;
        }
        let length = recorded.iter().map(|(.., recording)| length_us(recording)).fold(0.0, f64::max);
        let mut span = TraceEvent::new("X", execution_type.to_string(), (RUN, REPETITIONS), start);
        span.dur = Some(length);
        events.push(span);
        if recorded.iter().any(|(.., recording)| recording.is_cut_off()) {
            let mut mark = TraceEvent::new("i", "end of the recording", (RUN, REPETITIONS), start + length);
            mark.s = Some("t");
            events.push(mark);
        }
        for (of, station, recording) in recorded {
            gaps(&mut events, recording, start);
            plc(&mut events, of.plc, recording, start, start + length);
            robot(&mut events, of.robot, recording, start, start + length);
            executed(&mut events, of.robot, (recording, station.motions), start, start + length);
            waits(&mut events, of.plc, (recording, station.marks), start, start + length);
            frames(&mut events, of.cable, recording, start);
        }
        start += length + GAP_US;
    }
    serde_json::to_string(&Timeline { display_time_unit: "ms", trace_events: events }).map(|json| json + "\n")
}

/// Adds a span for each wait at a mark.
fn waits(
    events: &mut Vec<TraceEvent>,
    plc: u32,
    (recording, marks): (&Recording, &[u32]),
    start: f64,
    end: f64,
) {
    let mut open: Option<TraceEvent> = None;
    for scan in recording.plc_scans() {
        let at = start + scan.at_us as f64;
        let waits = !marks.is_empty() && scan.sample.marks_come > scan.sample.marks_passed;
        if waits && open.is_none() {
            let number = marks.get(scan.sample.marks_passed as usize);
            let name = number.map_or_else(|| "waits".to_owned(), |number| format!("waits at mark {number}"));
            open = Some(TraceEvent::new("X", name, (plc, MARKS), at));
        } else if !waits && let Some(mut ended) = open.take() {
            ended.dur = Some((at - ended.ts).max(0.0));
            events.push(ended);
        }
    }
    if let Some(mut last) = open {
        last.dur = Some((end - last.ts).max(0.0));
        events.push(last);
    }
}

/// Marks the start of a recording that lacks cycles.
fn gaps(events: &mut Vec<TraceEvent>, recording: &Recording, start: f64) {
    let [scans, cycles] = recording.gaps();
    if scans + cycles > 0 {
        let mut mark = TraceEvent::new("i", "cycles are missing in this recording", (RUN, GAPS), start)
            .with("scans", scans)
            .with("robot cycles", cycles);
        mark.s = Some("t");
        events.push(mark);
    }
}

fn process(pid: u32, name: &str) -> TraceEvent {
    TraceEvent::new("M", "process_name", (pid, 0), 0.0).with("name", name)
}

fn track(pid: u32, tid: u32, name: &str) -> TraceEvent {
    TraceEvent::new("M", "thread_name", (pid, tid), 0.0).with("name", name)
}

fn names() -> Vec<TraceEvent> {
    vec![
        process(RUN, "run"),
        track(RUN, REPETITIONS, "first repetition of each type"),
        track(RUN, GAPS, "what the recordings lack"),
    ]
}

fn names_of(of: Processes, station: &TimelineStation<'_>) -> Vec<TraceEvent> {
    let Processes { plc, robot, cable } = of;
    let named = |what: &str| format!("{what} {}", station.name).trim_end().to_owned();
    let mut names = vec![
        process(plc, &named("PLC")),
        track(plc, CYCLES, "scans"),
        track(plc, COMMAND, "command given"),
        track(plc, REFUSED, "images refused"),
        process(robot, &named("robot")),
        track(robot, CYCLES, "interpolation cycles"),
        track(robot, COMMAND, "command executed"),
        track(robot, STATE, "state"),
        track(robot, MOTION, "motion"),
        track(robot, REFUSED, "images refused"),
        process(cable, &named("cable")),
        track(cable, 1, "PLC sends"),
        track(cable, 2, "robot receives"),
        track(cable, 3, "robot sends"),
        track(cable, 4, "PLC receives"),
    ];
    if !station.marks.is_empty() {
        names.push(track(plc, MARKS, "waits at marks"));
    }
    names
}

fn frames(events: &mut Vec<TraceEvent>, cable: u32, recording: &Recording, start: f64) {
    for frame in recording.frames() {
        let track = match (frame.end, frame.sent) {
            (Side::A, true) => 1,
            (Side::B, false) => 2,
            (Side::B, true) => 3,
            (Side::A, false) => 4,
        };
        let mut event =
            TraceEvent::new("i", frame.name, (cable, track), start + frame.at_us).with("bytes", frame.bytes);
        event.s = Some("t");
        events.push(if frame.faulty { event.with("fault", true) } else { event });
    }
}

/// Returns the time from the start edge to the last recorded cycle.
fn length_us(recording: &Recording) -> f64 {
    let plc = recording.plc_scans().last().map_or(0.0, |scan| scan.at_us as f64);
    recording.robot_ticks().last().map_or(0.0, |tick| tick.at_ms * 1e3).max(plc)
}

fn plc(events: &mut Vec<TraceEvent>, plc: u32, recording: &Recording, start: f64, end: f64) {
    let scans = recording.plc_scans();
    for scan in scans {
        let at = start + scan.at_us as f64;
        let mut cycle = TraceEvent::new("i", "scan", (plc, CYCLES), at).with("scan", scan.sample.scan);
        cycle.s = Some("t");
        events.push(cycle);
    }
    let commands =
        scans.iter().map(|scan| (start + scan.at_us as f64, format!("command {}", scan.sample.command)));
    spans(events, (plc, COMMAND), commands, end);
    refused(events, plc, scans.iter().map(|scan| (start + scan.at_us as f64, scan.sample.altered)));
    let fill = scans.iter().map(|scan| (start + scan.at_us as f64, f64::from(scan.sample.in_slots)));
    counter(events, (plc, "motions in the slots"), fill);
    let written = scans.iter().map(|scan| (start + scan.at_us as f64, f64::from(scan.sample.written)));
    counter(events, (plc, "motions written"), written);
}

fn robot(events: &mut Vec<TraceEvent>, robot: u32, recording: &Recording, start: f64, end: f64) {
    // The robot has its own clock: a tick that began before the start edge is not part of the run.
    let ticks = || recording.robot_ticks().iter().filter(|tick| tick.at_ms >= 0.0);
    let at = move |at_ms: f64| start + at_ms * 1e3;
    for tick in ticks() {
        let mut cycle = TraceEvent::new("i", "tick", (robot, CYCLES), at(tick.at_ms))
            .with("executed", tick.sample.executed)
            .with("accepted", tick.sample.accepted);
        cycle.s = Some("t");
        events.push(cycle);
    }
    let commands = ticks().map(|tick| (at(tick.at_ms), format!("command {}", tick.sample.command)));
    spans(events, (robot, COMMAND), commands, end);
    refused(events, robot, ticks().map(|tick| (at(tick.at_ms), tick.sample.altered)));
    spans(
        events,
        (robot, STATE),
        ticks().map(|tick| (at(tick.at_ms), format!("{:?}", tick.sample.state))),
        end,
    );
    let speed = ticks().map(|tick| (at(tick.at_ms), f64::from(tick.sample.path_speed_mm_s)));
    counter(events, (robot, "path speed in mm/s"), speed);
    let queue = ticks().map(|tick| (at(tick.at_ms), f64::from(tick.sample.queued())));
    counter(events, (robot, "motions in the queue"), queue);
}

/// Adds a mark where a node refused an image because a byte was altered.
fn refused(events: &mut Vec<TraceEvent>, node: u32, samples: impl Iterator<Item = (f64, u64)>) {
    let mut before = None;
    for (at, altered) in samples {
        if before.replace(altered).is_some_and(|before| before < altered) {
            let mut mark = TraceEvent::new("i", "altered image refused", (node, REFUSED), at);
            mark.s = Some("t");
            events.push(mark);
        }
    }
}

/// Adds a span for each motion that the robot executes.
fn executed(
    events: &mut Vec<TraceEvent>,
    robot: u32,
    (recording, motions): (&Recording, &[&str]),
    start: f64,
    end: f64,
) {
    let mut place = Place::default();
    let mut open: Option<(usize, TraceEvent)> = None;
    let mut close = |open: &mut Option<(usize, TraceEvent)>, at: f64| {
        if let Some((_, mut span)) = open.take() {
            span.dur = Some((at - span.ts).max(0.0));
            events.push(span);
        }
    };
    for tick in recording.robot_ticks().iter().filter(|tick| tick.at_ms >= 0.0) {
        let index = place.follow(&tick.sample);
        if index == open.as_ref().map(|(open, _)| *open) {
            continue;
        }
        let at = start + tick.at_ms * 1e3;
        close(&mut open, at);
        open = index.and_then(|index| {
            let name = *motions.get(index)?;
            Some((index, TraceEvent::new("X", name, (robot, MOTION), at).with("number", index + 1)))
        });
    }
    close(&mut open, end);
}

/// Adds a span for each stretch in which the name is the same.
fn spans(
    events: &mut Vec<TraceEvent>,
    track: (u32, u32),
    samples: impl Iterator<Item = (f64, String)>,
    end: f64,
) {
    let mut open: Option<TraceEvent> = None;
    for (at, name) in samples {
        if open.as_ref().is_some_and(|open| open.name == name) {
            continue;
        }
        let next = TraceEvent::new("X", name, track, at);
        if let Some(mut ended) = open.replace(next) {
            ended.dur = Some(at - ended.ts);
            events.push(ended);
        }
    }
    if let Some(mut last) = open {
        last.dur = Some((end - last.ts).max(0.0));
        events.push(last);
    }
}

/// Adds a value whenever it changes.
fn counter(
    events: &mut Vec<TraceEvent>,
    (pid, name): (u32, &str),
    samples: impl Iterator<Item = (f64, f64)>,
) {
    let mut last = None;
    for (at, value) in samples {
        if last != Some(value) {
            last = Some(value);
            events.push(TraceEvent::new("C", name, (pid, 0), at).with("value", value));
        }
    }
}

#[cfg(test)]
mod tests;
