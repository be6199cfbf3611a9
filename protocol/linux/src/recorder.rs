//! Records what passes an interface into a pcapng file, from a thread and a socket of its own.
//!
//! It sees both directions as the kernel has them, so that it witnesses what the node really put on the wire. An
//! 802.1Q tag that the kernel took off a received frame is put back.

use std::fs::File;
use std::io::{self, BufWriter, IoSliceMut};
use std::os::fd::AsRawFd;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, SystemTime};

use pcap_file::DataLink;
use pcap_file::pcapng::PcapNgWriter;
use pcap_file::pcapng::blocks::enhanced_packet::EnhancedPacketBlock;
use pcap_file::pcapng::blocks::interface_description::{
    InterfaceDescriptionBlock, InterfaceDescriptionOption,
};
use socket2::{Domain, Protocol, Socket, Type};

/// Room for the frames of about a second while the disk is busy, in bytes.
const RECEIVE_BUFFER: usize = 8 << 20;

/// Frames are on disk after this time even if the process is killed.
const FLUSH_AFTER: Duration = Duration::from_millis(100);

pub(crate) const SNAP_LEN: usize = 2048;

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
}

/// A capture that is running.
#[derive(Debug)]
pub struct Recorder {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Result<u64, RecorderError>>,
}

impl Recorder {
    /// Starts to record what passes `interface` into the new file `path`.
    pub fn start(interface: &str, path: &Path) -> Result<Self, RecorderError> {
        let no_file = |source| RecorderError::File { path: path.to_owned(), source };
        let no_socket = |source| RecorderError::Socket { interface: interface.to_owned(), source };
        let socket = open(interface).map_err(no_socket)?;
        let mut capture = Capture::create(path, interface).map_err(no_file)?;
        let stop = Arc::new(AtomicBool::new(false));
        let (stopped, path, interface) = (Arc::clone(&stop), path.to_owned(), interface.to_owned());
        let thread = std::thread::Builder::new()
            .name("recorder".to_owned())
            .spawn(move || {
                let mut frames = 0;
                let mut buf = [0; SNAP_LEN];
                while !stopped.load(Ordering::Relaxed) {
                    match receive(&socket, &mut buf) {
                        Ok(frame) => {
                            let written = capture.write(&frame);
                            written.map_err(|source| RecorderError::File { path: path.clone(), source })?;
                            frames += 1;
                        }
                        Err(error)
                            if matches!(
                                error.kind(),
                                io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut
                            ) =>
                        {
                            let flushed = capture.flush();
                            flushed.map_err(|source| RecorderError::File { path: path.clone(), source })?;
                        }
                        Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                        Err(source) => return Err(RecorderError::Socket { interface, source }),
                    }
                }
                capture.flush().map_err(|source| RecorderError::File { path, source })?;
                Ok(frames)
            })
            .map_err(|source| RecorderError::Socket { interface: "a thread".to_owned(), source })?;
        Ok(Self { stop, thread })
    }

    /// Ends the capture and returns how many frames are in it.
    pub fn stop(self) -> Result<u64, RecorderError> {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().unwrap_or(Ok(0))
    }
}

/// A pcapng file with one interface and times in nanoseconds.
struct Capture {
    writer: PcapNgWriter<BufWriter<File>>,
}

impl Capture {
    fn create(path: &Path, interface: &str) -> io::Result<Self> {
        let mut writer = PcapNgWriter::new(BufWriter::new(File::create(path)?)).map_err(io::Error::other)?;
        let nanoseconds = InterfaceDescriptionOption::IfTsResol(9);
        let name = InterfaceDescriptionOption::IfName(interface.to_owned().into());
        let description = InterfaceDescriptionBlock {
            linktype: DataLink::ETHERNET,
            snaplen: SNAP_LEN as u32,
            options: vec![name, nanoseconds],
        };
        writer.write_pcapng_block(description).map_err(io::Error::other)?;
        Ok(Self { writer })
    }

    fn write(&mut self, frame: &Received<'_>) -> io::Result<()> {
        let block = EnhancedPacketBlock {
            interface_id: 0,
            timestamp: frame.since_1970,
            original_len: frame.data.len() as u32,
            data: frame.data.into(),
            options: Vec::new(),
        };
        self.writer.write_pcapng_block(block).map(|_| ()).map_err(io::Error::other)
    }

    fn flush(&mut self) -> io::Result<()> {
        io::Write::flush(self.writer.get_mut())
    }
}

/// A frame as the kernel hands it over.
pub(crate) struct Received<'a> {
    pub(crate) since_1970: Duration,
    pub(crate) data: &'a [u8],
}

pub(crate) fn open(interface: &str) -> io::Result<Socket> {
    let all = (libc::ETH_P_ALL as u16).to_be();
    let socket = Socket::new(Domain::PACKET, Type::RAW, Some(Protocol::from(i32::from(all))))?;
    // The buffer is a wish: without CAP_NET_ADMIN the kernel cuts it to its limit.
    let _ = socket.set_recv_buffer_size(RECEIVE_BUFFER);
    socket.set_read_timeout(Some(FLUSH_AFTER))?;
    socket.bind_device(Some(interface.as_bytes()))?;
    set_flag(&socket, libc::SOL_SOCKET, libc::SO_TIMESTAMPNS)?;
    set_flag(&socket, libc::SOL_PACKET, libc::PACKET_AUXDATA)?;
    Ok(socket)
}

fn set_flag(socket: &Socket, level: libc::c_int, name: libc::c_int) -> io::Result<()> {
    let on: libc::c_int = 1;
    let len = size_of_val(&on) as libc::socklen_t;
    // SAFETY: `on` lives over the call and `len` is its size.
    let result = unsafe { libc::setsockopt(socket.as_raw_fd(), level, name, (&raw const on).cast(), len) };
    if result == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

/// Waits for a frame, and puts back a tag that the kernel took off.
pub(crate) fn receive<'a>(socket: &Socket, buf: &'a mut [u8; SNAP_LEN]) -> io::Result<Received<'a>> {
    const TAG: usize = 4;
    const MACS: usize = 12;
    let mut control = [0_u64; 16];
    let mut since_1970 = None;
    let mut tag = None;
    let len = {
        // The frame goes in four bytes further on, so that a tag fits before it.
        let mut slice = IoSliceMut::new(&mut buf[TAG..]);
        // SAFETY: all zero is a valid msghdr.
        let mut message: libc::msghdr = unsafe { std::mem::zeroed() };
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
    Ok(Received { since_1970, data: &buf[start..TAG + len] })
}
