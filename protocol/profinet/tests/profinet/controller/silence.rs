//! What is reported of a device that does not answer, or whose answers come late or from elsewhere.

use machine::StationConflict;
use machine::ethernet::EthernetHeader;
use profinet::dcp::{self, Content, IpSuite, Pdu};
use profinet::status::{Service, Violation};

use super::peer::ethernet;
use super::*;

#[test]
fn a_device_that_comes_late_and_then_does_not_answer_calls_is_reported_3_s_after_the_start() {
    for (address_conflict, words) in [
        (false, "the device is there but does not answer calls"),
        (true, "the device does not answer calls, and"),
    ] {
        let script = PeerScript { silent: true, ..PeerScript::default() };
        let mut cell = Cell::new(Transport::Rt1, script);
        assert_eq!(cell.run(1_000), []);
        cell.peer.script = PeerScript { deaf_to_rpc: true, address_conflict, ..PeerScript::default() };
        cell.goes_down(2_000, &[(DownCause::NoAnswer, 0, words)]);
    }
}

#[test]
fn a_device_that_does_not_answer_when_its_address_is_set_is_reported_as_such() {
    let mut cell = Cell::new(Transport::Rt1, PeerScript { silent: true, ..PeerScript::default() });
    assert_eq!(cell.run(100), []);
    cell.peer.script = PeerScript { ignores_set: true, ..PeerScript::default() };
    cell.goes_down(2_900, &[(DownCause::NoAnswer, 0, "the device is there but does not answer when its IP")]);
}

#[test]
fn a_device_that_sends_no_data_is_reported_after_3_s_even_if_its_watchdog_takes_longer() {
    let config = ArConfig { cycle: Duration::from_millis(512), ..ar(Transport::Udp) };
    let mut cell = Cell::with(config, PeerScript { no_cyclic: true, ..PeerScript::default() });
    cell.goes_down(3_000, &[(DownCause::NoAnswer, 0, "the device is connected but sends no cyclic frames")]);
    cell.goes_down(
        8_000,
        &[(DownCause::Watchdog, 0xCF81_FD05, "the device is connected but sends no cyclic")],
    );
}

#[test]
fn another_reason_to_refuse_is_reported_again_and_silence_after_it_is_not() {
    let status = |violation: Violation| violation.status(Service::Connect);
    let mut cell = Cell::new(Transport::Udp, PeerScript::default());
    for violation in [Violation::OutOfArResources, Violation::ArUuidUnknown, Violation::OutOfArResources] {
        cell.peer.script.refuses_connect = Some(status(violation));
        cell.goes_down(10_000, &[(DownCause::Refused, status(violation).0, violation.text())]);
    }
    cell.peer.script.silent = true;
    assert_eq!(cell.run(20_000), []);
}

#[test]
fn a_controller_that_is_called_late_does_what_was_due() {
    let mut cell = Cell::new(Transport::Udp, PeerScript { silent: true, ..PeerScript::default() });
    assert_eq!((cell.run(0), cell.frames), (Vec::new(), 1));
    // It is due at 200, 450 and 700 ms.
    for (at, frames) in [(250, 2), (449, 2), (500, 3)] {
        cell.now = Instant::from_millis(at);
        cell.controller.handle_timeout(cell.now);
        cell.drain();
        assert_eq!(cell.frames, frames, "{at}");
    }
}

/// Returns an answer of this station to the last search on the cable.
fn found(cell: &Cell, from: Mac, address: Ipv4Addr) -> (Source, Vec<u8>) {
    let xid = |frame: &Vec<u8>| {
        let (_, payload) = EthernetHeader::parse(frame).ok()?;
        let pdu = Pdu::parse(payload).ok()?;
        (pdu.service == dcp::Service::IdentifyRequest).then_some(pdu.xid)
    };
    let xid = cell.tap.iter().rev().find_map(xid).unwrap();
    let mask = Ipv4Addr::new(255, 255, 255, 0);
    let identity = samples::DEVICE.identity;
    let blocks = [
        Content::NameOfStation(b"device").into(),
        Content::DeviceId { vendor: identity.vendor, device: identity.device }.into(),
        Content::Ip(IpSuite { address, mask, gateway: address }).into(),
    ];
    let (source, mut frame) = ethernet(|w| dcp::emit(w, dcp::Service::IdentifyResponse, xid, 0, blocks));
    frame[6..12].copy_from_slice(&from.0);
    (source, frame)
}

#[test]
fn an_answer_that_comes_after_the_search_was_given_up_neither_starts_a_connection_nor_sets_an_address() {
    for address in [DEVICE_ADDRESS, Ipv4Addr::UNSPECIFIED] {
        let mut cell = Cell::new(Transport::Rt1, PeerScript { silent: true, ..PeerScript::default() });
        assert_eq!(cell.run(10), []);
        let now = cell.now;
        cell.ar().disconnect(now);
        cell.goes_down(0, &[(DownCause::ClosedHere, 0, "")]);
        let frames = cell.frames;
        let late = found(&cell, DEVICE, address);
        cell.deliver(late);
        assert_eq!((cell.run(10_000), cell.frames), (Vec::new(), frames), "{address}");
    }
}

#[test]
fn a_second_station_of_the_name_does_not_end_a_connection() {
    let mut cell = Cell::new(Transport::Rt1, PeerScript::default());
    assert_eq!(cell.run(50), [LinkEvent::Up]);
    let second = found(&cell, Mac([2, 0, 0, 0, 0, 9]), DEVICE_ADDRESS);
    cell.deliver(second);
    let conflict = StationConflict::Name { device: DEVICE, ignored: Mac([2, 0, 0, 0, 0, 9]) };
    assert_eq!((cell.run(100), cell.controller.counters().foreign), (vec![LinkEvent::Conflict(conflict)], 1));
    let again = found(&cell, DEVICE, DEVICE_ADDRESS);
    cell.deliver(again);
    assert_eq!((cell.run(100), cell.controller.counters().foreign), (Vec::new(), 1));
}
