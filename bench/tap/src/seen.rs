//! Stations by what they and others say of them outside of cyclic frames and the start of a connection.
//!
//! ```text
//! DCP           name, vendor and device, address: answers, greetings, and names that are set
//! LLDP          name, description
//! ARP           which interface has which address
//! ListIdentity  product name, key and serial number
//! RPC           order number, serial number and versions: I&M0 that is read, the list of the endpoint mapper
//! ```

use std::net::Ipv4Addr;

use ethernet_ip::ENCAPSULATION_PORT;
use ethernet_ip::discovery::IdentityReply;
use machine::arp::ArpPacket;
use machine::ethernet::Mac;
use profinet::block::BlockReader;
use profinet::dcp::{self, Content, Service};
use profinet::lldp;
use profinet::record::{Address, Identification, ReadResponse, index};
use profinet::rpc::{DEVICE_INTERFACE, ENDPOINT_MAPPER_INTERFACE, Header, Kind, Operation, ResponseArgs};

use crate::address::EndAddress;
use crate::packet::{EthernetPacket, Payload};
use crate::relation::PeerTraits;

/// Stations that are remembered.
const MAX_STATIONS: usize = 256;

/// Most characters that are kept of a text.
const MAX_TEXT: usize = 240;

/// Subtype of a chassis ID and of a port ID that is a name (IEEE 802.1AB, 8.5.2, 8.5.3).
const LOCALLY_ASSIGNED: u8 = 7;

/// Slot of a device's access point, its subslot there, and the subslots of its interface (IEC 61158-6-10, 5.2.3.9): their I&M0 is that
/// of the device. Modules have their own.
const ACCESS_POINT_SLOT: u16 = 0;
const ACCESS_POINT_SUBSLOT: u16 = 1;
const INTERFACE_SUBSLOTS: std::ops::RangeInclusive<u16> = 0x8000..=0x8F00;

/// Place and length in bytes of the annotation in the answer of an endpoint mapper (C706, ept_lookup): handle, counts, object and
/// tower pointer come before it.
const ANNOTATION: std::ops::Range<usize> = 64..128;

/// A station.
#[derive(Clone, Default, Debug)]
struct SeenStation {
    mac: Mac,
    ip: Option<Ipv4Addr>,
    name: Option<String>,
    /// Vendor and device, or the key of CIP.
    identity: Option<String>,
    /// Order number, serial number, versions. I&M0 takes precedence over texts.
    details: Option<String>,
    has_record: bool,
}

/// All stations of a capture.
#[derive(Default, Debug)]
pub(crate) struct SeenStations {
    stations: Vec<SeenStation>,
}

/// Returns a text as a person can read it: no controls, single blanks; `None` if nothing is left.
fn text(bytes: &[u8]) -> Option<String> {
    let text = String::from_utf8_lossy(bytes);
    let plain = text.split(|character: char| character.is_whitespace() || character.is_control());
    let words: Vec<_> = plain.filter(|word| !word.is_empty()).collect();
    let text: String = words.join(" ").chars().take(MAX_TEXT).collect();
    (!text.is_empty()).then_some(text)
}

impl SeenStations {
    /// Reads a packet that may name a station.
    pub(crate) fn read(&mut self, packet: &EthernetPacket<'_>) {
        match packet.payload {
            Payload::Profinet(payload) => self.read_dcp(packet, payload),
            Payload::Lldp(payload) => self.read_lldp(packet.source, payload),
            Payload::Arp(payload) => {
                if let Ok(arp) = ArpPacket::parse(payload)
                    && !arp.sender_address.is_unspecified()
                    && let Some(station) = self.station(arp.sender_mac)
                {
                    station.ip = Some(arp.sender_address);
                }
            }
            Payload::Udp { from, data, .. } | Payload::Tcp { from, data, .. }
                if from.port() == ENCAPSULATION_PORT =>
            {
                self.read_identity(packet.source, *from.ip(), data);
            }
            Payload::Udp { from, data, .. } => {
                self.read_rpc(packet.source, *from.ip(), data);
            }
            Payload::Tcp { .. } | Payload::Other => {}
        }
    }

    /// Returns what was said of the station with this address, or with this interface; `identity` is that of its connection, for a
    /// station that said none of vendor and device itself.
    pub(crate) fn traits_of(
        &self,
        address: EndAddress,
        mac: Option<Mac>,
        identity: Option<String>,
    ) -> PeerTraits {
        let mac = match address {
            EndAddress::Mac(mac) => Some(mac),
            EndAddress::Ip(_) => mac,
        };
        let is_of = |station: &&SeenStation| match address {
            EndAddress::Ip(ip) if station.ip.is_some() => station.ip == Some(ip),
            EndAddress::Ip(_) | EndAddress::Mac(_) => Some(station.mac) == mac,
        };
        let Some(station) = self.stations.iter().find(is_of) else {
            return PeerTraits { identity, ..PeerTraits::default() };
        };
        let identity = station.identity.clone().or(identity);
        let identity: Vec<_> = identity.iter().chain(&station.details).cloned().collect();
        PeerTraits {
            mac: Some(station.mac),
            ip: station.ip,
            name: station.name.clone(),
            identity: (!identity.is_empty()).then(|| identity.join(", ")),
        }
    }

    fn station(&mut self, mac: Mac) -> Option<&mut SeenStation> {
        if mac.is_group() {
            return None;
        }
        let at = self.stations.iter().position(|station| station.mac == mac);
        if at.is_none() && self.stations.len() < MAX_STATIONS {
            self.stations.push(SeenStation { mac, ..SeenStation::default() });
        }
        let at = at.unwrap_or(self.stations.len().saturating_sub(1));
        self.stations.get_mut(at).filter(|station| station.mac == mac)
    }

    fn read_dcp(&mut self, packet: &EthernetPacket<'_>, payload: &[u8]) {
        let Ok(pdu) = dcp::Pdu::parse(payload) else { return };
        let of = match pdu.service {
            Service::IdentifyResponse | Service::Hello | Service::GetResponse => packet.source,
            Service::SetRequest => packet.destination,
            _ => return,
        };
        let Some(station) = self.station(of) else { return };
        for block in pdu.blocks().flatten() {
            match block.content {
                Content::NameOfStation(name) => station.name = text(name).or(station.name.take()),
                Content::DeviceId { vendor, device } => {
                    station.identity = Some(format!("vendor 0x{vendor:04X}, device 0x{device:04X}"));
                }
                Content::TypeOfStation(kind) if station.details.is_none() => station.details = text(kind),
                Content::Ip(suite) if !suite.address.is_unspecified() => station.ip = Some(suite.address),
                _ => {}
            }
        }
    }

    fn read_lldp(&mut self, source: Mac, payload: &[u8]) {
        let Ok(pdu) = lldp::Pdu::parse(payload) else { return };
        // The name of the port contains that of the station, or the chassis has it (IEC 61158-6-10, 4.11).
        let of_port = pdu
            .port
            .value
            .iter()
            .position(|byte| *byte == b'.')
            .and_then(|dot| pdu.port.value.get(dot + 1..));
        let of_port = of_port.filter(|_| pdu.port.subtype == LOCALLY_ASSIGNED);
        let of_chassis = Some(pdu.chassis.value).filter(|_| pdu.chassis.subtype == LOCALLY_ASSIGNED);
        let name = of_port.or(of_chassis).or(pdu.system_name).and_then(text);
        let (address, description) = (pdu.management_address, pdu.system_description.and_then(text));
        let Some(station) = self.station(pdu.chassis_mac.unwrap_or(source)) else { return };
        // DCP says it first hand.
        station.name = station.name.take().or(name);
        station.ip = station.ip.or(address.filter(|address| !address.is_unspecified()));
        if !station.has_record {
            station.details = description.or(station.details.take());
        }
    }

    fn read_identity(&mut self, source: Mac, ip: Ipv4Addr, data: &[u8]) {
        let Some(reply) = IdentityReply::parse(data) else { return };
        let Some(station) = self.station(source) else { return };
        let key = reply.identity.key;
        station.ip = Some(ip);
        station.name = text(reply.product_name).or(station.name.take());
        station.identity = Some(format!(
            "vendor 0x{:04X}, device type 0x{:02X}, product code {}, revision {}.{}, serial number 0x{:08X}",
            key.vendor,
            key.device_type,
            key.product_code,
            key.revision.major,
            key.revision.minor,
            reply.identity.serial_number
        ));
    }

    fn read_rpc(&mut self, source: Mac, ip: Ipv4Addr, datagram: &[u8]) {
        let Ok((header, body)) = Header::parse(datagram) else { return };
        if header.kind != Kind::Response || header.is_fragment() {
            return;
        }
        let (details, has_record) = match header.interface {
            ENDPOINT_MAPPER_INTERFACE => (body.get(ANNOTATION).and_then(text), false),
            DEVICE_INTERFACE => (identification(&header, body), true),
            _ => return,
        };
        let Some(details) = details else { return };
        let Some(station) = self.station(source) else { return };
        if !station.has_record {
            station.ip = Some(ip);
            (station.details, station.has_record) = (Some(details), has_record);
        }
    }
}

/// Returns the device's I&M0 in words, if this is the answer to its Read.
fn identification(header: &Header, body: &[u8]) -> Option<String> {
    let is_read = [Operation::Read, Operation::ReadImplicit].map(u16::from).contains(&header.operation);
    if !is_read {
        return None;
    }
    let blocks = ResponseArgs::parse(header, body).ok()?.blocks;
    let response = ReadResponse::parse(&mut BlockReader::new(blocks)).ok()?;
    let Address { slot, subslot, index, .. } = response.address;
    let is_of_device = index == index::IDENTIFICATION_AND_MAINTENANCE_0
        && slot == ACCESS_POINT_SLOT
        && (subslot == ACCESS_POINT_SUBSLOT || INTERFACE_SUBSLOTS.contains(&subslot));
    Some(Identification::parse(response.record).filter(|_| is_of_device)?.to_string())
}

#[cfg(test)]
mod tests;
