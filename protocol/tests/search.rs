//! Searches on a cable with many devices, and against broken and forged answers.
#![expect(
    clippy::expect_used,
    clippy::indexing_slicing,
    clippy::unwrap_used,
    reason = "helpers of tests may fail as loudly as tests"
)]

use std::net::{Ipv4Addr, SocketAddrV4};

use ethernet_ip::{Adapter, AdapterConfig, ENCAPSULATION_PORT};
use machine::arp::ArpPacket;
use machine::ethernet::{EthernetHeader, Mac};
use machine::search::{Answers, MOST_DEVICES, SearchCounters, SearchEnded};
use machine::{Duration, Instant, LinkEvent, Machine, Port, Source, Transmit};
use profinet::dcp::{self, Block, Content, Pdu, Service};
use profinet::{Device, DeviceConfig, ETHER_TYPE, lldp};
use proptest::prelude::*;
use protocol::search::Search;
use protocol::stations::{ETHERNET_IP_ROBOT, PROFINET_ROBOT};

const MAC: Mac = Mac([2, 0, 0, 0, 0, 1]);
const ADDRESS: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 1);
const MASK: Ipv4Addr = Ipv4Addr::new(255, 255, 255, 0);
const PORT: u16 = 50_000;
const XID: u32 = 0xFFFF_FFFF;
const LENGTH: Duration = Duration::from_secs(2);
const CABLE: Duration = Duration::from_micros(25);

fn search() -> Search {
    let profinet = profinet::SearchConfig { mac: MAC, first_xid: XID, length: LENGTH };
    let ethernet_ip = ethernet_ip::SearchConfig::from_address(PORT, ADDRESS, MASK, LENGTH);
    Search::new(
        Some(profinet::Search::new(profinet, Instant::ZERO)),
        Some(ethernet_ip::Search::new(ethernet_ip, Instant::ZERO)),
    )
}

fn profinet(search: &Search) -> &Answers<profinet::FoundStation> {
    search.profinet().unwrap().answers()
}

fn ethernet_ip(search: &Search) -> &Answers<ethernet_ip::FoundDevice> {
    search.ethernet_ip().unwrap().answers()
}

/// A cable with many devices behind a switch, in virtual time.
struct Segment {
    now: Instant,
    search: Search,
    devices: Vec<(Ipv4Addr, Box<dyn Machine<Event = LinkEvent>>)>,
    /// Frames in flight: time of arrival, the device or the search, source.
    in_flight: Vec<(Instant, Option<usize>, Source, Vec<u8>)>,
    /// When answers on raw Ethernet were sent.
    answered: Vec<Instant>,
    /// Frames before this time are lost.
    open_from: Instant,
    over: bool,
}

impl Segment {
    fn new(stations: u8, adapters: u8) -> Self {
        let address = |number: u8| Ipv4Addr::new(192, 168, 64, 100 + number);
        let station = |number: u8| -> (Ipv4Addr, Box<dyn Machine<Event = LinkEvent>>) {
            let config = DeviceConfig {
                mac: Mac([2, 0, 0, 0, 1, number]),
                station_name: format!("robot-{number}").into_bytes(),
                permanent: None,
                address: Some(address(number)),
                mask: MASK,
                description: PROFINET_ROBOT,
                controllers: machine::Allowed::default(),
            };
            (address(number), Box::new(Device::new(config, Instant::ZERO)))
        };
        let adapter = |number: u8| -> (Ipv4Addr, Box<dyn Machine<Event = LinkEvent>>) {
            let config = AdapterConfig {
                description: &ETHERNET_IP_ROBOT,
                serial_number: number.into(),
                address: address(number),
                mask: MASK,
                gateway: Ipv4Addr::UNSPECIFIED,
                mac: [2, 0, 0, 0, 2, number],
                first_id: 1,
                originators: machine::Allowed::default(),
            };
            (address(number), Box::new(Adapter::new(config)))
        };
        Self {
            now: Instant::ZERO,
            search: search(),
            devices: (0..stations).map(station).chain((0..adapters).map(adapter)).collect(),
            in_flight: Vec::new(),
            answered: Vec::new(),
            open_from: Instant::ZERO,
            over: false,
        }
    }

    /// Runs to the end of the search.
    fn run(mut self) -> Self {
        while !self.over {
            let timeouts = self.devices.iter().filter_map(|(_, device)| device.poll_timeout());
            let arrivals = self.in_flight.iter().map(|(at, ..)| *at);
            let next = timeouts.chain(arrivals).chain(self.search.poll_timeout()).min();
            self.now = next.expect("a search that is not over has a deadline").max(self.now);
            self.step();
        }
        assert_eq!(self.now, Instant::ZERO + LENGTH);
        self
    }

    fn step(&mut self) {
        let now = self.now;
        let (due, later) = core::mem::take(&mut self.in_flight).into_iter().partition(|(at, ..)| *at <= now);
        self.in_flight = later;
        for (_, to, from, frame) in due {
            match to {
                Some(index) => {
                    self.devices[index].1.handle_frame(now, from, &frame);
                    self.settle_device(index);
                }
                None => self.search.handle_frame(now, from, &frame),
            }
        }
        for index in 0..self.devices.len() {
            if self.devices[index].1.poll_timeout().is_some_and(|due| due <= now) {
                self.devices[index].1.handle_timeout(now);
                self.settle_device(index);
            }
        }
        if self.search.poll_timeout().is_some_and(|due| due <= now) {
            self.search.handle_timeout(now);
            self.settle_search();
        }
    }

    fn settle_device(&mut self, index: usize) {
        let (now, (address, device)) = (self.now, &mut self.devices[index]);
        let mut buf = [0; 4096];
        while let Some(Transmit { port, to, len }) = device.poll_transmit(now, &mut buf) {
            let from = match (port, to) {
                (Port::Udp(port), Some(to)) => {
                    Source { port: Port::Udp(to.port()), peer: Some(SocketAddrV4::new(*address, port)) }
                }
                _ => ETHERNET,
            };
            // A station also announces itself to its neighbours, and its IP address.
            let is_announcement =
                buf[..len].starts_with(&lldp::MULTICAST.0) || ArpPacket::from_frame(&buf[..len]).is_some();
            if port == Port::Ethernet && !is_announcement {
                self.answered.push(now);
            }
            self.in_flight.push((now + CABLE, None, from, buf[..len].to_vec()));
        }
        while device.poll_event().is_some() {}
    }

    fn settle_search(&mut self) {
        let now = self.now;
        let mut buf = [0; 4096];
        while let Some(Transmit { port, to, len }) = self.search.poll_transmit(now, &mut buf) {
            if now < self.open_from {
                continue;
            }
            let peer = to.map(|_| SocketAddrV4::new(ADDRESS, PORT));
            let from = Source { port: to.map_or(port, |to| Port::Udp(to.port())), peer };
            for index in 0..self.devices.len() {
                self.in_flight.push((now + CABLE, Some(index), from, buf[..len].to_vec()));
            }
        }
        self.over |= self.search.poll_event() == Some(SearchEnded);
    }
}

/// Builds the answer of a PROFINET station.
fn answer(mac: Mac, xid: u32, name: &[u8]) -> Vec<u8> {
    let header = EthernetHeader { destination: MAC, source: mac, tag: None, ether_type: ETHER_TYPE };
    let blocks: [Block<'_>; 2] =
        [Content::NameOfStation(name).into(), Content::DeviceId { vendor: 0x0493, device: 2 }.into()];
    let mut buf = [0; 512];
    let len =
        header.emit(&mut buf, |writer| dcp::emit(writer, Service::IdentifyResponse, xid, 0, blocks)).unwrap();
    buf[..len].to_vec()
}

const ETHERNET: Source = Source { port: Port::Ethernet, peer: None };

fn from_device(last: u8) -> Source {
    let peer = SocketAddrV4::new(Ipv4Addr::new(192, 168, 64, last), ENCAPSULATION_PORT);
    Source { port: Port::Udp(PORT), peer: Some(peer) }
}

/// Returns a search that has sent its first requests.
fn asking() -> Search {
    let mut search = search();
    search.handle_timeout(Instant::ZERO);
    search
}

/// Sends all waiting frames; returns their number.
fn sent(search: &mut Search, now: Instant) -> usize {
    let mut buf = [0; 4096];
    core::iter::from_fn(|| search.poll_transmit(now, &mut buf)).count()
}

#[test]
fn every_device_on_a_cable_is_listed_once_however_often_it_answers() {
    let found = Segment::new(40, 5).run().search;
    let mut macs: Vec<_> = profinet(&found).devices().iter().map(|station| station.mac).collect();
    macs.sort_unstable();
    assert_eq!(macs, (0..40).map(|number| Mac([2, 0, 0, 0, 1, number])).collect::<Vec<_>>());
    let station = &profinet(&found).devices()[0];
    assert_eq!(station.name, format!("robot-{}", station.mac.0[5]).into_bytes().into());
    let identity = PROFINET_ROBOT.identity;
    assert_eq!((station.identity, station.roles), (Some((identity.vendor, identity.device)), 1));
    assert_eq!(profinet(&found).counters(), SearchCounters { repeated: 80, ..SearchCounters::default() });

    let serials: Vec<_> =
        ethernet_ip(&found).devices().iter().map(|device| device.identity.serial_number).collect();
    assert_eq!(serials, [0, 1, 2, 3, 4]);
    let device = &ethernet_ip(&found).devices()[3];
    assert_eq!(device.address, Ipv4Addr::new(192, 168, 64, 103));
    assert_eq!(device.listens_at, SocketAddrV4::new(device.address, ENCAPSULATION_PORT));
    // Three requests with two broadcasts each.
    assert_eq!(ethernet_ip(&found).counters(), SearchCounters { repeated: 25, ..SearchCounters::default() });
}

#[test]
fn stations_spread_their_answers_over_a_quarter_of_the_search() {
    let segment = Segment::new(40, 0).run();
    let first: Vec<_> = segment.answered.iter().filter(|at| **at < Instant::ZERO + LENGTH / 4).collect();
    assert_eq!(first.len(), 40);
    let mut distinct = first.clone();
    distinct.dedup();
    assert!(distinct.len() > 20, "{distinct:?}");
    // The last answers to the last request arrive well before the end.
    let last = segment.answered.iter().max().unwrap();
    assert!(*last < Instant::ZERO + LENGTH * 3 / 4 + CABLE * 2, "{last:?}");
}

#[test]
fn after_a_lost_request_the_next_one_finds_the_devices() {
    let mut segment = Segment::new(3, 3);
    segment.open_from = Instant::ZERO + LENGTH / 2;
    let found = segment.run().search;
    assert_eq!((profinet(&found).devices().len(), ethernet_ip(&found).devices().len()), (3, 3));
    assert_eq!(profinet(&found).counters().repeated, 0);
}

#[test]
fn the_request_asks_every_station_and_gives_a_delay_within_the_search() {
    let mut search = asking();
    let mut buf = [0; 4096];
    let Transmit { port, len, .. } = search.poll_transmit(Instant::ZERO, &mut buf).unwrap();
    assert_eq!(port, Port::Ethernet);
    let (header, payload) = EthernetHeader::parse(&buf[..len]).unwrap();
    assert_eq!((header.destination, header.source), (dcp::IDENTIFY_MULTICAST, MAC));
    let pdu = Pdu::parse(payload).unwrap();
    assert_eq!((pdu.service, pdu.xid, pdu.response_delay_factor), (Service::IdentifyRequest, XID, 50));
    let blocks: Vec<_> = pdu.blocks().map(|block| block.unwrap().content).collect();
    assert_eq!(blocks, [Content::All]);
    let to: Vec<_> = core::iter::from_fn(|| search.poll_transmit(Instant::ZERO, &mut buf)?.to).collect();
    let broadcasts = [Ipv4Addr::new(192, 168, 64, 255), Ipv4Addr::BROADCAST];
    assert_eq!(to, broadcasts.map(|address| SocketAddrV4::new(address, ENCAPSULATION_PORT)));
    // ListIdentity carries the time to answer within, in ms, in the first bytes of its context.
    assert_eq!(buf[12..14], 500_u16.to_le_bytes());
}

#[test]
fn a_driver_that_is_late_for_two_requests_sends_one_and_keeps_the_end() {
    let mut search = asking();
    assert_eq!(sent(&mut search, Instant::ZERO), 3);
    let late = Instant::ZERO + LENGTH * 3 / 5;
    search.handle_timeout(late);
    assert_eq!(sent(&mut search, late), 3);
    assert_eq!(search.poll_timeout(), Some(Instant::ZERO + LENGTH));
}

#[test]
fn broken_foreign_and_unrequested_answers_are_counted_and_otherwise_ignored() {
    let mac = Mac([2, 0, 0, 0, 0, 9]);
    let good = answer(mac, XID, b"robot");
    let mut search = asking();
    let mut hostile = vec![
        answer(mac, XID.wrapping_sub(1), b"of an old question"),
        answer(mac, XID.wrapping_add(1), b"of a question to come"),
        answer(Mac([0xFF; 6]), XID, b"from everybody"),
    ];
    let to_another = [&[2, 0, 0, 0, 0, 7], &good[6..]].concat();
    hostile.push(to_another);
    // FrameID, header and blocks cut short; 14 bytes are Ethernet's, 16 have the FrameID.
    let blocks_end = 14 + 12 + 4 + 2 + 5 + 1 + 4 + 2 + 4;
    hostile.extend((16..blocks_end).map(|cut| good[..cut].to_vec()));
    for frame in &hostile {
        search.handle_frame(Instant::ZERO, ETHERNET, frame);
    }
    assert_eq!(profinet(&search).counters().ignored, hostile.len() as u64);
    assert!(profinet(&search).devices().is_empty());
    // Cyclic data is on the cable, too, and is no answer; neither is a datagram at another port.
    search.handle_frame(Instant::ZERO, ETHERNET, &[&good[..14], &[0x80, 0x01, 0, 0]].concat());
    search.handle_frame(Instant::ZERO, Source { port: Port::Udp(PORT + 1), ..from_device(7) }, &good);
    assert_eq!(profinet(&search).counters().ignored, hostile.len() as u64);
    assert_eq!(ethernet_ip(&search).counters().ignored, 0);
    search.handle_frame(Instant::ZERO, from_device(7), &good);
    assert_eq!(ethernet_ip(&search).counters().ignored, 1);
    search.handle_frame(Instant::ZERO, ETHERNET, &good);
    assert_eq!(profinet(&search).devices().len(), 1);
}

#[test]
fn a_station_that_is_renamed_during_the_search_has_its_new_name() {
    let mac = Mac([2, 0, 0, 0, 0, 9]);
    let mut search = asking();
    search.handle_frame(Instant::ZERO, ETHERNET, &answer(mac, XID, b""));
    search.handle_frame(Instant::ZERO, ETHERNET, &answer(mac, XID, b"robot"));
    let names: Vec<_> = profinet(&search).devices().iter().map(|station| &*station.name).collect();
    assert_eq!(names, [b"robot"]);
    assert_eq!(profinet(&search).counters(), SearchCounters { repeated: 1, ..SearchCounters::default() });
}

#[test]
fn a_flood_of_forged_stations_takes_bounded_memory() {
    let mut search = asking();
    for number in 0..5_000_u16 {
        let [high, low] = number.to_be_bytes();
        search.handle_frame(Instant::ZERO, ETHERNET, &answer(Mac([2, 0, 0, 0, high, low]), XID, b"x"));
    }
    assert_eq!(profinet(&search).devices().len(), MOST_DEVICES);
    assert_eq!(profinet(&search).counters().surplus, 5_000 - MOST_DEVICES as u64);
}

#[test]
fn answers_after_the_end_are_ignored() {
    let mut search = asking();
    let end = Instant::ZERO + LENGTH;
    search.handle_timeout(end);
    assert_eq!((search.poll_event(), search.poll_event()), (Some(SearchEnded), None));
    assert_eq!(search.poll_timeout(), None);
    search.handle_frame(end, ETHERNET, &answer(Mac([2, 0, 0, 0, 0, 9]), XID, b"robot"));
    assert!(profinet(&search).devices().is_empty());
}

#[test]
fn a_link_of_two_hosts_is_asked_by_the_limited_broadcast_alone() {
    let mask = Ipv4Addr::new(255, 255, 255, 254);
    let config = ethernet_ip::SearchConfig::from_address(PORT, ADDRESS, mask, LENGTH);
    assert_eq!(config.to, [Ipv4Addr::BROADCAST]);
}

proptest! {
    #[test]
    fn no_bytes_on_any_port_make_the_search_panic_or_end_it(
        bytes in proptest::collection::vec(any::<u8>(), 0..200),
        behind_the_head in any::<bool>(),
        udp in any::<bool>(),
    ) {
        let mut search = asking();
        let head: &[u8] = match (behind_the_head, udp) {
            (false, _) => &[],
            (true, true) => &[0x63, 0, 40, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
            (true, false) => &[2, 0, 0, 0, 0, 1, 2, 0, 0, 0, 0, 9, 0x88, 0x92, 0xFE, 0xFF, 5, 1, 0xFF, 0xFF, 0xFF, 0xFF],
        };
        let from = if udp { from_device(9) } else { ETHERNET };
        search.handle_frame(Instant::ZERO, from, &[head, &bytes].concat());
        prop_assert_eq!(search.poll_timeout(), Some(Instant::ZERO + LENGTH / 4));
    }
}
