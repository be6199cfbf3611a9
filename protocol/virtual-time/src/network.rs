//! Any number of nodes, each with a clock of its own, and cables between them, in virtual time.

mod cables;
mod deadlines;
mod frames;
mod hosts;
mod ids;
mod in_flight;
mod learned;
mod nodes;
mod stream;
mod switch;
mod tap;

use alloc::boxed::Box;
use alloc::collections::VecDeque;
use alloc::string::String;
use alloc::vec::Vec;
use core::net::Ipv4Addr;

use machine::ethernet::Mac;
use machine::{Duration, Instant, InterfaceId, Multihomed};

use crate::clock::Clock;
use crate::link::Impairment;
use crate::side::Side;
use cables::{Cable, Stop};
use deadlines::Deadlines;
use hosts::Nic;
pub use ids::{CableId, NicId, NodeId, Plug, SwitchId};
use in_flight::{InFlights, new_buf};
use nodes::Node;
use stream::Streams;
use switch::{Forwarding, Switch};
pub use switch::{SwitchConfig, SwitchCounters};
use tap::Tap;
pub use tap::{Carrier, Segment, Tapped};

/// A node with one interface, by its cable on a switch.
#[derive(Clone, Copy, Debug)]
pub struct StationConfig {
    /// Its clock.
    pub clock: Clock,
    /// Its MAC address. It takes only frames to this address and to groups.
    pub mac: Mac,
    /// The IP address that it has at the start.
    pub address: Option<Ipv4Addr>,
    /// What its cable does to the frames that it sends, and to those that the switch sends.
    pub links: [Impairment; 2],
}

impl StationConfig {
    /// A station with a perfect clock and a cable without faults.
    #[must_use]
    pub fn new(mac: Mac, address: Option<Ipv4Addr>, cable_delay: Duration) -> Self {
        let cable = Impairment { delay: cable_delay, ..Impairment::default() };
        Self { clock: Clock::default(), mac, address, links: [cable; 2] }
    }
}

/// Nodes, their cables and switches, in virtual time.
///
/// A node's interface is at one end of a cable; at the other end is another node's interface, or a switch.
#[derive(Debug)]
pub struct Network<M: Multihomed> {
    seed: u64,
    now: Instant,
    nodes: Vec<Node<M>>,
    /// How many of the nodes were polled before; the others start with the next event or command.
    started: usize,
    deadlines: Deadlines,
    nics: Vec<Nic>,
    cables: Vec<Cable>,
    switches: Vec<Switch>,
    in_flight: InFlights,
    streams: Streams,
    stops: Vec<Stop>,
    /// Buffer that the machines write into. When it is sent away with a frame, a spare buffer replaces it.
    buf: Box<[u8]>,
    spare_bufs: Vec<Box<[u8]>>,
    events: VecDeque<(NodeId, M::Event)>,
    tap: Option<Tap>,
}

impl<M: Multihomed> Network<M> {
    /// Creates a network without nodes at true time zero. Each direction of each cable draws its faults from a random
    /// stream of its own, by this seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self {
            seed,
            now: Instant::ZERO,
            nodes: Vec::new(),
            started: 0,
            deadlines: Deadlines::default(),
            nics: Vec::new(),
            cables: Vec::new(),
            switches: Vec::new(),
            in_flight: InFlights::default(),
            streams: Streams::new(seed),
            stops: Vec::new(),
            buf: new_buf(),
            spare_bufs: Vec::new(),
            events: VecDeque::new(),
            tap: None,
        }
    }

    /// Creates a network without nodes, but with a switch: [`SwitchId::FIRST`].
    #[must_use]
    pub fn with_switch(seed: u64, config: SwitchConfig) -> Self {
        let mut network = Self::new(seed);
        network.add_switch(config);
        network
    }

    /// Adds a node, which has no interface yet. Its name is for messages. The machine runs from the next event or command on.
    pub fn add_node(&mut self, name: impl Into<String>, machine: M, clock: Clock) -> NodeId {
        self.nodes.push(Node::new(name.into(), machine, clock));
        self.deadlines.grow(self.nodes.len());
        NodeId(self.nodes.len() - 1)
    }

    /// Adds an interface to a node's host. It serves these interfaces of the machine, each with ports of its own.
    ///
    /// With a MAC address it takes only frames to this address and to groups, as an interface on a switch must. Without one it
    /// takes every frame, and learns its own address from the first one that its machine sends.
    pub fn add_nic(
        &mut self,
        node: NodeId,
        serves: &[InterfaceId],
        mac: Option<Mac>,
        address: Option<Ipv4Addr>,
    ) -> NicId {
        let id = NicId(self.nics.len());
        self.nics.push(Nic::new(node, serves, mac, address));
        if let Some(node) = self.nodes.get_mut(node.0) {
            node.attach(serves, id);
        }
        id
    }

    /// Adds a switch without cables.
    pub fn add_switch(&mut self, config: SwitchConfig) -> SwitchId {
        self.switches.push(Switch::new(config, Forwarding::ByAddress));
        SwitchId(self.switches.len() - 1)
    }

    /// Adds a line of EtherCAT devices without cables. The first cable leads to the MainDevice, each further one to the next device: what
    /// comes back from a device goes to the next one, and from the last one to the MainDevice. After a cable that is cut, or a node that
    /// was killed, no device is reached. It takes no time.
    pub fn add_line(&mut self) -> SwitchId {
        self.switches.push(Switch::new(SwitchConfig::IDEAL, Forwarding::ToNextPort));
        SwitchId(self.switches.len() - 1)
    }

    /// Connects two ends by a cable. `links` is what it does to the frames that the first end sends, and to those that the
    /// second end sends. Returns `None` if an interface has a cable already, or if both ends are switches.
    pub fn connect(&mut self, ends: [Plug; 2], links: [Impairment; 2]) -> Option<CableId> {
        let id = CableId(self.cables.len());
        let has_cable = |plug| match plug {
            Plug::Nic(NicId(nic)) => self.nics.get(nic).is_none_or(|nic| nic.cable.is_some()),
            Plug::Switch(SwitchId(switch)) => self.switches.get(switch).is_none(),
        };
        let [first, second] = ends;
        if has_cable(first)
            || has_cable(second)
            || first == second
            || (first.is_switch() && second.is_switch())
        {
            return None;
        }
        for (plug, side) in [(first, Side::A), (second, Side::B)] {
            match plug {
                Plug::Nic(NicId(nic)) => {
                    if let Some(nic) = self.nics.get_mut(nic) {
                        nic.cable = Some((id, side));
                    }
                }
                Plug::Switch(SwitchId(switch)) => {
                    if let Some(switch) = self.switches.get_mut(switch) {
                        switch.add_port(id, side);
                    }
                }
            }
        }
        self.cables.push(Cable::new(ends, links, self.seed, id));
        Some(id)
    }

    /// Adds a node with one interface, and its cable to a switch. The node is the cable's side A.
    pub fn add_station(
        &mut self,
        switch: SwitchId,
        name: impl Into<String>,
        machine: M,
        station: StationConfig,
    ) -> NodeId {
        let StationConfig { clock, mac, address, links } = station;
        let node = self.add_node(name, machine, clock);
        let nic = self.add_nic(node, &[InterfaceId::FIRST], Some(mac), address);
        self.connect([Plug::Nic(nic), Plug::Switch(switch)], links);
        node
    }

    /// Returns the true time.
    #[must_use]
    pub const fn now(&self) -> Instant {
        self.now
    }

    /// Gives a node's machine a command; `now` is by its own clock. Returns `None` for a node of another network.
    pub fn command<R>(&mut self, id: NodeId, command: impl FnOnce(&mut M, Instant) -> R) -> Option<R> {
        self.switch_on();
        let local = self.read_clock(id);
        let result = command(&mut self.nodes.get_mut(id.0)?.machine, local);
        self.poll_machine(id, local);
        Some(result)
    }

    /// Runs until a machine has an event, until `until` in true time, or until a frame of
    /// [`stop_at_frame`](Self::stop_at_frame), whichever is first.
    ///
    /// # Panics
    ///
    /// A machine is polled again and again at one instant, so that time would never move on. The message names its node.
    pub fn next_event(&mut self, until: Instant) -> Option<(NodeId, M::Event)> {
        self.switch_on();
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

    /// Processes the next thing in flight or due, unless it is after `until`. Returns whether there was one. At one instant
    /// arrivals come first, then the nodes in the order in which they were added.
    fn step(&mut self, until: Instant) -> bool {
        let arrival = self.in_flight.next_arrival();
        let timeout = self.deadlines.first();
        match (arrival, timeout) {
            (Some(arrives), timeout) if timeout.is_none_or(|(at, _)| arrives <= at) => {
                if arrives > until {
                    return false;
                }
                self.now = self.now.max(arrives);
                self.deliver();
                true
            }
            (_, Some((at, node))) => {
                if at > until {
                    return false;
                }
                self.now = self.now.max(at);
                self.handle_timeout(NodeId(node));
                true
            }
            _ => false,
        }
    }

    /// Returns how long a frame of this length takes through a switch that has nothing else to do.
    #[must_use]
    pub fn forwarding_time(&self, switch: SwitchId, frame_len: usize) -> Duration {
        self.switches.get(switch.0).map(|switch| switch.passage(frame_len)).unwrap_or_default()
    }
}
