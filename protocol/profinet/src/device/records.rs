//! The device's records, and which of them a controller may write.

use super::relation::Relation;
use crate::block::BlockWriter;
use crate::connect::{API, emit_module_diff};
use crate::description::{Description, INTERFACE_SUBSLOT};
use crate::record::{
    Address, LogBook, PhysicalDevice, ReadRequest, WriteRequest, WriteResponse, emit_api_data,
    emit_expected_identification, emit_im0, emit_im0_filter_data, emit_port, emit_real_identification, index,
    is_port,
};
use crate::status::{Service, Status, Violation};
use machine::Instant;

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

/// What a record of this index is about, which tells the fields of its address that matter (IEC 61158-6-10, Index).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Scope {
    Subslot,
    Slot,
    Ar,
    Api,
    Device,
}

impl Scope {
    const fn of(index: u16) -> Self {
        match index {
            0..=0xBFFF => Self::Subslot,
            0xC000..=0xDFFF => Self::Slot,
            0xE000..=0xEFFF => Self::Ar,
            0xF000..=0xF7FF => Self::Api,
            0xF800..=0xFFFF => Self::Device,
        }
    }

    /// Checks the fields of an address that matter; a record of the whole device can be read at any slot and subslot.
    fn check(self, address: &Address, description: &Description) -> Result<(), Violation> {
        let Address { api, slot, subslot, .. } = *address;
        let (with_api, is_there) = match self {
            Self::Subslot => (true, description.submodule(slot, subslot).is_some()),
            Self::Slot => (true, description.module(slot).is_some()),
            Self::Api => (true, true),
            Self::Ar | Self::Device => (false, true),
        };
        match (with_api && api != API, is_there) {
            (true, _) => Err(Violation::InvalidApi),
            (false, false) => Err(Violation::InvalidSlot),
            (false, true) => Ok(()),
        }
    }

    /// Returns whether the record of an address is about this submodule.
    const fn includes(self, address: &Address, slot: u16, subslot: u16) -> bool {
        match self {
            Self::Subslot => address.slot == slot && address.subslot == subslot,
            Self::Slot => address.slot == slot,
            Self::Ar | Self::Api | Self::Device => true,
        }
    }
}

/// Returns whether an index is that of diagnosis or maintenance data, whatever it is about. There is never any: such a record
/// is empty.
const fn is_diagnosis(index: u16) -> bool {
    const OF_DEVICE: u16 = 0xF80C;
    // The same numbers of subslot, slot, AR and API.
    let is_scoped = matches!(index & 0xF000, 0x8000 | 0xC000 | 0xE000 | 0xF000);
    index == OF_DEVICE || is_scoped && matches!(index & 0x0FFF, 0x00A..=0x00C | 0x010..=0x013)
}

/// What the device reads its records from.
#[derive(Clone, Copy, Debug)]
pub(super) struct Records<'a> {
    pub(super) description: &'a Description,
    /// The AR, if there is one.
    pub(super) relation: Option<&'a Relation>,
    pub(super) physical: PhysicalDevice<'a>,
    pub(super) log_book: &'a LogBook,
    pub(super) now: Instant,
}

impl Records<'_> {
    /// Writes the requested record into `record` and returns its length.
    pub(super) fn read(
        &self,
        read: &ReadRequest,
        record: &mut [u8; RECORD_CAPACITY],
    ) -> Result<usize, Violation> {
        let Self { description, physical, log_book, now, .. } = *self;
        let (address, index) = (&read.address, read.address.index);
        let scope = Scope::of(index);
        scope.check(address, description)?;
        let wanted = |slot, subslot| scope.includes(address, slot, subslot);
        let mut writer = BlockWriter::new(record);
        match index {
            index::IDENTIFICATION_AND_MAINTENANCE_0 => emit_im0(description, &mut writer),
            index::REAL_IDENTIFICATION_SUBSLOT
            | index::REAL_IDENTIFICATION_SLOT
            | index::REAL_IDENTIFICATION_AR
            | index::REAL_IDENTIFICATION_API => emit_real_identification(description, wanted, &mut writer),
            index::EXPECTED_IDENTIFICATION_SUBSLOT
            | index::EXPECTED_IDENTIFICATION_SLOT
            | index::EXPECTED_IDENTIFICATION_AR => {
                if let Some(relation) = self.relation_of(read)? {
                    emit_expected_identification(relation.expected(), wanted, &mut writer);
                }
            }
            index::MODULE_DIFF => {
                let diff = self.relation_of(read)?.map(Relation::diff).unwrap_or_default();
                if !diff.is_empty() {
                    emit_module_diff(diff, &mut writer);
                }
            }
            index::PD_PORT_DATA_REAL if is_port(address.subslot) => {
                emit_port(address.slot, address.subslot, &mut writer);
            }
            index::PD_INTERFACE_DATA_REAL if address.subslot == INTERFACE_SUBSLOT => {
                physical.emit_interface(&mut writer);
            }
            index::PD_REAL_DATA => physical.emit_all(description, &mut writer),
            index::API_DATA => emit_api_data(&mut writer),
            index::LOG_BOOK => log_book.emit(now, &mut writer),
            index::IM0_FILTER_DATA => emit_im0_filter_data(description, &mut writer),
            index if is_diagnosis(index) => {}
            _ => return Err(Violation::InvalidIndex),
        }
        let len = writer.finish().map_err(|_| Violation::OutOfMemory)?;
        let most = usize::try_from(read.most).unwrap_or(usize::MAX);
        if len <= most { Ok(len) } else { Err(Violation::InvalidRange) }
    }

    /// Returns the AR that a Read is about: that of its target, of itself, or the only one.
    fn relation_of(&self, read: &ReadRequest) -> Result<Option<&Relation>, Violation> {
        let named = [read.target_ar, read.address.ar].into_iter().find(|ar| !ar.is_nil());
        match named {
            Some(ar) => {
                let of_it = |relation: &&Relation| relation.uuid == ar;
                self.relation.filter(of_it).map(Some).ok_or(Violation::RecordArUuid)
            }
            None => Ok(self.relation),
        }
    }
}
