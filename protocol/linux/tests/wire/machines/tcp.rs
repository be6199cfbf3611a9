//! Machines over TCP, to test the driver's connections with.

use std::collections::VecDeque;
use std::net::SocketAddrV4;

use machine::{
    Attempt, Cycle, Duration, Instant, Machine, Port, PortRequest, Source, StreamChange, StreamId,
    StreamRequest, Transmit,
};
use protocol::fieldbus::LinkEvent;

use crate::test_network::Progress;

pub(crate) const TCP_PORT: u16 = 44818;
const PERIOD: Duration = Duration::from_millis(1);

/// Echoes what it receives, and also has a cyclic timeout. If a client sends [`FLOOD`], it sends without end; if a
/// client sends [`LEAVE`], it answers [`FAREWELL`] and closes.
#[derive(Debug)]
pub(crate) struct EchoServer {
    cycle: Cycle,
    to_send: VecDeque<(StreamId, Vec<u8>)>,
    flooded: Option<StreamId>,
    to_close: Option<StreamId>,
    pub(crate) dscp: u8,
    pub(crate) ticks: u64,
    pub(crate) opened: Vec<StreamId>,
    pub(crate) closed: Vec<StreamId>,
}

pub(crate) const FLOOD: &[u8] = b"flood\n";
pub(crate) const LEAVE: &[u8] = b"leave\n";
pub(crate) const FAREWELL: &[u8] = b"farewell";

impl EchoServer {
    pub(crate) fn new(now: Instant) -> Self {
        Self {
            cycle: Cycle::new(now + PERIOD, PERIOD),
            to_send: VecDeque::new(),
            flooded: None,
            to_close: None,
            dscp: 27,
            ticks: 0,
            opened: Vec::new(),
            closed: Vec::new(),
        }
    }
}

impl Progress for EchoServer {
    fn link(event: LinkEvent) -> LinkEvent {
        event
    }
}

impl Machine for EchoServer {
    type Event = LinkEvent;

    fn ports(&self) -> &[PortRequest] {
        &[]
    }

    fn handle_frame(&mut self, _: Instant, from: Source, frame: &[u8]) {
        let Port::Stream(stream) = from.port else { return };
        match frame {
            FLOOD => self.flooded = Some(stream),
            LEAVE => {
                self.to_send.push_back((stream, FAREWELL.to_vec()));
                self.to_close = Some(stream);
            }
            frame => self.to_send.push_back((stream, frame.to_vec())),
        }
    }

    fn handle_stream(&mut self, _: Instant, stream: StreamId, change: StreamChange) {
        match change {
            StreamChange::Accepted(_) => self.opened.push(stream),
            StreamChange::Closed => {
                self.closed.push(stream);
                self.flooded = self.flooded.filter(|flooded| *flooded != stream);
            }
            StreamChange::Connected(_) | StreamChange::NotConnected(_) => {
                unreachable!("it connects to nobody")
            }
        }
    }

    fn listen_port(&self) -> Option<u16> {
        Some(TCP_PORT)
    }

    fn poll_stream(&mut self) -> Option<StreamRequest> {
        self.to_close.take().map(StreamRequest::Close)
    }

    fn dscp(&self, _: Port) -> u8 {
        self.dscp
    }

    fn handle_timeout(&mut self, now: Instant) {
        if self.cycle.tick(now).is_some() {
            self.ticks += 1;
            if let Some(stream) = self.flooded {
                self.to_send.push_back((stream, vec![0xAA; 4096]));
            }
        }
    }

    fn poll_transmit(&mut self, _: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let (stream, bytes) = self.to_send.pop_front()?;
        buf.get_mut(..bytes.len())?.copy_from_slice(&bytes);
        Some(Transmit { port: Port::Stream(stream), to: None, len: bytes.len() })
    }

    fn poll_event(&mut self) -> Option<LinkEvent> {
        None
    }

    fn poll_timeout(&self) -> Option<Instant> {
        Some(self.cycle.next())
    }
}

/// Connects to a peer, sends a text and keeps what it receives; retries 20 ms after a failure.
#[derive(Debug)]
pub(crate) struct Caller {
    to: SocketAddrV4,
    call_at: Option<Instant>,
    call: bool,
    to_send: Option<StreamId>,
    pub(crate) opened: Vec<StreamId>,
    pub(crate) closed: Vec<StreamId>,
    pub(crate) received: Vec<u8>,
}

pub(crate) const GREETING: &[u8] = b"who is there?";

impl Caller {
    pub(crate) fn new(to: SocketAddrV4, now: Instant) -> Self {
        Self {
            to,
            call_at: Some(now),
            call: false,
            to_send: None,
            opened: Vec::new(),
            closed: Vec::new(),
            received: Vec::new(),
        }
    }
}

impl Progress for Caller {
    fn link(event: LinkEvent) -> LinkEvent {
        event
    }

    /// Returns the number of refused attempts and closed connections.
    fn progress(&self) -> u64 {
        self.closed.len() as u64
    }
}

impl Machine for Caller {
    type Event = LinkEvent;

    fn ports(&self) -> &[PortRequest] {
        &[]
    }

    fn handle_frame(&mut self, _: Instant, _: Source, frame: &[u8]) {
        self.received.extend_from_slice(frame);
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        match change {
            StreamChange::Connected(_) => {
                self.opened.push(stream);
                self.to_send = Some(stream);
            }
            StreamChange::Closed | StreamChange::NotConnected(_) => {
                self.closed.push(stream);
                self.call_at = Some(now + Duration::from_millis(20));
            }
            StreamChange::Accepted(_) => unreachable!("it lets nobody in"),
        }
    }

    fn poll_stream(&mut self) -> Option<StreamRequest> {
        std::mem::take(&mut self.call).then_some(StreamRequest::Connect { to: self.to, attempt: Attempt(0) })
    }

    fn handle_timeout(&mut self, _: Instant) {
        self.call_at = None;
        self.call = true;
    }

    fn poll_transmit(&mut self, _: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let stream = self.to_send.take()?;
        buf.get_mut(..GREETING.len())?.copy_from_slice(GREETING);
        Some(Transmit { port: Port::Stream(stream), to: None, len: GREETING.len() })
    }

    fn poll_event(&mut self) -> Option<LinkEvent> {
        None
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.call_at
    }
}
