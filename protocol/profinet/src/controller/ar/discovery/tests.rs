use super::*;
use core::net::Ipv4Addr;
use machine::wire::Writer;

const OWN: Mac = Mac([2, 0, 0, 0, 0, 1]);
const DEVICE: Mac = Mac([2, 0, 0, 0, 0, 2]);
const ADDRESS: IpSuite = IpSuite {
    address: Ipv4Addr::new(192, 168, 64, 2),
    mask: Ipv4Addr::new(255, 255, 255, 0),
    gateway: Ipv4Addr::new(192, 168, 64, 2),
};
const NO_ADDRESS: IpSuite =
    IpSuite { address: Ipv4Addr::UNSPECIFIED, mask: Ipv4Addr::UNSPECIFIED, gateway: Ipv4Addr::UNSPECIFIED };

fn looking() -> Discovery {
    let name = Box::from(&b"robot"[..]);
    let mut discovery = Discovery::new(WantedStation {
        own_mac: OWN,
        name,
        identity: (0x0493, 2),
        mac: None,
        address: ADDRESS,
    });
    discovery.begin(Instant::ZERO, 100);
    discovery
}

fn sent(discovery: &mut Discovery) -> Option<(Mac, Service, u32)> {
    let mut buf = [0; 128];
    let len = discovery.poll_transmit(&mut buf)?;
    let (header, payload) = EthernetHeader::parse(&buf[..len]).unwrap();
    let pdu = Pdu::parse(payload).unwrap();
    Some((header.destination, pdu.service, pdu.xid))
}

fn answer(
    discovery: &mut Discovery,
    from: Mac,
    service: Service,
    xid: u32,
    blocks: &[Block<'_>],
) -> Progress {
    let mut buf = [0; 256];
    let mut writer = Writer::new(&mut buf);
    dcp::emit(&mut writer, service, xid, 0, blocks.iter().copied());
    discovery.handle(Instant::ZERO, from, &Pdu::parse(&buf).unwrap())
}

fn robot(device: u16, address: IpSuite) -> [Block<'static>; 3] {
    [
        Content::NameOfStation(b"robot").into(),
        Content::DeviceId { vendor: 0x0493, device }.into(),
        Content::Ip(address).into(),
    ]
}

#[test]
fn a_station_that_has_its_address_is_found_at_once() {
    let mut discovery = looking();
    assert_eq!(sent(&mut discovery), Some((IDENTIFY_MULTICAST, Service::IdentifyRequest, 100)));
    let blocks = robot(2, ADDRESS);
    let progress = answer(&mut discovery, DEVICE, Service::IdentifyResponse, 100, &blocks);
    assert_eq!(progress, Progress::Found(DEVICE));
    assert_eq!(discovery.poll_timeout(), None);
}

#[test]
fn a_station_without_its_address_gets_it() {
    let mut discovery = looking();
    let _ = sent(&mut discovery);
    let blocks = robot(2, NO_ADDRESS);
    let progress = answer(&mut discovery, DEVICE, Service::IdentifyResponse, 100, &blocks);
    assert_eq!(progress, Progress::Pending);
    assert_eq!(sent(&mut discovery), Some((DEVICE, Service::SetRequest, 101)));
    let set = |error| [Content::Response { code: Code::IP, error }.into()];
    let foreign = answer(&mut discovery, OWN, Service::SetResponse, 101, &set(BlockError::None));
    assert_eq!(foreign, Progress::Foreign);
    let progress = answer(&mut discovery, DEVICE, Service::SetResponse, 101, &set(BlockError::None));
    assert_eq!(progress, Progress::Found(DEVICE));
}

#[test]
fn a_station_that_refuses_its_address_is_reported_with_its_reason() {
    let mut discovery = looking();
    answer(&mut discovery, DEVICE, Service::IdentifyResponse, 100, &robot(2, NO_ADDRESS));
    let refused = [Content::Response { code: Code::IP, error: BlockError::InOperation }.into()];
    let progress = answer(&mut discovery, DEVICE, Service::SetResponse, 101, &refused);
    assert_eq!(progress, Progress::Refused(Refusal { code: 6, text: ADDRESS_REFUSED }));
}

#[test]
fn a_station_whose_address_another_one_has_gets_it_again_and_the_conflict_is_known() {
    for (conflict, info) in [(false, 0x0001), (false, 0x0002), (true, 0x0081), (true, 0x0082)] {
        let mut discovery = looking();
        let _ = sent(&mut discovery);
        let mut blocks = robot(2, ADDRESS);
        blocks[2].qualifier = info;
        let progress = answer(&mut discovery, DEVICE, Service::IdentifyResponse, 100, &blocks);
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
    let mut buf = [0; 256];
    let odd = Content::Unknown(Code::DEVICE_INSTANCE, &[1]);
    let [name, id, ip] = robot(2, ADDRESS);
    dcp::emit(&mut Writer::new(&mut buf), Service::IdentifyResponse, 100, 0, [odd.into(), name, id, ip]);
    let progress = discovery.handle(Instant::ZERO, DEVICE, &Pdu::parse(&buf).unwrap());
    assert_eq!(progress, Progress::Found(DEVICE));
}

#[test]
fn another_device_and_a_name_that_is_given_twice_are_told_apart() {
    let mut discovery = looking();
    let progress = answer(&mut discovery, DEVICE, Service::IdentifyResponse, 100, &robot(3, ADDRESS));
    assert_eq!(progress, Progress::Refused(Refusal { code: 0x0493_0003, text: WRONG_IDENTITY }));

    let mut discovery = looking();
    answer(&mut discovery, DEVICE, Service::IdentifyResponse, 100, &robot(2, ADDRESS));
    let progress = answer(&mut discovery, OWN, Service::IdentifyResponse, 100, &robot(2, ADDRESS));
    assert_eq!(progress, Progress::Refused(Refusal { code: 0, text: NAME_TWICE }));
}

#[test]
fn a_station_that_does_not_answer_a_set_is_looked_for_again() {
    let mut discovery = looking();
    answer(&mut discovery, DEVICE, Service::IdentifyResponse, 100, &robot(2, NO_ADDRESS));
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
    answer(&mut discovery, DEVICE, Service::IdentifyResponse, 100, &robot(2, NO_ADDRESS));
    let done = [Content::Response { code: Code::IP, error: BlockError::None }.into()];
    for xid in [100, 102] {
        assert_eq!(answer(&mut discovery, DEVICE, Service::SetResponse, xid, &done), Progress::Foreign);
    }
    assert_eq!(answer(&mut discovery, DEVICE, Service::SetResponse, 101, &done), Progress::Found(DEVICE));
}

#[test]
fn a_station_that_answers_twice_is_still_one() {
    let mut discovery = looking();
    for _ in 0..3 {
        let progress = answer(&mut discovery, DEVICE, Service::IdentifyResponse, 100, &robot(2, NO_ADDRESS));
        assert_eq!(progress, Progress::Pending);
    }
    let done = [Content::Response { code: Code::IP, error: BlockError::None }.into()];
    assert_eq!(answer(&mut discovery, DEVICE, Service::SetResponse, 101, &done), Progress::Found(DEVICE));
}

#[test]
fn a_station_with_the_right_address_but_another_mask_gets_both_and_the_other_way_round() {
    let other_mask = IpSuite { mask: Ipv4Addr::new(255, 255, 0, 0), ..ADDRESS };
    let other_address = IpSuite { address: Ipv4Addr::new(192, 168, 64, 3), ..ADDRESS };
    for has in [other_mask, other_address] {
        let mut discovery = looking();
        let _ = sent(&mut discovery);
        let progress = answer(&mut discovery, DEVICE, Service::IdentifyResponse, 100, &robot(2, has));
        assert_eq!(progress, Progress::Pending);
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
    // The answer comes at 0 for `answer`.
    answer(&mut discovery, DEVICE, Service::IdentifyResponse, 100, &robot(2, NO_ADDRESS));
    assert!(sent(&mut discovery).is_some());
    for (millis, is_repeated) in [(199, false), (200, true), (399, false), (400, true)] {
        discovery.handle_timeout(at(millis));
        let expected = is_repeated.then_some((DEVICE, Service::SetRequest, 101));
        assert_eq!(sent(&mut discovery), expected, "{millis}");
    }
}

#[test]
fn a_station_whose_mac_address_is_known_is_told_from_others_of_its_name() {
    let mut discovery = looking();
    discovery.wanted.mac = Some(DEVICE);
    let mut buf = [0; 256];
    dcp::emit(&mut Writer::new(&mut buf), Service::Hello, 1, 0, robot(2, ADDRESS));
    let hello = Pdu::parse(&buf).unwrap();
    assert_eq!([DEVICE, OWN].map(|from| discovery.is_hello(from, &hello)), [true, false]);
    let blocks = robot(2, ADDRESS);
    let progress = answer(&mut discovery, OWN, Service::IdentifyResponse, 100, &blocks);
    assert_eq!((progress, discovery.has_found()), (Progress::Foreign, false));
    let progress = answer(&mut discovery, DEVICE, Service::IdentifyResponse, 100, &blocks);
    assert_eq!((progress, discovery.has_found()), (Progress::Found(DEVICE), true));
}
