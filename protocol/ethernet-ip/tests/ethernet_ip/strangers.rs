//! Clients that do not own the outputs: none ends or changes the owner's connection, or takes a place that it needs.

use std::net::{Ipv4Addr, SocketAddrV4};

use ethernet_ip::cip::General;
use ethernet_ip::connection::{ConnectionType, OpenRequest};
use ethernet_ip::encapsulation::Command;
use ethernet_ip::{ENCAPSULATION_PORT, IO_PORT};
use machine::{Allowed, Duration, ForeignRequest, LinkEvent, Peer, Requested, Sender};

use crate::cell::{PLC, adapter_config};
use crate::client::{
    INPUT_ONLY_PATH, Rig, close_message, explicit, heartbeat, message, owner, parameters, peer,
};

const STRANGER: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 66);

/// Returns the address of host `index` of many.
const fn host(index: u8) -> Ipv4Addr {
    Ipv4Addr::new(192, 168, 64, 100 + index)
}

#[test]
fn sixteen_idle_sessions_of_one_host_or_of_two_leave_a_place_for_a_scanner() {
    for hosts in [1, 2] {
        let mut rig = Rig::new();
        for index in 0..16 {
            rig.client_from(host(index % hosts));
        }
        assert_eq!(rig.adapter.sessions(), 16);
        rig.start_good_scanner();
        rig.assert_good_scanner_is_served();
        assert_eq!(rig.adapter.sessions(), 16);
    }
}

#[test]
fn the_owner_keeps_its_session_and_gets_another_whoever_asks_for_one() {
    let mut rig = Rig::new();
    rig.start_good_scanner();
    for round in 0..100 {
        for index in 0..24 {
            rig.connect_from(host(index));
        }
        let _ = (round, rig.client_from(STRANGER));
        rig.advance(Duration::from_millis(1));
    }
    rig.client();
    rig.client();
    rig.assert_good_scanner_is_served();
}

#[test]
fn of_sixteen_hosts_with_a_session_each_the_oldest_gives_way_and_never_the_owner() {
    let mut rig = Rig::new();
    rig.start_good_scanner();
    let others: Vec<_> = (0..15).map(|index| rig.client_from(host(index)).stream).collect();
    for round in 0..3 {
        rig.advance(Duration::from_micros(10));
        rig.connect_from(host(20 + round));
    }
    assert_eq!(rig.closed, others[..3]);
    rig.client();
    assert_eq!(rig.adapter.sessions(), 16);
    rig.assert_good_scanner_is_served();
}

#[test]
fn a_forward_close_and_a_triad_of_another_host_do_not_touch_the_owners_connection() {
    let mut rig = Rig::new();
    rig.start_good_scanner();
    let stranger = rig.client_from(STRANGER);
    let triad = owner(0xFFFF).triad;
    let answer = rig.request(stranger, &close_message(triad, &[]));
    assert_eq!(answer.general, General::PrivilegeViolation);
    let report = ForeignRequest {
        from: Sender::Ip(STRANGER),
        what: Requested::End,
        owner: Some(Sender::Ip(PLC)),
        more: 0,
    };
    assert_eq!(rig.events.last(), Some(&LinkEvent::Foreign(report)));
    assert_eq!(rig.try_open(stranger, &owner(0xFFFF)), Err((1, 0x0106)), "the outputs have an owner");
    rig.assert_good_scanner_is_served();
}

#[test]
fn a_stranger_that_uses_the_triad_of_the_owner_first_does_not_keep_it_out() {
    let mut rig = Rig::new();
    let stranger = rig.client_from(STRANGER);
    rig.open(stranger, &OpenRequest { t_o_id: 7, ..heartbeat(0xFFFF, INPUT_ONLY_PATH) });
    rig.open(stranger, &explicit(0xFFFE));
    rig.start_good_scanner();
    rig.assert_good_scanner_is_served_beside(2);
    rig.request(stranger, &close_message(owner(0xFFFF).triad, &[]));
    rig.assert_good_scanner_is_served();
}

#[test]
fn a_stranger_that_takes_class_3_connections_leaves_one_for_others() {
    let mut rig = Rig::new();
    let stranger = rig.client_from(STRANGER);
    for serial in 1..100 {
        let _ = rig.try_open(stranger, &explicit(serial));
    }
    assert_eq!(rig.adapter.connections().1, 7);
    let client = rig.client();
    rig.open(client, &explicit(200));
}

#[test]
fn settings_that_would_hurt_the_owner_are_refused_to_others_while_it_is_there() {
    // QoS: scheduled priority and explicit messages; TCP/IP: inactivity timeout; Identity: reset.
    let requests: [&[u8]; 4] = [
        &[0x10, 3, 0x20, 0x48, 0x24, 1, 0x30, 5, 1],
        &[0x10, 3, 0x20, 0x48, 0x24, 1, 0x30, 8, 1],
        &[0x10, 3, 0x20, 0xF5, 0x24, 1, 0x30, 13, 1, 0],
        &[5, 2, 0x20, 1, 0x24, 1, 1],
    ];
    let mut rig = Rig::new();
    rig.start_good_scanner();
    let stranger = rig.client_from(STRANGER);
    for request in requests {
        let answer = rig.request(stranger, request);
        assert_eq!(answer.general, General::DeviceStateConflict, "{request:02X?}");
    }
    let report = ForeignRequest {
        from: Sender::Ip(STRANGER),
        what: Requested::Write,
        owner: Some(Sender::Ip(PLC)),
        more: 0,
    };
    assert!(rig.events.contains(&LinkEvent::Foreign(report)));
    let same = rig.request(stranger, &[0x10, 3, 0x20, 0xF5, 0x24, 1, 0x30, 13, 120, 0]);
    assert_eq!(same.general, General::Success, "what it is already");
    rig.assert_good_scanner_is_served();
    let own = rig.client();
    assert_eq!(rig.request(own, requests[0]).general, General::Success, "the owner may");

    let mut rig = Rig::new();
    let client = rig.client_from(STRANGER);
    // The last one is the reset, which ends the session.
    assert!(requests.iter().all(|request| rig.request(client, request).general == General::Success));
}

#[test]
fn an_owner_that_wants_a_faster_multicast_than_runs_gets_one_of_its_own() {
    let multicast = |request: OpenRequest<'static>, rpi_us| OpenRequest {
        t_o: parameters(ConnectionType::Multicast, 258),
        t_o_rpi_us: rpi_us,
        ..request
    };
    let group = |last| Some(SocketAddrV4::new(Ipv4Addr::new(239, 192, 1, last), IO_PORT));
    let mut rig = Rig::new();
    let stranger = rig.client_from(STRANGER);
    let unspecified = SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, 0);
    let slow = multicast(heartbeat(1, INPUT_ONLY_PATH), 1_000_000);
    assert_eq!(rig.open_to(stranger, &slow, unspecified).1, group(32));
    let client = rig.client();
    let (answer, to) = rig.open_to(client, &multicast(owner(2), 1_000), unspecified);
    assert_eq!((answer.general, to), (General::Success, group(33)));
    let fast = multicast(heartbeat(3, INPUT_ONLY_PATH), 1_000);
    assert_eq!(rig.open_to(stranger, &fast, unspecified).1, group(33), "and others may join it");
}

#[test]
fn broadcast_questions_of_many_hosts_with_long_delays_silence_nobody() {
    let mut rig = Rig::new();
    let mut question = message(Command::ListIdentity, 0, &[]);
    question[12..14].copy_from_slice(&u16::MAX.to_le_bytes());
    for index in 0..50 {
        rig.broadcast(ENCAPSULATION_PORT, peer(host(index), 40_000), &question);
    }
    rig.broadcast(ENCAPSULATION_PORT, peer(PLC, 40_000), &message(Command::ListIdentity, 0, &[]));
    rig.advance(Duration::from_secs(66));
    assert_eq!(rig.datagrams.len(), 51);
    assert!(rig.datagrams.iter().any(|(_, _, to, _)| *to == peer(PLC, 40_000)));
}

#[test]
fn an_adapter_with_a_list_of_originators_serves_these_alone() {
    let listed = Peer { address: Some(PLC), mac: None, serial_number: Some(0x0BAD_CAFE) };
    let mut rig =
        Rig::of(ethernet_ip::AdapterConfig { originators: Allowed(vec![listed]), ..adapter_config() });
    let refused = rig.connect_from(STRANGER);
    assert_eq!((rig.closed.last(), rig.adapter.sessions()), (Some(&refused), 0));
    let report =
        ForeignRequest { from: Sender::Ip(STRANGER), what: Requested::Connection, owner: None, more: 0 };
    assert_eq!(rig.events, [LinkEvent::Foreign(report)]);
    let client = rig.client();
    let mut other = owner(1);
    other.triad.originator_serial = 1;
    assert_eq!(rig.try_open(client, &other), Err((0x0F, 0)));
    rig.start_good_scanner();
    rig.assert_good_scanner_is_served();
}
