//! The run of a pair: it connects, exchanges data and disconnects, alone or beside a stranger.

use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;
use core::net::Ipv4Addr;

use machine::ethernet::Mac;
use machine::{Duration, Instant, InterfaceId, LinkEvent, Machine};

use super::{
    Choices, MS, Member, MemberEvent, Random, RecordedStation, STRANGER, STRANGER_MAC, SentFrame, Stranger,
};
use crate::{Network, NodeId, StationConfig, SwitchConfig, SwitchId};

/// The two stations of a pair, and what they do in a run, by their protocol.
pub trait StationPair {
    /// Name of a connection of the first station.
    type Id: core::fmt::Debug;
    /// The first station: it connects and disconnects.
    type A: Machine<Event = (Self::Id, LinkEvent)>;
    /// The second station.
    type B: Machine<Event = LinkEvent>;
    /// Names of the stations.
    const NAMES: [&'static str; 2];
    /// Whether the second station requests its IP address.
    const ASKS_FOR_ADDRESS: bool = false;

    /// Fills the data that the first station sends with a value; returns the first byte of what it received.
    fn exchange_a(&self, station: &mut Self::A, value: u8) -> Option<u8>;

    /// Fills the data that the second station sends with a value; returns the first byte of what it received.
    fn exchange_b(&self, station: &mut Self::B, value: u8) -> Option<u8>;

    /// Ends the connection.
    fn disconnect(&self, station: &mut Self::A, now: Instant);

    /// Confirms the IP address that the second station requested.
    fn address_set(&self, station: &mut Self::B, now: Instant) {
        let _ = (station, now);
    }
}

/// A station of the pair before it is on the switch.
#[derive(Clone, Copy, Debug)]
pub struct PairStation<M> {
    /// The station.
    pub machine: M,
    /// Its MAC address.
    pub mac: Mac,
    /// Its IP address, if it has one at the start.
    pub address: Option<Ipv4Addr>,
}

/// An event of either station, and when.
pub type ReportedEvent = (Instant, MemberEvent<LinkEvent, LinkEvent>);

/// The phases of a run.
#[derive(Clone, Copy, Debug)]
pub struct Phases {
    /// By now data are exchanged; from now on no frame of a stranger may allocate.
    pub up: Instant,
    /// The pair disconnects.
    pub disconnect: Instant,
    /// The run ends.
    pub end: Instant,
}

/// The record of a run.
#[derive(PartialEq, Debug)]
pub struct RunRecord {
    /// Bytes and instants of each side's frames.
    pub sent: [Vec<SentFrame>; 2],
    /// Events that both reported.
    pub events: Vec<ReportedEvent>,
    /// Received data: the first byte at each side, one entry for each millisecond.
    pub images: Vec<[Option<u8>; 2]>,
}

/// The pair on its switch, and a place for a stranger.
#[derive(Debug)]
pub struct PairRun<P: StationPair, C: Choices = Random> {
    pair: P,
    network: Network<Member<P::A, P::B, C>>,
    stations: [NodeId; 2],
    events: Vec<ReportedEvent>,
    images: Vec<[Option<u8>; 2]>,
}

/// Puts a station on the switch. Between two stations a frame takes 25 µs.
fn plug_in<M: Machine>(
    network: &mut Network<M>,
    name: &'static str,
    machine: M,
    (mac, address): (Mac, Option<Ipv4Addr>),
) -> NodeId {
    let config = StationConfig::new(mac, address, Duration::from_nanos(12_500));
    network.add_station(SwitchId::FIRST, name, machine, config)
}

impl<P: StationPair, C: Choices> PairRun<P, C> {
    /// Puts the pair on a switch. `count` returns the heap allocations so far.
    #[must_use]
    pub fn new(pair: P, a: PairStation<P::A>, b: PairStation<P::B>, count: fn() -> u64) -> Self {
        let mut network = Network::with_switch(0, SwitchConfig::IDEAL);
        let stations = [
            (P::NAMES[0], Member::A(RecordedStation::new(a.machine, count)), a.mac, a.address),
            (P::NAMES[1], Member::B(RecordedStation::new(b.machine, count)), b.mac, b.address),
        ];
        let stations = stations
            .map(|(name, machine, mac, address)| plug_in(&mut network, name, machine, (mac, address)));
        Self { pair, network, stations, events: Vec::new(), images: Vec::new() }
    }

    fn a<R>(&mut self, command: impl FnOnce(&P, &mut RecordedStation<P::A>, Instant) -> R) -> Option<R> {
        let pair = &self.pair;
        let done = self.network.command(self.stations[0], |station, now| match station {
            Member::A(watched) => Some(command(pair, watched, now)),
            _ => None,
        });
        done.flatten()
    }

    fn b<R>(&mut self, command: impl FnOnce(&P, &mut RecordedStation<P::B>, Instant) -> R) -> Option<R> {
        let pair = &self.pair;
        let done = self.network.command(self.stations[1], |station, now| match station {
            Member::B(watched) => Some(command(pair, watched, now)),
            _ => None,
        });
        done.flatten()
    }

    /// Runs to `until`; both sides change their data every millisecond.
    fn run(&mut self, until: Instant) {
        while self.network.now() < until {
            let step = self.network.now() + MS;
            while let Some((_, event)) = self.network.next_event(step) {
                self.record(event);
            }
            let value = (self.images.len() % 251) as u8;
            let input = self.a(|pair, watched, _| pair.exchange_a(&mut watched.machine, value));
            let output = self.b(|pair, watched, _| pair.exchange_b(&mut watched.machine, value));
            self.images.push([input.flatten(), output.flatten()]);
        }
    }

    fn record(&mut self, event: MemberEvent<(P::Id, LinkEvent), LinkEvent>) {
        let now = self.network.now();
        let reported = match event {
            MemberEvent::A((_, LinkEvent::Foreign(_) | LinkEvent::Conflict(_)))
            | MemberEvent::B(LinkEvent::Foreign(_) | LinkEvent::Conflict(_)) => return,
            MemberEvent::A((_, event)) => MemberEvent::A(event),
            MemberEvent::B(LinkEvent::SetAddress { address, .. }) if P::ASKS_FOR_ADDRESS => {
                self.network.set_address(self.stations[1], InterfaceId::FIRST, Some(address));
                self.b(|pair, watched, now| pair.address_set(&mut watched.machine, now));
                MemberEvent::B(LinkEvent::Up)
            }
            MemberEvent::B(event) => MemberEvent::B(event),
        };
        self.events.push((now, reported));
    }

    /// Connects, exchanges data, disconnects, and waits; returns what was sent and reported, and how many frames of a
    /// stranger each side received.
    ///
    /// # Panics
    ///
    /// A frame of the stranger allocates while data are exchanged.
    pub fn run_whole(mut self, stranger: Option<Stranger<C>>, phases: Phases) -> (RunRecord, [u64; 2]) {
        if let Some(stranger) = stranger {
            plug_in(
                &mut self.network,
                "the stranger",
                Member::Stranger(stranger),
                (STRANGER_MAC, Some(STRANGER)),
            );
        }
        self.run(phases.up);
        let before = self.allocations();
        self.run(phases.disconnect);
        assert_eq!(self.allocations(), before, "allocations for a stranger while data are exchanged");
        let foreign = [self.a(|_, a, _| a.foreign), self.b(|_, b, _| b.foreign)];
        self.a(|pair, watched, now| pair.disconnect(&mut watched.machine, now));
        self.run(phases.end);
        let sent =
            [self.a(|_, a, _| core::mem::take(&mut a.sent)), self.b(|_, b, _| core::mem::take(&mut b.sent))];
        let record =
            RunRecord { sent: sent.map(Option::unwrap_or_default), events: self.events, images: self.images };
        (record, foreign.map(Option::unwrap_or_default))
    }

    fn allocations(&mut self) -> [Option<u64>; 2] {
        [self.a(|_, a, _| a.allocations), self.b(|_, b, _| b.allocations)]
    }

    /// Runs beside a station that sends from the addresses of one of the pair. It may end the connection; only a panic is an
    /// error.
    pub fn run_with_forger(mut self, stranger: Stranger<C>, (mac, address): (Mac, Ipv4Addr), end: Instant) {
        plug_in(
            &mut self.network,
            "the forger",
            Member::Stranger(stranger.forging(mac)),
            (mac, Some(address)),
        );
        self.run(end);
    }
}

impl RunRecord {
    /// Returns the first frame in which a disturbed run of such a pair differs.
    #[must_use]
    pub fn difference<P: StationPair>(&self, disturbed: &Self) -> String {
        for ((name, alone), disturbed) in P::NAMES.into_iter().zip(&self.sent).zip(&disturbed.sent) {
            if let Some((one, other)) = alone.iter().zip(disturbed).find(|(one, other)| one != other) {
                return format!("the {name} sent\n{other:02x?}\ninstead of\n{one:02x?}");
            }
        }
        let (one, other) = (self.sent.each_ref().map(Vec::len), disturbed.sent.each_ref().map(Vec::len));
        format!("{one:?} and {other:?} frames; events {:?} instead of {:?}", disturbed.events, self.events)
    }
}
