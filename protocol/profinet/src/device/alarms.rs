//! The device's end of the alarm connection: sends the device's alarms one at a time and repeats them until the controller has
//! them, acknowledges the controller's PDUs, and refuses alarms, because a controller sends none.

use super::outgoing::{AlarmError, Outgoing, OutgoingAlarms};
use crate::ETHER_TYPE;
use crate::alarm::{
    Acknowledgement, Alarm, FRAME_ID_HIGH, FRAME_ID_LOW, Notification, PduType, Priority, Rta, error_status,
    next_sequence,
};
use crate::rt::{Route, UDP_PORT};
use crate::status::{Service, Status, Violation};
use crate::tag;
use machine::Instant;
use machine::Port;
use machine::Transmit;
use machine::ethernet::EthernetHeader;
use machine::wire::{BigEndian, Overflow, Writer};

/// One alarm connection, both priorities.
#[derive(Clone, Copy, Debug)]
pub(super) struct AlarmEndpoint {
    route: Route,
    own_reference: u16,
    peer_reference: u16,
    high: Channel,
    low: Channel,
    outgoing: OutgoingAlarms,
}

#[derive(Clone, Copy, Debug)]
struct Channel {
    /// Number of the last DATA PDU sent.
    sent: u16,
    /// Number of the last DATA PDU received.
    acknowledged: u16,
    acknowledge: bool,
    refuse: Option<Acknowledgement>,
}

impl Channel {
    /// Nothing sent and nothing received: the first DATA PDU has number 0xFFFF.
    const NEW: Self = Self { sent: 0xFFFE, acknowledged: 0xFFFE, acknowledge: false, refuse: None };
}

/// Result of receiving a PDU on the alarm connection.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum AlarmReceived {
    /// It was accepted.
    Handled,
    /// It was a duplicate or out of order.
    Late,
    /// It was malformed.
    Malformed,
    /// It is for another connection.
    Foreign,
    /// The controller aborts the AR.
    Aborted(Status),
}

impl AlarmEndpoint {
    pub(super) const fn new(
        route: Route,
        own_reference: u16,
        peer_reference: u16,
        outgoing: OutgoingAlarms,
    ) -> Self {
        Self { route, own_reference, peer_reference, high: Channel::NEW, low: Channel::NEW, outgoing }
    }

    /// Queues an alarm of the device.
    pub(super) fn raise(&mut self, alarm: &Notification<'_>) -> Result<(), AlarmError> {
        self.outgoing.raise(alarm)
    }

    /// Repeats the alarm that the controller has not acknowledged in time. Returns false after the last repetition.
    pub(super) fn handle_timeout(&mut self, now: Instant) -> bool {
        self.outgoing.handle_timeout(now)
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        self.outgoing.poll_timeout()
    }

    /// Handles an RTA PDU, which begins behind its FrameID.
    pub(super) fn handle_pdu(&mut self, priority: Priority, pdu: &[u8]) -> AlarmReceived {
        let Ok((rta, variable)) = Rta::parse(pdu) else { return AlarmReceived::Malformed };
        if (rta.destination, rta.source) != (self.own_reference, self.peer_reference) {
            return AlarmReceived::Foreign;
        }
        let channel = match priority {
            Priority::High => &mut self.high,
            Priority::Low => &mut self.low,
        };
        if matches!(rta.pdu_type, PduType::Data | PduType::Ack) && rta.ack_sequence == channel.sent {
            self.outgoing.received(priority);
        }
        match rta.pdu_type {
            PduType::Data => channel.handle_data(priority, &rta, variable, &mut self.outgoing),
            PduType::Ack | PduType::Nack => AlarmReceived::Handled,
            PduType::Error => match error_status(variable) {
                Some(status) => AlarmReceived::Aborted(status),
                None => AlarmReceived::Malformed,
            },
            PduType::Unknown(_) => AlarmReceived::Malformed,
        }
    }

    /// Writes the next PDU.
    pub(super) fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        if !self.high.has_to_send() && !self.low.has_to_send() && !self.outgoing.has_to_send() {
            return None;
        }
        let (own, peer, route) = (self.own_reference, self.peer_reference, self.route);
        for (priority, channel) in [(Priority::High, &mut self.high), (Priority::Low, &mut self.low)] {
            let rta = |pdu_type, flags, channel: &Channel| Rta {
                destination: peer,
                source: own,
                pdu_type,
                flags,
                send_sequence: channel.sent,
                ack_sequence: channel.acknowledged,
            };
            if core::mem::take(&mut channel.acknowledge) {
                let rta = rta(PduType::Ack, Rta::WINDOW_1, channel);
                return transmit(route, priority, buf, |writer| rta.emit(writer, |_| {})).ok();
            }
            if let Some(refusal) = channel.refuse.take() {
                channel.sent = next_sequence(channel.sent);
                let rta = rta(PduType::Data, Rta::WINDOW_1_TACK, channel);
                let alarm = Alarm::Acknowledgement(refusal);
                return transmit(route, priority, buf, |writer| rta.emit(writer, |w| alarm.emit(w))).ok();
            }
            if let Some(Outgoing { alarm, is_repeated }) = self.outgoing.next(now, priority) {
                if !is_repeated {
                    channel.sent = next_sequence(channel.sent);
                }
                let rta = rta(PduType::Data, Rta::WINDOW_1_TACK, channel);
                let alarm = Alarm::Notification(alarm.notification());
                return transmit(route, priority, buf, |writer| rta.emit(writer, |w| alarm.emit(w))).ok();
            }
        }
        None
    }

    /// Returns the last PDU of this connection: an error PDU.
    pub(super) const fn final_error(&self, status: Status) -> FinalError {
        let rta = Rta {
            destination: self.peer_reference,
            source: self.own_reference,
            pdu_type: PduType::Error,
            flags: Rta::WINDOW_1,
            send_sequence: next_sequence(self.low.sent),
            ack_sequence: self.low.acknowledged,
        };
        FinalError { route: self.route, rta, status }
    }
}

impl Channel {
    const fn has_to_send(&self) -> bool {
        self.acknowledge || self.refuse.is_some()
    }

    fn handle_data(
        &mut self,
        priority: Priority,
        rta: &Rta,
        variable: &[u8],
        outgoing: &mut OutgoingAlarms,
    ) -> AlarmReceived {
        if rta.send_sequence == self.acknowledged {
            // Our acknowledgement was lost.
            self.acknowledge = true;
            return AlarmReceived::Late;
        }
        if rta.send_sequence != next_sequence(self.acknowledged) {
            return AlarmReceived::Late;
        }
        let Ok(alarm) = Alarm::parse(variable) else { return AlarmReceived::Malformed };
        self.acknowledged = rta.send_sequence;
        self.acknowledge = true;
        match alarm {
            Alarm::Notification(notification) => {
                self.refuse = Some(Acknowledgement {
                    priority,
                    head: notification.head,
                    specifier: notification.specifier,
                    status: Violation::AlarmNotSupported.status(Service::AlarmAck),
                });
            }
            Alarm::Acknowledgement(acknowledgement) => outgoing.acknowledged(&acknowledgement),
        }
        AlarmReceived::Handled
    }
}

/// An error PDU that is sent after its AR has ended.
#[derive(Clone, Copy, Debug)]
pub(super) struct FinalError {
    route: Route,
    rta: Rta,
    status: Status,
}

impl FinalError {
    pub(super) fn emit(&self, buf: &mut [u8]) -> Result<Transmit, Overflow> {
        transmit(self.route, Priority::Low, buf, |writer| self.rta.emit_error(self.status, writer))
    }
}

fn transmit(
    route: Route,
    priority: Priority,
    buf: &mut [u8],
    pdu: impl FnOnce(&mut Writer<'_, BigEndian>),
) -> Result<Transmit, Overflow> {
    let (frame_id, tag) = match priority {
        Priority::High => (FRAME_ID_HIGH, tag::RT),
        Priority::Low => (FRAME_ID_LOW, tag::ALARM_LOW),
    };
    let write = |writer: &mut Writer<'_, BigEndian>| {
        writer.u16(frame_id);
        pdu(writer);
    };
    match route {
        Route::Ethernet { source, destination } => {
            let header = EthernetHeader { destination, source, tag: Some(tag), ether_type: ETHER_TYPE };
            let len = header.emit(buf, write)?;
            Ok(Transmit { port: Port::Ethernet, to: None, len })
        }
        Route::Udp(to) => {
            let mut writer = Writer::new(buf);
            write(&mut writer);
            Ok(Transmit { port: Port::Udp(UDP_PORT), to: Some(to), len: writer.finish()? })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::captured;
    use machine::Duration;
    use machine::ethernet::Mac;

    const CPU: Mac = Mac([0xEC, 0x1C, 0x5D, 0x61, 0xE7, 0x3C]);
    const P_NET: Mac = Mac([0x8C, 0xF3, 0x19, 0xCD, 0x19, 0xF8]);

    #[test]
    fn an_alarm_ack_of_a_siemens_controller_is_acknowledged_as_p_net_did() {
        let route = Route::Ethernet { source: P_NET, destination: CPU };
        let mut endpoint =
            AlarmEndpoint::new(route, 0, 0, OutgoingAlarms::new(Duration::from_millis(100), 3));
        endpoint.high.sent = 0xFFFF;
        let frame = captured::frame(captured::ALARM_ACK_HIGH_CPU);
        let (_, payload) = EthernetHeader::parse(&frame).unwrap();
        assert_eq!(endpoint.handle_pdu(Priority::High, &payload[2..]), AlarmReceived::Handled);
        let mut buf = [0; 100];
        let transmit = endpoint.poll_transmit(Instant::ZERO, &mut buf).unwrap();
        let p_net = captured::frame(captured::ALARM_ACK_RTA_HIGH_DEV);
        assert_eq!(buf[..p_net.len()], p_net);
        assert_eq!(transmit.len, 64);
        assert!(endpoint.poll_transmit(Instant::ZERO, &mut buf).is_none());

        assert_eq!(endpoint.handle_pdu(Priority::High, &payload[2..]), AlarmReceived::Late);
        assert!(
            endpoint.poll_transmit(Instant::ZERO, &mut buf).is_some(),
            "a repetition is acknowledged again"
        );
    }

    #[test]
    fn an_alarm_from_the_controller_is_refused_with_its_status() {
        let mut endpoint = AlarmEndpoint::new(
            Route::Ethernet { source: P_NET, destination: CPU },
            0,
            0,
            OutgoingAlarms::new(Duration::from_millis(100), 3),
        );
        let frame = captured::frame(captured::ALARM_PROCESS_NOTIF);
        let (_, payload) = EthernetHeader::parse(&frame).unwrap();
        assert_eq!(endpoint.handle_pdu(Priority::High, &payload[2..]), AlarmReceived::Handled);
        let mut buf = [0; 100];
        assert!(endpoint.poll_transmit(Instant::ZERO, &mut buf).is_some(), "the acknowledgement");
        let transmit = endpoint.poll_transmit(Instant::ZERO, &mut buf).unwrap();
        let (_, payload) = EthernetHeader::parse(&buf[..transmit.len]).unwrap();
        let (_, variable) = Rta::parse(&payload[2..]).unwrap();
        let Ok(Alarm::Acknowledgement(refusal)) = Alarm::parse(variable) else { panic!("a refusal") };
        assert_eq!(refusal.status, Status(0xDA81_3C00));
    }

    #[test]
    fn an_error_pdu_of_the_controller_is_its_abort() {
        let mut endpoint = AlarmEndpoint::new(
            Route::Ethernet { source: P_NET, destination: CPU },
            0,
            0,
            OutgoingAlarms::new(Duration::from_millis(100), 3),
        );
        let frame = captured::frame(captured::ALARM_ERR_RTA_CPU_REMOVED);
        let (_, payload) = EthernetHeader::parse(&frame).unwrap();
        let received = endpoint.handle_pdu(Priority::Low, &payload[2..]);
        assert_eq!(received, AlarmReceived::Aborted(Violation::ArRemoved.status(Service::Abort)));
        let mut other = AlarmEndpoint::new(
            Route::Ethernet { source: P_NET, destination: CPU },
            1,
            0,
            OutgoingAlarms::new(Duration::from_millis(100), 3),
        );
        assert_eq!(other.handle_pdu(Priority::Low, &payload[2..]), AlarmReceived::Foreign);
    }

    #[test]
    fn an_alarm_of_either_priority_is_acknowledged_with_its_own_frame_id() {
        let frame = captured::frame(captured::ALARM_PROCESS_NOTIF);
        let (_, payload) = EthernetHeader::parse(&frame).unwrap();
        for (priority, frame_id) in [(Priority::High, FRAME_ID_HIGH), (Priority::Low, FRAME_ID_LOW)] {
            let mut endpoint = AlarmEndpoint::new(
                Route::Ethernet { source: P_NET, destination: CPU },
                0,
                0,
                OutgoingAlarms::new(Duration::from_millis(100), 3),
            );
            assert_eq!(endpoint.handle_pdu(priority, &payload[2..]), AlarmReceived::Handled);
            let mut buf = [0; 100];
            for wanted in [PduType::Ack, PduType::Data] {
                let transmit = endpoint.poll_transmit(Instant::ZERO, &mut buf).unwrap();
                let (_, payload) = EthernetHeader::parse(&buf[..transmit.len]).unwrap();
                let (rta, _) = Rta::parse(&payload[2..]).unwrap();
                assert_eq!((&payload[..2], rta.pdu_type), (&frame_id.to_be_bytes()[..], wanted));
            }
            assert!(endpoint.poll_transmit(Instant::ZERO, &mut buf).is_none());
        }
    }
}
