//! Version of an EtherNet/IP robot and of its parts, read from its Identity object without a connection.

use std::net::SocketAddrV4;

use ethernet_ip::ENCAPSULATION_PORT;
use ethernet_ip::cip::{ElectronicKey, Revision, class};
use plc_node::bus::expected_key;
use plc_node::dialogue::{AttributeAnswer, Dialogue};
use setup::{Bus, BusKind};

use super::unreachable::unreachable;
use crate::verbs::doctor::finding::Finding;

const VERSION: &str = "version";
const PARTS: &str = "parts";

/// Attributes of the Identity object (volume 1, table 5-2.2); of its class, the largest instance.
const LARGEST_INSTANCE: u32 = 2;
const REVISION: u32 = 4;
const SERIAL_NUMBER: u32 = 6;
const PRODUCT_NAME: u32 = 7;

/// Parts of a device that are asked for.
const MOST_PARTS: u32 = 32;

/// Instance of the Identity object: the device, or a part of it. What it does not say is `None`.
#[derive(Clone, PartialEq, Eq, Default, Debug)]
struct DevicePart {
    instance: u32,
    revision: Option<Revision>,
    serial_number: Option<u32>,
    name: Option<Vec<u8>>,
}

impl DevicePart {
    fn read(dialogue: &mut Dialogue, instance: u32) -> std::io::Result<Option<Self>> {
        let mut ask = |attribute| dialogue.attribute(class::IDENTITY, instance, attribute);
        let revision = ask(REVISION)?;
        if revision == AttributeAnswer::NoObject {
            return Ok(None);
        }
        Ok(Some(Self::of(instance, [revision, ask(SERIAL_NUMBER)?, ask(PRODUCT_NAME)?])))
    }

    fn of(instance: u32, [revision, serial_number, name]: [AttributeAnswer; 3]) -> Self {
        let bytes = |answer| match answer {
            AttributeAnswer::Bytes(bytes) => Some(bytes),
            AttributeAnswer::NoObject | AttributeAnswer::Refused(_) => None,
        };
        let revision = bytes(revision).and_then(|bytes| <[u8; 2]>::try_from(bytes).ok());
        let serial_number = bytes(serial_number).and_then(|bytes| <[u8; 4]>::try_from(bytes).ok());
        // A SHORT_STRING: its length, then its letters.
        let name = bytes(name).and_then(|bytes| {
            let (length, letters) = bytes.split_first()?;
            letters.get(..usize::from(*length)).map(<[u8]>::to_vec)
        });
        Self {
            instance,
            revision: revision.map(|[major, minor]| Revision { major, minor }),
            serial_number: serial_number.map(u32::from_le_bytes),
            name,
        }
    }

    fn shown(&self) -> String {
        let name = self
            .name
            .as_ref()
            .map_or_else(|| "no product name".to_owned(), |name| format!("`{}`", name.escape_ascii()));
        let revision = self.revision.map_or_else(
            || "no revision".to_owned(),
            |Revision { major, minor }| format!("revision {major}.{minor}"),
        );
        let serial = self
            .serial_number
            .map_or_else(|| "no serial number".to_owned(), |number| format!("serial number 0x{number:08X}"));
        format!("{name}, {revision}, {serial}")
    }
}

/// What a setup expects of the device.
#[derive(Clone, Copy, Debug)]
struct WantedVersion<'a> {
    /// The key that the PLC sends, if it does not take any device.
    key: Option<ElectronicKey>,
    /// The name in its device file, if the setup names one.
    product_name: Option<&'a str>,
}

/// Reads the Identity object of the robot and judges it; nothing on another bus.
pub(super) fn findings(bus: &Bus, seen: &[Finding]) -> Vec<Finding> {
    let BusKind::EthernetIp(addresses, ethernet_ip) = &bus.kind else { return Vec::new() };
    if let Some(reason) = unreachable(ethernet_ip, seen) {
        return [VERSION, PARTS].map(|what| reason.finding(what)).to_vec();
    }
    let wanted = WantedVersion { key: expected_key(ethernet_ip), product_name: bus.product_name() };
    match read(SocketAddrV4::new(addresses.robot, ENCAPSULATION_PORT)) {
        Ok(parts) => judged(&wanted, &parts).to_vec(),
        Err(error) => [VERSION, PARTS]
            .map(|what| {
                let found = format!("cannot read the Identity object of {}: {error}", addresses.robot);
                Finding::limited(what, found, "note product and firmware by hand")
            })
            .to_vec(),
    }
}

/// Reads the device, then its parts, over a session of its own.
fn read(robot: SocketAddrV4) -> std::io::Result<Vec<DevicePart>> {
    let mut dialogue = Dialogue::open(robot)?;
    let largest = match dialogue.attribute(class::IDENTITY, 0, LARGEST_INSTANCE)? {
        AttributeAnswer::Bytes(bytes) => <[u8; 2]>::try_from(bytes).map_or(1, u16::from_le_bytes),
        AttributeAnswer::NoObject | AttributeAnswer::Refused(_) => 1,
    };
    let mut parts = Vec::new();
    for instance in 1..=u32::from(largest).clamp(1, MOST_PARTS) {
        parts.extend(DevicePart::read(&mut dialogue, instance)?);
    }
    Ok(parts)
}

/// Compares the device with the setup, and lists its parts.
fn judged(wanted: &WantedVersion<'_>, parts: &[DevicePart]) -> [Finding; 2] {
    let others: Vec<_> = parts.iter().filter(|part| part.instance != 1).collect();
    let listed = others.iter().map(|part| format!("{}: {}", part.instance, part.shown()));
    let of_parts = if others.is_empty() {
        Finding::good(PARTS, "none: its Identity object has one instance")
    } else {
        Finding::good(PARTS, listed.collect::<Vec<_>>().join("; "))
    };
    let Some(device) = parts.iter().find(|part| part.instance == 1) else {
        let fix = "note product and firmware by hand";
        return [Finding::limited(VERSION, "the device has no Identity object", fix), of_parts];
    };
    [version(wanted, device), of_parts]
}

fn version(wanted: &WantedVersion<'_>, device: &DevicePart) -> Finding {
    let shown = device.shown();
    let Some(revision) = device.revision else {
        return Finding::limited(VERSION, shown, "note the firmware by hand");
    };
    // Only the revision is judged here: the rest of the device is as the key wants it.
    if let Some(key) = wanted.key
        && key.check(&ElectronicKey { revision, ..key }).is_err()
    {
        let fix = "install that firmware, or take the device file of this revision and write it into [bus.ethernet_ip.adapter.key]";
        let newer = if key.compatible { " or a newer minor one" } else { "" };
        let Revision { major, minor } = key.revision;
        let found = format!("{shown}; the setup expects revision {major}.{minor}{newer}");
        return Finding::missing(VERSION, found, fix);
    }
    match wanted.product_name {
        Some(name) if device.name.as_deref().is_some_and(|found| found != name.as_bytes()) => {
            let found = format!("{shown}; its device file names it `{}`", name.escape_debug());
            Finding::limited(VERSION, found, "see that the device file is that of this product")
        }
        _ => Finding::good(VERSION, shown),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::verbs::doctor::finding::Verdict::{Good, Limited, Missing};

    fn bytes(bytes: &[u8]) -> AttributeAnswer {
        AttributeAnswer::Bytes(bytes.to_vec())
    }

    fn arm(instance: u32, revision: [u8; 2]) -> DevicePart {
        DevicePart::of(instance, [bytes(&revision), bytes(&[0x2A, 0, 0, 0xC0]), bytes(b"\x03arm")])
    }

    fn wanted(major: u8, minor: u8, compatible: bool) -> WantedVersion<'static> {
        let revision = Revision { major, minor };
        let key = ElectronicKey { vendor: 1, device_type: 2, product_code: 3, revision, compatible };
        WantedVersion { key: Some(key), product_name: Some("arm") }
    }

    #[test]
    fn the_revision_is_judged_as_the_key_of_the_setup_is_and_the_name_by_the_device_file() {
        let device = arm(1, [3, 4]);
        let verdict = |wanted: WantedVersion<'_>| version(&wanted, &device).verdict;
        for (major, minor, exactly, at_least) in [
            (3, 4, Good, Good),
            (3, 2, Missing, Good),
            (3, 5, Missing, Missing),
            (2, 4, Missing, Missing),
            (3, 0, Good, Good),
            (0, 0, Good, Good),
        ] {
            let found = [false, true].map(|compatible| verdict(wanted(major, minor, compatible)));
            assert_eq!(found, [exactly, at_least], "{major}.{minor}");
        }
        let other = version(&wanted(3, 5, false), &device);
        assert_eq!(
            other.found,
            "`arm`, revision 3.4, serial number 0xC000002A; the setup expects revision 3.5"
        );
        assert_eq!(verdict(WantedVersion { product_name: Some("leg"), ..wanted(3, 4, false) }), Limited);
        assert_eq!(verdict(WantedVersion { product_name: None, ..wanted(3, 4, false) }), Good);
    }

    #[test]
    fn parts_are_listed_and_what_an_instance_does_not_say_is_no_panic() {
        let [_, none] = judged(&wanted(1, 1, false), &[arm(1, [1, 1])]);
        assert_eq!((none.verdict, &*none.found), (Good, "none: its Identity object has one instance"));
        let [_, some] = judged(&wanted(1, 1, false), &[arm(1, [1, 1]), arm(3, [9, 2])]);
        assert_eq!(some.found, "3: `arm`, revision 9.2, serial number 0xC000002A");
        let [version, _] = judged(&wanted(1, 1, false), &[]);
        assert_eq!(version.verdict, Limited);
        let odd = [
            [bytes(&[1]), bytes(&[1, 2, 3]), bytes(&[9, b'a'])],
            [bytes(&[]), bytes(&[]), bytes(&[])],
            [AttributeAnswer::Refused(0x14), AttributeAnswer::NoObject, AttributeAnswer::Refused(8)],
        ];
        for answers in odd {
            let part = DevicePart::of(1, answers);
            assert_eq!(part, DevicePart { instance: 1, ..DevicePart::default() });
            assert_eq!(super::version(&wanted(1, 1, false), &part).verdict, Limited);
        }
        let hostile = DevicePart::of(2, [bytes(&[1, 1]), bytes(&[0; 4]), bytes(b"\x02\x1b[")]);
        assert!(hostile.shown().starts_with("`\\x1b[`"), "{}", hostile.shown());
    }
}
