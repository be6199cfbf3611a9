//! Ports and the real-time driver: the one crate with unsafe code.

#![expect(
    unsafe_code,
    reason = "system calls that neither rustix nor socket2 wraps; each use says why it is sound"
)]

mod recorder;

pub use recorder::{Recorder, RecorderError};
