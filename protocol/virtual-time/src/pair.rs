//! A network of two nodes of different types and one cable between them.

use core::net::Ipv4Addr;

use machine::{Instant, InterfaceId, Multihomed};

use crate::clock::Clock;
use crate::either::{Either, Event};
use crate::link::{Impairment, LinkCounters};
use crate::network::{CableId, Network, NodeId, Plug, Tapped};
use crate::side::Side;

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

/// The nodes and the cable of every pair: it is the whole network.
const NODES: [NodeId; 2] = [NodeId(0), NodeId(1)];
const CABLE: CableId = CableId(0);

const fn node(side: Side) -> NodeId {
    let [a, b] = NODES;
    match side {
        Side::A => a,
        Side::B => b,
    }
}

/// A [`Network`] of two nodes with one interface each, and one cable between them: A at side A, B at side B.
pub struct Pair<A: Multihomed, B: Multihomed>(Network<Either<A, B>>);

impl<A: Multihomed, B: Multihomed> Pair<A, B> {
    /// Connects two machines by a cable at true time zero.
    pub fn new(a: A, b: B, config: PairConfig) -> Self {
        let PairConfig { seed, clocks: [clock_a, clock_b], links, addresses: [address_a, address_b] } =
            config;
        let mut network = Network::new(seed);
        let nodes = [
            (network.add_node("A", Either::A(a), clock_a), address_a),
            (network.add_node("B", Either::B(b), clock_b), address_b),
        ];
        let ends = nodes
            .map(|(node, address)| Plug::Nic(network.add_nic(node, &[InterfaceId::FIRST], None, address)));
        network.connect(ends, links);
        network.switch_on();
        Self(network)
    }

    /// Returns the true time.
    #[must_use]
    pub const fn now(&self) -> Instant {
        self.0.now()
    }

    /// Returns what a side's clock shows now.
    #[must_use]
    pub fn local_time(&self, side: Side) -> Instant {
        self.0.local_time(node(side))
    }

    /// Returns the first machine.
    #[must_use]
    pub fn a(&self) -> &A {
        match self.0.machine(node(Side::A)) {
            Some(Either::A(a)) => a,
            _ => unreachable!("{ONE_TYPE_EACH}"),
        }
    }

    /// Returns the second machine.
    #[must_use]
    pub fn b(&self) -> &B {
        match self.0.machine(node(Side::B)) {
            Some(Either::B(b)) => b,
            _ => unreachable!("{ONE_TYPE_EACH}"),
        }
    }

    /// Gives the first machine a command; `now` is by its own clock.
    pub fn command_a<R>(&mut self, command: impl FnOnce(&mut A, Instant) -> R) -> R {
        let done = self.0.command(node(Side::A), |machine, now| match machine {
            Either::A(a) => command(a, now),
            Either::B(_) => unreachable!("{ONE_TYPE_EACH}"),
        });
        let Some(done) = done else { unreachable!("{ONE_TYPE_EACH}") };
        done
    }

    /// Gives the second machine a command; `now` is by its own clock.
    pub fn command_b<R>(&mut self, command: impl FnOnce(&mut B, Instant) -> R) -> R {
        let done = self.0.command(node(Side::B), |machine, now| match machine {
            Either::B(b) => command(b, now),
            Either::A(_) => unreachable!("{ONE_TYPE_EACH}"),
        });
        let Some(done) = done else { unreachable!("{ONE_TYPE_EACH}") };
        done
    }

    /// Gives a side an IP address, as its operating system would.
    pub fn set_address(&mut self, side: Side, address: Option<Ipv4Addr>) {
        self.0.set_address(node(side), InterfaceId::FIRST, address);
    }

    /// Changes what the cable does to the frames that `side` sends.
    pub fn set_impairment(&mut self, side: Side, impairment: Impairment) {
        self.0.set_impairment(CABLE, side, impairment);
    }

    /// Cuts the cable in both directions, or mends it, as [`Network::set_cut`].
    pub fn set_cut(&mut self, cut: bool) {
        self.0.set_cut(CABLE, cut);
    }

    /// Kills a node: it neither receives nor sends any more.
    pub fn kill(&mut self, side: Side) {
        self.0.kill(node(side));
    }

    /// Starts another machine in place of the first one, which was killed. Its TCP connections are closed.
    pub fn restart_a(&mut self, machine: A) {
        self.0.restart(node(Side::A), Either::A(machine));
    }

    /// Starts another machine in place of the second one, which was killed. Its TCP connections are closed.
    pub fn restart_b(&mut self, machine: B) {
        self.0.restart(node(Side::B), Either::B(machine));
    }

    /// Makes [`next_event`](Self::next_event) return once `side` has put so many frames into the cable.
    pub fn stop_at_frame(&mut self, side: Side, frame: Option<u64>) {
        self.0.stop_at_frame(CABLE, side, frame);
    }

    /// Returns what the cable did to the frames that `side` sent.
    #[must_use]
    pub fn link_counters(&self, side: Side) -> LinkCounters {
        self.0.link_counters(CABLE, side)
    }

    /// Shows every frame to `tap`, once when it is sent and once when it arrives.
    pub fn set_tap(&mut self, tap: impl FnMut(Tapped<'_>) + 'static) {
        self.0.set_tap(tap);
    }

    /// Runs until a machine has an event, until `until` in true time, or until a frame of
    /// [`stop_at_frame`](Self::stop_at_frame), whichever is first.
    ///
    /// # Panics
    ///
    /// Time would never move on, as [`Network::next_event`].
    pub fn next_event(&mut self, until: Instant) -> Option<Event<A::Event, B::Event>> {
        self.0.next_event(until).map(|(_, event)| event)
    }
}

/// Why a machine of another type cannot be found.
const ONE_TYPE_EACH: &str = "node 0 of a pair is an A and node 1 a B, from `new` on";
