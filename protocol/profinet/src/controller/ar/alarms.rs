//! The controller's end of the alarm connection: it acknowledges every alarm, so that the device can send the next one. An
//! error PDU ends the AR (IEC 61158-6-10, 4.8).
//!
//! ```text
//! device  DATA notification  ──▶
//!         ◀── ACK                 the PDU has arrived
//!         ◀── DATA AlarmAck       the application has received the alarm
//!         ACK ──▶
//! ```

use super::plug::Plugged;
use crate::ETHER_TYPE;
use crate::alarm::{
    Acknowledgement, Alarm, FRAME_ID_HIGH, FRAME_ID_LOW, PduType, Priority, Rta, error_status, next_sequence,
};
use crate::rt::{Route, UDP_PORT};
use crate::status::Status;
use crate::tag;
use machine::ethernet::EthernetHeader;
use machine::wire::{BigEndian, Writer};
use machine::{Duration, Instant, Port, Transmit};

/// RTATimeoutFactor 1: when a DATA PDU that was not acknowledged is repeated.
const REPEAT_AFTER: Duration = Duration::from_millis(100);
/// RTARetries: number of repetitions.
const RETRIES: u8 = 3;
/// Acknowledged sequence number before the first PDU has arrived.
const BEFORE_FIRST: u16 = 0xFFFE;

/// Result of receiving an RTA PDU.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Outcome {
    /// It belongs to the connection.
    Handled,
    /// It is the alarm of a submodule that waits for its parameters.
    Plugged(Plugged),
    /// It belongs to another connection, or answers a PDU that was not sent.
    Foreign,
    /// It broke the format.
    Malformed,
    /// The device ended the AR.
    Aborted(Status),
}

/// The alarm connection of one AR, both priorities.
#[derive(Debug)]
pub(super) struct Alarms {
    route: Route,
    /// LocalAlarmReference of this side, and of the device.
    references: (u16, u16),
    high: Endpoint,
    low: Endpoint,
}

#[derive(Debug)]
struct Endpoint {
    priority: Priority,
    last_sent: u16,
    last_received: u16,
    ack_due: bool,
    outstanding: Option<Outstanding>,
}

/// An AlarmAck that the device has not acknowledged.
#[derive(Clone, Copy, Debug)]
struct Outstanding {
    alarm: Acknowledgement,
    repeat_at: Instant,
    sent: u8,
    due: bool,
}

/// An error PDU that is sent after its AR has ended.
#[derive(Clone, Copy, Debug)]
pub(super) struct FinalError {
    route: Route,
    rta: Rta,
    status: Status,
}

impl Alarms {
    /// Creates the connection after a Connect. `references` are the LocalAlarmReferences of this side and of the device.
    pub(super) const fn new(route: Route, references: (u16, u16)) -> Self {
        Self { route, references, high: Endpoint::new(Priority::High), low: Endpoint::new(Priority::Low) }
    }

    /// Handles a PDU that followed this FrameID.
    pub(super) fn handle(&mut self, now: Instant, frame_id: u16, pdu: &[u8]) -> Outcome {
        let Ok((rta, variable)) = Rta::parse(pdu) else { return Outcome::Malformed };
        if (rta.destination, rta.source) != self.references {
            return Outcome::Foreign;
        }
        if rta.pdu_type == PduType::Error {
            return error_status(variable).map_or(Outcome::Malformed, Outcome::Aborted);
        }
        match frame_id {
            FRAME_ID_HIGH => self.high.handle(now, &rta, variable),
            FRAME_ID_LOW => self.low.handle(now, &rta, variable),
            _ => Outcome::Foreign,
        }
    }

    /// Repeats PDUs that were not acknowledged. Returns whether the device failed to acknowledge the last repetition.
    pub(super) fn handle_timeout(&mut self, now: Instant) -> bool {
        self.high.handle_timeout(now) || self.low.handle_timeout(now)
    }

    /// Writes the next PDU.
    pub(super) fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let Self { route, references, high, low } = self;
        if !high.has_to_send() && !low.has_to_send() {
            return None;
        }
        [high, low].into_iter().find_map(|endpoint| {
            let (rta, alarm) = endpoint.poll_transmit(now, *references)?;
            emit(*route, endpoint.priority, buf, |writer| {
                rta.emit(writer, |writer| {
                    if let Some(alarm) = alarm {
                        Alarm::Acknowledgement(alarm).emit(writer);
                    }
                });
            })
        })
    }

    /// Returns the numbers of the newest PDUs with data, of high and low priority.
    pub(super) const fn received(&self) -> (u16, u16) {
        (self.high.last_received, self.low.last_received)
    }

    /// Returns whether the device has acknowledged every AlarmAck.
    pub(super) const fn are_acknowledged(&self) -> bool {
        self.high.outstanding.is_none() && self.low.outstanding.is_none()
    }

    /// Returns when a PDU has to be repeated.
    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        Instant::earlier(self.high.repeat_at(), self.low.repeat_at())
    }

    /// Returns the error PDU that reports the end of the AR to the device.
    pub(super) const fn final_error(&self, status: Status) -> FinalError {
        let rta = self.low.rta(PduType::Error, self.references);
        FinalError { route: self.route, rta, status }
    }
}

impl FinalError {
    /// Writes the PDU.
    pub(super) fn emit(&self, buf: &mut [u8]) -> Option<Transmit> {
        emit(self.route, Priority::Low, buf, |writer| self.rta.emit_error(self.status, writer))
    }
}

impl Endpoint {
    const fn new(priority: Priority) -> Self {
        Self {
            priority,
            last_sent: BEFORE_FIRST,
            last_received: BEFORE_FIRST,
            ack_due: false,
            outstanding: None,
        }
    }

    const fn rta(&self, pdu_type: PduType, (own, devices): (u16, u16)) -> Rta {
        Rta {
            destination: devices,
            source: own,
            pdu_type,
            flags: match pdu_type {
                PduType::Data => Rta::WINDOW_1_TACK,
                _ => Rta::WINDOW_1,
            },
            send_sequence: self.last_sent,
            ack_sequence: self.last_received,
        }
    }

    fn handle(&mut self, now: Instant, rta: &Rta, variable: &[u8]) -> Outcome {
        match rta.pdu_type {
            PduType::Data => {}
            PduType::Ack => {
                return if self.acknowledged(rta.ack_sequence) { Outcome::Handled } else { Outcome::Foreign };
            }
            // The device wants the PDU again; it is repeated in any case.
            PduType::Nack => return Outcome::Handled,
            PduType::Error | PduType::Unknown(_) => return Outcome::Foreign,
        }
        if rta.send_sequence == self.last_received {
            self.ack_due = true;
            return Outcome::Handled;
        }
        let _ = self.acknowledged(rta.ack_sequence);
        if rta.send_sequence != next_sequence(self.last_received) || self.outstanding.is_some() {
            return Outcome::Foreign;
        }
        let Ok(alarm) = Alarm::parse(variable) else { return Outcome::Malformed };
        self.last_received = rta.send_sequence;
        self.ack_due = true;
        if let Alarm::Notification(notification) = alarm {
            self.last_sent = next_sequence(self.last_sent);
            self.outstanding = Some(Outstanding {
                alarm: Acknowledgement {
                    priority: self.priority,
                    head: notification.head,
                    specifier: notification.specifier,
                    status: Status::OK,
                },
                repeat_at: now + REPEAT_AFTER,
                sent: 0,
                due: true,
            });
            return Plugged::from_alarm(&notification).map_or(Outcome::Handled, Outcome::Plugged);
        }
        Outcome::Handled
    }

    fn repeat_at(&self) -> Option<Instant> {
        self.outstanding.as_ref().map(|outstanding| outstanding.repeat_at)
    }

    fn has_to_send(&self) -> bool {
        self.ack_due || self.outstanding.as_ref().is_some_and(|outstanding| outstanding.due)
    }

    fn acknowledged(&mut self, ack_sequence: u16) -> bool {
        let ours = ack_sequence == self.last_sent
            && self.outstanding.is_some_and(|outstanding| outstanding.sent > 0);
        if ours {
            self.outstanding = None;
        }
        ours
    }

    fn handle_timeout(&mut self, now: Instant) -> bool {
        match &mut self.outstanding {
            Some(outstanding) if now >= outstanding.repeat_at => {
                outstanding.due = true;
                outstanding.repeat_at = now + REPEAT_AFTER;
                outstanding.sent > RETRIES
            }
            _ => false,
        }
    }

    fn poll_transmit(
        &mut self,
        now: Instant,
        references: (u16, u16),
    ) -> Option<(Rta, Option<Acknowledgement>)> {
        if core::mem::take(&mut self.ack_due) {
            // As in the Siemens controller's frames, the ACK still counts the DATA PDU before.
            let mut ack = self.rta(PduType::Ack, references);
            if self.outstanding.is_some_and(|outstanding| outstanding.sent == 0) {
                ack.send_sequence = preceding(ack.send_sequence);
            }
            return Some((ack, None));
        }
        let data = self.rta(PduType::Data, references);
        let outstanding = self.outstanding.as_mut().filter(|outstanding| outstanding.due)?;
        outstanding.due = false;
        outstanding.sent += 1;
        outstanding.repeat_at = now + REPEAT_AFTER;
        Some((data, Some(outstanding.alarm)))
    }
}

/// Returns the number before `sequence`, which was sent.
const fn preceding(sequence: u16) -> u16 {
    match sequence {
        0 => 0xFFFF,
        other => other - 1,
    }
}

fn emit(
    route: Route,
    priority: Priority,
    buf: &mut [u8],
    pdu: impl FnOnce(&mut Writer<'_, BigEndian>),
) -> Option<Transmit> {
    let (frame_id, tag) = match priority {
        Priority::High => (FRAME_ID_HIGH, tag::RT),
        Priority::Low => (FRAME_ID_LOW, tag::ALARM_LOW),
    };
    match route {
        Route::Ethernet { source, destination } => {
            let header = EthernetHeader { destination, source, tag: Some(tag), ether_type: ETHER_TYPE };
            let len = header
                .emit(buf, |writer| {
                    writer.u16(frame_id);
                    pdu(writer);
                })
                .ok()?;
            Some(Transmit { port: Port::Ethernet, to: None, len })
        }
        Route::Udp(to) => {
            let mut writer = Writer::<BigEndian>::new(buf);
            writer.u16(frame_id);
            pdu(&mut writer);
            let len = writer.finish().ok()?;
            Some(Transmit { port: Port::Udp(UDP_PORT), to: Some(to), len })
        }
    }
}

#[cfg(test)]
mod tests;
