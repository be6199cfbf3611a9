//! Calls of the buses, and questions to those that may have something ([`BusPolls`]).

use machine::{Instant, InterfaceId, Pending, StreamRequest, Transmit};
use protocol::bus_polls::BusPolls;
use protocol::fieldbus::ControllerBus;

use super::PlcNode;
use crate::program::PlcProgram;

impl<B: ControllerBus, P: PlcProgram> PlcNode<B, P> {
    /// Returns a bus, to call it.
    pub(super) fn call(&mut self, bus: usize) -> Option<&mut B> {
        if let Some(polled) = self.polled.get_mut(bus) {
            *polled = BusPolls::called();
        }
        self.buses.get_mut(bus)
    }

    /// Returns whether a bus may have an event. It has none afterwards: the caller takes all of them.
    pub(super) fn take_may_report(&mut self, bus: usize) -> bool {
        self.polled.get_mut(bus).is_some_and(BusPolls::take_may_report)
    }

    /// Asks a bus that was just called what it may have.
    pub(super) fn note_pending(&mut self, now: Instant, bus: usize) {
        if let (Some(polled), Some(bus)) = (self.polled.get_mut(bus), self.buses.get(bus)) {
            polled.narrow(bus.pending(now));
        }
    }

    /// Returns what the PLC may have. Events of its buses are already its own.
    pub(super) fn all_pending(&self) -> Pending {
        Pending {
            frame: self.polled.iter().any(|polled| polled.may_send),
            request: self.polled.iter().any(|polled| polled.may_connect),
            event: !self.events.is_empty(),
        }
    }

    /// Returns when a bus wants to be called.
    pub(super) fn timeout_of(&self, bus: usize) -> Option<Instant> {
        let (polled, bus) = (self.polled.get(bus)?, self.buses.get(bus)?);
        polled.timeout(|| bus.poll_timeout())
    }

    /// Writes the next frame of any bus.
    pub(super) fn next_frame(&mut self, now: Instant, buf: &mut [u8]) -> Option<(InterfaceId, Transmit)> {
        let numbered = (0..).map(InterfaceId).zip(self.buses.iter_mut().zip(&mut self.polled));
        for (on, (bus, polled)) in numbered {
            if !polled.may_send {
                continue;
            }
            if let Some(transmit) = bus.poll_transmit(now, buf) {
                *polled = BusPolls::called();
                polled.narrow(bus.pending(now));
                return Some((on, transmit));
            }
            polled.end_sending();
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
                *polled = BusPolls::called();
                return Some((on, request));
            }
            polled.may_connect = false;
        }
        None
    }
}
