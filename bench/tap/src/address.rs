//! Addresses of the two ends.

use std::fmt;
use std::net::Ipv4Addr;

use machine::ethernet::Mac;

/// EndAddress by which a station sends its cyclic frames.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum EndAddress {
    /// That of its interface, for PROFINET in EtherType 0x8892.
    Mac(Mac),
    /// Its IP address, for PROFINET over UDP and for EtherNet/IP.
    Ip(Ipv4Addr),
}

impl EndAddress {
    /// Returns whether it is the address of a group.
    pub(crate) const fn is_group(self) -> bool {
        match self {
            Self::Mac(mac) => mac.is_group(),
            Self::Ip(address) => address.is_multicast() || address.is_broadcast(),
        }
    }
}

impl fmt::Display for EndAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Mac(mac) => mac.fmt(f),
            Self::Ip(address) => address.fmt(f),
        }
    }
}

impl std::str::FromStr for EndAddress {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let as_ip = text.parse().map(Self::Ip);
        as_ip.or_else(|_| text.parse().map(Self::Mac)).map_err(|_| {
            format!("`{text}`: expected an IP address such as 10.0.0.2, or a MAC address such as 02:00:00:00:00:02")
        })
    }
}

/// CyclicBus that carries the cyclic frames.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum CyclicBus {
    /// PROFINET in EtherType 0x8892.
    ProfinetRt,
    /// PROFINET over UDP.
    ProfinetUdp,
    /// EtherNet/IP.
    EthernetIp,
}

impl fmt::Display for CyclicBus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::ProfinetRt => "PROFINET RT",
            Self::ProfinetUdp => "PROFINET RT over UDP",
            Self::EthernetIp => "EtherNet/IP",
        })
    }
}
