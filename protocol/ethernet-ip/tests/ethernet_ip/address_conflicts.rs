//! Stations that have the same IP address, on one switch: both ends detect them and say who they are.

use std::net::Ipv4Addr;

use ethernet_ip::{Adapter, AdapterConfig, ConnectionId, Scanner};
use machine::arp::{self, AddressConflict, ArpPacket};
use machine::ethernet::Mac;
use machine::{
    Down, DownCause, Duration, Instant, InterfaceId, LinkEvent, Machine, Port, PortRequest, Source,
    StationConflict, StreamChange, StreamId, StreamRequest, Transmit,
};
use virtual_time::{Network, NodeId, StationConfig, SwitchConfig, SwitchId};

use crate::cell::{PLC, ROBOT, adapter_config, wanted};
use crate::single_connection::SCANNER;

/// Delay of the cable of each station: between two a frame takes twice as long.
const CABLE: Duration = Duration::from_nanos(12_500);

const MASK: Ipv4Addr = Ipv4Addr::new(255, 255, 255, 0);
const ELSEWHERE: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 77);
const PLC_MAC: Mac = Mac([2, 0, 0, 0, 0, 1]);
const ROBOT_MAC: Mac = Mac([2, 0, 0, 0, 0, 2]);
const STRANGER_MAC: Mac = Mac([2, 0, 0, 0, 0, 9]);

#[expect(clippy::large_enum_variant, reason = "there are few at a time")]
enum Station {
    Scanner(Scanner),
    Adapter(Adapter),
    /// Somebody with an operating system, which answers ARP, and a packet to send.
    Stranger(Option<ArpPacket>),
}

impl Machine for Station {
    type Event = (Option<ConnectionId>, LinkEvent);

    fn ports(&self) -> &[PortRequest] {
        match self {
            Self::Scanner(scanner) => scanner.ports(),
            Self::Adapter(adapter) => adapter.ports(),
            Self::Stranger(_) => &[arp::ETHERNET],
        }
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        match self {
            Self::Scanner(scanner) => scanner.handle_frame(now, from, frame),
            Self::Adapter(adapter) => adapter.handle_frame(now, from, frame),
            Self::Stranger(_) => {}
        }
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        match self {
            Self::Scanner(scanner) => scanner.handle_stream(now, stream, change),
            Self::Adapter(adapter) => adapter.handle_stream(now, stream, change),
            Self::Stranger(_) => {}
        }
    }

    fn listen_port(&self) -> Option<u16> {
        match self {
            Self::Adapter(adapter) => adapter.listen_port(),
            _ => None,
        }
    }

    fn poll_stream(&mut self) -> Option<StreamRequest> {
        match self {
            Self::Scanner(scanner) => scanner.poll_stream(),
            Self::Adapter(adapter) => adapter.poll_stream(),
            Self::Stranger(_) => None,
        }
    }

    fn neighbour(&self, address: Ipv4Addr) -> Option<Mac> {
        match self {
            Self::Scanner(scanner) => scanner.neighbour(address),
            _ => None,
        }
    }

    fn handle_wrong_neighbour(&mut self, now: Instant, address: Ipv4Addr, found: Mac) {
        if let Self::Scanner(scanner) = self {
            scanner.handle_wrong_neighbour(now, address, found);
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        match self {
            Self::Scanner(scanner) => scanner.handle_timeout(now),
            Self::Adapter(adapter) => adapter.handle_timeout(now),
            Self::Stranger(_) => {}
        }
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        match self {
            Self::Scanner(scanner) => scanner.poll_transmit(now, buf),
            Self::Adapter(adapter) => adapter.poll_transmit(now, buf),
            Self::Stranger(packet) => {
                let len = packet.take()?.emit_frame(buf).unwrap();
                Some(Transmit { port: Port::Ethernet, to: None, len })
            }
        }
    }

    fn poll_event(&mut self) -> Option<Self::Event> {
        match self {
            Self::Scanner(scanner) => scanner.poll_event().map(|(id, event)| (Some(id), event)),
            Self::Adapter(adapter) => adapter.poll_event().map(|event| (None, event)),
            Self::Stranger(_) => None,
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        match self {
            Self::Scanner(scanner) => scanner.poll_timeout(),
            Self::Adapter(adapter) => adapter.poll_timeout(),
            Self::Stranger(_) => None,
        }
    }
}

struct Cell {
    network: Network<Station>,
    plc: NodeId,
    robot: NodeId,
    connection: ConnectionId,
    strangers: Vec<NodeId>,
    events: Vec<(NodeId, Instant, LinkEvent)>,
}

impl Cell {
    /// A scanner and an adapter; strangers are on the switch before them.
    fn with(strangers: &[(Mac, Ipv4Addr)]) -> Self {
        let mut network = Network::with_switch(1, SwitchConfig::IDEAL);
        let add = |(mac, address): &(Mac, Ipv4Addr)| {
            network.add_station(
                SwitchId::FIRST,
                "stranger",
                Station::Stranger(None),
                StationConfig::new(*mac, Some(*address), CABLE),
            )
        };
        let strangers = strangers.iter().map(add).collect();
        let now = network.now();
        let adapter = Adapter::new(AdapterConfig { mac: ROBOT_MAC.0, ..adapter_config() });
        let robot = network.add_station(
            SwitchId::FIRST,
            "adapter",
            Station::Adapter(adapter.with_conflict_detection(now)),
            StationConfig::new(ROBOT_MAC, Some(ROBOT), CABLE),
        );
        let mut scanner = Scanner::new(SCANNER).with_conflict_detection(PLC_MAC, PLC, MASK, now);
        let connection = scanner.connect(wanted(), now).unwrap();
        let plc = network.add_station(
            SwitchId::FIRST,
            "scanner",
            Station::Scanner(scanner),
            StationConfig::new(PLC_MAC, Some(PLC), CABLE),
        );
        Self { network, plc, robot, connection, strangers, events: Vec::new() }
    }

    fn run(&mut self, millis: u64) {
        let until = self.network.now() + Duration::from_millis(millis);
        while let Some((id, (_, event))) = self.network.next_event(until) {
            self.events.push((id, self.network.now(), event));
        }
    }

    fn of(&self, id: NodeId) -> Vec<LinkEvent> {
        let its = self.events.iter().filter(|(of, ..)| *of == id).map(|(.., event)| *event);
        its.filter(|event| !matches!(event, LinkEvent::Owner(_))).collect()
    }

    fn words(&self) -> String {
        let mut words = String::new();
        if let Some(Station::Scanner(scanner)) = self.network.machine(self.plc) {
            scanner.connection(self.connection).unwrap().explain(&mut words).unwrap();
        }
        words
    }

    /// Lets a new station say that it has an address.
    fn claims(&mut self, mac: Mac, address: Ipv4Addr) {
        let announcement = ArpPacket::announcement(mac, address);
        self.network.add_station(
            SwitchId::FIRST,
            "stranger",
            Station::Stranger(Some(announcement)),
            StationConfig::new(mac, Some(address), CABLE),
        );
    }

    /// Returns how many connections the robot has.
    fn connections(&self) -> usize {
        match self.network.machine(self.robot) {
            Some(Station::Adapter(adapter)) => adapter.connections().0,
            _ => panic!("it is an adapter"),
        }
    }
}

fn is_refusal(event: &LinkEvent) -> bool {
    matches!(event, LinkEvent::Down(Down { cause: DownCause::Refused, .. }))
}

fn conflict(address: Ipv4Addr, mac: Mac) -> LinkEvent {
    LinkEvent::Conflict(StationConflict::Address(AddressConflict { address, mac }))
}

#[test]
fn without_a_conflict_data_flow_within_400_ms_of_the_start() {
    let mut cell = Cell::with(&[(STRANGER_MAC, ELSEWHERE)]);
    cell.run(1_000);
    assert_eq!(cell.of(cell.plc), [LinkEvent::Up]);
    assert_eq!(cell.of(cell.robot), [LinkEvent::Up]);
    let last = cell.events.iter().map(|(_, at, _)| *at).max().unwrap();
    assert!(last < Instant::from_millis(100), "{:?}", cell.events);
}

#[test]
fn a_stranger_with_the_robot_s_address_is_named_by_both_ends_and_nothing_is_opened() {
    let mut cell = Cell::with(&[(STRANGER_MAC, ROBOT)]);
    cell.run(30_000);
    let plc = cell.of(cell.plc);
    assert_eq!(plc.len(), 1, "{plc:?}");
    assert!(is_refusal(&plc[0]), "{plc:?}");
    let words = cell.words();
    for part in [&ROBOT.to_string(), &ROBOT_MAC.to_string(), &STRANGER_MAC.to_string()] {
        assert!(words.contains(part.as_str()), "{words}");
    }
    assert_eq!(cell.of(cell.robot), [conflict(ROBOT, STRANGER_MAC)]);
    assert_eq!(cell.connections(), 0);
}

#[test]
fn a_stranger_with_the_plc_s_address_is_named_and_nothing_is_opened() {
    let mut cell = Cell::with(&[(STRANGER_MAC, PLC)]);
    cell.run(30_000);
    let plc = cell.of(cell.plc);
    assert_eq!(plc.len(), 1, "{plc:?}");
    assert!(is_refusal(&plc[0]), "{plc:?}");
    let words = cell.words();
    for part in [&PLC.to_string(), &PLC_MAC.to_string(), &STRANGER_MAC.to_string()] {
        assert!(words.contains(part.as_str()), "{words}");
    }
    assert_eq!(cell.of(cell.robot), []);
}

#[test]
fn a_stranger_that_comes_while_data_flow_is_named_by_its_owner_and_the_connection_stays() {
    for (address, of_robot) in [(ROBOT, true), (PLC, false)] {
        let mut cell = Cell::with(&[]);
        cell.run(500);
        cell.claims(STRANGER_MAC, address);
        cell.run(5_000);
        let expected = [LinkEvent::Up, conflict(address, STRANGER_MAC)];
        // The PLC hears of both: its own address, and that of its adapter.
        assert_eq!(cell.of(cell.plc), expected);
        assert_eq!(cell.of(cell.robot), expected[..if of_robot { 2 } else { 1 }]);
        assert_eq!(cell.connections(), 1);
    }
}

#[test]
fn when_the_stranger_has_another_address_the_connection_comes_within_two_seconds() {
    for address in [ROBOT, PLC] {
        let mut cell = Cell::with(&[(STRANGER_MAC, address)]);
        cell.run(5_000);
        let moved = cell.network.now();
        for id in cell.strangers.clone() {
            cell.network.set_address(id, InterfaceId::FIRST, Some(ELSEWHERE));
        }
        cell.run(2_500);
        let up = cell.events.iter().find(|(id, _, event)| *id == cell.plc && *event == LinkEvent::Up);
        let (_, at, _) = up.unwrap_or_else(|| panic!("{address}: {:?}", cell.events));
        assert!(at.since(moved) < Duration::from_secs(2), "{at:?}");
    }
}
