//! Raw Ethernet: an `AF_PACKET` socket for one EtherType on one interface.

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use protocol::profinet::dcp::{HELLO_MULTICAST, IDENTIFY_MULTICAST};
use protocol::profinet::ethernet::{ETHER_TYPE_PROFINET, Mac};
use rustix::io::Errno;
use rustix::net::{
    AddressFamily, Protocol, RecvFlags, SendFlags, SocketAddrAny, SocketFlags, SocketType, recvfrom, send,
    socket_with,
};

use crate::socket_option::{self, ON};
use crate::{Interface, PortError, Received, packet_socket};

const BROADCAST: [u8; 6] = [0xFF; 6];

/// What to listen to on raw Ethernet.
#[derive(Clone, Copy, Debug)]
pub struct Ethernet {
    /// The EtherType of the frames, behind a priority tag if they have one.
    pub ethertype: u16,
    /// Groups to join.
    pub groups: &'static [Mac],
}

/// PROFINET: its EtherType, and the groups that every station listens to (IEC 61158-6-10, multicast addresses): DCP
/// Identify, DCP Hello, and the fast and slow alarm groups.
pub const PROFINET: Ethernet = Ethernet {
    ethertype: ETHER_TYPE_PROFINET,
    groups: &[
        IDENTIFY_MULTICAST,
        HELLO_MULTICAST,
        Mac([0x01, 0x0E, 0xCF, 0x00, 0x01, 0x01]),
        Mac([0x01, 0x0E, 0xCF, 0x00, 0x01, 0x02]),
    ],
};

/// An open raw socket.
#[derive(Debug)]
pub(crate) struct EthernetSocket {
    socket: OwnedFd,
    mac: Mac,
    groups: &'static [Mac],
}

impl EthernetSocket {
    pub(crate) fn open(interface: &Interface, ethernet: Ethernet) -> Result<Self, PortError> {
        let failed = |reason: std::io::Error| PortError::ethernet(interface.name(), reason);
        // Protocol 0 hears nothing until it is bound: so no frame of another interface gets in before that.
        let socket = socket_with(
            AddressFamily::PACKET,
            SocketType::RAW,
            SocketFlags::CLOEXEC | SocketFlags::NONBLOCK,
            None::<Protocol>,
        )
        .map_err(|error| failed(error.into()))?;
        socket_option::set(&socket, libc::SOL_PACKET, libc::PACKET_IGNORE_OUTGOING, &ON).map_err(failed)?;
        for group in ethernet.groups {
            let mut address = [0; 8];
            for (to, from) in address.iter_mut().zip(group.0) {
                *to = from;
            }
            let request = libc::packet_mreq {
                mr_ifindex: interface.index() as i32,
                mr_type: libc::PACKET_MR_MULTICAST as u16,
                mr_alen: 6,
                mr_address: address,
            };
            socket_option::set(&socket, libc::SOL_PACKET, libc::PACKET_ADD_MEMBERSHIP, &request)
                .map_err(failed)?;
        }
        packet_socket::bind(&socket, interface, ethernet.ethertype).map_err(failed)?;
        Ok(Self { socket, mac: interface.mac(), groups: ethernet.groups })
    }

    pub(crate) fn as_fd(&self) -> BorrowedFd<'_> {
        self.socket.as_fd()
    }

    pub(crate) fn send(&self, frame: &[u8]) -> Result<(), Errno> {
        send(&self.socket, frame, SendFlags::DONTWAIT).map(drop)
    }

    pub(crate) fn receive(&self, buf: &mut [u8]) -> Result<Received, Errno> {
        let capacity = buf.len();
        let (len, whole, from) = recvfrom(&self.socket, &mut *buf, RecvFlags::TRUNC | RecvFlags::DONTWAIT)?;
        let frame = buf.get(..len).unwrap_or_default();
        // A frame of another VLAN and one for another station come here too, both as PACKET_OTHERHOST.
        let for_others = from.as_ref().and_then(packet_type) == Some(libc::PACKET_OTHERHOST);
        if whole > capacity || for_others || !self.is_for_us(frame) {
            return Ok(Received::Discarded);
        }
        Ok(Received::Frame { len, peer: None, to_all: false })
    }

    fn is_for_us(&self, frame: &[u8]) -> bool {
        let Some(destination) = frame.first_chunk::<6>() else {
            return false;
        };
        *destination == self.mac.0
            || *destination == BROADCAST
            || self.groups.iter().any(|group| group.0 == *destination)
    }
}

/// How the kernel sorted the frame: for us, broadcast, multicast, or somebody else's.
fn packet_type(address: &SocketAddrAny) -> Option<u8> {
    if address.address_family() != AddressFamily::PACKET
        || (address.addr_len() as usize) < std::mem::offset_of!(libc::sockaddr_ll, sll_addr)
    {
        return None;
    }
    // SAFETY: the family says that this is a `sockaddr_ll`, the length check says that the field was written, and
    // the read does not rely on alignment.
    Some(unsafe { (&raw const (*address.as_ptr().cast::<libc::sockaddr_ll>()).sll_pkttype).read_unaligned() })
}
