//! One node's endpoint on the bus that its setup names.

use core::fmt;
use core::net::Ipv4Addr;

use machine::ethernet::Mac;
use machine::{
    Counters, Instant, LinkStatus, Machine, Pending, Port, PortRequest, Source, StreamChange, StreamId,
    StreamRequest, Transmit,
};

use crate::fieldbus::{ControllerBus, Fieldbus, StationId, ToStore};
use crate::image::{Image, Order};

/// An endpoint on one of the buses, as one type.
#[derive(Debug)]
pub enum Endpoint<P, E, C> {
    /// On PROFINET.
    Profinet(P),
    /// On EtherNet/IP.
    EthernetIp(E),
    /// On EtherCAT.
    Ethercat(C),
}

/// Evaluates an expression for the endpoint of the setup's bus.
macro_rules! on {
    ($endpoint:expr, $bus:ident => $value:expr) => {
        match $endpoint {
            Endpoint::Profinet($bus) => $value,
            Endpoint::EthernetIp($bus) => $value,
            Endpoint::Ethercat($bus) => $value,
        }
    };
}

impl<V, P, E, C> Machine for Endpoint<P, E, C>
where
    P: Machine<Event = V>,
    E: Machine<Event = V>,
    C: Machine<Event = V>,
{
    type Event = V;

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        on!(self, bus => bus.handle_frame(now, from, frame));
    }

    fn handle_broadcast(&mut self, now: Instant, from: Source, frame: &[u8]) {
        on!(self, bus => bus.handle_broadcast(now, from, frame));
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        on!(self, bus => bus.handle_stream(now, stream, change));
    }

    fn ports(&self) -> &[PortRequest] {
        on!(self, bus => bus.ports())
    }

    fn listen_port(&self) -> Option<u16> {
        on!(self, bus => bus.listen_port())
    }

    fn poll_stream(&mut self) -> Option<StreamRequest> {
        on!(self, bus => bus.poll_stream())
    }

    fn dscp(&self, port: Port) -> u8 {
        on!(self, bus => bus.dscp(port))
    }

    fn group(&self, port: Port, index: usize) -> Option<Ipv4Addr> {
        on!(self, bus => bus.group(port, index))
    }

    fn neighbour(&self, address: Ipv4Addr) -> Option<Mac> {
        on!(self, bus => bus.neighbour(address))
    }

    fn handle_wrong_neighbour(&mut self, now: Instant, address: Ipv4Addr, found: Mac) {
        on!(self, bus => bus.handle_wrong_neighbour(now, address, found));
    }

    fn handle_timeout(&mut self, now: Instant) {
        on!(self, bus => bus.handle_timeout(now));
    }

    fn pending(&self, now: Instant) -> Pending {
        on!(self, bus => bus.pending(now))
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        on!(self, bus => bus.poll_transmit(now, buf))
    }

    fn poll_event(&mut self) -> Option<V> {
        on!(self, bus => bus.poll_event())
    }

    fn poll_timeout(&self) -> Option<Instant> {
        on!(self, bus => bus.poll_timeout())
    }
}

impl<P: Fieldbus, E: Fieldbus, C: Fieldbus> Fieldbus for Endpoint<P, E, C> {
    fn byte_order(&self) -> Order {
        on!(self, bus => bus.byte_order())
    }

    fn set_output(&mut self, image: &Image) {
        on!(self, bus => bus.set_output(image));
    }

    fn input(&self) -> Option<Image> {
        on!(self, bus => bus.input())
    }

    fn has_input(&self) -> bool {
        on!(self, bus => bus.has_input())
    }

    fn disconnect(&mut self, now: Instant) {
        on!(self, bus => Fieldbus::disconnect(bus, now));
    }

    fn explain(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        on!(self, bus => bus.explain(words))
    }

    fn remark(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        on!(self, bus => bus.remark(words))
    }

    fn write_request(&self, words: &mut dyn fmt::Write) -> fmt::Result {
        on!(self, bus => Fieldbus::write_request(bus, words))
    }

    fn counters(&self) -> Counters {
        on!(self, bus => Fieldbus::counters(bus))
    }

    fn received(&self) -> u64 {
        on!(self, bus => Fieldbus::received(bus))
    }

    fn address_set(&mut self, now: Instant, done: bool) {
        on!(self, bus => Fieldbus::address_set(bus, now, done));
    }

    fn wants_link(&self) -> bool {
        on!(self, bus => Fieldbus::wants_link(bus))
    }

    fn set_link(&mut self, status: &LinkStatus) {
        on!(self, bus => Fieldbus::set_link(bus, status));
    }

    fn to_store(&self) -> ToStore<'_> {
        on!(self, bus => Fieldbus::to_store(bus))
    }

    fn stored(&mut self, now: Instant, done: bool) {
        on!(self, bus => Fieldbus::stored(bus, now, done));
    }
}

impl<P: ControllerBus, E: ControllerBus, C: ControllerBus> ControllerBus for Endpoint<P, E, C> {
    fn stations(&self) -> u16 {
        on!(self, bus => bus.stations())
    }

    fn byte_order(&self) -> Order {
        on!(self, bus => bus.byte_order())
    }

    fn set_output(&mut self, station: StationId, image: &Image) {
        on!(self, bus => bus.set_output(station, image));
    }

    fn input(&self, station: StationId) -> Option<Image> {
        on!(self, bus => bus.input(station))
    }

    fn repeats(&self, station: StationId, image: &Image) -> bool {
        on!(self, bus => bus.repeats(station, image))
    }

    fn poll_arrival(&mut self) -> Option<StationId> {
        on!(self, bus => bus.poll_arrival())
    }

    fn disconnect(&mut self, now: Instant, station: StationId) {
        on!(self, bus => bus.disconnect(now, station));
    }

    fn explain(&self, station: StationId, words: &mut dyn fmt::Write) -> fmt::Result {
        on!(self, bus => bus.explain(station, words))
    }

    fn remark(&self, station: StationId, words: &mut dyn fmt::Write) -> fmt::Result {
        on!(self, bus => bus.remark(station, words))
    }

    fn write_identity(&self, station: StationId, words: &mut dyn fmt::Write) -> fmt::Result {
        on!(self, bus => bus.write_identity(station, words))
    }

    fn counters(&self, station: StationId) -> Counters {
        on!(self, bus => bus.counters(station))
    }

    fn received(&self, station: StationId) -> u64 {
        on!(self, bus => ControllerBus::received(bus, station))
    }
}
