//! Faults of a mailbox, as broken devices have them: what a MainDevice has to live with.

use alloc::collections::VecDeque;
use alloc::vec::Vec;

use super::coe;

/// Fault of the answers that a device gives by its mailbox.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum MailFault {
    /// No answer comes.
    Lost,
    /// The answer to a request comes after the next request.
    Late,
    /// Each answer comes twice.
    Doubled,
    /// All answers have the same counter.
    Counter,
    /// The length in the header is longer than the mailbox.
    Length,
    /// The header names another protocol.
    Protocol,
    /// Segments have the wrong toggle bit.
    Toggle,
    /// The device answers that it has no memory left.
    Error,
}

/// Answers that a fault holds back or repeats.
#[derive(Debug, Default)]
pub(super) struct MailFaults {
    pub(super) fault: Option<MailFault>,
    held: Option<Vec<u8>>,
    queue: VecDeque<Vec<u8>>,
}

/// Mailbox error: no memory (ETG.1000.4, mailbox error reply).
const OUT_OF_MEMORY: u16 = 7;

/// Places in a message: type and counter; command of an SDO.
const KIND: usize = 5;
const COMMAND: usize = 8;

/// Bit of a segment's command.
const TOGGLE: u8 = 0x10;

/// Answers that wait at most.
const MOST_QUEUED: usize = 16;

impl MailFaults {
    pub(super) fn of(fault: Option<MailFault>) -> Self {
        Self { fault, ..Self::default() }
    }

    /// Returns the next message that was held back or repeated.
    pub(super) fn next(&mut self) -> Option<Vec<u8>> {
        self.queue.pop_front()
    }

    /// Applies the fault to the answer in `message`. Returns the length that it has then; 0 for none.
    pub(super) fn apply(&mut self, message: &mut [u8], len: usize) -> usize {
        let Some(fault) = self.fault.filter(|_| len > 0) else { return len };
        let answer = message.get(..len).unwrap_or_default().to_vec();
        match fault {
            MailFault::Lost => 0,
            MailFault::Late => {
                if let Some(before) = self.held.replace(answer)
                    && self.queue.len() < MOST_QUEUED
                {
                    self.queue.push_back(before);
                }
                0
            }
            MailFault::Doubled => {
                if self.queue.len() < MOST_QUEUED {
                    self.queue.push_back(answer);
                }
                len
            }
            MailFault::Counter => {
                if let Some(kind) = message.get_mut(KIND) {
                    *kind = *kind & 0x0F | 1 << 4;
                }
                len
            }
            MailFault::Length => {
                if let Some(length) = message.get_mut(..2) {
                    length.fill(0xFF);
                }
                len
            }
            MailFault::Protocol => {
                // Servo drive profile (SoE).
                if let Some(kind) = message.get_mut(KIND) {
                    *kind = *kind & 0xF0 | 5;
                }
                len
            }
            MailFault::Toggle => {
                let is_segment = |command: u8| matches!(command >> 5, 0 | 1);
                let is_response = message
                    .get(6..8)
                    .and_then(|head| head.first_chunk::<2>())
                    .is_some_and(|head| coe::service(u16::from_le_bytes(*head)) == coe::SDO_RESPONSE);
                if let Some(command) =
                    message.get_mut(COMMAND).filter(|command| is_response && is_segment(**command))
                {
                    *command ^= TOGGLE;
                }
                len
            }
            MailFault::Error => {
                let reply = [4, 0, 0, 0, 0, 0x10, 1, 0, OUT_OF_MEMORY as u8, 0];
                match message.get_mut(..reply.len()) {
                    Some(place) => {
                        place.copy_from_slice(&reply);
                        reply.len()
                    }
                    None => len,
                }
            }
        }
    }
}
