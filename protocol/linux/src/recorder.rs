//! Records what passes an interface into a pcapng file, or hands it to a callback, from a thread and a socket of its
//! own.
//!
//! It sees both directions as the kernel has them: what the node really put on the cable.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use socket2::{SockFilter, Socket};

use machine::Instant;

use crate::Interface;
use crate::clock;
use crate::handover::{EndRequest, Ending};
use crate::packet_ring::PacketRing;
use crate::packet_socket::FrameBuffer;
use capture_file::{CaptureFile, Packet, Retention};

/// Frames that wait while the disk is busy: two seconds at one frame a millisecond each way.
const SLOTS: usize = 4_096;

/// Time that the thread sleeps once it has taken all frames. If every frame woke it, the sending node would do the
/// waking, within its cycle. It sleeps this long because each wake-up takes the processor from other threads for
/// longer than handling the frames does.
const SLEEP: Duration = Duration::from_millis(50);

/// Sleeps after which frames are written to disk, so that they survive a killed process.
const FLUSH_EVERY: u32 = 2;

/// Why a capture failed.
#[derive(Debug, thiserror::Error)]
pub enum RecorderError {
    /// The file could not be created or written.
    #[error("cannot write the capture {}: {reason}", path.display())]
    File {
        /// The capture.
        path: PathBuf,
        /// The system's error.
        reason: io::Error,
    },
    /// The interface could not be opened for listening.
    #[error("cannot capture on {interface}: {reason} (captures need CAP_NET_RAW)")]
    Socket {
        /// The interface.
        interface: String,
        /// The system's error.
        reason: io::Error,
    },
    /// The disk or the host was too slow for the frames.
    #[error("{frames} frames are missing in the recording: the disk or the host was too busy to take them")]
    LeftOut {
        /// How many are missing.
        frames: u64,
    },
}

/// A running capture.
#[derive(Debug)]
pub struct Recorder {
    end: Arc<EndRequest>,
    socket: Socket,
    thread: JoinHandle<Result<u64, RecorderError>>,
}

impl Recorder {
    /// Starts to record what passes `interface` into the new file `path`, with a comment on the interface.
    pub fn start(
        interface: &Interface,
        path: &Path,
        about: &str,
        retention: Retention,
    ) -> Result<Self, RecorderError> {
        let capture = CaptureFile::create(path, interface.name(), about, retention)
            .map_err(|reason| RecorderError::File { path: path.to_owned(), reason })?;
        Self::start_with(interface, capture)
    }

    /// Starts to hand what passes `interface` to `see`, each frame with its instant by [`clock::now`]. Nothing is
    /// stored.
    pub fn watch(
        interface: &Interface,
        see: impl FnMut(Instant, &Packet<'_>) + Send + 'static,
    ) -> Result<Self, RecorderError> {
        Self::start_with(interface, Watcher(see))
    }

    fn start_with(interface: &Interface, listener: impl Listener + 'static) -> Result<Self, RecorderError> {
        let no_socket = |reason| RecorderError::Socket { interface: interface.name().to_owned(), reason };
        let ring = PacketRing::open(interface, SLOTS).map_err(no_socket)?;
        let socket = ring.socket().try_clone().map_err(no_socket)?;
        let end = Arc::new(EndRequest::default());
        let recording =
            Recording { ring, listener, end: Arc::clone(&end), interface: interface.name().to_owned() };
        let thread = std::thread::Builder::new()
            .name("recorder".to_owned())
            .spawn(move || recording.run())
            .map_err(|reason| RecorderError::Socket { interface: "a thread".to_owned(), reason })?;
        Ok(Self { end, socket, thread })
    }

    /// Pauses or continues the recording. While it is paused, the kernel hands the recorder no frames, so it costs almost
    /// nothing.
    ///
    /// # Errors
    ///
    /// The kernel's error; the recorder then continues as before.
    pub fn pause(&self, paused: bool) -> io::Result<()> {
        if paused {
            // A filter program of one instruction: keep no byte of the packet.
            self.socket.attach_filter(&[SockFilter::new((libc::BPF_RET | libc::BPF_K) as u16, 0, 0, 0)])
        } else {
            // Without a filter it was not paused.
            let detached = self.socket.detach_filter();
            detached.or_else(|error| match error.kind() {
                io::ErrorKind::NotFound => Ok(()),
                _ => Err(error),
            })
        }
    }

    /// Ends the capture and returns how many frames are in it.
    ///
    /// # Errors
    ///
    /// Some frames that passed are missing.
    pub fn stop(self) -> Result<u64, RecorderError> {
        self.end(Ending::Keep)
    }

    /// Ends the capture. If it is kept in memory until the end, nothing is written.
    pub fn discard(self) -> Result<(), RecorderError> {
        self.end(Ending::Discard).map(drop)
    }

    fn end(self, ending: Ending) -> Result<u64, RecorderError> {
        self.end.set(ending);
        self.thread.thread().unpark();
        self.thread.join().unwrap_or(Ok(0))
    }
}

/// Receives each frame, on the recorder's thread.
trait Listener: Send {
    fn handle(&mut self, packet: &Packet<'_>) -> Result<(), RecorderError>;

    /// Writes out the frames so far, so that they survive a killed process. It is called regularly.
    fn flush(&mut self) -> Result<(), RecorderError> {
        Ok(())
    }

    /// Ends; returns how many frames it received.
    fn finish(self) -> Result<u64, RecorderError>;
}

impl Listener for CaptureFile {
    fn handle(&mut self, packet: &Packet<'_>) -> Result<(), RecorderError> {
        self.write(packet).map_err(|reason| RecorderError::File { path: self.path().to_owned(), reason })
    }

    fn flush(&mut self) -> Result<(), RecorderError> {
        Self::flush(self).map_err(|reason| RecorderError::File { path: self.path().to_owned(), reason })
    }

    fn finish(self) -> Result<u64, RecorderError> {
        let path = self.path().to_owned();
        self.finish().map_err(|reason| RecorderError::File { path, reason })
    }
}

struct Watcher<F>(F);

impl<F: FnMut(Instant, &Packet<'_>) + Send> Listener for Watcher<F> {
    fn handle(&mut self, packet: &Packet<'_>) -> Result<(), RecorderError> {
        (self.0)(clock::instant_of(packet.since_1970), packet);
        Ok(())
    }

    fn finish(self) -> Result<u64, RecorderError> {
        Ok(0)
    }
}

/// The recorder's thread.
struct Recording<L> {
    ring: PacketRing,
    listener: L,
    end: Arc<EndRequest>,
    interface: String,
}

impl<L: Listener> Recording<L> {
    fn run(mut self) -> Result<u64, RecorderError> {
        let mut buffer = FrameBuffer::new();
        for rest in 1.. {
            // Read before the frames, so that all that passed before the end is taken.
            let ending = self.end.get();
            if ending == Some(Ending::Discard) {
                break;
            }
            while let Some(packet) = self.ring.take(&mut buffer) {
                self.listener.handle(&packet)?;
            }
            if ending.is_some() {
                let whole = self.is_whole();
                return self.listener.finish().and_then(|frames| whole.map(|()| frames));
            }
            if rest % FLUSH_EVERY == 0 {
                self.listener.flush()?;
            }
            std::thread::park_timeout(SLEEP);
        }
        Ok(0)
    }

    /// Returns an error if frames were missed so far.
    fn is_whole(&self) -> Result<(), RecorderError> {
        match self.ring.left_out() {
            Ok(0) => Ok(()),
            Ok(frames) => Err(RecorderError::LeftOut { frames }),
            Err(reason) => Err(RecorderError::Socket { interface: self.interface.clone(), reason }),
        }
    }
}
