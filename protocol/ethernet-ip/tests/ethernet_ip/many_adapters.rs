//! One scanner with connections to 64 adapters on one switch.

use std::net::{Ipv4Addr, SocketAddrV4};

use ethernet_ip::{Adapter, AdapterConfig, ConnectionConfig, ConnectionId, IO_PORT, Scanner, class1};
use machine::ethernet::Mac;
use machine::{
    DownCause, Duration, Instant, LinkEvent, Machine, Port, PortRequest, Source, StreamChange, StreamId,
    StreamRequest, Transmit,
};
use virtual_time::{Network, NodeId, StationConfig, SwitchConfig, SwitchId};

use crate::cell::adapter_config;
use crate::samples::{CONSUMED, DEVICE, LEN, PRODUCED};
use crate::single_connection::SCANNER;

/// Half of what a frame takes from one station to another, since the switch takes no time.
const CABLE: Duration = Duration::from_nanos(12_500);

const ADAPTERS: usize = 64;
const SCANNER_ADDRESS: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 1);

/// A station of the network.
#[expect(clippy::large_enum_variant, reason = "there are few at a time")]
enum Station {
    Scanner(Scanner),
    Adapter(Adapter),
    /// It does not answer.
    Dead,
}

impl Machine for Station {
    type Event = (Option<ConnectionId>, LinkEvent);

    fn ports(&self) -> &[PortRequest] {
        match self {
            Self::Scanner(scanner) => scanner.ports(),
            Self::Adapter(adapter) => adapter.ports(),
            Self::Dead => &[],
        }
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        match self {
            Self::Scanner(scanner) => scanner.handle_frame(now, from, frame),
            Self::Adapter(adapter) => adapter.handle_frame(now, from, frame),
            Self::Dead => {}
        }
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        match self {
            Self::Scanner(scanner) => scanner.handle_stream(now, stream, change),
            Self::Adapter(adapter) => adapter.handle_stream(now, stream, change),
            Self::Dead => {}
        }
    }

    fn listen_port(&self) -> Option<u16> {
        match self {
            Self::Adapter(adapter) => adapter.listen_port(),
            Self::Scanner(_) | Self::Dead => None,
        }
    }

    fn poll_stream(&mut self) -> Option<StreamRequest> {
        match self {
            Self::Scanner(scanner) => scanner.poll_stream(),
            Self::Adapter(adapter) => adapter.poll_stream(),
            Self::Dead => None,
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        match self {
            Self::Scanner(scanner) => scanner.handle_timeout(now),
            Self::Adapter(adapter) => adapter.handle_timeout(now),
            Self::Dead => {}
        }
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        match self {
            Self::Scanner(scanner) => scanner.poll_transmit(now, buf),
            Self::Adapter(adapter) => adapter.poll_transmit(now, buf),
            Self::Dead => None,
        }
    }

    fn poll_event(&mut self) -> Option<Self::Event> {
        match self {
            Self::Scanner(scanner) => scanner.poll_event().map(|(id, event)| (Some(id), event)),
            Self::Adapter(adapter) => adapter.poll_event().map(|event| (None, event)),
            Self::Dead => None,
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        match self {
            Self::Scanner(scanner) => scanner.poll_timeout(),
            Self::Adapter(adapter) => adapter.poll_timeout(),
            Self::Dead => None,
        }
    }
}

struct Cell {
    network: Network<Station>,
    scanner: NodeId,
    adapters: Vec<NodeId>,
    connections: Vec<ConnectionId>,
}

fn address(adapter: usize) -> Ipv4Addr {
    Ipv4Addr::new(192, 168, 64, 2 + adapter as u8)
}

impl Cell {
    /// Creates a scanner and adapters that exchange data every 1 ms: inputs are the adapter's number, outputs its complement.
    fn new() -> Self {
        let mut scanner = Scanner::new(SCANNER);
        let mut network = Network::with_switch(1, SwitchConfig::IDEAL);
        let (mut adapters, mut connections) = (Vec::new(), Vec::new());
        for index in 0..ADAPTERS {
            let config = ConnectionConfig::exclusive_owner(address(index), &DEVICE, 1_000);
            let id = scanner.connect(config, Instant::from_millis(1)).unwrap();
            scanner.connection_mut(id).unwrap().set_output(&[!index as u8; LEN]).unwrap();
            connections.push(id);
            let mac = [2, 0, 0, 0, 0, 2 + index as u8];
            let serial_number = 7 + index as u32;
            let config = AdapterConfig { address: address(index), mac, serial_number, ..adapter_config() };
            let mut adapter = Adapter::new(config);
            adapter.set_produced(PRODUCED, &[index as u8; LEN]).unwrap();
            adapters.push(network.add_station(
                SwitchId::FIRST,
                "adapter",
                Station::Adapter(adapter),
                StationConfig::new(Mac(mac), Some(address(index)), CABLE),
            ));
        }
        let mac = Mac([2, 0, 0, 0, 0, 1]);
        let scanner = network.add_station(
            SwitchId::FIRST,
            "scanner",
            Station::Scanner(scanner),
            StationConfig::new(mac, Some(SCANNER_ADDRESS), CABLE),
        );
        Self { network, scanner, adapters, connections }
    }

    /// Runs for so many ms and returns what the scanner reports meanwhile, by adapter.
    fn run(&mut self, millis: u64) -> Vec<(usize, LinkEvent)> {
        let until = self.network.now() + Duration::from_millis(millis);
        let mut reported = Vec::new();
        while let Some((_, (id, event))) = self.network.next_event(until) {
            let adapter = id.and_then(|id| self.connections.iter().position(|known| *known == id));
            reported.extend(adapter.map(|adapter| (adapter, event)));
        }
        reported
    }

    fn scanner<R>(&mut self, command: impl FnOnce(&mut Scanner, Instant) -> R) -> R {
        let command = |station: &mut Station, now| match station {
            Station::Scanner(scanner) => command(scanner, now),
            _ => panic!("the scanner is one"),
        };
        self.network.command(self.scanner, command).unwrap()
    }

    /// Returns the first byte of the input and of the output of an adapter.
    fn data(&mut self, adapter: usize) -> (Option<u8>, Option<u8>) {
        let first = |data: Option<&[u8]>| data.map(|data| data[0]);
        let id = self.connections[adapter];
        let input = self.scanner(|scanner, _| first(scanner.connection(id)?.input()));
        let command = |station: &mut Station, _| match station {
            Station::Adapter(adapter) => first(adapter.consumed(CONSUMED)),
            _ => None,
        };
        (input, self.network.command(self.adapters[adapter], command).unwrap())
    }

    fn has_data(&mut self, adapter: usize) -> bool {
        self.data(adapter) == (Some(adapter as u8), Some(!adapter as u8))
    }

    fn counters(&mut self, adapter: usize) -> machine::Counters {
        let id = self.connections[adapter];
        self.scanner(|scanner, _| scanner.connection(id).unwrap().counters())
    }
}

#[test]
fn sixty_four_adapters_at_1_ms_have_their_own_data_and_miss_no_frame_in_10_s() {
    let mut cell = Cell::new();
    let up = cell.run(2_000);
    assert_eq!(up.len(), ADAPTERS);
    assert!(up.iter().all(|(_, event)| *event == LinkEvent::Up), "{up:?}");
    let before: Vec<_> = (0..ADAPTERS).map(|adapter| cell.counters(adapter)).collect();
    assert_eq!(cell.run(10_000), []);
    for (adapter, before) in before.iter().enumerate() {
        let counted = cell.counters(adapter).since(before);
        assert_eq!((counted.received, counted.sent), (10_000, 10_000), "{adapter}");
        assert_eq!((counted.lost, counted.late, counted.skipped, counted.foreign), (0, 0, 0, 0));
        assert!(cell.has_data(adapter));
    }
}

#[test]
fn one_lost_adapter_among_64_is_named_and_does_not_disturb_the_others() {
    let mut cell = Cell::new();
    cell.run(2_000);
    let lost = cell.adapters[17];
    cell.network.command(lost, |station: &mut Station, _| *station = Station::Dead).unwrap();
    let events = cell.run(3_000);
    assert!(events.iter().all(|(adapter, _)| *adapter == 17), "{events:?}");
    let Some((17, LinkEvent::Down(down))) = events.first() else { panic!("{events:?}") };
    assert_eq!(down.cause, DownCause::Watchdog);
    for adapter in (0..ADAPTERS).filter(|adapter| *adapter != 17) {
        let counters = cell.counters(adapter);
        assert_eq!((counters.lost, counters.late), (0, 0), "{adapter}");
        assert!(cell.has_data(adapter));
    }
}

#[test]
fn cyclic_frames_of_strangers_and_with_foreign_connection_numbers_are_counted_and_change_nothing() {
    let mut cell = Cell::new();
    cell.run(2_000);
    for (number, from) in [(0xDEAD_BEEF, address(3)), (1, Ipv4Addr::new(192, 168, 64, 200))] {
        let mut frame = [0; 512];
        let len = class1::emit(&mut frame, (number, 1, 1), Some(true), &[9; LEN]).unwrap();
        let from = Source { port: Port::Udp(IO_PORT), peer: Some(SocketAddrV4::new(from, IO_PORT)) };
        let foreign = cell.scanner(|scanner, now| {
            let before = scanner.counters().foreign;
            (0..100).for_each(|_| scanner.handle_frame(now, from, &frame[..len]));
            scanner.counters().foreign - before
        });
        assert_eq!(foreign, 100);
        assert_eq!(cell.run(100), []);
    }
    assert!((0..ADAPTERS).all(|adapter| cell.has_data(adapter)));
}
