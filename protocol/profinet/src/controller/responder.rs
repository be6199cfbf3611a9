//! Calls to the controller: ApplicationReady of its devices, and the endpoint mapper. A repeated call is answered again, so
//! that a lost answer does no harm.

use core::net::SocketAddrV4;

use crate::Uuid;
use crate::control::{Command, Control};
use crate::rpc::{
    CONTROLLER_INTERFACE, ENDPOINT_MAPPER_INTERFACE, Endpoint, Header, Kind, MapperCall, MapperError,
    Message, Operation, RequestArgs, ResponseArgs, flags, rpc_status,
};
use crate::status::{Service, Violation};
use machine::wire::{BigEndian, Overflow, Writer};

/// Result of handling a PDU from the device.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum RequestOutcome {
    /// The device of this AR is ready for cyclic data.
    Ready(Uuid),
    /// It was answered; nothing else follows.
    Answered,
    /// It is not for a controller.
    Foreign,
    /// It was malformed, and was answered with an error.
    Malformed,
}

/// Answers calls, the last one at a time.
#[derive(Debug)]
pub(super) struct Responder {
    answer: Message,
    to: Option<SocketAddrV4>,
}

impl Responder {
    /// Creates a responder. It allocates its memory here; nothing allocates later.
    pub(super) fn new() -> Self {
        Self { answer: Message::new(), to: None }
    }

    /// Acknowledges a fragment of a call that is not complete.
    pub(super) fn acknowledge(&mut self, from: SocketAddrV4, header: &Header) {
        let answer = Header { fragment: header.fragment, ..header.answer(Kind::FragmentAck) };
        self.to = Some(from);
        // An empty body always fits.
        let _ = self.answer.set(answer, |_| Ok(0));
    }

    /// Handles a PDU of a client, with the whole body of its call. `endpoint` is what the endpoint mapper names. `session` returns the SessionKey of an AR that
    /// waits for ApplicationReady or has received it.
    pub(super) fn handle(
        &mut self,
        from: SocketAddrV4,
        header: &Header,
        body: &[u8],
        endpoint: &Endpoint<'_>,
        session: impl Fn(Uuid) -> Option<u16>,
    ) -> RequestOutcome {
        match header.kind {
            Kind::Request if header.flags & flags::MAYBE == 0 => {}
            Kind::Ping => {
                self.to = Some(from);
                if self.answer.header().is_some_and(|last| last.is_same_call(header)) {
                    self.answer.repeat();
                } else {
                    let _ = self.answer.set(header.answer(Kind::NoCall), |_| Ok(0));
                }
                return RequestOutcome::Answered;
            }
            _ => return RequestOutcome::Foreign,
        }
        self.to = Some(from);
        if header.interface == ENDPOINT_MAPPER_INTERFACE {
            return self.look_up(header, body, endpoint);
        }
        if header.interface != CONTROLLER_INTERFACE {
            return self.reject(header, rpc_status::UNKNOWN_INTERFACE);
        }
        if Operation::from(header.operation) != Operation::Control {
            return self.reject(header, rpc_status::OPERATION_RANGE);
        }
        let answer = header.answer(Kind::Response);
        let (maximum, control) = match RequestArgs::parse(header, body) {
            Ok(args) => (args.maximum, Control::parse_request(args.blocks)),
            Err(violation) => (0, Err(violation)),
        };
        let (called, result) = match control.map(|control| (control, session(control.ar))) {
            Err(violation) => (RequestOutcome::Malformed, Err(violation)),
            Ok((_, None)) => (RequestOutcome::Answered, Err(Violation::ArUuidUnknown)),
            Ok((control, Some(session))) if control.session != session => {
                (RequestOutcome::Answered, Err(control.command.wrong_session()))
            }
            Ok((control, Some(_))) => match control.command {
                Command::ApplicationReady => (RequestOutcome::Ready(control.ar), Ok(control)),
                // The submodule's provider status says the rest.
                Command::ApplicationReadyPlug { .. } => (RequestOutcome::Answered, Ok(control)),
                _ => (RequestOutcome::Answered, Err(Violation::StateConflict)),
            },
        };
        let status =
            result.err().map_or_else(Default::default, |violation| violation.status(Service::Control));
        let set = self.answer.set(answer, |body| {
            ResponseArgs::emit(status, maximum, body, |writer| {
                if let Ok(control) = result {
                    control.emit_response(writer);
                }
            })
        });
        set.map_or(RequestOutcome::Malformed, |()| called)
    }

    /// Answers a call of the endpoint mapper: where the controller takes calls.
    fn look_up(&mut self, header: &Header, body: &[u8], endpoint: &Endpoint<'_>) -> RequestOutcome {
        match MapperCall::parse(header, body) {
            Ok(asked) => {
                let answer = header.answer(Kind::Response);
                let set = self.answer.set(answer, |body| asked.answer(endpoint, body));
                set.map_or(RequestOutcome::Malformed, |()| RequestOutcome::Answered)
            }
            Err(MapperError::Operation(_)) => self.reject(header, rpc_status::OPERATION_RANGE),
            Err(MapperError::Truncated(_)) => {
                self.answer_status(header.answer(Kind::Fault), rpc_status::PROTOCOL_ERROR);
                RequestOutcome::Malformed
            }
        }
    }

    fn reject(&mut self, header: &Header, status: u32) -> RequestOutcome {
        self.answer_status(header.answer(Kind::Reject), status);
        RequestOutcome::Answered
    }

    fn answer_status(&mut self, answer: Header, status: u32) {
        let write = |body: &mut [u8]| -> Result<usize, Overflow> {
            let mut writer = Writer::<BigEndian>::new(body);
            writer.u32(status);
            writer.finish()
        };
        let _ = self.answer.set(answer, write);
    }

    /// Writes the next datagram of the answer; returns its receiver and length.
    pub(super) fn poll_transmit(&mut self, datagram: &mut [u8]) -> Option<(SocketAddrV4, usize)> {
        let len = self.answer.poll(datagram)?;
        Some((self.to?, len))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::status::Status;
    use crate::{captured, samples};
    use core::net::Ipv4Addr;

    /// p-net's ephemeral port in the capture.
    const P_NET: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::new(172, 16, 2, 10), 49_153);
    const SESSION: u16 = 2;
    const ENDPOINT: Endpoint<'_> = Endpoint {
        interface: CONTROLLER_INTERFACE,
        object: Uuid([5; 16]),
        description: &samples::CONTROLLER,
        port: 34964,
        address: Ipv4Addr::LOCALHOST,
    };

    /// Returns p-net's ApplicationReady (test data of crate `pnio` 0.1.0), and its ARUUID.
    fn ready() -> (Vec<u8>, Uuid) {
        let datagram = captured::datagram(captured::APPREADY_REQ);
        let uuid = datagram[108..124].try_into().unwrap();
        (datagram, Uuid(uuid))
    }

    /// Returns a controller with this AR and session.
    fn of(uuid: Uuid, session: u16) -> impl Fn(Uuid) -> Option<u16> {
        move |ar| (ar == uuid).then_some(session)
    }

    fn answer(responder: &mut Responder) -> Option<(Header, Vec<u8>)> {
        let mut datagram = [0; 1500];
        let (to, len) = responder.poll_transmit(&mut datagram)?;
        assert_eq!(to, P_NET);
        let (header, body) = Header::parse(&datagram[..len]).unwrap();
        Some((header, body.to_vec()))
    }

    #[test]
    fn application_ready_is_answered_like_the_siemens_controller_as_often_as_it_comes() {
        let (datagram, uuid) = ready();
        let (header, body) = Header::parse(&datagram).unwrap();
        let theirs = captured::datagram(captured::APPREADY_RES);
        let mut responder = Responder::new();
        for _ in 0..2 {
            assert_eq!(
                responder.handle(P_NET, &header, body, &ENDPOINT, of(uuid, SESSION)),
                RequestOutcome::Ready(uuid)
            );
            let (ours, body) = answer(&mut responder).unwrap();
            assert_eq!((ours.kind, ours.is_same_call(&header)), (Kind::Response, true));
            // The NDR numbers differ in byte order and in what the Siemens controller calls the maximum.
            assert_eq!(body[20..], theirs[100..]);
        }
    }

    #[test]
    fn another_ar_and_another_session_are_refused_with_their_status() {
        let (datagram, uuid) = ready();
        let (header, body) = Header::parse(&datagram).unwrap();
        let mut responder = Responder::new();
        for (ar, status) in [
            ((uuid, 3), Status::new(0xDD, 0x81, 0x16, 0x06)),
            ((Uuid([9; 16]), SESSION), Status::new(0xDD, 0x81, 0x40, 0x05)),
        ] {
            assert_eq!(
                responder.handle(P_NET, &header, body, &ENDPOINT, of(ar.0, ar.1)),
                RequestOutcome::Answered
            );
            let (header, body) = answer(&mut responder).unwrap();
            assert_eq!(ResponseArgs::parse(&header, &body).unwrap().status, status);
        }
    }

    #[test]
    fn a_ping_gets_the_answer_again_or_no_call() {
        let (datagram, uuid) = ready();
        let (header, body) = Header::parse(&datagram).unwrap();
        let ping = Header { kind: Kind::Ping, ..header };
        let mut responder = Responder::new();
        responder.handle(P_NET, &ping, &[], &ENDPOINT, |_| None);
        assert_eq!(answer(&mut responder).unwrap().0.kind, Kind::NoCall);
        responder.handle(P_NET, &header, body, &ENDPOINT, of(uuid, SESSION));
        answer(&mut responder);
        responder.handle(P_NET, &ping, &[], &ENDPOINT, |_| None);
        assert_eq!(answer(&mut responder).unwrap().0.kind, Kind::Response);
    }

    #[test]
    fn other_interfaces_and_operations_are_rejected() {
        let (datagram, uuid) = ready();
        let (header, body) = Header::parse(&datagram).unwrap();
        let mut responder = Responder::new();
        for header in [Header { interface: Uuid::NIL, ..header }, Header { operation: 0, ..header }] {
            responder.handle(P_NET, &header, body, &ENDPOINT, of(uuid, SESSION));
            assert_eq!(answer(&mut responder).unwrap().0.kind, Kind::Reject);
        }
    }
}
