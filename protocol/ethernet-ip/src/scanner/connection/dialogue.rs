//! Messages of a scanner over TCP, and parsing of their answers.

use crate::Writer;
use crate::cip::{ElectronicKey, Path, Reply, Request, Revision, class, service};
use crate::connection::{CloseRequest, OpenRequest, Triad};
use crate::cpf::{Item, Packet, write_unconnected};
use crate::description::Identity;
use crate::encapsulation::{Command, Header, PROTOCOL_VERSION};
use crate::{Reader, cip};
use core::net::SocketAddrV4;
use machine::Duration;
use machine::wire::{Overflow, Truncated};

/// A message to the adapter.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum ScannerMessage {
    /// RegisterSession.
    Register,
    /// Get_Attributes_All of the adapter's Identity, along the route to it.
    Identify,
    /// Forward_Open.
    Open,
    /// Get_Connection_Owner of the outputs that another scanner owns.
    AskOwner,
    /// Search_Connection_Data of that owner's connection.
    AskOwnerData,
    /// Forward_Close of the connection that was opened last.
    Close,
    /// UnRegisterSession.
    Unregister,
    /// Explicit request of the owner.
    Explicit,
    /// NOP: shows the adapter that the session is still in use.
    Nop,
}

/// Writes a message that has no CIP request in it.
pub(super) fn emit_plain(buf: &mut [u8], message: ScannerMessage, session: u32) -> Result<usize, Overflow> {
    let command = match message {
        ScannerMessage::Register => Command::RegisterSession,
        ScannerMessage::Unregister => Command::UnRegisterSession,
        _ => Command::Nop,
    };
    Header::request(command, session).emit(buf, |writer| {
        if message == ScannerMessage::Register {
            writer.u16(PROTOCOL_VERSION);
            writer.u16(0);
        }
    })
}

/// Time tick of an Unconnected_Send: 2^5 ms, or 32 ms (volume 1, 3-5.5.1.3).
const UNCONNECTED_TICK: u8 = 5;

/// Writes the path of instance 1 of a class.
fn instance_1(class: u32) -> impl FnOnce(&mut Writer<'_>) {
    move |writer| {
        cip::write_logical(writer, cip::Logical::Class, class);
        cip::write_logical(writer, cip::Logical::Instance, 1);
    }
}

fn emit_request(
    buf: &mut [u8],
    numbers: (u32, u32),
    service: u8,
    class: u32,
    data: impl FnOnce(&mut Writer<'_>),
) -> Result<usize, Overflow> {
    emit_unconnected(buf, numbers, |writer| Request::emit(writer, service, instance_1(class), data))
}

fn emit_unconnected(
    buf: &mut [u8],
    (session, number): (u32, u32),
    request: impl FnOnce(&mut Writer<'_>),
) -> Result<usize, Overflow> {
    let mut header = Header::request(Command::SendRRData, session);
    let [a, b, c, d] = number.to_le_bytes();
    header.context = [a, b, c, d, 0, 0, 0, 0];
    header.emit(buf, |writer| write_unconnected(writer, request))
}

/// Writes an explicit request; along a route, if there is one, so that the adapter answers it and not the bridge. Routers wait
/// for the answer as long as the scanner does, but at most 8 s.
pub(super) fn emit_explicit(
    buf: &mut [u8],
    numbers: (u32, u32),
    (route, timeout): (&[u8], Duration),
    request: impl FnOnce(&mut Writer<'_>),
) -> Result<usize, Overflow> {
    if route.is_empty() {
        return emit_unconnected(buf, numbers, request);
    }
    let ticks = (timeout.as_millis() >> UNCONNECTED_TICK).clamp(1, u8::MAX.into()) as u8;
    emit_request(buf, numbers, service::UNCONNECTED_SEND, class::CONNECTION_MANAGER, |writer| {
        writer.bytes(&[UNCONNECTED_TICK, ticks]);
        let size_at = writer.len();
        writer.u16(0);
        request(writer);
        let size = (writer.len() - size_at - 2) as u16;
        writer.patch_u16(size_at, size);
        if size % 2 == 1 {
            writer.u8(0);
        }
        writer.bytes(&[u8::try_from(route.len() / 2).unwrap_or(u8::MAX), 0]);
        writer.bytes(route);
    })
}

/// Writes the question for the adapter's identity.
pub(super) fn emit_identify(
    buf: &mut [u8],
    numbers: (u32, u32),
    route: (&[u8], Duration),
) -> Result<usize, Overflow> {
    emit_explicit(buf, numbers, route, |writer| {
        Request::emit(writer, service::GET_ATTRIBUTES_ALL, instance_1(class::IDENTITY), |_| {});
    })
}

pub(super) fn emit_open(
    buf: &mut [u8],
    numbers: (u32, u32),
    request: &OpenRequest<'_>,
    large: bool,
) -> Result<usize, Overflow> {
    let service = if large { service::LARGE_FORWARD_OPEN } else { service::FORWARD_OPEN };
    emit_request(buf, numbers, service, class::CONNECTION_MANAGER, |writer| request.emit(writer, large))
}

pub(super) fn emit_close(
    buf: &mut [u8],
    numbers: (u32, u32),
    request: &CloseRequest<'_>,
) -> Result<usize, Overflow> {
    emit_request(buf, numbers, service::FORWARD_CLOSE, class::CONNECTION_MANAGER, |writer| {
        request.emit(writer)
    })
}

/// Writes the question for the owner of the outputs of a connection path.
pub(super) fn emit_ask_owner(
    buf: &mut [u8],
    numbers: (u32, u32),
    path: &Path<'_>,
) -> Result<usize, Overflow> {
    emit_request(buf, numbers, service::GET_CONNECTION_OWNER, class::CONNECTION_MANAGER, |writer| {
        writer.bytes(&[0, u8::try_from(path.0.len() / 2).unwrap_or(u8::MAX)]);
        writer.bytes(path.0);
    })
}

/// Writes the question for the data of another scanner's connection.
pub(super) fn emit_ask_data(buf: &mut [u8], numbers: (u32, u32), triad: Triad) -> Result<usize, Overflow> {
    emit_request(buf, numbers, service::SEARCH_CONNECTION_DATA, class::CONNECTION_MANAGER, |writer| {
        triad.emit(writer);
    })
}

/// Returns the number of the request that a message answers.
pub(super) const fn number_of(header: &Header) -> u32 {
    let [a, b, c, d, ..] = header.context;
    u32::from_le_bytes([a, b, c, d])
}

/// Destinations of the data that the adapter's reply contains.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub(super) struct Sockets {
    /// O→T.
    pub(super) o_t: Option<SocketAddrV4>,
    /// T→O; the reply must contain it for a multicast.
    pub(super) t_o: Option<SocketAddrV4>,
}

/// Reads the CIP reply in the data of a SendRRData, and the address to which the adapter wants its data.
pub(super) fn read_reply(data: &[u8]) -> Option<(Reply<'_>, Sockets)> {
    let packet = Packet::parse_unconnected(data).ok()?;
    let Some(Item::UnconnectedData(reply)) = packet.data else { return None };
    let sockets = Sockets { o_t: packet.socket_o_t, t_o: packet.socket_t_o };
    Some((Reply::parse(reply).ok()?, sockets))
}

/// Reads the identity in the reply to Get_Attributes_All.
pub(super) fn read_identity(data: &[u8]) -> Result<Identity, Truncated> {
    let mut reader = Reader::new(data);
    let (vendor, device_type, product_code) = (reader.u16()?, reader.u16()?, reader.u16()?);
    let revision = Revision { major: reader.u8()?, minor: reader.u8()? };
    reader.skip(2)?;
    let serial_number = reader.u32()?;
    let key = ElectronicKey { vendor, device_type, product_code, revision, compatible: false };
    Ok(Identity { key, serial_number })
}
