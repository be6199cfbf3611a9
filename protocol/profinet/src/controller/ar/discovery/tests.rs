use super::*;
use crate::dcp::Block;
use core::net::Ipv4Addr;
use machine::wire::Writer;

const OWN: Mac = Mac([2, 0, 0, 0, 0, 1]);
const DEVICE: Mac = Mac([2, 0, 0, 0, 0, 2]);
const OTHER: Mac = Mac([2, 0, 0, 0, 0, 3]);
const OWN_ADDRESS: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 1);
const ADDRESS: IpSuite = IpSuite {
    address: Ipv4Addr::new(192, 168, 64, 2),
    mask: Ipv4Addr::new(255, 255, 255, 0),
    gateway: Ipv4Addr::new(192, 168, 64, 2),
};
const NO_ADDRESS: IpSuite =
    IpSuite { address: Ipv4Addr::UNSPECIFIED, mask: Ipv4Addr::UNSPECIFIED, gateway: Ipv4Addr::UNSPECIFIED };

fn looking_for(mac: Option<Mac>) -> Discovery {
    let name = Box::from(&b"robot"[..]);
    let mut discovery = Discovery::new(WantedStation {
        own_mac: OWN,
        own_address: OWN_ADDRESS,
        name,
        identity: (0x0493, 2),
        mac,
        address: ADDRESS,
    });
    discovery.begin(Instant::ZERO, 100);
    discovery
}

fn looking() -> Discovery {
    looking_for(None)
}

/// Returns the next DCP request.
fn sent(discovery: &mut Discovery) -> Option<(Mac, Service, u32)> {
    let mut buf = [0; 128];
    let len = discovery.poll_dcp(&mut buf)?;
    let (header, payload) = EthernetHeader::parse(&buf[..len]).unwrap();
    let pdu = Pdu::parse(payload).unwrap();
    Some((header.destination, pdu.service, pdu.xid))
}

fn answer_at(
    discovery: &mut Discovery,
    now: Instant,
    from: Mac,
    (service, xid): (Service, u32),
    blocks: &[Block<'_>],
) -> Progress {
    let mut buf = [0; 256];
    let mut writer = Writer::new(&mut buf);
    dcp::emit(&mut writer, service, xid, 0, blocks.iter().copied());
    discovery.handle(now, from, &Pdu::parse(&buf).unwrap())
}

fn answer(
    discovery: &mut Discovery,
    from: Mac,
    service: Service,
    xid: u32,
    blocks: &[Block<'_>],
) -> Progress {
    answer_at(discovery, Instant::ZERO, from, (service, xid), blocks)
}

/// Answers the Identify of a search that has just begun.
fn identified(discovery: &mut Discovery, from: Mac, blocks: &[Block<'_>]) -> Progress {
    let xid = discovery.xid;
    answer(discovery, from, Service::IdentifyResponse, xid, blocks)
}

/// Runs until the search makes progress, and returns when it did; these stations answer questions by ARP.
fn run(discovery: &mut Discovery, holders: &[(Ipv4Addr, Mac)]) -> (u64, Progress) {
    let mut buf = [0; 128];
    let mut now = Instant::ZERO;
    loop {
        let mut packets = Vec::new();
        let polls = [discovery.holders.poll_transmit(now, &mut buf).map(|_| buf), None];
        packets.extend(polls.into_iter().flatten());
        packets.extend(discovery.own.poll_transmit(now, &mut buf).map(|_| buf));
        for question in packets {
            let question = ArpPacket::from_frame(&question).unwrap().unwrap();
            for (_, mac) in holders.iter().filter(|(address, _)| *address == question.target_address) {
                match discovery.handle_arp(&question.answer(*mac)) {
                    Progress::Pending | Progress::Foreign => {}
                    progress => return (now.as_nanos() / 1_000_000, progress),
                }
            }
        }
        let before = (discovery.step, discovery.xid);
        now = now.max(discovery.poll_timeout().unwrap());
        match discovery.handle_timeout(now) {
            Progress::Pending if (discovery.step, discovery.xid) == before => {}
            progress => return (now.as_nanos() / 1_000_000, progress),
        }
    }
}

const IS_DEVICE: &[(Ipv4Addr, Mac)] = &[(ADDRESS.address, DEVICE)];

fn robot(device: u16, address: IpSuite) -> [Block<'static>; 3] {
    [
        Content::NameOfStation(b"robot").into(),
        Content::DeviceId { vendor: 0x0493, device }.into(),
        Content::Ip(address).into(),
    ]
}

fn set_done() -> [Block<'static>; 1] {
    [Content::Response { code: Code::IP, error: BlockError::None }.into()]
}

#[test]
fn a_station_that_has_its_address_is_found_once_every_other_one_had_time_to_answer() {
    let mut discovery = looking();
    assert_eq!(sent(&mut discovery), Some((IDENTIFY_MULTICAST, Service::IdentifyRequest, 100)));
    assert_eq!(identified(&mut discovery, DEVICE, &robot(2, ADDRESS)), Progress::Pending);
    assert_eq!(run(&mut discovery, IS_DEVICE), (200, Progress::Found(DEVICE)));
    assert_eq!(discovery.poll_timeout(), None);
}

#[test]
fn a_station_whose_mac_address_is_configured_is_found_as_soon_as_its_address_is_checked() {
    let mut discovery = looking_for(Some(DEVICE));
    identified(&mut discovery, DEVICE, &robot(2, ADDRESS));
    assert_eq!(run(&mut discovery, IS_DEVICE), (60, Progress::Found(DEVICE)));
}

#[test]
fn a_station_without_its_address_gets_it_and_must_answer_for_it() {
    let mut discovery = looking();
    let _ = sent(&mut discovery);
    identified(&mut discovery, DEVICE, &robot(2, NO_ADDRESS));
    assert_eq!(sent(&mut discovery), None, "not before the address is known to be free");
    assert_eq!(run(&mut discovery, &[]), (200, Progress::Pending));
    assert_eq!(sent(&mut discovery), Some((DEVICE, Service::SetRequest, 101)));
    let foreign = answer(&mut discovery, OTHER, Service::SetResponse, 101, &set_done());
    assert_eq!(foreign, Progress::Foreign);
    assert_eq!(answer(&mut discovery, DEVICE, Service::SetResponse, 101, &set_done()), Progress::Pending);
    assert_eq!(run(&mut discovery, IS_DEVICE), (0, Progress::Found(DEVICE)));
}

#[test]
fn a_station_that_does_not_answer_for_its_address_is_asked_for_3_s() {
    let mut discovery = looking();
    identified(&mut discovery, DEVICE, &robot(2, ADDRESS));
    assert_eq!(run(&mut discovery, &[]), (200, Progress::Pending));
    assert!(discovery.is_resolving());
    let (ms, progress) = run(&mut discovery, &[]);
    assert_eq!((progress, (3_200..3_300).contains(&ms)), (Progress::Unresolved, true), "{ms}");
}

#[test]
fn whoever_else_has_the_address_ends_the_search_before_anything_is_set() {
    let obstructed =
        |device, other| Progress::Obstructed(Obstacle::Address { address: ADDRESS.address, device, other });
    let both = &[(ADDRESS.address, DEVICE), (ADDRESS.address, OTHER)][..];
    let other = &[(ADDRESS.address, OTHER)][..];
    for (has, mac, holders) in [
        (ADDRESS, None, both),
        (NO_ADDRESS, None, other),
        (NO_ADDRESS, Some(DEVICE), other),
        (ADDRESS, Some(DEVICE), other),
    ] {
        let mut discovery = looking_for(mac);
        let _ = sent(&mut discovery);
        identified(&mut discovery, DEVICE, &robot(2, has));
        let (_, progress) = run(&mut discovery, holders);
        assert_eq!(progress, obstructed(DEVICE, OTHER), "{has:?} {mac:?}");
        assert_eq!((sent(&mut discovery), discovery.poll_timeout()), (None, None));
    }
}

#[test]
fn whoever_has_the_address_after_the_set_and_is_not_the_device_ends_the_search() {
    let mut discovery = looking();
    identified(&mut discovery, DEVICE, &robot(2, NO_ADDRESS));
    run(&mut discovery, &[]);
    answer(&mut discovery, DEVICE, Service::SetResponse, 101, &set_done());
    let obstacle = Obstacle::Address { address: ADDRESS.address, device: DEVICE, other: OTHER };
    let (_, progress) = run(&mut discovery, &[(ADDRESS.address, OTHER)]);
    assert_eq!(progress, Progress::Obstructed(obstacle));
}

#[test]
fn a_station_with_the_controllers_address_ends_the_search() {
    let mut discovery = looking();
    identified(&mut discovery, DEVICE, &robot(2, ADDRESS));
    let (_, progress) = run(&mut discovery, &[(ADDRESS.address, DEVICE), (OWN_ADDRESS, OTHER)]);
    let obstacle = Obstacle::OwnAddress { address: OWN_ADDRESS, other: OTHER };
    assert_eq!(progress, Progress::Obstructed(obstacle));
}

#[test]
fn a_station_that_refuses_its_address_is_reported_with_its_reason() {
    let mut discovery = looking();
    identified(&mut discovery, DEVICE, &robot(2, NO_ADDRESS));
    run(&mut discovery, &[]);
    let refused = [Content::Response { code: Code::IP, error: BlockError::InOperation }.into()];
    let progress = answer(&mut discovery, DEVICE, Service::SetResponse, 101, &refused);
    assert_eq!(progress, Progress::Refused(Refusal { code: 6, text: down_reasons::ADDRESS_REFUSED }));
}

#[test]
fn a_station_whose_address_another_one_has_gets_it_again_and_the_conflict_is_known() {
    for (conflict, info) in [(false, 0x0001), (false, 0x0002), (true, 0x0081), (true, 0x0082)] {
        let mut discovery = looking();
        let _ = sent(&mut discovery);
        let mut blocks = robot(2, ADDRESS);
        blocks[2].qualifier = info;
        identified(&mut discovery, DEVICE, &blocks);
        let (_, progress) = run(&mut discovery, IS_DEVICE);
        let expected = if conflict { Progress::Pending } else { Progress::Found(DEVICE) };
        assert_eq!((progress, discovery.has_conflict()), (expected, conflict), "0x{info:04X}");
        if conflict {
            assert_eq!(sent(&mut discovery), Some((DEVICE, Service::SetRequest, 101)));
        }
    }
}

#[test]
fn a_block_of_another_length_does_not_hide_the_station() {
    let mut discovery = looking();
    let odd = Content::Unknown(Code::DEVICE_INSTANCE, &[1]);
    let [name, id, ip] = robot(2, ADDRESS);
    identified(&mut discovery, DEVICE, &[odd.into(), name, id, ip]);
    assert_eq!(run(&mut discovery, IS_DEVICE), (200, Progress::Found(DEVICE)));
}

#[test]
fn another_device_is_refused_with_its_identity() {
    let mut discovery = looking();
    identified(&mut discovery, DEVICE, &robot(3, ADDRESS));
    let refusal = Refusal { code: 0x0493_0003, text: down_reasons::WRONG_IDENTITY };
    assert_eq!(run(&mut discovery, IS_DEVICE), (200, Progress::Refused(refusal)));
}

#[test]
fn a_name_that_two_stations_have_is_refused_whichever_of_them_answers_first_and_last() {
    for (stations, at) in [([DEVICE, OTHER], 0), ([OTHER, DEVICE], 0), ([DEVICE, OTHER], 199)] {
        let mut discovery = looking();
        let _ = sent(&mut discovery);
        identified(&mut discovery, stations[0], &robot(2, NO_ADDRESS));
        let (now, what) = (Instant::from_millis(at), (Service::IdentifyResponse, 100));
        answer_at(&mut discovery, now, stations[1], what, &robot(2, NO_ADDRESS));
        let twins = Progress::Obstructed(Obstacle::Twins(stations));
        assert_eq!(run(&mut discovery, &[]), (200, twins));
        assert_eq!(sent(&mut discovery), None, "neither is addressed");
    }
    // The second one is late, and the first one is being addressed.
    let mut discovery = looking();
    identified(&mut discovery, DEVICE, &robot(2, NO_ADDRESS));
    run(&mut discovery, &[]);
    let twins = Progress::Obstructed(Obstacle::Twins([DEVICE, OTHER]));
    assert_eq!(identified(&mut discovery, OTHER, &robot(2, NO_ADDRESS)), twins);
    assert_eq!(sent(&mut discovery), None);
}

#[test]
fn a_name_that_two_stations_had_is_that_of_one_after_three_windows_with_one_answer() {
    let mut discovery = looking();
    identified(&mut discovery, DEVICE, &robot(2, ADDRESS));
    identified(&mut discovery, OTHER, &robot(2, ADDRESS));
    run(&mut discovery, &[]);
    discovery.begin(Instant::ZERO, 500);
    for expected in [Progress::Pending, Progress::Pending, Progress::Found(DEVICE)] {
        identified(&mut discovery, DEVICE, &robot(2, ADDRESS));
        let (_, progress) = run(&mut discovery, IS_DEVICE);
        assert_eq!(progress, expected);
    }
}

#[test]
fn a_station_that_does_not_answer_a_set_is_looked_for_again() {
    let mut discovery = looking();
    identified(&mut discovery, DEVICE, &robot(2, NO_ADDRESS));
    run(&mut discovery, &[]);
    let mut services = Vec::new();
    for _ in 0..6 {
        services.extend(sent(&mut discovery).map(|(_, service, xid)| (service, xid)));
        let at = discovery.poll_timeout().unwrap();
        discovery.handle_timeout(at);
    }
    let set = (Service::SetRequest, 101);
    let again = (Service::IdentifyRequest, 102);
    assert_eq!(services, [set, set, set, set, set, again]);
}

#[test]
fn an_answer_to_another_request_is_not_taken_for_one_to_ours() {
    let mut discovery = looking();
    for xid in [99, 101] {
        let progress = answer(&mut discovery, DEVICE, Service::IdentifyResponse, xid, &robot(2, NO_ADDRESS));
        assert_eq!((progress, discovery.device()), (Progress::Foreign, None));
    }
    identified(&mut discovery, DEVICE, &robot(2, NO_ADDRESS));
    run(&mut discovery, &[]);
    for xid in [100, 102] {
        let progress = answer(&mut discovery, DEVICE, Service::SetResponse, xid, &set_done());
        assert_eq!(progress, Progress::Foreign);
    }
    answer(&mut discovery, DEVICE, Service::SetResponse, 101, &set_done());
    assert!(discovery.is_resolving());
}

#[test]
fn a_station_that_answers_twice_is_still_one() {
    let mut discovery = looking();
    for _ in 0..3 {
        assert_eq!(identified(&mut discovery, DEVICE, &robot(2, ADDRESS)), Progress::Pending);
    }
    assert_eq!(run(&mut discovery, IS_DEVICE), (200, Progress::Found(DEVICE)));
}

#[test]
fn a_station_with_the_right_address_but_another_mask_gets_both_and_the_other_way_round() {
    let other_mask = IpSuite { mask: Ipv4Addr::new(255, 255, 0, 0), ..ADDRESS };
    let other_address = IpSuite { address: Ipv4Addr::new(192, 168, 64, 3), ..ADDRESS };
    for has in [other_mask, other_address] {
        let mut discovery = looking();
        let _ = sent(&mut discovery);
        identified(&mut discovery, DEVICE, &robot(2, has));
        assert_eq!(run(&mut discovery, &[]), (200, Progress::Pending));
        assert_eq!(sent(&mut discovery), Some((DEVICE, Service::SetRequest, 101)));
    }
}

#[test]
fn a_request_is_repeated_after_200_ms_and_not_before() {
    let mut discovery = looking();
    let at = Instant::from_millis;
    assert!(sent(&mut discovery).is_some());
    for (millis, is_repeated) in [(199, false), (200, true), (399, false), (400, true)] {
        discovery.handle_timeout(at(millis));
        let expected = is_repeated.then_some((IDENTIFY_MULTICAST, Service::IdentifyRequest, 100));
        assert_eq!(sent(&mut discovery), expected, "{millis}");
    }
    let mut discovery = looking();
    identified(&mut discovery, DEVICE, &robot(2, NO_ADDRESS));
    run(&mut discovery, &[]);
    assert!(sent(&mut discovery).is_some());
    for (millis, is_repeated) in [(399, false), (400, true), (599, false), (600, true)] {
        discovery.handle_timeout(at(millis));
        let expected = is_repeated.then_some((DEVICE, Service::SetRequest, 101));
        assert_eq!(sent(&mut discovery), expected, "{millis}");
    }
}

#[test]
fn a_station_whose_mac_address_is_known_is_told_from_others_of_its_name() {
    let mut discovery = looking_for(Some(DEVICE));
    assert_eq!([DEVICE, OTHER].map(|from| discovery.is_excluded(from)), [false, true]);
    let blocks = robot(2, NO_ADDRESS);
    let others = [0; 3].map(|_| identified(&mut discovery, OTHER, &blocks));
    assert_eq!(others, [Progress::Ignored(OTHER), Progress::Foreign, Progress::Foreign], "named once");
    assert!(!discovery.has_found());
    identified(&mut discovery, DEVICE, &blocks);
    assert_eq!(run(&mut discovery, &[]), (60, Progress::Pending));
    let _ = sent(&mut discovery);
    discovery.begin(Instant::ZERO, 300);
    assert_eq!(identified(&mut discovery, OTHER, &blocks), Progress::Foreign, "in no later search either");
}
