//! Raw Ethernet: an `AF_PACKET` socket for one EtherType on one interface.

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use machine::ethernet::Mac;
use rustix::io::Errno;
use rustix::net::{AddressFamily, RecvFlags, SendFlags, SocketAddrAny, recvfrom, send};
use socket2::Socket;

use crate::socket_option::{self, ON};
use crate::{Interface, PortError, Received, packet_socket, plain};

const BROADCAST: [u8; 6] = [0xFF; 6];

/// An open raw socket.
#[derive(Debug)]
pub(crate) struct EthernetSocket {
    socket: OwnedFd,
    mac: Mac,
    groups: &'static [Mac],
}

impl EthernetSocket {
    /// Opens a socket for frames of this EtherType to this interface's address, to broadcast and to these groups.
    pub(crate) fn open(
        interface: &Interface,
        ether_type: u16,
        groups: &'static [Mac],
    ) -> Result<Self, PortError> {
        let prepare = |socket: &Socket| {
            socket.set_nonblocking(true)?;
            socket_option::set(socket, libc::SOL_PACKET, libc::PACKET_IGNORE_OUTGOING, &ON)?;
            for group in groups {
                let mut request: libc::packet_mreq = plain::zeroed();
                request.mr_ifindex = interface.index() as i32;
                request.mr_type = libc::PACKET_MR_MULTICAST as u16;
                request.mr_alen = 6;
                for (to, from) in request.mr_address.iter_mut().zip(group.0) {
                    *to = from;
                }
                socket_option::set(socket, libc::SOL_PACKET, libc::PACKET_ADD_MEMBERSHIP, &request)?;
            }
            Ok(())
        };
        let socket = packet_socket::open(interface, ether_type, prepare)
            .map_err(|reason| PortError::ethernet(interface.name(), reason))?;
        Ok(Self { socket: socket.into(), mac: interface.mac(), groups })
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
