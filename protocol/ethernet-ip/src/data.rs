//! The error for data that do not fit an assembly.

/// Why data cannot be set.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum DataError {
    /// There is no assembly of this instance that is sent.
    #[error("assembly {instance} is not sent by this device: only assemblies of the role `Produced` are")]
    NotProduced {
        /// The instance.
        instance: u32,
    },
    /// The assembly has data of another length.
    #[error("the assembly has {expected} bytes of data, not {found}")]
    Length {
        /// Its length in bytes.
        expected: usize,
        /// Bytes that were passed.
        found: usize,
    },
}
