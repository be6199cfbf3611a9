//! UDP over IPv4 on one interface.

use std::cell::Cell;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::os::fd::{AsFd, AsRawFd as _, BorrowedFd};

use rustix::io::Errno;
use rustix::net::{SendFlags, sendto};
use socket2::{Domain, InterfaceIndexOrAddress, Protocol, SockRef, Socket, Type};

use crate::socket_option::{self, ON};
use crate::{Interface, PortError, Received};

/// What to listen to over UDP.
#[derive(Clone, Copy, Debug)]
pub struct Udp {
    /// The local port; 0 for one that the kernel chooses.
    pub port: u16,
}

/// An open UDP socket.
#[derive(Debug)]
pub(crate) struct UdpPort {
    port: u16,
    socket: UdpSocket,
    interface: u32,
    /// The multicast group that it was told to belong to.
    group: Cell<Option<Ipv4Addr>>,
}

/// Room for what comes while the host stalls: 40 ms of a flood of full frames.
const RECEIVE_BUFFER_BYTES: usize = 1 << 20;

impl UdpPort {
    pub(crate) fn open(interface: &Interface, Udp { port }: Udp) -> Result<Self, PortError> {
        let open = || -> std::io::Result<UdpSocket> {
            let socket = Socket::new(Domain::IPV4, Type::DGRAM.nonblocking().cloexec(), Some(Protocol::UDP))?;
            // Bound to the interface and not to an address: the address comes later (DCP) and may change.
            socket.bind_device(Some(interface.name().as_bytes()))?;
            socket.set_broadcast(true)?;
            // Only what this socket joined: the groups of other programs are none of its business.
            socket.set_multicast_all_v4(false)?;
            socket.set_recv_buffer_size(RECEIVE_BUFFER_BYTES)?;
            tell_destinations(&socket)?;
            socket.bind(&SocketAddr::from((Ipv4Addr::UNSPECIFIED, port)).into())?;
            Ok(socket.into())
        };
        let opened = open().and_then(|socket| Ok((socket.local_addr()?.port(), socket)));
        let (port, socket) = opened.map_err(|reason| PortError::udp(interface.name(), port, reason))?;
        Ok(Self { port, socket, interface: interface.index(), group: Cell::new(None) })
    }

    pub(crate) const fn local_port(&self) -> u16 {
        self.port
    }

    pub(crate) fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }

    /// Joins this multicast group and leaves the one before, where they differ.
    pub(crate) fn follow_group(&self, group: Option<Ipv4Addr>) {
        let before = self.group.replace(group);
        if before == group {
            return;
        }
        let socket = SockRef::from(&self.socket);
        let interface = InterfaceIndexOrAddress::Index(self.interface);
        // Refused only where the interface is gone, which ends the driver, or the kernel's memory is used up.
        if let Some(before) = before {
            let _ = socket.leave_multicast_v4_n(&before, &interface);
        }
        if let Some(group) = group {
            let _ = socket.join_multicast_v4_n(&group, &interface);
        }
    }

    pub(crate) fn send(&self, frame: &[u8], to: SocketAddrV4) -> Result<(), Errno> {
        sendto(&self.socket, frame, SendFlags::DONTWAIT, &to).map(drop)
    }

    pub(crate) fn receive(&self, buf: &mut [u8]) -> Result<Received, Errno> {
        let mut control = [0_u64; 8];
        let mut slice = std::io::IoSliceMut::new(buf);
        // SAFETY: all zero is a valid sockaddr_in and a valid msghdr.
        let (mut from, mut message): (libc::sockaddr_in, libc::msghdr) = unsafe { std::mem::zeroed() };
        message.msg_name = (&raw mut from).cast();
        message.msg_namelen = size_of_val(&from) as libc::socklen_t;
        message.msg_iov = (&raw mut slice).cast();
        message.msg_iovlen = 1;
        message.msg_control = control.as_mut_ptr().cast();
        message.msg_controllen = size_of_val(&control) as _;
        // SAFETY: the message points at buffers that live over the call, with their sizes; IoSliceMut has the layout
        // of iovec.
        let len = unsafe { libc::recvmsg(self.socket.as_raw_fd(), &raw mut message, libc::MSG_DONTWAIT) };
        let Ok(len) = usize::try_from(len) else {
            let error = std::io::Error::last_os_error();
            return Err(Errno::from_io_error(&error).unwrap_or(Errno::IO));
        };
        if message.msg_flags & libc::MSG_TRUNC != 0 || from.sin_family != libc::AF_INET as libc::sa_family_t {
            return Ok(Received::Discarded);
        }
        let ip = Ipv4Addr::from_bits(u32::from_be(from.sin_addr.s_addr));
        let peer = Some(SocketAddrV4::new(ip, u16::from_be(from.sin_port)));
        Ok(Received::Frame { len, peer, to_all: is_broadcast(&message) })
    }
}

/// Asks the kernel to tell of each datagram where it was sent to.
fn tell_destinations(socket: &Socket) -> std::io::Result<()> {
    socket_option::set(socket, libc::IPPROTO_IP, libc::IP_PKTINFO, &ON)
}

/// Whether a received datagram was sent to every station: to an address that is neither this host's own nor a
/// multicast group's.
fn is_broadcast(message: &libc::msghdr) -> bool {
    // SAFETY: the kernel filled the control buffer and set its length; CMSG_NXTHDR stays within it.
    let mut header = unsafe { libc::CMSG_FIRSTHDR(message) };
    while !header.is_null() {
        // SAFETY: `header` points at a header within the control buffer, which is aligned for it.
        let (level, kind) = unsafe { ((*header).cmsg_level, (*header).cmsg_type) };
        if (level, kind) == (libc::IPPROTO_IP, libc::IP_PKTINFO) {
            // SAFETY: as above; a message of this type carries an in_pktinfo behind its header.
            let info = unsafe { libc::CMSG_DATA(header).cast::<libc::in_pktinfo>().read_unaligned() };
            let sent_to = Ipv4Addr::from_bits(u32::from_be(info.ipi_addr.s_addr));
            return !sent_to.is_multicast() && info.ipi_addr.s_addr != info.ipi_spec_dst.s_addr;
        }
        // SAFETY: `message` and `header` are as the kernel left them.
        header = unsafe { libc::CMSG_NXTHDR(message, header) };
    }
    false
}
