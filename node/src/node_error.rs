//! Why a node's process ends with an error.

use protocol_linux::{DriverError, PortError, StartError};

use crate::trace_file::TraceError;

/// Why a node's process ends with an error.
#[derive(Debug, thiserror::Error)]
pub enum NodeError {
    /// It could not start.
    #[error(transparent)]
    Start(#[from] StartError),
    /// A port of its bus cannot be opened.
    #[error(transparent)]
    Port(#[from] PortError),
    /// Its cycles cannot be recorded.
    #[error(transparent)]
    Trace(#[from] TraceError),
    /// Waiting for inputs failed.
    #[error("waiting for commands and news: {reason}")]
    Inbox {
        /// The kernel's error.
        reason: std::io::Error,
    },
    /// The cyclic thread's driver failed.
    #[error(transparent)]
    Driver(#[from] DriverError),
    /// The cyclic thread panicked; its message is on standard error.
    #[error("the cyclic thread panicked; this is a fault of the program, please report the output above")]
    Panic,
}
