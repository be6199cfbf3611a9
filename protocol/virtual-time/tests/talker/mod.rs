//! Machines for tests of networks: they send what they are told, and remember what they hear.

use std::collections::VecDeque;
use std::net::{Ipv4Addr, SocketAddrV4};

use machine::ethernet::Mac;
use machine::{
    Attempt, Duration, Instant, InterfaceId, Machine, Multihomed, Port, PortRequest, Source, StreamChange,
    StreamId, StreamRequest, Transmit,
};

/// The EtherTypes of the ports of [`Homes`]; a [`Talker`] sends the first.
pub(crate) const ETHER_TYPES: [u16; 2] = [0x88B5, 0x88B6];

pub(crate) fn mac(number: u8) -> Mac {
    Mac([2, 0, 0, 0, 0, number])
}

pub(crate) fn address(number: u8) -> Ipv4Addr {
    Ipv4Addr::new(10, 0, 0, number + 1)
}

fn frame(from: Mac, to: Mac, ether_type: u16, payload: &[u8]) -> Vec<u8> {
    [&to.0[..], &from.0, &ether_type.to_be_bytes(), payload].concat()
}

/// Sends frames and bytes of a stream, and remembers everything.
#[derive(Default)]
pub(crate) struct Talker {
    mac: Mac,
    frames: VecDeque<Vec<u8>>,
    pub(crate) heard: Vec<(Instant, Vec<u8>)>,
    pub(crate) answers_all: bool,
    pub(crate) is_endless: bool,
    every: Option<Duration>,
    next: Option<Instant>,
    pub(crate) ticks: u64,
    pub(crate) connect: Option<(SocketAddrV4, Attempt)>,
    stream: Option<StreamId>,
    pub(crate) stream_out: Vec<u8>,
    pub(crate) stream_in: Vec<u8>,
    pub(crate) changes: Vec<(Instant, StreamChange)>,
}

impl Talker {
    /// Counts a tick every so long by its own clock.
    pub(crate) fn ticking(every: Duration) -> Self {
        Self { every: Some(every), next: Some(Instant::ZERO + every), ..Self::default() }
    }

    /// Asks for the same timeout for ever.
    pub(crate) fn stuck_at(next: Instant) -> Self {
        Self { next: Some(next), ..Self::default() }
    }

    pub(crate) fn say_to(&mut self, to: Mac, payload: &[u8]) {
        self.frames.push_back(frame(self.mac, to, ETHER_TYPES[0], payload));
    }

    pub(crate) fn with_mac(mac: Mac) -> Self {
        Self { mac, ..Self::default() }
    }
}

impl Machine for Talker {
    type Event = ();

    fn ports(&self) -> &[PortRequest] {
        &[PortRequest::Ethernet { ether_type: ETHER_TYPES[0], groups: &[] }]
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        if let Port::Stream(_) = from.port {
            return self.stream_in.extend_from_slice(frame);
        }
        self.heard.push((now, frame.to_vec()));
        if self.answers_all {
            self.say_to(Mac([0xFF; 6]), b"answer");
        }
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        self.changes.push((now, change));
        let is_open = matches!(change, StreamChange::Accepted(_) | StreamChange::Connected(_));
        self.stream = is_open.then_some(stream);
    }

    fn listen_port(&self) -> Option<u16> {
        Some(7)
    }

    fn poll_stream(&mut self) -> Option<StreamRequest> {
        self.connect.take().map(|(to, attempt)| StreamRequest::Connect { to, attempt })
    }

    fn handle_timeout(&mut self, now: Instant) {
        if let Some(every) = self.every {
            self.ticks += 1;
            self.next = self.next.map(|next| next.next_on_grid(every, now).0);
        }
    }

    fn poll_transmit(&mut self, _now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        if self.is_endless {
            return Some(Transmit { port: Port::Ethernet, to: None, len: 60 });
        }
        if let Some(stream) = self.stream.filter(|_| !self.stream_out.is_empty()) {
            let len = self.stream_out.len().min(buf.len());
            buf[..len].copy_from_slice(&self.stream_out[..len]);
            self.stream_out.drain(..len);
            return Some(Transmit { port: Port::Stream(stream), to: None, len });
        }
        let frame = self.frames.pop_front()?;
        buf[..frame.len()].copy_from_slice(&frame);
        Some(Transmit { port: Port::Ethernet, to: None, len: frame.len() })
    }

    fn poll_event(&mut self) -> Option<()> {
        None
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.next
    }
}

/// A machine with two interfaces, each with a port for an EtherType of its own, that remembers where it hears something.
pub(crate) struct Homes {
    say: Option<(InterfaceId, Vec<u8>)>,
    pub(crate) heard: Vec<InterfaceId>,
}

impl Homes {
    pub(crate) fn new() -> Self {
        Self { say: None, heard: Vec::new() }
    }

    pub(crate) fn say(&mut self, on: InterfaceId, ether_type: u16, to: Mac) {
        self.say = Some((on, frame(mac(0x10 + on.0), to, ether_type, b"home")));
    }
}

impl Multihomed for Homes {
    type Event = ();

    fn interfaces(&self) -> u8 {
        2
    }

    fn handle_frame(&mut self, _now: Instant, on: InterfaceId, _from: Source, _frame: &[u8]) {
        self.heard.push(on);
    }

    fn handle_broadcast(&mut self, _now: Instant, _on: InterfaceId, _from: Source, _frame: &[u8]) {}

    fn handle_stream(&mut self, _now: Instant, _on: InterfaceId, _stream: StreamId, _change: StreamChange) {}

    fn handle_wrong_neighbour(&mut self, _now: Instant, _on: InterfaceId, _address: Ipv4Addr, _found: Mac) {}

    fn ports(&self, on: InterfaceId) -> &[PortRequest] {
        const PORTS: [[PortRequest; 1]; 2] = [
            [PortRequest::Ethernet { ether_type: ETHER_TYPES[0], groups: &[] }],
            [PortRequest::Ethernet { ether_type: ETHER_TYPES[1], groups: &[] }],
        ];
        &PORTS[usize::from(on.0)]
    }

    fn listen_port(&self, _on: InterfaceId) -> Option<u16> {
        None
    }

    fn poll_stream(&mut self) -> Option<(InterfaceId, StreamRequest)> {
        None
    }

    fn dscp(&self, _on: InterfaceId, _port: Port) -> u8 {
        0
    }

    fn group(&self, _on: InterfaceId, _port: Port, _index: usize) -> Option<Ipv4Addr> {
        None
    }

    fn neighbour(&self, _on: InterfaceId, _address: Ipv4Addr) -> Option<Mac> {
        None
    }

    fn handle_timeout(&mut self, _now: Instant) {}

    fn poll_transmit(&mut self, _now: Instant, buf: &mut [u8]) -> Option<(InterfaceId, Transmit)> {
        let (on, frame) = self.say.take()?;
        buf[..frame.len()].copy_from_slice(&frame);
        Some((on, Transmit { port: Port::Ethernet, to: None, len: frame.len() }))
    }

    fn poll_event(&mut self) -> Option<()> {
        None
    }

    fn poll_timeout(&self) -> Option<Instant> {
        None
    }
}
