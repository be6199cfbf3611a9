//! Which local addresses use a port that could not be opened, by the kernel's tables.

use std::fmt;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};

/// Transport protocol of a port.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Transport {
    /// UDP.
    Udp,
    /// TCP.
    Tcp,
}

impl Transport {
    /// Returns the option with which `ss` lists its sockets.
    pub(crate) const fn option(self) -> char {
        match self {
            Self::Udp => 'u',
            Self::Tcp => 't',
        }
    }
}

impl fmt::Display for Transport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Udp => "UDP",
            Self::Tcp => "TCP",
        })
    }
}

/// Returns the addresses of this thread's network namespace on which a program listens to this port.
pub(crate) fn find(transport: Transport, port: u16) -> Vec<SocketAddr> {
    let tables = match transport {
        Transport::Udp => ["udp", "udp6"],
        Transport::Tcp => ["tcp", "tcp6"],
    };
    let read = |table| std::fs::read_to_string(format!("/proc/thread-self/net/{table}")).unwrap_or_default();
    let all = tables.map(read).concat();
    all.lines().filter_map(listening).filter(|address| address.port() == port).collect()
}

/// Parses the local address in a line of such a table, if the socket has no peer: `sl local_address rem_address st
/// …`.
fn listening(line: &str) -> Option<SocketAddr> {
    let mut columns = line.split_whitespace().skip(1);
    let (local, remote) = (columns.next()?, columns.next()?);
    let (address, port) = local.split_once(':')?;
    let port = u16::from_str_radix(port, 16).ok()?;
    remote.ends_with(":0000").then_some(SocketAddr::new(ip(address)?, port))
}

/// Parses an IP address, which the kernel prints as 32-bit words in host byte order.
fn ip(hexadecimal: &str) -> Option<IpAddr> {
    let word = |at: usize| u32::from_str_radix(hexadecimal.get(at..at + 8)?, 16).ok().map(u32::to_ne_bytes);
    match hexadecimal.len() {
        8 => Some(Ipv4Addr::from(word(0)?).into()),
        32 => {
            let mut octets = [0; 16];
            for (index, place) in octets.chunks_exact_mut(4).enumerate() {
                place.copy_from_slice(&word(8 * index)?);
            }
            Some(Ipv6Addr::from(octets).into())
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(target_endian = "little")]
    fn a_line_of_the_kernels_table_gives_its_local_address() {
        let listens =
            "   1: 0100007F:AF12 00000000:0000 0A 00000000:00000000 00:00000000 00000000     0        0 17";
        assert_eq!(listening(listens), Some("127.0.0.1:44818".parse().unwrap()));
        let listens6 = "   0: 00000000000000000000000000000000:AF12 00000000000000000000000000000000:0000 0A";
        assert_eq!(listening(listens6), Some("[::]:44818".parse().unwrap()));
        let connected =
            "   2: 0100007F:AF12 0100007F:D431 01 00000000:00000000 00:00000000 00000000     0        0 18";
        assert_eq!(listening(connected), None);
        assert_eq!(listening("  sl  local_address rem_address   st"), None);
    }
}
