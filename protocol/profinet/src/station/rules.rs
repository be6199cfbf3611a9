//! What DCP allows as a station's name and as its address.

use core::net::Ipv4Addr;

use super::NO_ADDRESS;
use crate::dcp::{IpSuite, MAX_NAME_LEN};

/// Returns whether DCP allows this name: labels of lower-case letters, digits and hyphens, up to 63 bytes each and without
/// a hyphen at either end, separated by dots, up to 240 bytes in total; but neither what reads as an IP address nor a first
/// label that names a port (`port-001`, `port-001-00000`); or no name (IEC 61158-6-10, NameOfStationValue).
#[must_use]
pub fn is_station_name(name: &[u8]) -> bool {
    name.is_empty()
        || name.len() <= MAX_NAME_LEN
            && labels(name).all(is_label)
            && !labels(name).next().is_some_and(is_port)
            && !is_dotted_quad(name)
}

fn labels(name: &[u8]) -> impl Iterator<Item = &[u8]> {
    name.split(|byte| *byte == b'.')
}

fn is_label(label: &[u8]) -> bool {
    let is_inner = |byte: &u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || *byte == b'-';
    (1..=63).contains(&label.len())
        && label.iter().all(is_inner)
        && label.first() != Some(&b'-')
        && label.last() != Some(&b'-')
}

fn is_number(digits: &[u8]) -> bool {
    digits.iter().all(u8::is_ascii_digit)
}

/// Returns whether a label is that of a port, with or without its slot.
fn is_port(label: &[u8]) -> bool {
    match label.strip_prefix(b"port-") {
        Some(port @ [_, _, _]) => is_number(port),
        Some([port @ .., b'-', a, b, c, d, e]) => {
            port.len() == 3 && is_number(port) && is_number(&[*a, *b, *c, *d, *e])
        }
        _ => false,
    }
}

/// Returns whether a name is four numbers of up to three digits.
fn is_dotted_quad(name: &[u8]) -> bool {
    labels(name).count() == 4 && labels(name).all(|label| label.len() <= 3 && is_number(label))
}

/// Returns whether a station can have this address, mask and gateway: all zeros, for none; or the address of a host in a
/// subnet, with a gateway in the same subnet or without one, which is 0.0.0.0 or the own address (IEC 61158-6-10,
/// IPParameterValue).
pub(super) fn is_address(suite: IpSuite) -> bool {
    let IpSuite { address, mask, gateway } = suite;
    let bits = mask.to_bits();
    let is_contiguous = bits.leading_ones() + bits.trailing_zeros() == 32;
    // A mask of 31 or 32 bits leaves no address for a second host.
    let is_mask = is_contiguous && (1..=30).contains(&bits.leading_ones());
    let has_gateway = !gateway.is_unspecified();
    let subnet = |of: Ipv4Addr| of.to_bits() & bits;
    suite == NO_ADDRESS
        || is_mask
            && is_host(address, bits)
            && (!has_gateway || is_host(gateway, bits) && subnet(gateway) == subnet(address))
}

/// Returns whether an address can be that of a host: neither 0.x.x.x, loopback, multicast nor reserved, and neither the
/// first nor the last of its subnet.
const fn is_host(address: Ipv4Addr, mask: u32) -> bool {
    let [class, ..] = address.octets();
    let host = address.to_bits() & !mask;
    class != 0 && class != 127 && class < 224 && host != 0 && host != !mask
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_that_reads_as_an_address_or_as_a_port_is_none() {
        for name in
            ["1.2.3.4", "192.168.000.001", "999.999.999.999", "port-001", "port-001-00000", "port-001.plc"]
        {
            assert!(!is_station_name(name.as_bytes()), "{name}");
        }
        for name in [
            "1.2.3",
            "1.2.3.4.5",
            "1.2.3.4444",
            "1.2.3.a",
            "port-01",
            "port-0001",
            "port-abc",
            "port-001-0000",
            "x.port-001",
        ] {
            assert!(is_station_name(name.as_bytes()), "{name}");
        }
    }

    #[test]
    fn labels_are_of_lower_case_letters_digits_and_inner_hyphens() {
        let longest = [[b'a'; 63]; 4].join(&b'.');
        for (name, allowed) in [
            (&b""[..], true),
            (b"a", true),
            (b"xn--a-b", true),
            (&longest[..240], true),
            (&longest[..241], false),
            (&[b'a'; 63], true),
            (&[b'a'; 64], false),
            (b"A", false),
            (b"a_b", false),
            (b"-a", false),
            (b"a-", false),
            (b"a.-b", false),
            (b"a.b-", false),
            (b".a", false),
            (b"a.", false),
            (b"a..b", false),
            (b"a b", false),
            (b"a\0", false),
            ("ä".as_bytes(), false),
        ] {
            assert_eq!(is_station_name(name), allowed, "{}", String::from_utf8_lossy(name));
        }
    }

    #[test]
    fn an_address_is_that_of_a_host_whose_gateway_is_in_its_subnet() {
        let suite = |[address, mask, gateway]: [&str; 3]| IpSuite {
            address: address.parse().unwrap(),
            mask: mask.parse().unwrap(),
            gateway: gateway.parse().unwrap(),
        };
        const MASK: &str = "255.255.255.0";
        for allowed in [
            ["0.0.0.0", "0.0.0.0", "0.0.0.0"],
            ["10.0.0.1", MASK, "0.0.0.0"],
            ["10.0.0.1", MASK, "10.0.0.1"],
            ["10.0.0.1", MASK, "10.0.0.254"],
            ["10.0.0.255", "255.255.0.0", "10.0.255.1"],
            ["10.0.0.1", "255.255.255.252", "10.0.0.2"],
        ] {
            assert!(is_address(suite(allowed)), "{allowed:?}");
        }
        for refused in [
            ["10.0.0.1", MASK, "10.0.1.1"],
            ["10.0.0.1", MASK, "10.0.0.0"],
            ["10.0.0.1", MASK, "10.0.0.255"],
            ["10.0.0.0", MASK, "0.0.0.0"],
            ["10.0.0.255", MASK, "0.0.0.0"],
            ["10.0.0.1", "255.0.255.0", "0.0.0.0"],
            ["10.0.0.1", "0.0.0.0", "0.0.0.0"],
            ["10.0.0.1", "255.255.255.254", "0.0.0.0"],
            ["10.0.0.1", "255.255.255.255", "0.0.0.0"],
            ["0.0.0.0", MASK, "0.0.0.0"],
            ["0.0.0.0", "0.0.0.0", "10.0.0.1"],
            ["0.1.2.3", MASK, "0.0.0.0"],
            ["127.0.0.1", "255.0.0.0", "0.0.0.0"],
            ["224.0.0.1", MASK, "0.0.0.0"],
            ["240.0.0.1", MASK, "0.0.0.0"],
            ["255.255.255.255", MASK, "0.0.0.0"],
        ] {
            assert!(!is_address(suite(refused)), "{refused:?}");
        }
    }

    #[test]
    fn a_port_with_its_slot_has_three_and_five_digits() {
        assert!(!is_station_name(b"port-001-00000"));
        for name in
            ["port-abc-00000", "port-01-00000", "port-0001-00000", "port-001-abcde", "port-001-000000"]
        {
            assert!(is_station_name(name.as_bytes()), "{name}");
        }
    }
}
