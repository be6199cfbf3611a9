//! Which connection of which originator.

use machine::wire::Truncated;

use super::super::{Reader, Writer};

/// Worldwide unique identity of a connection.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug)]
pub struct Triad {
    /// Number that the originator gave the connection.
    pub connection_serial: u16,
    /// ODVA vendor number of the originator.
    pub vendor: u16,
    /// Serial number of the originator.
    pub originator_serial: u32,
}

impl Triad {
    pub(crate) fn parse(reader: &mut Reader<'_>) -> Result<Self, Truncated> {
        Ok(Self { connection_serial: reader.u16()?, vendor: reader.u16()?, originator_serial: reader.u32()? })
    }

    pub(crate) fn emit(self, writer: &mut Writer<'_>) {
        writer.u16(self.connection_serial);
        writer.u16(self.vendor);
        writer.u32(self.originator_serial);
    }
}
