//! Who hears of what passes the ends of an impaired cable, and of what was done to it: a wait-free ring from the thread that
//! passes frames on to one that writes them down.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::JoinHandle;
use std::time::Duration;

use machine::Instant;
use virtual_time::{Fate, Side};

use super::Shared;
use super::middle::ROOM;
use crate::RecorderError;
use crate::capture::{CaptureFile, Note, Packet};

/// Entries that may wait: half a second of two frames a millisecond each way, seen at both ends.
const RING_CAPACITY: usize = 4_096;

/// How often the ring is emptied. Nobody wakes the writer: that would be a system call for each frame.
const EMPTY_EVERY: Duration = Duration::from_millis(10);

/// Takes each frame with its instant by [`crate::clock::now`]; the comment says what the cable did to it.
pub type See = Box<dyn FnMut(Instant, &Packet<'_>) + Send>;

/// Who hears of what passes one end.
#[derive(Default)]
pub struct Witness {
    /// Keeps it, with a comment at each fault.
    pub capture: Option<CaptureFile>,
    /// Looks at it.
    pub see: Option<See>,
}

impl std::fmt::Debug for Witness {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Witness").field("capture", &self.capture).finish_non_exhaustive()
    }
}

/// A frame at an end of the cable.
#[derive(Clone, Copy)]
pub(super) struct Passed {
    pub(super) at: Instant,
    pub(super) since_1970: Duration,
    pub(super) end: Side,
    /// Whether the node at this end sent it.
    pub(super) sent: bool,
    pub(super) fate: Fate,
}

#[expect(clippy::large_enum_variant, reason = "a box would be an allocation on the cyclic thread")]
enum Entry {
    Passed { passed: Passed, len: usize, frame: [u8; ROOM] },
    Note(Note),
}

/// The cyclic thread's end of the ring; it has none where nobody wants to hear.
pub(super) struct Teller {
    entries: Option<rtrb::Producer<Entry>>,
    shared: Arc<Shared>,
}

impl Teller {
    /// Tells of a frame. Where the writer is far behind, it is left out and counted.
    pub(super) fn passed(&mut self, passed: Passed, bytes: &[u8]) {
        let Some(entries) = &mut self.entries else { return };
        if self.shared.paused.load(Ordering::Relaxed) {
            return;
        }
        let mut frame = [0; ROOM];
        let len = bytes.len().min(ROOM);
        if let (Some(to), Some(from)) = (frame.get_mut(..len), bytes.get(..len)) {
            to.copy_from_slice(from);
        }
        if entries.push(Entry::Passed { passed, len, frame }).is_err() {
            self.shared.left_out.fetch_add(1, Ordering::Relaxed);
        }
    }

    pub(super) fn note(&mut self, note: Note) {
        if let Some(entries) = &mut self.entries {
            let _ = entries.push(Entry::Note(note));
        }
    }
}

/// The thread that writes; none where nobody wants to hear.
#[derive(Debug)]
pub(super) struct Writer(Option<JoinHandle<Result<(), RecorderError>>>);

impl Writer {
    /// Waits until all is written. The teller must be gone.
    pub(super) fn finish(self) -> Result<(), RecorderError> {
        self.0.map_or(Ok(()), |thread| thread.join().unwrap_or(Ok(())))
    }
}

/// Starts a writer for these witnesses.
pub(super) fn start(witnesses: [Witness; 2], shared: &Arc<Shared>) -> std::io::Result<(Teller, Writer)> {
    let shared = Arc::clone(shared);
    if witnesses.iter().all(|witness| witness.capture.is_none() && witness.see.is_none()) {
        return Ok((Teller { entries: None, shared }, Writer(None)));
    }
    let (entries, mut waiting) = rtrb::RingBuffer::new(RING_CAPACITY);
    let mut ends = witnesses.map(|witness| End { witness, note: None });
    let of_thread = Arc::clone(&shared);
    let body = move || {
        let mut result = Ok(());
        loop {
            // Asked before the ring is emptied: what came before the end is still in it.
            let last = waiting.is_abandoned();
            while let Ok(entry) = waiting.pop() {
                let heard = hear(&mut ends, &entry);
                // One that cannot be written ends the captures; the cable goes on.
                if result.is_ok() && heard.is_err() {
                    result = heard;
                    ends.iter_mut().for_each(|end| end.witness.capture = None);
                }
            }
            let captures = ends.iter_mut().filter_map(|end| end.witness.capture.as_mut());
            let flushed = captures.map(|capture| capture.flush().map_err(|error| broken(capture, error)));
            result = result.and(flushed.collect());
            if last {
                break;
            }
            std::thread::sleep(EMPTY_EVERY);
        }
        let left_out = of_thread.left_out.load(Ordering::Relaxed);
        for End { witness, .. } in ends {
            let Some(capture) = witness.capture.filter(|_| !of_thread.discard.load(Ordering::Relaxed)) else {
                continue;
            };
            let path = capture.path().to_owned();
            let finished = capture.finish().map(drop).map_err(|source| RecorderError::File { path, source });
            result = result.and(finished);
        }
        if left_out > 0 { result.and(Err(RecorderError::LeftOut { frames: left_out })) } else { result }
    };
    let thread = std::thread::Builder::new().name("witness".to_owned()).spawn(body)?;
    Ok((Teller { entries: Some(entries), shared }, Writer(Some(thread))))
}

struct End {
    witness: Witness,
    /// A comment for the next frame.
    note: Option<String>,
}

fn hear(ends: &mut [End; 2], entry: &Entry) -> Result<(), RecorderError> {
    match entry {
        Entry::Note(note) => {
            for end in ends {
                let before = end.note.take().map_or_else(String::new, |before| before + "; ");
                end.note = Some(before + &note.to_string());
            }
            Ok(())
        }
        Entry::Passed { passed: Passed { at, since_1970, end, sent, fate }, len, frame } => {
            let End { witness, note } = &mut ends[end.index()];
            let fault = (!fate.is_clean()).then(|| fate.to_string());
            let data = frame.get(..*len).unwrap_or_default();
            let packet =
                Packet { since_1970: *since_1970, sent: Some(*sent), data, comment: fault.as_deref() };
            if let Some(see) = &mut witness.see {
                see(*at, &packet);
            }
            let Some(capture) = &mut witness.capture else { return Ok(()) };
            let comment = match (note.take(), &fault) {
                (Some(note), Some(fault)) => Some(format!("{note}; {fault}")),
                (note, fault) => note.or_else(|| fault.clone()),
            };
            capture
                .write(&Packet { comment: comment.as_deref(), ..packet })
                .map_err(|error| broken(capture, error))
        }
    }
}

fn broken(capture: &CaptureFile, source: std::io::Error) -> RecorderError {
    RecorderError::File { path: capture.path().to_owned(), source }
}
