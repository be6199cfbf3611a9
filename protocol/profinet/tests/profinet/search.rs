//! A search for all stations, against answers of stations and of others.

use std::net::Ipv4Addr;

use machine::ethernet::{EthernetHeader, Mac};
use machine::search::{SearchCounters, SearchEnded};
use machine::{Duration, Instant, Machine, Port, Source};
use profinet::dcp::{self, Content, IDENTIFY_MULTICAST, IpSuite, MAX_DELAY_FACTOR, Pdu, Service};
use profinet::{ETHER_TYPE, FoundStation, Search, SearchConfig};

const OWN: Mac = Mac([2, 0, 0, 0, 0, 1]);
const STATION: Mac = Mac([2, 0, 0, 0, 0, 2]);
const GROUP: Mac = Mac([3, 0, 0, 0, 0, 2]);
const XID: u32 = 0xFFFF_FFFF;
const ETHERNET: Source = Source { port: Port::Ethernet, peer: None };

fn search(length: Duration) -> Search {
    Search::new(SearchConfig { mac: OWN, first_xid: XID, length }, Instant::ZERO)
}

/// A request on the cable: when it was sent, its Xid and its delay factor.
type Asked = (u128, u32, u16);

/// Calls the search at this time and returns the request that it sends, if it sends one.
fn step(search: &mut Search, now: Instant) -> Option<Asked> {
    search.handle_timeout(now);
    let mut buf = [0; 128];
    let transmit = search.poll_transmit(now, &mut buf)?;
    assert_eq!((transmit.port, transmit.to), (Port::Ethernet, None));
    assert!(search.poll_transmit(now, &mut [0; 128]).is_none(), "one frame at a time");
    let (header, payload) = EthernetHeader::parse(&buf[..transmit.len]).unwrap();
    assert_eq!((header.destination, header.source, header.ether_type), (IDENTIFY_MULTICAST, OWN, ETHER_TYPE));
    let pdu = Pdu::parse(payload).unwrap();
    assert_eq!(pdu.service, Service::IdentifyRequest);
    assert_eq!(pdu.blocks().collect::<Vec<_>>(), [Ok(Content::All.into())]);
    Some((now.since(Instant::ZERO).as_millis(), pdu.xid, pdu.response_delay_factor))
}

/// Runs a search without stations and returns its requests, and when it ends.
fn run(length: Duration) -> (Vec<Asked>, u128) {
    let mut search = search(length);
    let mut asked = Vec::new();
    for _ in 0..10 {
        let now = search.poll_timeout().expect("the search has not ended");
        asked.extend(step(&mut search, now));
        if let Some(SearchEnded) = search.poll_event() {
            assert_eq!((search.poll_event(), search.poll_timeout()), (None, None));
            return (asked, now.since(Instant::ZERO).as_millis());
        }
    }
    panic!("it does not end");
}

#[test]
fn it_asks_three_times_and_the_answers_are_spread_over_a_quarter_of_its_time() {
    let (asked, end) = run(Duration::from_millis(2_000));
    assert_eq!((&asked[..], end), (&[(0, XID, 50), (500, 0, 50), (1_000, 1, 50)][..], 2_000));
    let factor = |length| run(Duration::from_millis(length)).0[0].2;
    assert_eq!(factor(20), 1);
    assert_eq!(factor(1_000), 25);
    assert_eq!(factor(10_000_000), MAX_DELAY_FACTOR);
}

/// An answer, and how its frame is addressed.
#[derive(Clone, Copy)]
struct Answer {
    source: Mac,
    destination: Mac,
    service: Service,
    xid: u32,
    name: &'static [u8],
}

const GOOD: Answer = Answer {
    source: STATION,
    destination: OWN,
    service: Service::IdentifyResponse,
    xid: XID,
    name: b"robot",
};

const IP: IpSuite = IpSuite {
    address: Ipv4Addr::new(192, 168, 64, 2),
    mask: Ipv4Addr::new(255, 255, 255, 0),
    gateway: Ipv4Addr::UNSPECIFIED,
};

fn frame(Answer { source, destination, service, xid, name }: Answer) -> Vec<u8> {
    let mut buf = [0; 256];
    let header = EthernetHeader { destination, source, tag: None, ether_type: ETHER_TYPE };
    let blocks = [
        Content::NameOfStation(name).into(),
        Content::TypeOfStation(b"sample").into(),
        Content::DeviceId { vendor: 0x0493, device: 2 }.into(),
        Content::Ip(IP).into(),
        Content::DeviceRole(1).into(),
    ];
    let len = header.emit(&mut buf, |w| dcp::emit(w, service, xid, 0, blocks)).unwrap();
    buf[..len].to_vec()
}

/// Gives the search a frame and returns whether it is a station's answer; `None` if it is not for a search at all.
fn takes(search: &mut Search, source: Source, frame: &[u8]) -> Option<bool> {
    let before = search.answers().counters();
    let stations = search.answers().devices().len() as u64;
    search.handle_frame(Instant::ZERO, source, frame);
    let after = search.answers().counters();
    let taken = search.answers().devices().len() as u64 - stations + after.repeated - before.repeated;
    match (taken, after.ignored - before.ignored) {
        (1, 0) => Some(true),
        (0, 1) => Some(false),
        (0, 0) => None,
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_station_that_answers_is_described_by_its_newest_answer() {
    let mut search = search(Duration::from_secs(2));
    step(&mut search, Instant::ZERO).expect("a request");
    assert_eq!(takes(&mut search, ETHERNET, &frame(Answer { name: b"", ..GOOD })), Some(true));
    let other = Mac([2, 0, 0, 0, 0, 3]);
    assert_eq!(takes(&mut search, ETHERNET, &frame(Answer { source: other, ..GOOD })), Some(true));
    assert_eq!(takes(&mut search, ETHERNET, &frame(GOOD)), Some(true));
    let station = |mac| FoundStation {
        mac,
        name: b"robot".as_slice().into(),
        type_of_station: b"sample".as_slice().into(),
        identity: Some((0x0493, 2)),
        ip: Some(IP),
        roles: 1,
    };
    assert_eq!(search.answers().devices(), [station(STATION), station(other)]);
    assert_eq!(search.answers().counters(), SearchCounters { repeated: 1, ignored: 0, surplus: 0 });
}

#[test]
fn only_an_answer_to_an_own_request_that_a_station_sends_to_this_one_counts() {
    let mut search = search(Duration::from_secs(2));
    assert_eq!(takes(&mut search, ETHERNET, &frame(GOOD)), Some(false), "nothing was asked yet");
    step(&mut search, Instant::ZERO).expect("a request");
    for (name, answer, is_taken) in [
        ("the first request", GOOD, true),
        ("the second request, which was not sent", Answer { xid: 0, ..GOOD }, false),
        ("a request of before", Answer { xid: XID - 1, ..GOOD }, false),
        ("for another station", Answer { destination: STATION, ..GOOD }, false),
        ("from a group", Answer { source: GROUP, ..GOOD }, false),
    ] {
        assert_eq!(takes(&mut search, ETHERNET, &frame(answer)), Some(is_taken), "{name}");
    }
    step(&mut search, Instant::from_millis(500)).expect("a request");
    for (xid, is_taken) in [(XID, true), (0, true), (1, false)] {
        assert_eq!(takes(&mut search, ETHERNET, &frame(Answer { xid, ..GOOD })), Some(is_taken), "{xid:X}");
    }
    // With the FrameID of an answer, but another service.
    let mut request = frame(GOOD);
    request[17] = 0;
    assert_eq!(takes(&mut search, ETHERNET, &request), Some(false));
    let mut not_supported = frame(GOOD);
    not_supported[17] = 5;
    assert_eq!(takes(&mut search, ETHERNET, &not_supported), Some(false));
    assert_eq!(search.answers().devices().len(), 1);
}

#[test]
fn frames_that_are_no_answers_to_a_search_are_not_counted() {
    let mut search = search(Duration::from_secs(2));
    step(&mut search, Instant::ZERO).expect("a request");
    let mut other_type = frame(GOOD);
    other_type[12..14].copy_from_slice(&[0x88, 0xCC]);
    let mut cyclic = frame(GOOD);
    cyclic[14..16].copy_from_slice(&[0x80, 0x00]);
    let udp = Source { port: Port::Udp(34964), peer: None };
    let request = frame(Answer { service: Service::IdentifyRequest, ..GOOD });
    for (source, frame) in [
        (ETHERNET, &other_type[..]),
        (ETHERNET, &cyclic),
        (ETHERNET, &request),
        (ETHERNET, &frame(GOOD)[..13]),
        (ETHERNET, &frame(GOOD)[..14]),
        (udp, &frame(GOOD)),
    ] {
        assert_eq!(takes(&mut search, source, frame), None, "{frame:X?}");
    }
}

#[test]
fn an_answer_after_the_end_is_not_taken() {
    let mut search = search(Duration::from_secs(2));
    step(&mut search, Instant::ZERO).expect("a request");
    search.handle_timeout(Instant::from_millis(2_000));
    assert_eq!(takes(&mut search, ETHERNET, &frame(GOOD)), None);
    assert_eq!(search.poll_event(), Some(SearchEnded));
}
