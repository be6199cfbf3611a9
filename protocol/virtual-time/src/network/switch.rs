//! A switch: it stores each frame, looks its destination up, and forwards it, by a queue at each port.

use alloc::collections::VecDeque;
use alloc::vec::Vec;

use super::Network;
use super::hosts::is_arp;
use super::ids::{CableId, NicId, Plug, SwitchId};
use super::in_flight::Frame;
use super::learned::LearnedPorts;
use super::tap::{Carrier, Label};
use crate::link::LinkEffect;
use crate::side::Side;
use machine::ethernet::{EthernetHeader, Mac};
use machine::{Duration, Instant, Multihomed, Port};

/// Shortest frame without its checksum (IEEE 802.3, 3.2.8).
const SHORTEST_FRAME: usize = 60;

/// Bytes around a frame on the wire: preamble and start 8, checksum 4, gap to the next frame 12 (IEEE 802.3, 3.1.1 and 4.4.2).
const AROUND_FRAME: usize = 24;

/// Headers of a datagram: Ethernet 14, IPv4 20, UDP 8 bytes. A frame of a machine is the datagram's payload.
const AROUND_DATAGRAM: usize = 42;

/// Headers of a TCP segment: Ethernet 14, IPv4 20, TCP 20 bytes.
const AROUND_SEGMENT: usize = 54;

/// How a switch forwards.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct SwitchConfig {
    /// Time from the end of a frame's arrival until it is in the queue of the port by which it leaves.
    pub forwarding: Duration,
    /// Bit rate of each port; without one a frame leaves at once.
    pub bits_per_second: Option<u64>,
    /// Frames that a port's queue holds, with the one that is being sent. It drops what comes while it is full.
    pub queue_len: usize,
}

impl SwitchConfig {
    /// A switch that takes no time and drops nothing.
    pub const IDEAL: Self = Self { forwarding: Duration::ZERO, bits_per_second: None, queue_len: usize::MAX };

    /// Returns how long a port takes to send a frame, with what is around it on the wire.
    fn transmission(&self, on_wire: usize) -> Duration {
        let bits = on_wire as u64 * 8;
        let time = self.bits_per_second.and_then(|rate| (bits * 1_000_000_000).checked_div(rate));
        Duration::from_nanos(time.unwrap_or_default())
    }
}

/// Treatment of a frame by a network element.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Forwarding {
    /// It looks up where the receiver is.
    ByAddress,
    /// It passes the frame to the next port, and at the last one to the first.
    ToNextPort,
}

/// What a port of a switch did.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct SwitchCounters {
    /// Frames that were put into the port's queue.
    pub forwarded: u64,
    /// Frames that it dropped because the queue was full.
    pub dropped: u64,
    /// Most frames that were in the queue at once.
    pub longest_queue: usize,
}

/// A port of a switch, with its cable.
#[derive(Debug)]
struct SwitchPort {
    cable: CableId,
    side: Side,
    /// When each frame in the queue will have been sent.
    queue: VecDeque<Instant>,
    counters: SwitchCounters,
}

impl SwitchPort {
    /// Puts a frame into the queue. Returns when it has been sent; `None` if the queue is full.
    fn enqueue(&mut self, ready: Instant, transmission: Duration, queue_len: usize) -> Option<Instant> {
        while self.queue.front().is_some_and(|sent| *sent <= ready) {
            self.queue.pop_front();
        }
        if self.queue.len() >= queue_len {
            self.counters.dropped += 1;
            return None;
        }
        let sent = self.queue.back().map_or(ready, |last| ready.max(*last)) + transmission;
        self.queue.push_back(sent);
        self.counters.forwarded += 1;
        self.counters.longest_queue = self.counters.longest_queue.max(self.queue.len());
        Some(sent)
    }
}

#[derive(Debug)]
pub(super) struct Switch {
    config: SwitchConfig,
    forwarding: Forwarding,
    ports: Vec<SwitchPort>,
    /// The port of each cable, by the cable's number.
    port_of_cable: Vec<Option<usize>>,
    learned: LearnedPorts,
}

impl Switch {
    pub(super) const fn new(config: SwitchConfig, forwarding: Forwarding) -> Self {
        Self {
            config,
            forwarding,
            ports: Vec::new(),
            port_of_cable: Vec::new(),
            learned: LearnedPorts::new(),
        }
    }

    pub(super) fn add_port(&mut self, cable: CableId, side: Side) {
        if cable.0 >= self.port_of_cable.len() {
            self.port_of_cable.resize(cable.0 + 1, None);
        }
        if let Some(port) = self.port_of_cable.get_mut(cable.0) {
            *port = Some(self.ports.len());
        }
        let (queue, counters) = (VecDeque::new(), SwitchCounters::default());
        self.ports.push(SwitchPort { cable, side, queue, counters });
    }

    fn port_of(&self, cable: CableId) -> Option<usize> {
        self.port_of_cable.get(cable.0).copied().flatten()
    }

    /// Returns how long a frame of this length takes through the switch if it waits for no other.
    pub(super) fn passage(&self, frame_len: usize) -> Duration {
        self.config.forwarding + self.config.transmission(frame_len.max(SHORTEST_FRAME) + AROUND_FRAME)
    }

    /// Returns how long a TCP segment with so many bytes takes through the switch. Segments wait in no queue.
    pub(super) fn passage_of_segment(&self, len: usize) -> Duration {
        self.passage(len + AROUND_SEGMENT)
    }

    /// Learns where the sender of a frame is, and returns the port of its receiver; `None` if every port may be.
    fn learn(&mut self, by: usize, [source, destination]: [Mac; 2]) -> Option<usize> {
        if !source.is_group() {
            self.learned.insert(source, by);
        }
        if destination.is_group() { None } else { self.learned.get(destination) }
    }
}

impl<M: Multihomed> Network<M> {
    /// Returns what a switch's port did to the frames that it sent into a cable.
    #[must_use]
    pub fn switch_counters(&self, switch: SwitchId, cable: CableId) -> SwitchCounters {
        let port = self
            .switches
            .get(switch.0)
            .and_then(|switch| switch.port_of(cable).and_then(|port| switch.ports.get(port)));
        port.map(|port| port.counters).unwrap_or_default()
    }

    /// Forwards a frame that has arrived at a switch by this cable.
    pub(super) fn forward(&mut self, id: SwitchId, by: CableId, frame: Frame) {
        match self.switches.get(id.0).map(|switch| switch.forwarding) {
            Some(Forwarding::ByAddress) => self.forward_by_address(id, by, frame),
            Some(Forwarding::ToNextPort) => self.forward_to_next_port(id, by, frame),
            None => {}
        }
    }

    /// Passes a frame on to the next port, or from the last one that has a link to the first.
    fn forward_to_next_port(&mut self, id: SwitchId, by: CableId, frame: Frame) {
        let Some(switch) = self.switches.get(id.0) else { return };
        let Some(by) = switch.port_of(by) else { return };
        let next = switch.ports.get(by + 1).filter(|port| self.has_link(port)).map_or(0, |_| by + 1);
        self.send_from_switch(id, next, frame);
    }

    /// Returns whether a port's cable is whole and has a running node at its other end.
    fn has_link(&self, port: &SwitchPort) -> bool {
        let cable = self.cables.get(port.cable.0).filter(|cable| !cable.is_cut());
        let far_end = cable.map(|cable| cable.end(port.side.other()));
        matches!(far_end, Some(Plug::Nic(NicId(nic))) if self.nics.get(nic).is_some_and(|nic| self.is_alive(nic.node)))
    }

    fn forward_by_address(&mut self, id: SwitchId, by: CableId, frame: Frame) {
        let bytes = frame.buf.get(..frame.len).unwrap_or_default();
        let macs = match (frame.port, frame.hop) {
            (Port::Ethernet, _) => match EthernetHeader::parse(bytes) {
                Ok((header, _)) => [header.source, header.destination],
                Err(_) => return self.spare_bufs.push(frame.buf),
            },
            (_, Some(macs)) => macs,
            (_, None) => return self.spare_bufs.push(frame.buf),
        };
        let Some(switch) = self.switches.get_mut(id.0) else { return };
        let Some(by) = switch.port_of(by) else { return };
        let ports = match switch.learn(by, macs) {
            Some(port) => port..port + 1,
            None => 0..switch.ports.len(),
        };
        let (first, last) = (ports.start, ports.end.saturating_sub(1));
        let last = if last == by && last > first { last - 1 } else { last };
        for port in ports.start..last {
            if port != by {
                let copy = self.copy(&frame);
                self.send_from_switch(id, port, copy);
            }
        }
        // The last one needs no copy.
        if last == by { self.spare_bufs.push(frame.buf) } else { self.send_from_switch(id, last, frame) }
    }

    fn send_from_switch(&mut self, SwitchId(switch): SwitchId, port: usize, mut frame: Frame) {
        let Some(switch) = self.switches.get_mut(switch) else { return };
        let config = switch.config;
        let Some(port) = switch.ports.get_mut(port) else { return };
        let around = if frame.port == Port::Ethernet { 0 } else { AROUND_DATAGRAM };
        let on_wire = (frame.len + around).max(SHORTEST_FRAME) + AROUND_FRAME;
        let ready = self.now + config.forwarding;
        let Some(sent) = port.enqueue(ready, config.transmission(on_wire), config.queue_len) else {
            return self.spare_bufs.push(frame.buf);
        };
        let (cable, side) = (port.cable, port.side);
        let Some(link) = self.cables.get_mut(cable.0).map(|cable| cable.link(side)) else { return };
        let bytes = frame.buf.get(..frame.len).unwrap_or_default();
        let (effect, arrives) = if frame.label.carrier == Carrier::Ethernet && is_arp(bytes) {
            (LinkEffect::default(), link.pass_of_hosts(sent))
        } else {
            link.decide(sent, frame.len)
        };
        frame.label = Label { effect, ..frame.label };
        self.tap_departure(sent, (cable, side), frame.label, bytes);
        match arrives {
            Some(arrives) => self.put_in((cable, side), arrives, frame),
            None => self.spare_bufs.push(frame.buf),
        }
    }
}
