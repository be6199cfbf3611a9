//! Data that the owner of a machine gives it for an assembly.

/// Why data was not taken.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum DataError {
    /// No assembly of this instance is sent.
    #[error("assembly {instance} is not sent by this device: only assemblies of the role `Produced` are")]
    NotProduced {
        /// The instance.
        instance: u32,
    },
    /// The assembly has data of another length.
    #[error("the assembly has {expected} bytes of data, not {found}")]
    Length {
        /// Bytes that it has.
        expected: usize,
        /// Bytes that were given.
        found: usize,
    },
}
