//! TCP/IP Interface, class F5 (volume 2, 5-4).

use super::super::Writer;
use super::super::cip::{Violation, class};
use super::{Device, Object, parse_exact, write_instance_path};
use core::net::Ipv4Addr;
use machine::Duration;
use machine::arp::ArpPacket;

/// Initial value of attribute 13 (volume 2, 5-4.3.13).
const DEFAULT_INACTIVITY_S: u16 = 120;

/// Length of attribute 11: activity, MAC address of the other station, its ARP packet (volume 2, 5-4.3.11).
const LAST_CONFLICT: usize = 1 + 6 + ArpPacket::LEN;

/// Multicast addresses reserved for each device (volume 2, 3-5.3).
pub(in super::super) const MULTICASTS: u16 = 32;

/// The device's addresses in the network.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(in super::super) struct Network {
    pub(in super::super) address: Ipv4Addr,
    pub(in super::super) mask: Ipv4Addr,
    pub(in super::super) gateway: Ipv4Addr,
    pub(in super::super) mac: [u8; 6],
    inactivity_s: u16,
    /// Whether address conflicts are detected.
    pub(in super::super) detects_conflicts: bool,
    last_conflict: [u8; LAST_CONFLICT],
    /// Whether a conflict was detected since the start.
    has_conflict: bool,
}

impl Network {
    pub(in super::super) const fn new(
        address: Ipv4Addr,
        mask: Ipv4Addr,
        gateway: Ipv4Addr,
        mac: [u8; 6],
    ) -> Self {
        Self {
            address,
            mask,
            gateway,
            mac,
            inactivity_s: DEFAULT_INACTIVITY_S,
            detects_conflicts: false,
            last_conflict: [0; LAST_CONFLICT],
            has_conflict: false,
        }
    }

    /// Takes note of a conflict: the packet that showed it, and whether this device was probing its address.
    pub(in super::super) fn conflict(&mut self, packet: &ArpPacket, is_probing: bool) {
        self.has_conflict = true;
        let mut writer = machine::wire::Writer::<machine::wire::BigEndian>::new(&mut self.last_conflict);
        // AcdActivity: 1 the address was probed, 2 it was in use and defended.
        writer.u8(if is_probing { 1 } else { 2 });
        writer.bytes(&packet.sender_mac.0);
        packet.emit(&mut writer);
    }

    pub(super) const fn restore_defaults(&mut self) {
        self.inactivity_s = DEFAULT_INACTIVITY_S;
    }

    /// Returns how long a TCP connection may be silent; `None` if there is no limit.
    pub(in super::super) fn inactivity(&self) -> Option<Duration> {
        (self.inactivity_s > 0).then(|| Duration::from_secs(self.inactivity_s.into()))
    }

    /// Returns one of the device's own [`MULTICASTS`] addresses, from 0: 239.192.1.0 + 32 · (the lower ten bits of host − 1) +
    /// index (volume 2, 3-5.3).
    pub(in super::super) fn multicast(&self, index: u32) -> Ipv4Addr {
        let host = self.address.to_bits() & !self.mask.to_bits();
        let base = Ipv4Addr::new(239, 192, 1, 0).to_bits();
        Ipv4Addr::from_bits(base + u32::from(MULTICASTS) * (host.wrapping_sub(1) & 0x3FF) + index)
    }

    /// Returns whether this address is in the device's subnet.
    pub(in super::super) fn is_local(&self, address: Ipv4Addr) -> bool {
        (self.address.to_bits() ^ address.to_bits()) & self.mask.to_bits() == 0
    }
}

pub(super) struct TcpIpInterface;

impl Object for TcpIpInterface {
    const REVISION: u16 = 4;
    const ATTRIBUTES: &'static [u16] = &[1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13];

    fn get(
        device: &Device,
        _instance: u32,
        attribute: u16,
        writer: &mut Writer<'_>,
    ) -> Result<(), Violation> {
        let network = &device.network;
        // Addresses are written like all numbers here: least significant byte first.
        let address = |writer: &mut Writer<'_>, address: Ipv4Addr| writer.u32(address.to_bits());
        match attribute {
            // Status: the interface is configured by its operating system; bit 6, a conflict was detected.
            1 => writer.u32(1 | u32::from(network.has_conflict) << 6),
            // Capability: static; bit 7, conflicts can be detected.
            2 => writer.u32(u32::from(network.detects_conflicts) << 7),
            // Control: nothing can be configured by this object.
            3 => writer.u32(0),
            4 => write_instance_path(writer, class::ETHERNET_LINK),
            5 => {
                [network.address, network.mask, network.gateway].into_iter().for_each(|a| address(writer, a));
                // No name servers, no domain name.
                writer.zeros(4 + 4 + 2);
            }
            // No host name.
            6 => writer.u16(0),
            // No safety network number.
            7 => writer.zeros(6),
            // Multicasts stay on their network: time to live 1.
            8 => writer.u8(1),
            9 => {
                // Allocation by the default algorithm.
                writer.u16(0);
                writer.u16(MULTICASTS);
                address(writer, network.multicast(0));
            }
            // SelectAcd; LastConflictDetected.
            10 => writer.u8(network.detects_conflicts.into()),
            11 => writer.bytes(&network.last_conflict),
            // Quick connect is off.
            12 => writer.u8(0),
            13 => writer.u16(network.inactivity_s),
            _ => return Err(Violation::UnknownAttribute),
        }
        Ok(())
    }

    fn set(device: &mut Device, _instance: u32, attribute: u16, data: &[u8]) -> Result<(), Violation> {
        let locked = device.locked;
        let network = &mut device.network;
        match attribute {
            3 => match u32::from_le_bytes(parse_exact(data)?) {
                0 => Ok(()),
                _ => Err(Violation::BadAttributeValue),
            },
            13 => match u16::from_le_bytes(parse_exact(data)?) {
                // A shorter time would end the TCP connection of the owner of the outputs.
                seconds @ 0..=3600 if locked && seconds != network.inactivity_s => Err(Violation::InUse),
                seconds @ 0..=3600 => {
                    network.inactivity_s = seconds;
                    Ok(())
                }
                _ => Err(Violation::BadAttributeValue),
            },
            _ => Err(Violation::NotSettable),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_host_of_a_subnet_has_multicast_addresses_of_its_own() {
        let multicast = |address: [u8; 4]| {
            let (mask, gateway) = (Ipv4Addr::new(255, 255, 255, 0), Ipv4Addr::UNSPECIFIED);
            Network::new(address.into(), mask, gateway, [0; 6]).multicast(0).octets()
        };
        assert_eq!(multicast([192, 168, 64, 1]), [239, 192, 1, 0]);
        assert_eq!(multicast([192, 168, 64, 2]), [239, 192, 1, 32]);
        assert_eq!(multicast([192, 168, 64, 254]), [239, 192, 32, 160]);
    }

    #[test]
    fn the_1024th_host_of_a_large_subnet_does_not_have_the_addresses_of_the_first() {
        let multicast = |address: [u8; 4]| {
            let (mask, gateway) = (Ipv4Addr::new(255, 255, 0, 0), Ipv4Addr::UNSPECIFIED);
            Network::new(address.into(), mask, gateway, [0; 6]).multicast(0).octets()
        };
        assert_eq!(multicast([10, 0, 0, 1]), [239, 192, 1, 0]);
        assert_eq!(multicast([10, 0, 3, 255]), [239, 192, 128, 192], "host 1023");
        assert_eq!(multicast([10, 0, 4, 0]), [239, 192, 128, 224], "host 1024");
        assert_eq!(multicast([10, 0, 4, 1]), [239, 192, 1, 0], "only ten bits are left");
    }

    #[test]
    fn the_last_conflict_is_the_activity_the_other_station_and_its_packet() {
        let mac = machine::ethernet::Mac([2, 0, 0, 0, 0, 9]);
        let packet = ArpPacket::announcement(mac, Ipv4Addr::new(192, 168, 64, 2));
        for (is_probing, activity) in [(true, 1), (false, 2)] {
            let [address, mask] = [[192, 168, 64, 2], [255, 255, 255, 0]].map(Ipv4Addr::from);
            let mut network = Network::new(address, mask, Ipv4Addr::UNSPECIFIED, [0; 6]);
            assert_eq!((network.has_conflict, network.last_conflict), (false, [0; 35]));
            network.conflict(&packet, is_probing);
            assert!(network.has_conflict);
            let [first, rest @ ..] = network.last_conflict;
            assert_eq!((first, &rest[..6]), (activity, &mac.0[..]));
            assert_eq!(ArpPacket::parse(&rest[6..]), Ok(packet));
        }
    }
}
