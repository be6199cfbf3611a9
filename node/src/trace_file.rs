//! Writes each cycle of a node into a file: a wait-free ring from the cyclic thread to a writing thread.

use std::fs::File;
use std::io::{self, BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;
use std::time::Duration;

use machine::Instant;
use protocol_linux::handover::{self, Received, Sender};

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

/// The cyclic thread's end of the ring.
#[derive(Debug)]
pub(crate) struct TraceRing<S> {
    samples: Sender<(Instant, S)>,
    recording: bool,
    last: Option<u64>,
}

impl<S> TraceRing<S> {
    pub(crate) const fn record(&mut self, on: bool) {
        self.recording = on;
    }

    /// Sends a sample if there was a cycle since the last one. If the ring is full, the sample is dropped.
    pub(crate) fn record_cycle(&mut self, cycle: u64, sample: impl FnOnce() -> (Instant, S)) {
        if self.recording && self.last != Some(cycle) {
            self.last = Some(cycle);
            let _ = self.samples.send(sample());
        }
    }
}

/// The writing thread.
#[derive(Debug)]
pub(crate) struct TraceWriter {
    thread: JoinHandle<Result<(), TraceError>>,
}

impl TraceWriter {
    /// Waits until everything is written. The ring's other end must have been dropped.
    pub(crate) fn finish(self) -> Result<(), TraceError> {
        self.thread.join().unwrap_or(Ok(()))
    }
}

/// Starts a writer, which makes the file `path` and writes each sample into it as a row.
pub(crate) fn start<S: TraceSample>(path: &Path) -> Result<(TraceRing<S>, TraceWriter), TraceError> {
    let broken = |path: &Path| {
        let path = path.to_owned();
        move |reason| TraceError { path, reason }
    };
    let mut file = BufWriter::new(File::create(path).map_err(broken(path))?);
    let (samples, mut waiting) = handover::ring::<(Instant, S)>(RING_CAPACITY);
    let path = path.to_owned();
    let of_thread = path.clone();
    let body = move || {
        let mut line = String::new();
        loop {
            match waiting.take() {
                Received::Item((at, sample)) => {
                    line.clear();
                    write_row(at, &sample, &mut line);
                    line.push('\n');
                    file.write_all(line.as_bytes()).map_err(broken(&of_thread))?;
                }
                Received::Nothing => {
                    // Flushed, so that a killed node does not lose the cycles that led to it.
                    file.flush().map_err(broken(&of_thread))?;
                    std::thread::sleep(EMPTY_EVERY);
                }
                Received::Ended => return file.flush().map_err(broken(&of_thread)),
            }
        }
    };
    let thread = std::thread::Builder::new().name("trace".to_owned()).spawn(body).map_err(broken(&path))?;
    Ok((TraceRing { samples, recording: false, last: None }, TraceWriter { thread }))
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
    fn each_cycle_is_a_line_once_while_it_is_recorded() {
        let path = std::env::temp_dir().join(format!("trace-file-{}", std::process::id()));
        let (mut ring, writer) = start(&path).unwrap();
        for (cycle, on) in [(1, false), (2, true), (2, true), (3, true), (4, false)] {
            ring.record(on);
            ring.record_cycle(cycle, || (Instant::from_nanos(cycle * 10), Cycle(cycle)));
        }
        drop(ring);
        writer.finish().unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "20,2\n30,3\n");
        std::fs::remove_file(&path).unwrap();
    }
}
