//! Dispatches the datagrams of RPC by their kind: hands whole requests to the server, and makes the replies that have no
//! blocks.

use core::net::SocketAddrV4;

use super::server::is_served;
use super::{Core, Device};
use crate::RPC_PORT;
use crate::rpc::{Header, Kind, Received, flags, rpc_status};
use machine::{Instant, Port, Transmit};

/// A PDU of RPC without blocks: a Reject, Fault, NoCall or FragmentAck.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reply {
    header: Header,
    status: Option<u32>,
    to: SocketAddrV4,
}

impl Device {
    /// Handles a datagram of RPC.
    pub(super) fn handle_rpc(&mut self, now: Instant, from: SocketAddrV4, datagram: &[u8]) {
        let core = &mut self.core;
        core.acyclic = true;
        let Ok((header, body)) = Header::parse(datagram) else {
            core.counters.malformed += 1;
            return;
        };
        match header.kind {
            Kind::Request if !is_served(header.interface) => {
                core.counters.foreign += 1;
                core.reply(&header, Kind::Reject, Some(rpc_status::UNKNOWN_INTERFACE), from);
            }
            Kind::Request => match self.requests.take(*from.ip(), core.controller(), &header, body) {
                Received::Whole(body) => core.handle_request(now, from, &header, body),
                Received::Part if header.flags & flags::NO_FRAGMENT_ACK == 0 => {
                    core.reply(&header, Kind::FragmentAck, None, from);
                }
                Received::Part => {}
                Received::Refused => core.counters.malformed += 1,
                // Without an answer the controller would repeat the call until it gives up.
                Received::TooLong => {
                    core.counters.malformed += 1;
                    core.reply(&header, Kind::Reject, Some(rpc_status::UNSPECIFIED_REJECT), from);
                }
            },
            Kind::Ping => {
                if !core.answers.look_up_ping(&header, from) {
                    core.reply(&header, Kind::NoCall, None, from);
                }
            }
            Kind::Response if header.is_fragment() => core.counters.malformed += 1,
            Kind::Response => core.handle_response(now, from, &header, body),
            // The controller cannot take the call yet. The call is repeated later.
            Kind::Working | Kind::NoCall | Kind::Reject | Kind::Fault | Kind::Ack | Kind::FragmentAck => {}
            Kind::Cancel | Kind::CancelAck | Kind::Unknown(_) => core.counters.foreign += 1,
        }
    }
}

impl Core {
    /// Replies by a PDU without blocks.
    pub(super) fn reply(&mut self, request: &Header, kind: Kind, status: Option<u32>, to: SocketAddrV4) {
        let header = match kind {
            Kind::FragmentAck => Header { fragment: request.fragment, ..request.answer(kind) },
            _ => request.answer(kind),
        };
        self.reply = Some(Reply { header, status, to });
    }

    /// Writes the reply that waits, if one does.
    pub(super) fn poll_reply(&mut self, buf: &mut [u8]) -> Option<Transmit> {
        let Reply { header, status, to } = self.reply.take()?;
        let body = status.map(u32::to_be_bytes);
        let len = header.emit(body.as_ref().map_or(&[], |body| &body[..]), buf).ok()?;
        Some(Transmit { port: Port::Udp(RPC_PORT), to: Some(to), len })
    }
}
