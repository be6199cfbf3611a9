//! UDP over IPv4 on one interface.

use std::cell::Cell;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::os::fd::{AsFd, BorrowedFd};

use rustix::io::Errno;
use rustix::net::{SendFlags, sendto};
use socket2::{Domain, InterfaceIndexOrAddress, Protocol, SockRef, Socket, Type};

use crate::received_message::{self, ReceivedMessage};
use crate::socket_option::{self, ON};
use crate::{Interface, PortError, Received, plain};

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
    /// Opens this port; 0 for one that the kernel chooses.
    pub(crate) fn open(interface: &Interface, port: u16) -> Result<Self, PortError> {
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
        let socket = open().map_err(|reason| PortError::udp(interface.name(), port, reason))?;
        Ok(Self { port, socket, interface: interface.index(), group: Cell::new(None) })
    }

    /// The port that was asked for: 0 where the kernel chose one.
    pub(crate) const fn port(&self) -> u16 {
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
        let mut to_all = false;
        let received =
            received_message::receive::<libc::sockaddr_in>(&self.socket, buf, libc::MSG_DONTWAIT, |told| {
                if told.kind == (libc::IPPROTO_IP, libc::IP_PKTINFO) {
                    to_all = plain::read(told.data).is_some_and(is_to_all);
                }
            });
        let ReceivedMessage { len, from, is_cut } =
            received.map_err(|error| Errno::from_io_error(&error).unwrap_or(Errno::IO))?;
        if is_cut || from.sin_family != libc::AF_INET as libc::sa_family_t {
            return Ok(Received::Discarded);
        }
        let ip = Ipv4Addr::from_bits(u32::from_be(from.sin_addr.s_addr));
        let peer = Some(SocketAddrV4::new(ip, u16::from_be(from.sin_port)));
        Ok(Received::Frame { len, peer, to_all })
    }
}

/// Asks the kernel to tell of each datagram where it was sent to.
fn tell_destinations(socket: &Socket) -> std::io::Result<()> {
    socket_option::set(socket, libc::IPPROTO_IP, libc::IP_PKTINFO, &ON)
}

/// Whether a received datagram was sent to every station: to an address that is neither this host's own nor a
/// multicast group's.
fn is_to_all(info: libc::in_pktinfo) -> bool {
    let sent_to = Ipv4Addr::from_bits(u32::from_be(info.ipi_addr.s_addr));
    !sent_to.is_multicast() && info.ipi_addr.s_addr != info.ipi_spec_dst.s_addr
}
