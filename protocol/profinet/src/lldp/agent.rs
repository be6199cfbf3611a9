//! The agent of one port: announces its station and knows its neighbour, without a clock or a socket.

use alloc::vec::Vec;
use core::net::Ipv4Addr;

use super::identity::Text;
use super::{
    CHASSIS_IS_MAC, ETHER_TYPE, Id, LOCALLY_ASSIGNED, MOST_ID, MULTICAST, MacPhy, PORT_IS_MAC, Pdu, Violation,
};
use crate::description::Description;
use crate::mau::MauType;
use machine::ethernet::{EthernetHeader, Mac};
use machine::{Duration, Instant};

/// Time between two announcements (IEC 61158-6-10, LLDP timing).
pub const INTERVAL: Duration = Duration::from_secs(5);

/// Time in seconds for which an announcement is valid.
pub const TIME_TO_LIVE: u16 = 20;

/// Name of the first port. A station has one.
pub(crate) const PORT_NAME: &[u8] = b"port-001";

/// Our port: it negotiates nothing that the station knows of.
const OUR_PORT: MacPhy = MacPhy {
    autonegotiation: 0,
    advertised: MauType::OF_OUR_PORTS.advertised(),
    mau_type: MauType::OF_OUR_PORTS.code(),
};

/// How ports and chassis are named: MultipleInterfaceMode.NameOfDevice.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub enum Naming {
    /// The chassis has the name of the station, and a port its own, as before version 2.3 of PROFINET.
    #[default]
    Station,
    /// The chassis has the name of its kind, and a port its own with that of the station behind it.
    Device,
}

/// What a station says of itself.
#[derive(Clone, Copy, Debug)]
pub struct Local<'a> {
    /// MAC address of the interface and of its port.
    pub mac: Mac,
    /// Name of the station; empty if it has none.
    pub name: &'a [u8],
    /// Its IP address; 0.0.0.0 if it has none.
    pub address: Ipv4Addr,
    /// Its description.
    pub description: &'a Description,
    /// How it is named.
    pub naming: Naming,
}

impl Local<'_> {
    /// Writes the whole Ethernet frame; returns its length, and `None` if it does not fit.
    pub fn emit(&self, buf: &mut [u8]) -> Option<usize> {
        let system = Text::system(self.description);
        let no_name = Text::mac(self.mac);
        let name = if self.name.is_empty() { no_name.as_bytes() } else { self.name };
        let mut port = Text::new();
        port.push(PORT_NAME);
        let named = |value| Id { subtype: LOCALLY_ASSIGNED, value };
        let chassis = match self.naming {
            Naming::Station if self.name.is_empty() => Id { subtype: CHASSIS_IS_MAC, value: &self.mac.0 },
            Naming::Station => named(self.name),
            Naming::Device => {
                port.push(b".");
                port.push(name);
                named(system.as_bytes())
            }
        };
        let pdu = Pdu {
            system_name: Some(self.name).filter(|name| !name.is_empty()),
            system_description: Some(system.as_bytes()),
            management_address: Some(self.address).filter(|address| !address.is_unspecified()),
            delays: Some([0; 5]),
            port_status: Some([0; 2]),
            chassis_mac: Some(self.mac),
            mac_phy: Some(OUR_PORT),
            ..Pdu::new(chassis, named(port.as_bytes()), TIME_TO_LIVE)
        };
        let header =
            EthernetHeader { destination: MULTICAST, source: self.mac, tag: None, ether_type: ETHER_TYPE };
        header.emit(buf, |writer| pdu.emit(writer)).ok()
    }
}

/// The station at the other end of the cable.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Neighbour {
    /// Name of its port, a dot, and its name.
    alias: Vec<u8>,
    /// Length of the name of its port.
    port_len: usize,
    mac: Mac,
    /// MAC address that it sends from.
    source: Mac,
    /// When it is forgotten.
    until: Instant,
}

impl Neighbour {
    /// Memory for the longest names.
    const CAPACITY: usize = 2 * MOST_ID + 1;

    /// Returns the name of its port and of the station, joined by a dot: the AliasName of the station beside it.
    #[must_use]
    pub fn alias(&self) -> &[u8] {
        &self.alias
    }

    /// Returns the name of its port, such as `port-001`.
    #[must_use]
    pub fn port_name(&self) -> &[u8] {
        self.alias.get(..self.port_len).unwrap_or_default()
    }

    /// Returns its station name; the digits of its MAC address if it has none.
    #[must_use]
    pub fn station_name(&self) -> &[u8] {
        self.alias.get(self.port_len + 1..).unwrap_or_default()
    }

    /// Returns the MAC address of its interface, as it says; otherwise the one that it sends from.
    #[must_use]
    pub const fn mac(&self) -> Mac {
        self.mac
    }

    /// Takes what the neighbour says now. The memory suffices.
    fn update(&mut self, source: Mac, pdu: &Pdu<'_>, until: Instant) {
        self.source = source;
        self.mac = pdu.chassis_mac.unwrap_or(source);
        self.until = until;
        self.alias.clear();
        push_name(&mut self.alias, pdu.port, PORT_IS_MAC);
        let dot = self.alias.iter().position(|byte| *byte == b'.');
        self.port_len = dot.unwrap_or(self.alias.len());
        if dot.is_none() {
            self.alias.push(b'.');
            push_name(&mut self.alias, pdu.chassis, CHASSIS_IS_MAC);
        }
    }
}

/// Appends a name; digits for a MAC address, which has this subtype.
fn push_name(to: &mut Vec<u8>, id: Id<'_>, mac: u8) {
    match id.value.first_chunk() {
        Some(value) if id.subtype == mac => to.extend_from_slice(Text::mac(Mac(*value)).as_bytes()),
        _ => to.extend_from_slice(id.value),
    }
}

/// Why an LLDPDU is ignored.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Refusal {
    /// It is malformed.
    Malformed(Violation),
    /// It is not for the nearest station, or not from one station.
    Foreign,
}

/// The agent of one port.
#[derive(Debug)]
pub struct Agent {
    announce_at: Instant,
    neighbour: Neighbour,
    /// Whether there is a neighbour; the memory of its names stays.
    is_known: bool,
}

impl Agent {
    /// Creates an agent that announces its station at `start` first. It allocates its memory here; nothing later allocates.
    #[must_use]
    pub fn new(start: Instant) -> Self {
        let alias = Vec::with_capacity(Neighbour::CAPACITY);
        let (mac, source) = (Mac::default(), Mac::default());
        let neighbour = Neighbour { alias, port_len: 0, mac, source, until: start };
        Self { announce_at: start, neighbour, is_known: false }
    }

    /// Announces the station at once, since what it says of itself changed.
    pub fn announce(&mut self, now: Instant) {
        self.announce_at = self.announce_at.min(now);
    }

    /// Handles an Ethernet frame with an LLDPDU. The first station that announces itself is the neighbour, until it goes or
    /// is not heard for the time that it said; on a cable with more than one, the others are ignored.
    pub fn handle_frame(
        &mut self,
        now: Instant,
        header: &EthernetHeader,
        payload: &[u8],
    ) -> Result<(), Refusal> {
        if header.destination != MULTICAST || header.source.is_group() {
            return Err(Refusal::Foreign);
        }
        let pdu = Pdu::parse(payload).map_err(Refusal::Malformed)?;
        self.handle_timeout(now);
        if self.is_known && self.neighbour.source != header.source {
            return Ok(());
        }
        self.is_known = pdu.ttl > 0;
        if self.is_known {
            let until = now + Duration::from_secs(u64::from(pdu.ttl));
            self.neighbour.update(header.source, &pdu, until);
        }
        Ok(())
    }

    /// Forgets the neighbour once its time is over.
    pub fn handle_timeout(&mut self, now: Instant) {
        self.is_known &= now < self.neighbour.until;
    }

    /// Returns when to announce the station, or to forget the neighbour.
    #[must_use]
    pub fn poll_timeout(&self) -> Instant {
        if self.is_known { self.announce_at.min(self.neighbour.until) } else { self.announce_at }
    }

    /// Writes the announcement if it is due; returns the frame's length.
    pub fn poll_transmit(&mut self, now: Instant, local: &Local<'_>, buf: &mut [u8]) -> Option<usize> {
        if now < self.announce_at {
            return None;
        }
        self.announce_at = now + INTERVAL;
        local.emit(buf)
    }

    /// Returns the neighbour, if there is one.
    #[must_use]
    pub fn neighbour(&self) -> Option<&Neighbour> {
        self.is_known.then_some(&self.neighbour)
    }
}
