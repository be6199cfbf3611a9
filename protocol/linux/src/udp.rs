//! UDP over IPv4 on one interface.

use std::cell::RefCell;
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
    /// The multicast groups that it belongs to.
    groups: RefCell<Vec<Ipv4Addr>>,
}

/// Receive buffer in bytes: what arrives in a host stall of 40 ms at a flood of full frames.
pub(crate) const RECEIVE_BUFFER_BYTES: usize = 1 << 20;

impl UdpPort {
    /// Opens this port; with 0 the kernel chooses one.
    pub(crate) fn open(interface: &Interface, port: u16) -> Result<Self, PortError> {
        let open = || -> std::io::Result<UdpSocket> {
            let socket = Socket::new(Domain::IPV4, Type::DGRAM.nonblocking().cloexec(), Some(Protocol::UDP))?;
            // Bound to the interface and not to an address: the address is set later (DCP) and may change.
            socket.bind_device(Some(interface.name().as_bytes()))?;
            socket.set_broadcast(true)?;
            // Receive only the groups that this socket joined, not those of other programs.
            socket.set_multicast_all_v4(false)?;
            socket.set_recv_buffer_size(RECEIVE_BUFFER_BYTES)?;
            request_destinations(&socket)?;
            socket.bind(&SocketAddr::from((Ipv4Addr::UNSPECIFIED, port)).into())?;
            Ok(socket.into())
        };
        let socket = open().map_err(|reason| PortError::udp(interface.name(), port, reason))?;
        Ok(Self { port, socket, interface: interface.index(), groups: RefCell::default() })
    }

    /// Returns the requested port: 0 if the kernel chose one.
    pub(crate) const fn port(&self) -> u16 {
        self.port
    }

    pub(crate) fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }

    /// Joins these multicast groups and leaves the previous ones that are not among them.
    pub(crate) fn update_groups(&self, wanted: impl Iterator<Item = Ipv4Addr> + Clone) {
        let mut groups = self.groups.borrow_mut();
        if groups.iter().copied().eq(wanted.clone()) {
            return;
        }
        let socket = SockRef::from(&self.socket);
        let interface = InterfaceIndexOrAddress::Index(self.interface);
        // Leaving fails only if the interface is gone, which ends the driver, or the kernel is out of memory.
        for left in groups.iter().filter(|group| !wanted.clone().any(|wanted| wanted == **group)) {
            let _ = socket.leave_multicast_v4_n(left, &interface);
        }
        for joined in wanted.clone().filter(|group| !groups.contains(group)) {
            let _ = socket.join_multicast_v4_n(&joined, &interface);
        }
        groups.clear();
        groups.extend(wanted);
    }

    pub(crate) fn send(&self, frame: &[u8], to: SocketAddrV4) -> Result<(), Errno> {
        sendto(&self.socket, frame, SendFlags::DONTWAIT, &to).map(drop)
    }

    pub(crate) fn receive(&self, buf: &mut [u8]) -> Result<Received, Errno> {
        let mut to_all = false;
        let received = received_message::receive::<libc::sockaddr_in>(
            &self.socket,
            buf,
            libc::MSG_DONTWAIT,
            |control| {
                if control.kind == (libc::IPPROTO_IP, libc::IP_PKTINFO) {
                    to_all = plain::read(control.data).is_some_and(is_to_all);
                }
            },
        );
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

/// Makes the kernel report each datagram's destination.
fn request_destinations(socket: &Socket) -> std::io::Result<()> {
    socket_option::set(socket, libc::IPPROTO_IP, libc::IP_PKTINFO, &ON)
}

/// Returns whether a received datagram was sent to every station: its destination is neither an address of this host
/// nor a multicast group.
fn is_to_all(info: libc::in_pktinfo) -> bool {
    let sent_to = Ipv4Addr::from_bits(u32::from_be(info.ipi_addr.s_addr));
    !sent_to.is_multicast() && info.ipi_addr.s_addr != info.ipi_spec_dst.s_addr
}
