//! Observers of an impaired cable: a wait-free ring carries each frame at each end, and what the cable did to it,
//! from the thread that passes frames on to a thread that records them.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::JoinHandle;
use std::time::Duration;

use machine::Instant;
use virtual_time::{LinkEffect, Side};

use super::Shared;
use super::forwarder::ROOM;
use crate::RecorderError;
use crate::handover::{Ending, Received, Sender, ring};
use capture_file::{CableEvent, CaptureFile, Packet};

/// Entries that the ring holds: half a second at two frames a millisecond each way, seen at both ends.
const RING_CAPACITY: usize = 4_096;

/// Interval at which the writer empties the ring. Waking it for each frame would be a system call per frame.
const EMPTY_EVERY: Duration = Duration::from_millis(10);

/// Called with each frame and its instant by [`crate::clock::now`]; the packet's comment says what the cable did to
/// it.
pub type FrameCallback = Box<dyn FnMut(Instant, &Packet<'_>) + Send>;

/// Capture and callback for the frames at one end.
#[derive(Default)]
pub struct Observer {
    /// Capture to write them to, with a comment at each fault.
    pub capture: Option<CaptureFile>,
    /// Callback to hand them to.
    pub see: Option<FrameCallback>,
}

impl std::fmt::Debug for Observer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Observer").field("capture", &self.capture).finish_non_exhaustive()
    }
}

/// A frame at an end of the cable.
#[derive(Clone, Copy)]
pub(super) struct ObservedFrame {
    pub(super) at: Instant,
    pub(super) since_1970: Duration,
    pub(super) end: Side,
    /// Whether the node at this end sent it.
    pub(super) sent: bool,
    pub(super) effect: LinkEffect,
}

#[expect(clippy::large_enum_variant, reason = "a box would be an allocation on the cyclic thread")]
enum ObservedEntry {
    ObservedFrame { passed: ObservedFrame, len: usize, frame: [u8; ROOM] },
    CableEvent(CableEvent),
}

/// The cyclic thread's end of the ring; without a ring if there is no observer.
pub(super) struct ObserverSender {
    entries: Option<Sender<ObservedEntry>>,
    shared: Arc<Shared>,
}

impl ObserverSender {
    /// Passes a frame to the writer. If the ring is full, the frame is left out and counted.
    pub(super) fn observe(&mut self, passed: ObservedFrame, bytes: &[u8]) {
        let Some(entries) = &mut self.entries else { return };
        if self.shared.paused.load(Ordering::Relaxed) {
            return;
        }
        let mut frame = [0; ROOM];
        let len = bytes.len().min(ROOM);
        if let (Some(to), Some(from)) = (frame.get_mut(..len), bytes.get(..len)) {
            to.copy_from_slice(from);
        }
        let _ = entries.send(ObservedEntry::ObservedFrame { passed, len, frame });
    }

    /// Adds a comment to the next frames. If the ring is full, it is left out and counts as a frame.
    pub(super) fn note(&mut self, note: CableEvent) {
        if let Some(entries) = &mut self.entries {
            let _ = entries.send(ObservedEntry::CableEvent(note));
        }
    }
}

/// The writing thread; none if there is no observer.
#[derive(Debug)]
pub(super) struct Writer(Option<JoinHandle<Result<(), RecorderError>>>);

impl Writer {
    /// Waits until everything is written. The ring's other end must have been dropped.
    pub(super) fn finish(self) -> Result<(), RecorderError> {
        self.0.map_or(Ok(()), |thread| thread.join().unwrap_or(Ok(())))
    }
}

/// Starts a writer for these observers.
pub(super) fn start(
    observers: [Observer; 2],
    shared: &Arc<Shared>,
) -> std::io::Result<(ObserverSender, Writer)> {
    let shared = Arc::clone(shared);
    if observers.iter().all(|observer| observer.capture.is_none() && observer.see.is_none()) {
        return Ok((ObserverSender { entries: None, shared }, Writer(None)));
    }
    let (entries, mut waiting) = ring(RING_CAPACITY);
    let mut ends = observers.map(|observer| End { observer, note: None });
    let writer_shared = Arc::clone(&shared);
    let body = move || {
        let mut result = Ok(());
        loop {
            let taken = waiting.take();
            if let Received::Item(entry) = &taken {
                let recorded = record(&mut ends, entry);
                // If a capture cannot be written, all captures end; the cable continues.
                if result.is_ok() && recorded.is_err() {
                    result = recorded;
                    ends.iter_mut().for_each(|end| end.observer.capture = None);
                }
                continue;
            }
            let captures = ends.iter_mut().filter_map(|end| end.observer.capture.as_mut());
            let flushed = captures.map(|capture| capture.flush().map_err(|error| broken(capture, error)));
            result = result.and(flushed.collect());
            if matches!(taken, Received::Ended) {
                break;
            }
            std::thread::sleep(EMPTY_EVERY);
        }
        let is_wanted = writer_shared.end.get() != Some(Ending::Discard);
        let left_out = waiting.dropped();
        for End { observer, .. } in ends {
            let Some(capture) = observer.capture.filter(|_| is_wanted) else { continue };
            let path = capture.path().to_owned();
            let finished = capture.finish().map(drop).map_err(|reason| RecorderError::File { path, reason });
            result = result.and(finished);
        }
        if left_out > 0 { result.and(Err(RecorderError::LeftOut { frames: left_out })) } else { result }
    };
    let thread = std::thread::Builder::new().name("observer".to_owned()).spawn(body)?;
    Ok((ObserverSender { entries: Some(entries), shared }, Writer(Some(thread))))
}

struct End {
    observer: Observer,
    /// Comment for the next frame.
    note: Option<String>,
}

fn record(ends: &mut [End; 2], entry: &ObservedEntry) -> Result<(), RecorderError> {
    match entry {
        ObservedEntry::CableEvent(note) => {
            for end in ends {
                let before = end.note.take().map_or_else(String::new, |before| before + "; ");
                end.note = Some(before + &note.to_string());
            }
            Ok(())
        }
        ObservedEntry::ObservedFrame {
            passed: ObservedFrame { at, since_1970, end, sent, effect },
            len,
            frame,
        } => {
            let End { observer, note } = &mut ends[end.index()];
            let fault = (!effect.is_clean()).then(|| effect.to_string());
            let data = frame.get(..*len).unwrap_or_default();
            let packet =
                Packet { since_1970: *since_1970, sent: Some(*sent), data, comment: fault.as_deref() };
            if let Some(see) = &mut observer.see {
                see(*at, &packet);
            }
            let Some(capture) = &mut observer.capture else { return Ok(()) };
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

fn broken(capture: &CaptureFile, reason: std::io::Error) -> RecorderError {
    RecorderError::File { path: capture.path().to_owned(), reason }
}
