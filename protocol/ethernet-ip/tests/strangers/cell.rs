//! A scanner and an adapter on a switch, watched: alone, or beside a stranger.

use std::net::Ipv4Addr;

use ethernet_ip::{Adapter, AdapterConfig, ConnectionConfig, ConnectionId, Scanner, ScannerConfig};
use machine::ethernet::Mac;
use machine::{Allowed, Duration, Instant, LinkEvent, Peer};
use virtual_time::hostile::{Choices, Member, MemberEvent, STRANGER, STRANGER_MAC, Sent, Stranger, Watched};
use virtual_time::{Network, StationId};

use super::samples::{CONSUMED, DEVICE, LEN, PRODUCED};

/// MAC and IP addresses of the pair.
pub(crate) const STATIONS: [(Mac, Ipv4Addr); 2] = [
    (Mac([2, 0, 0, 0, 0, 1]), Ipv4Addr::new(192, 168, 64, 1)),
    (Mac([2, 0, 0, 0, 0, 2]), Ipv4Addr::new(192, 168, 64, 2)),
];

/// An event of the scanner or of the adapter, and when.
pub(crate) type Reported = (Instant, MemberEvent<LinkEvent, LinkEvent>);

/// The pair on its switch, and a place for a stranger.
pub(crate) struct Cell<C: Choices> {
    network: Network<Member<Scanner, Adapter, C>>,
    scanner: StationId,
    adapter: StationId,
    connection: ConnectionId,
    events: Vec<Reported>,
    images: Vec<[Option<u8>; 2]>,
}

/// When what happens in the life of the pair.
#[derive(Clone, Copy)]
pub(crate) struct Phases {
    /// Data are exchanged by then; from now on nothing of a stranger may cost heap memory.
    pub(crate) up: Instant,
    /// The pair parts.
    pub(crate) parting: Instant,
    /// The end.
    pub(crate) end: Instant,
}

/// What a run left behind.
#[derive(PartialEq)]
pub(crate) struct Record {
    /// Bytes and instants of each side's frames.
    pub(crate) sent: [Vec<Sent>; 2],
    /// What both reported.
    pub(crate) events: Vec<Reported>,
    /// Data that arrived, one entry a millisecond: the first byte at each side.
    pub(crate) images: Vec<[Option<u8>; 2]>,
}

impl<C: Choices> Cell<C> {
    /// Creates a pair whose adapter lists its scanner if `listed`.
    pub(crate) fn new(listed: bool, allocations: fn() -> u64) -> Self {
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
        let adapter = network.add(Member::B(Watched::new(slave, allocations)), adapter_mac, Some(robot));
        let scanner = network.add(Member::A(Watched::new(master, allocations)), scanner_mac, Some(plc));
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

    /// Connects, exchanges data, parts, and waits; returns what was sent and reported, and how many frames of a stranger each
    /// side got.
    pub(crate) fn whole_life(mut self, stranger: Option<Stranger<C>>, phases: Phases) -> (Record, [u64; 2]) {
        if let Some(stranger) = stranger {
            self.network.add(Member::Stranger(stranger), STRANGER_MAC, Some(STRANGER));
        }
        self.run(phases.up);
        let before = [self.scanner(|s, _| s.allocations), self.adapter(|a, _| a.allocations)];
        self.run(phases.parting);
        let after = [self.scanner(|s, _| s.allocations), self.adapter(|a, _| a.allocations)];
        assert_eq!(after, before, "allocations for a stranger while data are exchanged");
        let foreign = [self.scanner(|s, _| s.foreign), self.adapter(|a, _| a.foreign)];
        let connection = self.connection;
        self.scanner(|scanner, now| {
            scanner.machine.connection_mut(connection).map(|connection| connection.disconnect(now))
        });
        self.run(phases.end);
        let sent = [
            self.scanner(|s, _| core::mem::take(&mut s.sent)),
            self.adapter(|a, _| core::mem::take(&mut a.sent)),
        ];
        (Record { sent, events: self.events, images: self.images }, foreign)
    }

    /// Lives beside a station that sends from the addresses of one of the pair. Whether it ends the connection is not judged.
    pub(crate) fn forged_life(
        mut self,
        stranger: Stranger<C>,
        (mac, address): (Mac, Ipv4Addr),
        end: Instant,
    ) {
        self.network.add(Member::Stranger(stranger.forging(mac)), mac, Some(address));
        self.run(end);
    }
}

/// Returns the first frame that differs.
pub(crate) fn difference(alone: &Record, disturbed: &Record) -> String {
    for (side, name) in ["scanner", "adapter"].into_iter().enumerate() {
        let pairs = alone.sent[side].iter().zip(&disturbed.sent[side]);
        if let Some((one, other)) = pairs.into_iter().find(|(one, other)| one != other) {
            return format!("the {name} sent\n{other:02x?}\ninstead of\n{one:02x?}");
        }
    }
    let (one, other) = (alone.sent.each_ref().map(Vec::len), disturbed.sent.each_ref().map(Vec::len));
    format!("{one:?} and {other:?} frames; events {:?} instead of {:?}", disturbed.events, alone.events)
}
