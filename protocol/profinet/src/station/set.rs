//! What a Set of DCP changes: name and address of the station, and who may change them.
//!
//! The station sets a name at once. The owner sets an address on the interface, so the answer waits until the owner is done.

use super::{IO_CONTROLLER, NO_ADDRESS, Refusal, Reply, Station};
use crate::dcp::{Block, BlockError, Code, Content, IpSuite, MAX_NAME_LEN, Pdu};
use machine::{Duration, Instant, Requested};

/// Time in which the owner can set an address on the interface. After it, the requester has given up.
const ADDRESS_TIME: Duration = Duration::from_secs(3);

/// Whether the sender of a DCP PDU may change the station.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum SetPermission {
    /// It may.
    Allowed,
    /// Nobody may: an AR runs.
    InOperation,
    /// Others may, but not this sender.
    NotListed,
}

/// Effects of a DCP PDU on the rest of the device.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub(crate) struct Effect {
    /// The address that the owner must set on the interface.
    pub(crate) address: Option<IpSuite>,
    /// The change that was refused since an AR runs.
    pub(crate) refused: Option<Requested>,
}

/// A Set of the address that the owner has not completed yet.
#[derive(Clone, Copy, Debug)]
pub(super) struct PendingSet {
    reply: Reply,
    suite: IpSuite,
    pub(super) deadline: Instant,
}

impl Station {
    /// Handles a Set: executes its blocks and answers, or waits for the owner to set the address.
    pub(super) fn set(
        &mut self,
        now: Instant,
        pdu: &Pdu<'_>,
        mut reply: Reply,
        set_permission: SetPermission,
    ) -> Result<Effect, Refusal> {
        if self
            .pending_set
            .is_some_and(|pending_set| (pending_set.reply.xid, pending_set.reply.to) == (reply.xid, reply.to))
        {
            // A repetition of the Set in progress.
            return Ok(Effect::default());
        }
        // All blocks must be well-formed before any of them is executed.
        if pdu.blocks().any(|block| block.is_err()) {
            return Err(Refusal::Malformed);
        }
        let mut effect = Effect::default();
        for block in pdu.blocks().flatten() {
            let error = self.set_block(&block, set_permission, &mut effect);
            reply.results.push(block.code(), error);
        }
        match effect.address {
            Some(suite) => self.pending_set = Some(PendingSet { reply, suite, deadline: now + ADDRESS_TIME }),
            None => self.queue(now, reply)?,
        }
        Ok(effect)
    }

    /// Executes a block of a Set if it is allowed, and returns the result for the answer.
    fn set_block(
        &mut self,
        block: &Block<'_>,
        set_permission: SetPermission,
        effect: &mut Effect,
    ) -> BlockError {
        let change = self.change(&block.content).filter(|_| set_permission != SetPermission::Allowed);
        effect.refused = effect.refused.or(change);
        match block.content {
            _ if change.is_some() && set_permission == SetPermission::InOperation => BlockError::InOperation,
            _ if change.is_some() => BlockError::NotPossible,
            _ if self.role == IO_CONTROLLER && matches!(block.code().0 >> 8, 1 | 2) => {
                BlockError::NotPossible
            }
            Content::FactoryReset | Content::ResetToFactory if self.role == IO_CONTROLLER => {
                BlockError::NotPossible
            }
            Content::Ip(suite) if suite == self.ip => BlockError::None,
            Content::Ip(suite) if !is_allowed(suite) => BlockError::SuboptionNotSet,
            Content::Ip(_) if self.pending_set.is_some() || effect.address.is_some() => BlockError::Resource,
            Content::Ip(suite) => {
                effect.address = Some(suite);
                BlockError::None
            }
            Content::NameOfStation(name) if !is_station_name(name) => BlockError::SuboptionNotSet,
            Content::NameOfStation(name) => {
                self.rename(name);
                BlockError::None
            }
            Content::FactoryReset | Content::ResetToFactory => {
                let name = core::mem::take(&mut self.factory_name);
                self.rename(&name);
                self.factory_name = name;
                BlockError::None
            }
            Content::Start | Content::End | Content::Signal(_) => BlockError::None,
            _ if matches!(block.code().0 >> 8, 1 | 2 | 5) => BlockError::SuboptionNotSupported,
            _ => BlockError::OptionNotSupported,
        }
    }

    /// Returns the change that a block of a Set requests, if it changes the station's name or address.
    fn change(&self, content: &Content<'_>) -> Option<Requested> {
        match content {
            Content::Ip(suite) if *suite != self.ip => Some(Requested::Address),
            Content::NameOfStation(name) if *name != self.name => Some(Requested::Name),
            Content::FactoryReset | Content::ResetToFactory => Some(Requested::Reset),
            _ => None,
        }
    }

    fn rename(&mut self, name: &[u8]) {
        self.name.clear();
        self.name.extend_from_slice(name.get(..MAX_NAME_LEN).unwrap_or(name));
    }

    /// Reports whether the owner could set the address on the interface. Returns whether the address changed.
    pub(crate) fn address_set(&mut self, now: Instant, done: bool) -> bool {
        let Some(PendingSet { mut reply, suite, .. }) = self.pending_set.take() else { return false };
        if done {
            self.ip = suite;
        } else {
            let address = reply
                .results
                .entries
                .iter_mut()
                .filter(|(code, error)| *code == Code::IP && *error == BlockError::None);
            address.for_each(|(_, error)| *error = BlockError::NotPossible);
        }
        reply.due = now;
        // If there is no room for the answer, it is not sent: the controller repeats the request and is answered at once.
        let _ = self.queue(now, reply);
        done
    }
}

/// Returns whether a station can have this address: a host address or none, with a contiguous mask.
fn is_allowed(suite: IpSuite) -> bool {
    let IpSuite { address, mask, .. } = suite;
    let mask = u32::from(mask);
    let contiguous = mask.leading_ones() + mask.trailing_zeros() >= 32;
    let host = !(address.is_loopback() || address.is_multicast() || address.is_broadcast());
    contiguous && (suite == NO_ADDRESS || host && !address.is_unspecified() && address.octets()[0] < 224)
}

/// Returns whether DCP allows this name: labels of lower-case letters, digits and hyphens, up to 63 bytes each,
/// separated by dots, up to 240 bytes in total; or no name (IEC 61158-6-10, NameOfStationValue).
#[must_use]
pub fn is_station_name(name: &[u8]) -> bool {
    let label = |label: &[u8]| {
        let inner = |byte: &u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || *byte == b'-';
        (1..=63).contains(&label.len())
            && label.iter().all(inner)
            && label.first() != Some(&b'-')
            && label.last() != Some(&b'-')
    };
    name.is_empty() || name.len() <= MAX_NAME_LEN && name.split(|byte| *byte == b'.').all(label)
}
