//! The SDO information service: lists the objects and describes them (ETG.1000.6, 5.6.3).
//!
//! ```text
//! 0      operation in bits 0..7, bit 7: more fragments follow
//! 2..4   fragments left
//! 4..    by operation
//! ```

use super::{MailboxError, Outbox, coe};
use crate::abort_code::AbortCode;
use crate::description::{Access, DataType, ObjectCode};
use crate::dictionary::{Dictionary, DictionaryEntry, DictionaryObject};
use crate::{Reader, Writer};

const LIST_REQUEST: u8 = 1;
const LIST_RESPONSE: u8 = 2;
const OBJECT_REQUEST: u8 = 3;
const OBJECT_RESPONSE: u8 = 4;
const ENTRY_REQUEST: u8 = 5;
const ENTRY_RESPONSE: u8 = 6;
const ERROR: u8 = 7;

const MORE: u8 = 0x80;

/// Length in bytes of the service's header.
const HEADER_LEN: usize = 4;

/// Lists of objects.
const LENGTHS: u16 = 0;
const ALL: u16 = 1;
const MAPPABLE_OUTPUTS: u16 = 2;
const MAPPABLE_INPUTS: u16 = 3;
const LAST_LIST: u16 = 5;

/// A list that is sent in fragments.
#[derive(Default, Debug)]
pub(super) struct Listing {
    /// Kind of the list, and how many of its objects were sent.
    running: Option<(u16, usize)>,
}

impl Listing {
    /// Serves a request.
    pub(super) fn receive(
        &mut self,
        mut reader: Reader<'_>,
        dictionary: &Dictionary,
        outbox: &mut Outbox,
    ) -> Result<(), MailboxError> {
        let [operation, _, _, _] = reader.array::<HEADER_LEN>().map_err(|_| MailboxError::TooShort)?;
        self.running = None;
        let first = reader.u16().map_err(|_| MailboxError::TooShort)?;
        let served = match operation & !MORE {
            LIST_REQUEST if first == LENGTHS => {
                write(outbox, LIST_RESPONSE, 0, |writer| {
                    writer.u16(LENGTHS);
                    (ALL..=LAST_LIST).for_each(|list| writer.u16(count(dictionary, list) as u16));
                });
                Ok(())
            }
            LIST_REQUEST if first <= LAST_LIST => {
                self.running = Some((first, 0));
                self.continue_with(dictionary, outbox);
                Ok(())
            }
            LIST_REQUEST => Err(AbortCode::GENERAL),
            OBJECT_REQUEST => dictionary.object(first).map(|object| write_object(object, outbox)),
            ENTRY_REQUEST => {
                let [subindex, _] = reader.array().map_err(|_| MailboxError::TooShort)?;
                let chosen = dictionary.is_chosen_by_main_device(first);
                dictionary.object(first).and_then(|object| match object.entry(subindex) {
                    Some(entry) => {
                        write_entry(first, entry, chosen, outbox);
                        Ok(())
                    }
                    // Subindices that a record leaves out have no type, as in Beckhoff's stack: MainDevices ask for each up to the
                    // highest one.
                    None if object.entries.last().is_some_and(|last| subindex < last.subindex) => {
                        write_gap(first, subindex, outbox);
                        Ok(())
                    }
                    None => Err(AbortCode::NO_SUBINDEX),
                })
            }
            _ => Err(AbortCode::COMMAND),
        };
        if let Err(code) = served {
            write(outbox, ERROR, 0, |writer| writer.u32(code.0));
        }
        Ok(())
    }

    /// Writes the next fragment of a list. Returns whether there was one.
    pub(super) fn continue_with(&mut self, dictionary: &Dictionary, outbox: &mut Outbox) -> bool {
        let Some((list, sent)) = self.running else { return false };
        let room = outbox.capacity().saturating_sub(coe::LEN + HEADER_LEN) / 2;
        let left = count(dictionary, list).saturating_sub(sent);
        // The first fragment names the list.
        let fits = if sent == 0 { room.saturating_sub(1) } else { room }.max(1);
        let (now, behind) = (left.min(fits), left.saturating_sub(fits));
        write(outbox, LIST_RESPONSE, behind.div_ceil(room.max(1)) as u16, |writer| {
            if sent == 0 {
                writer.u16(list);
            }
            let indices = objects(dictionary, list).skip(sent).take(now).map(|object| object.index);
            indices.for_each(|index| writer.u16(index));
        });
        self.running = (behind > 0).then_some((list, sent + now));
        true
    }
}

fn write(outbox: &mut Outbox, operation: u8, left: u16, write: impl FnOnce(&mut Writer<'_>)) {
    coe::write(outbox, coe::SDO_INFORMATION, |writer| {
        writer.u8(operation | if left > 0 { MORE } else { 0 });
        writer.u8(0);
        writer.u16(left);
        write(writer);
    });
}

/// Returns the objects of a list: all, or those that can be mapped into process data; the other lists are empty.
fn objects(dictionary: &Dictionary, list: u16) -> impl Iterator<Item = &DictionaryObject> {
    dictionary.objects().iter().filter(move |object| match list {
        ALL => true,
        MAPPABLE_OUTPUTS => object.entries.iter().any(|entry| entry.mappable.1),
        MAPPABLE_INPUTS => object.entries.iter().any(|entry| entry.mappable.0),
        _ => false,
    })
}

fn count(dictionary: &Dictionary, list: u16) -> usize {
    objects(dictionary, list).count()
}

fn write_object(object: &DictionaryObject, outbox: &mut Outbox) {
    let last = object.entries.last();
    let data_type = match (object.code, object.index, last) {
        (ObjectCode::Record, 0x1018, _) => DataType::Identity as u16,
        (ObjectCode::Record, 0x1600..=0x1BFF, _) => DataType::PdoMapping as u16,
        (ObjectCode::Record, ..) => 0,
        // The type of its elements, also where there are none.
        (ObjectCode::Array, 0x1C10..=0x1C2F, _) => DataType::Unsigned16 as u16,
        (_, _, last) => last.map_or(0, |entry| entry.data_type as u16),
    };
    let room = outbox.capacity().saturating_sub(coe::LEN + HEADER_LEN + 6);
    write(outbox, OBJECT_RESPONSE, 0, |writer| {
        writer.u16(object.index);
        writer.u16(data_type);
        writer.u8(last.map_or(0, |entry| entry.subindex));
        writer.u8(object.code as u8);
        writer.bytes(cut(object.name, room));
    });
}

fn write_entry(index: u16, entry: &DictionaryEntry, chosen: bool, outbox: &mut Outbox) {
    let (input, output) = entry.mappable;
    let access = match entry.access {
        // Read always, written in PRE-OP.
        Access::ReadOnly if chosen => 0x0F,
        Access::ReadOnly => 0x07,
        Access::ReadWrite | Access::WriteOneOf(_) => 0x3F,
        Access::WriteInPreOp => 0x0F,
        Access::WriteOnly => 0x38,
    };
    let access = access | if output { 0x40 } else { 0 } | if input { 0x80 } else { 0 };
    let room = outbox.capacity().saturating_sub(coe::LEN + HEADER_LEN + 10);
    write(outbox, ENTRY_RESPONSE, 0, |writer| {
        writer.u16(index);
        writer.u8(entry.subindex);
        writer.u8(0); // no unit, default, minimum or maximum
        writer.u16(entry.data_type as u16);
        writer.u16(entry.bits as u16);
        writer.u16(access);
        writer.bytes(cut(&entry.name, room));
    });
}

fn write_gap(index: u16, subindex: u8, outbox: &mut Outbox) {
    write(outbox, ENTRY_RESPONSE, 0, |writer| {
        writer.u16(index);
        writer.u8(subindex);
        writer.zeros(7);
    });
}

fn cut(name: &str, room: usize) -> &[u8] {
    name.as_bytes().get(..name.len().min(room)).unwrap_or_default()
}
