//! Writes each cycle of a node into a file for each of its stations: wait-free rings from the cyclic thread to a writing thread.

use std::ffi::OsStr;
use std::fs::File;
use std::io::{self, BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;
use std::time::Duration;

use machine::Instant;
use protocol_linux::handover::{self, Received, Receiver, Sender};

use crate::trace_row::{TraceSample, write_row};

/// Samples that the ring holds: four seconds at a cycle of 1 ms.
const RING_CAPACITY: usize = 4_096;

/// Interval at which the writer empties the ring. Waking it for each cycle would be a system call per cycle.
const EMPTY_EVERY: Duration = Duration::from_millis(100);

/// Why cycles cannot be recorded.
#[derive(Debug, thiserror::Error)]
#[error("cannot write the trace {}: {reason}", path.display())]
pub struct TraceError {
    path: PathBuf,
    reason: io::Error,
}

/// The cyclic thread's ends of the rings.
#[derive(Debug)]
pub(crate) struct TraceRing<S> {
    /// One for each station.
    samples: Vec<Sender<(Instant, S)>>,
    recording: bool,
    last: Option<u64>,
}

impl<S> TraceRing<S> {
    pub(crate) const fn record(&mut self, on: bool) {
        self.recording = on;
    }

    /// Sends a sample of each station if there was a cycle since the last one. Where a ring is full, the sample is dropped.
    pub(crate) fn record_cycle(&mut self, cycle: u64, sample: impl Fn(usize) -> (Instant, S)) {
        if self.recording && self.last != Some(cycle) {
            self.last = Some(cycle);
            for (station, samples) in self.samples.iter_mut().enumerate() {
                let _ = samples.send(sample(station));
            }
        }
    }
}

/// The writing thread.
#[derive(Debug)]
pub(crate) struct TraceWriter {
    thread: JoinHandle<Result<(), TraceError>>,
}

impl TraceWriter {
    /// Waits until everything is written. The rings' other ends must have been dropped.
    pub(crate) fn finish(self) -> Result<(), TraceError> {
        self.thread.join().unwrap_or(Ok(()))
    }
}

/// Returns the files of these stations, `NAME-STATION.EXTENSION`; without any it is the file itself.
pub(crate) fn of_stations(path: &Path, stations: &[String]) -> Vec<PathBuf> {
    if stations.is_empty() {
        return vec![path.to_owned()];
    }
    let text = |part: Option<&OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
    let (stem, extension) = (text(path.file_stem()), text(path.extension()));
    stations.iter().map(|station| path.with_file_name(format!("{stem}-{station}.{extension}"))).collect()
}

/// The writing thread's end of a ring, and its file.
struct StationRows<S> {
    samples: Receiver<(Instant, S)>,
    file: BufWriter<File>,
    path: PathBuf,
}

impl<S: TraceSample> StationRows<S> {
    /// Writes what the ring holds. Returns whether its other end was dropped.
    fn write(&mut self, line: &mut String) -> Result<bool, TraceError> {
        let broken = |path: &Path| {
            let path = path.to_owned();
            move |reason| TraceError { path, reason }
        };
        loop {
            match self.samples.take() {
                Received::Item((at, sample)) => {
                    line.clear();
                    write_row(at, &sample, line);
                    line.push('\n');
                    self.file.write_all(line.as_bytes()).map_err(broken(&self.path))?;
                }
                end @ (Received::Nothing | Received::Ended) => {
                    // Flushed, so that a killed node does not lose the cycles that led to it.
                    self.file.flush().map_err(broken(&self.path))?;
                    return Ok(matches!(end, Received::Ended));
                }
            }
        }
    }
}

/// Starts a writer, which makes these files, one for each station, and writes each sample into its own as a row.
pub(crate) fn start<S: TraceSample>(paths: &[PathBuf]) -> Result<(TraceRing<S>, TraceWriter), TraceError> {
    let (mut senders, mut rows) = (Vec::with_capacity(paths.len()), Vec::with_capacity(paths.len()));
    for path in paths {
        let file = File::create(path).map_err(|reason| TraceError { path: path.clone(), reason })?;
        let (sender, samples) = handover::ring::<(Instant, S)>(RING_CAPACITY);
        senders.push(sender);
        rows.push(StationRows { samples, file: BufWriter::new(file), path: path.clone() });
    }
    let body = move || {
        let mut line = String::new();
        loop {
            let mut is_done = true;
            for of_station in &mut rows {
                is_done &= of_station.write(&mut line)?;
            }
            if is_done {
                return Ok(());
            }
            std::thread::sleep(EMPTY_EVERY);
        }
    };
    let thread = std::thread::Builder::new().name("trace".to_owned()).spawn(body);
    let path = || paths.first().cloned().unwrap_or_default();
    let thread = thread.map_err(|reason| TraceError { path: path(), reason })?;
    Ok((TraceRing { samples: senders, recording: false, last: None }, TraceWriter { thread }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace_row::Fields;
    use std::fmt::Write as _;

    #[derive(Clone, Copy, Debug)]
    struct Cycle(u64);

    impl TraceSample for Cycle {
        const COLUMNS: &'static str = "cycle";

        fn write(&self, line: &mut String) {
            let _ = write!(line, "{}", self.0);
        }

        fn read(fields: &mut Fields<'_>) -> Option<Self> {
            fields.value().map(Self)
        }
    }

    #[test]
    fn each_cycle_is_a_line_once_while_it_is_recorded_in_the_file_of_each_station() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("trace-file.rows");
        let names = ["left".to_owned(), "right".to_owned()];
        let paths = of_stations(&path, &names);
        let (mut ring, writer) = start(&paths).unwrap();
        for (cycle, on) in [(1, false), (2, true), (2, true), (3, true), (4, false)] {
            ring.record(on);
            ring.record_cycle(cycle, |station| {
                (Instant::from_nanos(cycle * 10), Cycle(cycle + 100 * station as u64))
            });
        }
        drop(ring);
        writer.finish().unwrap();
        let texts = paths.iter().map(|path| std::fs::read_to_string(path).unwrap()).collect::<Vec<_>>();
        assert_eq!(texts, ["20,2\n30,3\n", "20,102\n30,103\n"]);
    }

    #[test]
    fn the_only_station_has_the_file_itself_and_several_have_their_names_in_theirs() {
        let path = Path::new("run/trace-plc.rows");
        assert_eq!(of_stations(path, &[]), [path]);
        assert_eq!(of_stations(path, &["b-2".to_owned()]), [Path::new("run/trace-plc-b-2.rows")]);
    }
}
