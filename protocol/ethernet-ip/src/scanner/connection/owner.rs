//! The methods for the owner of a connection: its data, its state, its end.

use core::fmt;

use machine::{Counters, Down, DownCause, Instant};

use super::dialogue::ScannerMessage;
use super::{Connection, Refusal, Step};
use crate::data::DataError;
use crate::description::Identity;

impl Connection {
    /// Returns whether data are exchanged in both directions.
    #[must_use]
    pub const fn is_up(&self) -> bool {
        self.up
    }

    /// Returns the adapter's refusal of the last connection, with what the adapter has instead.
    #[must_use]
    pub const fn refusal(&self) -> Option<&Refusal> {
        self.refusal.as_ref()
    }

    /// Writes why the adapter refused the last connection and what it has instead, where that is more than [`Down`]
    /// holds; otherwise nothing.
    pub fn explain(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        match (&self.conflict, &self.refusal) {
            (Some(conflict), _) => write!(words, "{conflict}"),
            (None, Some(refusal)) => write!(words, "{refusal}"),
            (None, None) => Ok(()),
        }
    }

    /// Writes the intervals that the adapter granted, if they are not those that were asked for; nothing while the connection is
    /// not up.
    pub fn remark(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        let (asked, granted) = ((self.config.o_t_rpi_us, self.config.t_o_rpi_us), self.granted_us);
        if !self.up || granted == asked {
            return Ok(());
        }
        let is_slower = granted.0 > asked.0 || granted.1 > asked.1;
        let than = if is_slower { "slower" } else { "faster" };
        write!(
            words,
            "the adapter {} is {than} than asked: it grants a packet every {} µs O→T and {} µs T→O, asked were {} and {} µs",
            self.config.target, granted.0, granted.1, asked.0, asked.1
        )
    }

    /// Returns the identity that the adapter reported, once it was asked.
    #[must_use]
    pub const fn identity(&self) -> Option<&Identity> {
        self.found.as_ref()
    }

    /// Returns the numbers of frames of this connection since its start.
    #[must_use]
    pub const fn counters(&self) -> Counters {
        self.counters
    }

    /// Returns the number of cyclic frames received since the start.
    #[must_use]
    pub const fn received(&self) -> u64 {
        self.counters.received
    }

    /// Returns the newest data of the T→O assembly; none while the connection is not up.
    #[must_use]
    pub fn input(&self) -> Option<&[u8]> {
        self.up.then_some(&self.input)
    }

    /// Sets the data of the O→T assembly, for the next cyclic frame and every one after it. Until then they are zeros.
    pub fn set_output(&mut self, data: &[u8]) -> Result<(), DataError> {
        if data.len() != self.output.len() {
            return Err(DataError::Length { expected: self.output.len(), found: data.len() });
        }
        self.output.copy_from_slice(data);
        Ok(())
    }

    /// Returns the data of the O→T assembly, to be changed in place.
    pub fn output_mut(&mut self) -> &mut [u8] {
        &mut self.output
    }

    /// Sets the run/idle state in the frames; it is run at the start.
    pub const fn set_run(&mut self, run: bool) {
        self.run = run;
    }

    /// Makes it a null connection (volume 1, 3-5.5.2): its Forward_Open gives the adapter its configuration, and no data are
    /// exchanged. It is up from then on for explicit requests, as long as its session lasts. Call it before the scanner runs.
    pub const fn make_null(&mut self) {
        self.is_null = true;
    }

    /// Returns whether it is a null connection.
    #[must_use]
    pub const fn is_null(&self) -> bool {
        self.is_null
    }

    /// Closes the connection by a Forward_Close, and then the session; over a new TCP connection if the old one is gone.
    /// [`LinkEvent::Down`](machine::LinkEvent::Down) reports the end.
    pub fn disconnect(&mut self, now: Instant) {
        if self.leaving {
            return;
        }
        self.leaving = true;
        self.up = false;
        self.keep_alive_at = None;
        match (self.step, self.stream) {
            (Step::Running, _) if self.is_null => {
                self.fail(now, Down { cause: DownCause::ClosedHere, code: 0, text: "" });
            }
            (Step::Running, Some(_)) => {
                self.io = None;
                self.enter(now, Step::Closing, ScannerMessage::Close);
            }
            (Step::Running, None) => {
                self.io = None;
                self.connect(now);
            }
            _ => {
                self.connect = false;
                self.fail(now, Down { cause: DownCause::ClosedHere, code: 0, text: "" });
            }
        }
    }
}
