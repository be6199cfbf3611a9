//! Packet sockets, and what hears all that passes an interface, in both directions as the kernel has it.
//!
//! An 802.1Q tag that the kernel took off a received frame is put back.

use std::io::{self, IoSliceMut};
use std::os::fd::{AsFd, AsRawFd as _};
use std::time::{Duration, SystemTime};

use socket2::{Domain, Socket, Type};

use crate::Interface;
use crate::capture::{Packet, SNAP_LEN};
use crate::socket_option::{self, ON};

/// Room for the frames of about a second while the reader is busy, in bytes.
const RECEIVE_BUFFER: usize = 8 << 20;

/// The bytes of a tag.
const TAG: usize = 4;

/// Room for a frame, and for a tag that is put back.
pub(crate) struct FrameBuffer([u8; TAG + SNAP_LEN]);

impl FrameBuffer {
    pub(crate) const fn new() -> Self {
        Self([0; TAG + SNAP_LEN])
    }

    /// Where a frame goes in: so much further on that a tag fits before it.
    pub(crate) fn room(&mut self) -> &mut [u8] {
        &mut self.0[TAG..]
    }

    /// The first `len` bytes that were put in, with the tag (its EtherType and what follows that) between the addresses
    /// and the rest.
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

/// The tag that the kernel took off, by the status and the fields that it tells beside a frame.
pub(crate) fn taken_off(status: u32, tpid: u16, tci: u16) -> Option<(u16, u16)> {
    let known = status & libc::TP_STATUS_VLAN_TPID_VALID != 0;
    (status & libc::TP_STATUS_VLAN_VALID != 0).then_some((if known { tpid } else { 0x8100 }, tci))
}

/// A socket that hears what passes `interface`, with the instant of each frame, once it is prepared. Needs `CAP_NET_RAW`.
pub(crate) fn open(
    interface: &Interface,
    prepare: impl FnOnce(&Socket) -> io::Result<()>,
) -> io::Result<Socket> {
    // Protocol 0 hears nothing until it is bound: so no frame of another interface gets in before that.
    let socket = Socket::new(Domain::PACKET, Type::RAW, None)?;
    socket_option::set(&socket, libc::SOL_SOCKET, libc::SO_TIMESTAMPNS, &ON)?;
    prepare(&socket)?;
    bind(&socket, interface, libc::ETH_P_ALL as u16)?;
    Ok(socket)
}

/// Prepares a socket for [`receive`].
pub(crate) fn prepare_receive(socket: &Socket) -> io::Result<()> {
    // The buffer is a wish: without CAP_NET_ADMIN the kernel cuts it to its limit.
    let _ = socket.set_recv_buffer_size(RECEIVE_BUFFER);
    socket_option::set(socket, libc::SOL_PACKET, libc::PACKET_AUXDATA, &ON)
}

/// Makes a packet socket hear frames of this EtherType on this interface, and send there.
pub(crate) fn bind(socket: impl AsFd, interface: &Interface, ethertype: u16) -> io::Result<()> {
    let address = libc::sockaddr_ll {
        sll_family: libc::AF_PACKET as u16,
        sll_protocol: ethertype.to_be(),
        sll_ifindex: interface.index() as i32,
        sll_hatype: 0,
        sll_pkttype: 0,
        sll_halen: 0,
        sll_addr: [0; 8],
    };
    let (socket, len) = (socket.as_fd().as_raw_fd(), size_of_val(&address) as libc::socklen_t);
    // SAFETY: the socket is open; the address is a whole `sockaddr_ll` and its true size is given.
    let bound = unsafe { libc::bind(socket, (&raw const address).cast(), len) };
    if bound < 0 { Err(io::Error::last_os_error()) } else { Ok(()) }
}

/// Waits for a frame.
pub(crate) fn receive<'a>(socket: &Socket, buffer: &'a mut FrameBuffer) -> io::Result<Packet<'a>> {
    let mut control = [0_u64; 16];
    let mut since_1970 = None;
    let mut tag = None;
    // SAFETY: all zero is a valid sockaddr_ll.
    let mut address: libc::sockaddr_ll = unsafe { std::mem::zeroed() };
    let len = {
        let mut slice = IoSliceMut::new(buffer.room());
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
                    tag = taken_off(aux.tp_status, aux.tp_vlan_tpid, aux.tp_vlan_tci);
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
    Ok(Packet { since_1970, sent, data: buffer.frame(len, tag), comment: None })
}
