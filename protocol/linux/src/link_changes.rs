//! Notices of changes of network interfaces, over rtnetlink's group of links (rtnetlink(7)).

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use rustix::io::Errno;
use rustix::net::netlink::SocketAddrNetlink;
use rustix::net::{AddressFamily, RecvFlags, SocketFlags, SocketType, bind, recv, socket_with};

/// `RTMGRP_LINK` of linux/rtnetlink.h.
const GROUP_OF_LINKS: u32 = 1;

/// A socket that is readable after an interface of its network has changed, as when a carrier comes or goes.
#[derive(Debug)]
pub struct LinkChanges(OwnedFd);

impl LinkChanges {
    /// Starts to listen in the network of this thread.
    ///
    /// # Errors
    ///
    /// The kernel gives no socket.
    pub fn listen() -> std::io::Result<Self> {
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        let socket = socket_with(AddressFamily::NETLINK, SocketType::RAW, flags, None)?;
        bind(&socket, &SocketAddrNetlink::new(0, GROUP_OF_LINKS))?;
        Ok(Self(socket))
    }

    /// Discards the notices so far: read the state of the interfaces after this, not before.
    pub fn clear(&self) {
        // A notice may be cut: only that there was one matters. After more than the socket has room for, it has an error once.
        while matches!(
            recv(&self.0, &mut [0_u8; 64][..], RecvFlags::TRUNC),
            Ok(_) | Err(Errno::INTR | Errno::NOBUFS)
        ) {}
    }
}

impl AsFd for LinkChanges {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}
