//! A pair of stations and a stranger on one switch, to test that the stranger changes nothing between them.
//!
//! The stranger sends altered copies of the pair's own frames, from addresses of its own, to both. A run with it is
//! compared with one without it: the pair must send each other the same bytes at the same instants. A seeded random
//! stream, or the bytes of a fuzzer, choose what the stranger sends.

mod choices;
mod pair_run;
mod recorded_station;
mod stranger;

pub use choices::{Choices, Random, Script};
pub use pair_run::{PairRun, PairStation, Phases, ReportedEvent, RunRecord, StationPair};
pub use recorded_station::{RecordedStation, SentFrame};
pub use stranger::Stranger;

use core::net::Ipv4Addr;

use machine::ethernet::Mac;
use machine::{
    Duration, Instant, Machine, Port, PortRequest, Source, StreamChange, StreamId, StreamRequest, Transmit,
};

/// The stranger's MAC address.
pub const STRANGER_MAC: Mac = Mac([2, 0, 0, 0, 0, 0x66]);
/// The stranger's IP address.
pub const STRANGER: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 66);

const MS: Duration = Duration::from_millis(1);
/// A station of the network: one of the pair, or the stranger.
#[derive(Debug)]
pub enum Member<A, B, C = Random> {
    /// The first of the pair.
    A(RecordedStation<A>),
    /// The second of the pair.
    B(RecordedStation<B>),
    /// The stranger.
    Stranger(Stranger<C>),
}

/// An event of one of the pair.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum MemberEvent<A, B> {
    /// Of the first.
    A(A),
    /// Of the second.
    B(B),
}

impl<A: Machine, B: Machine, C: Choices> Machine for Member<A, B, C> {
    type Event = MemberEvent<A::Event, B::Event>;

    fn ports(&self) -> &[PortRequest] {
        match self {
            Self::A(watched) => watched.machine.ports(),
            Self::B(watched) => watched.machine.ports(),
            Self::Stranger(_) => &[],
        }
    }

    fn neighbour(&self, address: Ipv4Addr) -> Option<Mac> {
        match self {
            Self::A(watched) => watched.machine.neighbour(address),
            Self::B(watched) => watched.machine.neighbour(address),
            Self::Stranger(_) => None,
        }
    }

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        match self {
            Self::A(watched) => watched.handle_frame(now, from, frame),
            Self::B(watched) => watched.handle_frame(now, from, frame),
            Self::Stranger(stranger) => stranger.handle_frame(from, frame),
        }
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        match self {
            Self::A(watched) => watched.handle_stream(now, stream, change),
            Self::B(watched) => watched.handle_stream(now, stream, change),
            Self::Stranger(stranger) => stranger.handle_stream(stream, change),
        }
    }

    fn listen_port(&self) -> Option<u16> {
        match self {
            Self::A(watched) => watched.machine.listen_port(),
            Self::B(watched) => watched.machine.listen_port(),
            Self::Stranger(_) => None,
        }
    }

    fn poll_stream(&mut self) -> Option<StreamRequest> {
        match self {
            Self::A(watched) => watched.poll_stream(),
            Self::B(watched) => watched.poll_stream(),
            Self::Stranger(stranger) => stranger.poll_stream(),
        }
    }

    fn group(&self, port: Port, index: usize) -> Option<Ipv4Addr> {
        match self {
            Self::A(watched) => watched.machine.group(port, index),
            Self::B(watched) => watched.machine.group(port, index),
            Self::Stranger(_) => None,
        }
    }

    fn handle_timeout(&mut self, now: Instant) {
        match self {
            Self::A(watched) => watched.machine.handle_timeout(now),
            Self::B(watched) => watched.machine.handle_timeout(now),
            Self::Stranger(stranger) => stranger.handle_timeout(now),
        }
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        match self {
            Self::A(watched) => watched.poll_transmit(now, buf),
            Self::B(watched) => watched.poll_transmit(now, buf),
            Self::Stranger(stranger) => stranger.poll_transmit(buf),
        }
    }

    fn poll_event(&mut self) -> Option<Self::Event> {
        match self {
            Self::A(watched) => watched.poll_event().map(MemberEvent::A),
            Self::B(watched) => watched.poll_event().map(MemberEvent::B),
            Self::Stranger(_) => None,
        }
    }

    fn poll_timeout(&self) -> Option<Instant> {
        match self {
            Self::A(watched) => watched.machine.poll_timeout(),
            Self::B(watched) => watched.machine.poll_timeout(),
            Self::Stranger(stranger) => stranger.poll_timeout(),
        }
    }
}
