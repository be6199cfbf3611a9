//! Direction, place and cycle of cyclic frames, by the start of their connection: Connect of PROFINET, Forward_Open of EtherNet/IP.

mod ethernet_ip;
mod profinet;

use std::net::SocketAddrV4;

use ::ethernet_ip::ENCAPSULATION_PORT;
use machine::ethernet::Mac;

use crate::address::{CyclicBus, EndAddress};
use crate::content::ImageDirection;
use crate::cyclic::FlowKey;
use crate::packet::{EthernetPacket, Payload};

/// Connections that are remembered; the oldest is forgotten for a newer one.
const MAX_RELATIONS: usize = 64;

/// Cyclic frames of one direction, as agreed when the connection was set up.
#[derive(Clone, PartialEq, Eq, Debug)]
pub(crate) struct Agreement {
    pub(crate) direction: ImageDirection,
    /// FrameID, or number of the connection.
    connection: u32,
    /// Addresses of the sender.
    from: [Option<EndAddress>; 2],
    /// Position and length in bytes of the parts of the image in the data; empty if the standard leaves it to the devices.
    pub(crate) parts: Vec<(usize, usize)>,
    /// Length of the data in bytes, if it is known.
    pub(crate) sdu_len: Option<usize>,
    /// Time from frame to frame in ns.
    pub(crate) cycle_ns: u64,
    /// Counts of the frames' counter in one cycle.
    pub(crate) step: u32,
}

/// Identity of one end, as far as the capture shows it.
#[derive(Clone, PartialEq, Eq, Default, Debug)]
pub(crate) struct PeerTraits {
    pub(crate) mac: Option<Mac>,
    pub(crate) ip: Option<std::net::Ipv4Addr>,
    /// Name of the station, or of the product.
    pub(crate) name: Option<String>,
    /// Vendor, device and the like, in words.
    pub(crate) identity: Option<String>,
}

impl PeerTraits {
    fn has(&self, address: EndAddress) -> bool {
        match address {
            EndAddress::Mac(mac) => self.mac == Some(mac),
            EndAddress::Ip(ip) => self.ip == Some(ip),
        }
    }
}

/// A connection whose start is in the capture.
#[derive(Clone, PartialEq, Eq, Debug)]
struct Relation {
    plc: PeerTraits,
    robot: PeerTraits,
    agreements: Vec<Agreement>,
}

impl Relation {
    fn agreement(&self, key: &FlowKey) -> Option<&Agreement> {
        let is_of = |agreement: &&Agreement| {
            let is_of_bus = (agreement.step == 1) == (key.bus == CyclicBus::EthernetIp);
            is_of_bus && agreement.connection == key.connection && agreement.from.contains(&Some(key.from))
        };
        self.agreements.iter().find(is_of)
    }
}

/// All connections whose start is in the capture.
#[derive(Default, Debug)]
pub(crate) struct Relations {
    profinet: profinet::Connects,
    ethernet_ip: ethernet_ip::Opens,
    relations: Vec<Relation>,
}

impl Relations {
    /// Reads a packet that may start a connection; returns whether it did.
    pub(crate) fn read(&mut self, packet: &EthernetPacket<'_>) -> bool {
        let macs = (packet.source, packet.destination);
        let relation = match packet.payload {
            Payload::Udp { from, to, data } => self.profinet.read((from, to), data),
            Payload::Tcp { from, to, data } if has_port(ENCAPSULATION_PORT, from, to) => {
                self.ethernet_ip.read(macs, (from, to), data)
            }
            _ => None,
        };
        let Some(relation) = relation else { return false };
        if self.relations.len() >= MAX_RELATIONS {
            self.relations.remove(0);
        }
        self.relations.push(relation);
        true
    }

    /// Returns what was agreed for these frames, by the last connection that has them.
    pub(crate) fn agreement(&self, key: &FlowKey) -> Option<&Agreement> {
        self.relations.iter().rev().find_map(|relation| relation.agreement(key))
    }

    /// Returns what was agreed for these frames when the newest connection was set up, if they belong to it.
    pub(crate) fn newest_agreement(&self, key: &FlowKey) -> Option<&Agreement> {
        self.relations.last()?.agreement(key)
    }

    /// Returns what the capture shows of the PLC or of the robot with this address.
    pub(crate) fn traits_of(&self, direction: ImageDirection, address: EndAddress) -> PeerTraits {
        let ends = self.relations.iter().rev().map(|relation| match direction {
            ImageDirection::Command => &relation.plc,
            ImageDirection::Feedback => &relation.robot,
        });
        ends.into_iter().find(|end| end.has(address)).cloned().unwrap_or_default()
    }
}

fn has_port(port: u16, from: SocketAddrV4, to: SocketAddrV4) -> bool {
    from.port() == port || to.port() == port
}
