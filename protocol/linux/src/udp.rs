//! UDP over IPv4 on one interface.

use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};
use std::os::fd::{AsFd, BorrowedFd};

use rustix::io::Errno;
use rustix::net::{RecvFlags, SendFlags, SocketAddrAny, recvfrom, sendto};
use socket2::{Domain, Protocol, Socket, Type};

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
            socket.set_recv_buffer_size(RECEIVE_BUFFER_BYTES)?;
            socket.bind(&SocketAddr::from((Ipv4Addr::UNSPECIFIED, port)).into())?;
            Ok(socket.into())
        };
        let opened = open().and_then(|socket| Ok((socket.local_addr()?.port(), socket)));
        let (port, socket) = opened.map_err(|reason| PortError::udp(interface.name(), port, reason))?;
        Ok(Self { port, socket })
    }

    pub(crate) const fn local_port(&self) -> u16 {
        self.port
    }

    pub(crate) fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }

    pub(crate) fn send(&self, frame: &[u8], to: SocketAddrV4) -> Result<(), Errno> {
        sendto(&self.socket, frame, SendFlags::DONTWAIT, &to).map(drop)
    }

    pub(crate) fn receive(&self, buf: &mut [u8]) -> Result<Received, Errno> {
        let capacity = buf.len();
        let (len, whole, from) = recvfrom(&self.socket, buf, RecvFlags::TRUNC | RecvFlags::DONTWAIT)?;
        let peer = from.and_then(|from: SocketAddrAny| SocketAddrV4::try_from(from).ok());
        if whole > capacity || peer.is_none() {
            return Ok(Received::Discarded);
        }
        Ok(Received::Frame { len, peer })
    }
}
