//! Two machines on one cable, in virtual time.

mod frames;
pub(crate) mod hosts;
mod in_flight;
mod stream;
mod tap;

use alloc::boxed::Box;
use alloc::collections::VecDeque;
use alloc::vec::Vec;
use core::net::Ipv4Addr;

use machine::ethernet::Mac;
use machine::{Instant, Machine};

use crate::clock::{Clock, ClockReader};
use crate::link::{Impairment, Link, LinkCounters};
use crate::side::Side;
use in_flight::{InFlights, new_buf};
use stream::Streams;
use tap::Tap;
pub use tap::{Carrier, Segment, Tapped};

/// An event of one of the two machines.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Event<A, B> {
    /// An event of the first machine.
    A(A),
    /// An event of the second machine.
    B(B),
}

/// Configuration of a [`Pair`], apart from its machines.
#[derive(Clone, Copy, Debug)]
pub struct PairConfig {
    /// Seed of the links' random streams.
    pub seed: u64,
    /// Clocks of A and B.
    pub clocks: [Clock; 2],
    /// What the cable does to frames that A sends, and to frames that B sends.
    pub links: [Impairment; 2],
    /// IP addresses that the sides have at the start.
    pub addresses: [Option<Ipv4Addr>; 2],
}

/// State of a side besides its machine.
#[derive(Debug)]
struct Station {
    clock: ClockReader,
    link: Link,
    address: Option<Ipv4Addr>,
    /// MAC address, by the first Ethernet frame of its machine: from then on its host answers ARP.
    mac: Option<Mac>,
    /// The machine's next timeout by its own clock.
    local_timeout: Option<Instant>,
    /// The same instant in true time.
    timeout: Option<Instant>,
    alive: bool,
    /// Number of the frame of this side at which the pair stops, counted from 1.
    stop_at: Option<u64>,
}

/// Two machines on one cable, in virtual time.
pub struct Pair<A: Machine, B: Machine> {
    a: A,
    b: B,
    now: Instant,
    stations: [Station; 2],
    in_flight: InFlights,
    streams: Streams,
    /// Buffer that the machines write into. When it is sent away with a frame, a spare buffer replaces it.
    buf: Box<[u8]>,
    spare_bufs: Vec<Box<[u8]>>,
    events: VecDeque<Event<A::Event, B::Event>>,
    tap: Option<Tap>,
}

impl<A: Machine, B: Machine> Pair<A, B> {
    /// Connects two machines by a cable at true time zero.
    pub fn new(a: A, b: B, config: PairConfig) -> Self {
        let PairConfig {
            seed,
            clocks: [clock_a, clock_b],
            links: [link_a, link_b],
            addresses: [address_a, address_b],
        } = config;
        let station = |clock, impairment, address, stream| Station {
            clock: ClockReader::new(clock),
            link: Link::new(impairment, seed, stream),
            address,
            mac: None,
            local_timeout: None,
            timeout: None,
            alive: true,
            stop_at: None,
        };
        let mut pair = Self {
            a,
            b,
            now: Instant::ZERO,
            stations: [station(clock_a, link_a, address_a, 0), station(clock_b, link_b, address_b, 1)],
            in_flight: InFlights::default(),
            streams: Streams::new(seed),
            buf: new_buf(),
            spare_bufs: Vec::new(),
            events: VecDeque::new(),
            tap: None,
        };
        for side in [Side::A, Side::B] {
            pair.poll_machine(side, pair.local_time(side));
        }
        pair
    }

    /// Returns the true time.
    #[must_use]
    pub const fn now(&self) -> Instant {
        self.now
    }

    /// Returns what a side's clock shows now.
    #[must_use]
    pub fn local_time(&self, side: Side) -> Instant {
        let [a, b] = &self.stations;
        match side {
            Side::A => a.clock.clock().local_time(self.now),
            Side::B => b.clock.clock().local_time(self.now),
        }
    }

    /// Returns the first machine.
    #[must_use]
    pub const fn a(&self) -> &A {
        &self.a
    }

    /// Returns the second machine.
    #[must_use]
    pub const fn b(&self) -> &B {
        &self.b
    }

    /// Gives the first machine a command; `now` is by its own clock.
    pub fn command_a<R>(&mut self, command: impl FnOnce(&mut A, Instant) -> R) -> R {
        let local = self.local_time(Side::A);
        let result = command(&mut self.a, local);
        self.poll_machine(Side::A, local);
        result
    }

    /// Gives the second machine a command; `now` is by its own clock.
    pub fn command_b<R>(&mut self, command: impl FnOnce(&mut B, Instant) -> R) -> R {
        let local = self.local_time(Side::B);
        let result = command(&mut self.b, local);
        self.poll_machine(Side::B, local);
        result
    }

    /// Gives a side an IP address, as its operating system would.
    pub fn set_address(&mut self, side: Side, address: Option<Ipv4Addr>) {
        self.station(side).address = address;
    }

    /// Changes what the cable does to the frames that `side` sends.
    pub fn set_impairment(&mut self, side: Side, impairment: Impairment) {
        self.station(side).link.set_impairment(impairment);
    }

    /// Cuts the cable in both directions, or mends it. A cut loses datagrams in flight; bytes of a stream wait until
    /// the cable is mended or the stream's ends give up.
    pub fn set_cut(&mut self, cut: bool) {
        for station in &mut self.stations {
            station.link.set_cut(cut);
        }
        if cut { self.hold_streams() } else { self.resume_streams() }
    }

    /// Kills a node: it neither receives nor sends any more.
    pub fn kill(&mut self, side: Side) {
        let station = self.station(side);
        station.alive = false;
        station.timeout = None;
    }

    /// Starts another machine in place of the first one, which was killed. Its TCP connections are closed.
    pub fn restart_a(&mut self, machine: A) {
        self.a = machine;
        self.restarted(Side::A);
    }

    /// Starts another machine in place of the second one, which was killed. Its TCP connections are closed.
    pub fn restart_b(&mut self, machine: B) {
        self.b = machine;
        self.restarted(Side::B);
    }

    fn restarted(&mut self, side: Side) {
        self.close_streams_of(side);
        let station = self.station(side);
        station.alive = true;
        station.mac = None;
        station.local_timeout = None;
        let local = self.local_time(side);
        self.poll_machine(side, local);
    }

    /// Makes [`next_event`](Self::next_event) return once `side` has put so many frames into the cable.
    pub fn stop_at_frame(&mut self, side: Side, frame: Option<u64>) {
        self.station(side).stop_at = frame;
    }

    /// Returns what the cable did to the frames that `side` sent.
    #[must_use]
    pub fn link_counters(&self, side: Side) -> LinkCounters {
        let [a, b] = &self.stations;
        match side {
            Side::A => a.link.counters(),
            Side::B => b.link.counters(),
        }
    }

    /// Runs until a machine has an event, until `until` in true time, or until a frame of
    /// [`stop_at_frame`](Self::stop_at_frame), whichever is first.
    pub fn next_event(&mut self, until: Instant) -> Option<Event<A::Event, B::Event>> {
        loop {
            if let Some(event) = self.events.pop_front() {
                return Some(event);
            }
            if self.stops() {
                return None;
            }
            if !self.step(until) {
                self.now = self.now.max(until);
                return None;
            }
        }
    }

    /// Returns whether a side has put in the frame at which the pair stops, once for each such frame.
    fn stops(&mut self) -> bool {
        let reached = |station: &mut Station| {
            let sent = station.link.counters().sent;
            station.stop_at.take_if(|frame| *frame <= sent).is_some()
        };
        let [a, b] = &mut self.stations;
        reached(a) | reached(b)
    }

    /// Processes the next thing in flight or due, unless it is after `until`. Returns whether there was one.
    fn step(&mut self, until: Instant) -> bool {
        let [a, b] = &self.stations;
        let arrival = self.in_flight.next_arrival();
        let timeout = match (a.timeout, b.timeout) {
            (Some(of_a), Some(of_b)) if of_b < of_a => Some((of_b, Side::B)),
            (Some(of_a), _) => Some((of_a, Side::A)),
            (None, of_b) => of_b.map(|of_b| (of_b, Side::B)),
        };
        match (arrival, timeout) {
            (Some(arrives), timeout) if timeout.is_none_or(|(at, _)| arrives <= at) => {
                if arrives > until {
                    return false;
                }
                self.now = self.now.max(arrives);
                self.deliver();
                true
            }
            (_, Some((at, side))) => {
                if at > until {
                    return false;
                }
                self.now = self.now.max(at);
                let local = self.read_clock(side);
                match side {
                    Side::A => self.a.handle_timeout(local),
                    Side::B => self.b.handle_timeout(local),
                }
                self.poll_machine(side, local);
                true
            }
            _ => false,
        }
    }

    /// Fulfils the contract after a change: drains frames and events, then reads the timeout. `local` is what the
    /// side's clock shows now.
    fn poll_machine(&mut self, side: Side, local: Instant) {
        if !self.station(side).alive {
            return;
        }
        loop {
            let transmit = match side {
                Side::A => self.a.poll_transmit(local, &mut self.buf),
                Side::B => self.b.poll_transmit(local, &mut self.buf),
            };
            let Some(transmit) = transmit else { break };
            self.send(side, transmit);
        }
        loop {
            let request = match side {
                Side::A => self.a.poll_stream(),
                Side::B => self.b.poll_stream(),
            };
            let Some(request) = request else { break };
            self.request_stream(side, request);
        }
        match side {
            Side::A => {
                while let Some(event) = self.a.poll_event() {
                    self.events.push_back(Event::A(event));
                }
            }
            Side::B => {
                while let Some(event) = self.b.poll_event() {
                    self.events.push_back(Event::B(event));
                }
            }
        }
        let timeout = match side {
            Side::A => self.a.poll_timeout(),
            Side::B => self.b.poll_timeout(),
        };
        let station = self.station(side);
        // Most events leave the timeout unchanged, and converting a time between clocks is slow.
        if timeout != station.local_timeout {
            station.local_timeout = timeout;
            station.timeout = timeout.map(|due| station.clock.true_time(due));
        }
    }

    /// Reads a side's clock like [`local_time`](Self::local_time), once for each step.
    fn read_clock(&mut self, side: Side) -> Instant {
        let now = self.now;
        self.station(side).clock.local_time(now)
    }

    fn station(&mut self, side: Side) -> &mut Station {
        let [a, b] = &mut self.stations;
        match side {
            Side::A => a,
            Side::B => b,
        }
    }
}
