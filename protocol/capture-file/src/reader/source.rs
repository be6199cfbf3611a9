//! The bytes of a capture, with the offset for messages.

use std::io::{self, ErrorKind, Read};

use super::CaptureError;

/// An input that counts its bytes.
#[derive(Debug)]
pub(super) struct CountedInput<R> {
    input: R,
    offset: u64,
}

impl<R: Read> CountedInput<R> {
    pub(super) const fn new(input: R) -> Self {
        Self { input, offset: 0 }
    }

    /// Returns the number of bytes read so far.
    pub(super) const fn offset(&self) -> u64 {
        self.offset
    }

    /// Fills the buffer; the file is cut if it ends before.
    pub(super) fn fill(&mut self, buffer: &mut [u8]) -> Result<(), CaptureError> {
        if self.fill_or_end(buffer)? { Ok(()) } else { Err(CaptureError::Cut(self.offset)) }
    }

    /// Fills the buffer, or returns `false` if the file ends exactly here.
    pub(super) fn fill_or_end(&mut self, buffer: &mut [u8]) -> Result<bool, CaptureError> {
        let mut filled = 0;
        while let Some(rest) = buffer.get_mut(filled..).filter(|rest| !rest.is_empty()) {
            match self.input.read(rest) {
                Ok(0) if filled == 0 => return Ok(false),
                Ok(0) => return Err(CaptureError::Cut(self.offset)),
                Ok(count) => {
                    filled += count;
                    self.offset += count as u64;
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error.into()),
            }
        }
        Ok(true)
    }

    /// Fills `buffer` with the next `len` bytes and replaces what it had.
    pub(super) fn take(&mut self, len: usize, buffer: &mut Vec<u8>) -> Result<(), CaptureError> {
        buffer.clear();
        buffer.resize(len, 0);
        self.fill(buffer)
    }

    /// Skips bytes.
    pub(super) fn skip(&mut self, len: u64) -> Result<(), CaptureError> {
        let skipped = io::copy(&mut self.input.by_ref().take(len), &mut io::sink())?;
        self.offset += skipped;
        if skipped == len { Ok(()) } else { Err(CaptureError::Cut(self.offset)) }
    }
}
