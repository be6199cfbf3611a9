use proptest::prelude::*;

use super::*;
use crate::samples;
use machine::Instant;
use machine::ethernet::EthernetHeader;

const MAC: Mac = Mac([2, 0, 0, 0, 0, 2]);
const OTHER: Mac = Mac([2, 0, 0, 0, 0, 3]);

/// An LLDPDU with the names of before version 2.3, byte by byte from IEEE 802.1AB and IEC 61158-6-10.
const CPU: &[u8] = &[
    0x02, 0x07, 7, b'p', b'l', b'c', b'-', b'1', b'a', // ChassisID
    0x04, 0x09, 7, b'p', b'o', b'r', b't', b'-', b'0', b'0', b'1', // PortID
    0x06, 0x02, 0, 20, // TimeToLive
    0x10, 0x0C, 5, 1, 192, 168, 0, 1, 1, 0, 0, 0, 0, 0, // ManagementAddress
    0xFE, 0x08, 0x00, 0x0E, 0xCF, 2, 0, 0, 0, 0, // port status
    0xFE, 0x0A, 0x00, 0x0E, 0xCF, 5, 0, 0x1B, 0x1B, 1, 2, 3, // MAC address of the interface
    0xFE, 0x09, 0x00, 0x12, 0x0F, 1, 3, 0x6C, 0x01, 0, 0x10, // 100BASE-TX, full duplex
    0x00, 0x00, // End
];

fn id(value: &[u8]) -> Id<'_> {
    Id { subtype: LOCALLY_ASSIGNED, value }
}

fn emitted(pdu: &Pdu<'_>) -> Vec<u8> {
    let mut buf = [0; 1500];
    let mut writer = Writer::<BigEndian>::new(&mut buf);
    pdu.emit(&mut writer);
    let len = writer.finish().unwrap();
    buf[..len].to_vec()
}

/// Gives the agent an LLDPDU of a station.
fn hear(agent: &mut Agent, now: Instant, source: Mac, payload: &[u8]) -> Result<(), Refusal> {
    let header = EthernetHeader { destination: MULTICAST, source, tag: None, ether_type: ETHER_TYPE };
    agent.handle_frame(now, &header, payload)
}

fn names(agent: &Agent) -> Option<(&str, &str, Mac)> {
    let text = |name| core::str::from_utf8(name).unwrap();
    let neighbour = agent.neighbour()?;
    Some((text(neighbour.port_name()), text(neighbour.station_name()), neighbour.mac()))
}

#[test]
fn every_tlv_has_its_place() {
    let pdu = Pdu::parse(CPU).unwrap();
    let expected = Pdu {
        management_address: Some(Ipv4Addr::new(192, 168, 0, 1)),
        port_status: Some([0; 2]),
        chassis_mac: Some(Mac([0, 0x1B, 0x1B, 1, 2, 3])),
        mac_phy: Some(MacPhy { autonegotiation: 3, advertised: 0x6C01, mau_type: 0x10 }),
        ..Pdu::new(id(b"plc-1a"), id(b"port-001"), 20)
    };
    assert_eq!(pdu, expected);
    assert_eq!(emitted(&pdu), CPU);
}

#[test]
fn a_system_has_a_name_and_a_description() {
    let pdu = Pdu {
        system_name: Some(b"plc"),
        system_description: Some(b"a controller"),
        ..Pdu::new(id(b"plc-1a"), id(b"port-001"), 20)
    };
    let bytes = emitted(&pdu);
    assert_eq!(bytes[24..29], [0x0A, 3, b'p', b'l', b'c']);
    assert_eq!(bytes[29..31], [0x0C, 12]);
    assert_eq!(Pdu::parse(&bytes), Ok(pdu));
}

#[test]
fn a_management_address_that_is_not_one_of_ipv4_is_none() {
    // The numbers of address families: 1 IPv4, 2 IPv6, 6 IEEE 802.
    for (address, expected) in [
        (&[1, 192, 168, 0, 1][..], Some(Ipv4Addr::new(192, 168, 0, 1))),
        (&[1, 192, 168, 0, 1, 0], None),
        (&[1, 192, 168, 0], None),
        (&[6, 192, 168, 0, 1], None),
        (&[2, 0xFE, 0x80, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1], None),
    ] {
        let len = address.len() as u8;
        let tlv = [&[0x10, len + 7, len], address, &[1, 0, 0, 0, 0, 0]].concat();
        let payload = [&CPU[..24], &tlv].concat();
        let found = Pdu::parse(&payload).map(|pdu| pdu.management_address);
        assert_eq!(found, Ok(expected), "{address:?}");
    }
}

#[test]
fn the_first_three_tlvs_have_their_order_and_come_once() {
    let [chassis, port, ttl] = [&CPU[..9], &CPU[9..20], &CPU[20..24]];
    let end = &[0, 0][..];
    let order = |found, wanted| Err(Violation::Order { found, wanted });
    let parse = |parts: &[&[u8]]| Pdu::parse(&parts.concat()).map(|pdu| pdu.ttl);
    assert_eq!(parse(&[chassis, port, ttl, end]), Ok(20));
    assert_eq!(parse(&[chassis, port, ttl]), Ok(20), "the end of the frame is an end");
    assert_eq!(parse(&[port, chassis, ttl, end]), order(PORT_ID, CHASSIS_ID));
    assert_eq!(parse(&[chassis, ttl, port, end]), order(TTL, PORT_ID));
    assert_eq!(parse(&[chassis, port, end]), order(END, TTL));
    assert_eq!(parse(&[chassis, port, ttl, port, end]), Err(Violation::Repeated(PORT_ID)));
    assert_eq!(parse(&[chassis, port, ttl, ttl, end]), Err(Violation::Repeated(TTL)));
    assert_eq!(parse(&[chassis, port, ttl, end, chassis]), Ok(20), "what is behind End is no matter");
}

#[test]
fn a_value_that_is_too_short_or_too_long_for_its_type_is_refused() {
    let (chassis, head) = (&CPU[..9], &CPU[..24]);
    let long = [&[0x02, 0xFF, 7][..], &[b'a'; 254], &CPU[9..24]].concat();
    assert!(Pdu::parse(&long).is_ok(), "254 bytes");
    let cases: [&[&[u8]]; 9] = [
        &[&[0x02, 0x00], &CPU[9..24]],
        &[&[0x02, 0x01, 7], &CPU[9..24]],
        // A MAC address of five bytes.
        &[&[0x02, 0x06, 4, 1, 2, 3, 4, 5], &CPU[9..24]],
        &[&[0x03, 0x01, 7], &[b'a'; 256], &CPU[9..24]],
        &[chassis, &[0x04, 0x04, 3, 1, 2, 3], &CPU[20..24]],
        &[chassis, &CPU[9..20], &[0x06, 0x01, 20]],
        &[head, &[0x10, 0x03, 5, 1, 192]],
        &[head, &[0xFE, 0x06, 0x00, 0x0E, 0xCF, 5, 1, 2]],
        &[head, &[0x00, 0x01, 0]],
    ];
    for parts in cases {
        let payload = parts.concat();
        let found = Pdu::parse(&payload);
        assert!(matches!(found, Err(Violation::Length { .. })), "{parts:?}: {found:?}");
    }
    assert!(matches!(Pdu::parse(&CPU[..CPU.len() - 3]), Err(Violation::Truncated(_))));
}

#[test]
fn the_neighbour_has_the_names_of_both_ways_to_name_it() {
    let mut agent = Agent::new(Instant::ZERO);
    let cpu = Mac([0, 0x1B, 0x1B, 1, 2, 3]);
    hear(&mut agent, Instant::ZERO, MAC, CPU).unwrap();
    assert_eq!(names(&agent), Some(("port-001", "plc-1a", cpu)));
    assert_eq!(agent.neighbour().unwrap().alias(), b"port-001.plc-1a");
    let device = Pdu::new(id(b"a device of some kind"), id(b"port-002.cell.plc"), 20);
    hear(&mut agent, Instant::ZERO, MAC, &emitted(&device)).unwrap();
    assert_eq!(names(&agent), Some(("port-002", "cell.plc", MAC)));
    let chassis = Id { subtype: CHASSIS_IS_MAC, value: &OTHER.0 };
    hear(&mut agent, Instant::ZERO, MAC, &emitted(&Pdu::new(chassis, id(b"port-003"), 20))).unwrap();
    assert_eq!(names(&agent), Some(("port-003", "02-00-00-00-00-03", MAC)));
    let port = Id { subtype: PORT_IS_MAC, value: &MAC.0 };
    hear(&mut agent, Instant::ZERO, MAC, &emitted(&Pdu::new(chassis, port, 20))).unwrap();
    assert_eq!(names(&agent), Some(("02-00-00-00-00-02", "02-00-00-00-00-03", MAC)));
}

#[test]
fn the_neighbour_goes_after_its_time_or_when_it_says_so_and_only_then_is_there_another() {
    let mut agent = Agent::new(Instant::ZERO);
    let at = |ms| Instant::from_millis(ms);
    let of = |name, ttl| emitted(&Pdu::new(id(name), id(b"port-001"), ttl));
    hear(&mut agent, at(1_000), MAC, &of(b"a", 20)).unwrap();
    for ttl in [20, 0] {
        hear(&mut agent, at(2_000), OTHER, &of(b"b", ttl)).unwrap();
        assert_eq!(names(&agent), Some(("port-001", "a", MAC)), "another one beside it");
    }
    hear(&mut agent, at(3_000), MAC, &of(b"renamed", 20)).unwrap();
    assert_eq!(names(&agent), Some(("port-001", "renamed", MAC)));
    agent.handle_timeout(at(22_999));
    assert!(agent.neighbour().is_some());
    agent.handle_timeout(at(23_000));
    assert_eq!(names(&agent), None);
    hear(&mut agent, at(23_001), OTHER, &of(b"b", 20)).unwrap();
    assert_eq!(names(&agent), Some(("port-001", "b", OTHER)));
    hear(&mut agent, at(23_002), OTHER, &of(b"b", 0)).unwrap();
    assert_eq!(names(&agent), None, "it said that it goes");
}

#[test]
fn only_frames_to_the_nearest_station_from_one_station_count() {
    let mut agent = Agent::new(Instant::ZERO);
    let header = EthernetHeader { destination: MULTICAST, source: MAC, tag: None, ether_type: ETHER_TYPE };
    for header in [
        EthernetHeader { destination: Mac([0x01, 0x80, 0xC2, 0, 0, 0]), ..header },
        EthernetHeader { source: MULTICAST, ..header },
    ] {
        assert_eq!(agent.handle_frame(Instant::ZERO, &header, CPU), Err(Refusal::Foreign));
    }
    assert_eq!(names(&agent), None);
}

#[test]
fn an_announcement_follows_every_five_seconds_and_at_once_when_something_changed() {
    let local = Local {
        mac: MAC,
        name: b"device",
        address: Ipv4Addr::UNSPECIFIED,
        description: &samples::DEVICE,
        naming: Naming::Station,
    };
    let mut agent = Agent::new(Instant::from_millis(500));
    let mut buf = [0; 1500];
    let mut sends =
        |agent: &mut Agent, ms| agent.poll_transmit(Instant::from_millis(ms), &local, &mut buf).is_some();
    let sent: Vec<_> = (0..200).map(|step| step * 100).filter(|ms| sends(&mut agent, *ms)).collect();
    assert_eq!(sent, [500, 5_500, 10_500, 15_500]);
    agent.announce(Instant::from_millis(20_000));
    assert_eq!(agent.poll_timeout(), Instant::from_millis(20_000));
    assert!(sends(&mut agent, 20_000) && !sends(&mut agent, 24_900) && sends(&mut agent, 25_000));
}

#[test]
fn the_longest_name_is_announced_whole() {
    let name = [b'a'; crate::dcp::MAX_NAME_LEN];
    let mut buf = [0; 1500];
    for naming in [Naming::Station, Naming::Device] {
        let description = &samples::DEVICE;
        let address = Ipv4Addr::new(10, 0, 0, 1);
        let local = Local { mac: MAC, name: &name, address, description, naming };
        let len = local.emit(&mut buf).unwrap();
        let (header, payload) = EthernetHeader::parse(&buf[..len]).unwrap();
        let mut agent = Agent::new(Instant::ZERO);
        agent.handle_frame(Instant::ZERO, &header, payload).unwrap();
        assert_eq!(agent.neighbour().unwrap().station_name(), name, "{naming:?}");
    }
}

proptest! {
    /// Whatever arrives, the agent neither stops nor grows, and what it takes it knows in bounds.
    #[test]
    fn no_bytes_stop_the_agent(
        bytes in proptest::collection::vec(any::<u8>(), 0..600),
        start in 0_usize..=CPU.len(),
    ) {
        let mut agent = Agent::new(Instant::ZERO);
        let capacity = 2 * MOST_ID + 1;
        for payload in [&bytes[..], &[&CPU[..start], &bytes].concat()] {
            let taken = hear(&mut agent, Instant::ZERO, MAC, payload).is_ok();
            prop_assert_eq!(taken, Pdu::parse(payload).is_ok());
            if let Some(neighbour) = agent.neighbour() {
                prop_assert!(neighbour.alias().len() <= capacity);
                let (port, station) = (neighbour.port_name().len(), neighbour.station_name().len());
                prop_assert_eq!(port + 1 + station, neighbour.alias().len());
            }
        }
    }

    /// What is written is read again.
    #[test]
    fn a_pdu_survives_the_wire(
        chassis in proptest::collection::vec(any::<u8>(), 1..=255),
        port in proptest::collection::vec(any::<u8>(), 1..=255),
        ttl in any::<u16>(),
        text in proptest::option::of(proptest::collection::vec(any::<u8>(), 0..=255)),
        delays in proptest::option::of(any::<[u32; 5]>()),
        status in proptest::option::of(any::<[u16; 2]>()),
        mac in proptest::option::of(any::<[u8; 6]>()),
        mau_type in proptest::option::of(any::<u16>()),
    ) {
        let pdu = Pdu {
            system_name: text.as_deref(),
            management_address: mac.map(|[a, b, c, d, ..]| Ipv4Addr::new(a, b, c, d)),
            delays,
            port_status: status,
            chassis_mac: mac.map(Mac),
            mac_phy: mau_type.map(|mau_type| MacPhy { autonegotiation: 3, advertised: 0x8000, mau_type }),
            ..Pdu::new(id(&chassis), id(&port), ttl)
        };
        let bytes = emitted(&pdu);
        prop_assert_eq!(Pdu::parse(&bytes), Ok(pdu));
    }
}
