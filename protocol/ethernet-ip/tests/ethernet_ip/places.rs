//! Places of an adapter when all are taken: who gives way, and to whom.

use std::net::{Ipv4Addr, SocketAddrV4};

use ethernet_ip::IO_PORT;
use ethernet_ip::cip::General;
use ethernet_ip::connection::{ConnectionType, OpenRequest};
use ethernet_ip::encapsulation::Command;
use machine::{Allowed, Duration, Peer};

use crate::cell::{PLC, adapter_config, data};
use crate::client::{
    Client, INPUT_ONLY_PATH, LISTEN_ONLY_PATH, OWNER_PATH, Rig, close_message, explicit, heartbeat, message,
    owner, parameters,
};
use crate::hostile::VENDOR;

/// Returns the address of host `index` of many.
const fn host(index: u8) -> Ipv4Addr {
    Ipv4Addr::new(192, 168, 64, 100 + index)
}

/// Connects sixteen hosts, with a session each.
fn sixteen(rig: &mut Rig) -> Vec<Client> {
    (0..16).map(|index| rig.client_from(host(index))).collect()
}

/// Lets time pass while each client sends a NOP every half second, as the adapter allows.
fn hold(rig: &mut Rig, clients: &[Client], halves: u32) {
    for _ in 0..halves {
        for client in clients
            .iter()
            .filter(|client| rig.closed.iter().all(|closed| *closed != client.stream))
            .copied()
            .collect::<Vec<_>>()
        {
            rig.send(client.stream, &message(Command::Nop, 0, &[]));
        }
        rig.advance(Duration::from_millis(500));
    }
}

#[test]
fn an_owner_that_was_cut_off_gets_in_again_while_sixteen_hosts_hold_a_session_each() {
    // Also where the robot's list of PLCs has only their serial numbers.
    let listed = Peer { serial_number: Some(owner(1).triad.originator_serial), ..Peer::default() };
    for originators in [Allowed::default(), Allowed(vec![listed])] {
        let mut rig = Rig::of(ethernet_ip::AdapterConfig { originators, ..adapter_config() });
        let plc = rig.client();
        let opened = rig.open(plc, &owner(1));
        rig.io(PLC, opened.o_t_id, 1, Some(true), &data(1));
        let others = sixteen(&mut rig);
        // The cable is cut: the connection times out, and the others fill the place.
        hold(&mut rig, &others, 3);
        assert_eq!((rig.adapter.connections().0, rig.adapter.sessions()), (0, 15));
        rig.client_from(host(16));
        assert_eq!(rig.adapter.sessions(), 16);
        let again = rig.client();
        rig.open(again, &owner(2));
        // Nobody takes its place until it sends data.
        for index in 17..100 {
            rig.client_from(host(index));
        }
        assert_eq!(rig.request(again, VENDOR).general, General::Success);
    }
}

#[test]
fn a_scanner_that_never_was_there_gets_the_place_of_the_session_whose_last_request_is_oldest() {
    let mut rig = Rig::new();
    let others = sixteen(&mut rig);
    rig.advance(Duration::from_millis(1));
    // A NOP is not a request, which is why the second host gives way and not the third.
    assert_eq!(rig.request(others[0], VENDOR).general, General::Success);
    hold(&mut rig, &others, 4);
    rig.start_good_scanner();
    assert_eq!(rig.closed, [others[1].stream]);
    rig.assert_good_scanner_is_served();
}

/// Opens as many connections without outputs as the adapter has, each of a host of its own: 4 input-only, 4 listen-only and 8
/// of class 3.
fn full_of_connections(rig: &mut Rig) -> Vec<Client> {
    let clients = sixteen(rig);
    for (client, serial) in clients.iter().zip(100..) {
        let request = match serial - 100 {
            0..4 => heartbeat(serial, INPUT_ONLY_PATH),
            4..8 => heartbeat(serial, LISTEN_ONLY_PATH),
            _ => explicit(serial),
        };
        rig.open(*client, &request);
        rig.advance(Duration::from_micros(10));
    }
    assert_eq!(rig.adapter.connections(), (8, 8));
    clients
}

#[test]
fn where_each_session_carries_a_connection_that_of_an_input_only_one_gives_way_and_its_data_go_on() {
    let mut rig = Rig::new();
    let clients = full_of_connections(&mut rig);
    rig.start_good_scanner();
    assert_eq!(rig.closed, [clients[0].stream]);
    rig.assert_good_scanner_is_served_beside(9);
    let to_first = SocketAddrV4::new(host(0), IO_PORT);
    assert!(rig.datagrams.iter().any(|(_, _, to, _)| *to == to_first));
}

#[test]
fn the_owner_gets_a_class_3_an_input_only_and_a_listen_only_connection_in_place_of_the_most_silent_one() {
    for kind in 0..3 {
        let request = |serial| match kind {
            0 => explicit(serial),
            1 => heartbeat(serial, INPUT_ONLY_PATH),
            _ => heartbeat(serial, LISTEN_ONLY_PATH),
        };
        let mut rig = Rig::new();
        let clients = full_of_connections(&mut rig);
        let stranger = rig.client_from(host(30));
        let refused = rig.try_open(stranger, &request(200));
        assert!(
            matches!(refused, Err((1, 0x0113 | 0x011A))),
            "{kind}: another host has no right: {refused:?}"
        );
        let plc = rig.client();
        rig.open(plc, &owner(1));
        let before = rig.adapter.connections();
        rig.open(plc, &request(2));
        assert_eq!(rig.adapter.connections(), before, "one for one");
        // The first of its kind; its TCP connection ends, where that is there.
        let first = [8, 0, 4][kind];
        let triad = request(100 + first as u16).triad;
        let other = rig.client_from(host(first as u8));
        let closed = rig.request(other, &close_message(triad, &[]));
        assert_eq!(closed.status(), (1, 0x0107), "{kind}: it is closed already");
        assert!(kind == 1 || rig.closed.contains(&clients[first].stream), "{kind}");
    }
}

#[test]
fn the_last_owner_keeps_its_right_for_two_minutes_and_only_while_nobody_else_owns_the_outputs() {
    const JUST: Duration = Duration::from_secs(119);
    for (silent_for, other_owns, gets_in) in
        [(JUST, false, true), (Duration::from_secs(121), false, false), (JUST, true, false)]
    {
        let mut rig = Rig::new();
        let plc = rig.client();
        rig.open(plc, &owner(1));
        rig.request(plc, &close_message(owner(1).triad, OWNER_PATH));
        rig.hang_up(plc.stream);
        rig.advance(silent_for);
        if other_owns {
            let other = rig.client_from(host(40));
            rig.open(other, &OpenRequest { o_t_rpi_us: 1_000_000, ..owner(7) });
        }
        for index in 0..8 {
            let other = rig.client_from(host(index));
            rig.open(other, &explicit(100 + u16::from(index)));
        }
        let plc = rig.client();
        let opened = rig.try_open(plc, &explicit(2)).map(drop);
        let expected = if gets_in { Ok(()) } else { Err((1, 0x0113)) };
        assert_eq!(opened, expected, "after {silent_for:?}, another owner: {other_owns}");
    }
}

#[test]
fn a_multicast_goes_on_for_the_owner_that_took_the_place_of_its_first_taker() {
    let multicast = |request: OpenRequest<'static>| OpenRequest {
        t_o: parameters(ConnectionType::Multicast, 258),
        ..request
    };
    let mut rig = Rig::new();
    for index in 0..4 {
        let client = rig.client_from(host(index));
        let request = heartbeat(100 + u16::from(index), INPUT_ONLY_PATH);
        // The first one alone takes the multicast.
        rig.open(client, &if index == 0 { multicast(request) } else { request });
        rig.advance(Duration::from_micros(10));
    }
    let plc = rig.client();
    rig.open(plc, &owner(1));
    rig.open(plc, &multicast(heartbeat(2, INPUT_ONLY_PATH)));
    rig.datagrams.clear();
    rig.advance(Duration::from_millis(5));
    let sent = rig.datagrams.iter().filter(|(_, _, to, _)| to.ip().is_multicast());
    assert!((4..=5).contains(&sent.count()));
}
