//! An open port, whichever it is.

use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};
use std::os::fd::BorrowedFd;

use machine::{Port, PortRequest};
use rustix::io::Errno;

use crate::Interface;
use crate::dscp::Marking;
use crate::ethernet::EthernetSocket;
use crate::taken::{self, Transport};
use crate::udp::UdpPort;

/// Why a port cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum PortError {
    /// This user must not.
    #[error(
        "opening {what} on `{interface}` is not permitted: run as root, or allow this program by \
         `sudo setcap cap_net_raw,cap_net_admin,cap_sys_nice,cap_ipc_lock+ep PROGRAM`"
    )]
    NotPermitted {
        /// Which port.
        what: String,
        /// The interface.
        interface: String,
    },
    /// Another program has it.
    #[error(
        "{transport} port {port} on `{interface}` is taken by another program{}; `ss -{}lpn 'sport = :{port}'` shows by \
         which: stop that one first",
        at(by), transport.option()
    )]
    Taken {
        /// UDP or TCP.
        transport: Transport,
        /// The port.
        port: u16,
        /// The interface.
        interface: String,
        /// The addresses that have it.
        by: Vec<SocketAddr>,
    },
    /// Anything else that the kernel said.
    #[error("opening {what} on `{interface}`: {reason}")]
    Refused {
        /// Which port.
        what: String,
        /// The interface.
        interface: String,
        /// What the kernel said.
        reason: std::io::Error,
    },
}

impl PortError {
    pub(crate) fn ethernet(interface: &str, reason: std::io::Error) -> Self {
        Self::of("raw Ethernet".to_owned(), interface, reason)
    }

    pub(crate) fn udp(interface: &str, port: u16, reason: std::io::Error) -> Self {
        Self::bound(Transport::Udp, interface, port, reason)
    }

    pub(crate) fn tcp(interface: &str, port: u16, reason: std::io::Error) -> Self {
        Self::bound(Transport::Tcp, interface, port, reason)
    }

    fn bound(transport: Transport, interface: &str, port: u16, reason: std::io::Error) -> Self {
        match reason.kind() {
            std::io::ErrorKind::AddrInUse => {
                let by = taken::holders(transport, port);
                Self::Taken { transport, port, interface: interface.to_owned(), by }
            }
            _ => Self::of(format!("{transport} port {port}"), interface, reason),
        }
    }

    fn of(what: String, interface: &str, reason: std::io::Error) -> Self {
        let interface = interface.to_owned();
        match reason.kind() {
            std::io::ErrorKind::PermissionDenied => Self::NotPermitted { what, interface },
            _ => Self::Refused { what, interface, reason },
        }
    }
}

fn at(by: &[SocketAddr]) -> String {
    let addresses: Vec<_> = by.iter().map(SocketAddr::to_string).collect();
    if addresses.is_empty() { String::new() } else { format!(" at {}", addresses.join(", ")) }
}

/// What a look at a socket brought.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Received {
    /// A frame, at the start of the buffer.
    Frame {
        /// Its length in bytes.
        len: usize,
        /// The sender's address, on UDP.
        peer: Option<SocketAddrV4>,
        /// Whether it was sent to every station, on UDP.
        to_all: bool,
    },
    /// A frame that is not for this station, or that is longer than any that a machine takes.
    Discarded,
}

/// An open port of a machine. What impairs frames on their way is to become one more variant. TCP is the driver's own.
#[derive(Debug)]
pub struct OpenPort {
    kind: Kind,
    marking: Marking,
}

#[derive(Debug)]
enum Kind {
    Ethernet(EthernetSocket),
    Udp(UdpPort),
}

impl OpenPort {
    /// Opens a port on an interface. Raw Ethernet needs `CAP_NET_RAW`.
    pub fn open(interface: &Interface, request: PortRequest) -> Result<Self, PortError> {
        let kind = match request {
            PortRequest::Ethernet { ether_type, groups } => {
                Kind::Ethernet(EthernetSocket::open(interface, ether_type, groups)?)
            }
            PortRequest::Udp(port) => Kind::Udp(UdpPort::open(interface, port)?),
        };
        Ok(Self { kind, marking: Marking::default() })
    }

    /// Opens several ports, or none.
    pub fn open_all(interface: &Interface, requests: &[PortRequest]) -> Result<Vec<Self>, PortError> {
        requests.iter().map(|request| Self::open(interface, *request)).collect()
    }

    /// The machine's name for it.
    #[must_use]
    pub const fn port(&self) -> Port {
        match &self.kind {
            Kind::Ethernet(_) => Port::Ethernet,
            Kind::Udp(udp) => Port::Udp(udp.port()),
        }
    }

    pub(crate) fn as_fd(&self) -> BorrowedFd<'_> {
        match &self.kind {
            Kind::Ethernet(ethernet) => ethernet.as_fd(),
            Kind::Udp(udp) => udp.as_fd(),
        }
    }

    /// Sends a frame without waiting; over IP it carries this DSCP.
    pub(crate) fn send(&self, frame: &[u8], to: Option<SocketAddrV4>, dscp: u8) -> Result<(), Errno> {
        if let Kind::Udp(udp) = &self.kind {
            self.marking.follow(udp.as_fd(), dscp);
        }
        match (&self.kind, to) {
            (Kind::Ethernet(ethernet), _) => ethernet.send(frame),
            (Kind::Udp(udp), Some(to)) => udp.send(frame, to),
            (Kind::Udp(_), None) => Err(Errno::DESTADDRREQ),
        }
    }

    /// Belongs to this multicast group from now on, and to no other.
    pub(crate) fn follow_group(&self, group: Option<Ipv4Addr>) {
        if let Kind::Udp(udp) = &self.kind {
            udp.follow_group(group);
        }
    }

    /// Takes the next frame without waiting; `Errno::AGAIN` where there is none.
    pub(crate) fn receive(&self, buf: &mut [u8]) -> Result<Received, Errno> {
        match &self.kind {
            Kind::Ethernet(ethernet) => ethernet.receive(buf),
            Kind::Udp(udp) => udp.receive(buf),
        }
    }
}
