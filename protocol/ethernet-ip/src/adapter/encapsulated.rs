//! Answers to encapsulation messages (volume 2, 2-4).

use alloc::boxed::Box;
use core::net::SocketAddrV4;

use super::session::Session;
use super::state::{Context, State};
use crate::cpf::{Item, Packet, kind, write_address, write_item};
use crate::encapsulation::{Command, HEADER_LEN, Header, Message, PROTOCOL_VERSION, Status};
use crate::objects::write_identity_item;
use crate::{Reader, Writer};
use machine::{Instant, StreamId};

/// ListServices: CIP encapsulation over TCP, and class 0 and 1 over UDP (volume 2, 2-4.6).
const CAPABILITY: u16 = 1 << 5 | 1 << 8;

/// The one service's name, 16 bytes.
const SERVICE_NAME: &[u8; 16] = b"Communications\0\0";

/// Result of handling a message.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Answer {
    /// A reply of this many bytes.
    Reply(usize),
    /// No reply.
    None,
    /// No reply; the TCP connection is closed.
    Close,
}

fn reply(header: &Header, status: Status, buf: &mut [u8], body: impl FnOnce(&mut Writer<'_>)) -> Answer {
    header.reply(status).emit(buf, body).map_or(Answer::None, Answer::Reply)
}

/// Answers a message that came over TCP.
pub(super) fn answer(
    state: &mut State,
    now: Instant,
    session: &mut Session,
    next_handle: &mut u32,
    message: Message<'_>,
    buf: &mut [u8],
) -> Answer {
    let (header, data) = match message {
        Message::Whole(header, data) => (header, Some(data)),
        Message::TooLong(header) => (header, None),
    };
    // The length of a NOP does not matter (volume 2, 2-4.2).
    if header.command == Command::Nop {
        return Answer::None;
    }
    if !is_request(&header) {
        state.counters.malformed += 1;
        return Answer::None;
    }
    let is_own = header.session == session.handle;
    match header.command {
        Command::UnRegisterSession => return if is_own { Answer::Close } else { Answer::None },
        Command::SendRRData | Command::SendUnitData if session.handle == 0 || !is_own => {
            return reply(&header, Status::InvalidSession, buf, |_| {});
        }
        _ => {}
    }
    let Some(data) = data else {
        state.counters.malformed += 1;
        return reply(&header, Status::InvalidLength, buf, |_| {});
    };
    match header.command {
        Command::RegisterSession => register(session, next_handle, &header, data, buf),
        Command::SendRRData => send_rr_data(state, now, session, &header, data, buf),
        Command::SendUnitData => send_unit_data(state, now, session.stream, session.peer, &header, data, buf),
        _ => list(state, &header, buf),
    }
}

/// Returns whether a header is that of a request. Its status and options are 0; other messages are ignored without a
/// reply (volume 2, 2-3.5 and 2-3.7), so that no two devices answer each other's refusals for ever.
pub(super) fn is_request(header: &Header) -> bool {
    header.status == Status::Success && header.options == 0
}

/// Returns whether a datagram is one whole request. The commands that are answered over UDP have no data in a request
/// (volume 2, 2-4.1): a datagram with data is the answer of another device, sent from the port of requests.
pub(super) fn is_request_datagram(header: &Header, len: usize) -> bool {
    let may_have_data =
        !matches!(header.command, Command::ListServices | Command::ListIdentity | Command::ListInterfaces);
    is_request(header)
        && len == HEADER_LEN + usize::from(header.length)
        && (header.length == 0 || may_have_data)
}

/// Answers the message in a UDP datagram. Returns the reply's length.
pub(super) fn answer_datagram(state: &mut State, datagram: &[u8], buf: &mut [u8]) -> Option<usize> {
    let whole = Header::parse(datagram).ok().filter(|header| is_request_datagram(header, datagram.len()));
    let Some(header) = whole else {
        state.counters.malformed += 1;
        return None;
    };
    match list(state, &header, buf) {
        Answer::Reply(len) => Some(len),
        Answer::None | Answer::Close => None,
    }
}

/// Writes the answer to a ListIdentity and returns its length.
pub(super) fn list_identity(state: &State, header: &Header, buf: &mut [u8]) -> Option<usize> {
    let body = |writer: &mut Writer<'_>| {
        writer.u16(1);
        write_identity_item(&state.device, writer);
    };
    header.reply(Status::Success).emit(buf, body).ok()
}

/// Answers the commands that need no session.
fn list(state: &State, header: &Header, buf: &mut [u8]) -> Answer {
    match header.command {
        Command::Nop => Answer::None,
        Command::ListServices => reply(header, Status::Success, buf, |writer| {
            writer.u16(1);
            write_item(writer, kind::LIST_SERVICES, |writer| {
                writer.u16(PROTOCOL_VERSION);
                writer.u16(CAPABILITY);
                writer.bytes(SERVICE_NAME);
            });
        }),
        Command::ListIdentity => list_identity(state, header, buf).map_or(Answer::None, Answer::Reply),
        // There are no interfaces but CIP's own.
        Command::ListInterfaces => reply(header, Status::Success, buf, |writer| writer.u16(0)),
        _ => reply(header, Status::InvalidCommand, buf, |_| {}),
    }
}

fn register(
    session: &mut Session,
    next_handle: &mut u32,
    header: &Header,
    data: &[u8],
    buf: &mut [u8],
) -> Answer {
    let mut reader = Reader::new(data);
    let (Ok(version), Ok(options), true) = (reader.u16(), reader.u16(), reader.is_empty()) else {
        return reply(header, Status::InvalidLength, buf, |_| {});
    };
    let body = |writer: &mut Writer<'_>| {
        writer.u16(PROTOCOL_VERSION);
        writer.u16(0);
    };
    if version != PROTOCOL_VERSION || options != 0 {
        return reply(header, Status::UnsupportedProtocol, buf, body);
    }
    if session.handle != 0 {
        return reply(header, Status::InvalidCommand, buf, body);
    }
    *next_handle = next_handle.wrapping_add(1).max(1);
    session.handle = *next_handle;
    reply(&Header { session: session.handle, ..*header }, Status::Success, buf, body)
}

/// Reads what SendRRData and SendUnitData have before their items: interface handle 0, for CIP, and a timeout.
fn packet(data: &[u8]) -> Option<Packet<'_>> {
    let mut reader = Reader::new(data);
    let interface = reader.u32().ok()?;
    reader.u16().ok()?;
    Packet::parse(reader).ok().filter(|_| interface == 0)
}

fn write_head(writer: &mut Writer<'_>, items: u16) {
    writer.u32(0);
    writer.u16(0);
    writer.u16(items);
}

fn send_rr_data(
    state: &mut State,
    now: Instant,
    session: &Session,
    header: &Header,
    data: &[u8],
    buf: &mut [u8],
) -> Answer {
    let packet = packet(data);
    let Some(Packet {
        address: Some(Item::NullAddress),
        data: Some(Item::UnconnectedData(request)),
        socket_t_o,
        ..
    }) = packet
    else {
        state.counters.malformed += 1;
        return reply(header, Status::IncorrectData, buf, |_| {});
    };
    if request.is_empty() {
        state.counters.malformed += 1;
        return reply(header, Status::IncorrectData, buf, |_| {});
    }
    let mut context = Context {
        now,
        peer: session.peer,
        stream: session.stream,
        socket_t_o,
        reply_socket_t_o: None,
        depth: 0,
    };
    state.with_scratch(|state, scratch| {
        let len = state.route(&mut context, request, scratch);
        let cip = scratch.get(..len).unwrap_or_default();
        reply(header, Status::Success, buf, |writer| {
            write_head(writer, 2 + u16::from(context.reply_socket_t_o.is_some()));
            write_item(writer, kind::NULL_ADDRESS, |_| {});
            write_item(writer, kind::UNCONNECTED_DATA, |writer| writer.bytes(cip));
            if let Some(address) = context.reply_socket_t_o {
                write_item(writer, kind::SOCKET_ADDRESS_T_O, |writer| write_address(writer, address));
            }
        })
    })
}

fn send_unit_data(
    state: &mut State,
    now: Instant,
    stream: StreamId,
    peer: SocketAddrV4,
    header: &Header,
    data: &[u8],
    buf: &mut [u8],
) -> Answer {
    let Some(Packet {
        address: Some(Item::ConnectedAddress(o_t_id)),
        data: Some(Item::ConnectedData(message)),
        ..
    }) = packet(data)
    else {
        state.counters.malformed += 1;
        return reply(header, Status::IncorrectData, buf, |_| {});
    };
    let mut reader = Reader::new(message);
    let (Ok(count), request) = (reader.u16(), reader.rest()) else {
        state.counters.malformed += 1;
        return Answer::None;
    };
    let Some(connection) = state.explicit.receive(now, stream, o_t_id) else {
        state.counters.foreign += 1;
        return Answer::None;
    };
    if message.len() > usize::from(connection.o_t_size) || request.is_empty() {
        state.counters.malformed += 1;
        return Answer::None;
    }
    let (t_o_id, room) = (connection.t_o_id, usize::from(connection.t_o_size.saturating_sub(2)));
    let write = |buf: &mut [u8], cip: &[u8]| {
        reply(header, Status::Success, buf, |writer| {
            write_head(writer, 2);
            write_item(writer, kind::CONNECTED_ADDRESS, |writer| writer.u32(t_o_id));
            write_item(writer, kind::CONNECTED_DATA, |writer| {
                writer.u16(count);
                writer.bytes(cip);
            });
        })
    };
    if let Some(cip) = state.explicit.stored_reply(o_t_id, count) {
        return write(buf, cip);
    }
    let mut context = Context { now, peer, stream, socket_t_o: None, reply_socket_t_o: None, depth: 0 };
    state.with_scratch(|state, scratch| {
        let room = room.min(scratch.len());
        let len = state.route(&mut context, request, scratch.get_mut(..room).unwrap_or_default());
        let cip = scratch.get(..len).unwrap_or_default();
        if cip.is_empty() {
            // Not even the refusal fits into the connection.
            return Answer::None;
        }
        state.explicit.store_reply(o_t_id, count, cip);
        write(buf, cip)
    })
}

impl State {
    /// Lends the buffer for CIP replies to `work`.
    fn with_scratch<R>(&mut self, work: impl FnOnce(&mut Self, &mut [u8]) -> R) -> R {
        let mut scratch = core::mem::replace(&mut self.scratch, Box::new([]));
        let result = work(self, &mut scratch);
        self.scratch = scratch;
        result
    }
}
