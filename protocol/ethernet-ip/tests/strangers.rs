//! A stranger changes nothing between a scanner and its adapter.
//!
//! The pair connects, exchanges data and parts, once alone and once while a host with another address sends altered
//! copies of all its messages and frames, also of those that the pair sends later, to both: over UDP and over up to 24 TCP
//! connections with sessions of their own. The pair must send the same bytes at the same instants and report the same
//! events, and while data are exchanged nothing of the stranger may cost heap memory. `STRANGER_RUNS` sets the number of
//! runs.

#![expect(clippy::unwrap_used, reason = "a test fails by a panic")]

use std::net::{Ipv4Addr, SocketAddrV4};

use ethernet_ip::{
    Adapter, AdapterConfig, ConnectionConfig, ConnectionId, ENCAPSULATION_PORT, Scanner, ScannerConfig,
};
use machine::ethernet::Mac;
use machine::{Allowed, Duration, Instant, LinkEvent, Peer};
use protocol_linux::allocation::{self, AllocationCounter};
use virtual_time::hostile::{Member, MemberEvent, STRANGER, STRANGER_MAC, Sent, Stranger, Watched};
use virtual_time::{Network, StationId};

#[path = "ethernet_ip/samples.rs"]
mod samples;

use samples::{CONSUMED, DEVICE, LEN, PRODUCED};

#[global_allocator]
static ALLOCATOR: AllocationCounter = AllocationCounter;

const STATIONS: [(Mac, Ipv4Addr); 2] = [
    (Mac([2, 0, 0, 0, 0, 1]), Ipv4Addr::new(192, 168, 64, 1)),
    (Mac([2, 0, 0, 0, 0, 2]), Ipv4Addr::new(192, 168, 64, 2)),
];

/// An event of the scanner or of the adapter, and when.
type Reported = (Instant, MemberEvent<LinkEvent, LinkEvent>);

struct Cell {
    network: Network<Member<Scanner, Adapter>>,
    scanner: StationId,
    adapter: StationId,
    connection: ConnectionId,
    events: Vec<Reported>,
    images: Vec<[Option<u8>; 2]>,
}

/// What a run left behind.
#[derive(PartialEq)]
struct Record {
    sent: [Vec<Sent>; 2],
    events: Vec<Reported>,
    images: Vec<[Option<u8>; 2]>,
}

impl Cell {
    /// Creates a pair whose adapter lists its scanner if `listed`.
    fn new(listed: bool) -> Self {
        let [(scanner_mac, plc), (adapter_mac, robot)] = STATIONS;
        let mut master =
            Scanner::new(ScannerConfig { vendor: 0xFFFF, serial_number: 1, first_id: 0x5C00_0000 });
        let config = ConnectionConfig::exclusive_owner(robot, &DEVICE, 1_000);
        let connection = master.connect(config, Instant::ZERO).unwrap();
        let listed_peer = Peer { address: Some(plc), mac: None, serial_number: Some(1) };
        let slave = Adapter::new(AdapterConfig {
            description: &DEVICE,
            serial_number: 0x1234_5678,
            address: robot,
            mask: Ipv4Addr::new(255, 255, 255, 0),
            gateway: Ipv4Addr::UNSPECIFIED,
            mac: adapter_mac.0,
            first_id: 0x0100_0000,
            originators: Allowed(if listed { vec![listed_peer] } else { Vec::new() }),
        });
        let mut network = Network::new(Duration::from_micros(25));
        let adapter =
            network.add(Member::B(Watched::new(slave, allocation::count)), adapter_mac, Some(robot));
        let scanner = network.add(Member::A(Watched::new(master, allocation::count)), scanner_mac, Some(plc));
        Self { network, scanner, adapter, connection, events: Vec::new(), images: Vec::new() }
    }

    fn scanner<R>(&mut self, command: impl FnOnce(&mut Watched<Scanner>, Instant) -> R) -> R {
        let done = self.network.command(self.scanner, |station, now| match station {
            Member::A(watched) => Some(command(watched, now)),
            _ => None,
        });
        done.flatten().unwrap()
    }

    fn adapter<R>(&mut self, command: impl FnOnce(&mut Watched<Adapter>, Instant) -> R) -> R {
        let done = self.network.command(self.adapter, |station, now| match station {
            Member::B(watched) => Some(command(watched, now)),
            _ => None,
        });
        done.flatten().unwrap()
    }

    /// Runs to `until`; both sides change their data every millisecond.
    fn run(&mut self, until: Instant) {
        while self.network.now() < until {
            let step = self.network.now() + Duration::from_millis(1);
            while let Some((_, event)) = self.network.next_event(step) {
                let now = self.network.now();
                match event {
                    MemberEvent::A((_, LinkEvent::Foreign(_))) | MemberEvent::B(LinkEvent::Foreign(_)) => {}
                    MemberEvent::A((_, event)) => self.events.push((now, MemberEvent::A(event))),
                    MemberEvent::B(event) => self.events.push((now, MemberEvent::B(event))),
                }
            }
            let value = (self.images.len() % 251) as u8;
            let connection = self.connection;
            let input = self.scanner(|scanner, _| {
                let connection = scanner.machine.connection_mut(connection)?;
                connection.set_output(&[value; LEN]).unwrap();
                connection.input().map(|data| data[0])
            });
            let output = self.adapter(|adapter, _| {
                adapter.machine.set_produced(PRODUCED, &[value; LEN]).unwrap();
                adapter.machine.consumed(CONSUMED).map(|data| data[0])
            });
            self.images.push([input, output]);
        }
    }

    /// Connects, exchanges data for 300 ms, parts, and waits; returns what was sent and reported.
    fn whole_life(mut self, stranger: Option<Stranger>) -> (Record, [u64; 2]) {
        if let Some(stranger) = stranger {
            self.network.add(Member::Stranger(stranger), STRANGER_MAC, Some(STRANGER));
        }
        self.run(Instant::from_millis(50));
        let before = [self.scanner(|s, _| s.allocations), self.adapter(|a, _| a.allocations)];
        self.run(Instant::from_millis(350));
        let after = [self.scanner(|s, _| s.allocations), self.adapter(|a, _| a.allocations)];
        assert_eq!(after, before, "allocations for a stranger while data are exchanged");
        let foreign = [self.scanner(|s, _| s.foreign), self.adapter(|a, _| a.foreign)];
        let connection = self.connection;
        self.scanner(|scanner, now| {
            scanner.machine.connection_mut(connection).map(|connection| connection.disconnect(now))
        });
        self.run(Instant::from_millis(360));
        let sent = [
            self.scanner(|s, _| core::mem::take(&mut s.sent)),
            self.adapter(|a, _| core::mem::take(&mut a.sent)),
        ];
        (Record { sent, events: self.events, images: self.images }, foreign)
    }
}

/// Returns the first frame that differs.
fn difference(alone: &Record, disturbed: &Record) -> String {
    for (side, name) in ["scanner", "adapter"].into_iter().enumerate() {
        let pairs = alone.sent[side].iter().zip(&disturbed.sent[side]);
        if let Some((one, other)) = pairs.into_iter().find(|(one, other)| one != other) {
            return format!("the {name} sent\n{other:02x?}\ninstead of\n{one:02x?}");
        }
    }
    let (one, other) = (alone.sent.each_ref().map(Vec::len), disturbed.sent.each_ref().map(Vec::len));
    format!("{one:?} and {other:?} frames; events {:?} instead of {:?}", disturbed.events, alone.events)
}

#[test]
fn a_stranger_that_sends_altered_copies_of_all_frames_changes_nothing_and_costs_no_memory() {
    let runs = std::env::var("STRANGER_RUNS").ok().and_then(|runs| runs.parse().ok()).unwrap_or(6);
    let mut total = [0_u64; 2];
    assert!(allocation::arm(), "allocations are not counted");
    // Without a list the stranger may own the outputs as long as nobody else does: it begins when the scanner's
    // Forward_Open is answered, and ends with the connection. With it the stranger begins at once.
    for (listed, start_us, end_us) in [(false, 400, 350_000), (true, 0, 360_000)] {
        let (alone, _) = Cell::new(listed).whole_life(None);
        assert!(alone.images[60..350].iter().all(|image| image[0].is_some() && image[1].is_some()));
        let heard = alone.sent.concat();
        for seed in 0..runs {
            let time = (Instant::from_micros(start_us), Instant::from_micros(end_us));
            let listen = Some(SocketAddrV4::new(STATIONS[1].1, ENCAPSULATION_PORT));
            let stranger = Stranger::new(seed, &heard, STATIONS, listen, time);
            let (disturbed, foreign) = Cell::new(listed).whole_life(Some(stranger));
            assert!(alone == disturbed, "listed: {listed}, seed {seed}: {}", difference(&alone, &disturbed));
            total = [total[0] + foreign[0], total[1] + foreign[1]];
        }
    }
    assert!(total.iter().all(|frames| *frames > 500 * runs), "{total:?}");
    println!(
        "frames of strangers: {} to the scanner, {} to the adapter; nothing changed",
        total[0], total[1]
    );
}
