//! What a station says of itself in its answer to Identify.

use crate::dcp::{Block, Content, IpSuite, Pdu, Station};
use machine::ethernet::Mac;

/// An answer to Identify.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Answer {
    pub(super) mac: Mac,
    /// VendorID and DeviceID, if it gives them.
    pub(super) identity: Option<(u16, u16)>,
    /// DeviceInstance, if it gives one.
    pub(super) instance: Option<u16>,
    pub(super) ip: Option<IpSuite>,
    /// Whether the station reports that another one has its address.
    pub(super) has_conflict: bool,
}

impl Answer {
    /// Reads an answer; `None` if it is malformed.
    pub(super) fn parse(mac: Mac, pdu: &Pdu<'_>) -> Option<Self> {
        let Station { identity, ip, .. } = Station::from_pdu(pdu).ok()?;
        let mut answer = Self { mac, identity, instance: None, ip, has_conflict: false };
        for block in pdu.blocks().flatten() {
            match block.content {
                Content::DeviceInstance(instance) => answer.instance = Some(instance),
                Content::Ip(_) => answer.has_conflict = block.qualifier & Block::ADDRESS_CONFLICT != 0,
                _ => {}
            }
        }
        Some(answer)
    }

    /// Returns whether the station has this name.
    pub(super) fn names(&self, name: &[u8], pdu: &Pdu<'_>) -> bool {
        Station::from_pdu(pdu).is_ok_and(|station| station.name.eq_ignore_ascii_case(name))
    }
}
