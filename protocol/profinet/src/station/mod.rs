//! The station from the point of view of DCP and LLDP: its name, its address and its neighbour, the answers to Identify, Get
//! and Set, and the announcements to the neighbour.

mod reply;
mod rules;
mod set;

pub use rules::is_station_name;
pub(super) use set::{Effect, OwnerStep, SetPermission};

use alloc::vec::Vec;
use core::net::Ipv4Addr;

use crate::dcp::{BlockError, Code, Content, IpSuite, MAX_NAME_LEN, Pdu, Service, response_delay};
use crate::description::Description;
use crate::lldp::{self, Agent, Local, Naming, Neighbour};
use crate::record::Maintenance;
use crate::rpc::INSTANCE;
use machine::ethernet::{EthernetHeader, Mac};
use machine::{Counters, Instant};
use reply::{Reply, Results};
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
const OPTIONS: [u8; 28] =
    [1, 1, 1, 2, 2, 1, 2, 2, 2, 3, 2, 4, 2, 5, 2, 6, 2, 7, 5, 1, 5, 2, 5, 3, 5, 5, 5, 6];

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
    /// Whether another station has its address, or the one that it was to have.
    has_conflict: bool,
    /// What the owner stores permanently; `None` if it cannot store.
    stored: Option<Stored>,
    prompt: [Option<Reply>; MOST_REPLIES],
    delayed: [Option<Reply>; MOST_REPLIES],
    /// When the first of both is due.
    reply_due: Option<Instant>,
    pending_set: Option<PendingSet>,
    /// The station that changed something by the last Set, and until when those of others are ignored.
    client: Option<(Mac, Instant)>,
    lldp: Agent,
    naming: Naming,
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

/// Why a frame is ignored.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Refusal {
    /// It is malformed.
    Malformed,
    /// It is not for this station, or there is no room for the answer.
    Foreign,
}

impl Refusal {
    /// Counts the frame among those that a station ignored.
    pub(super) const fn count(self, counters: &mut Counters) {
        match self {
            Self::Malformed => counters.malformed += 1,
            Self::Foreign => counters.foreign += 1,
        }
    }
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
        start: Instant,
    ) -> Self {
        let mut station = Self::new(mac, IO_DEVICE, description, name, ip.unwrap_or(NO_ADDRESS), start);
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
        // It announces itself as soon as it is run.
        Self::new(mac, IO_CONTROLLER, description, name, ip, Instant::ZERO)
    }

    fn new(mac: Mac, role: u8, description: Description, name: &[u8], ip: IpSuite, start: Instant) -> Self {
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
            has_conflict: false,
            stored: None,
            prompt: [None; MOST_REPLIES],
            delayed: [None; MOST_REPLIES],
            reply_due: None,
            pending_set: None,
            client: None,
            lldp: Agent::new(start),
            naming: Naming::default(),
        }
    }

    pub(super) fn name(&self) -> &[u8] {
        &self.name
    }

    pub(super) const fn ip(&self) -> IpSuite {
        self.ip
    }

    /// Sets whether another station has its address, as DCP reports it.
    pub(super) const fn set_conflict(&mut self, has_conflict: bool) {
        self.has_conflict = has_conflict;
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

    /// Returns the station at the other end of the cable, if it announced itself.
    pub(super) fn neighbour(&self) -> Option<&Neighbour> {
        self.lldp.neighbour()
    }

    /// Sets how the station and its port are named to the neighbour.
    pub(super) fn set_naming(&mut self, now: Instant, naming: Naming) {
        if core::mem::replace(&mut self.naming, naming) != naming {
            self.lldp.announce(now);
        }
    }

    /// Handles an Ethernet frame that is not one of PROFINET for this station: an LLDPDU, or it is foreign.
    pub(super) fn handle_other(
        &mut self,
        now: Instant,
        header: &EthernetHeader,
        payload: &[u8],
    ) -> Result<(), Refusal> {
        if header.ether_type != lldp::ETHER_TYPE {
            return Err(Refusal::Foreign);
        }
        self.lldp.handle_frame(now, header, payload).map_err(|refusal| match refusal {
            lldp::Refusal::Malformed(_) => Refusal::Malformed,
            lldp::Refusal::Foreign => Refusal::Foreign,
        })
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
                let mut results = Results::NONE;
                if pdu.blocks().flatten().any(|block| block.code() == Code::ALIAS_NAME) {
                    results.push(Code::ALIAS_NAME, BlockError::None);
                }
                self.queue(now, Reply { due, service: Service::IdentifyResponse, results, ..reply })?;
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
                Content::AliasName(alias) => {
                    self.neighbour().is_some_and(|neighbour| neighbour.alias() == alias)
                }
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

    pub(super) fn handle_timeout(&mut self, now: Instant) {
        if self.pending_set.as_ref().is_some_and(|pending_set| now >= pending_set.deadline) {
            self.pending_set = None;
        }
        self.lldp.handle_timeout(now);
    }

    pub(super) fn poll_timeout(&self) -> Instant {
        let due = self.lldp.poll_timeout();
        let set = self.pending_set.as_ref().map(|pending_set| pending_set.deadline);
        [self.reply_due, set].into_iter().flatten().fold(due, Instant::min)
    }

    /// Writes the next due answer or announcement as an Ethernet frame; returns its length.
    pub(super) fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<usize> {
        self.poll_reply(now, buf).or_else(|| self.poll_announcement(now, buf))
    }

    fn poll_announcement(&mut self, now: Instant, buf: &mut [u8]) -> Option<usize> {
        let Self { mac, ref name, ip, ref description, naming, .. } = *self;
        let local = Local { mac, name, address: ip.address, description, naming };
        self.lldp.poll_transmit(now, &local, buf)
    }
}

/// No address is set.
const NO_ADDRESS: IpSuite =
    IpSuite { address: Ipv4Addr::UNSPECIFIED, mask: Ipv4Addr::UNSPECIFIED, gateway: Ipv4Addr::UNSPECIFIED };
