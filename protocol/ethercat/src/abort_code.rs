//! SDO abort codes (ETG.1000.6, table of SDO abort codes).

/// Why an SDO transfer was aborted.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub(crate) struct AbortCode(pub(crate) u32);

impl AbortCode {
    /// A segment does not change the toggle bit.
    pub(crate) const TOGGLE: Self = Self(0x0503_0000);
    /// The command does not exist, or no transfer is running.
    pub(crate) const COMMAND: Self = Self(0x0504_0001);
    /// The entry cannot be read.
    pub(crate) const WRITE_ONLY: Self = Self(0x0601_0001);
    /// The entry cannot be written.
    pub(crate) const READ_ONLY: Self = Self(0x0601_0002);
    /// The object cannot be accessed as a whole.
    pub(crate) const NO_COMPLETE_ACCESS: Self = Self(0x0601_0004);
    /// Subindex 0 has to be 0 while the others are written.
    pub(crate) const COUNT_NOT_ZERO: Self = Self(0x0601_0003);
    /// The object cannot be mapped into process data.
    pub(crate) const NOT_MAPPABLE: Self = Self(0x0604_0041);
    /// More objects, or longer ones, than process data have room for.
    pub(crate) const TOO_MUCH_TO_MAP: Self = Self(0x0604_0042);
    /// There is no such object.
    pub(crate) const NO_OBJECT: Self = Self(0x0602_0000);
    /// The length does not fit the type.
    pub(crate) const LENGTH: Self = Self(0x0607_0010);
    /// More bytes than the type has.
    pub(crate) const TOO_LONG: Self = Self(0x0607_0012);
    /// Fewer bytes than the type has.
    pub(crate) const TOO_SHORT: Self = Self(0x0607_0013);
    /// The object has no such subindex.
    pub(crate) const NO_SUBINDEX: Self = Self(0x0609_0011);
    /// The value is none of those that the entry may have.
    pub(crate) const VALUE_RANGE: Self = Self(0x0609_0030);
    /// General error.
    pub(crate) const GENERAL: Self = Self(0x0800_0000);
    /// Not in the device's present state.
    pub(crate) const WRONG_STATE: Self = Self(0x0800_0022);
}
