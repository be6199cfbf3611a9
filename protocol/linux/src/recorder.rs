//! Records what passes an interface into a pcapng file, or shows it to somebody, from a thread and a socket of its own.
//!
//! It sees both directions as the kernel has them, so that it witnesses what the node really put on the wire. An
//! 802.1Q tag that the kernel took off a received frame is put back.

use std::io::{self, IoSliceMut};
use std::os::fd::AsRawFd;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime};

use socket2::{Domain, Protocol, SockFilter, Socket, Type};

use protocol::Instant;

use crate::capture::{CaptureFile, Keep, Packet, SNAP_LEN};
use crate::clock;

/// Room for the frames of about a second while the disk is busy, in bytes.
const RECEIVE_BUFFER: usize = 8 << 20;

/// How long the thread sleeps when it has taken all frames that are there. Were it woken by every frame, the node that
/// sends the frame would do the waking, within its cycle.
const REST: Duration = Duration::from_millis(5);

/// Frames are on disk after so many rests even if the process is killed.
const FLUSH_EVERY: u32 = 20;

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
    #[error("{frames} frames are missing in the captures: the disk or the host was too busy to take them")]
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
    pub fn start(interface: &str, path: &Path, about: &str, keep: Keep) -> Result<Self, RecorderError> {
        let capture = CaptureFile::create(path, interface, about, keep)
            .map_err(|source| RecorderError::File { path: path.to_owned(), source })?;
        Self::start_with(interface, capture)
    }

    /// Starts to show what passes `interface` to `see`, each frame with its instant by [`clock::now`]. Nothing is kept.
    pub fn watch(
        interface: &str,
        see: impl FnMut(Instant, &Packet<'_>) + Send + 'static,
    ) -> Result<Self, RecorderError> {
        Self::start_with(interface, Watcher(see))
    }

    fn start_with(interface: &str, listener: impl Listener + 'static) -> Result<Self, RecorderError> {
        let no_socket = |source| RecorderError::Socket { interface: interface.to_owned(), source };
        let socket = open(interface).map_err(no_socket)?;
        socket.set_nonblocking(true).map_err(no_socket)?;
        let shared = Arc::new(Shared::default());
        let recorder = socket.try_clone().map_err(no_socket)?;
        let recording =
            Recording { socket, listener, shared: Arc::clone(&shared), interface: interface.to_owned() };
        let thread = std::thread::Builder::new()
            .name("recorder".to_owned())
            .spawn(move || recording.run())
            .map_err(|source| RecorderError::Socket { interface: "a thread".to_owned(), source })?;
        Ok(Self { shared, socket: recorder, thread })
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
    pub fn stop(self) -> Result<u64, RecorderError> {
        self.shared.stop.store(true, Ordering::Relaxed);
        self.thread.join().unwrap_or(Ok(0))
    }

    /// Ends the capture; where it is kept in memory until the end, nothing is written.
    pub fn discard(self) -> Result<(), RecorderError> {
        self.shared.discard.store(true, Ordering::Relaxed);
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
    socket: Socket,
    listener: L,
    shared: Arc<Shared>,
    interface: String,
}

impl<L: Listener> Recording<L> {
    fn run(mut self) -> Result<u64, RecorderError> {
        let mut rests = 0;
        loop {
            // Asked first, so that all that passed before the end is taken.
            let is_last = self.shared.stop.load(Ordering::Relaxed);
            if self.shared.discard.load(Ordering::Relaxed) {
                return Ok(0);
            }
            self.take_all()?;
            if is_last {
                return self.listener.finish();
            }
            std::thread::sleep(REST);
            rests += 1;
            if rests % FLUSH_EVERY == 0 {
                self.listener.flush()?;
            }
        }
    }

    /// Takes the frames that are there.
    fn take_all(&mut self) -> Result<(), RecorderError> {
        let mut buf = [0; SNAP_LEN];
        loop {
            match receive(&self.socket, &mut buf) {
                Ok(frame) => self.listener.hear(&frame)?,
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(()),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(source) => {
                    return Err(RecorderError::Socket { interface: self.interface.clone(), source });
                }
            }
        }
    }
}

pub(crate) fn open(interface: &str) -> io::Result<Socket> {
    let all = (libc::ETH_P_ALL as u16).to_be();
    let socket = Socket::new(Domain::PACKET, Type::RAW, Some(Protocol::from(i32::from(all))))?;
    // The buffer is a wish: without CAP_NET_ADMIN the kernel cuts it to its limit.
    let _ = socket.set_recv_buffer_size(RECEIVE_BUFFER);
    socket.bind_device(Some(interface.as_bytes()))?;
    set_flag(&socket, libc::SOL_SOCKET, libc::SO_TIMESTAMPNS)?;
    set_flag(&socket, libc::SOL_PACKET, libc::PACKET_AUXDATA)?;
    Ok(socket)
}

pub(crate) fn set_flag(socket: &Socket, level: libc::c_int, name: libc::c_int) -> io::Result<()> {
    let on: libc::c_int = 1;
    let len = size_of_val(&on) as libc::socklen_t;
    // SAFETY: `on` lives over the call and `len` is its size.
    let result = unsafe { libc::setsockopt(socket.as_raw_fd(), level, name, (&raw const on).cast(), len) };
    if result == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

/// Waits for a frame, and puts back a tag that the kernel took off.
pub(crate) fn receive<'a>(socket: &Socket, buf: &'a mut [u8; SNAP_LEN]) -> io::Result<Packet<'a>> {
    const TAG: usize = 4;
    const MACS: usize = 12;
    let mut control = [0_u64; 16];
    let mut since_1970 = None;
    let mut tag = None;
    // SAFETY: all zero is a valid sockaddr_ll.
    let mut address: libc::sockaddr_ll = unsafe { std::mem::zeroed() };
    let len = {
        // The frame goes in four bytes further on, so that a tag fits before it.
        let mut slice = IoSliceMut::new(&mut buf[TAG..]);
        // SAFETY: all zero is a valid msghdr.
        let mut message: libc::msghdr = unsafe { std::mem::zeroed() };
        message.msg_name = (&raw mut address).cast();
        message.msg_namelen = size_of_val(&address) as libc::socklen_t;
        message.msg_iov = (&raw mut slice).cast();
        message.msg_iovlen = 1;
        message.msg_control = control.as_mut_ptr().cast();
        message.msg_controllen = size_of_val(&control) as _;
        // SAFETY: the message points at buffers that live over the call, with their sizes; IoSliceMut has the
        // layout of iovec.
        let len = unsafe { libc::recvmsg(socket.as_raw_fd(), &raw mut message, 0) };
        let len = usize::try_from(len).map_err(|_| io::Error::last_os_error())?;
        // SAFETY: the kernel filled the control buffer and set its length; CMSG_NXTHDR stays within it.
        let mut header = unsafe { libc::CMSG_FIRSTHDR(&raw const message) };
        while !header.is_null() {
            // SAFETY: `header` points at a header within the control buffer, which is aligned for it.
            let (level, kind) = unsafe { ((*header).cmsg_level, (*header).cmsg_type) };
            // SAFETY: as above; the data follows its header.
            let data = unsafe { libc::CMSG_DATA(header) };
            match (level, kind) {
                (libc::SOL_SOCKET, libc::SCM_TIMESTAMPNS) => {
                    // SAFETY: a message of this type carries a timespec.
                    let time = unsafe { data.cast::<libc::timespec>().read_unaligned() };
                    since_1970 = Some(Duration::new(time.tv_sec as u64, time.tv_nsec as u32));
                }
                (libc::SOL_PACKET, libc::PACKET_AUXDATA) => {
                    // SAFETY: a message of this type carries a tpacket_auxdata.
                    let aux = unsafe { data.cast::<libc::tpacket_auxdata>().read_unaligned() };
                    if aux.tp_status & libc::TP_STATUS_VLAN_VALID != 0 {
                        let known = aux.tp_status & libc::TP_STATUS_VLAN_TPID_VALID != 0;
                        tag = Some((if known { aux.tp_vlan_tpid } else { 0x8100 }, aux.tp_vlan_tci));
                    }
                }
                _ => {}
            }
            // SAFETY: `message` and `header` are as the kernel left them.
            header = unsafe { libc::CMSG_NXTHDR(&raw const message, header) };
        }
        len
    };
    let sent = Some(address.sll_pkttype == libc::PACKET_OUTGOING);
    let since_1970 = since_1970
        .unwrap_or_else(|| SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default());
    let start = match tag {
        Some((tpid, tci)) if len >= MACS => {
            buf.copy_within(TAG..TAG + MACS, 0);
            buf[MACS..MACS + 2].copy_from_slice(&tpid.to_be_bytes());
            buf[MACS + 2..MACS + TAG].copy_from_slice(&tci.to_be_bytes());
            0
        }
        _ => TAG,
    };
    Ok(Packet { since_1970, sent, data: &buf[start..TAG + len], comment: None })
}
