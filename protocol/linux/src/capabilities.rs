//! Capabilities of a program's file, for a user who is not root: `setcap cap_net_raw=p plc-node`.
//!
//! The kernel grants the program those of them that its environment permits, for example its container. With `=ep`
//! instead of `=p` the kernel would refuse to start the program where one is missing, and some of ours are not needed
//! everywhere.

use rustix::thread::{CapabilitySets, capabilities, set_capabilities};

/// Makes every capability that this thread is permitted effective. Threads inherit capabilities from the thread that
/// creates them, so call this before any other thread exists.
///
/// # Errors
///
/// The kernel's error.
pub fn raise() -> std::io::Result<()> {
    let sets = capabilities(None)?;
    if sets.effective != sets.permitted {
        set_capabilities(None, CapabilitySets { effective: sets.permitted, ..sets })?;
    }
    Ok(())
}
