//! Explicit requests of the owner over the session of a running connection: attributes that are read and written.

use alloc::boxed::Box;
use alloc::vec::Vec;

use super::dialogue::{self, ScannerMessage};
use super::{Connection, Step};
use crate::Writer;
use crate::cip::{General, Path, Reply, Request};
use crate::encapsulation::{Header, Status};
use machine::Instant;

/// Longest answer that is kept, in bytes: twice what an unconnected message carries (volume 1, 3-5.5.4: 504 bytes).
const LONGEST_ANSWER: usize = 1024;

/// Longest request in bytes, path and data: what an unconnected message carries.
const LONGEST_REQUEST: usize = 480;

/// Explicit request and its answer.
#[derive(Debug)]
pub(super) struct Explicit {
    service: u8,
    path: Vec<u8>,
    data: Vec<u8>,
    until: Instant,
    /// Number of the message, once it was sent.
    pub(super) number: Option<u32>,
    /// General status of the answer; `None` while it is awaited.
    status: Option<ExplicitAnswer>,
    /// Data of the answer. Its memory is made with the request.
    answer: Vec<u8>,
}

/// Result of an explicit request.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum ExplicitAnswer {
    /// The device answered with this status.
    Status(General),
    /// No answer came in time, or the connection ended before.
    NoAnswer,
}

/// Reason why an explicit request cannot be sent.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum ExplicitError {
    /// The connection has not got a session.
    #[error("the device is not connected; ask again once it is")]
    NotConnected,
    /// Another request waits for its answer.
    #[error("the device is answering an earlier request; ask again after that answer")]
    Busy,
    /// The request is too long.
    #[error("{0} bytes of path and data: a request has at most 480")]
    TooLong(usize),
}

impl Explicit {
    pub(super) fn emit(&self, writer: &mut Writer<'_>) {
        Request::emit(
            writer,
            self.service,
            |writer| writer.bytes(&self.path),
            |writer| writer.bytes(&self.data),
        );
    }
}

impl Connection {
    /// Sends an explicit request to the adapter: a service, a padded path and its data. [`take_answer`](Self::take_answer)
    /// returns the result.
    ///
    /// # Errors
    ///
    /// The connection is not up, another request waits, or the request is too long.
    pub fn request(
        &mut self,
        now: Instant,
        service: u8,
        path: Path<'_>,
        data: &[u8],
    ) -> Result<(), ExplicitError> {
        if self.step != Step::Running || self.stream.is_none() {
            return Err(ExplicitError::NotConnected);
        }
        if self.explicit.is_some() {
            return Err(ExplicitError::Busy);
        }
        let len = path.0.len() + data.len();
        if len > LONGEST_REQUEST {
            return Err(ExplicitError::TooLong(len));
        }
        self.explicit = Some(Box::new(Explicit {
            service,
            path: path.0.to_vec(),
            data: data.to_vec(),
            until: now + self.config.request_timeout,
            number: None,
            status: None,
            answer: Vec::with_capacity(LONGEST_ANSWER),
        }));
        self.queue(ScannerMessage::Explicit);
        Ok(())
    }

    /// Returns the result of the explicit request once, with the data of the answer; `None` while it is awaited.
    pub fn take_answer(&mut self) -> Option<(ExplicitAnswer, Vec<u8>)> {
        let status = self.explicit.as_ref()?.status?;
        self.explicit.take().map(|explicit| (status, explicit.answer))
    }

    /// Returns whether a message answers the explicit request.
    pub(super) fn is_explicit(&self, header: &Header) -> bool {
        self.explicit.as_ref().is_some_and(|explicit| explicit.number == Some(dialogue::number_of(header)))
    }

    pub(super) fn handle_explicit(&mut self, header: &Header, data: &[u8]) {
        let Some(explicit) = &mut self.explicit else { return };
        let answered = match dialogue::read_reply(data).filter(|_| header.status == Status::Success) {
            // A router that cannot reach the adapter answers for the Unconnected_Send.
            Some((Reply { general, data, .. }, _)) if data.len() <= LONGEST_ANSWER => {
                explicit.answer.extend_from_slice(data);
                ExplicitAnswer::Status(general)
            }
            _ => {
                self.counters.malformed += 1;
                ExplicitAnswer::NoAnswer
            }
        };
        explicit.status.get_or_insert(answered);
        explicit.number = None;
    }

    /// Returns until when the answer is awaited.
    pub(super) fn explicit_until(&self) -> Option<Instant> {
        self.explicit.as_ref().filter(|explicit| explicit.status.is_none()).map(|explicit| explicit.until)
    }

    /// Ends the wait for the answer.
    pub(super) fn give_up_explicit(&mut self) {
        if let Some(explicit) = &mut self.explicit {
            explicit.status.get_or_insert(ExplicitAnswer::NoAnswer);
            explicit.number = None;
        }
    }
}
