//! Raw Ethernet: an `AF_PACKET` socket for one EtherType on one interface.

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use machine::ethernet::Mac;
use rustix::io::Errno;
use rustix::net::{AddressFamily, RecvFlags, SendFlags, SocketAddrAny, recvfrom, send};
use socket2::Socket;

use crate::socket_option::{self, ON};
use crate::udp::RECEIVE_BUFFER_BYTES;
use crate::{Interface, PortError, Received, packet_socket, plain};

const BROADCAST: [u8; 6] = [0xFF; 6];

/// Which frames a raw socket receives, by their destination address.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Destination {
    /// Those to the interface's own address, to broadcast and to these groups.
    OursOr(&'static [Mac]),
    /// All.
    Any,
}

impl Destination {
    /// Returns the memberships of the socket that make the interface receive the frames: type and address of each.
    fn memberships(self) -> impl Iterator<Item = (i32, Mac)> {
        let groups = match self {
            Self::OursOr(groups) => groups,
            Self::Any => &[],
        };
        let all = matches!(self, Self::Any).then_some((libc::PACKET_MR_PROMISC, Mac([0; 6])));
        groups.iter().map(|group| (libc::PACKET_MR_MULTICAST, *group)).chain(all)
    }
}

/// An open raw socket.
#[derive(Debug)]
pub(crate) struct EthernetSocket {
    socket: OwnedFd,
    mac: Mac,
    destination: Destination,
}

impl EthernetSocket {
    /// Opens a socket for frames of this EtherType to these addresses.
    pub(crate) fn open(
        interface: &Interface,
        ether_type: u16,
        destination: Destination,
    ) -> Result<Self, PortError> {
        let prepare = |socket: &Socket| {
            socket.set_nonblocking(true)?;
            socket.set_recv_buffer_size(RECEIVE_BUFFER_BYTES)?;
            socket_option::set(socket, libc::SOL_PACKET, libc::PACKET_IGNORE_OUTGOING, &ON)?;
            for (kind, address) in destination.memberships() {
                let mut request: libc::packet_mreq = plain::zeroed();
                request.mr_ifindex = interface.index() as i32;
                request.mr_type = kind as u16;
                request.mr_alen = 6;
                for (to, from) in request.mr_address.iter_mut().zip(address.0) {
                    *to = from;
                }
                socket_option::set(socket, libc::SOL_PACKET, libc::PACKET_ADD_MEMBERSHIP, &request)?;
            }
            Ok(())
        };
        let socket = packet_socket::open(interface, ether_type, prepare)
            .map_err(|reason| PortError::ethernet(interface.name(), reason))?;
        Ok(Self { socket: socket.into(), mac: interface.mac(), destination })
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
        // Frames of another VLAN and frames for another station arrive here too, both as PACKET_OTHERHOST.
        let for_others = from.as_ref().and_then(packet_type) == Some(libc::PACKET_OTHERHOST);
        let is_wanted = match self.destination {
            Destination::OursOr(groups) => !for_others && self.is_for_us(frame, groups),
            // The kernel has removed the tag of a VLAN. One in a frame for another station stays unnoticed.
            Destination::Any => !for_others || is_unicast(frame) && !self.is_for_us(frame, &[]),
        };
        if whole > capacity || !is_wanted {
            return Ok(Received::Discarded);
        }
        Ok(Received::Frame { len, peer: None, to_all: false })
    }

    fn is_for_us(&self, frame: &[u8], groups: &[Mac]) -> bool {
        let Some(destination) = frame.first_chunk::<6>() else {
            return false;
        };
        *destination == self.mac.0
            || *destination == BROADCAST
            || groups.iter().any(|group| group.0 == *destination)
    }
}

/// Returns whether a frame is for one station.
fn is_unicast(frame: &[u8]) -> bool {
    frame.first().is_some_and(|first| first & 1 == 0)
}

/// Returns the kernel's classification of the frame: for this host, broadcast, multicast or for another host.
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
