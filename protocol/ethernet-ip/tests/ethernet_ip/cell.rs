//! Scanner and adapter on one cable.

use std::net::Ipv4Addr;

use crate::samples::DEVICE;
use crate::samples::LEN;
use crate::single_connection::SingleConnection;
use ethernet_ip::{Adapter, AdapterConfig, ConnectionConfig};
use machine::LinkEvent;
use machine::{Duration, Instant};
use virtual_time::{Clock, Event, Impairment, Pair, PairConfig};

pub(crate) const PLC: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 1);
pub(crate) const ROBOT: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 2);

pub(crate) type Bus = Pair<SingleConnection, Adapter>;
pub(crate) type News = Event<LinkEvent, LinkEvent>;

pub(crate) fn adapter_config() -> AdapterConfig {
    AdapterConfig {
        description: &DEVICE,
        serial_number: 0x1234_5678,
        address: ROBOT,
        mask: Ipv4Addr::new(255, 255, 255, 0),
        gateway: Ipv4Addr::UNSPECIFIED,
        mac: [2, 0, 0, 0, 0, 2],
        first_id: 0x0100_0000,
        originators: machine::Allowed::default(),
    }
}

pub(crate) fn adapter() -> Adapter {
    Adapter::new(adapter_config())
}

/// Returns a scanner that wants the outputs of the robot, every millisecond.
pub(crate) fn wanted() -> ConnectionConfig {
    ConnectionConfig::exclusive_owner(ROBOT, &DEVICE, 1_000)
}

/// Returns a cable with a delay of 25 µs that loses nothing.
pub(crate) fn cable() -> Impairment {
    Impairment { delay: Duration::from_micros(25), ..Impairment::default() }
}

pub(crate) fn bus_of(config: ConnectionConfig, link: Impairment, seed: u64) -> Bus {
    let clocks = [Clock::default(), Clock { offset_ns: 123_456_789, drift_ppb: 30_000 }];
    let pair = PairConfig { seed, clocks, links: [link; 2], addresses: [Some(PLC), Some(ROBOT)] };
    Pair::new(SingleConnection::new(config, Instant::from_millis(1)), adapter(), pair)
}

/// Runs for a time and returns what happened, each with the true time in ms, besides who opened the connection.
pub(crate) fn run(bus: &mut Bus, millis: u64) -> Vec<(u64, News)> {
    let until = bus.now() + Duration::from_millis(millis);
    let mut events = Vec::new();
    while let Some(event) = bus.next_event(until) {
        if !matches!(event, Event::B(LinkEvent::Owner(_))) {
            events.push((bus.now().as_nanos() / 1_000_000, event));
        }
    }
    events
}

/// Returns a bus that is up, 50 ms after the start.
pub(crate) fn up(config: ConnectionConfig) -> Bus {
    let mut bus = bus_of(config, cable(), 1);
    let events: Vec<_> = run(&mut bus, 50).into_iter().map(|(_, event)| event).collect();
    let refusal = bus.a().connection().refusal().map(ToString::to_string);
    assert!(events.contains(&Event::A(LinkEvent::Up)), "{events:?}, {refusal:?}");
    assert!(events.contains(&Event::B(LinkEvent::Up)), "{events:?}, {refusal:?}");
    bus
}

/// Returns data in which every byte shows its position.
pub(crate) fn data(first: u8) -> [u8; LEN] {
    core::array::from_fn(|index| first.wrapping_add(index as u8))
}
