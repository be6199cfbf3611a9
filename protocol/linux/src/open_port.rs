//! An open port of a machine: raw Ethernet or UDP.

use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4};
use std::os::fd::{AsFd, BorrowedFd};

use machine::{Port, PortRequest};
use rustix::io::Errno;

use crate::Interface;
use crate::dscp::Marking;
use crate::ethernet::{Destination, EthernetSocket};
use crate::port_holders::{self, Transport};
use crate::udp::UdpPort;

/// Why a port cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum PortError {
    /// This user lacks the permission.
    #[error(
        "opening {what} on `{interface}` is not permitted: run as root, or allow this program by \
         `sudo setcap cap_net_raw,cap_net_admin,cap_sys_nice,cap_ipc_lock+ep PROGRAM`"
    )]
    NotPermitted {
        /// The port.
        what: String,
        /// The interface.
        interface: String,
    },
    /// Another program uses it.
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
        /// The local addresses that other programs use it with.
        by: Vec<SocketAddr>,
    },
    /// Two interfaces of the machine are this one, and both need the port.
    #[error(
        "{transport} port {port} on `{interface}` is needed by two buses of this node: give one of them another interface"
    )]
    Shared {
        /// UDP or TCP.
        transport: Transport,
        /// The port.
        port: u16,
        /// The interface.
        interface: String,
    },
    /// The machine has another number of interfaces.
    #[error("{given} network interfaces were given to a node that needs {needed}: one for each bus")]
    InterfaceCount {
        /// The number that the machine needs.
        needed: usize,
        /// The number that was given.
        given: usize,
    },
    /// Any other error of the kernel.
    #[error("opening {what} on `{interface}`: {reason}")]
    Refused {
        /// The port.
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
                let by = port_holders::find(transport, port);
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

/// Result of reading a socket.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Received {
    /// A frame, at the start of the buffer.
    Frame {
        /// Its length in bytes.
        len: usize,
        /// The sender's address; UDP only.
        peer: Option<SocketAddrV4>,
        /// Whether it was sent to every station; UDP only.
        to_all: bool,
    },
    /// A frame for another station, or one that is too long for any machine.
    Discarded,
}

/// An open port of a machine. TCP connections are not ports; the driver handles them.
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
                Kind::Ethernet(EthernetSocket::open(interface, ether_type, Destination::OursOr(groups))?)
            }
            PortRequest::AnyEthernet { ether_type } => {
                Kind::Ethernet(EthernetSocket::open(interface, ether_type, Destination::Any)?)
            }
            PortRequest::Udp(port) => Kind::Udp(UdpPort::open(interface, port)?),
        };
        Ok(Self { kind, marking: Marking::default() })
    }

    /// Opens several ports; if one fails, none stays open.
    pub fn open_all(interface: &Interface, requests: &[PortRequest]) -> Result<Vec<Self>, PortError> {
        requests.iter().map(|request| Self::open(interface, *request)).collect()
    }

    /// Returns the machine's name for it.
    #[must_use]
    pub const fn port(&self) -> Port {
        match &self.kind {
            Kind::Ethernet(_) => Port::Ethernet,
            Kind::Udp(udp) => Port::Udp(udp.port()),
        }
    }

    /// Sends a frame without waiting; IP packets carry this DSCP.
    ///
    /// # Errors
    ///
    /// The kernel refuses it, or a UDP port is given no receiver.
    pub fn send(&self, frame: &[u8], to: Option<SocketAddrV4>, dscp: u8) -> Result<(), Errno> {
        if let Kind::Udp(udp) = &self.kind {
            self.marking.follow(udp.as_fd(), dscp);
        }
        match (&self.kind, to) {
            (Kind::Ethernet(ethernet), _) => ethernet.send(frame),
            (Kind::Udp(udp), Some(to)) => udp.send(frame, to),
            (Kind::Udp(_), None) => Err(Errno::DESTADDRREQ),
        }
    }

    /// Joins these multicast groups and leaves all others.
    pub(crate) fn update_groups(&self, groups: impl Iterator<Item = Ipv4Addr> + Clone) {
        if let Kind::Udp(udp) = &self.kind {
            udp.update_groups(groups);
        }
    }

    /// Reads the next frame without waiting.
    ///
    /// # Errors
    ///
    /// `Errno::AGAIN` if there is none; any other error of the kernel.
    pub fn receive(&self, buf: &mut [u8]) -> Result<Received, Errno> {
        match &self.kind {
            Kind::Ethernet(ethernet) => ethernet.receive(buf),
            Kind::Udp(udp) => udp.receive(buf),
        }
    }
}

impl AsFd for OpenPort {
    fn as_fd(&self) -> BorrowedFd<'_> {
        match &self.kind {
            Kind::Ethernet(ethernet) => ethernet.as_fd(),
            Kind::Udp(udp) => udp.as_fd(),
        }
    }
}
