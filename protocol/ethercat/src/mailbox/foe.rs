//! FoE: one file, written and read in packets (ETG.1000.6, 5.8).
//!
//! ```text
//! 0      operation
//! 2..6   password, packet number or error code
//! 6..    file name, data or error text
//! ```

use alloc::vec::Vec;

use super::{Context, MailboxError, Outbox, PROTOCOL_FOE};
use crate::event::Event;
use crate::{Reader, Writer};

const READ: u8 = 1;
const WRITE: u8 = 2;
const DATA: u8 = 3;
const ACKNOWLEDGE: u8 = 4;
const ERROR: u8 = 5;

/// Error codes (ETG.1000.6, FoE error codes).
const NOT_FOUND: u32 = 0x8001;
const DISK_FULL: u32 = 0x8003;
const ILLEGAL: u32 = 0x8004;
const WRONG_PACKET: u32 = 0x8005;

/// Length in bytes of the header.
const LEN: usize = 6;

/// Longest file name in bytes.
const MAX_NAME: usize = 64;

/// The file of a device.
#[derive(Default, Debug)]
pub(crate) struct File {
    name: Vec<u8>,
    content: Vec<u8>,
    capacity: usize,
}

impl File {
    pub(crate) fn new(capacity: usize) -> Self {
        Self { name: Vec::new(), content: Vec::new(), capacity }
    }

    pub(crate) const fn capacity(&self) -> usize {
        self.capacity
    }

    /// Returns name and content, once a file was written whole.
    pub(crate) fn get(&self) -> Option<(&[u8], &[u8])> {
        (!self.name.is_empty()).then_some((&self.name[..], &self.content[..]))
    }
}

#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
enum Progress {
    #[default]
    Idle,
    /// The device waits for the packet with this number.
    Writing { packet: u32 },
    /// The device waits for the acknowledgement of the packet with this number.
    Reading { packet: u32, last: bool },
}

/// The transfer that is running, if one is.
#[derive(Default, Debug)]
pub(super) struct FileAccess {
    progress: Progress,
    name: Vec<u8>,
    incoming: Vec<u8>,
}

impl FileAccess {
    /// Serves a request.
    pub(super) fn receive(
        &mut self,
        body: &[u8],
        context: &mut Context<'_, '_>,
        outbox: &mut Outbox,
    ) -> Result<(), MailboxError> {
        let mut reader = Reader::new(body);
        let [operation, _] = reader.array().map_err(|_| MailboxError::TooShort)?;
        let number = reader.u32().map_err(|_| MailboxError::TooShort)?;
        let rest = reader.rest();
        let served = match operation {
            READ => self.read(rest, context, outbox),
            WRITE => self.write(rest, outbox),
            DATA => self.data(number, rest, context, outbox),
            ACKNOWLEDGE => self.acknowledged(number, context, outbox),
            ERROR => {
                self.progress = Progress::Idle;
                Ok(())
            }
            _ => Err(ILLEGAL),
        };
        if let Err(code) = served {
            self.progress = Progress::Idle;
            write(outbox, ERROR, code, |_| ());
        }
        Ok(())
    }

    fn write(&mut self, name: &[u8], outbox: &mut Outbox) -> Result<(), u32> {
        if name.is_empty() || name.len() > MAX_NAME {
            return Err(ILLEGAL);
        }
        self.name.clear();
        self.name.extend_from_slice(name);
        self.incoming.clear();
        self.progress = Progress::Writing { packet: 1 };
        write(outbox, ACKNOWLEDGE, 0, |_| ());
        Ok(())
    }

    fn data(
        &mut self,
        number: u32,
        data: &[u8],
        context: &mut Context<'_, '_>,
        outbox: &mut Outbox,
    ) -> Result<(), u32> {
        let Progress::Writing { packet } = self.progress else { return Err(ILLEGAL) };
        if number != packet {
            return Err(WRONG_PACKET);
        }
        if self.incoming.len() + data.len() > context.file.capacity {
            return Err(DISK_FULL);
        }
        self.incoming.extend_from_slice(data);
        // A packet that does not fill the mailbox is the last one.
        if data.len() < context.mailbox_len.saturating_sub(super::HEADER_LEN + LEN) {
            self.progress = Progress::Idle;
            core::mem::swap(&mut context.file.name, &mut self.name);
            core::mem::swap(&mut context.file.content, &mut self.incoming);
            context.sink.push(Event::FileWritten { len: context.file.content.len() });
        } else {
            self.progress = Progress::Writing { packet: packet.wrapping_add(1) };
        }
        write(outbox, ACKNOWLEDGE, number, |_| ());
        Ok(())
    }

    fn read(&mut self, name: &[u8], context: &Context<'_, '_>, outbox: &mut Outbox) -> Result<(), u32> {
        if context.file.name.is_empty() || context.file.name != name {
            return Err(NOT_FOUND);
        }
        self.send(1, context, outbox);
        Ok(())
    }

    fn acknowledged(
        &mut self,
        number: u32,
        context: &Context<'_, '_>,
        outbox: &mut Outbox,
    ) -> Result<(), u32> {
        let Progress::Reading { packet, last } = self.progress else { return Err(ILLEGAL) };
        if number != packet {
            return Err(WRONG_PACKET);
        }
        if last {
            self.progress = Progress::Idle;
        } else {
            self.send(packet.wrapping_add(1), context, outbox);
        }
        Ok(())
    }

    /// Sends a packet of the file; the last one is shorter than a mailbox, and empty if necessary.
    fn send(&mut self, packet: u32, context: &Context<'_, '_>, outbox: &mut Outbox) {
        let len = packet_len(outbox);
        let start = (packet as usize).saturating_sub(1).saturating_mul(len);
        let rest = context.file.content.get(start..).unwrap_or_default();
        let data = rest.get(..rest.len().min(len)).unwrap_or_default();
        write(outbox, DATA, packet, |writer| writer.bytes(data));
        self.progress = Progress::Reading { packet, last: data.len() < len };
    }
}

fn packet_len(outbox: &Outbox) -> usize {
    outbox.capacity().saturating_sub(LEN)
}

fn write(outbox: &mut Outbox, operation: u8, number: u32, write: impl FnOnce(&mut Writer<'_>)) {
    outbox.write(PROTOCOL_FOE, |writer| {
        writer.u8(operation);
        writer.u8(0);
        writer.u32(number);
        write(writer);
    });
}
