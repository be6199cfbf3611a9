//! Judgement of a search on the bus: the name of the foreign end, its address, its identity, and others that have them too.

use std::net::Ipv4Addr;

use ethercat_maindevice::{Found, Unreadable};
use ethernet_ip::FoundDevice;
use ethernet_ip::cip::{ElectronicKey, Revision};
use plc_node::discover::FoundDevices;
use profinet::FoundStation;
use protocol::stations::{ETHERCAT_ROBOT, ETHERNET_IP_ROBOT, PROFINET_ROBOT};
use setup::{Bus, BusKind, EthernetIp, Profinet};

use crate::verbs::doctor::finding::Finding;

const NAME: &str = "name";
const ADDRESS: &str = "address";
const IDENTITY: &str = "identity";
const CONTROLLER: &str = "controller";

/// Bit of an IO-Controller in the roles that a station reports by DCP.
const IO_CONTROLLER: u8 = 2;

/// Remedy where a bus is silent.
const SILENT: &str = "look at cable, power and switches; `plc-node discover` lists what answers";

/// Returns the findings on the robot of a setup among these devices. `position` is its place on an EtherCAT cable.
pub(super) fn robot(found: &FoundDevices, bus: &Bus, position: usize) -> Vec<Finding> {
    match (found, &bus.kind) {
        (FoundDevices::Profinet(stations), BusKind::Profinet(addresses, profinet)) => {
            io_device(stations, profinet, addresses.robot)
        }
        (FoundDevices::EthernetIp(devices), BusKind::EthernetIp(addresses, ethernet_ip)) => {
            let serial = bus.robot.and_then(|robot| robot.serial_number);
            adapter(devices, ethernet_ip, addresses.robot, serial)
        }
        (FoundDevices::Ethercat(found), BusKind::Ethercat(ethercat)) => {
            let device = ethercat.device.as_ref();
            let expected = device.map_or(
                (ETHERCAT_ROBOT.vendor_id, ETHERCAT_ROBOT.product_code, Some(ETHERCAT_ROBOT.revision)),
                |device| (device.vendor, device.product, device.revision),
            );
            vec![sub_device(found, position, expected)]
        }
        _ => Vec::new(),
    }
}

/// Returns the finding on the PLC among the stations that answered; `None` on a bus whose PLC answers no search.
pub(super) fn plc(found: &FoundDevices, bus: &Bus) -> Option<Finding> {
    let (FoundDevices::Profinet(stations), BusKind::Profinet(_, profinet)) = (found, &bus.kind) else {
        return None;
    };
    let controllers: Vec<_> =
        stations.iter().filter(|station| station.roles & IO_CONTROLLER != 0).map(shown).collect();
    let is_named = stations.iter().any(|station| *station.name == *profinet.plc_station_name.as_bytes());
    let listed = controllers.join(", ");
    Some(match (controllers.as_slice(), is_named) {
        ([], _) => {
            let found = format!("no IO-Controller answers DCP; {} other stations do", stations.len());
            Finding::limited(CONTROLLER, found, "some PLCs do not answer: the next steps decide")
        }
        ([_], _) | (_, true) => Finding::good(CONTROLLER, listed),
        (_, false) => {
            let fix = "name the right one in bus.allowed_plcs of the setup, so that no other takes the robot";
            Finding::limited(CONTROLLER, format!("several: {listed}"), fix)
        }
    })
}

fn shown(station: &FoundStation) -> String {
    let address = station.ip.map_or(Ipv4Addr::UNSPECIFIED, |ip| ip.address);
    let name = station.name.escape_ascii();
    if address.is_unspecified() {
        format!("`{name}` ({}, no address)", station.mac)
    } else {
        format!("`{name}` ({}, {address})", station.mac)
    }
}

fn io_device(stations: &[FoundStation], profinet: &Profinet, address: Ipv4Addr) -> Vec<Finding> {
    let name = &profinet.robot_station_name;
    let named: Vec<_> = stations.iter().filter(|station| *station.name == *name.as_bytes()).collect();
    let station = match named.as_slice() {
        [] => {
            let found = if stations.is_empty() {
                Finding::not_seen(NAME, "no station answers DCP", SILENT)
            } else {
                let others: Vec<_> = stations.iter().map(shown).collect();
                let fix = format!(
                    "give the robot's interface the name `{name}` by its own tool or by DCP, or set bus.profinet.robot_station_name"
                );
                Finding::missing(NAME, format!("nobody is `{name}`; there are {}", others.join(", ")), fix)
            };
            let [address, identity] = [ADDRESS, IDENTITY]
                .map(|what| Finding::not_seen(what, "no such station", "see the step `name`"));
            return vec![found, address, identity];
        }
        [station] => station,
        [station, ..] => {
            let macs: Vec<_> = named.iter().map(|station| station.mac.to_string()).collect();
            let fix = "rename all but one of them; with bus.robot.mac the PLC takes that one";
            let twins =
                Finding::missing(NAME, format!("`{name}` is the name of {}", macs.join(" and ")), fix);
            return vec![twins, address_of(station, stations, address), identity_of(station, profinet)];
        }
    };
    let of_name = Finding::good(NAME, shown(station));
    vec![of_name, address_of(station, stations, address), identity_of(station, profinet)]
}

fn address_of(station: &FoundStation, stations: &[FoundStation], wanted: Ipv4Addr) -> Finding {
    let has = |station: &FoundStation| station.ip.map_or(Ipv4Addr::UNSPECIFIED, |ip| ip.address);
    let other = stations.iter().find(|other| other.mac != station.mac && has(other) == wanted);
    match (other, has(station)) {
        (Some(other), _) => {
            let fix = "give that station another address, or choose another bus.robot_address";
            Finding::missing(ADDRESS, format!("{wanted}: {} has it already", shown(other)), fix)
        }
        (None, found) if found.is_unspecified() => {
            Finding::good(ADDRESS, format!("none yet: the PLC sets {wanted} by DCP"))
        }
        (None, found) if found == wanted => Finding::good(ADDRESS, wanted.to_string()),
        (None, found) => Finding::good(ADDRESS, format!("{found}: the PLC sets {wanted} by DCP")),
    }
}

fn identity_of(station: &FoundStation, profinet: &Profinet) -> Finding {
    let own = (PROFINET_ROBOT.identity.vendor, PROFINET_ROBOT.identity.device);
    let wanted = profinet.device.as_ref().map_or(own, |device| (device.vendor, device.device));
    let text = |(vendor, device): (u16, u16)| format!("VendorID 0x{vendor:04X}, DeviceID 0x{device:04X}");
    let kind = station.type_of_station.escape_ascii();
    match station.identity {
        Some(found) if found == wanted => Finding::good(IDENTITY, format!("{}, `{kind}`", text(found))),
        Some(found) => {
            let fix = "write the real identity and modules into [bus.profinet.device], or connect the robot of the setup";
            Finding::missing(IDENTITY, format!("{}, `{kind}`; expected {}", text(found), text(wanted)), fix)
        }
        None => Finding::limited(IDENTITY, "the station does not report it", "the Connect decides"),
    }
}

fn adapter(
    devices: &[FoundDevice],
    ethernet_ip: &EthernetIp,
    address: Ipv4Addr,
    serial: Option<u32>,
) -> Vec<Finding> {
    let text = |device: &FoundDevice| {
        let name = device.product_name.escape_ascii();
        format!("`{name}` at {} ({})", device.address, device.identity)
    };
    let at: Vec<_> = devices.iter().filter(|device| device.address == address).collect();
    let (of_address, device) = match at.as_slice() {
        [] if devices.is_empty() => {
            let found = Finding::not_seen(ADDRESS, "no device answers ListIdentity", SILENT);
            return vec![found, Finding::not_seen(IDENTITY, "no such device", "see the step `address`")];
        }
        [] => {
            let others: Vec<_> = devices.iter().map(text).collect();
            let found = format!("nobody answers from {address}; there are {}", others.join(", "));
            let fix = "set the robot's address by its own tool, or correct bus.robot_address";
            return vec![
                Finding::missing(ADDRESS, found, fix),
                Finding::not_seen(IDENTITY, "no such device", "see the step `address`"),
            ];
        }
        [device] => (Finding::good(ADDRESS, format!("{address} answers")), device),
        [device, ..] => {
            let both: Vec<_> = at.iter().map(|device| text(device)).collect();
            let fix = "switch all but one of them off, or give them other addresses";
            (Finding::missing(ADDRESS, format!("two devices have it: {}", both.join(", ")), fix), device)
        }
    };
    let wanted = match &ethernet_ip.adapter {
        None => Some(ETHERNET_IP_ROBOT.key()),
        Some(adapter) => adapter.key.map(|key| ElectronicKey {
            vendor: key.vendor,
            device_type: key.device_type,
            product_code: key.product_code,
            revision: Revision { major: key.major_revision, minor: key.minor_revision },
            compatible: key.compatible,
        }),
    };
    let fits = wanted.is_none_or(|wanted| wanted.check(&device.identity.key).is_ok());
    let is_serial = serial.is_none_or(|serial| serial == device.identity.serial_number);
    let of_identity = if fits && is_serial {
        Finding::good(IDENTITY, text(device))
    } else {
        let fix = "write the key of the real device into [bus.ethernet_ip.adapter], or connect the robot of the setup";
        let wanted = match (is_serial, serial, wanted) {
            (false, Some(serial), _) => format!("serial number 0x{serial:08X}"),
            (_, _, Some(key)) => format!(
                "vendor {}, device type {}, product code {}, revision {}.{}",
                key.vendor, key.device_type, key.product_code, key.revision.major, key.revision.minor
            ),
            _ => String::from("any"),
        };
        Finding::missing(IDENTITY, format!("{}; expected {wanted}", text(device)), fix)
    };
    vec![of_address, of_identity]
}

fn sub_device(found: &Found, position: usize, expected: (u32, u32, Option<u32>)) -> Finding {
    if !found.frames_return {
        return Finding::not_seen(IDENTITY, "no frame comes back", SILENT);
    }
    let Some(device) = found.devices.get(position) else {
        let found = format!("{} SubDevices on the cable, none at position {position}", found.devices.len());
        return Finding::missing(
            IDENTITY,
            found,
            "look at the line of cables, and at the power of each device",
        );
    };
    let mut state = String::new();
    // A string takes every character.
    let _ = device.write_state(&mut state);
    let (vendor, product, revision) = expected;
    match &device.identity {
        Ok(identity) => {
            let found = format!(
                "`{}` at position {position}: vendor 0x{:08X}, product 0x{:08X}, revision 0x{:08X}, in {state}",
                identity.name.escape_ascii(),
                identity.vendor,
                identity.product,
                identity.revision
            );
            let is_expected = (identity.vendor, identity.product) == (vendor, product)
                && revision.is_none_or(|revision| revision == identity.revision);
            if is_expected {
                Finding::good(IDENTITY, found)
            } else {
                let wanted = format!("vendor 0x{vendor:08X}, product 0x{product:08X}");
                let wanted = revision.map_or(wanted.clone(), |it| format!("{wanted}, revision 0x{it:08X}"));
                let fix =
                    "write the real device into [bus.ethercat.device], or connect the robot of the setup";
                Finding::missing(IDENTITY, format!("{found}; expected {wanted}"), fix)
            }
        }
        Err(reason) => {
            let reason = match reason {
                Unreadable::HeldByDevice => "the device itself holds its EEPROM",
                Unreadable::Failed => "its EEPROM cannot be read",
                Unreadable::NoAnswer => "it stopped answering",
            };
            Finding::limited(
                IDENTITY,
                format!("position {position}, in {state}: {reason}"),
                "bringing it up decides",
            )
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verbs::doctor::finding::Verdict::{Good, Missing, NotSeen};
    use ethernet_ip::description::Identity;
    use machine::ethernet::Mac;
    use profinet::dcp::IpSuite;

    fn station(last: u8, name: &str, address: [u8; 4], device: u16) -> FoundStation {
        let ip = IpSuite { address: address.into(), mask: [255; 4].into(), gateway: address.into() };
        FoundStation {
            mac: Mac([2, 0, 0, 0, 0, last]),
            name: name.as_bytes().into(),
            type_of_station: (*b"robot").into(),
            identity: Some((0xFFFF, device)),
            ip: Some(ip),
            roles: 1,
        }
    }

    fn verdicts(findings: &[Finding]) -> Vec<crate::verbs::doctor::finding::Verdict> {
        findings.iter().map(|finding| finding.verdict).collect()
    }

    #[test]
    fn a_station_is_judged_by_name_address_and_identity_and_twins_are_named() {
        let bus = setup::setup("A").unwrap().bus;
        let [none, robot_address] = [[0; 4], [192, 168, 64, 2]];
        let judged = |stations: Vec<FoundStation>| robot(&FoundDevices::Profinet(stations), &bus, 0);
        let right = station(1, "skillbench-robot", none, 1);
        assert_eq!(verdicts(&judged(vec![right.clone()])), [Good; 3]);
        assert_eq!(verdicts(&judged(vec![])), [NotSeen; 3]);
        let misnamed = judged(vec![station(1, "robot-7", none, 1)]);
        assert_eq!(verdicts(&misnamed), [Missing, NotSeen, NotSeen]);
        assert!(misnamed[0].found.contains("`robot-7` (02:00:00:00:00:01, no address)"), "{misnamed:?}");
        let twin = judged(vec![right.clone(), station(2, "skillbench-robot", none, 1)]);
        assert_eq!(twin[0].verdict, Missing);
        assert!(twin[0].found.ends_with("02:00:00:00:00:01 and 02:00:00:00:00:02"), "{twin:?}");
        let taken = judged(vec![right, station(3, "camera", robot_address, 9)]);
        assert_eq!(verdicts(&taken), [Good, Missing, Good]);
        assert!(taken[1].found.contains("`camera`"), "{taken:?}");
        assert_eq!(verdicts(&judged(vec![station(1, "skillbench-robot", robot_address, 7)]))[2], Missing);
    }

    #[test]
    fn an_adapter_is_judged_by_its_address_and_its_key() {
        let bus = setup::setup("B").unwrap().bus;
        let address = bus.addresses().unwrap().robot;
        let device = |address: Ipv4Addr, product_code| FoundDevice {
            address,
            listens_at: std::net::SocketAddrV4::new(address, 44_818),
            identity: Identity {
                key: ElectronicKey { product_code, ..ETHERNET_IP_ROBOT.key() },
                serial_number: 5,
            },
            status: 0,
            product_name: (*b"arm").into(),
            state: 3,
        };
        let judged = |devices: Vec<FoundDevice>| robot(&FoundDevices::EthernetIp(devices), &bus, 0);
        assert_eq!(verdicts(&judged(vec![device(address, 1)])), [Good, Good]);
        assert_eq!(verdicts(&judged(vec![device(address, 9)])), [Good, Missing]);
        assert_eq!(verdicts(&judged(vec![])), [NotSeen, NotSeen]);
        let elsewhere = judged(vec![device(Ipv4Addr::new(10, 1, 2, 3), 1)]);
        assert_eq!(verdicts(&elsewhere), [Missing, NotSeen]);
        assert!(elsewhere[0].found.contains("`arm` at 10.1.2.3"), "{elsewhere:?}");
        assert_eq!(verdicts(&judged(vec![device(address, 1), device(address, 2)]))[0], Missing);
    }
}
