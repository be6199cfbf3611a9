//! Everything besides cyclic data: discovery, calls, alarms and timeouts.

use core::net::SocketAddrV4;

use super::{Ar, ArPhase, down_reasons};
use crate::RPC_PORT;
use crate::status::{Service, Violation};
use machine::{Down, DownCause};
use machine::{Instant, Port, Transmit};

/// Whether anything besides cyclic data needs to be polled. While cyclic data are exchanged this is rare, so it is not
/// polled at every frame.
#[derive(Clone, Copy, Debug)]
pub(super) enum Acyclic {
    /// There may be something to send, and another deadline.
    Active,
    /// Everything is sent, and nothing is due before this time.
    Quiet { until: Option<Instant> },
}

impl Ar {
    /// Writes the next frame that is not cyclic.
    pub(in super::super) fn poll_acyclic(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        if matches!(self.acyclic, Acyclic::Quiet { .. }) {
            return None;
        }
        let transmit = self.poll_any_acyclic(now, buf);
        if transmit.is_none() {
            self.acyclic = Acyclic::Quiet { until: self.acyclic_timeout() };
        }
        transmit
    }

    fn poll_any_acyclic(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        if let Some(transmit) = self.link.as_mut().and_then(|link| link.alarms.poll_transmit(now, buf)) {
            return Some(transmit);
        }
        if let Some(transmit) = self.final_error.take().and_then(|final_error| final_error.emit(buf)) {
            return Some(transmit);
        }
        if let Some(len) = self.caller.poll_transmit(buf) {
            let to = Some(SocketAddrV4::new(self.config.address, RPC_PORT));
            return Some(Transmit { port: Port::Udp(RPC_PORT), to, len });
        }
        let len = self.discovery.poll_transmit(now, buf)?;
        Some(Transmit { port: Port::Ethernet, to: None, len })
    }

    /// Returns when something besides cyclic frames is due, in either direction.
    pub(super) fn acyclic_timeout(&self) -> Option<Instant> {
        let of_phase = match self.phase {
            ArPhase::Pausing { until } | ArPhase::Releasing { until } => Some(until),
            ArPhase::AwaitingReady { .. } => self.ready_until(),
            _ => None,
        };
        let of_alarms = self.link.as_ref().and_then(|link| link.alarms.poll_timeout());
        [of_phase, self.silent_at, of_alarms, self.discovery.poll_timeout(), self.caller.poll_timeout()]
            .into_iter()
            .fold(None, Instant::earlier)
    }

    /// Handles what is due besides cyclic frames.
    pub(super) fn handle_acyclic_timeout(&mut self, now: Instant) {
        self.acyclic = Acyclic::Active;
        self.handle_link_timeout(now);
        let progress = self.discovery.handle_timeout(now);
        self.progress(now, progress);
        if self.caller.handle_timeout(now) {
            self.give_up_call(now);
        }
        match self.phase {
            ArPhase::Pausing { until } if now >= until => self.start_attempt(now),
            ArPhase::AwaitingReady { .. } if self.ready_until().is_some_and(|until| now >= until) => {
                let status = Violation::ApplicationReadyTimeout.status(Service::Abort);
                let down = Down { cause: DownCause::NoAnswer, code: 0, text: down_reasons::NOT_READY };
                self.fail(now, down, Some(status));
            }
            ArPhase::Releasing { until } if now >= until => self.stop(),
            _ => {}
        }
        if self.silent_at.is_some_and(|at| now >= at) {
            self.report(Down { cause: DownCause::NoAnswer, code: 0, text: self.reason_for_silence() });
        }
    }

    /// Returns until when the device may prepare itself.
    fn ready_until(&self) -> Option<Instant> {
        let ArPhase::AwaitingReady { until, silent_until } = self.phase else { return None };
        let sends = self.link.as_ref().is_some_and(|link| self.is_monitored(link));
        Some(if sends { until } else { silent_until })
    }

    fn handle_link_timeout(&mut self, now: Instant) {
        let is_monitored = self.link.as_ref().is_some_and(|link| self.is_monitored(link));
        let Some(link) = &mut self.link else { return };
        if link.alarms.handle_timeout(now) {
            let down = Down { cause: DownCause::NoAnswer, code: 0, text: down_reasons::NO_ALARM_ACK };
            self.fail(now, down, Some(Violation::Abort.status(Service::Abort)));
        } else if is_monitored && link.receiver.is_expired(now) {
            let status = Violation::ConsumerExpired.status(Service::Abort);
            let has_sent = link.receiver.received() > 0;
            let text = if has_sent { down_reasons::WATCHDOG } else { down_reasons::NO_CYCLIC };
            self.fail(now, Down { cause: DownCause::Watchdog, code: status.0, text }, Some(status));
        }
    }
}
