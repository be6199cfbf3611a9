//! A machine of two machines, each on an interface of its own, beside those that are on one.

use core::net::Ipv4Addr;

use machine::ethernet::Mac;
use machine::{
    Instant, InterfaceId, Machine, Multihomed, Port, PortRequest, Source, StreamChange, StreamId,
    StreamRequest, Transmit,
};

/// Sends back each datagram that it gets.
#[derive(Default)]
struct Echo {
    waiting: Vec<u8>,
}

impl Machine for Echo {
    type Event = ();

    fn ports(&self) -> &[PortRequest] {
        &[PortRequest::Udp(7)]
    }

    fn handle_frame(&mut self, _now: Instant, _from: Source, frame: &[u8]) {
        self.waiting.extend(frame);
    }

    fn handle_timeout(&mut self, _now: Instant) {}

    fn poll_transmit(&mut self, _now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let byte = self.waiting.pop()?;
        *buf.first_mut()? = byte;
        Some(Transmit { port: Port::Udp(7), to: "192.0.2.1:7".parse().ok(), len: 1 })
    }

    fn poll_event(&mut self) -> Option<()> {
        None
    }

    fn poll_timeout(&self) -> Option<Instant> {
        None
    }
}

/// Two of them on two networks.
#[derive(Default)]
struct Two([Echo; 2]);

impl Two {
    fn on(&self, InterfaceId(number): InterfaceId) -> Option<&Echo> {
        self.0.get(usize::from(number))
    }

    fn on_mut(&mut self, InterfaceId(number): InterfaceId) -> Option<&mut Echo> {
        self.0.get_mut(usize::from(number))
    }
}

impl Multihomed for Two {
    type Event = ();

    fn interfaces(&self) -> u8 {
        2
    }

    fn handle_frame(&mut self, now: Instant, on: InterfaceId, from: Source, frame: &[u8]) {
        if let Some(echo) = self.on_mut(on) {
            Machine::handle_frame(echo, now, from, frame);
        }
    }

    fn handle_broadcast(&mut self, now: Instant, on: InterfaceId, from: Source, frame: &[u8]) {
        Multihomed::handle_frame(self, now, on, from, frame);
    }

    fn handle_stream(&mut self, _: Instant, _: InterfaceId, _: StreamId, _: StreamChange) {}

    fn handle_wrong_neighbour(&mut self, _: Instant, _: InterfaceId, _: Ipv4Addr, _: Mac) {}

    fn ports(&self, on: InterfaceId) -> &[PortRequest] {
        self.on(on).map_or(&[], Machine::ports)
    }

    fn listen_port(&self, _: InterfaceId) -> Option<u16> {
        None
    }

    fn poll_stream(&mut self) -> Option<(InterfaceId, StreamRequest)> {
        None
    }

    fn dscp(&self, _: InterfaceId, _: Port) -> u8 {
        0
    }

    fn group(&self, _: InterfaceId, _: Port, _: usize) -> Option<Ipv4Addr> {
        None
    }

    fn neighbour(&self, _: InterfaceId, _: Ipv4Addr) -> Option<Mac> {
        None
    }

    fn handle_timeout(&mut self, _: Instant) {}

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<(InterfaceId, Transmit)> {
        let mut numbered = (0..).map(InterfaceId).zip(&mut self.0);
        numbered.find_map(|(on, echo)| Some((on, Machine::poll_transmit(echo, now, buf)?)))
    }

    fn poll_event(&mut self) -> Option<()> {
        None
    }

    fn poll_timeout(&self) -> Option<Instant> {
        None
    }
}

/// Gives a machine one datagram on an interface. Returns the interfaces on which it answers.
fn answers(machine: &mut impl Multihomed, on: InterfaceId) -> Vec<InterfaceId> {
    let from = Source { port: Port::Udp(7), peer: "192.0.2.1:7".parse().ok() };
    machine.handle_frame(Instant::ZERO, on, from, &[1]);
    core::iter::from_fn(|| machine.poll_transmit(Instant::ZERO, &mut [0; 1514])).map(|(on, _)| on).collect()
}

#[test]
fn a_machine_answers_on_the_interface_on_which_it_was_asked() {
    for number in 0..2 {
        assert_eq!(answers(&mut Two::default(), InterfaceId(number)), [InterfaceId(number)]);
    }
}

#[test]
fn a_machine_with_one_interface_is_multihomed_with_one() {
    let mut echo = Echo::default();
    assert_eq!(echo.interfaces(), 1);
    assert_eq!(answers(&mut echo, InterfaceId::FIRST), [InterfaceId::FIRST]);
    assert_eq!(Multihomed::ports(&echo, InterfaceId::FIRST), [PortRequest::Udp(7)]);
    assert!(Multihomed::ports(&echo, InterfaceId(1)).is_empty());
}
