//! Wishes of a tool for commissioning beside process data: objects written in PRE-OP, devices held in SAFE-OP, objects read and
//! written, emergencies.

use std::collections::VecDeque;

/// Object that is written in PRE-OP.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct StartupWrite {
    /// Index.
    pub index: u16,
    /// Subindex.
    pub subindex: u8,
    /// Data in the byte order of the wire, at most four bytes.
    pub data: Vec<u8>,
}

/// Access to an object.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct SdoRequest {
    /// Index.
    pub index: u16,
    /// Subindex.
    pub subindex: u8,
    /// Bytes to read: 1, 2, 4 or 8.
    pub len: usize,
    /// Data to write; none for a read.
    pub data: Option<Vec<u8>>,
}

/// Data read, nothing of a write, or why not.
pub type SdoAnswer = Result<Vec<u8>, String>;

/// Wishes of the owner, and what came of them.
#[derive(Default, Debug)]
pub(crate) struct Commissioning {
    pub(crate) startup: Vec<StartupWrite>,
    pub(crate) holds_safe_op: bool,
    pub(crate) mailbox: Option<(u16, u16)>,
    pub(crate) request: Option<SdoRequest>,
    pub(crate) is_asked: bool,
    pub(crate) answer: Option<SdoAnswer>,
    pub(crate) emergencies: VecDeque<[u8; 8]>,
}

impl Commissioning {
    pub(crate) fn ask(&mut self, request: SdoRequest) -> bool {
        if self.is_asked || self.answer.is_some() {
            return false;
        }
        self.is_asked = true;
        self.request = Some(request);
        true
    }
}
