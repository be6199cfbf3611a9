//! All that was found out about the packets of a capture, whatever robot they are of.

use std::collections::BTreeMap;

use machine::ethernet::Mac;

use crate::address::EndAddress;
use crate::cyclic::FlowKey;
use crate::flow::Flow;
use crate::relation::Relations;
use crate::seen::SeenStations;

/// Packets of a capture, by what became of them.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub(crate) struct PacketCounts {
    pub(crate) packets: u64,
    pub(crate) cyclic: u64,
    /// Cyclic frames without their end, because the snapshot length was too short.
    pub(crate) cut: u64,
    /// Packets that are earlier than the one before.
    pub(crate) backwards: u64,
    /// Cyclic frames of connections beyond those that are followed.
    pub(crate) not_followed: u64,
}

/// Packets, connections and their frames.
#[derive(Default, Debug)]
pub(crate) struct Traffic {
    pub(crate) relations: Relations,
    /// Stations by what they and others say of them.
    pub(crate) seen: SeenStations,
    pub(crate) flows: BTreeMap<FlowKey, Flow>,
    /// Interfaces of the senders of cyclic frames.
    pub(crate) macs: BTreeMap<EndAddress, Mac>,
    pub(crate) counts: PacketCounts,
}

impl Traffic {
    /// Applies the connection that was set up last to frames that are known already: numbers may be used again.
    pub(crate) fn agree(&mut self) {
        for flow in self.flows.values_mut() {
            if let Some(agreement) = self.relations.newest_agreement(&flow.key) {
                flow.agree(agreement);
            }
        }
    }
}
