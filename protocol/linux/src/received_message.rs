//! recvmsg(2): a message with its sender's address and the kernel's control messages, few of which rustix supports.

use std::io::{self, IoSliceMut};
use std::os::fd::{AsFd, AsRawFd as _};

use crate::plain::{self, Plain};

/// A message that was received.
pub(crate) struct ReceivedMessage<A> {
    /// Its length in bytes, at most that of the buffer.
    pub(crate) len: usize,
    /// The sender's address as the kernel wrote it; all zero if it wrote none.
    pub(crate) from: A,
    /// Whether the message was longer than the buffer.
    pub(crate) is_cut: bool,
}

/// A control message: what the kernel reports about a message.
pub(crate) struct Control<'a> {
    /// The protocol level and the type, as in `(SOL_SOCKET, SCM_TIMESTAMPNS)`.
    pub(crate) kind: (libc::c_int, libc::c_int),
    /// Its content, for [`plain::read`].
    pub(crate) data: &'a [u8],
}

/// Receives a message into `bytes`, and hands its control messages to `on_control`.
pub(crate) fn receive<A: Plain>(
    socket: impl AsFd,
    bytes: &mut [u8],
    flags: libc::c_int,
    mut on_control: impl FnMut(&Control<'_>),
) -> io::Result<ReceivedMessage<A>> {
    let mut from = plain::zeroed::<A>();
    let mut control = [0_u64; 16];
    let mut slice = IoSliceMut::new(bytes);
    // SAFETY: all zero is a valid msghdr.
    let mut message: libc::msghdr = unsafe { std::mem::zeroed() };
    message.msg_name = (&raw mut from).cast();
    message.msg_namelen = size_of::<A>() as libc::socklen_t;
    message.msg_iov = (&raw mut slice).cast();
    message.msg_iovlen = 1;
    message.msg_control = control.as_mut_ptr().cast();
    message.msg_controllen = size_of_val(&control) as _;
    // SAFETY: the message points at buffers that outlive the call, with their sizes; IoSliceMut has the layout of
    // iovec, and all bytes are valid for the address.
    let len = unsafe { libc::recvmsg(socket.as_fd().as_raw_fd(), &raw mut message, flags) };
    let len = usize::try_from(len).map_err(|_| io::Error::last_os_error())?;
    // SAFETY: the kernel filled the control buffer and set its length; CMSG_NXTHDR stays within it.
    let mut header = unsafe { libc::CMSG_FIRSTHDR(&raw const message) };
    while !header.is_null() {
        // SAFETY: `header` points at a header within the control buffer, which is aligned for it; the data follows it and
        // ends with the length that the header gives.
        let control = unsafe {
            let len = ((*header).cmsg_len as usize).saturating_sub(libc::CMSG_LEN(0) as usize);
            let data = std::slice::from_raw_parts(libc::CMSG_DATA(header), len);
            Control { kind: ((*header).cmsg_level, (*header).cmsg_type), data }
        };
        on_control(&control);
        // SAFETY: `message` and `header` are as the kernel left them.
        header = unsafe { libc::CMSG_NXTHDR(&raw const message, header) };
    }
    Ok(ReceivedMessage { len, from, is_cut: message.msg_flags & libc::MSG_TRUNC != 0 })
}
