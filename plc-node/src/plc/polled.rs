//! Knowledge of a bus since it was last called, so that the PLC asks it only when it may have something.
//!
//! A bus changes only when it is called: with a frame, at its timeout, or with a command. Most calls of the PLC are scans, which
//! call no bus.

use std::cell::Cell;

use machine::{Instant, InterfaceId, StreamRequest, Transmit};
use protocol::fieldbus::ControllerBus;

use super::PlcNode;
use crate::program::PlcProgram;

/// Frames, requests and events that a bus may have, and when it wants to be called.
#[derive(Clone, Debug)]
pub(super) struct Polled {
    may_send: bool,
    may_connect: bool,
    may_report: bool,
    /// Its next timeout; `None` where it was not asked since it was last called.
    timeout: Cell<Option<Option<Instant>>>,
}

impl Polled {
    /// Returns what is known of a bus that was just called: nothing.
    pub(super) const CALLED: Self =
        Self { may_send: true, may_connect: true, may_report: true, timeout: Cell::new(None) };
}

impl<B: ControllerBus, P: PlcProgram> PlcNode<B, P> {
    /// Returns a bus, to call it.
    pub(super) fn call(&mut self, bus: usize) -> Option<&mut B> {
        if let Some(polled) = self.polled.get_mut(bus) {
            *polled = Polled::CALLED;
        }
        self.buses.get_mut(bus)
    }

    /// Returns whether a bus may have an event. It has none afterwards: the caller takes all of them.
    pub(super) fn take_may_report(&mut self, bus: usize) -> bool {
        self.polled.get_mut(bus).is_some_and(|polled| std::mem::take(&mut polled.may_report))
    }

    /// Returns when a bus wants to be called.
    pub(super) fn timeout_of(&self, bus: usize) -> Option<Instant> {
        let (polled, bus) = (self.polled.get(bus)?, self.buses.get(bus)?);
        polled.timeout.get().unwrap_or_else(|| {
            let timeout = bus.poll_timeout();
            polled.timeout.set(Some(timeout));
            timeout
        })
    }

    /// Writes the next frame of any bus.
    pub(super) fn next_frame(&mut self, now: Instant, buf: &mut [u8]) -> Option<(InterfaceId, Transmit)> {
        let numbered = (0..).map(InterfaceId).zip(self.buses.iter_mut().zip(&mut self.polled));
        for (on, (bus, polled)) in numbered {
            if !polled.may_send {
                continue;
            }
            if let Some(transmit) = bus.poll_transmit(now, buf) {
                // What follows a frame may be anything.
                *polled = Polled::CALLED;
                return Some((on, transmit));
            }
            polled.may_send = false;
            polled.timeout.set(None);
        }
        None
    }

    /// Returns the next request about TCP connections of any bus.
    pub(super) fn next_stream(&mut self) -> Option<(InterfaceId, StreamRequest)> {
        let numbered = (0..).map(InterfaceId).zip(self.buses.iter_mut().zip(&mut self.polled));
        for (on, (bus, polled)) in numbered {
            if !polled.may_connect {
                continue;
            }
            if let Some(request) = bus.poll_stream() {
                *polled = Polled::CALLED;
                return Some((on, request));
            }
            polled.may_connect = false;
        }
        None
    }
}
