//! SDO transfers (ETG.1000.6, 5.6.2): expedited up to 4 bytes, normal up to the size of the mailbox, longer
//! values in segments.
//!
//! ```text
//! 0      command in bits 5..8; others by command
//! 1..4   index and subindex     not in segments
//! 4..8   data of an expedited transfer; otherwise length of the data
//! 8..    data                   from 1 in segments
//! ```

use alloc::vec::Vec;

use super::{Context, MailboxError, Outbox, coe, report_written};
use crate::Reader;
use crate::abort_code::AbortCode;
use crate::description::{Access, ObjectCode};
use crate::dictionary::configures;

/// Length in bytes of the longest value: longer ones are refused before memory is allocated for them.
const MAX_LEN: usize = 0x1_0000;

/// Commands of the MainDevice.
const DOWNLOAD_SEGMENT: u8 = 0;
const DOWNLOAD: u8 = 1;
const UPLOAD: u8 = 2;
const UPLOAD_SEGMENT: u8 = 3;
const ABORT: u8 = 4;

/// Answers, with their bits.
const SEGMENT_WRITTEN: u8 = 0x20;
const WRITTEN: u8 = 0x60;
const VALUE: u8 = 0x41;
const EXPEDITED: u8 = 0x02;
const COMPLETE_ACCESS: u8 = 0x10;
const TOGGLE: u8 = 0x10;
const LAST: u8 = 0x01;
const ABORTED: u8 = 0x80;

/// Least data of a segment.
const MIN_SEGMENT: usize = 7;

/// The entry or entries that a transfer reads or writes.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
struct Target {
    index: u16,
    subindex: u8,
    /// All entries from the subindex on.
    complete: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
enum Progress {
    #[default]
    Idle,
    /// The device still has to send the bytes from `sent` on.
    Uploading { sent: usize, toggle: bool },
    /// The device waits for up to `len` bytes.
    Downloading { len: usize, toggle: bool },
}

/// The transfer that is running, if one is.
#[derive(Default, Debug)]
pub(super) struct Transfer {
    target: Target,
    data: Vec<u8>,
    progress: Progress,
}

impl Transfer {
    pub(super) const fn reset(&mut self) {
        self.progress = Progress::Idle;
    }

    /// Serves a request.
    pub(super) fn receive(
        &mut self,
        mut reader: Reader<'_>,
        context: &mut Context<'_, '_>,
        outbox: &mut Outbox,
    ) -> Result<(), MailboxError> {
        let command = reader.u8().map_err(|_| MailboxError::TooShort)?;
        let served = match command >> 5 {
            DOWNLOAD_SEGMENT => self.download_segment(command, reader.rest(), context, outbox),
            UPLOAD_SEGMENT => self.upload_segment(command, outbox),
            ABORT => {
                self.reset();
                return Ok(());
            }
            start => {
                let [low, high, subindex] = reader.array().map_err(|_| MailboxError::TooShort)?;
                let index = u16::from_le_bytes([low, high]);
                // A new transfer ends the one before.
                self.reset();
                self.target = Target { index, subindex, complete: command & COMPLETE_ACCESS != 0 };
                match start {
                    DOWNLOAD => {
                        let head = reader.array().map_err(|_| MailboxError::TooShort)?;
                        self.download(command, head, reader.rest(), context, outbox)
                    }
                    UPLOAD => self.upload(context, outbox),
                    _ => Err(AbortCode::COMMAND),
                }
            }
        };
        if let Err(code) = served {
            self.reset();
            self.answer(outbox, ABORTED, code.0);
        }
        Ok(())
    }

    fn answer(&self, outbox: &mut Outbox, command: u8, value: u32) {
        let Target { index, subindex, .. } = self.target;
        // ETG.1000.6 defines an abort as a request, whichever side sends it.
        let service = if command == ABORTED { coe::SDO_REQUEST } else { coe::SDO_RESPONSE };
        coe::write(outbox, service, |writer| {
            writer.u8(command);
            writer.u16(index);
            writer.u8(subindex);
            writer.u32(value);
        });
    }

    fn upload(&mut self, context: &Context<'_, '_>, outbox: &mut Outbox) -> Result<(), AbortCode> {
        self.data.clear();
        collect(self.target, context, &mut self.data)?;
        let complete = if self.target.complete { COMPLETE_ACCESS } else { 0 };
        let len = self.data.len();
        if (1..=4).contains(&len) {
            let mut value = [0; 4];
            value.iter_mut().zip(&self.data).for_each(|(to, from)| *to = *from);
            let command = VALUE | EXPEDITED | complete | ((4 - len) as u8) << 2;
            self.answer(outbox, command, u32::from_le_bytes(value));
            return Ok(());
        }
        let room = outbox.capacity().saturating_sub(coe::LEN + 8);
        let first = len.min(room);
        let Target { index, subindex, .. } = self.target;
        coe::write(outbox, coe::SDO_RESPONSE, |writer| {
            writer.u8(VALUE | complete);
            writer.u16(index);
            writer.u8(subindex);
            writer.u32(len as u32);
            writer.bytes(self.data.get(..first).unwrap_or_default());
        });
        if first < len {
            self.progress = Progress::Uploading { sent: first, toggle: false };
        }
        Ok(())
    }

    fn upload_segment(&mut self, command: u8, outbox: &mut Outbox) -> Result<(), AbortCode> {
        let Progress::Uploading { sent, toggle } = self.progress else { return Err(AbortCode::COMMAND) };
        if (command & TOGGLE != 0) != toggle {
            return Err(AbortCode::TOGGLE);
        }
        let room = outbox.capacity().saturating_sub(coe::LEN + 1);
        let rest = self.data.get(sent..).unwrap_or_default();
        let segment = rest.get(..rest.len().min(room)).unwrap_or_default();
        let last = segment.len() == rest.len();
        let unused = MIN_SEGMENT.saturating_sub(segment.len());
        let toggle_bit = if toggle { TOGGLE } else { 0 };
        coe::write(outbox, coe::SDO_RESPONSE, |writer| {
            writer.u8(toggle_bit | (unused as u8) << 1 | if last { LAST } else { 0 });
            writer.bytes(segment);
            writer.zeros(unused);
        });
        self.progress = if last {
            Progress::Idle
        } else {
            Progress::Uploading { sent: sent + segment.len(), toggle: !toggle }
        };
        Ok(())
    }

    fn download(
        &mut self,
        command: u8,
        head: [u8; 4],
        rest: &[u8],
        context: &mut Context<'_, '_>,
        outbox: &mut Outbox,
    ) -> Result<(), AbortCode> {
        self.data.clear();
        if command & EXPEDITED != 0 {
            // Without the bit for the size, the size is the value's own length.
            let len = match command & 1 {
                0 => own_len(self.target, context)?.min(4),
                _ => 4 - usize::from(command >> 2 & 3),
            };
            self.data.extend(head.iter().take(len));
            return self.store(context, outbox, WRITTEN);
        }
        let len = usize::try_from(u32::from_le_bytes(head)).unwrap_or(usize::MAX);
        if len > MAX_LEN {
            return Err(AbortCode::TOO_LONG);
        }
        // Refuse before the segments come.
        check_writable(self.target, context)?;
        self.data.extend_from_slice(rest.get(..rest.len().min(len)).unwrap_or_default());
        if self.data.len() == len {
            return self.store(context, outbox, WRITTEN);
        }
        self.progress = Progress::Downloading { len, toggle: false };
        self.answer(outbox, WRITTEN, 0);
        Ok(())
    }

    fn download_segment(
        &mut self,
        command: u8,
        rest: &[u8],
        context: &mut Context<'_, '_>,
        outbox: &mut Outbox,
    ) -> Result<(), AbortCode> {
        let Progress::Downloading { len, toggle } = self.progress else { return Err(AbortCode::COMMAND) };
        if (command & TOGGLE != 0) != toggle {
            return Err(AbortCode::TOGGLE);
        }
        let unused = if rest.len() <= MIN_SEGMENT { usize::from(command >> 1 & 7) } else { 0 };
        let segment = rest.get(..rest.len().saturating_sub(unused)).unwrap_or_default();
        if self.data.len() + segment.len() > len {
            return Err(AbortCode::TOO_LONG);
        }
        self.data.extend_from_slice(segment);
        let answer = SEGMENT_WRITTEN | if toggle { TOGGLE } else { 0 };
        if command & LAST == 0 {
            self.progress = Progress::Downloading { len, toggle: !toggle };
            acknowledge_segment(outbox, answer);
            return Ok(());
        }
        self.progress = Progress::Idle;
        if self.data.len() != len {
            return Err(AbortCode::LENGTH);
        }
        self.store(context, outbox, answer)
    }

    /// Writes the whole data, and answers.
    fn store(
        &mut self,
        context: &mut Context<'_, '_>,
        outbox: &mut Outbox,
        answer: u8,
    ) -> Result<(), AbortCode> {
        let Target { index, subindex, complete } = self.target;
        if complete {
            self.store_complete(context)?;
        } else {
            let outputs = &mut *context.process.outputs;
            context.dictionary.write(index, subindex, &self.data, context.state, outputs)?;
            report_written(context.sink, index, subindex);
        }
        if answer == WRITTEN {
            self.answer(outbox, answer | if complete { COMPLETE_ACCESS } else { 0 }, 0);
        } else {
            acknowledge_segment(outbox, answer);
        }
        Ok(())
    }

    fn store_complete(&self, context: &mut Context<'_, '_>) -> Result<(), AbortCode> {
        let Target { index, subindex, .. } = self.target;
        let entries = complete_entries(self.target, context)?;
        let mut rest = &self.data[..];
        let mut values = Vec::with_capacity(entries.len());
        for (number, capacity) in entries {
            // The MainDevice may choose fewer process data than the object has subindices for.
            if rest.is_empty() && configures(index) {
                break;
            }
            // Subindex 0 takes 16 bits (ETG.1000.6, complete access).
            let taken = if number == 0 { 2 } else { capacity };
            let (value, behind) = rest.split_at_checked(taken).ok_or(AbortCode::TOO_SHORT)?;
            rest = behind;
            values.push((number, value.get(..capacity).unwrap_or_default()));
        }
        if !rest.is_empty() {
            return Err(AbortCode::TOO_LONG);
        }
        // A write of the present value is accepted even if the entry cannot be written.
        let is_new = |(number, value): &(u8, &[u8])| context.dictionary.get(index, *number) != Some(*value);
        if !configures(index) {
            values.retain(is_new);
            for (number, value) in values {
                let outputs = &mut *context.process.outputs;
                context.dictionary.write(index, number, value, context.state, outputs)?;
            }
        } else if values.iter().any(is_new) {
            context.dictionary.configure_whole(index, &values, context.state)?;
        }
        report_written(context.sink, index, subindex);
        Ok(())
    }
}

fn acknowledge_segment(outbox: &mut Outbox, command: u8) {
    coe::write(outbox, coe::SDO_RESPONSE, |writer| {
        writer.u8(command);
        writer.zeros(MIN_SEGMENT);
    });
}

/// Collects the value of an entry, or of all entries of an object.
fn collect(target: Target, context: &Context<'_, '_>, data: &mut Vec<u8>) -> Result<(), AbortCode> {
    let Target { index, subindex, complete } = target;
    if !complete {
        let entry = context.dictionary.entry(index, subindex)?;
        if entry.access == Access::WriteOnly {
            return Err(AbortCode::WRITE_ONLY);
        }
        context.dictionary.read(entry, &context.process, data);
        return Ok(());
    }
    for (number, _) in complete_entries(target, context)? {
        // Of the chosen process data, only as many as subindex 0 says.
        if configures(index) && number > context.dictionary.count(index) {
            break;
        }
        let entry = context.dictionary.entry(index, number)?;
        context.dictionary.read(entry, &context.process, data);
        if number == 0 {
            data.push(0);
        }
    }
    Ok(())
}

/// Returns subindices and lengths of the entries that a complete access reads or writes.
fn complete_entries(target: Target, context: &Context<'_, '_>) -> Result<Vec<(u8, usize)>, AbortCode> {
    let object = context.dictionary.object(target.index)?;
    if object.code == ObjectCode::Variable || target.subindex > 1 {
        return Err(AbortCode::NO_COMPLETE_ACCESS);
    }
    let entries = object.entries.iter().filter(|entry| entry.subindex >= target.subindex);
    Ok(entries.map(|entry| (entry.subindex, entry.capacity())).collect())
}

fn own_len(target: Target, context: &Context<'_, '_>) -> Result<usize, AbortCode> {
    Ok(context.dictionary.entry(target.index, target.subindex)?.capacity())
}

fn check_writable(target: Target, context: &Context<'_, '_>) -> Result<(), AbortCode> {
    let entry = context.dictionary.entry(target.index, target.subindex)?;
    // Values for objects that configure process data are checked once all of them are there.
    let refused = !target.complete && entry.access == Access::ReadOnly && !configures(target.index);
    if refused { Err(AbortCode::READ_ONLY) } else { Ok(()) }
}
