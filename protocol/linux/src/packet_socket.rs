//! Packet sockets: they receive all frames that pass an interface, in both directions, as the kernel sees them.
//!
//! An 802.1Q tag that the kernel removed from a received frame is put back.

use std::io;
use std::os::fd::AsRawFd as _;
use std::time::Duration;

use socket2::{Domain, Socket, Type};

use crate::socket_option::{self, ON};
use crate::{Interface, clock, plain, received_message};
use capture_file::{Packet, SNAP_LEN};

/// Receive buffer in bytes: the frames of about a second in which the reader is busy.
const RECEIVE_BUFFER: usize = 8 << 20;

/// Frames of every EtherType.
pub(crate) const ALL: u16 = libc::ETH_P_ALL as u16;

/// The bytes of a tag.
const TAG: usize = 4;

/// Room for a frame and for a tag that is put back.
pub(crate) struct FrameBuffer([u8; TAG + SNAP_LEN]);

impl FrameBuffer {
    pub(crate) const fn new() -> Self {
        Self([0; TAG + SNAP_LEN])
    }

    /// Returns where to write a frame: so far behind the start that a tag fits before it.
    pub(crate) fn room(&mut self) -> &mut [u8] {
        &mut self.0[TAG..]
    }

    /// Returns the first `len` bytes that were written to [`room`](Self::room), with `tag` (its EtherType and the
    /// TCI) inserted behind the addresses.
    pub(crate) fn frame(&mut self, len: usize, tag: Option<(u16, u16)>) -> &[u8] {
        const MACS: usize = 12;
        let end = (TAG + len).min(self.0.len());
        let Some((tpid, tci)) = tag.filter(|_| len >= MACS) else { return &self.0[TAG..end] };
        self.0.copy_within(TAG..TAG + MACS, 0);
        self.0[MACS..MACS + 2].copy_from_slice(&tpid.to_be_bytes());
        self.0[MACS + 2..MACS + TAG].copy_from_slice(&tci.to_be_bytes());
        &self.0[..end]
    }
}

/// Returns the tag that the kernel removed, from the status and the fields that it hands over with a frame.
pub(crate) fn removed_tag(status: u32, tpid: u16, tci: u16) -> Option<(u16, u16)> {
    let known = status & libc::TP_STATUS_VLAN_TPID_VALID != 0;
    (status & libc::TP_STATUS_VLAN_VALID != 0).then_some((if known { tpid } else { 0x8100 }, tci))
}

/// Opens a packet socket that receives frames of this EtherType on this interface and sends there; `prepare` sets its
/// options before it is bound. Needs `CAP_NET_RAW`.
pub(crate) fn open(
    interface: &Interface,
    ethertype: u16,
    prepare: impl FnOnce(&Socket) -> io::Result<()>,
) -> io::Result<Socket> {
    // A socket of protocol 0 receives nothing until it is bound, so no frame of another interface gets in before.
    let socket = Socket::new(Domain::PACKET, Type::RAW, None)?;
    prepare(&socket)?;
    let address = libc::sockaddr_ll {
        sll_family: libc::AF_PACKET as u16,
        sll_protocol: ethertype.to_be(),
        sll_ifindex: interface.index() as i32,
        ..plain::zeroed()
    };
    let len = size_of_val(&address) as libc::socklen_t;
    // SAFETY: the socket is open; the address is a whole `sockaddr_ll` and its true size is given.
    let bound = unsafe { libc::bind(socket.as_raw_fd(), (&raw const address).cast(), len) };
    if bound < 0 { Err(io::Error::last_os_error()) } else { Ok(socket) }
}

/// Sets the options that [`receive`] needs.
pub(crate) fn prepare_receive(socket: &Socket) -> io::Result<()> {
    // The size is a request: without CAP_NET_ADMIN the kernel limits it.
    let _ = socket.set_recv_buffer_size(RECEIVE_BUFFER);
    request_timestamps(socket)?;
    socket_option::set(socket, libc::SOL_PACKET, libc::PACKET_AUXDATA, &ON)
}

/// Makes the kernel report the instant at which each frame passed.
pub(crate) fn request_timestamps(socket: &Socket) -> io::Result<()> {
    socket_option::set(socket, libc::SOL_SOCKET, libc::SO_TIMESTAMPNS, &ON)
}

/// Waits for a frame.
pub(crate) fn receive<'a>(socket: &Socket, buffer: &'a mut FrameBuffer) -> io::Result<Packet<'a>> {
    let (mut since_1970, mut tag) = (None, None);
    let received = received_message::receive::<libc::sockaddr_ll>(socket, buffer.room(), 0, |control| {
        match control.kind {
            (libc::SOL_SOCKET, libc::SCM_TIMESTAMPNS) => {
                let time = plain::read::<libc::timespec>(control.data);
                since_1970 = time.map(|time| Duration::new(time.tv_sec as u64, time.tv_nsec as u32));
            }
            (libc::SOL_PACKET, libc::PACKET_AUXDATA) => {
                let aux = plain::read::<libc::tpacket_auxdata>(control.data);
                tag = aux.and_then(|aux| removed_tag(aux.tp_status, aux.tp_vlan_tpid, aux.tp_vlan_tci));
            }
            _ => {}
        }
    })?;
    Ok(Packet {
        since_1970: since_1970.unwrap_or_else(clock::utc),
        sent: Some(received.from.sll_pkttype == libc::PACKET_OUTGOING),
        data: buffer.frame(received.len, tag),
        comment: None,
    })
}
