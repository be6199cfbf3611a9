//! A [`Fieldbus`] as a [`ControllerBus`] with one station, and the other way round.

use core::fmt;
use core::net::Ipv4Addr;

use machine::ethernet::Mac;
use machine::{Instant, LinkEvent, Machine, Source, StreamChange, StreamId, Transmit};

use crate::fieldbus::{ControllerBus, Counters, Fieldbus, StationId};
use crate::image::{Image, Order};

/// An endpoint with one connection as the PLC's end of a bus with one station.
#[derive(Clone, Debug)]
pub struct OneStation<B> {
    /// The endpoint.
    pub bus: B,
    received: u64,
}

impl<B: Fieldbus> OneStation<B> {
    /// Takes an endpoint.
    #[must_use]
    pub const fn new(bus: B) -> Self {
        Self { bus, received: 0 }
    }
}

impl<B: Fieldbus> Machine for OneStation<B> {
    type Event = (StationId, LinkEvent);

    machine::forward_ports!(bus);

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.bus.handle_frame(now, from, frame);
    }

    fn handle_broadcast(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.bus.handle_broadcast(now, from, frame);
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        self.bus.handle_stream(now, stream, change);
    }

    fn handle_wrong_neighbour(&mut self, now: Instant, address: Ipv4Addr, found: Mac) {
        self.bus.handle_wrong_neighbour(now, address, found);
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.bus.handle_timeout(now);
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.bus.poll_transmit(now, buf)
    }

    fn poll_event(&mut self) -> Option<Self::Event> {
        self.bus.poll_event().map(|event| (StationId::FIRST, event))
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.bus.poll_timeout()
    }
}

impl<B: Fieldbus> ControllerBus for OneStation<B> {
    fn stations(&self) -> u16 {
        1
    }

    fn byte_order(&self) -> Order {
        self.bus.byte_order()
    }

    fn set_output(&mut self, station: StationId, image: &Image) {
        if station == StationId::FIRST {
            self.bus.set_output(image);
        }
    }

    fn input(&self, station: StationId) -> Option<Image> {
        self.bus.input().filter(|_| station == StationId::FIRST)
    }

    fn received(&self, station: StationId) -> u64 {
        if station == StationId::FIRST { self.bus.received() } else { 0 }
    }

    fn poll_arrival(&mut self) -> Option<StationId> {
        let received = self.bus.received();
        (core::mem::replace(&mut self.received, received) != received).then_some(StationId::FIRST)
    }

    fn disconnect(&mut self, now: Instant, station: StationId) {
        if station == StationId::FIRST {
            self.bus.disconnect(now);
        }
    }

    fn explain(&self, _station: StationId, words: &mut dyn fmt::Write) -> fmt::Result {
        self.bus.explain(words)
    }

    fn remark(&self, _station: StationId, words: &mut dyn fmt::Write) -> fmt::Result {
        self.bus.remark(words)
    }

    fn counters(&self, station: StationId) -> Counters {
        if station == StationId::FIRST { self.bus.counters() } else { Counters::default() }
    }
}

/// The PLC's end of a bus as that of its first station alone.
#[derive(Clone, Debug)]
pub struct FirstStation<B> {
    /// The PLC's end.
    pub bus: B,
}

impl<B: ControllerBus> Machine for FirstStation<B> {
    type Event = LinkEvent;

    machine::forward_ports!(bus);

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.bus.handle_frame(now, from, frame);
    }

    fn handle_broadcast(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.bus.handle_broadcast(now, from, frame);
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        self.bus.handle_stream(now, stream, change);
    }

    fn handle_wrong_neighbour(&mut self, now: Instant, address: Ipv4Addr, found: Mac) {
        self.bus.handle_wrong_neighbour(now, address, found);
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.bus.handle_timeout(now);
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.bus.poll_transmit(now, buf)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.bus.poll_timeout()
    }

    fn poll_event(&mut self) -> Option<LinkEvent> {
        loop {
            let (station, event) = self.bus.poll_event()?;
            if station == StationId::FIRST {
                return Some(event);
            }
        }
    }
}

impl<B: ControllerBus> Fieldbus for FirstStation<B> {
    fn byte_order(&self) -> Order {
        self.bus.byte_order()
    }

    fn set_output(&mut self, image: &Image) {
        self.bus.set_output(StationId::FIRST, image);
    }

    fn input(&self) -> Option<Image> {
        self.bus.input(StationId::FIRST)
    }

    fn received(&self) -> u64 {
        self.bus.received(StationId::FIRST)
    }

    fn disconnect(&mut self, now: Instant) {
        self.bus.disconnect(now, StationId::FIRST);
    }

    fn explain(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        self.bus.explain(StationId::FIRST, words)
    }

    fn remark(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        self.bus.remark(StationId::FIRST, words)
    }

    fn counters(&self) -> Counters {
        self.bus.counters(StationId::FIRST)
    }
}
