//! An open port, whichever it is.

use std::net::SocketAddrV4;
use std::os::fd::BorrowedFd;

use protocol::Port;
use protocol::profinet::RPC_PORT;
use protocol::profinet::rt::UDP_PORT;
use rustix::io::Errno;

use crate::ethernet::EthernetSocket;
use crate::udp::UdpPort;
use crate::{Ethernet, Interface, PROFINET, Udp};

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
        "UDP port {port} is taken by another program; `ss -ulpn 'sport = :{port}'` shows by which: stop that one first"
    )]
    Taken {
        /// The UDP port.
        port: u16,
    },
    /// Anything else that the kernel said.
    #[error("opening {what} on `{interface}`: {source}")]
    Refused {
        /// Which port.
        what: String,
        /// The interface.
        interface: String,
        /// What the kernel said.
        source: std::io::Error,
    },
}

impl PortError {
    pub(crate) fn ethernet(interface: &str, source: std::io::Error) -> Self {
        Self::of("raw Ethernet".to_owned(), interface, source)
    }

    pub(crate) fn udp(interface: &str, port: u16, source: std::io::Error) -> Self {
        match source.kind() {
            std::io::ErrorKind::AddrInUse => Self::Taken { port },
            _ => Self::of(format!("UDP port {port}"), interface, source),
        }
    }

    fn of(what: String, interface: &str, source: std::io::Error) -> Self {
        let interface = interface.to_owned();
        match source.kind() {
            std::io::ErrorKind::PermissionDenied => Self::NotPermitted { what, interface },
            _ => Self::Refused { what, interface, source },
        }
    }
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
    },
    /// A frame that is not for this station, or that is longer than any that a machine takes.
    Discarded,
}

/// An open port of a machine. What impairs frames on their way is to become one more variant; a TCP listener and its
/// connections, as [`Port::Stream`], another.
#[derive(Debug)]
pub struct Wire(Kind);

#[derive(Debug)]
enum Kind {
    Ethernet(EthernetSocket),
    Udp(UdpPort),
}

impl Wire {
    /// Opens raw Ethernet. Needs `CAP_NET_RAW`.
    pub fn ethernet(interface: &Interface, ethernet: Ethernet) -> Result<Self, PortError> {
        Ok(Self(Kind::Ethernet(EthernetSocket::open(interface, ethernet)?)))
    }

    /// Opens a UDP port.
    pub fn udp(interface: &Interface, udp: Udp) -> Result<Self, PortError> {
        Ok(Self(Kind::Udp(UdpPort::open(interface, udp)?)))
    }

    /// The ports of a PROFINET station: raw Ethernet, connection management, and cyclic data over UDP.
    pub fn profinet(interface: &Interface) -> Result<Vec<Self>, PortError> {
        Ok(vec![
            Self::ethernet(interface, PROFINET)?,
            Self::udp(interface, Udp { port: RPC_PORT })?,
            Self::udp(interface, Udp { port: UDP_PORT })?,
        ])
    }

    /// The machine's name for it.
    #[must_use]
    pub const fn port(&self) -> Port {
        match &self.0 {
            Kind::Ethernet(_) => Port::Ethernet,
            Kind::Udp(udp) => Port::Udp(udp.local_port()),
        }
    }

    pub(crate) fn as_fd(&self) -> BorrowedFd<'_> {
        match &self.0 {
            Kind::Ethernet(ethernet) => ethernet.as_fd(),
            Kind::Udp(udp) => udp.as_fd(),
        }
    }

    /// Sends a frame without waiting.
    pub(crate) fn send(&self, frame: &[u8], to: Option<SocketAddrV4>) -> Result<(), Errno> {
        match (&self.0, to) {
            (Kind::Ethernet(ethernet), _) => ethernet.send(frame),
            (Kind::Udp(udp), Some(to)) => udp.send(frame, to),
            (Kind::Udp(_), None) => Err(Errno::DESTADDRREQ),
        }
    }

    /// Takes the next frame without waiting; `Errno::AGAIN` where there is none.
    pub(crate) fn receive(&self, buf: &mut [u8]) -> Result<Received, Errno> {
        match &self.0 {
            Kind::Ethernet(ethernet) => ethernet.receive(buf),
            Kind::Udp(udp) => udp.receive(buf),
        }
    }
}
