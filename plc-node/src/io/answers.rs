//! The device that is meant, among those that answered.

use std::net::Ipv4Addr;

use ethercat_maindevice::FoundSubDevice;
use ethernet_ip::FoundDevice;
use profinet::FoundStation;

use super::target_error::TargetError;
use crate::printable::printable;

/// Most devices that a message lists.
const MOST_LISTED: usize = 12;

fn list<D>(devices: &[&D], text: impl Fn(&D) -> String) -> String {
    let texts: Vec<_> = devices.iter().take(MOST_LISTED).map(|device| text(device)).collect();
    if texts.is_empty() { "none".to_owned() } else { texts.join(", ") }
}

/// Returns the address of the only adapter of an identity.
///
/// # Errors
///
/// There is none, there are several, or several have its address.
pub(super) fn adapter_among(
    found: &[FoundDevice],
    vendor: u16,
    product_code: u16,
) -> Result<Ipv4Addr, TargetError> {
    let is_its =
        |it: &&FoundDevice| (it.identity.key.vendor, it.identity.key.product_code) == (vendor, product_code);
    let its: Vec<_> = found.iter().filter(is_its).collect();
    match its.as_slice() {
        [] => Err(TargetError::None("EtherNet/IP")),
        [first, others @ ..] => {
            let serial = |it: &FoundDevice| format!("serial number 0x{:08X}", it.identity.serial_number);
            let sharing: Vec<_> = found.iter().filter(|it| it.address == first.address).collect();
            if sharing.len() > 1 && others.iter().all(|it| it.address == first.address) {
                return Err(TargetError::SharedAddress(sharing.len(), first.address, list(&sharing, serial)));
            }
            if others.is_empty() {
                return Ok(first.address);
            }
            let with_serial = |it: &FoundDevice| format!("{} ({})", it.address, serial(it));
            Err(TargetError::Several(its.len(), list(&its, with_serial)))
        }
    }
}

/// Returns the position, from 1, of the only device of an identity among several on an EtherCAT cable. Without another device,
/// or without one of the identity, it is `None`: the MainDevice names what it finds in the device's place.
///
/// # Errors
///
/// There are several.
pub(super) fn position_among(
    found: &[FoundSubDevice],
    vendor: u32,
    product: u32,
) -> Result<Option<u16>, TargetError> {
    let serial = |it: &FoundSubDevice| {
        let identity = it.identity.as_ref().ok()?;
        ((identity.vendor, identity.product) == (vendor, product)).then_some(identity.serial_number)
    };
    let its: Vec<_> = found.iter().filter(|it| serial(it).is_some()).collect();
    match its.as_slice() {
        [] => Ok(None),
        [only] => Ok((found.len() > 1).then(|| only.position.saturating_add(1))),
        several => {
            let text = |it: &FoundSubDevice| {
                format!(
                    "position {} (serial number 0x{:08X})",
                    it.position.saturating_add(1),
                    serial(it).unwrap_or(0)
                )
            };
            Err(TargetError::Several(several.len(), list(several, text)))
        }
    }
}

/// Returns the station of a name; without one, the only one of an identity.
///
/// # Errors
///
/// There is none, or there are several.
pub(super) fn station_among<'a>(
    found: &'a [FoundStation],
    identity: (u16, u16),
    at: Option<&str>,
) -> Result<&'a FoundStation, TargetError> {
    let is_its = |it: &&FoundStation| match at {
        Some(at) => &*it.name == at.as_bytes(),
        None => it.identity == Some(identity),
    };
    let its: Vec<_> = found.iter().filter(is_its).collect();
    let all: Vec<_> = found.iter().collect();
    let name = |it: &FoundStation| printable(&it.name);
    match (its.as_slice(), at) {
        ([only], _) => Ok(only),
        ([], Some(at)) => Err(TargetError::NoStation(printable(at.as_bytes()), list(&all, name))),
        ([], None) => Err(TargetError::None("PROFINET")),
        ([first, others @ ..], _) if others.iter().all(|it| it.name == first.name) => {
            Err(TargetError::Twins(its.len(), name(first), list(&its, |it| it.mac.to_string())))
        }
        (several, _) => {
            Err(TargetError::Several(several.len(), list(several, |it| format!("{} ({})", name(it), it.mac))))
        }
    }
}

/// Checks that no other station has the address of this one.
///
/// # Errors
///
/// Several have it.
pub(super) fn alone_at_its_address(
    found: &[FoundStation],
    station: &FoundStation,
) -> Result<(), TargetError> {
    let address = |it: &FoundStation| it.ip.map(|ip| ip.address).filter(|address| !address.is_unspecified());
    let Some(its) = address(station) else { return Ok(()) };
    let sharing: Vec<_> = found.iter().filter(|it| address(it) == Some(its)).collect();
    if sharing.len() < 2 {
        return Ok(());
    }
    let text = |it: &FoundStation| format!("{} ({})", printable(&it.name), it.mac);
    Err(TargetError::SharedAddress(sharing.len(), its, list(&sharing, text)))
}

#[cfg(test)]
mod tests {
    use std::net::SocketAddrV4;

    use ethercat_maindevice::{Identity as SubDeviceIdentity, Unreadable};
    use ethernet_ip::cip::{ElectronicKey, Revision};
    use ethernet_ip::description::Identity;
    use machine::ethernet::Mac;
    use profinet::dcp::IpSuite;

    use super::*;

    fn adapter(host: u8, product_code: u16, serial_number: u32) -> FoundDevice {
        let address = Ipv4Addr::new(192, 168, 0, host);
        let revision = Revision { major: 1, minor: 1 };
        let key = ElectronicKey { vendor: 5, device_type: 0x2B, product_code, revision, compatible: false };
        FoundDevice {
            address,
            listens_at: SocketAddrV4::new(address, 44_818),
            identity: Identity { key, serial_number },
            status: 0,
            product_name: Box::default(),
            state: 3,
        }
    }

    fn station(mac: u8, name: &str, host: u8) -> FoundStation {
        let address = Ipv4Addr::new(192, 168, 0, host);
        FoundStation {
            mac: Mac([2, 0, 0, 0, 0, mac]),
            name: name.as_bytes().into(),
            type_of_station: Box::default(),
            identity: Some((0x1234, 1)),
            ip: Some(IpSuite { address, mask: Ipv4Addr::new(255, 255, 255, 0), gateway: address }),
            roles: 1,
        }
    }

    #[test]
    fn two_adapters_of_one_address_are_told_and_never_taken_for_one() {
        let one = Ipv4Addr::new(192, 168, 0, 2);
        assert_eq!(adapter_among(&[adapter(2, 7, 1), adapter(3, 8, 2)], 5, 7), Ok(one));
        assert_eq!(adapter_among(&[adapter(2, 8, 1)], 5, 7), Err(TargetError::None("EtherNet/IP")));
        // The other one may be of another identity.
        for other in [7, 8] {
            let error = adapter_among(&[adapter(2, 7, 1), adapter(2, other, 2)], 5, 7).unwrap_err();
            assert_eq!(
                error.to_string(),
                "2 devices have the address 192.168.0.2: serial number 0x00000001, serial number 0x00000002; \
                 give each an address of its own"
            );
            assert!(!error.is_usage());
        }
        let error = adapter_among(&[adapter(2, 7, 1), adapter(3, 7, 2)], 5, 7).unwrap_err();
        assert!(error.is_usage() && error.to_string().ends_with("choose one with --at"), "{error}");
    }

    fn sub_device(position: u16, product: u32) -> FoundSubDevice {
        let identity = SubDeviceIdentity {
            vendor: 2,
            product,
            revision: 1,
            serial_number: u32::from(position) + 0x10,
            order_code: Vec::new(),
            name: Vec::new(),
        };
        FoundSubDevice {
            position,
            station_address: 0,
            alias: 0,
            status: 1,
            status_code: 0,
            identity: Ok(identity),
        }
    }

    #[test]
    fn the_only_sub_device_of_an_identity_is_taken_by_its_position_and_of_several_one_must_be_chosen() {
        let found = [sub_device(0, 7), sub_device(1, 8), sub_device(2, 9), sub_device(3, 9)];
        assert_eq!(position_among(&found, 2, 8), Ok(Some(2)));
        assert_eq!(position_among(&found[..1], 2, 7), Ok(None), "it is alone");
        assert_eq!(position_among(&found, 2, 6), Ok(None), "the MainDevice names the others");
        let unreadable = FoundSubDevice { identity: Err(Unreadable::Failed), ..sub_device(0, 8) };
        assert_eq!(position_among(&[unreadable, sub_device(1, 8)], 2, 8), Ok(Some(2)));
        let error = position_among(&found, 2, 9).unwrap_err();
        assert_eq!(
            error.to_string(),
            "2 devices of the file's identity answer: position 3 (serial number 0x00000012), position 4 (serial number \
             0x00000013); choose one with --at"
        );
        assert!(error.is_usage());
    }

    #[test]
    fn two_stations_of_one_name_or_one_address_are_told() {
        let found = [station(1, "valves", 2), station(2, "valves", 3)];
        for at in [None, Some("valves")] {
            let error = station_among(&found, (0x1234, 1), at).unwrap_err();
            assert!(
                matches!(&error, TargetError::Twins(2, name, macs) if name == "valves" && macs.contains(", ")),
                "{error}"
            );
        }
        let found = [station(1, "valves", 2), station(2, "drives", 2), station(3, "lamps", 3)];
        let several = station_among(&found, (0x1234, 1), None).unwrap_err();
        assert!(matches!(several, TargetError::Several(3, _)), "{several}");
        let valves = station_among(&found, (0x1234, 1), Some("valves")).unwrap();
        let error = alone_at_its_address(&found, valves).unwrap_err();
        assert!(error.to_string().starts_with("2 devices have the address 192.168.0.2: valves ("), "{error}");
        assert_eq!(alone_at_its_address(&found, &found[2]), Ok(()));
        let unset =
            [station(1, "valves", 2), station(2, "drives", 2)].map(|it| FoundStation { ip: None, ..it });
        assert_eq!(alone_at_its_address(&unset, &unset[0]), Ok(()), "no address is no shared one");
    }
}
