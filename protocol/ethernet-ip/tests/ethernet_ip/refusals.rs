//! Which connections an adapter opens, which it refuses, and how the scanner tells its owner.
//!
//! In one file, because all of its short tests begin with the same set-up of a request.

use std::net::{Ipv4Addr, SocketAddrV4};

use crate::samples::{CONSUMED, DEVICE, PRODUCED};
use crate::single_connection::{SCANNER, SingleConnection};
use ethernet_ip::cip::{ElectronicKey, General, Path, Revision};
use ethernet_ip::connection::{ConnectionType, OpenReply, OpenRequest, Parameters, Priority, Transport};
use ethernet_ip::description::Description;
use ethernet_ip::{ConnectionConfig, IO_PORT, ScannerConfig};
use machine::{DownCause, LinkEvent};
use machine::{Duration, Machine};
use virtual_time::Event;

use crate::cell::{PLC, ROBOT, bus_of, cable, run, up, wanted};
use crate::client::{
    INPUT_ONLY_PATH, LISTEN_ONLY_PATH, OWNER_PATH, Rig, close_message, explicit, heartbeat, open_message,
    owner, parameters, peer,
};

const OTHER: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 7);

/// Returns a request for a new connection that is wrong in one way.
fn wrong(change: impl FnOnce(&mut OpenRequest<'static>)) -> OpenRequest<'static> {
    let mut request = owner(0x77);
    change(&mut request);
    request
}

#[test]
fn each_violation_of_a_forward_open_gives_its_extended_status() {
    // Longer than a screen, because it is one table of cases.
    use ConnectionType::{Multicast, Null, PointToPoint, Reserved};
    let path = |path: &'static [u8]| wrong(|r| r.path = Path(path));
    let heart = |change: fn(&mut OpenRequest<'static>)| {
        let mut request = heartbeat(0x77, INPUT_ONLY_PATH);
        change(&mut request);
        request
    };
    let class_3 = |change: fn(&mut OpenRequest<'static>)| {
        let mut request = explicit(0x77);
        change(&mut request);
        request
    };
    let cases: &[(u16, &str, OpenRequest<'static>)] = &[
        (0x0112, "O→T interval 0", wrong(|r| r.o_t_rpi_us = 0)),
        (0x0112, "T→O interval 0", wrong(|r| r.t_o_rpi_us = 0)),
        (0x0112, "T→O interval u32::MAX", wrong(|r| r.t_o_rpi_us = u32::MAX)),
        (0x0112, "499 µs", wrong(|r| r.t_o_rpi_us = 499)),
        (0x0111, "class 3, interval 0", class_3(|r| r.o_t_rpi_us = 0)),
        (0x0114, "vendor", path(b"\x34\x04\x01\x00\0\0\0\0\0\0\x20\x04\x24\x97\x2C\x96\x2C\x64")),
        (0x0114, "product code", path(b"\x34\x04\0\0\0\0\x09\0\0\0\x20\x04\x24\x97\x2C\x96\x2C\x64")),
        (0x0115, "device type", path(b"\x34\x04\0\0\x0C\0\0\0\0\0\x20\x04\x24\x97\x2C\x96\x2C\x64")),
        (0x0116, "major revision", path(b"\x34\x04\0\0\0\0\0\0\x02\x01\x20\x04\x24\x97\x2C\x96\x2C\x64")),
        (0x0116, "minor revision", path(b"\x34\x04\0\0\0\0\0\0\x01\x02\x20\x04\x24\x97\x2C\x96\x2C\x64")),
        (0x0116, "newer revision", path(b"\x34\x04\0\0\0\0\0\0\x81\x02\x20\x04\x24\x97\x2C\x96\x2C\x64")),
        (0x0117, "class that has no connections", path(&[0x20, 1, 0x24, 1])),
        (0x0119, "listen-only alone", heartbeat(0x77, LISTEN_ONLY_PATH)),
        (0x011B, "10 ms inhibit time at 1 ms", path(&[0x43, 10, 0x20, 4, 0x2C, 150, 0x2C, 100])),
        (0x011C, "class 0", wrong(|r| r.transport = Transport(0x00))),
        (0x011C, "class 2", wrong(|r| r.transport = Transport(0x02))),
        (0x011D, "trigger 3", wrong(|r| r.transport = Transport(0x31))),
        (0x011D, "class 3, trigger 3", class_3(|r| r.transport = Transport(0xB3))),
        (0x011E, "class 3, target as client", class_3(|r| r.transport = Transport(0x23))),
        (0x011F, "O→T variable", wrong(|r| r.o_t.variable = true)),
        (0x0120, "T→O variable", wrong(|r| r.t_o.variable = true)),
        (0x0121, "class 3, urgent O→T", class_3(|r| r.o_t.priority = Priority::Urgent)),
        (0x0122, "class 3, urgent T→O", class_3(|r| r.t_o.priority = Priority::Urgent)),
        (0x0123, "O→T multicast", wrong(|r| r.o_t.kind = Multicast)),
        (0x0123, "O→T reserved", wrong(|r| r.o_t.kind = Reserved)),
        (0x0123, "O→T null alone", wrong(|r| r.o_t.kind = Null)),
        (0x0124, "T→O reserved", wrong(|r| r.t_o.kind = Reserved)),
        (0x0124, "T→O null alone", wrong(|r| r.t_o.kind = Null)),
        (0x0124, "class 3, T→O multicast", class_3(|r| r.t_o.kind = Multicast)),
        (0x0125, "redundant owner", wrong(|r| r.o_t.redundant_owner = true)),
        (0x0126, "configuration data", path(b"\x20\x04\x24\x97\x2C\x96\x2C\x64\x80\x01\0\0")),
        (0x0127, "O→T 261 bytes", wrong(|r| r.o_t.size = 261)),
        (0x0127, "heartbeat with data", heart(|r| r.o_t = parameters(PointToPoint, 10))),
        (0x0127, "class 3, 1 byte", class_3(|r| r.o_t.size = 1)),
        (0x0128, "T→O 0 bytes", wrong(|r| r.t_o.size = 0)),
        (0x0128, "T→O 511 bytes", wrong(|r| r.t_o.size = 511)),
        (0x0129, "configuration assembly 9", path(&[0x20, 4, 0x24, 9, 0x2C, 150, 0x2C, 100])),
        (0x012A, "O→T assembly 9", path(&[0x20, 4, 0x24, 151, 0x2C, 9, 0x2C, 100])),
        (0x012A, "no assembly at all", path(&[0x20, 4])),
        (0x012B, "T→O assembly 9", path(&[0x20, 4, 0x24, 151, 0x2C, 150, 0x2C, 9])),
        (0x012B, "one assembly", path(&[0x20, 4, 0x2C, 150])),
        (0x012F, "assemblies swapped", path(&[0x20, 4, 0x24, 151, 0x2C, 100, 0x2C, 150])),
        (0x012F, "configuration in O→T's place", path(&[0x20, 4, 0x24, 150, 0x2C, 151, 0x2C, 100])),
        (0x012F, "four assemblies", path(&[0x20, 4, 0x24, 151, 0x2C, 150, 0x2C, 100, 0x2C, 100])),
        (0x0133, "multiplier 8", wrong(|r| r.multiplier = 8)),
        (0x0133, "multiplier 255", wrong(|r| r.multiplier = 255)),
        (0x0311, "out of a port", path(&[1, 0, 0x20, 4, 0x24, 151, 0x2C, 150, 0x2C, 100])),
        (0x0315, "an unknown segment", path(&[0xE0, 0, 0x20, 4])),
        (0x0315, "a key of format 9", path(&[0x34, 9, 0, 0, 0, 0, 0, 0, 0, 0])),
        (0x0315, "a safety segment", path(&[0x50, 1, 0, 0, 0x20, 4, 0x2C, 150, 0x2C, 100])),
        (0x0315, "a symbol", path(&[0x91, 2, b'a', b'b'])),
    ];
    let mut rig = Rig::new();
    let client = rig.client();
    for (expected, what, request) in cases {
        assert_eq!(rig.try_open(client, request), Err((1, *expected)), "{what}");
        assert_eq!(rig.adapter.connections(), (0, 0), "{what}");
    }
    assert!(rig.try_open(client, &owner(1)).is_ok(), "and then a good one opens");
}

#[test]
fn a_refusal_names_the_connection_and_the_size_that_would_do() {
    let mut rig = Rig::new();
    let client = rig.client();
    let answer = rig.request(client, &open_message(&wrong(|r| r.o_t.size = 100), false));
    assert_eq!(answer.additional, [0x0127, 262]);
    assert_eq!(answer.data, b"\x77\0\x01\0\xFE\xCA\xAD\x0B\0\0");
    let answer = rig.request(client, &open_message(&wrong(|r| r.t_o.size = 100), false));
    assert_eq!(answer.additional, [0x0128, 258]);
}

#[test]
fn a_refused_interval_is_followed_by_the_limit_of_each_direction() {
    let mut rig = Rig::new();
    let client = rig.client();
    let limits = |rig: &mut Rig, request: &OpenRequest<'static>| {
        rig.request(client, &open_message(request, false)).additional
    };
    // Kind of limit O→T and T→O: 0 none, 2 least, 3 most. Then both intervals in µs, low word first.
    let short = wrong(|r| (r.o_t_rpi_us, r.t_o_rpi_us) = (499, 499));
    assert_eq!(limits(&mut rig, &short), [0x0112, 0x0202, 500, 0, 500, 0]);
    let long = wrong(|r| r.t_o_rpi_us = 10_000_001);
    assert_eq!(limits(&mut rig, &long), [0x0112, 0x0300, 0, 0, 0x9680, 0x98]);
    rig.open(client, &multicast(1, INPUT_ONLY_PATH));
    let faster = OpenRequest { t_o_rpi_us: 500, ..multicast(2, INPUT_ONLY_PATH) };
    assert_eq!(limits(&mut rig, &faster), [0x0112, 0x0200, 0, 0, 1_000, 0], "the interval of the multicast");
}

#[test]
fn a_refusal_of_the_route_tells_how_much_of_the_path_is_left_and_no_other_refusal_does() {
    let mut rig = Rig::new();
    let client = rig.client();
    let left = |rig: &mut Rig, path: &'static [u8], large| {
        let request = wrong(|r| r.path = Path(path));
        rig.request(client, &open_message(&request, large)).data[8..].to_vec()
    };
    for large in [false, true] {
        assert_eq!(left(&mut rig, &[1, 0, 0x20, 4, 0x24, 151, 0x2C, 150, 0x2C, 100], large), [5, 0]);
        assert_eq!(left(&mut rig, &[0xE0, 0, 0x20, 4], large), [2, 0]);
        assert_eq!(left(&mut rig, &[0x20, 4, 0x24, 151, 0x2C, 9, 0x2C, 100], large), [0, 0]);
    }
}

#[test]
fn a_forward_open_with_a_wrong_path_size_is_refused() {
    let mut rig = Rig::new();
    let client = rig.client();
    let good = open_message(&owner(1), false);
    let size_at = good.len() - OWNER_PATH.len() - 1;
    for (words, general) in [(3, 0x15), (5, 0x13), (255, 0x13)] {
        let mut message = good.clone();
        message[size_at] = words;
        assert_eq!(rig.request(client, &message).status().0, general, "{words} words");
    }
}

#[test]
fn the_same_forward_open_twice_is_refused_until_the_first_one_is_closed() {
    let mut rig = Rig::new();
    let client = rig.client();
    let first = rig.open(client, &owner(1));
    assert_eq!(rig.try_open(client, &owner(1)), Err((1, 0x0100)));
    assert_eq!(rig.try_open(client, &explicit(1)), Err((1, 0x0100)));
    assert_eq!(rig.try_open(client, &owner(2)), Err((1, 0x0106)));
    rig.request(client, &close_message(owner(1).triad, OWNER_PATH));
    let second = rig.open(client, &owner(1));
    assert_ne!(first.o_t_id, second.o_t_id, "a late frame of the first must not reach the second");
}

#[test]
fn every_shape_of_a_path_that_peers_send_is_understood() {
    let paths: [&'static [u8]; 6] = [
        OWNER_PATH,
        &[0x20, 4, 0x2C, 150, 0x2C, 100],
        &[0x20, 4, 0x24, 151, 0x24, 150, 0x24, 100],
        &[0x21, 0, 4, 0, 0x25, 0, 151, 0, 0x2D, 0, 150, 0, 0x2D, 0, 100, 0],
        &[0x20, 4, 0x24, 151, 0x20, 4, 0x2C, 150, 0x20, 4, 0x2C, 100],
        b"\x34\x04\xFF\xFF\x2B\0\x01\0\x81\x01\x20\x04\x24\x97\x2C\x96\x2C\x64\x80\x00",
    ];
    for path in paths {
        for large in [false, true] {
            let mut rig = Rig::new();
            let client = rig.client();
            let answer = rig.request(client, &open_message(&wrong(|r| r.path = Path(path)), large));
            assert_eq!(answer.general, General::Success, "{path:02X?}");
        }
    }
}

#[test]
fn the_reply_reports_the_packet_intervals_that_are_served() {
    let mut rig = Rig::new();
    let client = rig.client();
    let opened = rig.open(client, &wrong(|r| (r.o_t_rpi_us, r.t_o_rpi_us) = (2_500, 777)));
    assert_eq!(
        (opened.o_t_api_us, opened.t_o_api_us, opened.t_o_id),
        (2_500, 777, 0x4000_FFFF & owner(0x77).t_o_id)
    );
    rig.advance(Duration::from_millis(8));
    let sent: Vec<_> = rig.datagrams.iter().map(|(at, ..)| *at).collect();
    assert!(
        sent.len() == 10 && sent.windows(2).all(|pair| pair[1].since(pair[0]) == Duration::from_micros(777))
    );
}

#[test]
fn a_null_forward_open_finds_the_device_and_opens_nothing() {
    let mut rig = Rig::new();
    let client = rig.client();
    let mut null = owner(5);
    null.o_t = parameters(ConnectionType::Null, 0);
    null.t_o = null.o_t;
    let opened = rig.open(client, &null);
    assert_eq!((opened.triad, rig.adapter.connections()), (null.triad, (0, 0)));
    let ping = OpenRequest { path: Path(&[0x20, 1, 0x24, 1]), ..null };
    assert_eq!(
        rig.try_open(client, &ping).map(|opened| opened.triad),
        Ok(null.triad),
        "a ping names the Identity"
    );
    let second = OpenRequest { path: Path(&[0x20, 1, 0x24, 2]), ..null };
    assert_eq!(rig.try_open(client, &second), Err((1, 0x0132)), "there is one Identity");
    assert_eq!(rig.adapter.connections(), (0, 0));
    assert_eq!(
        rig.try_open(client, &OpenRequest { path: Path(&[0x20, 0x66, 0x24, 1]), ..null }),
        Err((1, 0x0132))
    );
    // On an open connection it changes nothing, and the connection goes on.
    rig.open(client, &owner(5));
    rig.open(client, &null);
    assert_eq!(rig.adapter.connections(), (1, 0));
}

#[test]
fn input_only_and_listen_only_connections_get_the_inputs_beside_the_owner() {
    let mut rig = Rig::new();
    rig.adapter.set_produced(PRODUCED, &[7; 256]).unwrap();
    let client = rig.client();
    rig.open(client, &owner(1));
    let viewer = rig.client_from(OTHER);
    rig.open(viewer, &heartbeat(2, INPUT_ONLY_PATH));
    rig.open(viewer, &heartbeat(3, LISTEN_ONLY_PATH));
    rig.datagrams.clear();
    rig.advance(Duration::from_micros(1_500));
    let to: Vec<_> = rig.datagrams.iter().map(|(_, _, to, bytes)| (*to.ip(), bytes[20])).collect();
    assert_eq!(to, [(PLC, 7), (OTHER, 7), (OTHER, 7)]);
}

#[test]
fn a_heartbeat_without_data_keeps_a_connection_alive_and_its_lack_ends_it() {
    let mut rig = Rig::new();
    let client = rig.client();
    let opened = rig.open(client, &heartbeat(1, INPUT_ONLY_PATH));
    for sequence in 1..100 {
        rig.io(PLC, opened.o_t_id, sequence, None, &[]);
        rig.advance(Duration::from_millis(15));
    }
    assert_eq!(rig.adapter.connections(), (1, 0));
    rig.advance(Duration::from_millis(2));
    assert_eq!(rig.adapter.connections(), (0, 0));
}

#[test]
fn listen_only_connections_end_with_the_last_other_one() {
    let mut rig = Rig::new();
    let client = rig.client();
    rig.open(client, &owner(1));
    rig.open(client, &heartbeat(2, LISTEN_ONLY_PATH));
    rig.open(client, &heartbeat(3, INPUT_ONLY_PATH));
    rig.request(client, &close_message(owner(1).triad, &[]));
    assert_eq!(rig.adapter.connections(), (2, 0));
    rig.request(client, &close_message(owner(3).triad, &[]));
    assert_eq!(rig.adapter.connections(), (0, 0));
}

fn multicast(serial: u16, path: &'static [u8]) -> OpenRequest<'static> {
    let t_o = parameters(ConnectionType::Multicast, 258);
    OpenRequest { t_o, multiplier: 7, ..heartbeat(serial, path) }
}

#[test]
fn a_multicast_is_sent_once_for_all_and_goes_on_without_a_gap_when_its_first_taker_leaves() {
    let mut rig = Rig::new();
    let client = rig.client();
    let mut opened = Vec::new();
    for serial in 1..=3 {
        let request = multicast(serial, INPUT_ONLY_PATH);
        let (answer, socket) =
            rig.open_to(client, &request, SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, IO_PORT));
        assert_eq!(socket, Some(peer(Ipv4Addr::new(239, 192, 1, 32), IO_PORT)));
        opened.push(OpenReply::parse(&answer.data).unwrap());
    }
    assert!(opened.iter().all(|o| o.t_o_id == opened[0].t_o_id && o.t_o_id != owner(1).t_o_id));
    rig.advance(Duration::from_micros(2_500));
    rig.request(client, &close_message(owner(1).triad, &[]));
    rig.advance(Duration::from_millis(2));
    let sequences: Vec<_> = rig.datagrams.iter().map(|(.., bytes)| bytes[10]).collect();
    assert_eq!(sequences, [1, 2, 3, 4]);
    assert!(rig.datagrams.iter().all(|(_, _, to, _)| *to.ip() == Ipv4Addr::new(239, 192, 1, 32)));
}

#[test]
fn a_connection_that_does_not_fit_the_running_multicast_or_is_off_the_subnet_is_refused() {
    let mut rig = Rig::new();
    let client = rig.client();
    rig.open(client, &multicast(1, INPUT_ONLY_PATH));
    let fits = multicast(2, INPUT_ONLY_PATH);
    let t_o = Parameters { priority: Priority::High, ..fits.t_o };
    assert_eq!(rig.try_open(client, &OpenRequest { t_o, ..fits }), Err((1, 0x0136)));
    assert_eq!(rig.try_open(client, &OpenRequest { transport: Transport(0x11), ..fits }), Err((1, 0x0138)));
    assert_eq!(rig.try_open(client, &OpenRequest { t_o_rpi_us: 500, ..fits }), Err((1, 0x0112)));
    // A production inhibit time of 1 ms, where the multicast has none.
    let path = Path(&[0x43, 1, 0x20, 4, 0x24, 151, 0x2C, 152, 0x2C, 100]);
    assert_eq!(rig.try_open(client, &OpenRequest { path, ..fits }), Err((1, 0x0139)));
    assert_eq!(rig.open(client, &OpenRequest { t_o_rpi_us: 4_000, ..fits }).t_o_api_us, 1_000);
    let far = rig.client_from(Ipv4Addr::new(10, 0, 0, 1));
    assert_eq!(rig.try_open(far, &multicast(3, INPUT_ONLY_PATH)), Err((1, 0x0813)));
}

#[test]
fn no_two_multicasts_that_run_at_a_time_have_one_group() {
    let mut rig = Rig::new();
    let client = rig.client();
    let group_of = |rig: &mut Rig, request: &OpenRequest<'static>| {
        let (answer, socket) =
            rig.open_to(client, request, SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, IO_PORT));
        assert_eq!(answer.general, General::Success);
        *socket.unwrap().ip()
    };
    let owner_at = |serial, rpi_us, priority| {
        let t_o = Parameters { priority, ..parameters(ConnectionType::Multicast, 258) };
        OpenRequest { t_o, t_o_rpi_us: rpi_us, multiplier: 7, ..owner(serial) }
    };
    let first = group_of(&mut rig, &multicast(1, INPUT_ONLY_PATH));
    let second = group_of(&mut rig, &owner_at(2, 500, Priority::Scheduled));
    // Takes part in the owner's, and keeps it when the owner leaves.
    let heir = OpenRequest { t_o_rpi_us: 500, ..multicast(3, INPUT_ONLY_PATH) };
    assert_eq!(group_of(&mut rig, &heir), second);
    rig.request(client, &close_message(owner(2).triad, &[]));
    let third = group_of(&mut rig, &owner_at(4, 500, Priority::High));
    assert_eq!([first, second, third].map(|group| group.octets()[3]), [32, 33, 34]);
    rig.request(client, &close_message(owner(1).triad, &[]));
    rig.request(client, &close_message(owner(4).triad, &[]));
    assert_eq!(group_of(&mut rig, &owner_at(5, 500, Priority::High)), first, "which is free again");
}

#[test]
fn input_only_connections_are_as_many_as_described_and_the_last_one_is_for_another_host() {
    let mut rig = Rig::new();
    let client = rig.client();
    let other = rig.client_from(ROBOT);
    for serial in 1..=3 {
        rig.open(client, &heartbeat(serial, INPUT_ONLY_PATH));
    }
    assert_eq!(rig.try_open(client, &heartbeat(4, INPUT_ONLY_PATH)), Err((1, 0x011A)));
    rig.open(other, &heartbeat(4, INPUT_ONLY_PATH));
    assert_eq!(rig.try_open(other, &heartbeat(5, INPUT_ONLY_PATH)), Err((1, 0x011A)));
    for serial in 11..=17 {
        rig.open(client, &explicit(serial));
    }
    assert_eq!(rig.try_open(client, &explicit(18)), Err((1, 0x0113)), "the last place is for another host");
    rig.open(other, &explicit(18));
    assert_eq!(rig.try_open(other, &explicit(19)), Err((1, 0x0113)));
    assert!(rig.try_open(client, &owner(20)).is_ok());
}

#[test]
fn t_o_data_goes_to_the_port_that_the_originator_names() {
    let mut rig = Rig::new();
    let client = rig.client();
    let (answer, _) = rig.open_to(client, &owner(1), SocketAddrV4::new(Ipv4Addr::UNSPECIFIED, 50_222));
    assert_eq!(answer.general, General::Success);
    rig.advance(Duration::from_micros(1_100));
    assert_eq!(rig.datagrams.last().unwrap().2, peer(PLC, 50_222));
}

#[test]
fn a_connection_that_follows_changes_sends_them_at_once_but_not_within_its_inhibit_time() {
    let mut rig = Rig::new();
    let client = rig.client();
    let path = Path(&[0x43, 2, 0x20, 4, 0x2C, 150, 0x2C, 100]);
    let request = OpenRequest { path, t_o_rpi_us: 20_000, transport: Transport(0x11), ..owner(1) };
    rig.open(client, &request);
    let start = rig.now;
    for change in 1..=10 {
        rig.advance(Duration::from_micros(700));
        rig.adapter.set_produced(PRODUCED, &[change; 256]).unwrap();
        rig.settle();
    }
    rig.advance(Duration::from_millis(30));
    let sent: Vec<_> =
        rig.datagrams.iter().map(|(at, .., bytes)| (at.since(start).as_micros(), bytes[20])).collect();
    assert_eq!(sent, [(700, 1), (2_700, 3), (4_700, 6), (6_700, 9), (8_700, 10), (28_700, 10)]);
    // The last frame repeats the data: its number is new, its sequence count is not.
    let numbers: Vec<_> = rig.datagrams.iter().map(|(.., bytes)| (bytes[10], bytes[18])).collect();
    assert_eq!(numbers, [(1, 1), (2, 2), (3, 3), (4, 4), (5, 5), (6, 5)]);
}

#[test]
fn the_owner_loses_its_outputs_only_after_ten_seconds_if_it_never_sends() {
    let mut rig = Rig::new();
    let client = rig.client();
    rig.open(client, &owner(1));
    rig.advance(Duration::from_millis(9_999));
    assert_eq!(rig.try_open(client, &owner(2)), Err((1, 0x0106)));
    rig.advance(Duration::from_millis(1));
    rig.adapter.handle_timeout(rig.now);
    rig.settle();
    let client = rig.client();
    rig.open(client, &owner(3));
}

#[test]
fn outputs_are_free_again_when_their_owner_timed_out() {
    let mut rig = Rig::new();
    let client = rig.client();
    let opened = rig.open(client, &owner(1));
    rig.io(PLC, opened.o_t_id, 1, Some(true), &[1; 256]);
    assert_eq!(rig.events, [LinkEvent::Up]);
    rig.advance(Duration::from_millis(17));
    assert!(matches!(rig.events[1], LinkEvent::Down(down) if down.cause == DownCause::Watchdog));
    let client = rig.client();
    let opened = rig.open(client, &owner(2));
    rig.io(PLC, opened.o_t_id, 1, Some(true), &[2; 256]);
    assert_eq!(rig.adapter.consumed(CONSUMED), Some(&[2; 256][..]));
}

/// Returns how the scanner describes a refusal.
fn refusal_text(config: ConnectionConfig) -> String {
    let mut bus = bus_of(config, cable(), 1);
    let events = run(&mut bus, 100);
    assert!(
        matches!(events[..], [(_, Event::A(LinkEvent::Down(down)))] if down.cause == DownCause::Refused),
        "{events:?}"
    );
    bus.a().connection().refusal().unwrap().to_string()
}

#[test]
fn a_refused_scanner_says_in_words_why_and_what_the_device_has_instead() {
    let key = ElectronicKey { revision: Revision { major: 3, minor: 1 }, ..DEVICE.key() };
    let all = [
        refusal_text(ConnectionConfig { consumed: 99, ..wanted() }),
        refusal_text(ConnectionConfig { o_t_size: 100, ..wanted() }),
        refusal_text(ConnectionConfig { t_o_size: 600, ..wanted() }),
        refusal_text(ConnectionConfig { t_o_rpi_us: 100, ..wanted() }),
        refusal_text(ConnectionConfig { key: Some(key), ..wanted() }),
        refusal_text(ConnectionConfig { configuration: Some(3), key: None, ..wanted() }),
        refusal_text(ConnectionConfig { route: vec![1, 0], ..wanted() }),
    ];
    insta::assert_snapshot!(all.join("\n"), @r"
    the adapter 192.168.64.2 refused the connection: there is no such O to T assembly (general status 0x01, extended status 0x012A); asked for O→T assembly 99 and T→O assembly 100 with configuration assembly 151; by its EDS file the device has the assemblies 100 for T→O (256 bytes), 150 for O→T (256 bytes), 151 for configuration, 152 for O→T of input-only connections, 153 for O→T of listen-only connections; name assemblies of the device's EDS file, each in its place
    the adapter 192.168.64.2 refused the connection: the O to T size is not the assembly's (general status 0x01, extended status 0x0127); asked for 100 bytes of data O→T to assembly 150 (connection size 106); the device has 256 bytes of data (connection size 262 with sequence count and header); give the device's bytes of data for that direction; a difference of 4 is another real-time format
    the adapter 192.168.64.2 refused the connection: the T to O size is not the assembly's (general status 0x01, extended status 0x0128); asked for 600 bytes of data T→O from assembly 100 (connection size 602); the device has 256 bytes of data (connection size 258 with sequence count and header); give the device's bytes of data for that direction; a difference of 4 is another real-time format
    the adapter 192.168.64.2 refused the connection: the requested packet intervals are not acceptable (general status 0x01, extended status 0x0112); asked for a packet every 1000 µs O→T and every 100 µs T→O; the device would take this interval O→T and at least 500 µs T→O; by its EDS file the device serves 500 to 10000000 µs; ask for another packet interval
    the adapter 192.168.64.2 refused the connection: the electronic key does not fit the device (general status 0x25); asked for vendor 65535, device type 43, product code 1, revision 3.1; the device is vendor 65535, device type 43, product code 1, revision 1.1, serial number 0x12345678; give the key of the device that is there, or connect the device of the key
    the adapter 192.168.64.2 refused the connection: there is no such configuration assembly (general status 0x01, extended status 0x0129); asked for O→T assembly 150 and T→O assembly 100 with configuration assembly 3; by its EDS file the device has the assemblies 100 for T→O (256 bytes), 150 for O→T (256 bytes), 151 for configuration, 152 for O→T of input-only connections, 153 for O→T of listen-only connections; name assemblies of the device's EDS file, each in its place
    the adapter 192.168.64.2 refused the connection: the path leads out of a port that the device does not have (general status 0x01, extended status 0x0311); asked for O→T assembly 150 and T→O assembly 100 with configuration assembly 151; correct the route, or leave it out where no bridge is between
    ");
}

#[test]
fn a_device_without_an_eds_file_or_another_one_than_it_describes_is_not_said_to_have_what_it_says() {
    let unknown = refusal_text(ConnectionConfig { described: None, t_o_rpi_us: 100, ..wanted() });
    assert!(unknown.ends_with("and at least 500 µs T→O; ask for another packet interval"), "{unknown}");
    static OTHER: Description = Description { product_code: 9, ..DEVICE };
    let other =
        refusal_text(ConnectionConfig { described: Some(&OTHER), key: None, consumed: 99, ..wanted() });
    assert!(!other.contains("by its EDS file"), "{other}");
}

#[test]
fn a_second_scanner_is_told_that_the_outputs_are_owned() {
    let mut bus = up(wanted());
    let second = ScannerConfig { serial_number: 9, ..SCANNER };
    bus.command_a(|scanner, now| *scanner = SingleConnection::of(second, wanted(), now));
    run(&mut bus, 20);
    let words = bus.a().connection().refusal().unwrap().to_string();
    insta::assert_snapshot!(words, @"the adapter 192.168.64.2 refused the connection: another scanner owns the outputs (general status 0x01, extended status 0x0106); asked for O→T assembly 150 and T→O assembly 100 with configuration assembly 151; the owner is vendor 65535, serial number 0x00000001, in run, with a packet every 1000 µs and a time-out of 0.128 s; by its EDS file the device has outputs for 1 owner; stop the other scanner, or wait for its timeout");
    assert_eq!(bus.a().connection().refusal().unwrap().down().code, 0x0001_0106);
}
