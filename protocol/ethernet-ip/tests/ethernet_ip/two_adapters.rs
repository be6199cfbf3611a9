//! One scanner with connections to two adapters on one switch.

use std::net::Ipv4Addr;

use ethernet_ip::connection::RealTimeFormat;
use ethernet_ip::{Adapter, AdapterConfig, ConnectionConfig, ConnectionId, IO_PORT, Scanner};
use machine::ethernet::Mac;
use machine::{
    DownCause, Duration, Instant, InterfaceId, LinkEvent, Machine, Port, PortRequest, Source, StreamChange,
    StreamId, StreamRequest, Transmit,
};
use virtual_time::{Network, NodeId, StationConfig, SwitchConfig, SwitchId};

use crate::cell::adapter_config;
use crate::samples::{CONSUMED, DEVICE, LEN, PRODUCED};
use crate::single_connection::SCANNER;

/// Delay of the cable of each station: between two a frame takes twice as long.
const CABLE: Duration = Duration::from_nanos(12_500);

const SCANNER_ADDRESS: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 1);
const ADAPTERS: [Ipv4Addr; 2] = [Ipv4Addr::new(192, 168, 64, 2), Ipv4Addr::new(192, 168, 64, 3)];

/// A station of the network.
#[expect(clippy::large_enum_variant, reason = "there are few at a time")]
enum Station {
    Scanner(Scanner),
    Adapter(Adapter),
}

/// What a station reports; the connection if it is the scanner.
type Reported = (Option<ConnectionId>, LinkEvent);

macro_rules! each {
    ($station:ident, $machine:ident => $call:expr) => {
        match $station {
            Station::Scanner($machine) => $call,
            Station::Adapter($machine) => $call,
        }
    };
}

impl Machine for Station {
    type Event = Reported;

    fn ports(&self) -> &[PortRequest] {
        each!(self, machine => machine.ports())
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        each!(self, machine => machine.handle_frame(now, from, frame));
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        each!(self, machine => machine.handle_stream(now, stream, change));
    }

    fn listen_port(&self) -> Option<u16> {
        each!(self, machine => machine.listen_port())
    }

    fn poll_stream(&mut self) -> Option<StreamRequest> {
        each!(self, machine => machine.poll_stream())
    }

    fn group(&self, port: Port, index: usize) -> Option<Ipv4Addr> {
        each!(self, machine => machine.group(port, index))
    }

    fn handle_timeout(&mut self, now: Instant) {
        each!(self, machine => machine.handle_timeout(now));
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        each!(self, machine => machine.poll_transmit(now, buf))
    }

    fn poll_event(&mut self) -> Option<Reported> {
        match self {
            Self::Scanner(scanner) => scanner.poll_event().map(|(id, event)| (Some(id), event)),
            Self::Adapter(adapter) => adapter.poll_event().map(|event| (None, event)),
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        each!(self, machine => machine.poll_timeout())
    }
}

struct Cell {
    network: Network<Station>,
    scanner: NodeId,
    adapters: [NodeId; 2],
    connections: [ConnectionId; 2],
}

/// Returns a connection to the first adapter every 1 ms, or to the second every 2 ms.
fn wanted(index: usize, multicast: bool) -> ConnectionConfig {
    let config = ConnectionConfig::exclusive_owner(ADAPTERS[index], &DEVICE, 1_000 << index);
    ConnectionConfig { multicast, ..config }
}

impl Cell {
    fn new(multicast: bool) -> Self {
        let mut scanner = Scanner::new(SCANNER);
        let connections = [0, 1].map(|index| {
            let id = scanner.connect(wanted(index, multicast), Instant::from_millis(1)).unwrap();
            let connection = scanner.connection_mut(id).unwrap();
            connection.set_output(&[0xA0 + index as u8; LEN]).unwrap();
            id
        });
        let mut network = Network::with_switch(1, SwitchConfig::IDEAL);
        let adapters = [0, 1].map(|index| {
            let address = ADAPTERS[index];
            let mac = [2, 0, 0, 0, 0, 2 + index as u8];
            let config = AdapterConfig { address, mac, serial_number: 7 + index as u32, ..adapter_config() };
            let mut adapter = Adapter::new(config);
            adapter.set_produced(PRODUCED, &[0xD0 + index as u8; LEN]).unwrap();
            network.add_station(
                SwitchId::FIRST,
                "adapter",
                Station::Adapter(adapter),
                StationConfig::new(Mac(mac), Some(address), CABLE),
            )
        });
        let mac = Mac([2, 0, 0, 0, 0, 1]);
        let scanner = network.add_station(
            SwitchId::FIRST,
            "scanner",
            Station::Scanner(scanner),
            StationConfig::new(mac, Some(SCANNER_ADDRESS), CABLE),
        );
        Self { network, scanner, adapters, connections }
    }

    /// Runs for so many ms and returns what the scanner reports meanwhile.
    fn run(&mut self, millis: u64) -> Vec<(ConnectionId, LinkEvent)> {
        let until = self.network.now() + Duration::from_millis(millis);
        let next = || Some(self.network.next_event(until)?.1);
        std::iter::from_fn(next).filter_map(|(id, event)| Some((id?, event))).collect()
    }

    fn scanner<R>(&mut self, command: impl FnOnce(&mut Scanner, Instant) -> R) -> R {
        let command = |station: &mut Station, now| match station {
            Station::Scanner(scanner) => command(scanner, now),
            Station::Adapter(_) => panic!("the scanner is one"),
        };
        self.network.command(self.scanner, command).unwrap()
    }

    fn adapter<R>(&mut self, id: NodeId, command: impl FnOnce(&mut Adapter, Instant) -> R) -> R {
        let command = |station: &mut Station, now| match station {
            Station::Adapter(adapter) => command(adapter, now),
            Station::Scanner(_) => panic!("{id:?} is the scanner"),
        };
        self.network.command(id, command).unwrap()
    }

    /// Returns the first byte of the input of each connection, and of the consumed assembly of each adapter.
    fn data(&mut self) -> [[Option<u8>; 2]; 2] {
        let first = |data: Option<&[u8]>| data.map(|data| data[0]);
        let ids = self.connections;
        let inputs = self.scanner(|scanner, _| ids.map(|id| first(scanner.connection(id)?.input())));
        let outputs =
            self.adapters.map(|id| self.adapter(id, |adapter, _| first(adapter.consumed(CONSUMED))));
        [inputs, outputs]
    }
}

const DATA: [[Option<u8>; 2]; 2] = [[Some(0xD0), Some(0xD1)], [Some(0xA0), Some(0xA1)]];

#[test]
fn two_adapters_are_two_connections_of_one_scanner_on_one_port_2222() {
    for multicast in [false, true] {
        let mut cell = Cell::new(multicast);
        let mut up = cell.run(100);
        up.sort_by_key(|(id, _)| *id);
        assert_eq!(up, cell.connections.map(|id| (id, LinkEvent::Up)));
        assert_eq!(cell.data(), DATA);
        assert_eq!(cell.run(1_000), []);
        let ids = cell.connections;
        let (counters, groups) = cell.scanner(|scanner, _| {
            assert_eq!(scanner.counters(), machine::Counters::default(), "no frame belongs to no connection");
            let groups = (0..).map_while(|index| scanner.group(Port::Udp(IO_PORT), index));
            (ids.map(|id| scanner.connection(id).unwrap().counters()), groups.collect::<Vec<_>>())
        });
        assert!((1_080..=1_110).contains(&counters[0].received), "{counters:?}");
        assert!((540..=555).contains(&counters[1].received), "{counters:?}");
        assert!(counters.iter().all(|counters| counters.lost + counters.foreign == 0), "{counters:?}");
        assert_eq!(groups.len(), if multicast { 2 } else { 0 }, "{groups:?}");
    }
}

#[test]
fn an_adapter_that_is_gone_is_asked_again_and_the_other_one_misses_nothing() {
    let mut cell = Cell::new(false);
    cell.run(100);
    let second = cell.adapters[1];
    cell.network.set_address(second, InterfaceId::FIRST, None);
    let events = cell.run(5_000);
    let causes: Vec<_> = events
        .iter()
        .map(|(id, event)| match event {
            LinkEvent::Down(down) => (*id, Some(down.cause)),
            _ => (*id, None),
        })
        .collect();
    let lost = cell.connections[1];
    let expected = [DownCause::Watchdog, DownCause::NoAnswer].map(|cause| (lost, Some(cause)));
    assert_eq!(causes, expected, "{events:?}");
    assert_eq!(cell.data(), [[DATA[0][0], None], [DATA[1][0], None]]);
    cell.network.set_address(second, InterfaceId::FIRST, Some(ADAPTERS[1]));
    assert_eq!(cell.run(2_000), [(lost, LinkEvent::Up)]);
    assert_eq!(cell.data(), DATA);
    let first = cell.connections[0];
    let counters = cell.scanner(|scanner, _| scanner.connection(first).unwrap().counters());
    assert_eq!((counters.lost, counters.late), (0, 0));
}

#[test]
fn a_connection_that_is_removed_ends_its_tcp_connection_and_makes_room_for_a_new_one() {
    let mut cell = Cell::new(false);
    cell.run(100);
    let [first, second] = cell.connections;
    let adapter = cell.adapters[1];
    assert_eq!(cell.adapter(adapter, |adapter, _| adapter.sessions()), 1);
    cell.scanner(|scanner, _| assert!(scanner.remove(second).is_some()));
    cell.run(300);
    assert_eq!(cell.adapter(adapter, |adapter, _| (adapter.sessions(), adapter.connections().0)), (0, 0));
    let anew = cell.scanner(|scanner, now| {
        let id = scanner.connect(wanted(1, false), now).unwrap();
        scanner.connection_mut(id).unwrap().set_output(&[0xA1; LEN]).unwrap();
        id
    });
    assert_eq!(cell.run(100), [(anew, LinkEvent::Up)]);
    cell.connections = [first, anew];
    assert_eq!(cell.data(), DATA);
}

#[test]
fn two_connections_to_one_adapter_are_told_apart_by_their_numbers() {
    let mut cell = Cell::new(false);
    cell.run(100);
    // Takes the same data without owning the outputs.
    let listener = ConnectionConfig {
        consumed: 152,
        o_t_size: 0,
        consumed_format: RealTimeFormat::Heartbeat,
        ..wanted(0, false)
    };
    let id = cell.scanner(|scanner, now| scanner.connect(listener, now).unwrap());
    assert_eq!(cell.run(100), [(id, LinkEvent::Up)]);
    let input = cell.scanner(|scanner, _| scanner.connection(id).unwrap().input().map(|data| data[0]));
    assert_eq!(input, Some(0xD0));
    assert_eq!(cell.data(), DATA);
    let adapter = cell.adapters[0];
    assert_eq!(cell.adapter(adapter, |adapter, _| adapter.connections()), (2, 0));
}

#[test]
fn two_connections_that_take_part_in_one_multicast_of_an_adapter_both_get_its_frames() {
    let mut cell = Cell::new(true);
    cell.run(100);
    let viewer = ConnectionConfig {
        consumed: 152,
        o_t_size: 0,
        consumed_format: RealTimeFormat::Heartbeat,
        ..wanted(0, true)
    };
    let id = cell.scanner(|scanner, now| scanner.connect(viewer, now).unwrap());
    assert_eq!(cell.run(100), [(id, LinkEvent::Up)]);
    assert_eq!(cell.run(15_000), [], "neither watchdog expires");
    let input = cell.scanner(|scanner, _| scanner.connection(id).unwrap().input().map(|data| data[0]));
    assert_eq!(input, Some(0xD0));
    assert_eq!(cell.data(), DATA);
    let foreign = cell.scanner(|scanner, _| scanner.counters().foreign);
    assert_eq!(foreign, 0, "no frame belongs to no connection");
}
