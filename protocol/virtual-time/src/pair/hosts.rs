//! What the host of a station does beside its machine: it answers ARP requests for its address, as a kernel does.

use super::in_flight::{Delivery, new_buf};
use super::tap::{Carrier, Label};
use super::{Pair, Station};
use crate::link::LinkEffect;
use crate::side::Side;
use machine::arp::{self, ArpPacket, Operation};
use machine::ethernet::EthernetHeader;
use machine::{Machine, Port, PortRequest};

/// Returns whether an Ethernet frame carries ARP, by its EtherType. Nothing sends ARP in tagged frames here.
pub(crate) fn is_arp(frame: &[u8]) -> bool {
    frame.get(12..14) == Some(&arp::ETHER_TYPE.to_be_bytes())
}

/// Returns whether a machine with these ports receives an Ethernet frame, if that carries ARP.
pub(crate) fn takes_arp(ports: &[PortRequest], frame: &[u8]) -> bool {
    let is_for_arp = |request: &PortRequest| {
        matches!(request, PortRequest::Ethernet { ether_type, .. } | PortRequest::AnyEthernet { ether_type }
            if *ether_type == arp::ETHER_TYPE)
    };
    !is_arp(frame) || ports.iter().any(is_for_arp)
}

impl Station {
    /// Remembers its own MAC address when its machine sends the first Ethernet frame.
    pub(super) fn learn_mac(&mut self, frame: &[u8]) {
        if self.mac.is_none() {
            self.mac = EthernetHeader::parse(frame).ok().map(|(header, _)| header.source);
        }
    }
}

impl<A: Machine, B: Machine> Pair<A, B> {
    /// Returns whether the machine has a port for the frame. Only ARP is asked for by some and not by others.
    pub(super) fn has_opened(&self, side: Side, port: Port, frame: &[u8]) -> bool {
        let ports = match side {
            Side::A => self.a.ports(),
            Side::B => self.b.ports(),
        };
        port != Port::Ethernet || takes_arp(ports, frame)
    }

    /// Answers a question for the address of this side, as its kernel would.
    pub(super) fn answer_arp(&mut self, side: Side, frame: &[u8]) {
        let now = self.now;
        let station = self.station(side);
        let (Some(Ok(packet)), Some(mac)) = (ArpPacket::from_frame(frame), station.mac) else { return };
        if packet.operation != Operation::Request || station.address != Some(packet.target_address) {
            return;
        }
        let arrives = station.link.pass_of_hosts(now);
        let mut buf = self.spare_bufs.pop().unwrap_or_else(new_buf);
        let Ok(len) = packet.answer(mac).emit_frame(&mut buf) else { return };
        let label = Label {
            carrier: Carrier::Ethernet,
            dscp: 0,
            effect: LinkEffect { cut: arrives.is_none(), ..LinkEffect::default() },
        };
        self.tap_departure(now, side, label, buf.get(..len).unwrap_or_default());
        let Some(arrives) = arrives else { return };
        let delivery = Delivery::Frame { port: Port::Ethernet, peer: None, label, buf, len };
        self.in_flight.push(arrives, side.other(), delivery);
    }
}
