//! The records of the physical device: its interface and its ports with their neighbours.
//!
//! ```text
//! PDInterfaceDataReal   LengthOwnChassisID u8 · OwnChassisID · padding to 4 · MAC 6 · padding 2 · IP 4 · mask 4 · gateway 4
//! PDPortDataReal        padding 2 · slot u16 · subslot u16 · LengthOwnPortID u8 · OwnPortID · NumberOfPeers u8
//!                       padding to 4 · then for each peer: LengthPeerPortName u8 · PeerPortName
//!                         LengthPeerStationName u8 · PeerStationName · padding to 4 · LineDelay u32 · MAC 6 · padding 2
//!                       MAUType u16 · padding 2 · DomainBoundary u32 · MulticastBoundary u32
//!                       LinkState.Port u8 · LinkState.Link u8 · padding 2 · MediaType u32
//! MultipleBlockHeader   padding 2 · API u32 · slot u16 · subslot u16 · then the blocks of that submodule
//! ```
//!
//! Padding is counted from the start of the block.

use crate::block::{self, BlockType, BlockWriter};
use crate::connect::API;
use crate::dcp::IpSuite;
use crate::description::{Description, INTERFACE_SUBSLOT, PORT_SUBSLOT};
use crate::lldp::Neighbour;
use crate::mau::MauType;
use machine::ethernet::Mac;

/// LinkState.Link: up. Who reads the record has come by this link.
const LINK_UP: u8 = 1;

/// What a station says of its interface and its ports.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct PhysicalDevice<'a> {
    /// Its name, which is its OwnChassisID.
    pub name: &'a [u8],
    /// MAC address of the interface.
    pub mac: Mac,
    /// IP address of the interface.
    pub ip: IpSuite,
    /// The neighbour of its first port, if it is known.
    pub neighbour: Option<&'a Neighbour>,
}

impl PhysicalDevice<'_> {
    /// Writes PDInterfaceDataReal.
    pub fn emit_interface(&self, writer: &mut BlockWriter<'_>) {
        let start = writer.len();
        block::write(writer, BlockType::PdInterfaceDataReal, |w| {
            put_text(self.name, w);
            align(start, w);
            w.bytes(&self.mac.0);
            align(start, w);
            for address in [self.ip.address, self.ip.mask, self.ip.gateway] {
                w.bytes(&address.octets());
            }
        });
    }

    /// Writes PDRealData: the blocks of the interface and of each port.
    pub fn emit_all(&self, description: &Description, writer: &mut BlockWriter<'_>) {
        for (slot, submodule) in description.submodules() {
            let subslot = submodule.subslot;
            if subslot == INTERFACE_SUBSLOT || is_port(subslot) {
                emit_multiple(slot, subslot, writer, |w| {
                    if is_port(subslot) { self.emit_port(slot, subslot, w) } else { self.emit_interface(w) }
                });
            }
        }
    }

    /// Writes PDPortDataReal of a port.
    pub fn emit_port(&self, slot: u16, subslot: u16, writer: &mut BlockWriter<'_>) {
        let start = writer.len();
        block::write(writer, BlockType::PdPortDataReal, |w| {
            w.zeros(2);
            w.u16(slot);
            w.u16(subslot);
            let number = subslot - INTERFACE_SUBSLOT;
            let digit = |power: u16| b'0' + (number / power % 10) as u8;
            put_text(&[b'p', b'o', b'r', b't', b'-', digit(100), digit(10), digit(1)], w);
            let peer = self.neighbour.filter(|_| subslot == PORT_SUBSLOT);
            w.u8(u8::from(peer.is_some()));
            align(start, w);
            if let Some(peer) = peer {
                put_text(peer.port_name(), w);
                put_text(peer.station_name(), w);
                align(start, w);
                // LineDelay: not measured.
                w.u32(0);
                w.bytes(&peer.mac().0);
                align(start, w);
            }
            w.u16(MauType::OF_OUR_PORTS.code());
            align(start, w);
            // DomainBoundary and MulticastBoundary: nothing is blocked.
            w.zeros(8);
            // LinkState.Port: unknown, since no port can be blocked.
            w.bytes(&[0, LINK_UP]);
            align(start, w);
            w.u32(MauType::OF_OUR_PORTS.media_type());
        });
    }
}

/// Writes a MultipleBlockHeader and the blocks of this submodule.
pub(super) fn emit_multiple(
    slot: u16,
    subslot: u16,
    writer: &mut BlockWriter<'_>,
    blocks: impl FnOnce(&mut BlockWriter<'_>),
) {
    block::write(writer, BlockType::MultipleBlockHeader, |w| {
        w.zeros(2);
        w.u32(API);
        w.u16(slot);
        w.u16(subslot);
        blocks(w);
    });
}

/// Returns whether a subslot is one of the ports of the first interface.
#[must_use]
pub const fn is_port(subslot: u16) -> bool {
    subslot >= PORT_SUBSLOT && subslot <= 0x80FF
}

/// Writes a text of up to 255 bytes behind its length.
fn put_text(text: &[u8], writer: &mut BlockWriter<'_>) {
    let text = text.get(..255).unwrap_or(text);
    writer.u8(text.len() as u8);
    writer.bytes(text);
}

fn align(start: usize, writer: &mut BlockWriter<'_>) {
    writer.pad_to(start + (writer.len() - start).next_multiple_of(4));
}
