//! What a Set of DCP changes: name and address of the station, for now or permanently, and who may change them.
//!
//! ```text
//! Set ──▶ SetAddress, the owner sets the interface ──▶ Store, the owner stores ──▶ answer
//! ```
//!
//! Each step is left out if nothing changes. A Set for now removes what was stored of the same kind: after a restart the
//! station has the name or address of its factory again (IEC 61158-6-10, BlockQualifier).

use alloc::vec::Vec;

use super::rules::is_address;
use super::{IO_CONTROLLER, NO_ADDRESS, Refusal, Reply, Station};
use crate::dcp::{Block, BlockError, Code, Content, IpSuite, MAX_NAME_LEN, Pdu, Violation};
use crate::is_station_name;
use crate::record::Maintenance;
use machine::{Duration, Instant, Requested};

/// Time in which the owner can carry out one step. After it, the requester has given up.
const STEP_TIME: Duration = Duration::from_secs(3);

/// Time after a Set that changed something in which only the same station can set (IEC 61158-5-10, client hold time).
const CLIENT_HOLD_TIME: Duration = Duration::from_secs(3);

/// Bit of BlockQualifier: store the value permanently.
const PERMANENT: u16 = 1;

/// Mode of ResetToFactory, in bits 1 to 15 of its BlockQualifier: the communication parameters, which are name and address.
/// Every station must be able to reset them.
const RESET_COMMUNICATION: u16 = 2;
/// Mode of ResetToFactory: all that the station stores, so also what the operator wrote.
const RESET_ALL: u16 = 8;

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
    /// The owner's next step.
    pub(crate) step: Option<OwnerStep>,
    /// The change that was refused since an AR runs.
    pub(crate) refused: Option<Requested>,
}

/// A step of a Set that the owner carries out.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum OwnerStep {
    /// It sets this address on the interface.
    SetAddress(IpSuite),
    /// It stores what [`Station::to_store`] returns, and removes the rest from its storage.
    Store,
}

/// A Set that the owner has not completed yet.
#[derive(Clone, Copy, Debug)]
pub(super) struct PendingSet {
    reply: Reply,
    change: Change,
    step: OwnerStep,
    pub(super) deadline: Instant,
}

/// What one Set changes. The new name is in [`Station::new_name`].
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
struct Change {
    /// Whether the name changes, and for how long.
    name: Option<Lasting>,
    /// The new address, and for how long.
    address: Option<(IpSuite, Lasting)>,
    /// Whether I&M1 to 4 are removed.
    clears_maintenance: bool,
}

/// For how long a value is set.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Lasting {
    /// Until the next restart.
    ForNow,
    /// Until it is set again.
    Permanently,
}

impl From<u16> for Lasting {
    fn from(qualifier: u16) -> Self {
        if qualifier & PERMANENT == 0 { Self::ForNow } else { Self::Permanently }
    }
}

impl Station {
    /// Handles a Set: executes its blocks and answers, or waits for the owner.
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
        // No block is executed if it cannot be told where one of them ends.
        let is_cut = |block: &Result<_, _>| matches!(block, Err(error) if !matches!(error, Violation::BlockLength { .. }));
        if pdu.blocks().any(|block| is_cut(&block)) {
            return Err(Refusal::Malformed);
        }
        let (mut change, mut effect) = (Change::default(), Effect::default());
        for block in pdu.blocks() {
            let (code, error) = match block {
                Ok(block) => {
                    let changes = self.requested(&block).is_some();
                    let error = self.set_block(&block, set_permission, &mut change, &mut effect);
                    if changes && error == BlockError::None {
                        self.client = Some((reply.to, now + CLIENT_HOLD_TIME));
                    }
                    (block.code(), error)
                }
                Err(Violation::BlockLength { code, .. }) => (code, self.length_error(code)),
                Err(_) => continue,
            };
            reply.results.push(code, error);
        }
        match self.next_step(None, change) {
            Some(step) => {
                effect.step = Some(step);
                self.pending_set = Some(PendingSet { reply, change, step, deadline: now + STEP_TIME });
            }
            None => {
                self.complete(now, change);
                self.queue(now, reply)?;
            }
        }
        Ok(effect)
    }

    /// Returns the error of a block whose length is not that of its option.
    fn length_error(&self, code: Code) -> BlockError {
        match code {
            _ if self.role == IO_CONTROLLER => BlockError::NotPossible,
            Code::IP | Code::SIGNAL => BlockError::SuboptionNotSet,
            _ => not_supported(code),
        }
    }

    /// Checks a block of a Set, adds what it changes to `change`, and returns the result for the answer.
    fn set_block(
        &mut self,
        block: &Block<'_>,
        set_permission: SetPermission,
        change: &mut Change,
        effect: &mut Effect,
    ) -> BlockError {
        let refused = self.requested(block).filter(|_| set_permission != SetPermission::Allowed);
        effect.refused = effect.refused.or(refused);
        let lasting = Lasting::from(block.qualifier);
        let is_permanent = lasting == Lasting::Permanently;
        match block.content {
            _ if refused.is_some() && set_permission == SetPermission::InOperation => BlockError::InOperation,
            _ if refused.is_some() => BlockError::NotPossible,
            Content::Start | Content::End | Content::Signal(_) => BlockError::None,
            _ if self.role == IO_CONTROLLER && matches!(block.code().0 >> 8, 1 | 2 | 5) => {
                BlockError::NotPossible
            }
            Content::Ip(suite) if !is_address(suite) => BlockError::SuboptionNotSet,
            Content::NameOfStation(name) if !is_station_name(name) => BlockError::SuboptionNotSet,
            Content::ResetToFactory if !matches!(block.qualifier >> 1, RESET_COMMUNICATION | RESET_ALL) => {
                BlockError::SuboptionNotSupported
            }
            Content::Ip(_) | Content::NameOfStation(_) if is_permanent && self.stored.is_none() => {
                BlockError::NotPossible
            }
            _ if self.requested(block).is_some() && self.pending_set.is_some() => BlockError::Resource,
            Content::Ip(suite) => {
                change.address = Some((suite, lasting));
                BlockError::None
            }
            Content::NameOfStation(name) => {
                copy_name(name, &mut self.new_name);
                change.name = Some(lasting);
                BlockError::None
            }
            Content::FactoryReset | Content::ResetToFactory => {
                copy_name(&self.factory_name, &mut self.new_name);
                change.name = Some(Lasting::ForNow);
                change.address = Some((NO_ADDRESS, Lasting::ForNow));
                change.clears_maintenance |=
                    block.content == Content::FactoryReset || block.qualifier >> 1 == RESET_ALL;
                BlockError::None
            }
            _ => not_supported(block.code()),
        }
    }

    /// Returns the change that a block of a Set requests, if it changes the station's name or address, or what is stored.
    fn requested(&self, block: &Block<'_>) -> Option<Requested> {
        let lasting = block.qualifier.into();
        match block.content {
            Content::Ip(suite) if suite != self.ip || self.must_store_address(suite, lasting) => {
                Some(Requested::Address)
            }
            Content::NameOfStation(name) if name != self.name || self.must_store_name(name, lasting) => {
                Some(Requested::Name)
            }
            Content::FactoryReset | Content::ResetToFactory => Some(Requested::Reset),
            _ => None,
        }
    }

    fn must_store_name(&self, name: &[u8], lasting: Lasting) -> bool {
        self.stored.as_ref().is_some_and(|stored| match lasting {
            Lasting::Permanently => stored.name.as_deref() != Some(name),
            Lasting::ForNow => stored.name.is_some(),
        })
    }

    fn must_store_address(&self, suite: IpSuite, lasting: Lasting) -> bool {
        self.stored.as_ref().is_some_and(|stored| match lasting {
            Lasting::Permanently => stored.address != Some(suite),
            Lasting::ForNow => stored.address.is_some(),
        })
    }

    /// Returns the owner's step after `done`, or its first one.
    fn next_step(&self, done: Option<OwnerStep>, change: Change) -> Option<OwnerStep> {
        let set_address = || {
            let (suite, _) = change.address.filter(|(suite, _)| *suite != self.ip)?;
            Some(OwnerStep::SetAddress(suite))
        };
        let must_store = || {
            change.name.is_some_and(|lasting| self.must_store_name(&self.new_name, lasting))
                || change.address.is_some_and(|(suite, lasting)| self.must_store_address(suite, lasting))
                || change.clears_maintenance
                    && self.maintenance().is_some_and(|it| *it != Maintenance::default())
        };
        let store = || must_store().then_some(OwnerStep::Store);
        match done {
            None => set_address().or_else(store),
            Some(OwnerStep::SetAddress(_)) => store(),
            Some(OwnerStep::Store) => None,
        }
    }

    /// Executes a change that needs no more steps of the owner.
    fn complete(&mut self, now: Instant, change: Change) {
        if change.name.is_some() {
            self.lldp.announce(now);
            copy_name(&self.new_name, &mut self.name);
        }
        let Some(stored) = &mut self.stored else { return };
        if let Some(lasting) = change.name {
            stored.set_name((lasting == Lasting::Permanently).then_some(&self.new_name));
        }
        if let Some((suite, lasting)) = change.address {
            stored.address = (lasting == Lasting::Permanently).then_some(suite);
        }
        if change.clears_maintenance {
            stored.maintenance = Maintenance::default();
        }
    }

    /// Returns what the owner has to store: name, address, and I&M1 to 4, each if there is one.
    pub(crate) fn to_store(&self) -> (Option<&[u8]>, Option<IpSuite>, Option<&Maintenance>) {
        let Some(stored) = &self.stored else { return (None, None, None) };
        let change = self.pending_set.map(|pending_set| pending_set.change).unwrap_or_default();
        let name = match change.name {
            Some(Lasting::Permanently) => Some(&self.new_name[..]),
            Some(Lasting::ForNow) => None,
            None => stored.name.as_deref(),
        };
        let address = match change.address {
            Some((suite, Lasting::Permanently)) => Some(suite),
            Some((_, Lasting::ForNow)) => None,
            None => stored.address,
        };
        let is_written = stored.maintenance != Maintenance::default() && !change.clears_maintenance;
        (name, address, is_written.then_some(&stored.maintenance))
    }

    /// Reports whether the owner could set the address on the interface. Returns whether the address changed, and the
    /// owner's next step.
    pub(crate) fn address_set(&mut self, now: Instant, done: bool) -> (bool, Option<OwnerStep>) {
        let Some(PendingSet { mut reply, mut change, step: step @ OwnerStep::SetAddress(suite), .. }) =
            self.pending_set
        else {
            return (false, None);
        };
        if done {
            self.ip = suite;
            self.lldp.announce(now);
        } else {
            reply.results.refuse(Code::IP);
            reply.results.refuse(Code::RESET_TO_FACTORY);
            reply.results.refuse(Code::FACTORY_RESET);
            change.address = None;
        }
        (done, self.continue_set(now, reply, change, step))
    }

    /// Reports whether the owner could store name and address. Returns whether the name changed.
    pub(crate) fn stored(&mut self, now: Instant, done: bool) -> bool {
        let Some(PendingSet { mut reply, change, step: OwnerStep::Store, .. }) = self.pending_set else {
            return false;
        };
        if !done {
            for code in [Code::IP, Code::NAME_OF_STATION, Code::RESET_TO_FACTORY, Code::FACTORY_RESET] {
                reply.results.refuse(code);
            }
        }
        let change = if done { change } else { Change::default() };
        let renamed = change.name.is_some() && self.new_name != self.name;
        self.continue_set(now, reply, change, OwnerStep::Store);
        renamed
    }

    /// Goes on after a step of the owner: returns the next one, or answers.
    fn continue_set(
        &mut self,
        now: Instant,
        mut reply: Reply,
        change: Change,
        done: OwnerStep,
    ) -> Option<OwnerStep> {
        let next = self.next_step(Some(done), change);
        self.pending_set = next.map(|step| PendingSet { reply, change, step, deadline: now + STEP_TIME });
        if next.is_none() {
            self.complete(now, change);
            reply.due = now;
            // If there is no room for the answer, it is not sent: the controller repeats the request and is answered at once.
            let _ = self.queue(now, reply);
        }
        next
    }
}

const fn not_supported(code: Code) -> BlockError {
    match code.0 >> 8 {
        1 | 2 | 5 => BlockError::SuboptionNotSupported,
        _ => BlockError::OptionNotSupported,
    }
}

/// Copies a name into memory that has room for the longest one.
fn copy_name(name: &[u8], to: &mut Vec<u8>) {
    to.clear();
    to.extend_from_slice(name.get(..MAX_NAME_LEN).unwrap_or(name));
}
