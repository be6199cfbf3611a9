//! Socket options that neither rustix nor socket2 supports.

use std::io;
use std::os::fd::{AsFd, AsRawFd as _};

use crate::plain::{self, Plain};

/// Value that switches an option on.
pub(crate) const ON: libc::c_int = 1;

/// Sets an option.
pub(crate) fn set<T: Plain>(
    socket: impl AsFd,
    level: libc::c_int,
    name: libc::c_int,
    value: &T,
) -> io::Result<()> {
    let (socket, len) = (socket.as_fd().as_raw_fd(), size_of::<T>() as libc::socklen_t);
    // SAFETY: the socket is open; the value is a plain C structure, its true size is given, and the kernel copies it.
    let result = unsafe { libc::setsockopt(socket, level, name, std::ptr::from_ref(value).cast(), len) };
    if result < 0 { Err(io::Error::last_os_error()) } else { Ok(()) }
}

/// Reads an option.
pub(crate) fn get<T: Plain>(socket: impl AsFd, level: libc::c_int, name: libc::c_int) -> io::Result<T> {
    let (mut value, mut len) = (plain::zeroed::<T>(), size_of::<T>() as libc::socklen_t);
    let socket = socket.as_fd().as_raw_fd();
    // SAFETY: the socket is open; the value outlives the call, its true size is given, and all bytes are valid for
    // it.
    let result = unsafe { libc::getsockopt(socket, level, name, (&raw mut value).cast(), &raw mut len) };
    if result < 0 { Err(io::Error::last_os_error()) } else { Ok(value) }
}
