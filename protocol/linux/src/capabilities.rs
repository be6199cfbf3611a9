//! Capabilities that a program's file has, for a user who is not root: `setcap cap_net_raw=p plc-node`.
//!
//! The kernel lends a program those of them that its surroundings permit, a container's for one. With `=ep` instead of
//! `=p` it would refuse to start the program where one is missing, and some of ours are not needed everywhere.

use rustix::thread::{CapabilitySets, capabilities, set_capabilities};

/// Makes every capability that this thread has effective. Threads inherit them from the one that makes them, so call it
/// before any other is there.
///
/// # Errors
///
/// What the kernel said.
pub fn raise() -> std::io::Result<()> {
    let sets = capabilities(None)?;
    if sets.effective != sets.permitted {
        set_capabilities(None, CapabilitySets { effective: sets.permitted, ..sets })?;
    }
    Ok(())
}
