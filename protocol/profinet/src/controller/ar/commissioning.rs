//! Services of an AR for a tool beside its data: alarms, records by index, and devices with other modules than
//! expected.

use alloc::collections::VecDeque;
use alloc::vec::Vec;

use super::call::{Caller, LONGEST_ANSWER};
use super::{Ar, ArPhase, Refusal, link};
use crate::alarm::{Alarm, AlarmHead, Notification, Rta};
use crate::block::BlockReader;
use crate::connect;
use crate::record::{Address, HEADER_LEN, ReadRequest, ReadResponse, WriteRequest, WriteResponse};
use crate::rpc::{ARGS_LEN, DEVICE_INTERFACE, LONGEST_BODY, Operation, RequestArgs, ResponseArgs};
use crate::status::Status;
use crate::{Parameter, Uuid};
use machine::Instant;

/// Alarms that wait for the owner; later ones are counted as lost.
const MOST_ALARMS: usize = 32;

/// Longest data of an alarm that the controller accepts (MaxAlarmDataLength of its Connect).
const LONGEST_ITEMS: usize = 256;

/// Alarm of the device.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct ReceivedAlarm {
    /// Type and source.
    pub head: AlarmHead,
    /// ModuleIdentNumber and SubmoduleIdentNumber.
    pub idents: (u32, u32),
    /// AlarmSpecifier.
    pub specifier: u16,
    /// UserStructureIdentifier and data, one after another.
    pub items: Vec<u8>,
}

/// Reason why a record cannot be read or written.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum RecordError {
    /// No data are exchanged.
    #[error("the device is not connected; ask again once it is")]
    NotConnected,
    /// Another call waits for its answer.
    #[error("the device is answering an earlier request; ask again after that answer")]
    Busy,
    /// The record is too long.
    #[error("{0} bytes: a record has at most {1}; shorten it")]
    TooLong(usize, usize),
}

/// State of what a tool asks for.
#[derive(Default, Debug)]
pub(super) struct Commissioning {
    keeps_alarms: bool,
    /// True if the device takes several parameter records at once.
    pub(super) writes_together: bool,
    accepts_differences: bool,
    alarms: VecDeque<ReceivedAlarm>,
    refused_records: Vec<(Parameter, Status)>,
    record: RecordAccess,
}

#[derive(Default, Debug)]
enum RecordAccess {
    #[default]
    None,
    Called,
    Answered(Result<Vec<u8>, Status>),
}

impl Commissioning {
    /// Keeps an alarm, if the owner wants alarms.
    fn note_alarm(&mut self, notification: &Notification<'_>) {
        let has_room = self.keeps_alarms && self.alarms.len() < MOST_ALARMS;
        if has_room && notification.items.len() <= LONGEST_ITEMS {
            self.alarms.push_back(ReceivedAlarm {
                head: notification.head,
                idents: (notification.module_ident, notification.submodule_ident),
                specifier: notification.specifier,
                items: notification.items.to_vec(),
            });
        }
    }
}

impl Ar {
    /// Takes over the alarm of a PDU that was acknowledged.
    pub(super) fn note_alarm(&mut self, pdu: &[u8]) {
        let Ok((_, variable)) = Rta::parse(pdu) else { return };
        if let Ok(Alarm::Notification(notification)) = Alarm::parse(variable) {
            self.health.note(&notification);
            self.commissioning.note_alarm(&notification);
        }
    }

    /// Keeps alarms for [`poll_alarm`](Self::poll_alarm), at most 32 at a time. Without this they are acknowledged only.
    pub fn keep_alarms(&mut self) {
        self.commissioning.keeps_alarms = true;
    }

    /// Drives a device whose modules or submodules differ: [`module_diff`](Self::module_diff) has the differences, those
    /// submodules have no data and get no records, and a record that is refused does not end the attempt. Without this the
    /// connection is refused.
    pub fn accept_differences(&mut self) {
        self.commissioning.accepts_differences = true;
    }

    /// Writes the parameter records of the startup together, in MultipleWrites, as devices want it whose GSDML file says
    /// MultipleWriteSupported. A device that refuses this gets each record on its own.
    pub fn write_together(&mut self) {
        self.commissioning.writes_together = true;
    }

    /// Reads and writes records of up to 64 KiB from now on; without this, of about 8 KiB. Call it before the device connects.
    pub fn accept_long_records(&mut self) {
        self.caller = Caller::new(DEVICE_INTERFACE, LONGEST_BODY);
    }

    /// Returns the length in bytes of the longest record that can be read or written.
    #[must_use]
    pub fn longest_record(&self) -> usize {
        self.caller.capacity().saturating_sub(ARGS_LEN + HEADER_LEN)
    }

    /// Returns the next alarm.
    pub fn poll_alarm(&mut self) -> Option<ReceivedAlarm> {
        self.commissioning.alarms.pop_front()
    }

    /// Returns the next parameter record of the startup that the device refused, with its status.
    pub fn poll_refused_record(&mut self) -> Option<(Parameter, u32)> {
        self.commissioning.refused_records.pop().map(|(parameter, status)| (parameter, status.0))
    }

    /// Reads a record. [`take_record`](Self::take_record) returns it.
    ///
    /// # Errors
    ///
    /// No data are exchanged, or another call waits.
    pub fn read_record(
        &mut self,
        now: Instant,
        (slot, subslot): (u16, u16),
        index: u16,
    ) -> Result<(), RecordError> {
        let address = self.record_address(slot, subslot, index)?;
        let most = self.longest_record();
        let request = ReadRequest { address, most: most as u32, target_ar: Uuid([0; 16]) };
        let longest_answer = (most + HEADER_LEN) as u32;
        let called = self.caller.call(now, Operation::Read, |body| {
            RequestArgs::emit(longest_answer, body, |writer| request.emit(writer))
        });
        called.map_err(|_| RecordError::TooLong(0, most))?;
        self.record_called();
        Ok(())
    }

    /// Writes a record. [`take_record`](Self::take_record) returns the result.
    ///
    /// # Errors
    ///
    /// No data are exchanged, another call waits, or the record is too long.
    pub fn write_record(
        &mut self,
        now: Instant,
        (slot, subslot): (u16, u16),
        index: u16,
        record: &[u8],
    ) -> Result<(), RecordError> {
        let most = self.longest_record();
        if record.len() > most {
            return Err(RecordError::TooLong(record.len(), most));
        }
        let address = self.record_address(slot, subslot, index)?;
        let request = WriteRequest { address, record };
        let called = self.caller.call(now, Operation::Write, |body| {
            RequestArgs::emit(LONGEST_ANSWER, body, |writer| request.emit(writer))
        });
        called.map_err(|_| RecordError::TooLong(record.len(), most))?;
        self.record_called();
        Ok(())
    }

    /// Returns the record read, or nothing of one written, or the status of a refusal; 0 if no answer came. `None` while the
    /// answer is awaited.
    pub fn take_record(&mut self) -> Option<Result<Vec<u8>, u32>> {
        match core::mem::take(&mut self.commissioning.record) {
            RecordAccess::Answered(result) => Some(result.map_err(|status| status.0)),
            other => {
                self.commissioning.record = other;
                None
            }
        }
    }

    fn record_address(&self, slot: u16, subslot: u16, index: u16) -> Result<Address, RecordError> {
        if self.phase != ArPhase::Exchanging {
            return Err(RecordError::NotConnected);
        }
        if !matches!(self.commissioning.record, RecordAccess::None) || !self.plugs.is_empty() {
            return Err(RecordError::Busy);
        }
        let ar = self.plan.connect.ar.uuid;
        Ok(Address { sequence: index, ar, api: connect::API, slot, subslot, index })
    }

    fn record_called(&mut self) {
        self.acyclic = super::acyclic::Acyclic::Active;
        self.commissioning.record = RecordAccess::Called;
    }

    /// Returns whether a record of the owner is being read or written.
    pub(super) fn awaits_record(&self) -> bool {
        self.phase == ArPhase::Exchanging && matches!(self.commissioning.record, RecordAccess::Called)
    }

    pub(super) fn record_answered(&mut self, now: Instant, result: Result<Vec<u8>, Status>) {
        self.commissioning.record = RecordAccess::Answered(result);
        self.continue_plug(now);
    }

    /// Ends the wait for a record, since the connection has ended.
    pub(super) fn give_up_record(&mut self) {
        if matches!(self.commissioning.record, RecordAccess::Called) {
            self.commissioning.record = RecordAccess::Answered(Err(Status(0)));
        }
    }

    /// Returns the first difference that ends the attempt.
    pub(super) fn unusable(&self) -> Option<Refusal> {
        let refusal = link::unusable(&self.diff);
        refusal.filter(|_| !self.commissioning.accepts_differences)
    }

    /// Returns the index of the first record from this one on whose submodule is the expected one.
    pub(super) fn next_parameter(&self, index: usize) -> usize {
        let mut rest = self.config.parameters.iter().enumerate().skip(index);
        let next = rest.find(|(_, parameter)| !self.is_other(parameter.slot, parameter.subslot));
        next.map_or(self.config.parameters.len(), |(index, _)| index)
    }

    fn is_other(&self, slot: u16, subslot: u16) -> bool {
        let mut modules = self.diff.iter().filter(|module| module.slot == slot);
        modules.any(|module| {
            let is_other_module =
                matches!(module.state, connect::ModuleState::NoModule | connect::ModuleState::WrongModule);
            let mut submodules = module.submodules.iter().filter(|it| it.subslot == subslot);
            is_other_module || submodules.any(|it| !it.state.is_usable())
        })
    }

    /// Keeps the record of an index that the device refuses at startup, if the owner accepts differences. Returns whether it does.
    pub(super) fn notes_refused_record(&mut self, parameter: usize, refusal: Refusal) -> bool {
        let Some(record) = self.config.parameters.get(parameter) else { return false };
        // One of each record is enough, however often the device is connected.
        let refused = &mut self.commissioning.refused_records;
        if self.commissioning.accepts_differences && refused.iter().all(|(known, _)| known != record) {
            refused.push((record.clone(), Status(refusal.code)));
        }
        self.commissioning.accepts_differences
    }
}

/// Returns the record in the answer to a Read, or nothing for a Write.
pub(super) fn record_of(args: &ResponseArgs<'_>) -> Result<Vec<u8>, Status> {
    if !args.status.is_ok() {
        return Err(args.status);
    }
    let reader = &mut BlockReader::new(args.blocks);
    if let Ok(read) = ReadResponse::parse(reader) {
        return Ok(read.record.to_vec());
    }
    match WriteResponse::parse(&mut BlockReader::new(args.blocks)) {
        Ok(written) if written.status.is_ok() => Ok(Vec::new()),
        Ok(written) => Err(written.status),
        Err(_) => Err(Status(0)),
    }
}
