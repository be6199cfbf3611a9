//! What the host of a node does beside its machine: it answers ARP requests for its address, as a kernel does, and on a
//! switch it has a table of neighbours, which never ages: it sends a datagram to the MAC address that the table has, or first
//! asks who has the IP address and takes the first answer.

use alloc::collections::BTreeMap;
use alloc::vec::Vec;
use core::net::Ipv4Addr;

use super::Network;
use super::ids::{CableId, NicId, NodeId, Plug};
use super::in_flight::{Frame, FrameArrival, new_buf};
use super::tap::{Carrier, Label};
use crate::link::LinkEffect;
use crate::side::Side;
use machine::arp::{self, ArpPacket, Operation};
use machine::ethernet::{EthernetHeader, Mac};
use machine::{InterfaceId, Multihomed, Port, PortRequest};

/// An interface of a node's host.
#[derive(Debug)]
pub(super) struct Nic {
    pub(super) node: NodeId,
    /// The interfaces of the machine that it serves.
    pub(super) serves: Vec<InterfaceId>,
    /// The MAC address that was given, or that of the first Ethernet frame of its machine: from then on the host answers ARP.
    pub(super) mac: Option<Mac>,
    /// Whether it takes only frames to this address and to groups.
    pub(super) is_selective: bool,
    pub(super) address: Option<Ipv4Addr>,
    /// MAC addresses that the host knows.
    neighbours: BTreeMap<Ipv4Addr, Mac>,
    /// Whether the driver may correct them, as a process with `CAP_NET_ADMIN` may.
    may_correct: bool,
    /// Its cable, and which side of it this is.
    pub(super) cable: Option<(CableId, Side)>,
}

/// Returns whether an Ethernet frame carries ARP, by its EtherType. Nothing sends ARP in tagged frames here.
#[inline]
pub(super) fn is_arp(frame: &[u8]) -> bool {
    frame.get(12..14) == Some(&arp::ETHER_TYPE.to_be_bytes())
}

/// Returns whether a machine with these ports receives an Ethernet frame, if that carries ARP.
#[inline]
pub(super) fn takes_arp(ports: &[PortRequest], frame: &[u8]) -> bool {
    let is_for_arp = |request: &PortRequest| {
        matches!(request, PortRequest::Ethernet { ether_type, .. } | PortRequest::AnyEthernet { ether_type }
            if *ether_type == arp::ETHER_TYPE)
    };
    !is_arp(frame) || ports.iter().any(is_for_arp)
}

impl Nic {
    pub(super) fn new(
        node: NodeId,
        serves: &[InterfaceId],
        mac: Option<Mac>,
        address: Option<Ipv4Addr>,
    ) -> Self {
        Self {
            node,
            serves: serves.to_vec(),
            mac,
            is_selective: mac.is_some(),
            address,
            neighbours: BTreeMap::new(),
            may_correct: true,
            cable: None,
        }
    }

    /// Remembers its own MAC address when its machine sends the first Ethernet frame.
    #[inline]
    pub(super) fn learn_mac(&mut self, frame: &[u8]) {
        if self.mac.is_none() {
            self.mac = EthernetHeader::parse(frame).ok().map(|(header, _)| header.source);
        }
    }

    /// Forgets what it has learned, as a computer that was switched off.
    pub(super) fn forget(&mut self) {
        self.mac = self.mac.filter(|_| self.is_selective);
        self.neighbours.clear();
    }
}

impl<M: Multihomed> Network<M> {
    /// Gives an interface of a node an IP address, as its operating system would.
    pub fn set_address(&mut self, node: NodeId, on: InterfaceId, address: Option<Ipv4Addr>) {
        if let Some(nic) = self.nic_of(node, on) {
            nic.address = address;
        }
    }

    /// Sets whether the driver of a node's interface may correct its host's table of neighbours. It may at the start.
    pub fn set_may_correct(&mut self, node: NodeId, on: InterfaceId, may_correct: bool) {
        if let Some(nic) = self.nic_of(node, on) {
            nic.may_correct = may_correct;
        }
    }

    /// Returns the cable of a node's interface.
    #[must_use]
    pub fn cable(&self, node: NodeId, on: InterfaceId) -> Option<CableId> {
        let nic = self.nodes.get(node.0)?.nic(on)?;
        self.nics.get(nic.0)?.cable.map(|(cable, _)| cable)
    }

    fn nic_of(&mut self, node: NodeId, on: InterfaceId) -> Option<&mut Nic> {
        let nic = self.nodes.get(node.0)?.nic(on)?;
        self.nics.get_mut(nic.0)
    }

    /// Handles an ARP packet as a host does: answers a question for its address, and keeps its table up to date, as the Linux
    /// kernel does. A packet changes an entry that exists; a question for the host's own address makes one.
    pub(super) fn handle_arp(&mut self, id: NicId, frame: &[u8]) {
        let Some(Ok(packet)) = ArpPacket::from_frame(frame) else { return };
        let Some(nic) = self.nics.get_mut(id.0) else { return };
        let asks = packet.operation == Operation::Request && nic.address == Some(packet.target_address);
        let sender = packet.sender_address;
        if !packet.is_probe() && (asks || nic.neighbours.contains_key(&sender)) {
            nic.neighbours.insert(sender, packet.sender_mac);
        }
        let (Some(mac), Some((cable, side)), true) = (nic.mac, nic.cable, asks) else { return };
        let arrives = self.pass_of_hosts(cable, side, self.now);
        let mut buf = self.spare_bufs.pop().unwrap_or_else(new_buf);
        let Ok(len) = packet.answer(mac).emit_frame(&mut buf) else { return };
        let effect = LinkEffect { cut: arrives.is_none(), ..LinkEffect::default() };
        let label = Label { carrier: Carrier::Ethernet, dscp: 0, effect };
        self.tap_departure(self.now, (cable, side), label, buf.get(..len).unwrap_or_default());
        let Some(arrives) = arrives else { return };
        let frame = Frame { port: Port::Ethernet, peer: None, label, hop: None, buf, len };
        self.in_flight.push(arrives, FrameArrival::Frame { cable, to: side.other(), frame });
    }

    /// Returns the MAC address to which a host on a switch sends a datagram; `None` if it sends nothing.
    pub(super) fn next_hop(&mut self, id: NicId, on: InterfaceId, to: Ipv4Addr) -> Option<Mac> {
        let nic = self.nics.get(id.0)?;
        let (node, may_correct) = (nic.node, nic.may_correct);
        let known = nic.neighbours.get(&to).copied();
        let known = known.or_else(|| self.others(id).find(|(_, other)| other.address == Some(to))?.1.mac);
        let machine = &mut self.nodes.get_mut(node.0)?.machine;
        let hop = match (machine.neighbour(on, to), known) {
            (Some(wanted), Some(found)) if wanted != found && !may_correct => {
                let now = self.read_clock(node);
                self.nodes.get_mut(node.0)?.machine.handle_wrong_neighbour(now, on, to, found);
                return None;
            }
            (Some(wanted), _) => wanted,
            (None, known) => known?,
        };
        self.nics.get_mut(id.0)?.neighbours.insert(to, hop);
        Some(hop)
    }

    /// Returns the interfaces of other nodes on the same switch, in the order in which they were added.
    pub(super) fn others(&self, id: NicId) -> impl Iterator<Item = (NicId, &Nic)> + '_ {
        let switch = self.switch_of(id);
        let is_other = move |other: NicId| other != id && switch.is_some() && self.switch_of(other) == switch;
        let numbered = self.nics.iter().enumerate().map(|(index, nic)| (NicId(index), nic));
        numbered.filter(move |(id, nic)| is_other(*id) && self.is_alive(nic.node))
    }

    fn switch_of(&self, NicId(nic): NicId) -> Option<Plug> {
        let (cable, side) = self.nics.get(nic)?.cable?;
        self.plug(cable, side.other()).filter(|plug| plug.is_switch())
    }
}
