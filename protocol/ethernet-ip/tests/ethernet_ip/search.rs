//! A search for devices: whom it asks, and which answers it keeps.

use std::net::Ipv4Addr;

use ethernet_ip::discovery::emit_request;
use ethernet_ip::encapsulation::{Command, Header};
use ethernet_ip::{ENCAPSULATION_PORT, Search, SearchConfig};
use machine::search::SearchEnded;
use machine::wire::FRAME_CAPACITY;
use machine::{Duration, Instant, Machine, Port, PortRequest, Source};

use crate::cell::ROBOT;
use crate::client::{Rig, peer};

const LOCAL_PORT: u16 = 50_100;
const START: Instant = Instant::from_millis(5);
const LENGTH: Duration = Duration::from_secs(2);
const OTHER: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 9);

fn search() -> Search {
    let to = vec![Ipv4Addr::new(192, 168, 64, 255), Ipv4Addr::BROADCAST];
    Search::new(SearchConfig { local_port: LOCAL_PORT, to, length: LENGTH }, START)
}

/// Returns the sample device's answer, with this serial number.
fn identity(serial_number: u32) -> Vec<u8> {
    let mut request = [0; 64];
    let len = emit_request(&mut request, 500).unwrap();
    let mut answer = Rig::new().ask_udp(&request[..len]).pop().unwrap();
    // Behind the header come the count, the item's type, length and version, an address, and ten bytes of identity.
    answer[58..62].copy_from_slice(&serial_number.to_le_bytes());
    answer
}

fn receive(search: &mut Search, from: Ipv4Addr, frame: &[u8]) {
    let from = Source { port: Port::Udp(LOCAL_PORT), peer: Some(peer(from, ENCAPSULATION_PORT)) };
    search.handle_frame(START, from, frame);
}

/// Returns the address and the serial number of each device found, and the number of answers that were ignored.
fn found(search: &Search) -> (Vec<(Ipv4Addr, u32)>, u64) {
    let devices = search.answers().devices().iter();
    let devices = devices.map(|device| (device.address, device.identity.serial_number));
    (devices.collect(), search.answers().counters().ignored)
}

#[test]
fn a_search_asks_the_broadcast_of_its_subnet_where_there_is_one_and_the_limited_broadcast() {
    let asks = |mask: [u8; 4]| {
        let address = Ipv4Addr::new(192, 168, 64, 1);
        SearchConfig::from_address(LOCAL_PORT, address, mask.into(), LENGTH).to
    };
    let limited = Ipv4Addr::BROADCAST;
    assert_eq!(asks([255, 255, 255, 0]), [Ipv4Addr::new(192, 168, 64, 255), limited]);
    assert_eq!(asks([255, 255, 255, 252]), [Ipv4Addr::new(192, 168, 64, 3), limited], "two hosts");
    assert_eq!(asks([255, 255, 255, 254]), [limited], "two hosts without a broadcast (RFC 3021)");
    assert_eq!(asks([255, 255, 255, 255]), [limited]);
    assert_eq!(asks([0, 0, 0, 0]), [limited], "it is the broadcast of this subnet");
}

#[test]
fn a_search_sends_its_question_to_each_address_and_reports_its_end() {
    let mut search = search();
    assert_eq!(search.ports(), [PortRequest::Udp(LOCAL_PORT)]);
    let mut buf = vec![0; FRAME_CAPACITY];
    let mut asked = Vec::new();
    let mut ended = None;
    while let Some(now) = search.poll_timeout() {
        search.handle_timeout(now);
        while let Some(transmit) = search.poll_transmit(now, &mut buf) {
            let header = Header::parse(&buf[..transmit.len]).unwrap();
            assert_eq!(
                (header.command, transmit.len, transmit.port),
                (Command::ListIdentity, 24, Port::Udp(LOCAL_PORT))
            );
            // The devices spread their answers over a quarter of the search: MaxResponseDelay, in ms.
            assert_eq!(header.context, [0xF4, 1, 0, 0, 0, 0, 0, 0]);
            asked.push((now, transmit.to.unwrap()));
        }
        ended = ended.or(search.poll_event().map(|SearchEnded| now));
    }
    assert_eq!(asked.first().map(|(at, _)| *at), Some(START));
    let addresses: Vec<_> = asked.iter().map(|(_, to)| *to).collect();
    let both = [Ipv4Addr::new(192, 168, 64, 255), Ipv4Addr::BROADCAST].map(|to| peer(to, 44_818));
    assert_eq!(addresses, [both; 3].concat());
    assert_eq!(ended, Some(START + LENGTH));
}

#[test]
fn a_device_that_answers_again_is_one_and_two_that_share_an_address_are_two() {
    let mut search = search();
    for (from, serial_number) in [(ROBOT, 1), (ROBOT, 1), (ROBOT, 2), (OTHER, 1)] {
        receive(&mut search, from, &identity(serial_number));
    }
    assert_eq!(found(&search), (vec![(ROBOT, 1), (ROBOT, 2), (OTHER, 1)], 0));
}

#[test]
fn one_host_fills_eight_places_and_no_more_and_other_hosts_get_theirs() {
    let mut search = search();
    for serial_number in 1..=10 {
        receive(&mut search, ROBOT, &identity(serial_number));
    }
    // Known already, and of another host.
    receive(&mut search, ROBOT, &identity(8));
    receive(&mut search, OTHER, &identity(1));
    let mut expected: Vec<_> = (1..=8).map(|serial_number| (ROBOT, serial_number)).collect();
    expected.push((OTHER, 1));
    assert_eq!(found(&search), (expected, 2));
}

#[test]
fn only_answers_to_the_searchs_own_port_before_its_end_count() {
    let mut search = search();
    let from =
        |port, with_peer: bool| Source { port, peer: with_peer.then_some(peer(ROBOT, ENCAPSULATION_PORT)) };
    search.handle_frame(START, from(Port::Udp(LOCAL_PORT + 1), true), &identity(1));
    search.handle_frame(START, from(Port::Udp(LOCAL_PORT), false), &identity(1));
    receive(&mut search, ROBOT, &identity(1)[..40]);
    assert_eq!(found(&search), (vec![], 1), "half an answer is ignored");
    while let Some(now) = search.poll_timeout() {
        search.handle_timeout(now);
    }
    receive(&mut search, ROBOT, &identity(1));
    assert_eq!(found(&search), (vec![], 1));
}
