//! Inputs of the thread beside the cyclic one, and lines of text assembled from pieces.

use std::net::SocketAddr;

use machine::LinkStatus;
use protocol_linux::StopSignal;

/// Longest accepted line in bytes. No instruction is longer.
pub(crate) const LINE_LIMIT: usize = 64 * 1024;

/// An input.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Input {
    /// A line from the instructions' source, without its end.
    Line(String),
    /// Standard input ended: the process that sent instructions is gone.
    Closed,
    /// A controller connected to the control port.
    Attached(SocketAddr),
    /// The controller left or was disconnected.
    Detached {
        /// The controller.
        peer: SocketAddr,
        /// Why.
        reason: String,
    },
    /// A client of the control port did not become the controller.
    Refused {
        /// The client.
        peer: SocketAddr,
        /// Why.
        reason: String,
        /// Clients since the last report, besides this one.
        more: u32,
    },
    /// State and counters of the node's interface.
    Link(LinkStatus),
    /// The interface at which the node passes frames on has a carrier, or has lost it.
    Carrier(bool),
    /// A signal asks to stop.
    Stop(StopSignal),
}

/// Assembles lines from the pieces in which they arrive.
#[derive(Default, Debug)]
pub(crate) struct Lines(Vec<u8>);

/// A line that exceeds the limit without an end.
#[derive(PartialEq, Eq, Debug, thiserror::Error)]
#[error("a line has more than {LINE_LIMIT} bytes")]
pub(crate) struct LineTooLong;

impl Lines {
    /// Adds a piece; returns the lines that it completes, without their ends.
    pub(crate) fn take(&mut self, piece: &[u8]) -> Result<Vec<String>, LineTooLong> {
        let mut whole = Vec::new();
        for byte in piece {
            match byte {
                b'\n' => {
                    whole.push(String::from_utf8_lossy(&self.0).into_owned());
                    self.0.clear();
                }
                _ if self.0.len() == LINE_LIMIT => return Err(LineTooLong),
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
    fn lines_are_assembled_whole_from_any_pieces() {
        let mut lines = Lines::default();
        assert_eq!(lines.take(b"\"rep").unwrap(), Vec::<String>::new());
        assert_eq!(lines.take(b"ort\"\n\n\xff\n\"st").unwrap(), ["\"report\"", "", "\u{fffd}"]);
        assert_eq!(lines.take(b"op\"\n").unwrap(), ["\"stop\""]);
    }

    #[test]
    fn a_line_without_an_end_is_not_kept() {
        let mut lines = Lines::default();
        assert_eq!(lines.take(&[b'x'; LINE_LIMIT]).unwrap(), Vec::<String>::new());
        assert_eq!(lines.take(b"x"), Err(LineTooLong));
    }
}
