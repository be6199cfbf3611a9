//! The device's records, and which of them a controller may write.

use super::relation::Relation;
use crate::block::BlockWriter;
use crate::connect::{API, emit_module_diff};
use crate::description::{Description, INTERFACE_SUBSLOT, Submodule};
use crate::record::{
    Address, Diagnosis, LogBook, Maintenance, PhysicalDevice, PhysicalParameters, ReadRequest, WriteRequest,
    WriteResponse, emit_api_data, emit_ar_data, emit_expected_identification, emit_im0, emit_im0_filter_data,
    emit_real_identification, index, is_port,
};
use crate::status::{Service, Status, Violation};
use machine::Instant;

/// Length of the longest record, in bytes.
pub(super) const RECORD_CAPACITY: usize = 4096;

/// Who a record is written to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Written<'a> {
    pub(super) description: &'a Description,
    /// I&M1 to 4 as they are; `None` if they cannot be stored.
    pub(super) maintenance: Option<&'a Maintenance>,
}

impl Written<'_> {
    /// Returns the result of writing one record.
    pub(super) fn status(&self, write: &WriteRequest<'_>) -> Status {
        self.change(write).map_or_else(|violation| violation.status(Service::Write), |_| Status::OK)
    }

    /// Checks a Write and returns what it changes.
    pub(super) fn change<'b>(&self, write: &WriteRequest<'b>) -> Result<Change<'b>, Violation> {
        let address = &write.address;
        let submodule = check_place(self.description, address)?;
        if PhysicalParameters::has(address.subslot, address.index) {
            let block = PhysicalParameters::check(address.subslot, address.index, write.record)?;
            return Ok(Change::Physical(block));
        }
        let Some(maintenance) = self.maintenance.filter(|_| Maintenance::has(address.index)) else {
            return check_index(submodule, address.index).map(|()| Change::Parameter);
        };
        // Those of the whole device are written where its I&M0 is, by I&M0FilterData.
        let access_point = self.description.submodules().next();
        if access_point
            .is_none_or(|(slot, submodule)| (slot, submodule.subslot) != (address.slot, address.subslot))
        {
            return Err(Violation::AccessDenied);
        }
        maintenance.written(address.index, write.record).map(Change::Maintenance)
    }
}

/// What a Write changes.
#[derive(Clone, Copy, Debug)]
pub(super) enum Change<'a> {
    /// I&M1 to 4, to these.
    Maintenance(Maintenance),
    /// A record of the interface or of a port, to this block.
    Physical(&'a [u8]),
    /// A parameter of a submodule, which is the owner's.
    Parameter,
}

fn check_place<'a>(description: &'a Description, address: &Address) -> Result<&'a Submodule, Violation> {
    if address.api != API {
        return Err(Violation::InvalidApi);
    }
    description.submodule(address.slot, address.subslot).ok_or(Violation::InvalidSlot)
}

fn check_index(submodule: &Submodule, index: u16) -> Result<(), Violation> {
    match index {
        index if submodule.parameters.contains(&index) => Ok(()),
        index::IDENTIFICATION_AND_MAINTENANCE_0
        | index::EXPECTED_IDENTIFICATION_SUBSLOT
        | index::REAL_IDENTIFICATION_SUBSLOT
        | index::INPUT_DATA
        | index::OUTPUT_DATA
        | index::PD_PORT_DATA_REAL
        | index::PD_INTERFACE_DATA_REAL => Err(Violation::AccessDenied),
        _ => Err(Violation::InvalidIndex),
    }
}

/// Writes the answers to a Write, or to each Write in a MultipleWrite.
pub(super) fn emit_write_answer(
    written: Written<'_>,
    write: &WriteRequest<'_>,
    status: Status,
    writer: &mut BlockWriter<'_>,
) {
    WriteResponse { address: write.address, length: 0, status }.emit(writer);
    if write.address.index == index::MULTIPLE_WRITE {
        for part in write.writes().flatten() {
            let status = written.status(&part);
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

/// Returns whether an index is that of diagnosis or maintenance data, whatever it is about. Without any, such a record is empty.
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
    /// I&M1 to 4; `None` if they cannot be stored.
    pub(super) maintenance: Option<&'a Maintenance>,
    /// The AR, if there is one.
    pub(super) relation: Option<&'a Relation>,
    pub(super) physical: PhysicalDevice<'a>,
    pub(super) log_book: &'a LogBook,
    pub(super) diagnosis: &'a [Diagnosis],
    pub(super) now: Instant,
}

impl Records<'_> {
    /// Writes the requested record into `record` and returns its length.
    pub(super) fn read(
        &self,
        read: &ReadRequest,
        record: &mut [u8; RECORD_CAPACITY],
    ) -> Result<usize, Violation> {
        let Self { description, maintenance, physical, log_book, now, .. } = *self;
        let (address, index) = (&read.address, read.address.index);
        let scope = Scope::of(index);
        scope.check(address, description)?;
        let wanted = |slot, subslot| scope.includes(address, slot, subslot);
        let mut writer = BlockWriter::new(record);
        match index {
            index::IDENTIFICATION_AND_MAINTENANCE_0 => {
                let supported = if maintenance.is_some() { Maintenance::SUPPORTED } else { 0 };
                emit_im0(description, supported, &mut writer);
            }
            index if Maintenance::has(index) => {
                maintenance.ok_or(Violation::InvalidIndex)?.emit(index, &mut writer);
            }
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
            index::INPUT_DATA => {
                let relation = self.relation.ok_or(Violation::InvalidIndex)?;
                let data = relation.input_data(address.slot, address.subslot);
                data.ok_or(Violation::InvalidIndex)?.emit_input(&mut writer);
            }
            index::OUTPUT_DATA => {
                let relation = self.relation.ok_or(Violation::InvalidIndex)?;
                let data = relation.output_data(address.slot, address.subslot);
                let (data, in_use) = data.ok_or(Violation::InvalidIndex)?;
                data.emit_output(in_use, &mut writer);
            }
            index::PD_PORT_DATA_REAL if is_port(address.subslot) => {
                physical.emit_port(address.slot, address.subslot, &mut writer);
            }
            index::PD_INTERFACE_DATA_REAL if address.subslot == INTERFACE_SUBSLOT => {
                physical.emit_interface(&mut writer);
            }
            index::PD_REAL_DATA => physical.emit_all(description, &mut writer),
            index if PhysicalParameters::has(address.subslot, index) => {
                if let Some(relation) = self.relation {
                    relation.physical.emit(address.slot, address.subslot, index, &mut writer);
                }
            }
            index::PD_EXPECTED_DATA => {
                if let Some(relation) = self.relation {
                    relation.physical.emit_all(&mut writer);
                }
            }
            index::AR_DATA | index::AR_DATA_API => {
                let ar = self.relation.map(Relation::ar_data);
                emit_ar_data(ar.as_slice(), &mut writer);
            }
            index::API_DATA => emit_api_data(&mut writer),
            index::LOG_BOOK => log_book.emit(now, &mut writer),
            index::IM0_FILTER_DATA => emit_im0_filter_data(description, &mut writer),
            index::CONNECTION_MONITORING_TRIGGER => {}
            index if is_diagnosis(index) => {
                let wanted = |it: &&Diagnosis| it.is_in(index) && wanted(it.slot, it.subslot);
                self.diagnosis.iter().filter(wanted).for_each(|it| it.emit(&mut writer));
            }
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
