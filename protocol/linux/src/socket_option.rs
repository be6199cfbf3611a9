//! Options of sockets that neither rustix nor socket2 knows.

use std::io;
use std::os::fd::{AsFd, AsRawFd as _};

/// On, for an option that is a switch.
pub(crate) const ON: libc::c_int = 1;

/// Sets an option to a plain C structure.
pub(crate) fn set<T: Copy>(
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

/// Asks for an option that is so many 32-bit words.
pub(crate) fn words<const N: usize>(
    socket: impl AsFd,
    level: libc::c_int,
    name: libc::c_int,
) -> io::Result<[u32; N]> {
    let (mut words, mut len) = ([0_u32; N], size_of::<[u32; N]>() as libc::socklen_t);
    // SAFETY: the socket is open; the words live over the call, their true size is given, and any bytes make a number.
    let result = unsafe {
        libc::getsockopt(socket.as_fd().as_raw_fd(), level, name, words.as_mut_ptr().cast(), &raw mut len)
    };
    if result < 0 { Err(io::Error::last_os_error()) } else { Ok(words) }
}
