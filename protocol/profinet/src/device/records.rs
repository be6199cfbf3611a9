//! The device's records, and which of them a controller may write.

use crate::block::BlockWriter;
use crate::connect::API;
use crate::description::{Description, INTERFACE_SUBSLOT};
use crate::record::{
    Address, ReadRequest, WriteRequest, WriteResponse, emit_im0, emit_real_identification, index,
};
use crate::status::{Service, Status, Violation};

/// Length of the longest record, in bytes.
pub(super) const RECORD_CAPACITY: usize = 2048;

/// Records of an interface or port that a controller writes to configure the physical device. They are accepted
/// without effect, since the operating system owns the interface.
const PHYSICAL_DEVICE: core::ops::RangeInclusive<u16> = 0x8020..=0x80FF;

/// Returns the result of writing one record.
pub(super) fn write_status(description: &Description, write: &WriteRequest<'_>) -> Status {
    check_write(description, &write.address)
        .map_or_else(|violation| violation.status(Service::Write), |()| Status::OK)
}

fn check_write(description: &Description, address: &Address) -> Result<(), Violation> {
    if address.api != API {
        return Err(Violation::InvalidApi);
    }
    let submodule = description.submodule(address.slot, address.subslot).ok_or(Violation::InvalidSlot)?;
    let is_physical = address.subslot >= INTERFACE_SUBSLOT && PHYSICAL_DEVICE.contains(&address.index);
    if is_physical || submodule.parameters.contains(&address.index) {
        Ok(())
    } else if address.index == index::IDENTIFICATION_AND_MAINTENANCE_0 {
        Err(Violation::AccessDenied)
    } else {
        Err(Violation::InvalidIndex)
    }
}

/// Writes the answers to a Write, or to each Write in a MultipleWrite.
pub(super) fn emit_write_answer(
    description: &Description,
    write: &WriteRequest<'_>,
    status: Status,
    writer: &mut BlockWriter<'_>,
) {
    WriteResponse { address: write.address, length: 0, status }.emit(writer);
    if write.address.index == index::MULTIPLE_WRITE {
        for part in write.writes().flatten() {
            let status = write_status(description, &part);
            WriteResponse { address: part.address, length: 0, status }.emit(writer);
        }
    }
}

/// Writes the requested record into `record` and returns its length.
pub(super) fn read(
    description: &Description,
    read: &ReadRequest,
    record: &mut [u8; RECORD_CAPACITY],
) -> Result<usize, Violation> {
    let Address { api, slot, subslot, index, .. } = read.address;
    let mut writer = BlockWriter::new(record);
    // Records of the whole device can be addressed with any slot.
    let is_of_device = matches!(index, index::REAL_IDENTIFICATION_AR | index::REAL_IDENTIFICATION_API);
    if !is_of_device && api != API {
        return Err(Violation::InvalidApi);
    }
    let is_of_slot = index == index::REAL_IDENTIFICATION_SLOT;
    if is_of_slot && description.module(slot).is_none() {
        return Err(Violation::InvalidSlot);
    }
    if !is_of_device && !is_of_slot && description.submodule(slot, subslot).is_none() {
        return Err(Violation::InvalidSlot);
    }
    match index {
        index::IDENTIFICATION_AND_MAINTENANCE_0 => emit_im0(description, &mut writer),
        index::REAL_IDENTIFICATION_SUBSLOT => {
            emit_real_identification(description, |at, sub| (at, sub) == (slot, subslot), &mut writer);
        }
        index::REAL_IDENTIFICATION_SLOT => {
            emit_real_identification(description, |at, _| at == slot, &mut writer);
        }
        index::REAL_IDENTIFICATION_AR | index::REAL_IDENTIFICATION_API => {
            emit_real_identification(description, |_, _| true, &mut writer);
        }
        _ => return Err(Violation::InvalidIndex),
    }
    let len = writer.finish().map_err(|_| Violation::OutOfMemory)?;
    let most = usize::try_from(read.most).unwrap_or(usize::MAX);
    if len <= most { Ok(len) } else { Err(Violation::InvalidRange) }
}
