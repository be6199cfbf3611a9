//! A session with an EtherNet/IP device, for questions outside of any connection.

use std::io::{ErrorKind, Read as _, Result, Write as _};
use std::net::{SocketAddrV4, TcpStream};
use std::time::Duration;

use ethernet_ip::cip::{General, Logical, Reply, Request, service, write_logical};
use ethernet_ip::cpf::{Item, Packet, write_unconnected};
use ethernet_ip::encapsulation::{
    Command, HEADER_LEN, Header, MAX_MESSAGE_LEN, Message, PROTOCOL_VERSION, Reassembly, Status,
};
use machine::wire::{LittleEndian, Overflow};
use setup::EthernetIp;

use crate::verbs::doctor::finding::{Finding, Verdict};

type Writer<'a> = machine::wire::Writer<'a, LittleEndian>;

/// Longest wait for a connection and for each answer.
const PATIENCE: Duration = Duration::from_secs(2);

/// Messages of a device that are passed over until its answer comes.
const MOST_OTHERS: u32 = 16;

/// Why a device is not asked.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Unreachable {
    /// Nothing has its address.
    NoDevice,
    /// It sits beyond a bridge.
    BeyondBridge,
}

impl Unreachable {
    /// Returns the finding of a step that asks the device.
    pub(super) fn finding(self, what: &'static str) -> Finding {
        match self {
            Self::NoDevice => Finding::not_seen(what, "no such device", "see the step `address`"),
            Self::BeyondBridge => {
                let found = "the robot sits beyond a bridge (bus.ethernet_ip.adapter.route), where this look does not read";
                Finding::limited(what, found, "the step `connection` decides")
            }
        }
    }
}

/// Returns why the robot is not asked, after what was seen of it.
pub(super) fn unreachable(ethernet_ip: &EthernetIp, seen: &[Finding]) -> Option<Unreachable> {
    if !seen.iter().any(|it| it.what == "address" && it.verdict == Verdict::Good) {
        return Some(Unreachable::NoDevice);
    }
    let is_beyond = ethernet_ip.adapter.as_ref().is_some_and(|adapter| !adapter.route.is_empty());
    is_beyond.then_some(Unreachable::BeyondBridge)
}

/// A session with a device.
#[derive(Debug)]
pub(super) struct Dialogue {
    stream: TcpStream,
    session: u32,
    number: u64,
    received: Reassembly,
}

/// Answer of a device to the question for an attribute.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(super) enum AttributeAnswer {
    /// The attribute's bytes.
    Bytes(Vec<u8>),
    /// The device has no such object.
    NoObject,
    /// It does not say, with this general status.
    Refused(u8),
}

pub(super) fn malformed(what: &str) -> std::io::Error {
    std::io::Error::new(ErrorKind::InvalidData, what.to_owned())
}

impl Dialogue {
    pub(super) fn open(device: SocketAddrV4) -> Result<Self> {
        let stream = TcpStream::connect_timeout(&device.into(), PATIENCE)?;
        stream.set_read_timeout(Some(PATIENCE))?;
        stream.set_write_timeout(Some(PATIENCE))?;
        let mut dialogue = Self { stream, session: 0, number: 0, received: Reassembly::default() };
        let (header, _) = dialogue.ask(Command::RegisterSession, |writer| {
            writer.u16(PROTOCOL_VERSION);
            writer.u16(0);
        })?;
        if header.status != Status::Success {
            return Err(malformed(&format!("it refuses a session: {}", header.status.text())));
        }
        dialogue.session = header.session;
        Ok(dialogue)
    }

    /// Reads an attribute of an object; instance 0 is the class itself.
    pub(super) fn attribute(&mut self, class: u32, instance: u32, attribute: u32) -> Result<AttributeAnswer> {
        let emit = |writer: &mut Writer<'_>| emit_read(writer, [class, instance, attribute]);
        let (header, data) = self.ask(Command::SendRRData, emit)?;
        if header.status != Status::Success {
            return Err(malformed(&format!("it refuses a message: {}", header.status.text())));
        }
        parse(&data)
    }

    /// Sends a message and returns the answer with the same number; others are passed over.
    fn ask(&mut self, command: Command, body: impl FnOnce(&mut Writer<'_>)) -> Result<(Header, Vec<u8>)> {
        self.number += 1;
        let mut header = Header::request(command, self.session);
        header.context = self.number.to_le_bytes();
        let mut buf = [0; HEADER_LEN + 64];
        let len =
            header.emit(&mut buf, body).map_err(|Overflow { .. }| malformed("a request is too long"))?;
        self.stream.write_all(buf.get(..len).unwrap_or_default())?;
        let mut others = 0;
        let mut bytes = [0; MAX_MESSAGE_LEN];
        while others < MOST_OTHERS {
            match self.received.next_message() {
                Some(Message::Whole(found, data))
                    if (found.command, found.context) == (command, header.context) =>
                {
                    return Ok((found, data.to_vec()));
                }
                Some(_) => others += 1,
                None => {
                    let count = self.stream.read(&mut bytes)?;
                    if count == 0 {
                        return Err(ErrorKind::UnexpectedEof.into());
                    }
                    let new = bytes.get(..count).unwrap_or_default();
                    self.received.push(new).map_err(|_| malformed("its answer is too long"))?;
                }
            }
        }
        Err(malformed("it answers other questions"))
    }
}

/// Writes the request for an attribute.
fn emit_read(writer: &mut Writer<'_>, [class, instance, attribute]: [u32; 3]) {
    write_unconnected(writer, |writer| {
        let path = |writer: &mut Writer<'_>| {
            write_logical(writer, Logical::Class, class);
            write_logical(writer, Logical::Instance, instance);
            write_logical(writer, Logical::Attribute, attribute);
        };
        Request::emit(writer, service::GET_ATTRIBUTE_SINGLE, path, |_| {});
    });
}

/// Parses the answer to the request for an attribute.
pub(super) fn parse(data: &[u8]) -> Result<AttributeAnswer> {
    let packet = Packet::parse_unconnected(data);
    let Ok(Some(Item::UnconnectedData(message))) = packet.map(|packet| packet.data) else {
        return Err(malformed("its answer has no message"));
    };
    let reply = Reply::parse(message).map_err(|_| malformed("its answer is cut off"))?;
    if reply.service != service::GET_ATTRIBUTE_SINGLE {
        return Err(malformed("its answer is to another service"));
    }
    Ok(match reply.general {
        General::Success => AttributeAnswer::Bytes(reply.data.to_vec()),
        General::PathDestinationUnknown | General::ObjectDoesNotExist => AttributeAnswer::NoObject,
        status => AttributeAnswer::Refused(status.into()),
    })
}
