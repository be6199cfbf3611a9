//! What an adapter answers to explicit messages.
//!
//! In one file, because all of its short tests begin with the same set-up of an object.

use ethernet_ip::cip::{General, ObjectClass};

use std::net::Ipv4Addr;

use ethernet_ip::connection::{OpenRequest, Priority};
use ethernet_ip::encapsulation::{Command, Header, Status};
use ethernet_ip::{AdapterConfig, ENCAPSULATION_PORT};
use machine::{Duration, Instant, Machine, Port};

use crate::cell::{PLC, ROBOT, adapter_config};
use crate::client::{
    Client, INPUT_ONLY_PATH, Rig, close_message, explicit, heartbeat, message, owner, peer, unconnected,
};

fn rig() -> (Rig, Client) {
    let mut rig = Rig::new();
    let client = rig.client();
    (rig, client)
}

/// Executes a Get_Attribute_Single.
fn get(rig: &mut Rig, client: Client, class: u8, instance: u8, attribute: u8) -> (u8, Vec<u8>) {
    let answer = rig.request(client, &[0x0E, 3, 0x20, class, 0x24, instance, 0x30, attribute]);
    (answer.general.into(), answer.data)
}

/// Executes a Set_Attribute_Single; returns the general status.
fn set(rig: &mut Rig, client: Client, class: u8, instance: u8, attribute: u8, data: &[u8]) -> u8 {
    let request = [&[0x10, 3, 0x20, class, 0x24, instance, 0x30, attribute][..], data].concat();
    rig.request(client, &request).general.into()
}

#[test]
fn the_list_commands_are_answered_alike_over_udp_and_tcp_without_a_session() {
    let mut rig = Rig::new();
    let stream = rig.connect_from(PLC);
    for (command, length) in
        [(Command::ListServices, 26), (Command::ListIdentity, 56), (Command::ListInterfaces, 2)]
    {
        let [over_udp] = &rig.ask_udp(&message(command, 0, &[]))[..] else { panic!("{command:?}") };
        rig.send(stream, &message(command, 0, &[]));
        let (header, data) = rig.read(stream).unwrap();
        assert_eq!((header.command, header.status, header.length), (command, Status::Success, length));
        assert_eq!(over_udp[24..], data);
    }
}

#[test]
fn list_identity_tells_address_identity_and_state() {
    let mut rig = Rig::new();
    let [reply] = &rig.ask_udp(&message(Command::ListIdentity, 0, &[]))[..] else { panic!() };
    let expected = b"\x01\0\x0C\0\x32\0\x01\0\0\x02\xAF\x12\xC0\xA8\x40\x02\0\0\0\0\0\0\0\0\
        \xFF\xFF\x2B\0\x01\0\x01\x01\x34\0\x78\x56\x34\x12\x10sample device 01\x03";
    assert_eq!(&reply[24..], expected);
}

#[test]
fn commands_that_need_a_session_are_refused_over_udp_and_nop_is_silent() {
    let mut rig = Rig::new();
    for command in [Command::RegisterSession, Command::SendRRData, Command::Unknown(0x1234)] {
        let [reply] = &rig.ask_udp(&message(command, 0, &[1, 0, 0, 0]))[..] else { panic!() };
        assert_eq!(Header::parse(reply).unwrap().status, Status::InvalidCommand, "{command:?}");
    }
    assert!(rig.ask_udp(&message(Command::Nop, 0, b"anything")).is_empty());
}

#[test]
fn a_session_needs_version_1_and_its_length_and_is_registered_once() {
    let mut rig = Rig::new();
    let stream = rig.connect_from(PLC);
    let mut register = |data: &[u8]| {
        rig.send(stream, &message(Command::RegisterSession, 0, data));
        let (header, data) = rig.read(stream).unwrap();
        (header.status, header.session != 0, data)
    };
    assert_eq!(register(&[2, 0, 0, 0]), (Status::UnsupportedProtocol, false, vec![1, 0, 0, 0]));
    assert_eq!(register(&[1, 0]), (Status::InvalidLength, false, vec![]));
    assert_eq!(register(&[1, 0, 0, 0]), (Status::Success, true, vec![1, 0, 0, 0]));
    assert_eq!(register(&[1, 0, 0, 0]).0, Status::InvalidCommand);
}

#[test]
fn a_session_is_bound_to_its_connection() {
    let (mut rig, client) = rig();
    let other = rig.client();
    assert_ne!(client.session, other.session);
    rig.send(other.stream, &message(Command::SendRRData, client.session, &[0; 16]));
    assert_eq!(rig.read(other.stream).unwrap().0.status, Status::InvalidSession);
    rig.send(other.stream, &message(Command::UnRegisterSession, client.session, &[]));
    assert!(rig.closed.is_empty());
    rig.send(other.stream, &message(Command::UnRegisterSession, other.session, &[]));
    assert_eq!(rig.closed, [other.stream]);
    assert_eq!(get(&mut rig, client, 1, 1, 1).0, 0);
}

#[test]
fn the_identity_is_read_whole_one_by_one_and_by_list() {
    let (mut rig, client) = rig();
    let all = rig.request(client, &[1, 2, 0x20, 1, 0x24, 1]).data;
    assert_eq!(&all, b"\xFF\xFF\x2B\0\x01\0\x01\x01\x34\0\x78\x56\x34\x12\x10sample device 01\x03");
    let one_by_one: Vec<u8> = (1..=8).flat_map(|id| get(&mut rig, client, 1, 1, id).1).collect();
    assert_eq!(all, one_by_one);
    let list = rig.request(client, b"\x03\x02\x20\x01\x24\x01\x03\0\x01\0\x63\0\x03\0");
    assert_eq!(list.general, General::AttributeListError);
    assert_eq!(list.data, b"\x03\0\x01\0\0\0\xFF\xFF\x63\0\x14\0\x03\0\0\0\x01\0");
}

#[test]
fn the_identity_tells_what_io_does() {
    let (mut rig, client) = rig();
    let status = |rig: &mut Rig| u16::from_le_bytes(get(rig, client, 1, 1, 5).1.try_into().unwrap());
    assert_eq!(status(&mut rig), 0x0034, "configured, no connection");
    let opened = rig.open(client, &owner(1));
    assert_eq!(status(&mut rig), 0x0075, "owned, idle");
    rig.io(PLC, opened.o_t_id, 1, Some(true), &[0; 256]);
    assert_eq!(status(&mut rig), 0x0065, "owned, running");
    rig.advance(Duration::from_millis(50));
    let client = rig.client();
    let status = |rig: &mut Rig| u16::from_le_bytes(get(rig, client, 1, 1, 5).1.try_into().unwrap());
    assert_eq!(status(&mut rig), 0x0124, "a connection timed out");
}

#[test]
fn every_object_answers_each_of_its_attributes_and_its_class_attributes() {
    let (mut rig, client) = rig();
    let objects: [(u8, u8, &[u8], usize); 9] = [
        (0x01, 1, &[1, 2, 3, 4, 5, 6, 7, 8], 32),
        (0x02, 1, &[1, 2], 20),
        (0x04, 100, &[3, 4], 0),
        (0x04, 150, &[3, 4], 0),
        (0x06, 1, &[1, 2, 3, 4, 5, 6, 7, 8], 16),
        (0x48, 1, &[4, 5, 6, 7, 8], 5),
        (0xF4, 1, &[1, 2, 3, 4, 7], 36),
        (0xF5, 1, &[1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13], 96),
        (0xF6, 1, &[1, 2, 3, 6, 7, 8, 9, 10, 11], 130),
    ];
    for class in ObjectClass::ALL {
        assert!(objects.iter().any(|(code, ..)| *code == class.code()), "no attributes of {}", class.name());
    }
    // Get_Attributes_All has zeros for the counters of the interface and of its medium, which are not there.
    let absent = |class, id| match (class, id) {
        (0xF6, 4) => 44,
        (0xF6, 5) => 48,
        _ => 0,
    };
    for (class, instance, attributes, all_len) in objects {
        let mut concatenated = Vec::new();
        for id in 0..=20 {
            let (status, data) = get(&mut rig, client, class, instance, id);
            let there = attributes.contains(&id);
            assert_eq!(
                (status, data.is_empty()),
                if there { (0, false) } else { (0x14, true) },
                "{class:X} {id}"
            );
            concatenated.extend(data);
            concatenated.extend(vec![0; absent(class, id)]);
        }
        let all = rig.request(client, &[1, 2, 0x20, class, 0x24, instance]);
        if all_len == 0 {
            assert_eq!(all.general, General::ServiceNotSupported);
        } else {
            assert_eq!((all.general, all.data.len()), (General::Success, all_len), "{class:X}");
            assert_eq!(all.data, concatenated, "{class:X}");
        }
        assert_eq!(get(&mut rig, client, class, 0, 1).0, 0, "revision of class {class:X}");
        assert_eq!(get(&mut rig, client, class, 99, 1).0, 0x16, "instance 99 of class {class:X}");
    }
    assert_eq!(get(&mut rig, client, 0x99, 1, 1).0, 0x05);
}

#[test]
fn each_class_names_its_highest_attributes_and_lets_none_of_its_own_be_set() {
    let (mut rig, client) = rig();
    for (class, instance) in [(1, 1), (2, 1), (4, 100), (6, 1), (0x48, 1), (0xF4, 1), (0xF5, 1), (0xF6, 1)] {
        let highest = |rig: &mut Rig, instance: u8| {
            let there = (0..=20).filter(|id| get(rig, client, class, instance, *id).0 == 0);
            u16::from(there.max().unwrap()).to_le_bytes().to_vec()
        };
        let (of_class, of_instance) = (highest(&mut rig, 0), highest(&mut rig, instance));
        assert_eq!(get(&mut rig, client, class, 0, 6), (0, of_class), "attribute 6 of class {class:02X}");
        assert_eq!(get(&mut rig, client, class, 0, 7), (0, of_instance), "attribute 7 of class {class:02X}");
        for id in 0..=20 {
            let expected = if get(&mut rig, client, class, 0, id).0 == 0 { 0x0E } else { 0x14 };
            assert_eq!(set(&mut rig, client, class, 0, id, &[1, 0]), expected, "{id} of class {class:02X}");
        }
    }
    // Revision, highest instance, highest attribute of the class and of the instance.
    let manager = rig.request(client, &[1, 2, 0x20, 6, 0x24, 0]);
    assert_eq!((manager.general, &manager.data[..]), (General::Success, &[1, 0, 1, 0, 7, 0, 8, 0][..]));
}

#[test]
fn paths_of_8_16_and_32_bits_lead_to_the_same_attribute() {
    let (mut rig, client) = rig();
    let short = rig.request(client, b"\x0E\x03\x20\x01\x24\x01\x30\x01");
    let word = rig.request(client, b"\x0E\x06\x21\0\x01\0\x25\0\x01\0\x31\0\x01\0");
    let long = rig.request(client, b"\x0E\x09\x22\0\x01\0\0\0\x26\0\x01\0\0\0\x32\0\x01\0\0\0");
    assert!(short == word && word == long && short.data == b"\xFF\xFF");
}

#[test]
fn what_can_be_set_keeps_its_value_and_what_cannot_says_so() {
    let (mut rig, client) = rig();
    assert_eq!(set(&mut rig, client, 0x48, 1, 5, &[46]), 0);
    assert_eq!(get(&mut rig, client, 0x48, 1, 5).1, [46]);
    assert_eq!(set(&mut rig, client, 0x48, 1, 5, &[64]), 0x09);
    assert_eq!(set(&mut rig, client, 0x48, 1, 5, &[]), 0x13);
    assert_eq!(set(&mut rig, client, 0x48, 1, 5, &[1, 2]), 0x15);
    assert_eq!(set(&mut rig, client, 0xF5, 1, 13, &[60, 0]), 0);
    assert_eq!(get(&mut rig, client, 0xF5, 1, 13).1, [60, 0]);
    assert_eq!(set(&mut rig, client, 0xF5, 1, 13, &[0xFF, 0xFF]), 0x09);
    assert_eq!(set(&mut rig, client, 0xF5, 1, 3, &[0; 4]), 0, "configured statically, as it is");
    assert_eq!(set(&mut rig, client, 0xF5, 1, 3, &[2, 0, 0, 0]), 0x09, "there is no DHCP");
    assert_eq!(set(&mut rig, client, 0xF5, 1, 3, &[0; 3]), 0x13);
    assert_eq!(set(&mut rig, client, 0xF5, 1, 5, &[0; 22]), 0x0E);
    assert_eq!(set(&mut rig, client, 0x01, 1, 1, &[0; 2]), 0x0E);
    assert_eq!(set(&mut rig, client, 0x01, 1, 77, &[0; 2]), 0x14);
    assert_eq!(set(&mut rig, client, 0x04, 150, 3, &[0; 256]), 0x0E, "an arm has one owner");
    assert_eq!(set(&mut rig, client, 0x04, 151, 3, &[]), 0);
    assert_eq!(set(&mut rig, client, 0x04, 151, 3, &[1]), 0x15);
}

/// Returns the DSCP that the adapter requests for its next cyclic frame to this host.
fn dscp_of_next_frame(rig: &mut Rig, to: Ipv4Addr) -> u8 {
    let mut buf = vec![0; machine::wire::FRAME_CAPACITY];
    loop {
        rig.now = rig.adapter.poll_timeout().unwrap();
        rig.adapter.handle_timeout(rig.now);
        while let Some(frame) = rig.adapter.poll_transmit(rig.now, &mut buf) {
            if frame.to.is_some_and(|peer| *peer.ip() == to) {
                return rig.adapter.dscp(frame.port);
            }
        }
    }
}

#[test]
fn each_connection_has_the_dscp_that_its_priority_had_when_it_was_opened() {
    const VIEWER: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 7);
    let (mut rig, client) = rig();
    let patient = |request: OpenRequest<'static>| OpenRequest { multiplier: 7, ..request };
    rig.open(client, &patient(owner(1)));
    assert_eq!(dscp_of_next_frame(&mut rig, PLC), 47, "scheduled");
    assert_eq!(set(&mut rig, client, 0x48, 1, 5, &[46]), 0);
    assert_eq!(dscp_of_next_frame(&mut rig, PLC), 47, "the setting is for the next connection");
    let viewer = rig.client_from(VIEWER);
    let mut high = patient(heartbeat(2, INPUT_ONLY_PATH));
    high.t_o.priority = Priority::High;
    rig.open(viewer, &high);
    assert_eq!(dscp_of_next_frame(&mut rig, VIEWER), 43, "high, beside scheduled");
    assert_eq!(dscp_of_next_frame(&mut rig, PLC), 47);
    rig.request(client, &close_message(owner(1).triad, &[]));
    rig.open(client, &patient(owner(3)));
    assert_eq!(dscp_of_next_frame(&mut rig, PLC), 46);
    assert_eq!(set(&mut rig, client, 0x48, 1, 8, &[10]), 0);
    assert_eq!(rig.adapter.dscp(Port::Stream(client.stream)), 10, "explicit messages, from the next one on");
}

#[test]
fn a_list_of_attributes_is_set_one_by_one_where_the_object_allows_it() {
    let (mut rig, client) = rig();
    let mut set_list = |class: u8, data: &[u8]| {
        let answer = rig.request(client, &[&[4, 2, 0x20, class, 0x24, 1][..], data].concat());
        (u8::from(answer.general), answer.data)
    };
    // Connection Manager: two of its counters.
    let both = [2, 0, 1, 0, 7, 0, 8, 0, 9, 0];
    assert_eq!(set_list(0x06, &both), (0, vec![2, 0, 1, 0, 0, 0, 8, 0, 0, 0]));
    let unknown = [2, 0, 3, 0, 5, 0, 99, 0, 1, 0];
    assert_eq!(set_list(0x06, &unknown), (0x0A, vec![2, 0, 3, 0, 0, 0, 99, 0, 0x14, 0]));
    let unknown_first = [2, 0, 99, 0, 1, 0, 3, 0, 6, 0];
    assert_eq!(
        set_list(0x06, &unknown_first),
        (0x0A, vec![1, 0, 99, 0, 0x14, 0]),
        "nothing behind it is read"
    );
    for cut in [&[][..], &[1], &[1, 0, 1, 0], &[1, 0, 1, 0, 7], &[0xFF, 0xFF, 1, 0, 7, 0]] {
        assert_eq!(set_list(0x06, cut).0, 0x13, "{cut:02X?}");
    }
    assert_eq!(set_list(0x06, &[1, 0, 1, 0, 7, 0, 0]).0, 0x15);
    for class in [0x01, 0x02, 0x48, 0xF4, 0xF5, 0xF6] {
        assert_eq!(set_list(class, &[1, 0, 13, 0, 60, 0]).0, 0x08, "class {class:02X} has no such service");
    }
    let counts = rig.request(client, &[1, 2, 0x20, 6, 0x24, 1]).data;
    assert_eq!(counts, [7, 0, 0, 0, 5, 0, 0, 0, 0, 0, 0, 0, 0, 0, 9, 0]);
}

#[test]
fn a_question_to_all_is_answered_after_a_delay_of_the_devices_own_and_one_to_it_alone_at_once() {
    let ask = |longest_ms: u16, serial_number: u32| {
        let mut rig = Rig::of(AdapterConfig { serial_number, ..adapter_config() });
        let mut question = message(Command::ListIdentity, 0, &[]);
        question[12..14].copy_from_slice(&longest_ms.to_le_bytes());
        let [at_once] = &rig.ask_udp(&question)[..] else { panic!("one answer to one question") };
        let at_once = at_once.clone();
        rig.datagrams.clear();
        let asked = rig.now;
        for _ in 0..50 {
            rig.broadcast(ENCAPSULATION_PORT, peer(PLC, 40_000), &question);
            rig.advance(Duration::from_secs(70));
        }
        assert_eq!(rig.datagrams.len(), 50);
        assert!(rig.datagrams.iter().all(|(_, _, to, bytes)| *to == peer(PLC, 40_000) && *bytes == at_once));
        let delay =
            |(index, (at, ..)): (u64, &(Instant, _, _, _))| at.since(asked + Duration::from_secs(70 * index));
        (0..).zip(&rig.datagrams).map(delay).collect::<Vec<_>>()
    };
    // A quarter of the limit. No limit means 2 s; a limit below 500 ms means 500 ms.
    for (named_ms, meant_ms) in [(0, 500), (1, 125), (500, 125), (3_000, 750), (u16::MAX, 16_384)] {
        let delays = ask(named_ms, 7);
        let longest = Duration::from_millis(meant_ms);
        assert!(delays.iter().all(|delay| *delay <= longest), "{named_ms} ms: {delays:?}");
        assert!(delays.iter().any(|delay| *delay > longest * 3 / 4), "{named_ms} ms: {delays:?}");
        assert!(delays.iter().any(|delay| *delay < longest / 4), "{named_ms} ms: {delays:?}");
    }
    assert_eq!(ask(0, 7), ask(0, 7), "the same device, the same run");
    assert_ne!(ask(0, 7), ask(0, 8), "two devices do not answer together");
}

#[test]
fn a_flood_of_questions_to_all_is_answered_within_bounds() {
    let mut rig = Rig::new();
    for port in 0..1_000 {
        rig.broadcast(ENCAPSULATION_PORT, peer(PLC, 40_000 + port), &message(Command::ListIdentity, 0, &[]));
    }
    rig.advance(Duration::from_secs(3));
    assert_eq!(rig.datagrams.len(), 2, "a host has two questions open at most");
}

#[test]
fn a_reset_takes_settings_back_but_not_from_a_robot_in_use() {
    let (mut rig, client) = rig();
    set(&mut rig, client, 0x48, 1, 5, &[1]);
    set(&mut rig, client, 0xF5, 1, 13, &[7, 0]);
    assert_eq!(rig.request(client, &[5, 2, 0x20, 1, 0x24, 1, 1]).general, General::Success);
    let client = rig.client();
    assert_eq!(get(&mut rig, client, 0x48, 1, 5).1, [47]);
    assert_eq!(get(&mut rig, client, 0xF5, 1, 13).1, [120, 0]);
    assert_eq!(rig.request(client, &[5, 2, 0x20, 1, 0x24, 1, 9]).general, General::InvalidParameter);
    rig.open(client, &owner(1));
    assert_eq!(rig.request(client, &[5, 2, 0x20, 1, 0x24, 1, 0]).general, General::DeviceStateConflict);
}

#[test]
fn a_reset_is_answered_and_then_all_clients_have_to_connect_again_as_after_a_power_cycle() {
    for with_class_3 in [false, true] {
        let (mut rig, client) = rig();
        let other = rig.client_from(Ipv4Addr::new(192, 168, 64, 9));
        rig.open(other, &explicit(1));
        let opened = rig.open(client, &explicit(2));
        let reset = &[5, 2, 0x20, 1, 0x24, 1, 0];
        let answer = if with_class_3 {
            rig.request_connected(client, &opened, 1, reset).unwrap()
        } else {
            rig.request(client, reset)
        };
        assert_eq!(answer.general, General::Success);
        assert_eq!((rig.adapter.sessions(), rig.adapter.connections()), (0, (0, 0)));
        assert_eq!(rig.closed, [client.stream, other.stream]);
        let client = rig.client();
        rig.open(client, &owner(3));
    }
}

#[test]
fn several_services_in_one_packet_are_answered_each() {
    let (mut rig, client) = rig();
    let packet = b"\x0A\x02\x20\x02\x24\x01\x02\0\x06\0\x0E\0\
        \x0E\x03\x20\x01\x24\x01\x30\x01\x0E\x03\x20\x01\x24\x01\x30\x02";
    let answer = rig.request(client, packet);
    assert_eq!(answer.general, General::Success);
    assert_eq!(answer.data, b"\x02\0\x06\0\x0C\0\x8E\0\0\0\xFF\xFF\x8E\0\0\0\x2B\0");
    let mut with_error = packet.to_vec();
    *with_error.last_mut().unwrap() = 99;
    let answer = rig.request(client, &with_error);
    assert_eq!(answer.general, General::EmbeddedServiceError);
    assert_eq!(answer.data, b"\x02\0\x06\0\x0C\0\x8E\0\0\0\xFF\xFF\x8E\0\x14\0");
}

/// Returns an Unconnected_Send of Get_Attribute_Single vendor, along a route.
fn unconnected_send(route: &[u8]) -> Vec<u8> {
    let mut cip = b"\x52\x02\x20\x06\x24\x01\x0A\xF0\x08\0\x0E\x03\x20\x01\x24\x01\x30\x01".to_vec();
    cip.extend([route.len() as u8 / 2, 0]);
    cip.extend(route);
    cip
}

#[test]
fn an_unconnected_send_reaches_this_device_and_no_other() {
    let (mut rig, client) = rig();
    assert_eq!(rig.request(client, &unconnected_send(&[])).data, [0xFF, 0xFF]);
    let to_self = [&[0x12, 12][..], b"192.168.64.2"].concat();
    assert_eq!(rig.request(client, &unconnected_send(&to_self)).data, [0xFF, 0xFF]);
    // Behind the status: how many words of the route are left, and a reserved byte, as tshark 4.0 reads it.
    let mut refused = |request: &[u8]| {
        let answer = rig.request(client, request);
        (answer.status(), answer.data)
    };
    assert_eq!(refused(&unconnected_send(&[1, 0])), ((1, 0x0311), vec![1, 0]));
    let elsewhere = [&[0x12, 12][..], b"192.168.64.9"].concat();
    assert_eq!(refused(&unconnected_send(&elsewhere)), ((1, 0x0312), vec![7, 0]));
    assert_eq!(refused(&unconnected_send(&[0x20, 4])), ((1, 0x0315), vec![1, 0]));
    let mut no_time = unconnected_send(&[]);
    no_time[7] = 0;
    assert_eq!(refused(&no_time), ((1, 0x0204), vec![0, 0]));
}

#[test]
fn a_class_3_connection_answers_each_request_once_and_a_repeated_one_alike() {
    let (mut rig, client) = rig();
    let opened = rig.open(client, &explicit(1));
    let count_opens = [0x0E, 3, 0x20, 6, 0x24, 1, 0x30, 1];
    let first = rig.request_connected(client, &opened, 1, &count_opens).unwrap();
    assert_eq!(first.data, [1, 0]);
    rig.open(client, &explicit(2));
    let repeated = rig.request_connected(client, &opened, 1, &count_opens).unwrap();
    assert_eq!(repeated, first);
    assert_eq!(rig.request_connected(client, &opened, 2, &count_opens).unwrap().data, [2, 0]);
}

#[test]
fn a_class_3_connection_is_closed_by_the_path_that_opened_it_or_none_and_by_no_other() {
    let (mut rig, client) = rig();
    rig.open(client, &explicit(1));
    rig.open(client, &explicit(2));
    let close = |serial, path: &[u8]| close_message(explicit(serial).triad, path);
    assert_eq!(rig.request(client, &close(1, &[0x20, 4, 0x24, 1])).status(), (1, 0x0316));
    assert_eq!(rig.request(client, &close(1, &[0x20, 2, 0x24, 1])).general, General::Success);
    assert_eq!(rig.request(client, &close(2, &[])).general, General::Success);
}

#[test]
fn a_class_3_connection_is_closed_over_another_tcp_connection_of_its_host_and_of_no_other_host() {
    let (mut rig, dead) = rig();
    rig.open(dead, &explicit(1));
    let stranger = rig.client_from(ROBOT);
    let close = close_message(explicit(1).triad, &[]);
    assert_eq!(rig.request(stranger, &close).status(), (0x0F, 0));
    // The cable was pulled: the client connects anew before the adapter notices that the old TCP connection is dead.
    let anew = rig.client();
    assert_eq!(rig.request(anew, &close).general, General::Success);
    assert_eq!(rig.adapter.connections(), (0, 0));
    rig.open(anew, &explicit(1));
}

#[test]
fn six_class_3_connections_work_side_by_side_and_end_with_their_tcp_connection() {
    let (mut rig, client) = rig();
    let others = [rig.client(), rig.client()];
    let opened: Vec<_> = (1..=6).map(|serial| rig.open(client, &explicit(serial))).collect();
    for (count, opened) in opened.iter().enumerate() {
        let name = rig.request_connected(client, opened, count as u16, &[0x0E, 3, 0x20, 1, 0x24, 1, 0x30, 1]);
        assert_eq!(name.unwrap().data, [0xFF, 0xFF]);
        let [other, _] = others;
        assert_eq!(rig.request_connected(other, opened, 9, &[0x0E, 3, 0x20, 1, 0x24, 1, 0x30, 1]), None);
    }
    assert_eq!(rig.adapter.connections(), (0, 6));
    rig.hang_up(client.stream);
    assert_eq!(rig.adapter.connections(), (0, 0));
}

#[test]
fn a_class_3_connection_times_out_when_nobody_uses_it() {
    let (mut rig, client) = rig();
    let opened = rig.open(client, &explicit(1));
    rig.advance(Duration::from_secs(25));
    assert!(rig.request_connected(client, &opened, 1, &[0x0E, 3, 0x20, 1, 0x24, 1, 0x30, 1]).is_some());
    // 2 s × 16, from the last request on.
    rig.advance(Duration::from_secs(31));
    assert_eq!(rig.adapter.connections(), (0, 1));
    rig.advance(Duration::from_secs(2));
    assert_eq!(rig.adapter.connections(), (0, 0));
    assert_eq!(rig.closed, [client.stream]);
}

#[test]
fn a_tcp_connection_is_closed_when_the_last_connection_that_was_opened_over_it_times_out() {
    let (mut rig, client) = rig();
    let (other, idle) = (rig.client(), rig.client());
    let first = rig.open(client, &explicit(1));
    rig.open(client, &owner(2));
    rig.open(client, &explicit(3));
    rig.open(other, &heartbeat(4, INPUT_ONLY_PATH));
    // The owner never sends: its connection ends after 10 s. One of class 3 is used, so that the client is there.
    rig.advance(Duration::from_secs(11));
    assert_eq!(rig.adapter.connections(), (0, 2));
    assert_eq!(rig.closed, [other.stream], "the viewer's, which carries nothing any more");
    assert!(rig.request_connected(client, &first, 1, &[0x0E, 3, 0x20, 1, 0x24, 1, 0x30, 1]).is_some());
    rig.advance(Duration::from_secs(25));
    assert_eq!((rig.adapter.connections(), rig.closed.len()), ((0, 1), 1), "one of two timed out");
    rig.advance(Duration::from_secs(10));
    assert_eq!(rig.adapter.connections(), (0, 0));
    assert_eq!(rig.closed, [other.stream, client.stream]);
    assert_eq!(get(&mut rig, idle, 1, 1, 1).0, 0, "a session without connections stays");
}

#[test]
fn a_tcp_connection_that_is_gone_is_not_closed_again_when_its_connection_times_out() {
    let (mut rig, client) = rig();
    rig.open(client, &owner(1));
    rig.hang_up(client.stream);
    assert_eq!(rig.adapter.connections(), (1, 0), "cyclic data do not need it");
    rig.advance(Duration::from_secs(11));
    assert_eq!((rig.adapter.connections(), rig.closed.len()), ((0, 0), 0));
}

#[test]
fn a_class_3_reply_that_is_larger_than_the_connection_says_so() {
    let (mut rig, client) = rig();
    let mut request = explicit(1);
    request.t_o.size = 20;
    let opened = rig.open(client, &request);
    let answer = rig.request_connected(client, &opened, 1, &[1, 2, 0x20, 1, 0x24, 1]).unwrap();
    assert_eq!(answer.general, General::ReplyDataTooLarge);
}

#[test]
fn the_connection_manager_counts_what_it_opened_refused_closed_and_lost() {
    let (mut rig, client) = rig();
    rig.open(client, &owner(1));
    let _ = rig.try_open(client, &owner(2));
    rig.request(client, &close_message(owner(9).triad, &[]));
    rig.advance(Duration::from_secs(11));
    let client = rig.client();
    let counts = rig.request(client, &[1, 2, 0x20, 6, 0x24, 1]).data;
    assert_eq!(counts, [2, 0, 0, 0, 0, 0, 1, 0, 1, 0, 0, 0, 1, 0, 1, 0]);
}

#[test]
fn a_silent_session_is_ended_after_the_inactivity_timeout() {
    let (mut rig, client) = rig();
    rig.advance(Duration::from_secs(119));
    rig.send(client.stream, &message(Command::Nop, 0, &[]));
    rig.advance(Duration::from_secs(119));
    assert!(rig.closed.is_empty());
    rig.advance(Duration::from_secs(2));
    assert_eq!(rig.closed, [client.stream]);
}

#[test]
fn a_foreign_host_cannot_close_a_connection_and_a_wrong_path_is_named() {
    let (mut rig, client) = rig();
    rig.open(client, &owner(1));
    let stranger = rig.client_from(ROBOT);
    let close = |path: &[u8]| close_message(owner(1).triad, path);
    assert_eq!(rig.request(stranger, &close(&[])).status(), (0x0F, 0));
    assert_eq!(rig.request(client, &close(&[0x20, 4, 0x2C, 152, 0x2C, 100])).status(), (1, 0x0316));
    assert_eq!(rig.request(client, &close(&[0x20, 4, 0x2C, 150, 0x2C, 100])).general, General::Success);
    assert_eq!(rig.request(client, &close(&[])).status(), (1, 0x0107));
}

#[test]
fn each_class_tells_its_highest_instance_and_how_many_there_are() {
    let (mut rig, client) = rig();
    let mut both = |class| {
        let mut number = |attribute| {
            let (status, data) = get(&mut rig, client, class, 0, attribute);
            assert_eq!(status, 0, "attribute {attribute} of class {class:02X}");
            u16::from_le_bytes(data.try_into().unwrap())
        };
        (number(2), number(3))
    };
    for class in [0x01, 0x02, 0x48, 0xF4, 0xF5, 0xF6] {
        assert_eq!(both(class), (1, 1), "class {class:02X}");
    }
    // The sample device has the assemblies 100 and 150 to 153.
    assert_eq!(both(0x04), (153, 5));
}

#[test]
fn the_connection_manager_counts_refusals_by_their_reason() {
    let (mut rig, client) = rig();
    for serial in 1..=3 {
        rig.open(client, &heartbeat(serial, INPUT_ONLY_PATH));
    }
    // No place; a path that leads nowhere; a request that is cut off.
    assert!(rig.try_open(client, &heartbeat(5, INPUT_ONLY_PATH)).is_err());
    assert!(rig.try_open(client, &heartbeat(6, &[0x20, 4, 0x2C, 99, 0x2C, 100])).is_err());
    rig.request(client, &[0x54, 2, 0x20, 6, 0x24, 1, 0x0A]);
    rig.request(client, &close_message(owner(9).triad, &[]));
    rig.request(client, &[0x4E, 2, 0x20, 6, 0x24, 1, 0x0A]);
    let counts = rig.request(client, &[1, 2, 0x20, 6, 0x24, 1]).data;
    // Opened, and refused for its format, for lack of resources, for another reason; closed, and refused for its format, for
    // another reason; timed out.
    assert_eq!(counts, [6, 0, 1, 0, 1, 0, 1, 0, 2, 0, 1, 0, 1, 0, 0, 0]);
}

#[test]
fn the_ethernet_link_has_no_speed_until_its_owner_reports_one() {
    let (mut rig, client) = rig();
    // Capability: bit 1 is auto-negotiation, and no option.
    assert_eq!(get(&mut rig, client, 0xF6, 1, 11).1, [2, 0, 0, 0, 0]);
    assert_eq!(get(&mut rig, client, 0xF6, 1, 1).1, [0; 4]);
}

#[test]
fn only_the_assembly_that_the_device_sends_can_be_set_by_its_program() {
    let (mut rig, _) = rig();
    for instance in [150, 151, 99] {
        let refused = rig.adapter.set_produced(instance, &[1; 256]);
        assert_eq!(refused, Err(ethernet_ip::DataError::NotProduced { instance }));
    }
    assert_eq!(rig.adapter.set_produced(100, &[1; 256]), Ok(()));
}

#[test]
fn a_tcp_connection_may_be_silent_for_ever_where_the_inactivity_timeout_is_0() {
    let (mut rig, client) = rig();
    assert_eq!(set(&mut rig, client, 0xF5, 1, 13, &[0, 0]), 0);
    rig.advance(Duration::from_secs(100_000));
    assert!(rig.closed.is_empty());
}

#[test]
fn the_port_names_its_number_and_the_devices_address_in_a_port_segment() {
    let (mut rig, client) = rig();
    // Port 2 with a link address of 12 characters: its bit 4 says that a length follows.
    assert_eq!(get(&mut rig, client, 0xF4, 1, 7).1, b"\x12\x0C192.168.64.2");
}

/// Returns a Multiple_Service_Packet with these services.
fn packet(services: &[&[u8]]) -> Vec<u8> {
    let mut cip = vec![0x0A, 2, 0x20, 2, 0x24, 1];
    cip.extend((services.len() as u16).to_le_bytes());
    let mut offset = 2 + 2 * services.len();
    for service in services {
        cip.extend((offset as u16).to_le_bytes());
        offset += service.len();
    }
    cip.extend(services.concat());
    cip
}

#[test]
fn the_reply_to_a_packet_of_services_has_the_services_number_and_one_reply_to_each() {
    let (mut rig, client) = rig();
    let [vendor, device_type] = [1, 2].map(|attribute| [0x0E, 3, 0x20, 1, 0x24, 1, 0x30, attribute]);
    // The reply to the second has no data: it is four bytes long.
    let set_timeout = [0x10, 3, 0x20, 0xF5, 0x24, 1, 0x30, 13, 60, 0];
    let request = packet(&[&vendor, &set_timeout, &device_type]);
    rig.send(client.stream, &message(Command::SendRRData, client.session, &unconnected(&request)));
    let (_, data) = rig.read(client.stream).unwrap();
    let expected = b"\x8A\0\0\0\x03\0\x08\0\x0E\0\x12\0\x8E\0\0\0\xFF\xFF\x90\0\0\0\x8E\0\0\0\x2B\0";
    // Interface, timeout, the number of items, an empty address and the head of the data come first.
    assert_eq!(&data[16..], expected);
}

#[test]
fn a_packet_of_services_is_refused_where_the_reply_to_one_has_no_room() {
    let (mut rig, client) = rig();
    // Room for the head of 10 bytes, the first reply of 6, and 3 of the 4 that the second has at least.
    let mut narrow = explicit(1);
    narrow.t_o.size = 2 + 10 + 6 + 3;
    let opened = rig.open(client, &narrow);
    let vendor = &[0x0E, 3, 0x20, 1, 0x24, 1, 0x30, 1][..];
    let both = packet(&[vendor, vendor]);
    // What an earlier reply left in the adapter's buffer is no status: zeros, and a text.
    for (count, class, attribute) in [(1, 0xF5, 11), (2, 0x01, 7)] {
        assert_eq!(get(&mut rig, client, class, 1, attribute).0, 0);
        let answer = rig.request_connected(client, &opened, count, &both).unwrap();
        assert_eq!(answer.general, General::ReplyDataTooLarge, "{count}");
    }
}

#[test]
fn a_request_that_has_the_bit_of_a_reply_is_answered_by_a_reply() {
    let (mut rig, client) = rig();
    for (request, refusal) in [(&[0x8E, 2, 0x20, 1, 0x24, 1][..], 0x08), (&[0x8E, 9, 0x20, 1][..], 0x26)] {
        rig.send(client.stream, &message(Command::SendRRData, client.session, &unconnected(request)));
        let (_, data) = rig.read(client.stream).unwrap();
        assert_eq!(data[16..19], [0x8E, 0, refusal]);
    }
}
