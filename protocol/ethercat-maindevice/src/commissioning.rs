//! Wishes of a tool for commissioning beside process data: objects written in PRE-OP, devices held in SAFE-OP, objects read and
//! written, emergencies.

use std::collections::VecDeque;
use std::fmt;

/// Object that is written in PRE-OP.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct StartupWrite {
    /// Index.
    pub index: u16,
    /// Subindex.
    pub subindex: u8,
    /// True for all entries from the subindex on, 0 or 1, at once: complete access.
    pub is_complete: bool,
    /// Data in the byte order of the wire, at most [`LONGEST_OBJECT`] bytes.
    pub data: Vec<u8>,
}

/// Access to an object.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct SdoRequest {
    /// Index.
    pub index: u16,
    /// Subindex.
    pub subindex: u8,
    /// True for all entries from the subindex on, 0 or 1, at once: complete access.
    pub is_complete: bool,
    /// Data to write, at most [`LONGEST_OBJECT`] bytes; none for a read.
    pub data: Option<Vec<u8>>,
}

/// Data read, nothing of a write, or why not.
pub type SdoAnswer = Result<Vec<u8>, String>;

/// Longest data in bytes that are read from an object or written to it.
pub const LONGEST_OBJECT: usize = 65_536;

/// Reason why a request for an object is not sent.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum SdoRefusal {
    /// The device is not up.
    NotConnected,
    /// The owner did not say where the device's mailbox is: see [`MainDevice::set_mailbox`](crate::MainDevice::set_mailbox).
    NoMailbox,
    /// An earlier request is being answered, or its answer was not taken.
    Busy,
    /// More bytes than [`LONGEST_OBJECT`] are to be written.
    TooLong(usize),
}

impl fmt::Display for SdoRefusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotConnected => f.write_str("the device is not connected; ask again once it is"),
            Self::NoMailbox => {
                f.write_str("the device has no mailbox, so it has no objects; use its process data")
            }
            Self::Busy => {
                f.write_str("the device is answering an earlier request; ask again after that answer")
            }
            Self::TooLong(len) => {
                write!(
                    f,
                    "{len} bytes: at most {LONGEST_OBJECT} can be written; use the maker's tool for longer objects"
                )
            }
        }
    }
}

impl std::error::Error for SdoRefusal {}

/// Module that a device detects.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct DetectedModule {
    /// Slot, from 1.
    pub slot: u8,
    /// ModuleIdent.
    pub ident: u32,
}

/// List of the modules that a device detects.
#[derive(Default, Debug)]
pub(crate) enum ModuleList {
    /// Nobody wants it.
    #[default]
    None,
    /// It is to be read in PRE-OP, where the device then stays.
    Wanted,
    /// Modules, or why they cannot be read.
    Read(Result<Vec<DetectedModule>, String>),
}

/// Wishes of the owner, and what came of them.
#[derive(Default, Debug)]
pub(crate) struct Commissioning {
    pub(crate) startup: Vec<StartupWrite>,
    pub(crate) holds_safe_op: bool,
    pub(crate) mailbox: Option<(u16, u16)>,
    pub(crate) modules: ModuleList,
    sdo: SdoAccess,
    pub(crate) emergencies: VecDeque<[u8; 8]>,
}

/// Access to an object on its way.
#[derive(Default, Debug)]
enum SdoAccess {
    #[default]
    None,
    /// It waits until the mailbox is free.
    Waiting(SdoRequest),
    /// The device is asked.
    Asked,
    Answered(SdoAnswer),
}

impl Commissioning {
    /// Takes over a request of the owner.
    pub(crate) fn ask(&mut self, request: SdoRequest) -> Result<(), SdoRefusal> {
        if self.mailbox.is_none() {
            return Err(SdoRefusal::NoMailbox);
        }
        if !matches!(self.sdo, SdoAccess::None) {
            return Err(SdoRefusal::Busy);
        }
        let written = request.data.as_ref().map_or(0, Vec::len);
        if written > LONGEST_OBJECT {
            return Err(SdoRefusal::TooLong(written));
        }
        self.sdo = SdoAccess::Waiting(request);
        Ok(())
    }

    /// Returns the request that waits. The device is asked from then on.
    pub(crate) fn next_request(&mut self) -> Option<SdoRequest> {
        if !matches!(self.sdo, SdoAccess::Waiting(_)) {
            return None;
        }
        match std::mem::replace(&mut self.sdo, SdoAccess::Asked) {
            SdoAccess::Waiting(request) => Some(request),
            _ => None,
        }
    }

    /// Keeps the device's answer, unless its request has ended with the connection.
    pub(crate) fn answered(&mut self, answer: SdoAnswer) {
        if matches!(self.sdo, SdoAccess::Asked) {
            self.sdo = SdoAccess::Answered(answer);
        }
    }

    /// Returns the answer once.
    pub(crate) fn take_answer(&mut self) -> Option<SdoAnswer> {
        match std::mem::take(&mut self.sdo) {
            SdoAccess::Answered(answer) => Some(answer),
            other => {
                self.sdo = other;
                None
            }
        }
    }

    /// Ends the request, since the connection has ended.
    pub(crate) fn end_request(&mut self) {
        if matches!(self.sdo, SdoAccess::Waiting(_) | SdoAccess::Asked) {
            let lost = "the connection ended before the answer; ask again once the device is connected";
            self.sdo = SdoAccess::Answered(Err(lost.to_owned()));
        }
    }
}
