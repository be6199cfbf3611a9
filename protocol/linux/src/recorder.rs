//! Records what passes an interface into a pcapng file, or shows it to somebody, from a thread and a socket of its own.
//!
//! It sees both directions as the kernel has them, so that it witnesses what the node really put on the wire.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use socket2::{SockFilter, Socket};

use machine::Instant;

use crate::Interface;
use crate::capture::{CaptureFile, Keep, Packet};
use crate::clock;
use crate::packet_ring::PacketRing;
use crate::packet_socket::FrameBuffer;

/// Frames that may wait while the disk is busy: two seconds of one a millisecond each way.
const SLOTS: usize = 4_096;

/// How long the thread sleeps when it has taken all frames that are there. Were it woken by every frame, the node that
/// sends the frame would do the waking, within its cycle; and each time that it wakes by itself takes the processor from
/// others for longer than the frames that it then takes.
const REST: Duration = Duration::from_millis(50);

/// Frames are on disk after so many rests even if the process is killed.
const FLUSH_EVERY: u32 = 2;

/// Why a capture could not be made.
#[derive(Debug, thiserror::Error)]
pub enum RecorderError {
    /// The file could not be made or written.
    #[error("cannot write the capture {}: {source}", path.display())]
    File {
        /// The capture.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The interface could not be listened on.
    #[error("cannot capture on {interface}: {source} (captures need CAP_NET_RAW)")]
    Socket {
        /// The interface.
        interface: String,
        /// What the system said.
        source: io::Error,
    },
    /// The disk could not keep up with the cable.
    #[error(
        "{frames} frames are missing in what was recorded: the disk or the host was too busy to take them"
    )]
    LeftOut {
        /// How many.
        frames: u64,
    },
}

/// A capture that is running.
#[derive(Debug)]
pub struct Recorder {
    shared: Arc<Shared>,
    socket: Socket,
    thread: JoinHandle<Result<u64, RecorderError>>,
}

impl Recorder {
    /// Starts to record what passes `interface` into the new file `path`, with a comment on the interface.
    pub fn start(interface: &Interface, path: &Path, about: &str, keep: Keep) -> Result<Self, RecorderError> {
        let capture = CaptureFile::create(path, interface.name(), about, keep)
            .map_err(|source| RecorderError::File { path: path.to_owned(), source })?;
        Self::start_with(interface, capture)
    }

    /// Starts to show what passes `interface` to `see`, each frame with its instant by [`clock::now`]. Nothing is kept.
    pub fn watch(
        interface: &Interface,
        see: impl FnMut(Instant, &Packet<'_>) + Send + 'static,
    ) -> Result<Self, RecorderError> {
        Self::start_with(interface, Watcher(see))
    }

    fn start_with(interface: &Interface, listener: impl Listener + 'static) -> Result<Self, RecorderError> {
        let no_socket = |source| RecorderError::Socket { interface: interface.name().to_owned(), source };
        let ring = PacketRing::open(interface, SLOTS).map_err(no_socket)?;
        let socket = ring.socket().try_clone().map_err(no_socket)?;
        let shared = Arc::new(Shared::default());
        let recording =
            Recording { ring, listener, shared: Arc::clone(&shared), interface: interface.name().to_owned() };
        let thread = std::thread::Builder::new()
            .name("recorder".to_owned())
            .spawn(move || recording.run())
            .map_err(|source| RecorderError::Socket { interface: "a thread".to_owned(), source })?;
        Ok(Self { shared, socket, thread })
    }

    /// Lets frames pass without recording them, or records again. While paused, the kernel hands the recorder nothing:
    /// it costs next to nothing then.
    ///
    /// # Errors
    ///
    /// What the kernel says; it goes on as before then.
    pub fn pause(&self, paused: bool) -> io::Result<()> {
        if paused {
            // A program of one instruction: keep no byte of the packet.
            self.socket.attach_filter(&[SockFilter::new((libc::BPF_RET | libc::BPF_K) as u16, 0, 0, 0)])
        } else {
            // Where there is none, it has not been paused.
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
    /// Not all that passed is in it.
    pub fn stop(self) -> Result<u64, RecorderError> {
        self.shared.stop.store(true, Ordering::Release);
        self.thread.thread().unpark();
        self.thread.join().unwrap_or(Ok(0))
    }

    /// Ends the capture; where it is kept in memory until the end, nothing is written.
    pub fn discard(self) -> Result<(), RecorderError> {
        self.shared.discard.store(true, Ordering::Release);
        self.stop().map(drop)
    }
}

/// What the recorder is told.
#[derive(Debug, Default)]
struct Shared {
    stop: AtomicBool,
    discard: AtomicBool,
}

/// Who hears of each frame, on the recorder's thread.
trait Listener: Send {
    fn hear(&mut self, packet: &Packet<'_>) -> Result<(), RecorderError>;

    /// Some time has passed: what was heard is to outlive the process.
    fn flush(&mut self) -> Result<(), RecorderError> {
        Ok(())
    }

    /// The end; returns how many frames were heard of.
    fn finish(self) -> Result<u64, RecorderError>;
}

impl Listener for CaptureFile {
    fn hear(&mut self, packet: &Packet<'_>) -> Result<(), RecorderError> {
        self.write(packet).map_err(|source| RecorderError::File { path: self.path().to_owned(), source })
    }

    fn flush(&mut self) -> Result<(), RecorderError> {
        Self::flush(self).map_err(|source| RecorderError::File { path: self.path().to_owned(), source })
    }

    fn finish(self) -> Result<u64, RecorderError> {
        let path = self.path().to_owned();
        self.finish().map_err(|source| RecorderError::File { path, source })
    }
}

struct Watcher<F>(F);

impl<F: FnMut(Instant, &Packet<'_>) + Send> Listener for Watcher<F> {
    fn hear(&mut self, packet: &Packet<'_>) -> Result<(), RecorderError> {
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
    shared: Arc<Shared>,
    interface: String,
}

impl<L: Listener> Recording<L> {
    fn run(mut self) -> Result<u64, RecorderError> {
        let mut buffer = FrameBuffer::new();
        for rest in 1.. {
            // Asked first, so that all that passed before the end is taken.
            let is_last = self.shared.stop.load(Ordering::Acquire);
            if self.shared.discard.load(Ordering::Acquire) {
                break;
            }
            while let Some(packet) = self.ring.take(&mut buffer) {
                self.listener.hear(&packet)?;
            }
            if is_last {
                let whole = self.is_whole();
                return self.listener.finish().and_then(|heard| whole.map(|()| heard));
            }
            if rest % FLUSH_EVERY == 0 {
                self.listener.flush()?;
            }
            std::thread::park_timeout(REST);
        }
        Ok(0)
    }

    /// Whether all that passed so far was heard.
    fn is_whole(&self) -> Result<(), RecorderError> {
        match self.ring.left_out() {
            Ok(0) => Ok(()),
            Ok(frames) => Err(RecorderError::LeftOut { frames }),
            Err(source) => Err(RecorderError::Socket { interface: self.interface.clone(), source }),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc;

    use super::*;
    use crate::test_cable::{self, TestCable};

    #[test]
    fn a_listener_that_is_busy_for_too_long_is_told_how_many_frames_it_missed() {
        let cable = TestCable::lay();
        let (go, wait) = mpsc::channel::<()>();
        let (tell, heard) = mpsc::channel();
        let see = move |_, packet: &Packet<'_>| {
            if let Some(number) = test_cable::number(packet.data) {
                let _ = tell.send(number);
                let _ = wait.recv();
            }
        };
        let recorder = cable.near("near0", |near| Recorder::watch(near, see).unwrap());
        cable.send(0..1, &[]);
        assert_eq!(heard.recv(), Ok(0));
        let more = SLOTS as u32 + 100;
        cable.send(1..1 + more, &[]);
        drop(go);
        let missed = match recorder.stop() {
            Err(RecorderError::LeftOut { frames }) => frames,
            other => panic!("{other:?}"),
        };
        let heard: Vec<_> = heard.iter().collect();
        assert_eq!(heard, Vec::from_iter(1..=heard.len() as u32));
        // Where IPv6 cannot be switched off, the kernel's own frames may be among those missed and those heard.
        assert!((100..120).contains(&missed), "{missed}");
        assert!(heard.len() as u64 + missed >= u64::from(more));
    }

    #[test]
    fn nothing_is_heard_of_other_interfaces_nor_while_it_is_paused() {
        let cable = TestCable::lay();
        let listen = |name| {
            let (tell, heard) = mpsc::channel();
            let see = move |_, packet: &Packet<'_>| {
                let _ = test_cable::number(packet.data).map(|number| tell.send(number));
            };
            (cable.near(name, |interface| Recorder::watch(interface, see).unwrap()), heard)
        };
        cable.near("lo", |loopback| loopback.set_up().unwrap());
        let ((recorder, heard), (elsewhere, heard_elsewhere)) = (listen("near0"), listen("lo"));
        cable.send(1..2, &[]);
        recorder.pause(true).unwrap();
        cable.send(2..3, &[]);
        recorder.pause(false).unwrap();
        cable.send(3..4, &[]);
        recorder.stop().unwrap();
        elsewhere.stop().unwrap();
        assert_eq!(heard.iter().collect::<Vec<_>>(), [1, 3]);
        assert_eq!(heard_elsewhere.iter().next(), None);
    }
}
