//! State and counters of an interface: its cable by ethtool, its counters over rtnetlink, its gateway by the table of routes.

use std::net::Ipv4Addr;

use machine::{LinkCounters, LinkStatus, Medium};
use rustix::io::Errno;
use rustix::net::netlink::SocketAddrNetlink;
use rustix::net::{AddressFamily, RecvFlags, SendFlags, SocketFlags, SocketType, recv, sendto, socket_with};

use super::{Interface, routes};

/// `ETHTOOL_GSET` of linux/ethtool.h.
const GET_SETTINGS: u32 = 0x01;

/// Number of 32-bit words of a `struct ethtool_cmd`.
const SETTINGS_WORDS: usize = 11;

/// The speed of an interface that does not know it.
const SPEED_UNKNOWN: u32 = u32::MAX;

const RTM_GETLINK: u16 = 18;
const NLM_F_REQUEST: u16 = 1;
/// A `struct rtnl_link_stats64`.
const IFLA_STATS64: u16 = 23;

/// Room for an answer: its attributes depend on the driver.
const ANSWER_ROOM: usize = 32 << 10;

impl Interface {
    /// Returns its state and counters; what the kernel does not tell is unknown or 0. It allocates.
    #[must_use]
    pub fn link_status(&self) -> LinkStatus {
        let settings = self.settings().map(|words| parse_settings(&words)).unwrap_or_default();
        LinkStatus {
            is_up: self.has_carrier().unwrap_or(false),
            gateway: self.gateway(),
            counters: self.counters().unwrap_or_default(),
            ..settings
        }
    }

    /// Returns the gateway to other networks through it, if there is one. It allocates.
    #[must_use]
    pub fn gateway(&self) -> Option<Ipv4Addr> {
        parse_gateway(&routes().ok()?, self.name())
    }

    fn settings(&self) -> std::io::Result<[u32; SETTINGS_WORDS]> {
        let mut words = [0; SETTINGS_WORDS];
        words[0] = GET_SETTINGS;
        let mut request = self.request();
        request.ifr_ifru.ifru_data = words.as_mut_ptr().cast();
        // `words` outlives the request, and the kernel touches no more than an `ethtool_cmd`, which it is as long as.
        self.ioctl(libc::SIOCETHTOOL, &mut request)?;
        Ok(words)
    }

    fn counters(&self) -> Result<LinkCounters, Errno> {
        let socket = socket_with(AddressFamily::NETLINK, SocketType::RAW, SocketFlags::CLOEXEC, None)?;
        // nlmsghdr: length, type, flags, sequence, port; ifinfomsg: family, type, index, flags, change.
        let mut request = [0; 32];
        request[0..4].copy_from_slice(&32_u32.to_ne_bytes());
        request[4..6].copy_from_slice(&RTM_GETLINK.to_ne_bytes());
        request[6..8].copy_from_slice(&NLM_F_REQUEST.to_ne_bytes());
        request[20..24].copy_from_slice(&self.index().to_ne_bytes());
        sendto(&socket, &request, SendFlags::empty(), &SocketAddrNetlink::new(0, 0))?;
        let mut answer = vec![0; ANSWER_ROOM];
        let (len, _) = recv(&socket, &mut answer[..], RecvFlags::empty())?;
        parse_counters(answer.get(..len).unwrap_or_default()).ok_or(Errno::PROTO)
    }
}

/// Parses a `struct ethtool_cmd`: command, supported and advertised modes; speed u16, duplex u8, port u8; address, transceiver,
/// autonegotiation, MDIO; frames to wait for; upper half of the speed u16.
fn parse_settings(words: &[u32; SETTINGS_WORDS]) -> LinkStatus {
    let [low, high] = [words[3], words[7]].map(u32::to_ne_bytes);
    let [_, _, negotiation, _] = words[4].to_ne_bytes();
    let [low_0, low_1, duplex, port] = low;
    let speed = u32::from(u16::from_ne_bytes([low_0, low_1]))
        | u32::from(u16::from_ne_bytes([high[0], high[1]])) << 16;
    LinkStatus {
        speed_mbit_s: Some(speed).filter(|speed| !matches!(*speed, 0 | SPEED_UNKNOWN)),
        is_full_duplex: match duplex {
            0 => Some(false),
            1 => Some(true),
            _ => None,
        },
        is_negotiated: Some(negotiation != 0),
        medium: match port {
            0 => Medium::TwistedPair,
            3 => Medium::Fibre,
            _ => Medium::Unknown,
        },
        ..LinkStatus::default()
    }
}

/// Finds the counters in an answer to `RTM_GETLINK`.
fn parse_counters(answer: &[u8]) -> Option<LinkCounters> {
    let number = |bytes: &[u8], at: usize| {
        bytes.get(at..at + 2).and_then(|bytes| bytes.try_into().ok()).map(u16::from_ne_bytes)
    };
    let mut attributes = answer.get(32..)?;
    let statistics = loop {
        let (len, kind) = (usize::from(number(attributes, 0)?), number(attributes, 2)?);
        if kind == IFLA_STATS64 {
            break attributes.get(4..len)?;
        }
        attributes = attributes.get(len.max(4).next_multiple_of(4)..)?;
    };
    // An older kernel has fewer.
    let counter = |index: usize| {
        let bytes = statistics.get(8 * index..8 * index + 8);
        bytes.and_then(|bytes| bytes.try_into().ok()).map_or(0, u64::from_ne_bytes)
    };
    let multicast = counter(8);
    Some(LinkCounters {
        in_octets: counter(2),
        // Linux counts broadcasts neither way, and multicasts when they are received.
        in_unicast: counter(0).saturating_sub(multicast),
        in_multicast: multicast,
        in_broadcast: 0,
        in_discards: counter(6),
        in_errors: counter(4),
        in_unknown_protocols: counter(23),
        out_octets: counter(3),
        out_unicast: counter(1),
        out_multicast: 0,
        out_broadcast: 0,
        out_discards: counter(7),
        out_errors: counter(5),
        alignment_errors: counter(13),
        fcs_errors: counter(12),
        single_collisions: counter(9),
        multiple_collisions: 0,
        sqe_test_errors: counter(19),
        deferred: 0,
        late_collisions: counter(20),
        excessive_collisions: counter(16),
        transmit_errors: counter(18),
        carrier_sense_errors: counter(17),
        too_long: counter(10),
        receive_errors: counter(11).saturating_add(counter(14)).saturating_add(counter(15)),
        symbol_errors: 0,
    })
}

/// Finds the default route through an interface in the kernel's table: interface, destination, gateway, flags, references, use,
/// metric, mask. Of several, the one with the lowest metric counts.
fn parse_gateway(routes: &str, interface: &str) -> Option<Ipv4Addr> {
    let default = |line: &str| {
        let fields: Vec<&str> = line.split_ascii_whitespace().collect();
        let [name, "00000000", gateway, _, _, _, metric, "00000000", ..] = fields[..] else { return None };
        let gateway = u32::from_str_radix(gateway, 16).ok().filter(|gateway| *gateway != 0)?;
        let metric: u32 = metric.parse().ok()?;
        (name == interface).then(|| (metric, Ipv4Addr::from(gateway.to_ne_bytes())))
    };
    routes.lines().skip(1).filter_map(default).min_by_key(|(metric, _)| *metric).map(|(_, gateway)| gateway)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cable_of_10_gbit_s_is_read_with_duplex_negotiation_and_medium() {
        let words = |speed: u32, [duplex, port, negotiation]: [u8; 3]| {
            let [a, b, c, d] = speed.to_ne_bytes();
            let mut words = [0; SETTINGS_WORDS];
            // The halves of the speed stand apart; on a little-endian host the lower one is the first.
            let (low, high) =
                if cfg!(target_endian = "little") { ([a, b], [c, d]) } else { ([c, d], [a, b]) };
            words[3] = u32::from_ne_bytes([low[0], low[1], duplex, port]);
            words[4] = u32::from_ne_bytes([0, 0, negotiation, 0]);
            words[7] = u32::from_ne_bytes([high[0], high[1], 0, 0]);
            words
        };
        let status = parse_settings(&words(10_000, [1, 0, 0]));
        let expected = LinkStatus {
            speed_mbit_s: Some(10_000),
            is_full_duplex: Some(true),
            is_negotiated: Some(false),
            medium: Medium::TwistedPair,
            ..LinkStatus::default()
        };
        assert_eq!(status, expected);
        let fibre = parse_settings(&words(100_000, [1, 3, 1]));
        assert_eq!(
            (fibre.speed_mbit_s, fibre.is_negotiated, fibre.medium),
            (Some(100_000), Some(true), Medium::Fibre)
        );
        let unknown = parse_settings(&words(SPEED_UNKNOWN, [0xFF, 0xFF, 0]));
        assert_eq!(
            (unknown.speed_mbit_s, unknown.is_full_duplex, unknown.medium),
            (None, None, Medium::Unknown)
        );
    }

    #[test]
    fn counters_are_found_behind_other_attributes_and_an_answer_that_is_cut_has_none() {
        let mut answer = vec![0; 32];
        // A name of two characters, with its padding.
        answer.extend([[7, 0], [3, 0]].concat().iter());
        answer.extend(b"lo\0\0");
        let statistics: Vec<u8> = (0..24_u64).flat_map(|index| (1_000 + index).to_ne_bytes()).collect();
        answer.extend(u16::try_from(4 + statistics.len()).unwrap().to_ne_bytes());
        answer.extend(IFLA_STATS64.to_ne_bytes());
        answer.extend(&statistics);
        if cfg!(target_endian = "little") {
            let counters = parse_counters(&answer).unwrap();
            assert_eq!(
                (counters.in_octets, counters.out_octets, counters.out_unicast),
                (1_002, 1_003, 1_001)
            );
            assert_eq!((counters.fcs_errors, counters.alignment_errors), (1_012, 1_013));
            assert!((0..answer.len()).all(|cut| parse_counters(&answer[..cut]).is_none()));
        }
        // A length of 0 does not stop the search.
        answer[32..34].copy_from_slice(&[0, 0]);
        let _ = parse_counters(&answer);
    }

    #[test]
    fn the_gateway_is_that_of_the_default_route_with_the_lowest_metric_through_the_interface() {
        let routes = "Iface\tDestination\tGateway\tFlags\tRefCnt\tUse\tMetric\tMask\tMTU\tWindow\tIRTT\n\
            eth0\t00000000\t0140A8C0\t0003\t0\t0\t200\t00000000\t0\t0\t0\n\
            eth0\t00000000\tFE40A8C0\t0003\t0\t0\t100\t00000000\t0\t0\t0\n\
            eth1\t00000000\t0100000A\t0003\t0\t0\t0\t00000000\t0\t0\t0\n\
            eth0\t0040A8C0\t00000000\t0001\t0\t0\t0\t00FFFFFF\t0\t0\t0\n";
        if cfg!(target_endian = "little") {
            assert_eq!(parse_gateway(routes, "eth0"), Some(Ipv4Addr::new(192, 168, 64, 254)));
            assert_eq!(parse_gateway(routes, "eth1"), Some(Ipv4Addr::new(10, 0, 0, 1)));
        }
        assert_eq!(parse_gateway(routes, "eth2"), None);
        assert_eq!(parse_gateway("", "eth0"), None);
    }
}
