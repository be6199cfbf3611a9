//! Plain structures of C, which the kernel writes and reads as bytes.

/// A structure that any bytes make, all zero as well.
///
/// # Safety
///
/// No bytes of its size are invalid: it has numbers and arrays of numbers only.
pub(crate) unsafe trait Plain: Copy {}

// SAFETY: numbers and arrays of numbers, as libc has them.
unsafe impl Plain for libc::c_int {}
// SAFETY: as above.
unsafe impl Plain for libc::in_pktinfo {}
// SAFETY: as above.
unsafe impl Plain for libc::packet_mreq {}
// SAFETY: as above.
unsafe impl Plain for libc::sockaddr_in {}
// SAFETY: as above.
unsafe impl Plain for libc::sockaddr_ll {}
// SAFETY: as above.
unsafe impl Plain for libc::timespec {}
// SAFETY: as above.
unsafe impl Plain for libc::tpacket_auxdata {}
// SAFETY: as above.
unsafe impl Plain for libc::tpacket_req {}
// SAFETY: as above.
unsafe impl Plain for libc::tpacket_stats {}

/// All zero.
pub(crate) const fn zeroed<T: Plain>() -> T {
    // SAFETY: any bytes make this structure.
    unsafe { std::mem::zeroed() }
}

/// The structure that these bytes begin with; none where they are too few.
pub(crate) fn read<T: Plain>(bytes: &[u8]) -> Option<T> {
    // SAFETY: the bytes are at least as many, and any make this structure; the read does not rely on alignment.
    (bytes.len() >= size_of::<T>()).then(|| unsafe { bytes.as_ptr().cast::<T>().read_unaligned() })
}
