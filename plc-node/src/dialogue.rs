//! A session with an EtherNet/IP device, for questions outside of any connection.

#![expect(
    clippy::disallowed_types,
    reason = "a tool asks a device by a socket of its own; no node runs in its process"
)]

use std::io::{ErrorKind, Read as _, Result, Write as _};
use std::net::{SocketAddrV4, TcpStream};
use std::time::Duration;

use ethernet_ip::cip::{General, Logical, Reply, Request, service, write_logical};
use ethernet_ip::cpf::{Item, Packet, write_unconnected};
use ethernet_ip::encapsulation::{
    Command, HEADER_LEN, Header, MAX_MESSAGE_LEN, Message, PROTOCOL_VERSION, Reassembly, Status,
};
use machine::wire::{LittleEndian, Overflow};

type Writer<'a> = machine::wire::Writer<'a, LittleEndian>;

/// Longest wait for a connection and for each answer.
const PATIENCE: Duration = Duration::from_secs(2);

/// Messages of a device that are passed over until its answer comes.
const MOST_OTHERS: u32 = 16;

/// Bytes of the longest request after its header.
const LONGEST_REQUEST: usize = 256;

/// A session with a device.
#[derive(Debug)]
pub struct Dialogue {
    stream: TcpStream,
    session: u32,
    number: u64,
    received: Reassembly,
}

/// Answer of a device to a request.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct DeviceReply {
    /// Result.
    pub status: General,
    /// Additional status word, where there is one.
    pub additional: Option<u16>,
    /// Data of the answer.
    pub data: Vec<u8>,
}

/// Answer of a device to the question for an attribute.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum AttributeAnswer {
    /// The attribute's bytes.
    Bytes(Vec<u8>),
    /// The device has no such object.
    NoObject,
    /// It does not say, with this general status.
    Refused(u8),
}

/// Returns the error of an answer that cannot be read.
#[must_use]
pub fn malformed(what: &str) -> std::io::Error {
    std::io::Error::new(ErrorKind::InvalidData, what.to_owned())
}

impl Dialogue {
    /// Connects to a device, and registers a session.
    ///
    /// # Errors
    ///
    /// Nothing answers, or the device refuses.
    pub fn open(device: SocketAddrV4) -> Result<Self> {
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
    ///
    /// # Errors
    ///
    /// The connection ends, or the answer is malformed.
    pub fn attribute(&mut self, class: u32, instance: u32, attribute: u32) -> Result<AttributeAnswer> {
        let path = [class, instance, attribute];
        self.request(service::GET_ATTRIBUTE_SINGLE, &path, &[]).map(AttributeAnswer::from)
    }

    /// Asks an object for a service. `path` is class, instance and, where the service is of an attribute, that.
    ///
    /// # Errors
    ///
    /// The connection ends, or the answer is malformed.
    pub fn request(&mut self, service: u8, path: &[u32], data: &[u8]) -> Result<DeviceReply> {
        let emit = |writer: &mut Writer<'_>| emit_request(writer, service, path, data);
        let (header, answer) = self.ask(Command::SendRRData, emit)?;
        if header.status != Status::Success {
            return Err(malformed(&format!("it refuses a message: {}", header.status.text())));
        }
        reply_to(service, &answer)
    }

    /// Sends a message and returns the answer with the same number; others are passed over.
    fn ask(&mut self, command: Command, body: impl FnOnce(&mut Writer<'_>)) -> Result<(Header, Vec<u8>)> {
        self.number += 1;
        let mut header = Header::request(command, self.session);
        header.context = self.number.to_le_bytes();
        let mut buf = [0; HEADER_LEN + LONGEST_REQUEST];
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

/// Writes a request to an object.
fn emit_request(writer: &mut Writer<'_>, service: u8, path: &[u32], data: &[u8]) {
    write_unconnected(writer, |writer| {
        let segments = |writer: &mut Writer<'_>| {
            let kinds = [Logical::Class, Logical::Instance, Logical::Attribute];
            kinds.into_iter().zip(path).for_each(|(kind, number)| write_logical(writer, kind, *number));
        };
        Request::emit(writer, service, segments, |writer| writer.bytes(data));
    });
}

/// Returns the reply to a service in an answer.
fn reply_to(service: u8, answer: &[u8]) -> Result<DeviceReply> {
    let packet = Packet::parse_unconnected(answer);
    let Ok(Some(Item::UnconnectedData(message))) = packet.map(|packet| packet.data) else {
        return Err(malformed("its answer has no message"));
    };
    let reply = Reply::parse(message).map_err(|_| malformed("its answer is cut off"))?;
    if reply.service != service {
        return Err(malformed("its answer is to another service"));
    }
    let additional = reply.additional_status(0);
    Ok(DeviceReply { status: reply.general, additional, data: reply.data.to_vec() })
}

impl From<DeviceReply> for AttributeAnswer {
    fn from(reply: DeviceReply) -> Self {
        match reply.status {
            General::Success => Self::Bytes(reply.data),
            General::PathDestinationUnknown | General::ObjectDoesNotExist => Self::NoObject,
            status => Self::Refused(status.into()),
        }
    }
}

/// Parses the answer to the request for an attribute.
///
/// # Errors
///
/// It is cut off, or the answer to something else.
pub fn parse(data: &[u8]) -> Result<AttributeAnswer> {
    reply_to(service::GET_ATTRIBUTE_SINGLE, data).map(AttributeAnswer::from)
}
