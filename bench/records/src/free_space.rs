//! Room on a disk.

use std::path::Path;

/// Returns how many bytes this user can still write to the disk of a directory; `None` where the system does not say.
#[cfg(target_os = "linux")]
#[must_use]
pub fn free_space(directory: &Path) -> Option<u64> {
    let found = rustix::fs::statvfs(directory).ok()?;
    found.f_bavail.checked_mul(found.f_frsize)
}

/// Returns how many bytes this user can still write to the disk of a directory; `None`: only Linux says it here.
#[cfg(not(target_os = "linux"))]
#[must_use]
pub const fn free_space(_directory: &Path) -> Option<u64> {
    None
}
