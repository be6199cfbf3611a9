//! Parameter records that are written together at the start: one MultipleWrite carries as many as fit.

use alloc::vec::Vec;

use super::call::LONGEST_ANSWER;
use super::{Ar, Refusal};
use crate::Uuid;
use crate::block::BlockReader;
use crate::connect;
use crate::controller::config::Parameter;
use crate::record::{Address, HEADER_LEN, WriteRequest, WriteResponse, emit_multiple_write};
use crate::rpc::{ARGS_LEN, BODY_CAPACITY, LONGEST_BODY, Operation, RequestArgs};
use crate::status::Status;
use machine::Instant;
use machine::wire::Overflow;

/// Returns the room in bytes that the calls of an AR need with these parameter records.
pub(super) fn capacity(parameters: &[Parameter]) -> usize {
    let longest = parameters.iter().map(|parameter| parameter.data.len()).max().unwrap_or(0);
    let needed = longest + ARGS_LEN + HEADER_LEN;
    needed.clamp(BODY_CAPACITY, LONGEST_BODY)
}

/// Returns the status of each record of a MultipleWrite from the blocks of its answer; `None` if they do not fit together.
pub(super) fn statuses(blocks: &[u8], ar: Uuid) -> Option<Vec<Status>> {
    let mut reader = BlockReader::new(blocks);
    WriteResponse::parse(&mut reader).ok()?;
    let mut statuses = Vec::new();
    while !reader.is_empty() {
        let written = WriteResponse::parse(&mut reader).ok().filter(|written| written.address.ar == ar)?;
        statuses.push(written.status);
    }
    Some(statuses)
}

/// Returns the bytes of a record among others: its head, and what fills it up to a multiple of four.
const fn length_among_others(record: usize) -> usize {
    HEADER_LEN + record.next_multiple_of(4)
}

impl Ar {
    /// Returns the index after the last record that is written together with the one of this index.
    pub(super) fn together_from(&self, index: usize) -> usize {
        if !self.commissioning.writes_together {
            return index + 1;
        }
        let room = self.caller.capacity().saturating_sub(ARGS_LEN + HEADER_LEN);
        // The answer has a head for each record, and one for all.
        let most_answers = LONGEST_ANSWER as usize / HEADER_LEN - 1;
        let (mut end, mut next, mut length, mut count) = (index, index, 0, 0);
        while let Some(parameter) = self.config.parameters.get(next) {
            length += length_among_others(parameter.data.len());
            count += 1;
            if length > room || count > most_answers {
                break;
            }
            end = next + 1;
            next = self.next_parameter(end);
        }
        end.max(index + 1)
    }

    /// Returns the indices of the records that are written together.
    fn together(&self, first: usize, end: usize) -> impl Iterator<Item = usize> + Clone + '_ {
        core::iter::successors(Some(first), |index| Some(self.next_parameter(index + 1)))
            .take_while(move |index| *index < end)
    }

    /// Calls a MultipleWrite of the parameter records of these indices.
    pub(super) fn call_multiple_write(
        &mut self,
        now: Instant,
        first: usize,
        end: usize,
    ) -> Result<(), Overflow> {
        let ar = self.plan.connect.ar.uuid;
        let indices: Vec<usize> = self.together(first, end).collect();
        let parameters = &self.config.parameters;
        let parts = indices.iter().filter_map(|index| {
            let Parameter { slot, subslot, index: record, data } = parameters.get(*index)?;
            let sequence = u16::try_from(*index).unwrap_or(u16::MAX);
            let address =
                Address { sequence, ar, api: connect::API, slot: *slot, subslot: *subslot, index: *record };
            Some(WriteRequest { address, record: data })
        });
        let sequence = u16::try_from(first).unwrap_or(u16::MAX);
        self.caller.call(now, Operation::Write, |body| {
            RequestArgs::emit(LONGEST_ANSWER, body, |writer| emit_multiple_write(sequence, ar, parts, writer))
        })
    }

    /// Returns the refusal of a record that was written together with others, if the AR cannot go on without it.
    pub(super) fn refused_of_several(
        &mut self,
        first: usize,
        end: usize,
        statuses: &[Status],
    ) -> Option<Refusal> {
        let indices: Vec<usize> = self.together(first, end).collect();
        if indices.len() != statuses.len() {
            return Some(Refusal { code: 0, text: super::down_reasons::UNFIT_ANSWER });
        }
        indices.into_iter().zip(statuses).find_map(|(index, status)| {
            let refusal = Refusal { code: status.0, text: status.text() };
            let goes_on = status.is_ok()
                || self.is_dispensable(index, refusal)
                || self.notes_refused_record(index, refusal);
            (!goes_on).then_some(refusal)
        })
    }
}
