//! An adapter driven by hand: clients over TCP and UDP, good ones and bad ones, and no second machine.
//!
//! In one file, because every test of the adapter uses all of it.

use std::collections::BTreeMap;
use std::net::{Ipv4Addr, SocketAddrV4};

use crate::samples::CONSUMED;
use ethernet_ip::cip::{General, Path, Reply};
use ethernet_ip::connection::{
    CloseRequest, ConnectionType, OpenReply, OpenRequest, Parameters, Priority, Transport, Triad,
};
use ethernet_ip::cpf::{self, Item, Packet, kind, write_item};
use ethernet_ip::encapsulation::{Command, HEADER_LEN, Header, Status};
use ethernet_ip::{Adapter, AdapterConfig, ENCAPSULATION_PORT, IO_PORT, class1};
use machine::wire::{FRAME_CAPACITY, LittleEndian, Reader, Writer};
use machine::{Duration, Instant, Machine, Port, Source, StreamChange, StreamId, StreamRequest};
use machine::{LinkEvent, OwnerReport};

use crate::cell::{PLC, adapter_config};

/// A path to the robot's assemblies: configuration, command, feedback.
pub(crate) const OWNER_PATH: &[u8] = &[0x20, 4, 0x24, 151, 0x2C, 150, 0x2C, 100];
/// The same for input-only.
pub(crate) const INPUT_ONLY_PATH: &[u8] = &[0x20, 4, 0x24, 151, 0x2C, 152, 0x2C, 100];
/// The same for listen-only.
pub(crate) const LISTEN_ONLY_PATH: &[u8] = &[0x20, 4, 0x24, 151, 0x2C, 153, 0x2C, 100];
/// The message router, for class 3.
pub(crate) const ROUTER_PATH: &[u8] = &[0x20, 2, 0x24, 1];

pub(crate) const fn peer(ip: Ipv4Addr, port: u16) -> SocketAddrV4 {
    SocketAddrV4::new(ip, port)
}

/// Returns parameters as scanners request them: fixed, scheduled.
pub(crate) const fn parameters(kind: ConnectionType, size: u16) -> Parameters {
    Parameters { redundant_owner: false, kind, priority: Priority::Scheduled, variable: false, size }
}

/// Returns a Forward_Open that owns the outputs at 1 ms; `serial` distinguishes it from others.
pub(crate) fn owner(serial: u16) -> OpenRequest<'static> {
    let triad = Triad { connection_serial: serial, vendor: 1, originator_serial: 0x0BAD_CAFE };
    OpenRequest {
        o_t_id: 0,
        t_o_id: 0x4000_0000 | u32::from(serial),
        triad,
        multiplier: 2,
        o_t_rpi_us: 1_000,
        o_t: parameters(ConnectionType::PointToPoint, 262),
        t_o_rpi_us: 1_000,
        t_o: parameters(ConnectionType::PointToPoint, 258),
        transport: Transport::CYCLIC,
        path: Path(OWNER_PATH),
    }
}

/// Returns a Forward_Open like [`owner`] without outputs.
pub(crate) fn heartbeat(serial: u16, path: &'static [u8]) -> OpenRequest<'static> {
    let o_t = parameters(ConnectionType::PointToPoint, 2);
    OpenRequest { o_t, path: Path(path), ..owner(serial) }
}

/// Returns a Forward_Open of a class 3 connection.
pub(crate) fn explicit(serial: u16) -> OpenRequest<'static> {
    let size = Parameters {
        priority: Priority::Low,
        variable: true,
        ..parameters(ConnectionType::PointToPoint, 504)
    };
    OpenRequest {
        o_t: size,
        t_o: size,
        o_t_rpi_us: 2_000_000,
        t_o_rpi_us: 2_000_000,
        transport: Transport::EXPLICIT,
        path: Path(ROUTER_PATH),
        ..owner(serial)
    }
}

fn written(write: impl FnOnce(&mut Writer<'_, LittleEndian>)) -> Vec<u8> {
    let mut buf = vec![0; 8_192];
    let mut writer = Writer::new(&mut buf);
    write(&mut writer);
    let len = writer.finish().unwrap();
    buf.truncate(len);
    buf
}

/// Returns a Forward_Open or Large_Forward_Open as a CIP request.
pub(crate) fn open_message(request: &OpenRequest<'_>, large: bool) -> Vec<u8> {
    let service = if large { 0x5B } else { 0x54 };
    written(|writer| {
        writer.bytes(&[service, 2, 0x20, 6, 0x24, 1]);
        request.emit(writer, large);
    })
}

/// Returns a Forward_Close as a CIP request.
pub(crate) fn close_message(triad: Triad, path: &[u8]) -> Vec<u8> {
    written(|writer| {
        writer.bytes(&[0x4E, 2, 0x20, 6, 0x24, 1]);
        CloseRequest { triad, path: Path(path) }.emit(writer);
    })
}

/// Returns an encapsulation message.
pub(crate) fn message(command: Command, session: u32, data: &[u8]) -> Vec<u8> {
    let mut buf = vec![0; HEADER_LEN + data.len()];
    Header::request(command, session).emit(&mut buf, |writer| writer.bytes(data)).unwrap();
    buf
}

/// Returns the data of a SendRRData with this CIP request.
pub(crate) fn unconnected(cip: &[u8]) -> Vec<u8> {
    written(|writer| {
        writer.zeros(6);
        writer.u16(2);
        write_item(writer, kind::NULL_ADDRESS, |_| {});
        write_item(writer, kind::UNCONNECTED_DATA, |writer| writer.bytes(cip));
    })
}

/// Returns the data of a SendUnitData.
pub(crate) fn connected(connection: u32, count: u16, cip: &[u8]) -> Vec<u8> {
    written(|writer| {
        writer.zeros(6);
        writer.u16(2);
        write_item(writer, kind::CONNECTED_ADDRESS, |writer| writer.u32(connection));
        write_item(writer, kind::CONNECTED_DATA, |writer| {
            writer.u16(count);
            writer.bytes(cip);
        });
    })
}

/// A CIP reply with its status, kept.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Answer {
    pub(crate) general: General,
    pub(crate) additional: Vec<u16>,
    pub(crate) data: Vec<u8>,
}

impl Answer {
    fn parse(cip: &[u8]) -> Self {
        let reply = Reply::parse(cip).unwrap();
        let additional =
            reply.additional.chunks(2).map(|word| u16::from_le_bytes([word[0], word[1]])).collect();
        Self { general: reply.general, additional, data: reply.data.to_vec() }
    }

    /// Returns the general status and the first additional word.
    pub(crate) fn status(&self) -> (u8, u16) {
        (self.general.into(), self.additional.first().copied().unwrap_or(0))
    }
}

/// A registered TCP client.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Client {
    pub(crate) stream: StreamId,
    pub(crate) session: u32,
}

/// A scanner that behaves: owns the outputs and sends every millisecond.
#[derive(Debug)]
struct Good {
    client: Client,
    opened: OpenReply,
    next: Instant,
    sequence: u32,
}

/// The adapter and everybody who talks to it.
pub(crate) struct Rig {
    pub(crate) adapter: Adapter,
    pub(crate) now: Instant,
    next_stream: u32,
    /// What came back over each TCP connection and was not read yet.
    pub(crate) streams: BTreeMap<u32, Vec<u8>>,
    /// Datagrams that the adapter sent: when, from which port, to whom.
    pub(crate) datagrams: Vec<(Instant, u16, SocketAddrV4, Vec<u8>)>,
    /// Connections that the adapter ended.
    pub(crate) closed: Vec<StreamId>,
    pub(crate) events: Vec<LinkEvent>,
    /// Who opened a connection that owns outputs.
    pub(crate) owners: Vec<OwnerReport>,
    good: Option<Good>,
    buf: Vec<u8>,
}

impl Rig {
    pub(crate) fn new() -> Self {
        Self::of(adapter_config())
    }

    pub(crate) fn of(config: AdapterConfig) -> Self {
        Self {
            adapter: Adapter::new(config),
            now: Instant::from_millis(1),
            next_stream: 1,
            streams: BTreeMap::new(),
            datagrams: Vec::new(),
            closed: Vec::new(),
            events: Vec::new(),
            owners: Vec::new(),
            good: None,
            buf: vec![0; FRAME_CAPACITY],
        }
    }

    /// Follows the contract after a mutation. An adapter that never stops talking has stalled.
    pub(crate) fn settle(&mut self) {
        for step in 0.. {
            assert!(step < 2_000, "the adapter does not stop sending");
            let Some(transmit) = self.adapter.poll_transmit(self.now, &mut self.buf) else { break };
            let bytes = self.buf[..transmit.len].to_vec();
            match transmit.port {
                Port::Stream(StreamId(id)) => self.streams.entry(id).or_default().extend(bytes),
                Port::Udp(port) => self.datagrams.push((self.now, port, transmit.to.unwrap(), bytes)),
                Port::Ethernet => panic!("EtherNet/IP has no raw frames"),
            }
        }
        while let Some(request) = self.adapter.poll_stream() {
            match request {
                StreamRequest::Close(stream) => self.closed.push(stream),
                StreamRequest::Connect { .. } => panic!("an adapter does not connect"),
            }
        }
        while let Some(event) = self.adapter.poll_event() {
            match event {
                LinkEvent::Owner(owner) => self.owners.push(owner),
                event => self.events.push(event),
            }
        }
    }

    /// Lets time pass; the good scanner, if there is one, sends its frames.
    pub(crate) fn advance(&mut self, time: Duration) {
        let until = self.now + time;
        loop {
            let adapter = self.adapter.poll_timeout().unwrap_or(until);
            let scanner = self.good.as_ref().map_or(until, |good| good.next);
            let next = adapter.min(scanner).max(self.now);
            if next >= until {
                self.now = until;
                return;
            }
            self.now = next;
            if scanner <= next {
                let good = self.good.as_mut().unwrap();
                good.next += Duration::from_millis(1);
                good.sequence += 1;
                let (id, sequence) = (good.opened.o_t_id, good.sequence);
                self.io(PLC, id, sequence, Some(true), &[sequence as u8; 256]);
            }
            if adapter <= next {
                self.adapter.handle_timeout(self.now);
                self.settle();
            }
        }
    }

    pub(crate) fn connect_from(&mut self, ip: Ipv4Addr) -> StreamId {
        let stream = StreamId(self.next_stream);
        self.next_stream += 1;
        self.adapter.handle_stream(self.now, stream, StreamChange::Accepted(peer(ip, 50_000)));
        self.settle();
        stream
    }

    pub(crate) fn hang_up(&mut self, stream: StreamId) {
        self.adapter.handle_stream(self.now, stream, StreamChange::Closed);
        self.settle();
    }

    /// Returns a client that connected and registered a session.
    pub(crate) fn client_from(&mut self, ip: Ipv4Addr) -> Client {
        let stream = self.connect_from(ip);
        self.send(stream, &message(Command::RegisterSession, 0, &[1, 0, 0, 0]));
        let (header, _) = self.read(stream).unwrap();
        assert_eq!(header.status, Status::Success);
        Client { stream, session: header.session }
    }

    pub(crate) fn client(&mut self) -> Client {
        self.client_from(PLC)
    }

    pub(crate) fn send(&mut self, stream: StreamId, bytes: &[u8]) {
        let from = Source { port: Port::Stream(stream), peer: None };
        self.adapter.handle_frame(self.now, from, bytes);
        self.settle();
    }

    pub(crate) fn datagram(&mut self, port: u16, from: SocketAddrV4, bytes: &[u8]) {
        let from = Source { port: Port::Udp(port), peer: Some(from) };
        self.adapter.handle_frame(self.now, from, bytes);
        self.settle();
    }

    /// Sends a datagram to every station.
    pub(crate) fn broadcast(&mut self, port: u16, from: SocketAddrV4, bytes: &[u8]) {
        let from = Source { port: Port::Udp(port), peer: Some(from) };
        self.adapter.handle_broadcast(self.now, from, bytes);
        self.settle();
    }

    /// Sends an encapsulation message over UDP and takes what comes back.
    pub(crate) fn ask_udp(&mut self, bytes: &[u8]) -> Vec<Vec<u8>> {
        self.datagrams.retain(|(_, port, ..)| *port != ENCAPSULATION_PORT);
        self.datagram(ENCAPSULATION_PORT, peer(PLC, 40_000), bytes);
        let answers = self
            .datagrams
            .iter()
            .filter(|(_, port, to, _)| *port == ENCAPSULATION_PORT && *to == peer(PLC, 40_000));
        answers.map(|(.., bytes)| bytes.clone()).collect()
    }

    /// Sends a cyclic frame.
    pub(crate) fn io(&mut self, ip: Ipv4Addr, id: u32, sequence: u32, run: Option<bool>, data: &[u8]) {
        let mut buf = [0; 1_024];
        let len = class1::emit(&mut buf, (id, sequence, sequence as u16), run, data).unwrap();
        self.datagram(IO_PORT, peer(ip, IO_PORT), &buf[..len]);
    }

    /// Returns the next message that came back over TCP.
    pub(crate) fn read(&mut self, stream: StreamId) -> Option<(Header, Vec<u8>)> {
        let bytes = self.streams.get_mut(&stream.0)?;
        let header = Header::parse(bytes).ok()?;
        let len = HEADER_LEN + usize::from(header.length);
        assert!(bytes.len() >= len, "a message is cut off");
        let message: Vec<u8> = bytes.drain(..len).collect();
        Some((header, message[HEADER_LEN..].to_vec()))
    }

    /// Sends a CIP request and returns its answer, with the packet's items.
    pub(crate) fn request_with(&mut self, client: Client, data: &[u8]) -> (Answer, Option<SocketAddrV4>) {
        self.send(client.stream, &message(Command::SendRRData, client.session, data));
        let (header, data) = self.read(client.stream).expect("no reply");
        assert_eq!(header.status, Status::Success);
        let mut reader = Reader::<LittleEndian>::new(&data);
        reader.skip(6).unwrap();
        let packet = Packet::parse(reader).unwrap();
        let Some(Item::UnconnectedData(cip)) = packet.data else { panic!("{packet:?}") };
        (Answer::parse(cip), packet.socket_t_o)
    }

    pub(crate) fn request(&mut self, client: Client, cip: &[u8]) -> Answer {
        self.request_with(client, &unconnected(cip)).0
    }

    /// Sends a CIP request over a class 3 connection and returns the answer, if there is one.
    pub(crate) fn request_connected(
        &mut self,
        client: Client,
        opened: &OpenReply,
        count: u16,
        cip: &[u8],
    ) -> Option<Answer> {
        let data = connected(opened.o_t_id, count, cip);
        self.send(client.stream, &message(Command::SendUnitData, client.session, &data));
        let (_, data) = self.read(client.stream)?;
        let mut reader = Reader::<LittleEndian>::new(&data);
        reader.skip(6).unwrap();
        let packet = Packet::parse(reader).unwrap();
        assert_eq!(packet.address, Some(Item::ConnectedAddress(opened.t_o_id)));
        let Some(Item::ConnectedData(reply)) = packet.data else { panic!("{packet:?}") };
        assert_eq!(reply[..2], count.to_le_bytes());
        Some(Answer::parse(&reply[2..]))
    }

    pub(crate) fn try_open(
        &mut self,
        client: Client,
        request: &OpenRequest<'_>,
    ) -> Result<OpenReply, (u8, u16)> {
        let answer = self.request(client, &open_message(request, false));
        match answer.general {
            General::Success => Ok(OpenReply::parse(&answer.data).unwrap()),
            _ => Err(answer.status()),
        }
    }

    pub(crate) fn open(&mut self, client: Client, request: &OpenRequest<'_>) -> OpenReply {
        self.try_open(client, request)
            .unwrap_or_else(|(general, extended)| panic!("refused with 0x{general:02X}, 0x{extended:04X}"))
    }

    /// Opens a Forward_Open with a socket address item; returns the reply's.
    pub(crate) fn open_to(
        &mut self,
        client: Client,
        request: &OpenRequest<'_>,
        to: SocketAddrV4,
    ) -> (Answer, Option<SocketAddrV4>) {
        let cip = open_message(request, false);
        let data = written(|writer| {
            writer.zeros(6);
            writer.u16(3);
            write_item(writer, kind::NULL_ADDRESS, |_| {});
            write_item(writer, kind::UNCONNECTED_DATA, |writer| writer.bytes(&cip));
            write_item(writer, kind::SOCKET_ADDRESS_T_O, |writer| cpf::write_address(writer, to));
        });
        self.request_with(client, &data)
    }

    /// Starts a good scanner, which owns the outputs and sends every millisecond.
    pub(crate) fn start_good_scanner(&mut self) {
        let client = self.client();
        let opened = self.open(client, &owner(0xFFFF));
        self.good = Some(Good { client, opened, next: self.now, sequence: 0 });
        self.advance(Duration::from_millis(3));
    }

    /// Asserts that the good scanner still gets its data on time and answers to its requests.
    pub(crate) fn assert_good_scanner_is_served(&mut self) {
        self.assert_good_scanner_is_served_beside(1);
    }

    /// Asserts the same while so many class 1 connections are open in all.
    pub(crate) fn assert_good_scanner_is_served_beside(&mut self, connections: usize) {
        assert_eq!(self.adapter.connections().0, connections, "class 1 connections");
        let good = self.good.as_ref().expect("there is no good scanner");
        let (client, id) = (good.client, good.opened.t_o_id);
        // From between two grid points, so that none of them falls on the window's edge.
        self.advance(Duration::from_nanos(1_500_000 - self.now.as_nanos() % 1_000_000));
        self.datagrams.clear();
        self.advance(Duration::from_millis(10));
        let frames: Vec<_> = self
            .datagrams
            .iter()
            .filter(|(_, port, _, bytes)| *port == IO_PORT && bytes[6..10] == id.to_le_bytes())
            .collect();
        assert_eq!(frames.len(), 10, "T→O frames in 10 ms");
        for pair in frames.windows(2) {
            assert_eq!(pair[1].0.since(pair[0].0), Duration::from_millis(1));
            let sequence = |frame: &[u8]| u32::from_le_bytes(frame[10..14].try_into().unwrap());
            assert_eq!(sequence(&pair[1].3), sequence(&pair[0].3) + 1);
            assert_eq!((pair[1].3.len(), pair[1].2), (276, peer(PLC, IO_PORT)));
        }
        let input = self.adapter.consumed(CONSUMED).expect("the owner's data is taken");
        let last = self.good.as_ref().unwrap().sequence as u8;
        assert_eq!(input, &[last; 256]);
        let name = self.request(client, &[0x0E, 3, 0x20, 1, 0x24, 1, 0x30, 7]);
        assert_eq!(name.data, b"\x10sample device 01");
    }
}
