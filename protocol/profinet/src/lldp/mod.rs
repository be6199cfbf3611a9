//! LLDP, Link Layer Discovery Protocol: a station tells the station at the other end of its cable who it is (IEEE 802.1AB,
//! with the TLVs of IEC 61158-6-10, 4.10).
//!
//! ```text
//! TLV          type 7 bits · length 9 bits · value
//!   1  ChassisID          subtype u8 · name of station, or the MAC address      first
//!   2  PortID             subtype u8 · name of the port                         second
//!   3  TimeToLive         seconds u16; 0: the station goes                      third
//!   5  SystemName         text
//!   6  SystemDescription  text
//!   8  ManagementAddress  length u8 · family u8 · address · numbering u8 · interface u32 · length u8 · object
//! 127  organization       OUI 3 · subtype u8 · value
//!        00-0E-CF 1         five delays u32                                     0: not measured
//!        00-0E-CF 2         state of RT_CLASS_2 u16 · of RT_CLASS_3 u16         0: off
//!        00-0E-CF 5         MAC address of the interface
//!        00-12-0F 1         autonegotiation u8 · speeds u16 · MAUType u16
//!   0  End                                                                      last; zeros may follow
//! ```
//!
//! The PDU stands behind the EtherType 0x88CC, without a tag. A bridge does not forward it.

mod agent;
mod identity;

pub use agent::{Agent, INTERVAL, Local, Naming, Neighbour, Refusal, TIME_TO_LIVE};

use core::net::Ipv4Addr;

use machine::PortRequest;
use machine::ethernet::Mac;
use machine::wire::{BigEndian, Reader, Truncated, Writer};

/// EtherType of LLDP.
pub const ETHER_TYPE: u16 = 0x88CC;

/// Destination of every LLDPDU: the nearest station.
pub const MULTICAST: Mac = Mac([0x01, 0x80, 0xC2, 0x00, 0x00, 0x0E]);

/// Raw Ethernet with the neighbours' LLDPDUs.
pub const ETHERNET: PortRequest = PortRequest::Ethernet { ether_type: ETHER_TYPE, groups: &[MULTICAST] };

const END: u16 = 0;
const CHASSIS_ID: u16 = 1;
const PORT_ID: u16 = 2;
const TTL: u16 = 3;
const SYSTEM_NAME: u16 = 5;
const SYSTEM_DESCRIPTION: u16 = 6;
const MANAGEMENT_ADDRESS: u16 = 8;
const ORGANIZATION: u16 = 127;

/// OUI and subtype of the TLVs of PROFINET and of IEEE 802.3.
const DELAYS: [u8; 4] = [0x00, 0x0E, 0xCF, 1];
const PORT_STATUS: [u8; 4] = [0x00, 0x0E, 0xCF, 2];
const CHASSIS_MAC: [u8; 4] = [0x00, 0x0E, 0xCF, 5];
const MAC_PHY: [u8; 4] = [0x00, 0x12, 0x0F, 1];

/// Address family of IPv4 (IANA).
const IPV4: u8 = 1;
/// Numbering of the interface of a management address: not known.
const NOT_NUMBERED: u8 = 1;

/// Subtypes of ChassisID and PortID whose value is a MAC address.
const CHASSIS_IS_MAC: u8 = 4;
const PORT_IS_MAC: u8 = 3;
/// Subtype of a ChassisID or PortID whose value is a name of PROFINET: locally assigned.
const LOCALLY_ASSIGNED: u8 = 7;

/// Longest value of a ChassisID or PortID in bytes.
const MOST_ID: usize = 255;

/// A malformed LLDPDU.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum Violation {
    /// The PDU or a TLV ends early.
    #[error("LLDP: {0}")]
    Truncated(#[from] Truncated),
    /// ChassisID, PortID and TimeToLive are not the first three TLVs in this order.
    #[error("LLDP: TLV {found} in place of TLV {wanted}")]
    Order {
        /// Type of the TLV in this place.
        found: u16,
        /// Type that it must have.
        wanted: u16,
    },
    /// One of these three comes again.
    #[error("LLDP: a second TLV {0}")]
    Repeated(u16),
    /// A TLV does not have a length that its type allows.
    #[error("LLDP: TLV {tlv} with {len} bytes")]
    Length {
        /// Type of the TLV.
        tlv: u16,
        /// Length of its value in bytes.
        len: usize,
    },
}

/// The name of a chassis or a port.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Id<'a> {
    /// What kind of name it is: 7 locally assigned; a MAC address is 4 for a chassis and 3 for a port.
    pub subtype: u8,
    /// The name, 1 to 255 bytes.
    pub value: &'a [u8],
}

/// IEEE 802.3 MAC/PHY configuration and status.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct MacPhy {
    /// Bit 0: the port can negotiate its speed; bit 1: it does.
    pub autonegotiation: u8,
    /// Speeds that it offers, as ifMauAutoNegCapAdvertisedBits (RFC 4836).
    pub advertised: u16,
    /// Kind of the port in operation, as dot3MauType (RFC 4836); 0 if it is not known.
    pub mau_type: u16,
}

/// An LLDPDU.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Pdu<'a> {
    /// Name of the station.
    pub chassis: Id<'a>,
    /// Name of the port.
    pub port: Id<'a>,
    /// Time in seconds for which this is valid; 0: the station goes.
    pub ttl: u16,
    /// Name of the system.
    pub system_name: Option<&'a [u8]>,
    /// Its description.
    pub system_description: Option<&'a [u8]>,
    /// Its first IPv4 address.
    pub management_address: Option<Ipv4Addr>,
    /// Delays of the port in nanoseconds: received here and there, sent here and there, the cable; each 0 if not measured.
    pub delays: Option<[u32; 5]>,
    /// State of the port for RT_CLASS_2 and RT_CLASS_3; 0 is off.
    pub port_status: Option<[u16; 2]>,
    /// MAC address of the interface that the port belongs to.
    pub chassis_mac: Option<Mac>,
    /// Speed of the port.
    pub mac_phy: Option<MacPhy>,
}

impl<'a> Pdu<'a> {
    /// Creates a PDU with the TLVs that every station sends.
    #[must_use]
    pub const fn new(chassis: Id<'a>, port: Id<'a>, ttl: u16) -> Self {
        Self {
            chassis,
            port,
            ttl,
            system_name: None,
            system_description: None,
            management_address: None,
            delays: None,
            port_status: None,
            chassis_mac: None,
            mac_phy: None,
        }
    }

    /// Parses the PDU in the payload of an Ethernet frame. It ends at the End TLV or with the payload. Unknown TLVs are
    /// skipped; of two optional ones of a kind, the first is taken.
    pub fn parse(payload: &'a [u8]) -> Result<Self, Violation> {
        let mut reader = Reader::<BigEndian>::new(payload);
        let chassis = id(CHASSIS_ID, mandatory(&mut reader, CHASSIS_ID)?)?;
        let port = id(PORT_ID, mandatory(&mut reader, PORT_ID)?)?;
        let mut ttl = mandatory(&mut reader, TTL)?;
        let mut pdu = Self::new(chassis, port, ttl.u16().map_err(|_| length(TTL, ttl))?);
        while !reader.is_empty() {
            let (tlv, value) = next(&mut reader)?;
            match tlv {
                END if value.is_empty() => break,
                END => return Err(length(END, value)),
                CHASSIS_ID | PORT_ID | TTL => return Err(Violation::Repeated(tlv)),
                SYSTEM_NAME => keep(&mut pdu.system_name, Some(value.rest())),
                SYSTEM_DESCRIPTION => keep(&mut pdu.system_description, Some(value.rest())),
                MANAGEMENT_ADDRESS => {
                    keep(&mut pdu.management_address, management_address(value)?);
                }
                ORGANIZATION => pdu.organization(value)?,
                _ => {}
            }
        }
        Ok(pdu)
    }

    fn organization(&mut self, mut value: Reader<'_, BigEndian>) -> Result<(), Violation> {
        let whole = value;
        let short = |_| length(ORGANIZATION, whole);
        match value.array().map_err(short)? {
            DELAYS => {
                let mut delays = [0; 5];
                for delay in &mut delays {
                    *delay = value.u32().map_err(short)?;
                }
                keep(&mut self.delays, Some(delays));
            }
            PORT_STATUS => {
                let status = [value.u16().map_err(short)?, value.u16().map_err(short)?];
                keep(&mut self.port_status, Some(status));
            }
            CHASSIS_MAC => keep(&mut self.chassis_mac, Some(Mac(value.array().map_err(short)?))),
            MAC_PHY => {
                let autonegotiation = value.u8().map_err(short)?;
                let (advertised, mau_type) = (value.u16().map_err(short)?, value.u16().map_err(short)?);
                keep(&mut self.mac_phy, Some(MacPhy { autonegotiation, advertised, mau_type }));
            }
            _ => {}
        }
        Ok(())
    }

    /// Writes the PDU, from the first TLV to End.
    pub fn emit(&self, writer: &mut Writer<'_, BigEndian>) {
        let put_id = |writer: &mut Writer<'_, BigEndian>, tlv, id: Id<'_>| {
            emit_tlv(writer, tlv, |w| {
                w.u8(id.subtype);
                w.bytes(id.value.get(..MOST_ID).unwrap_or(id.value));
            });
        };
        put_id(writer, CHASSIS_ID, self.chassis);
        put_id(writer, PORT_ID, self.port);
        emit_tlv(writer, TTL, |w| w.u16(self.ttl));
        for (tlv, text) in [(SYSTEM_NAME, self.system_name), (SYSTEM_DESCRIPTION, self.system_description)] {
            if let Some(text) = text {
                emit_tlv(writer, tlv, |w| w.bytes(text.get(..MOST_ID).unwrap_or(text)));
            }
        }
        if let Some(address) = self.management_address {
            emit_tlv(writer, MANAGEMENT_ADDRESS, |w| {
                w.bytes(&[5, IPV4]);
                w.bytes(&address.octets());
                w.u8(NOT_NUMBERED);
                w.u32(0);
                w.u8(0);
            });
        }
        self.emit_organizations(writer);
        emit_tlv(writer, END, |_| {});
    }

    fn emit_organizations(&self, writer: &mut Writer<'_, BigEndian>) {
        if let Some(delays) = self.delays {
            emit_organization(writer, DELAYS, |w| delays.into_iter().for_each(|delay| w.u32(delay)));
        }
        if let Some(status) = self.port_status {
            emit_organization(writer, PORT_STATUS, |w| status.into_iter().for_each(|class| w.u16(class)));
        }
        if let Some(mac) = self.chassis_mac {
            emit_organization(writer, CHASSIS_MAC, |w| w.bytes(&mac.0));
        }
        if let Some(MacPhy { autonegotiation, advertised, mau_type }) = self.mac_phy {
            emit_organization(writer, MAC_PHY, |w| {
                w.u8(autonegotiation);
                w.u16(advertised);
                w.u16(mau_type);
            });
        }
    }
}

fn next<'a>(reader: &mut Reader<'a, BigEndian>) -> Result<(u16, Reader<'a, BigEndian>), Violation> {
    let head = reader.u16()?;
    Ok((head >> 9, reader.sub(usize::from(head & 0x1FF))?))
}

fn mandatory<'a>(
    reader: &mut Reader<'a, BigEndian>,
    wanted: u16,
) -> Result<Reader<'a, BigEndian>, Violation> {
    let (found, value) = next(reader)?;
    if found == wanted { Ok(value) } else { Err(Violation::Order { found, wanted }) }
}

fn length(tlv: u16, value: Reader<'_, BigEndian>) -> Violation {
    Violation::Length { tlv, len: value.left() }
}

fn id<'a>(tlv: u16, value: Reader<'a, BigEndian>) -> Result<Id<'a>, Violation> {
    let wrong = Violation::Length { tlv, len: value.left() };
    let (subtype, value) = value.rest().split_first().ok_or(wrong)?;
    let is_mac = (tlv, *subtype) == (CHASSIS_ID, CHASSIS_IS_MAC) || (tlv, *subtype) == (PORT_ID, PORT_IS_MAC);
    let fits = if is_mac { value.len() == 6 } else { (1..=MOST_ID).contains(&value.len()) };
    if fits { Ok(Id { subtype: *subtype, value }) } else { Err(wrong) }
}

/// Returns the address in a management address TLV, if it is one of IPv4.
fn management_address(mut value: Reader<'_, BigEndian>) -> Result<Option<Ipv4Addr>, Violation> {
    let wrong = length(MANAGEMENT_ADDRESS, value);
    let len = value.u8().map_err(|_| wrong)?;
    let mut address = value.sub(usize::from(len)).map_err(|_| wrong)?;
    let family = address.u8().map_err(|_| wrong)?;
    let octets = address.array::<4>().ok().filter(|_| family == IPV4 && address.is_empty());
    Ok(octets.map(Ipv4Addr::from))
}

/// Takes the value of an optional TLV unless one of its kind came before.
fn keep<T>(place: &mut Option<T>, value: Option<T>) {
    if place.is_none() {
        *place = value;
    }
}

/// Writes a TLV. No value is longer than 511 bytes.
fn emit_tlv(writer: &mut Writer<'_, BigEndian>, tlv: u16, value: impl FnOnce(&mut Writer<'_, BigEndian>)) {
    let head_at = writer.len();
    writer.u16(0);
    let start = writer.len();
    value(writer);
    writer.patch_u16(head_at, tlv << 9 | (writer.len() - start) as u16 & 0x1FF);
}

fn emit_organization(
    writer: &mut Writer<'_, BigEndian>,
    kind: [u8; 4],
    value: impl FnOnce(&mut Writer<'_, BigEndian>),
) {
    emit_tlv(writer, ORGANIZATION, |w| {
        w.bytes(&kind);
        value(w);
    });
}

#[cfg(test)]
mod tests;
