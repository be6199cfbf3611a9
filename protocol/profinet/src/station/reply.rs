//! The answers of a station to DCP, and what they say.

use super::{MOST_BLOCKS, MOST_REPLIES, OPTIONS, Refusal, Station};
use crate::ETHER_TYPE;
use crate::dcp::{self, Block, BlockError, Code, Content, Service};
use crate::rpc::INSTANCE;
use machine::Instant;
use machine::ethernet::{EthernetHeader, Mac};

/// An answer that waits to be sent.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reply {
    pub(super) to: Mac,
    pub(super) xid: u32,
    pub(super) due: Instant,
    pub(super) service: Service,
    pub(super) results: Results,
}

/// Results of the blocks of a Set, or the options that a Get requests, or that an Identify request names beside those that
/// every answer has.
#[derive(Clone, Copy, Debug)]
pub(super) struct Results {
    entries: [(Code, BlockError); MOST_BLOCKS],
    len: usize,
}

impl Results {
    pub(super) const NONE: Self = Self { entries: [(Code::ALL, BlockError::None); MOST_BLOCKS], len: 0 };

    pub(super) fn push(&mut self, code: Code, error: BlockError) {
        if let Some(entry) = self.entries.get_mut(self.len) {
            *entry = (code, error);
            self.len += 1;
        }
    }

    /// Makes the result of an option, if it was good, a refusal by the owner.
    pub(super) fn refuse(&mut self, code: Code) {
        let good = self.entries.iter_mut().filter(|entry| **entry == (code, BlockError::None));
        good.for_each(|(_, error)| *error = BlockError::NotPossible);
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = (Code, BlockError)> {
        self.entries.iter().take(self.len).copied()
    }
}

impl Station {
    /// Returns why an option cannot be read, if it cannot.
    pub(super) fn get_error(&self, code: Code) -> BlockError {
        match self.block(code) {
            Some(_) => BlockError::None,
            None if matches!(code.0 >> 8, 1 | 2 | 5) => BlockError::SuboptionNotSupported,
            None => BlockError::OptionNotSupported,
        }
    }

    /// Queues an answer, if there is room for it.
    pub(super) fn queue(&mut self, now: Instant, reply: Reply) -> Result<(), Refusal> {
        let free = |places: &mut [Option<Reply>; MOST_REPLIES], reply: Reply| {
            let place = places.iter_mut().find(|place| place.is_none())?;
            *place = Some(reply);
            Some(reply.due)
        };
        let delayed = if reply.due > now { free(&mut self.delayed, reply) } else { None };
        // Without a free place to wait, the answer is sent at once, so that requests with long delays cannot silence the
        // station.
        let due = delayed.or_else(|| free(&mut self.prompt, Reply { due: now, ..reply }));
        self.reply_due = Instant::earlier(self.reply_due, Some(due.ok_or(Refusal::Foreign)?));
        Ok(())
    }

    /// Writes the next due answer as an Ethernet frame; returns its length.
    pub(super) fn poll_reply(&mut self, now: Instant, buf: &mut [u8]) -> Option<usize> {
        self.reply_due.filter(|due| *due <= now)?;
        let is_due = |reply: &Option<Reply>| reply.as_ref().is_some_and(|reply| reply.due <= now);
        let reply = self.prompt.iter_mut().chain(&mut self.delayed).find(|reply| is_due(reply))?.take()?;
        self.reply_due = self.prompt.iter().chain(&self.delayed).flatten().map(|reply| reply.due).min();
        let header =
            EthernetHeader { destination: reply.to, source: self.mac, tag: None, ether_type: ETHER_TYPE };
        let emitted = header.emit(buf, |writer| match reply.service {
            Service::IdentifyResponse => {
                let codes = [
                    Code::IP,
                    Code::TYPE_OF_STATION,
                    Code::NAME_OF_STATION,
                    Code::DEVICE_ID,
                    Code::DEVICE_ROLE,
                    Code::DEVICE_OPTIONS,
                    Code::DEVICE_INSTANCE,
                ];
                let named = reply.results.iter().map(|(code, _)| code);
                let blocks = codes.into_iter().chain(named).filter_map(|code| self.block(code));
                dcp::emit(writer, reply.service, reply.xid, 0, blocks);
            }
            Service::GetResponse => {
                let blocks = reply.results.iter().map(|(code, error)| match self.block(code) {
                    Some(block) if error == BlockError::None => block,
                    _ => Content::Response { code, error }.into(),
                });
                dcp::emit(writer, reply.service, reply.xid, 0, blocks);
            }
            _ => {
                let blocks =
                    reply.results.iter().map(|(code, error)| Content::Response { code, error }.into());
                dcp::emit(writer, reply.service, reply.xid, 0, blocks);
            }
        });
        emitted.ok()
    }

    /// Returns the block with an option's value.
    fn block(&self, code: Code) -> Option<Block<'_>> {
        let identity = self.description.identity;
        let content = match code {
            Code::MAC_ADDRESS => Content::MacAddress(self.mac),
            Code::IP => {
                let conflict = if self.has_conflict { Block::ADDRESS_CONFLICT } else { 0 };
                let qualifier = u16::from(!self.ip.address.is_unspecified()) | conflict;
                return Some(Block { qualifier, content: Content::Ip(self.ip) });
            }
            Code::TYPE_OF_STATION => Content::TypeOfStation(self.description.station_type.as_bytes()),
            Code::NAME_OF_STATION => Content::NameOfStation(&self.name),
            Code::DEVICE_ID => Content::DeviceId { vendor: identity.vendor, device: identity.device },
            Code::DEVICE_ROLE => Content::DeviceRole(self.role),
            Code::DEVICE_OPTIONS => Content::DeviceOptions(&OPTIONS),
            Code::ALIAS_NAME => Content::AliasName(self.neighbour()?.alias()),
            Code::DEVICE_INSTANCE => Content::DeviceInstance(INSTANCE),
            _ => return None,
        };
        Some(content.into())
    }
}
