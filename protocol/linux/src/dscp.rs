//! DSCP: the traffic class of a socket's packets.

use std::cell::Cell;
use std::os::fd::BorrowedFd;

use socket2::SockRef;

/// The DSCP that was last set on a socket.
#[derive(Clone, Debug, Default)]
pub(crate) struct Marking(Cell<u8>);

impl Marking {
    /// Sets this DSCP, 0 to 63, on the packets of `socket` if it has another.
    ///
    /// Its three upper bits also become the packet's priority inside this host, from which a VLAN device derives the
    /// PCP: RFC 8325 and the QoS object of EtherNet/IP (volume 2, table 5-7.4) pair the two the same way.
    pub(crate) fn follow(&self, socket: BorrowedFd<'_>, dscp: u8) {
        if self.0.replace(dscp) == dscp {
            return;
        }
        let socket = SockRef::from(&socket);
        // Every user may set both. If a kernel refuses nevertheless, frames still go out.
        let _ = socket.set_tos_v4(u32::from(dscp) << 2);
        let _ = socket.set_priority(u32::from(dscp) >> 3);
    }
}

#[cfg(test)]
mod tests {
    use std::net::UdpSocket;
    use std::os::fd::AsFd as _;

    use super::*;

    #[test]
    fn a_socket_follows_its_dscp_whenever_it_changes() {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let marking = Marking::default();
        let set = || SockRef::from(&socket).tos_v4().unwrap();
        for (dscp, tos) in [(0, 0), (47, 0xBC), (47, 0xBC), (27, 0x6C), (0, 0)] {
            marking.follow(socket.as_fd(), dscp);
            assert_eq!(set(), tos);
        }
    }
}
