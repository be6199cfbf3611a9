//! What comes in to the thread beside the cyclic one, and lines of text put together from pieces.

use std::net::SocketAddr;

use protocol_linux::StopSignal;

/// Longest line that is taken, in bytes; more without an end is no instruction of ours.
const LINE_LIMIT: usize = 64 * 1024;

/// Something came.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Input {
    /// A line of whoever gives the commands, without its end.
    Line(String),
    /// Standard input ended: whoever gives the commands is gone.
    Closed,
    /// A controller came to the control port.
    Attached(SocketAddr),
    /// The controller went, or was sent away.
    Detached {
        /// The controller.
        peer: SocketAddr,
        /// Why.
        reason: String,
    },
    /// A signal.
    Stop(StopSignal),
    /// The cyclic thread has news, or is gone.
    News,
}

/// Puts lines together from the pieces in which they come.
#[derive(Default, Debug)]
pub(crate) struct Lines(Vec<u8>);

/// A line without an end.
#[derive(PartialEq, Eq, Debug)]
pub(crate) struct Endless;

impl Lines {
    /// The lines that this piece completes, without their ends.
    pub(crate) fn take(&mut self, piece: &[u8]) -> Result<Vec<String>, Endless> {
        let mut whole = Vec::new();
        for byte in piece {
            match byte {
                b'\n' => {
                    whole.push(String::from_utf8_lossy(&self.0).into_owned());
                    self.0.clear();
                }
                _ if self.0.len() == LINE_LIMIT => return Err(Endless),
                byte => self.0.push(*byte),
            }
        }
        Ok(whole)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_come_out_whole_however_they_come_in() {
        let mut lines = Lines::default();
        assert_eq!(lines.take(b"\"rep").unwrap(), Vec::<String>::new());
        assert_eq!(lines.take(b"ort\"\n\n\xff\n\"st").unwrap(), ["\"report\"", "", "\u{fffd}"]);
        assert_eq!(lines.take(b"op\"\n").unwrap(), ["\"stop\""]);
    }

    #[test]
    fn a_line_without_an_end_is_not_kept() {
        let mut lines = Lines::default();
        assert_eq!(lines.take(&[b'x'; LINE_LIMIT]).unwrap(), Vec::<String>::new());
        assert_eq!(lines.take(b"x"), Err(Endless));
    }
}
