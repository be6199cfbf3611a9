//! The CoE header (ETG.1000.6, 5.6.1): number in bits 0..9, service in bits 12..16.

use super::{Outbox, PROTOCOL_COE};
use crate::Writer;

pub(super) const EMERGENCY: u16 = 1;
pub(super) const SDO_REQUEST: u16 = 2;
pub(super) const SDO_RESPONSE: u16 = 3;
pub(super) const SDO_INFORMATION: u16 = 8;

/// Length in bytes of the header.
pub(super) const LEN: usize = 2;

/// Returns the service of a header.
pub(super) const fn service(header: u16) -> u16 {
    header >> 12
}

/// Writes a CoE message.
pub(super) fn write(outbox: &mut Outbox, service: u16, write: impl FnOnce(&mut Writer<'_>)) {
    outbox.write(PROTOCOL_COE, |writer| {
        writer.u16(service << 12);
        write(writer);
    });
}
