//! The station from DCP's point of view: its name, its address, and the answers to Identify, Get and Set.

mod rules;
mod set;

pub use rules::is_station_name;
pub(super) use set::{Effect, OwnerStep, SetPermission};

use alloc::vec::Vec;
use core::net::Ipv4Addr;

use crate::ETHER_TYPE;
use crate::dcp::{
    self, Block, BlockError, Code, Content, IpSuite, MAX_NAME_LEN, Pdu, Service, response_delay,
};
use crate::description::Description;
use crate::record::Maintenance;
use crate::rpc::INSTANCE;
use machine::Instant;
use machine::ethernet::{EthernetHeader, Mac};
use set::PendingSet;

/// Largest number of blocks in one Set or Get; further ones are not answered.
const MOST_BLOCKS: usize = 16;

/// Largest number of answers that wait to be sent at once, and of answers to Identify that wait for their delay.
const MOST_REPLIES: usize = 8;

/// Role of an IO-Device, which gets its name and address from others.
const IO_DEVICE: u8 = 1;
/// Role of an IO-Controller, which has its name and address in its own configuration.
const IO_CONTROLLER: u8 = 2;

/// The options that can be read or set, as Identify lists them.
const OPTIONS: [u8; 26] = [1, 1, 1, 2, 2, 1, 2, 2, 2, 3, 2, 4, 2, 5, 2, 7, 5, 1, 5, 2, 5, 3, 5, 5, 5, 6];

/// Name and address of a device or a controller.
#[derive(Debug)]
pub(super) struct Station {
    mac: Mac,
    role: u8,
    description: Description,
    name: Vec<u8>,
    /// The name that a Set in progress gives.
    new_name: Vec<u8>,
    factory_name: Vec<u8>,
    ip: IpSuite,
    /// What the owner stores permanently; `None` if it cannot store.
    stored: Option<Stored>,
    prompt: [Option<Reply>; MOST_REPLIES],
    delayed: [Option<Reply>; MOST_REPLIES],
    /// When the first of both is due.
    reply_due: Option<Instant>,
    pending_set: Option<PendingSet>,
    /// The station that changed something by the last Set, and until when those of others are ignored.
    client: Option<(Mac, Instant)>,
}

/// What a device keeps, as its owner stores it: name and address that DCP set permanently, and what the operator wrote.
#[derive(Clone, PartialEq, Eq, Default, Debug)]
pub struct Permanent {
    /// Station name, at most 240 bytes; `None` if none was set permanently.
    pub name: Option<Vec<u8>>,
    /// IP address with mask and gateway; `None` if none was set permanently.
    pub address: Option<IpSuite>,
    /// I&M1 to 4; `None` if none was written.
    pub maintenance: Option<Maintenance>,
}

/// What is stored.
#[derive(Debug)]
struct Stored {
    name: Option<Vec<u8>>,
    /// Memory of a name, while none is stored.
    spare: Vec<u8>,
    address: Option<IpSuite>,
    maintenance: Maintenance,
}

impl Stored {
    /// Stores a name or removes it, without allocating.
    fn set_name(&mut self, name: Option<&Vec<u8>>) {
        let mut place = self.name.take().unwrap_or_else(|| core::mem::take(&mut self.spare));
        place.clear();
        match name {
            Some(name) => {
                place.extend_from_slice(name);
                self.name = Some(place);
            }
            None => self.spare = place,
        }
    }
}

/// An answer that waits to be sent.
#[derive(Clone, Copy, Debug)]
struct Reply {
    to: Mac,
    xid: u32,
    due: Instant,
    service: Service,
    results: Results,
}

/// Results of the blocks of a Set, or the options that a Get requests.
#[derive(Clone, Copy, Debug)]
struct Results {
    entries: [(Code, BlockError); MOST_BLOCKS],
    len: usize,
}

impl Results {
    const NONE: Self = Self { entries: [(Code::ALL, BlockError::None); MOST_BLOCKS], len: 0 };

    fn push(&mut self, code: Code, error: BlockError) {
        if let Some(entry) = self.entries.get_mut(self.len) {
            *entry = (code, error);
            self.len += 1;
        }
    }

    /// Makes the result of an option, if it was good, a refusal by the owner.
    fn refuse(&mut self, code: Code) {
        let good = self.entries.iter_mut().filter(|entry| **entry == (code, BlockError::None));
        good.for_each(|(_, error)| *error = BlockError::NotPossible);
    }

    fn iter(&self) -> impl Iterator<Item = (Code, BlockError)> {
        self.entries.iter().take(self.len).copied()
    }
}

/// Why a DCP PDU is ignored.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Refusal {
    /// It is malformed.
    Malformed,
    /// It is not for this station, or there is no room for the answer.
    Foreign,
}

impl Station {
    /// Creates the station of an IO-Device, whose name and address DCP may set. `stored` is what the owner stored of them;
    /// `None` if it cannot store.
    pub(super) fn device(
        mac: Mac,
        description: Description,
        name: &[u8],
        ip: Option<IpSuite>,
        stored: Option<Permanent>,
    ) -> Self {
        let mut station = Self::new(mac, IO_DEVICE, description, name, ip.unwrap_or(NO_ADDRESS));
        station.stored = stored.map(|Permanent { name, address, maintenance }| {
            let room = || Vec::with_capacity(MAX_NAME_LEN);
            let maintenance = maintenance.unwrap_or_default();
            let mut stored = Stored { name: None, spare: room(), address, maintenance };
            if let Some(name) = name.filter(|name| is_station_name(name)) {
                station.name.clear();
                station.name.extend_from_slice(&name);
                stored.set_name(Some(&name));
            }
            stored
        });
        station
    }

    /// Creates the station of an IO-Controller, which DCP can find and read but not set.
    pub(super) fn controller(mac: Mac, description: Description, name: &[u8], ip: IpSuite) -> Self {
        Self::new(mac, IO_CONTROLLER, description, name, ip)
    }

    fn new(mac: Mac, role: u8, description: Description, name: &[u8], ip: IpSuite) -> Self {
        let name = name.get(..MAX_NAME_LEN).unwrap_or(name);
        // Room for the longest name, so that a Set does not allocate.
        let mut own = Vec::with_capacity(MAX_NAME_LEN);
        own.extend_from_slice(name);
        Self {
            mac,
            role,
            description,
            name: own,
            new_name: Vec::with_capacity(MAX_NAME_LEN),
            factory_name: name.to_vec(),
            ip,
            stored: None,
            prompt: [None; MOST_REPLIES],
            delayed: [None; MOST_REPLIES],
            reply_due: None,
            pending_set: None,
            client: None,
        }
    }

    pub(super) fn name(&self) -> &[u8] {
        &self.name
    }

    pub(super) const fn ip(&self) -> IpSuite {
        self.ip
    }

    /// Returns I&M1 to 4; `None` if the owner cannot store them.
    pub(super) fn maintenance(&self) -> Option<&Maintenance> {
        self.stored.as_ref().map(|stored| &stored.maintenance)
    }

    /// Sets I&M1 to 4. Returns whether they changed, so that the owner has to store them.
    pub(super) fn set_maintenance(&mut self, new: Maintenance) -> bool {
        let stored = self.stored.as_mut();
        stored.is_some_and(|stored| core::mem::replace(&mut stored.maintenance, new) != new)
    }

    /// Handles a DCP PDU in an Ethernet frame.
    pub(super) fn handle_frame(
        &mut self,
        now: Instant,
        header: &EthernetHeader,
        payload: &[u8],
        set_permission: SetPermission,
    ) -> Result<Effect, Refusal> {
        let pdu = Pdu::parse(payload).map_err(|_| Refusal::Malformed)?;
        let reply =
            Reply { to: header.source, xid: pdu.xid, due: now, service: pdu.service, results: Results::NONE };
        if header.source.is_group() {
            return Err(Refusal::Malformed);
        }
        match pdu.service {
            Service::IdentifyRequest => {
                if !self.is_for_this_station(&pdu)? {
                    return Err(Refusal::Foreign);
                }
                let due = now + response_delay(self.mac, pdu.response_delay_factor);
                self.queue(now, Reply { due, service: Service::IdentifyResponse, ..reply })?;
                Ok(Effect::default())
            }
            Service::GetRequest if header.destination == self.mac => {
                let mut results = Results::NONE;
                for code in pdu.requested_options() {
                    // An option that is asked for twice is answered once: each of them fits a frame only once.
                    if !results.iter().any(|(known, _)| known == code) {
                        results.push(code, self.get_error(code));
                    }
                }
                self.queue(now, Reply { service: Service::GetResponse, results, ..reply })?;
                Ok(Effect::default())
            }
            Service::SetRequest if header.destination == self.mac => {
                if self.client.is_some_and(|(client, until)| client != header.source && now < until) {
                    return Err(Refusal::Foreign);
                }
                self.set(now, &pdu, Reply { service: Service::SetResponse, ..reply }, set_permission)
            }
            _ => Err(Refusal::Foreign),
        }
    }

    /// Returns whether an Identify request is for this station: all of its blocks match.
    fn is_for_this_station(&self, pdu: &Pdu<'_>) -> Result<bool, Refusal> {
        let mut any = false;
        for block in pdu.blocks() {
            let block = block.map_err(|_| Refusal::Malformed)?;
            any = true;
            let identity = self.description.identity;
            let matches = match block.content {
                Content::All => true,
                Content::NameOfStation(name) => name == self.name,
                Content::TypeOfStation(text) => text == self.description.station_type.as_bytes(),
                Content::DeviceId { vendor, device } => {
                    (vendor, device) == (identity.vendor, identity.device)
                }
                Content::DeviceInstance(instance) => instance == INSTANCE,
                Content::DeviceRole(roles) => roles & self.role != 0,
                Content::DeviceOptions(options) => options == OPTIONS,
                Content::MacAddress(mac) => mac == self.mac,
                Content::Ip(suite) => suite == self.ip,
                _ => false,
            };
            if !matches {
                return Ok(false);
            }
        }
        if any { Ok(true) } else { Err(Refusal::Malformed) }
    }

    fn get_error(&self, code: Code) -> BlockError {
        match self.block(code) {
            Some(_) => BlockError::None,
            None if matches!(code.0 >> 8, 1 | 2 | 5) => BlockError::SuboptionNotSupported,
            None => BlockError::OptionNotSupported,
        }
    }

    fn queue(&mut self, now: Instant, reply: Reply) -> Result<(), Refusal> {
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

    pub(super) fn handle_timeout(&mut self, now: Instant) {
        if self.pending_set.as_ref().is_some_and(|pending_set| now >= pending_set.deadline) {
            self.pending_set = None;
        }
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        Instant::earlier(self.reply_due, self.pending_set.as_ref().map(|pending_set| pending_set.deadline))
    }

    /// Writes the next due answer as an Ethernet frame; returns its length.
    pub(super) fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<usize> {
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
                let blocks = codes.into_iter().filter_map(|code| self.block(code));
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
                let qualifier = u16::from(!self.ip.address.is_unspecified());
                return Some(Block { qualifier, content: Content::Ip(self.ip) });
            }
            Code::TYPE_OF_STATION => Content::TypeOfStation(self.description.station_type.as_bytes()),
            Code::NAME_OF_STATION => Content::NameOfStation(&self.name),
            Code::DEVICE_ID => Content::DeviceId { vendor: identity.vendor, device: identity.device },
            Code::DEVICE_ROLE => Content::DeviceRole(self.role),
            Code::DEVICE_OPTIONS => Content::DeviceOptions(&OPTIONS),
            Code::DEVICE_INSTANCE => Content::DeviceInstance(INSTANCE),
            _ => return None,
        };
        Some(content.into())
    }
}

/// No address is set.
const NO_ADDRESS: IpSuite =
    IpSuite { address: Ipv4Addr::UNSPECIFIED, mask: Ipv4Addr::UNSPECIFIED, gateway: Ipv4Addr::UNSPECIFIED };
