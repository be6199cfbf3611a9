//! Judgement of what a PROFINET robot says of itself without a connection: the modules that are plugged, and its version.

use std::net::Ipv4Addr;

use plc_node::bus::expected_device;
use plc_node::discover::{FoundDevices, read_records};
use profinet::description::{Description, Identity};
use profinet::record::{Identification, RealModule, index, parse_real_identification};
use profinet::{RecordPlace, RecordReadError};
use protocol_linux::Interface;
use setup::{Bus, BusKind};

use crate::verbs::doctor::finding::{Finding, Verdict};

const PLUGGED: &str = "plugged modules";
const VERSION: &str = "version";

/// Subslot of the head module, which every device has.
const HEAD: u16 = 1;

/// Records that are read, in this order.
const RECORDS: [RecordPlace; 2] = [
    RecordPlace { slot: 0, subslot: 0, index: index::REAL_IDENTIFICATION_API },
    RecordPlace { slot: 0, subslot: HEAD, index: index::IDENTIFICATION_AND_MAINTENANCE_0 },
];

/// Record that was read, or why not.
type ReadRecord = Result<Vec<u8>, RecordReadError>;

/// Reads RealIdentificationData and I&M0 of the robot, and judges them; nothing on another bus.
pub(super) fn findings(
    found: &FoundDevices,
    bus: &Bus,
    interface: &Interface,
    seen: &[Finding],
) -> Vec<Finding> {
    let (FoundDevices::Profinet(stations), BusKind::Profinet(addresses, profinet)) = (found, &bus.kind)
    else {
        return Vec::new();
    };
    let unseen = |reason: &str| {
        [PLUGGED, VERSION].map(|what| Finding::not_seen(what, reason, "see the steps above")).to_vec()
    };
    let name = profinet.robot_station_name.as_bytes();
    let Some(station) = stations.iter().find(|station| *station.name == *name) else {
        return unseen("no such station");
    };
    // The PLC of this look sets the robot's address before it connects.
    let was_reached = seen.iter().any(|it| it.what == "connection" && it.verdict != Verdict::NotSeen);
    let own = station.ip.map_or(Ipv4Addr::UNSPECIFIED, |ip| ip.address);
    let address = if was_reached { addresses.robot } else { own };
    if address.is_unspecified() {
        return unseen("the station has no IP address");
    }
    let identity = station.identity.unwrap_or_default();
    let identity = Identity { vendor: identity.0, device: identity.1 };
    match read_records(interface, address, identity, &RECORDS) {
        Ok(records) => {
            let mut records = records.into_iter();
            let mut next = || records.next().unwrap_or(Err(RecordReadError::NoAnswer));
            vec![plugged(&next(), &expected_device(profinet)), version(&next())]
        }
        Err(error) => unseen(&format!("{error:#}")),
    }
}

/// Compares the modules that are plugged with those of the setup, one by one.
fn plugged(record: &ReadRecord, expected: &Description) -> Finding {
    let modules = match record {
        Ok(record) => match parse_real_identification(record) {
            Some(modules) => modules,
            None => {
                let found = "the record RealIdentificationData is malformed";
                return Finding::limited(PLUGGED, found, "the step `module` decides");
            }
        },
        Err(error) => return unread(PLUGGED, error, "the step `module` decides"),
    };
    let (mut wrong, mut more) = (Vec::new(), Vec::new());
    for wanted in expected.modules {
        let slot = wanted.slot;
        match modules.iter().find(|module| (module.api, module.slot) == (0, slot)) {
            None => wrong.push(format!("slot {slot} is empty, expected module 0x{:08X}", wanted.ident)),
            Some(module) if module.ident != wanted.ident => {
                wrong.push(format!(
                    "slot {slot} has module 0x{:08X}, expected 0x{:08X}",
                    module.ident, wanted.ident
                ));
            }
            Some(module) => {
                for submodule in wanted.submodules {
                    let (subslot, ident) = (submodule.subslot, submodule.ident);
                    match module.submodules.iter().find(|(at, _)| *at == subslot) {
                        None => wrong.push(format!(
                            "slot {slot} subslot 0x{subslot:04X} is empty, expected submodule 0x{ident:08X}"
                        )),
                        Some((_, real)) if *real != ident => wrong.push(format!(
                            "slot {slot} subslot 0x{subslot:04X} has submodule 0x{real:08X}, expected 0x{ident:08X}"
                        )),
                        Some(_) => {}
                    }
                }
            }
        }
    }
    for RealModule { api, slot, ident, .. } in &modules {
        if *api != 0 || expected.module(*slot).is_none() {
            more.push(format!("slot {slot} also has module 0x{ident:08X}"));
        }
    }
    let fix = "plug the modules of the setup in the robot's project, or write the real ones into [bus.profinet.device]";
    if !wrong.is_empty() {
        wrong.extend(more);
        return Finding::missing(PLUGGED, wrong.join("; "), fix);
    }
    let listed: Vec<_> =
        modules.iter().map(|module| format!("slot {} 0x{:08X}", module.slot, module.ident)).collect();
    let listed = listed.join(", ");
    if more.is_empty() {
        Finding::good(PLUGGED, format!("as the setup expects: {listed}"))
    } else {
        Finding::limited(
            PLUGGED,
            more.join("; "),
            "nothing, if the robot accepts a connection without that module",
        )
    }
}

fn version(record: &ReadRecord) -> Finding {
    match record {
        Ok(record) => match Identification::parse(record) {
            Some(identification) => Finding::good(VERSION, identification.to_string()),
            None => Finding::limited(VERSION, "the record I&M0 is malformed", "note the firmware by hand"),
        },
        Err(error) => unread(VERSION, error, "note order number and firmware by hand"),
    }
}

fn unread(what: &'static str, error: &RecordReadError, fix: &str) -> Finding {
    Finding::limited(what, format!("the record cannot be read without a connection: {error}"), fix)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verbs::doctor::finding::Verdict::{Good, Limited, Missing};
    use machine::wire::Writer;
    use profinet::record::{emit_im0, emit_real_identification};
    use protocol::stations::PROFINET_ROBOT;

    fn real(description: &Description) -> Vec<u8> {
        let mut buf = [0; 512];
        let mut writer = Writer::new(&mut buf);
        emit_real_identification(description, |_, _| true, &mut writer);
        let len = writer.finish().unwrap();
        buf[..len].to_vec()
    }

    /// Replaces the number of what is in slot 1 or in subslot 1.
    fn replaced(record: &[u8], from: u32, to: u32) -> Vec<u8> {
        let from = [&[0, 1], &from.to_be_bytes()[..]].concat();
        let at = record.windows(6).position(|six| *six == from).unwrap();
        let mut changed = record.to_vec();
        changed[at + 2..at + 6].copy_from_slice(&to.to_be_bytes());
        changed
    }

    #[test]
    fn each_module_is_compared_with_that_of_the_setup() {
        let right = real(&PROFINET_ROBOT);
        let judged = |record: Vec<u8>| plugged(&Ok(record), &PROFINET_ROBOT);
        assert_eq!(judged(right.clone()).verdict, Good);
        let other = judged(replaced(&right, 0x100, 0x0A0B));
        assert_eq!(other.verdict, Missing);
        assert_eq!(other.found, "slot 1 has module 0x00000A0B, expected 0x00000100");
        let other = judged(replaced(&right, 0x101, 0x77));
        assert_eq!(other.found, "slot 1 subslot 0x0001 has submodule 0x00000077, expected 0x00000101");
        let only_head: &[_] = PROFINET_ROBOT.modules.first_chunk::<1>().unwrap();
        let head = Description { modules: only_head, ..PROFINET_ROBOT };
        let without = judged(real(&head));
        assert_eq!(
            (without.verdict, &*without.found),
            (Missing, "slot 1 is empty, expected module 0x00000100")
        );
        // A module in a slot that the setup leaves empty.
        let more = plugged(&Ok(right.clone()), &head);
        assert_eq!((more.verdict, &*more.found), (Limited, "slot 1 also has module 0x00000100"));
        for cut in 0..right.len() {
            assert_eq!(judged(right[..cut].to_vec()).verdict, Limited, "{cut}");
        }
        assert_eq!(plugged(&Err(RecordReadError::Rejected), &PROFINET_ROBOT).verdict, Limited);
    }

    #[test]
    fn the_version_is_shown_as_the_robot_says_it() {
        let mut buf = [0; 128];
        let mut writer = Writer::new(&mut buf);
        emit_im0(&PROFINET_ROBOT, 0, &mut writer);
        let len = writer.finish().unwrap();
        let found = version(&Ok(buf[..len].to_vec()));
        assert_eq!(found.verdict, Good);
        assert!(found.found.contains(PROFINET_ROBOT.order_id), "{found:?}");
        assert_eq!(version(&Ok(buf[..len - 20].to_vec())).verdict, Limited);
        assert_eq!(version(&Err(RecordReadError::NoAnswer)).verdict, Limited);
    }
}
