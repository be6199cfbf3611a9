//! A machine on two interfaces that notes what its driver does.

use std::net::{Ipv4Addr, SocketAddrV4};
use std::ops::ControlFlow;

use machine::ethernet::Mac;
use machine::{
    Cycle, Instant, InterfaceId, Multihomed, Port, PortRequest, Source, StreamChange, StreamId,
    StreamRequest, Transmit,
};
use protocol_linux::{Owner, Statistics};

/// A call of the machine by its driver, with the interface.
#[derive(Clone, PartialEq, Debug)]
pub(super) enum Call {
    Frame(InterfaceId, Port, Vec<u8>),
    Stream(InterfaceId, StreamId, StreamChange),
    Timeout,
}

/// Notes what its driver calls it for, and sends what it is given.
#[derive(Debug, Default)]
pub(super) struct Notebook {
    pub(super) ports: [Vec<PortRequest>; 2],
    pub(super) listens: Option<u16>,
    pub(super) cycle: Option<Cycle>,
    /// Whether something is due after each frame.
    pub(super) is_busy: bool,
    pub(super) due: Option<Instant>,
    /// What it sends in each cycle.
    pub(super) cyclic: Vec<(InterfaceId, Port, SocketAddrV4)>,
    pub(super) queue: Vec<(InterfaceId, Port, SocketAddrV4)>,
    pub(super) requests: Vec<(InterfaceId, StreamRequest)>,
    /// Where every station must be on the second interface.
    pub(super) neighbour: Option<Mac>,
    pub(super) calls: Vec<Call>,
}

impl Notebook {
    pub(super) fn on(ports: [&[PortRequest]; 2]) -> Self {
        Self { ports: ports.map(<[_]>::to_vec), ..Self::default() }
    }

    pub(super) fn frames(&self) -> Vec<(InterfaceId, Port, Vec<u8>)> {
        let frame = |call: &Call| match call {
            Call::Frame(on, port, bytes) => Some((*on, *port, bytes.clone())),
            _ => None,
        };
        self.calls.iter().filter_map(frame).collect()
    }

    pub(super) fn timeouts(&self) -> usize {
        self.calls.iter().filter(|call| **call == Call::Timeout).count()
    }
}

impl Multihomed for Notebook {
    type Event = ();

    fn interfaces(&self) -> u8 {
        2
    }

    fn handle_frame(&mut self, now: Instant, on: InterfaceId, from: Source, frame: &[u8]) {
        self.calls.push(Call::Frame(on, from.port, frame.to_vec()));
        if self.is_busy {
            self.due = Some(now);
        }
    }

    fn handle_broadcast(&mut self, now: Instant, on: InterfaceId, from: Source, frame: &[u8]) {
        self.handle_frame(now, on, from, frame);
    }

    fn handle_stream(&mut self, _: Instant, on: InterfaceId, stream: StreamId, change: StreamChange) {
        self.calls.push(Call::Stream(on, stream, change));
    }

    fn handle_wrong_neighbour(&mut self, _: Instant, _: InterfaceId, _: Ipv4Addr, _: Mac) {}

    fn ports(&self, on: InterfaceId) -> &[PortRequest] {
        &self.ports[usize::from(on.0)]
    }

    fn listen_port(&self, _: InterfaceId) -> Option<u16> {
        self.listens
    }

    fn poll_stream(&mut self) -> Option<(InterfaceId, StreamRequest)> {
        self.requests.pop()
    }

    fn dscp(&self, _: InterfaceId, _: Port) -> u8 {
        0
    }

    fn group(&self, _: InterfaceId, _: Port, _: usize) -> Option<Ipv4Addr> {
        None
    }

    fn neighbour(&self, on: InterfaceId, _: Ipv4Addr) -> Option<Mac> {
        self.neighbour.filter(|_| on == InterfaceId(1))
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.due = None;
        self.calls.push(Call::Timeout);
        if let Some(cycle) = &mut self.cycle
            && cycle.tick(now).is_some()
        {
            self.queue.clone_from(&self.cyclic);
        }
    }

    fn poll_transmit(&mut self, _: Instant, buf: &mut [u8]) -> Option<(InterfaceId, Transmit)> {
        let (on, port, to) = self.queue.pop()?;
        buf[..2].copy_from_slice(&[b'#', on.0]);
        Some((on, Transmit { port, to: Some(to), len: 2 }))
    }

    fn poll_event(&mut self) -> Option<()> {
        None
    }

    fn poll_timeout(&self) -> Option<Instant> {
        [self.due, self.cycle.as_ref().map(Cycle::next)].into_iter().flatten().min()
    }
}

/// Ends the driver once `is_done`.
pub(super) struct Until<F>(pub(super) F);

impl<F: FnMut(&mut Notebook) -> bool> Owner<Notebook> for Until<F> {
    fn wake(&mut self, _: Instant, machine: &mut Notebook, _: &Statistics) -> ControlFlow<()> {
        if (self.0)(machine) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }

    fn event(&mut self, _: Instant, _: &mut Notebook, (): ()) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }
}
