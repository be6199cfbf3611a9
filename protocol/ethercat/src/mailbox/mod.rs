//! The mailbox: CoE and FoE behind one header (ETG.1000.4, 5.6; ETG.1000.6, 5.6 to 5.8).
//!
//! ```text
//! 0..2   length of the message behind this header
//! 2..4   station address, 0 for the MainDevice
//! 4      channel in bits 0..6, priority in bits 6..8
//! 5      protocol in bits 0..4, counter 1 to 7 in bits 4..7
//! ```

mod coe;
mod emergency;
mod faults;
mod foe;
mod info;
mod sdo;

use alloc::boxed::Box;
use alloc::vec;

pub use emergency::Emergency;
pub use faults::MailFault;
pub(crate) use foe::File;

use crate::al::AlState;
use crate::dictionary::{Dictionary, ProcessData};
use crate::event::{Event, Sink};
use crate::{Reader, Writer};
use emergency::Emergencies;
use faults::MailFaults;
use foe::FileAccess;
use info::Listing;
use sdo::Transfer;

/// Length in bytes of the header.
const HEADER_LEN: usize = 6;

const PROTOCOL_ERROR: u8 = 0;
const PROTOCOL_COE: u8 = 3;
const PROTOCOL_FOE: u8 = 4;

/// Details of a mailbox error reply (ETG.1000.4, mailbox error codes).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum MailboxError {
    UnsupportedProtocol = 2,
    ServiceNotSupported = 4,
    TooShort = 6,
    InvalidSize = 8,
}

/// What is needed to serve a request.
pub(crate) struct Context<'a, 's> {
    pub(crate) state: AlState,
    /// Length in bytes of the mailbox that the MainDevice writes, as it has configured it.
    pub(crate) mailbox_len: usize,
    pub(crate) dictionary: &'a mut Dictionary,
    pub(crate) process: ProcessData<'a>,
    pub(crate) file: &'a mut File,
    pub(crate) sink: &'a mut Sink<'s>,
}

/// The next message to the MainDevice.
#[derive(Debug)]
pub(crate) struct Outbox {
    buf: Box<[u8]>,
    /// Length in bytes of the mailbox as the MainDevice has configured it.
    room: usize,
    len: usize,
    counter: u8,
}

impl Outbox {
    fn new(len: u16) -> Self {
        let room = usize::from(len);
        Self { buf: vec![0; room].into_boxed_slice(), room, len: 0, counter: 0 }
    }

    /// Returns how many bytes a message may have behind the mailbox header.
    pub(crate) fn capacity(&self) -> usize {
        self.room.saturating_sub(HEADER_LEN)
    }

    /// Writes a message.
    fn write(&mut self, protocol: u8, write: impl FnOnce(&mut Writer<'_>)) {
        self.counter = if self.counter >= 7 { 1 } else { self.counter + 1 };
        let mut writer = Writer::new(self.buf.get_mut(..self.room).unwrap_or_default());
        writer.u16(0);
        writer.u16(0);
        writer.u8(0);
        writer.u8(protocol | self.counter << 4);
        write(&mut writer);
        let len = writer.len().saturating_sub(HEADER_LEN);
        writer.patch_u16(0, u16::try_from(len).unwrap_or(0));
        self.len = writer.finish().unwrap_or(0);
    }

    fn is_empty(&self) -> bool {
        self.len == 0
    }
}

/// A message that was handed out.
#[derive(Debug)]
struct Message {
    buf: Box<[u8]>,
    len: usize,
}

impl Message {
    fn new(len: u16) -> Self {
        Self { buf: vec![0; usize::from(len)].into_boxed_slice(), len: 0 }
    }

    /// Returns its bytes, or `None` if there is no message.
    fn get(&self) -> Option<&[u8]> {
        self.buf.get(..self.len).filter(|message| !message.is_empty())
    }
}

/// The application's end of both mailboxes.
#[derive(Debug)]
pub(crate) struct Mailbox {
    next: Outbox,
    /// The message in the mailbox, which the MainDevice has not read.
    unread: Message,
    /// The message that the MainDevice read last, in case it asks for it again.
    read: Message,
    /// The mailbox contains the message read last once more; `unread` follows it.
    repeats: bool,
    /// Counter of the message received last, by which a repeated message is recognised.
    received: u8,
    /// The bit of the repeat request that was served last.
    repeated: bool,
    transfer: Transfer,
    listing: Listing,
    files: FileAccess,
    emergencies: Emergencies,
    faults: MailFaults,
}

impl Mailbox {
    pub(crate) fn new(len: u16) -> Self {
        Self {
            next: Outbox::new(len),
            unread: Message::new(len),
            read: Message::new(len),
            repeats: false,
            received: 0,
            repeated: false,
            transfer: Transfer::default(),
            listing: Listing::default(),
            files: FileAccess::default(),
            emergencies: Emergencies::default(),
            faults: MailFaults::default(),
        }
    }

    /// Sets the fault of its answers from now on; none for a good mailbox.
    pub(crate) fn set_fault(&mut self, fault: Option<MailFault>) {
        if self.faults.fault != fault {
            self.faults = MailFaults::of(fault);
        }
    }

    /// Forgets all transfers, as in INIT.
    pub(crate) fn reset(&mut self) {
        (self.next.len, self.next.counter, self.received, self.repeated) = (0, 0, 0, false);
        (self.unread.len, self.read.len, self.repeats) = (0, 0, false);
        self.transfer.reset();
        self.listing = Listing::default();
        self.files = FileAccess::default();
        self.emergencies = Emergencies::default();
    }

    /// Starts with messages of up to `len` bytes, the length of the mailbox that the MainDevice reads.
    pub(crate) fn start(&mut self, len: u16) {
        self.next.room = usize::from(len).min(self.next.buf.len());
    }

    /// Queues an emergency. Returns whether there was room.
    pub(crate) fn raise(&mut self, emergency: Emergency) -> bool {
        self.emergencies.push(emergency)
    }

    /// Returns the message that goes to the MainDevice next.
    pub(crate) fn outgoing(&mut self, dictionary: &Dictionary) -> Option<&[u8]> {
        if self.next.is_empty()
            && let Some(message) = self.faults.next()
            && let Some(place) = self.next.buf.get_mut(..message.len())
        {
            place.copy_from_slice(&message);
            self.next.len = message.len();
        }
        if self.next.is_empty() {
            let Self { next, listing, emergencies, .. } = self;
            let _ = listing.continue_with(dictionary, next) || emergencies.write(next);
        }
        if self.next.is_empty() {
            return None;
        }
        self.next.buf.get(..self.next.len)
    }

    /// Notes that the outgoing message was handed out.
    pub(crate) fn handed_out(&mut self) {
        core::mem::swap(&mut self.next.buf, &mut self.unread.buf);
        self.unread.len = core::mem::take(&mut self.next.len);
    }

    /// Notes that the MainDevice read the mailbox. Returns the message that a repetition has taken out of it, which
    /// comes next.
    pub(crate) fn was_read(&mut self) -> Option<&[u8]> {
        if core::mem::take(&mut self.repeats) {
            return self.unread.get();
        }
        if self.unread.len > 0 {
            core::mem::swap(&mut self.read, &mut self.unread);
            self.unread.len = 0;
        }
        None
    }

    /// Returns whether the MainDevice asks for the last message once more, which it does by changing its bit.
    pub(crate) const fn is_repetition_requested(&mut self, bit: bool) -> bool {
        bit != core::mem::replace(&mut self.repeated, bit)
    }

    /// Repeats the message that the MainDevice read last. Returns this message, and whether the mailbox contains another
    /// one, which has to wait. `None` if nothing was read yet, or if the repetition is in the mailbox already.
    pub(crate) fn repeat(&mut self) -> Option<(&[u8], bool)> {
        if self.repeats {
            return None;
        }
        let message = self.read.get()?;
        self.repeats = self.unread.len > 0;
        Some((message, self.repeats))
    }

    /// Serves a message of the MainDevice. The answer is the next outgoing message.
    pub(crate) fn receive(&mut self, message: &[u8], context: &mut Context<'_, '_>) {
        let mut reader = Reader::new(message);
        let Ok([low, high, _, _, _, kind]) = reader.array::<HEADER_LEN>() else { return };
        let counter = kind >> 4 & 7;
        // A MainDevice that does not use the counter sends 0.
        if counter != 0 && counter == self.received {
            return;
        }
        self.received = counter;
        let served = match reader.bytes(usize::from(u16::from_le_bytes([low, high]))) {
            Err(_) => Err(MailboxError::InvalidSize),
            Ok(body) => match kind & 0x0F {
                PROTOCOL_COE if context.state != AlState::Boot => self.receive_coe(body, context),
                PROTOCOL_FOE if context.file.capacity() > 0 => {
                    self.files.receive(body, context, &mut self.next)
                }
                _ => Err(MailboxError::UnsupportedProtocol),
            },
        };
        if let Err(error) = served {
            self.next.write(PROTOCOL_ERROR, |writer| {
                writer.u16(1); // this is an error reply
                writer.u16(error as u16);
            });
        }
        self.next.len = self.faults.apply(&mut self.next.buf, self.next.len);
    }

    fn receive_coe(&mut self, body: &[u8], context: &mut Context<'_, '_>) -> Result<(), MailboxError> {
        let mut reader = Reader::new(body);
        let service = coe::service(reader.u16().map_err(|_| MailboxError::TooShort)?);
        match service {
            coe::SDO_REQUEST => self.transfer.receive(reader, context, &mut self.next),
            coe::SDO_INFORMATION => self.listing.receive(reader, context.dictionary, &mut self.next),
            _ => Err(MailboxError::ServiceNotSupported),
        }
    }
}

/// Reports an entry that the MainDevice wrote.
fn report_written(sink: &mut Sink<'_>, index: u16, subindex: u8) {
    sink.push(Event::ObjectWritten { index, subindex });
}
