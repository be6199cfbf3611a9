//! Frames on the cables: how they are sent and delivered. TCP has its own module.

use alloc::boxed::Box;
use core::net::{Ipv4Addr, SocketAddrV4};

use super::Network;
use super::hosts::{self, Nic};
use super::ids::{CableId, NicId, NodeId, Plug};
use super::in_flight::{Frame, FrameArrival, InFlight, holding, new_buf};
use super::tap::{Carrier, Label};
use crate::link::{LinkEffect, flip};
use crate::side::Side;
use machine::ethernet::{EthernetHeader, Mac};
use machine::{Instant, InterfaceId, Multihomed, Port, PortRequest, Source, Transmit};

/// Every station of a network.
const BROADCAST: Mac = Mac([0xFF; 6]);

/// Returns the group address of a multicast datagram (RFC 1112, section 6.4).
fn multicast_mac(group: Ipv4Addr) -> Mac {
    let [_, second, third, fourth] = group.octets();
    Mac([0x01, 0x00, 0x5E, second & 0x7F, third, fourth])
}

impl<M: Multihomed> Network<M> {
    /// Delivers the next frame, or what a stream carries.
    pub(super) fn deliver(&mut self) {
        let Some(InFlight { arrival, .. }) = self.in_flight.pop() else { return };
        let (cable, to, frame) = match arrival {
            FrameArrival::Frame { cable, to, frame } => (cable, to, frame),
            FrameArrival::Part { stream, to, part } => return self.deliver_part(stream, to, part),
            FrameArrival::StreamTimeout(stream) => return self.give_up_stream(stream),
        };
        self.tap_arrival(self.now, (cable, to), frame.label, frame.buf.get(..frame.len).unwrap_or_default());
        match self.plug(cable, to) {
            Some(Plug::Nic(nic)) => self.receive(nic, frame),
            Some(Plug::Switch(switch)) => self.forward(switch, cable, frame),
            None => {}
        }
    }

    /// Receives a frame at a node's interface.
    fn receive(&mut self, id: NicId, Frame { port, peer, label, hop, buf, len }: Frame) {
        let frame = buf.get(..len).unwrap_or_default();
        let Some(node) = self.nics.get(id.0).map(|nic| nic.node) else { return };
        if self.is_alive(node) {
            if label.carrier == Carrier::Ethernet {
                self.handle_arp(id, frame);
            }
            let mut index = 0;
            while let Some(nic) = self.nics.get(id.0)
                && let Some(on) = nic.serves.get(index).copied()
            {
                index += 1;
                if self.takes(nic, on, (port, label.carrier, hop), frame) {
                    self.hand_over(node, on, Source { port, peer }, label.carrier, frame);
                }
            }
        }
        self.spare_bufs.push(buf);
    }

    fn hand_over(&mut self, id: NodeId, on: InterfaceId, from: Source, carrier: Carrier, frame: &[u8]) {
        let local = self.read_clock(id);
        let Some(node) = self.nodes.get_mut(id.0) else { return };
        match carrier {
            Carrier::Udp { to, .. } if to.ip().is_broadcast() => {
                node.machine.handle_broadcast(local, on, from, frame);
            }
            _ => node.machine.handle_frame(local, on, from, frame),
        }
        self.poll_machine(id, local);
    }

    /// Returns whether an interface of a machine receives a frame that has arrived at its host's interface.
    fn takes(
        &self,
        nic: &Nic,
        on: InterfaceId,
        (port, carrier, hop): (Port, Carrier, Option<[Mac; 2]>),
        frame: &[u8],
    ) -> bool {
        let Some(node) = self.nodes.get(nic.node.0) else { return false };
        let machine = &node.machine;
        let ports = machine.ports(on);
        // Of several interfaces of the machine, the one with the port gets it. A single one gets everything.
        let is_shared = nic.serves.len() > 1;
        match carrier {
            Carrier::Udp { to, .. } => {
                if is_shared && !ports.contains(&PortRequest::Udp(to.port())) {
                    return false;
                }
                if to.ip().is_multicast() {
                    let joined = |index| machine.group(on, port, index);
                    return (0..).map_while(joined).any(|joined| joined == *to.ip());
                }
                let is_mine = |[_, mac]: [Mac; 2]| nic.mac == Some(mac) && nic.address == Some(*to.ip());
                to.ip().is_broadcast() || hop.is_none_or(is_mine)
            }
            Carrier::Ethernet | Carrier::Tcp { .. } => {
                hosts::takes_arp(ports, frame)
                    && (!nic.is_selective || is_addressed(nic, ports, frame))
                    && (!is_shared || has_opened(ports, frame))
            }
        }
    }

    /// Puts a frame that a machine has written into its cable.
    pub(super) fn send(&mut self, node: NodeId, on: InterfaceId, Transmit { port, to, len }: Transmit) {
        let Some(id) = self.nodes.get(node.0).and_then(|node| node.nic(on)) else { return };
        if let Port::Stream(stream) = port {
            return self.send_stream(id, stream, len);
        }
        let now = self.now;
        let dscp = self.dscp(node, on, port);
        let Some((cable, side)) = self.nics.get(id.0).and_then(|nic| nic.cable) else { return };
        let (port, peer, hop, carrier) = match (port, to) {
            (Port::Udp(local), Some(to)) => {
                let Some((source, hop)) = self.route(id, on, (cable, side), to) else { return };
                let source = SocketAddrV4::new(source, local);
                (Port::Udp(to.port()), Some(source), hop, Carrier::Udp { source, to })
            }
            (port, _) => (port, None, None, Carrier::Ethernet),
        };
        let (Some(nic), Some(link)) =
            (self.nics.get_mut(id.0), self.cables.get_mut(cable.0).map(|cable| cable.link(side)))
        else {
            return;
        };
        let (effect, arrives) = match (port, self.buf.get(..len)) {
            (Port::Ethernet, Some(frame)) => {
                nic.learn_mac(frame);
                if hosts::is_arp(frame) {
                    (LinkEffect::default(), link.pass_of_hosts(now))
                } else {
                    link.decide(now, len)
                }
            }
            _ => link.decide(now, len),
        };
        let label = Label { carrier, dscp, effect };
        let buf = self.take_buf();
        self.tap_departure(now, (cable, side), label, buf.get(..len).unwrap_or_default());
        let Some(arrives) = arrives else { return self.spare_bufs.push(buf) };
        self.put_in((cable, side), arrives, Frame { port, peer, label, hop, buf, len });
    }

    /// Puts a frame in flight that gets through, with the faults of its label.
    pub(super) fn put_in(&mut self, (cable, from): (CableId, Side), arrives: Instant, mut frame: Frame) {
        let effect = frame.label.effect;
        if let Some(bit) = effect.flipped_bit {
            flip(&mut frame.buf, bit);
        }
        let to = from.other();
        let second = effect.duplicated.then(|| self.copy(&frame));
        self.in_flight.push(arrives, FrameArrival::Frame { cable, to, frame });
        if let Some(frame) = second {
            self.in_flight.push(arrives, FrameArrival::Frame { cable, to, frame });
        }
    }

    pub(super) fn copy(&mut self, frame: &Frame) -> Frame {
        let Frame { port, peer, label, hop, ref buf, len } = *frame;
        Frame { port, peer, label, hop, buf: holding(self.spare_bufs.pop(), buf.get(..len)), len }
    }

    /// Returns the source address of a datagram and, on a switch, the MAC addresses of its packet; `None` if it is not sent.
    fn route(
        &mut self,
        id: NicId,
        on: InterfaceId,
        (cable, side): (CableId, Side),
        to: SocketAddrV4,
    ) -> Option<(Ipv4Addr, Option<[Mac; 2]>)> {
        let (source, mac) = self.nics.get(id.0).map(|nic| (nic.address, nic.mac))?;
        let to = *to.ip();
        if let Plug::Nic(peer) = self.plug(cable, side.other())? {
            let is_known = || self.nics.get(peer.0).is_some_and(|peer| peer.address == Some(to));
            return source
                .filter(|_| to.is_broadcast() || to.is_multicast() || is_known())
                .map(|source| (source, None));
        }
        let source = source?;
        let hop = match to {
            _ if to.is_broadcast() => BROADCAST,
            _ if to.is_multicast() => multicast_mac(to),
            _ => self.next_hop(id, on, to)?,
        };
        Some((source, Some([mac?, hop])))
    }

    /// Takes the buffer with a written frame, to send it; another one replaces it.
    fn take_buf(&mut self) -> Box<[u8]> {
        let spare = self.spare_bufs.pop().unwrap_or_else(new_buf);
        core::mem::replace(&mut self.buf, spare)
    }
}

/// Returns whether an interface takes a frame by its destination: its own address, a group, or any where it is promiscuous.
fn is_addressed(nic: &Nic, ports: &[PortRequest], frame: &[u8]) -> bool {
    let Ok((header, _)) = EthernetHeader::parse(frame) else { return false };
    let takes_any = |request: &PortRequest| matches!(request, PortRequest::AnyEthernet { ether_type } if *ether_type == header.ether_type);
    header.destination.is_group() || nic.mac == Some(header.destination) || ports.iter().any(takes_any)
}

/// Returns whether one of these ports is for the EtherType of a frame.
fn has_opened(ports: &[PortRequest], frame: &[u8]) -> bool {
    let Ok((header, _)) = EthernetHeader::parse(frame) else { return false };
    let is_for = |request: &PortRequest| {
        matches!(request, PortRequest::Ethernet { ether_type, .. } | PortRequest::AnyEthernet { ether_type }
            if *ether_type == header.ether_type)
    };
    ports.iter().any(is_for)
}
