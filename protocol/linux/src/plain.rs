//! Plain C structures, which the kernel writes and reads as bytes.

/// A structure for which all bytes are valid, also all zero.
///
/// # Safety
///
/// It consists of numbers and arrays of numbers only.
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

/// Returns the structure with all bytes zero.
pub(crate) const fn zeroed<T: Plain>() -> T {
    // SAFETY: all bytes are valid for this structure.
    unsafe { std::mem::zeroed() }
}

/// Reads the structure from the start of these bytes; `None` if they are too few.
pub(crate) fn read<T: Plain>(bytes: &[u8]) -> Option<T> {
    // SAFETY: there are enough bytes, and all bytes are valid for it; the read does not rely on alignment.
    (bytes.len() >= size_of::<T>()).then(|| unsafe { bytes.as_ptr().cast::<T>().read_unaligned() })
}
