//! What an adapter must survive: after each bad input a good scanner still gets its data on time.
//!
//! In one file, because all of its short tests begin with the same set-up of an adapter.

use std::net::Ipv4Addr;

use crate::samples::CONSUMED;
use ethernet_ip::cpf::{kind, write_item};
use ethernet_ip::encapsulation::{Command, Status};
use ethernet_ip::{ENCAPSULATION_PORT, IO_PORT};
use machine::wire::{LittleEndian, Writer};
use machine::{Duration, StreamId};

use crate::cell::{PLC, ROBOT};
use crate::client::{
    Client, INPUT_ONLY_PATH, Rig, close_message, explicit, heartbeat, message, open_message, owner, peer,
    unconnected,
};

/// Returns an adapter with a good scanner, and a bad client.
pub(crate) fn rig() -> (Rig, Client) {
    let mut rig = Rig::new();
    rig.start_good_scanner();
    let bad = rig.client();
    (rig, bad)
}

/// Get_Attribute_Single of the vendor number.
pub(crate) const VENDOR: &[u8] = &[0x0E, 3, 0x20, 1, 0x24, 1, 0x30, 1];

fn items(count: u16, write: impl FnOnce(&mut Writer<'_, LittleEndian>)) -> Vec<u8> {
    let mut buf = [0; 2_048];
    let mut writer = Writer::<LittleEndian>::new(&mut buf);
    writer.zeros(6);
    writer.u16(count);
    write(&mut writer);
    let len = writer.finish().unwrap();
    buf[..len].to_vec()
}

/// Sends a SendRRData with this data and returns the status of the reply.
fn status_of(rig: &mut Rig, client: Client, data: &[u8]) -> Status {
    rig.send(client.stream, &message(Command::SendRRData, client.session, data));
    rig.read(client.stream).expect("no reply").0.status
}

#[test]
fn a_message_that_is_cut_off_at_any_byte_waits_for_its_rest() {
    let (mut rig, bad) = rig();
    let whole = message(Command::SendRRData, bad.session, &unconnected(VENDOR));
    for cut in 0..whole.len() {
        rig.send(bad.stream, &whole[..cut]);
        assert!(rig.read(bad.stream).is_none(), "answered at {cut}");
        rig.send(bad.stream, &whole[cut..]);
        assert_eq!(rig.read(bad.stream).unwrap().0.status, Status::Success);
    }
    rig.assert_good_scanner_is_served();
}

#[test]
fn a_client_that_sends_a_byte_a_second_does_not_hold_up_another() {
    let (mut rig, bad) = rig();
    let whole = message(Command::SendRRData, bad.session, &unconnected(VENDOR));
    for byte in &whole {
        rig.send(bad.stream, &[*byte]);
        rig.assert_good_scanner_is_served();
        rig.advance(Duration::from_millis(990));
    }
    assert!(rig.read(bad.stream).is_some());
}

#[test]
fn messages_that_are_glued_together_are_answered_each_and_in_order() {
    let (mut rig, bad) = rig();
    let mut glued = Vec::new();
    for number in 0..60 {
        let mut one = message(Command::SendRRData, bad.session, &unconnected(VENDOR));
        one[12] = number;
        glued.extend(one);
    }
    rig.send(bad.stream, &glued);
    for number in 0..60 {
        assert_eq!(rig.read(bad.stream).unwrap().0.context[0], number);
    }
    rig.assert_good_scanner_is_served();
}

#[test]
fn a_message_that_is_too_long_is_refused_and_the_one_behind_it_is_answered() {
    for length in [4_073, 30_000, u16::MAX] {
        let (mut rig, bad) = rig();
        let mut long = message(Command::SendRRData, bad.session, &[]);
        long[2..4].copy_from_slice(&length.to_le_bytes());
        rig.send(bad.stream, &long);
        assert_eq!(rig.read(bad.stream).unwrap().0.status, Status::InvalidLength);
        for chunk in vec![0x65; usize::from(length)].chunks(1_000) {
            rig.send(bad.stream, chunk);
        }
        assert!(rig.read(bad.stream).is_none());
        rig.send(bad.stream, &message(Command::ListServices, 0, &[]));
        assert_eq!(rig.read(bad.stream).unwrap().0.status, Status::Success);
        rig.assert_good_scanner_is_served();
    }
}

#[test]
fn a_client_that_sends_more_than_there_is_room_for_loses_its_connections_at_once() {
    let (mut rig, bad) = rig();
    rig.open(bad, &explicit(1));
    assert_eq!(rig.adapter.connections(), (1, 1));
    rig.send(bad.stream, &[0x65; 9_000]);
    assert_eq!(rig.closed, [bad.stream]);
    assert_eq!(rig.adapter.connections(), (1, 0));
    rig.assert_good_scanner_is_served();
}

#[test]
fn a_reply_that_fits_into_no_message_of_a_connection_is_not_sent() {
    let (mut rig, bad) = rig();
    let mut tiny = explicit(1);
    tiny.t_o.size = 4;
    let opened = rig.open(bad, &tiny);
    assert_eq!(rig.request_connected(bad, &opened, 1, VENDOR), None);
    rig.assert_good_scanner_is_served();
}

#[test]
fn a_stream_of_garbage_is_answered_within_bounds() {
    let (mut rig, bad) = rig();
    for seed in 0..50_u32 {
        let garbage: Vec<u8> = (0..4_000_u32).map(|i| (i.wrapping_mul(seed | 1) >> 3) as u8).collect();
        rig.send(bad.stream, &garbage);
    }
    rig.assert_good_scanner_is_served();
}

#[test]
fn options_that_are_not_zero_throw_the_message_away() {
    let (mut rig, bad) = rig();
    let mut odd = message(Command::ListServices, 0, &[]);
    odd[20] = 1;
    rig.send(bad.stream, &odd);
    assert!(rig.read(bad.stream).is_none() && rig.ask_udp(&odd).is_empty());
    rig.assert_good_scanner_is_served();
}

#[test]
fn a_message_with_a_status_is_no_request_and_is_not_answered() {
    let (mut rig, bad) = rig();
    for command in
        [Command::ListIdentity, Command::RegisterSession, Command::SendRRData, Command::Unknown(0x1234)]
    {
        let mut odd = message(command, bad.session, &[]);
        odd[8] = 1;
        rig.send(bad.stream, &odd);
        assert!(rig.read(bad.stream).is_none(), "{command:?} over TCP");
        assert!(rig.ask_udp(&odd).is_empty(), "{command:?} over UDP");
        rig.broadcast(ENCAPSULATION_PORT, peer(PLC, 40_000), &odd);
        rig.advance(Duration::from_secs(3));
        let late = rig.datagrams.iter().filter(|(_, port, ..)| *port == ENCAPSULATION_PORT);
        assert_eq!(late.count(), 0, "{command:?} to all");
    }
    rig.assert_good_scanner_is_served();
}

#[test]
fn two_adapters_do_not_answer_each_others_answers() {
    let commands = [
        (Command::ListIdentity, 56),
        (Command::ListServices, 26),
        (Command::ListInterfaces, 2),
        (Command::SendRRData, 0),
        (Command::Unknown(0x1234), 0),
    ];
    for (command, length) in commands {
        let mut first = Rig::new();
        let answers = first.ask_udp(&message(command, 0, &[]));
        assert_eq!(answers.len(), 1, "{command:?}");
        assert_eq!(answers[0].len(), 24 + length, "{command:?}");
        let mut second = Rig::new();
        assert!(second.ask_udp(&answers[0]).is_empty(), "{command:?}");
        second.broadcast(ENCAPSULATION_PORT, peer(PLC, 40_000), &answers[0]);
        second.advance(Duration::from_secs(3));
        assert!(second.datagrams.is_empty(), "{command:?} to all");
    }
}

#[test]
fn commands_without_a_reply_get_none_however_long_they_are() {
    let (mut rig, bad) = rig();
    let too_long = |command, session| {
        let mut long = message(command, session, &[]);
        long[2..4].copy_from_slice(&30_000_u16.to_le_bytes());
        long
    };
    rig.send(bad.stream, &too_long(Command::Nop, 0));
    for chunk in [0x65; 30_000].chunks(1_000) {
        rig.send(bad.stream, chunk);
    }
    assert!(rig.read(bad.stream).is_none(), "a NOP");
    let mut odd = too_long(Command::SendRRData, bad.session);
    odd[20] = 1;
    rig.send(bad.stream, &odd);
    for chunk in [0x65; 30_000].chunks(1_000) {
        rig.send(bad.stream, chunk);
    }
    assert!(rig.read(bad.stream).is_none(), "options that are not zero");
    assert!(rig.closed.is_empty());
    rig.send(bad.stream, &too_long(Command::UnRegisterSession, bad.session));
    assert!(rig.read(bad.stream).is_none(), "UnRegisterSession");
    assert_eq!(rig.closed, [bad.stream]);
    rig.assert_good_scanner_is_served();
}

#[test]
fn item_counts_of_0_and_65535_are_malformed() {
    let (mut rig, bad) = rig();
    for count in [0, 1, 3, 0xFFFF] {
        let data = items(count, |writer| {
            write_item(writer, kind::NULL_ADDRESS, |_| {});
            if count > 1 {
                write_item(writer, kind::UNCONNECTED_DATA, |writer| writer.bytes(VENDOR));
            }
        });
        assert_eq!(status_of(&mut rig, bad, &data), Status::IncorrectData, "{count} items");
    }
    rig.assert_good_scanner_is_served();
}

#[test]
fn item_lengths_past_the_end_are_malformed() {
    let (mut rig, bad) = rig();
    for length in [9_u16, 255, 0xFFFF] {
        let data = items(2, |writer| {
            write_item(writer, kind::NULL_ADDRESS, |_| {});
            writer.u16(kind::UNCONNECTED_DATA);
            writer.u16(length);
            writer.bytes(VENDOR);
        });
        assert_eq!(status_of(&mut rig, bad, &data), Status::IncorrectData, "{length} bytes");
    }
    rig.assert_good_scanner_is_served();
}

#[test]
fn items_of_wrong_types_are_malformed() {
    let (mut rig, bad) = rig();
    let pairs = [
        (kind::CONNECTED_ADDRESS, kind::UNCONNECTED_DATA),
        (kind::NULL_ADDRESS, kind::CONNECTED_DATA),
        (kind::UNCONNECTED_DATA, kind::NULL_ADDRESS),
        (0x9999, 0x9999),
    ];
    for (address, data) in pairs {
        let data = items(2, |writer| {
            write_item(writer, address, |_| {});
            write_item(writer, data, |writer| writer.bytes(VENDOR));
        });
        assert_eq!(status_of(&mut rig, bad, &data), Status::IncorrectData);
    }
    rig.assert_good_scanner_is_served();
}

#[test]
fn send_rr_data_that_ends_before_its_items_is_malformed() {
    let (mut rig, bad) = rig();
    for len in 0..8 {
        assert_eq!(status_of(&mut rig, bad, &vec![0; len]), Status::IncorrectData, "{len} bytes");
    }
    let mut other_interface = unconnected(VENDOR);
    other_interface[0] = 1;
    assert_eq!(status_of(&mut rig, bad, &other_interface), Status::IncorrectData);
    rig.assert_good_scanner_is_served();
}

#[test]
fn a_router_request_of_0_bytes_is_malformed_and_one_of_1_byte_has_too_little_data() {
    let (mut rig, bad) = rig();
    assert_eq!(status_of(&mut rig, bad, &unconnected(&[])), Status::IncorrectData);
    assert_eq!(rig.request(bad, &[0x0E]).status(), (0x13, 0));
    rig.assert_good_scanner_is_served();
}

#[test]
fn a_path_of_255_words_in_a_short_request_has_the_wrong_size() {
    let (mut rig, bad) = rig();
    assert_eq!(rig.request(bad, &[0x0E, 255, 0x20, 1, 0x24, 1]).status(), (0x26, 0));
    rig.assert_good_scanner_is_served();
}

#[test]
fn segments_that_are_cut_off_have_the_wrong_size_and_unknown_ones_are_named() {
    let (mut rig, bad) = rig();
    for path in [&[0x20, 1, 0x25, 0][..], &[0x22, 0, 1, 0], &[0x20, 1, 0x34, 4], &[0x80, 0xFF]] {
        let request = [&[0x0E, path.len() as u8 / 2][..], path].concat();
        assert_eq!(rig.request(bad, &request).status(), (0x26, 0), "{path:02X?}");
    }
    for path in [&[0xFF, 0xFF][..], &[0x23, 0], &[0x38, 1], &[0x60, 0], &[0x00, 0]] {
        let request = [&[0x0E, 1][..], path].concat();
        assert_eq!(rig.request(bad, &request).status(), (0x04, 0), "{path:02X?}");
    }
    assert_eq!(rig.request(bad, &[0x0E, 0]).status(), (0x04, 0), "no path at all");
    rig.assert_good_scanner_is_served();
}

#[test]
fn an_attribute_list_that_counts_65535_has_too_little_data() {
    let (mut rig, bad) = rig();
    let list = |count: &[u8]| [&[3, 2, 0x20, 1, 0x24, 1][..], count].concat();
    assert_eq!(rig.request(bad, &list(&[0xFF, 0xFF, 1, 0])).status(), (0x13, 0));
    assert_eq!(rig.request(bad, &list(&[])).status(), (0x13, 0));
    assert_eq!(rig.request(bad, &list(&[1, 0, 1, 0, 2, 0])).status(), (0x15, 0));
    rig.assert_good_scanner_is_served();
}

#[test]
fn replies_that_are_larger_than_the_buffer_say_so() {
    let (mut rig, bad) = rig();
    // The feedback assembly's 256 bytes, 30 times: 7.7 kB.
    let mut list = vec![3, 2, 0x20, 4, 0x24, 100, 30, 0];
    list.extend([3, 0].repeat(30));
    assert_eq!(rig.request(bad, &list).status(), (0x11, 0));
    let count = 30_u16;
    let mut packet = vec![0x0A, 2, 0x20, 2, 0x24, 1];
    packet.extend(count.to_le_bytes());
    (0..count).for_each(|index| packet.extend((2 + 2 * count + 8 * index).to_le_bytes()));
    (0..count).for_each(|_| packet.extend([0x0E, 3, 0x20, 4, 0x24, 100, 0x30, 3]));
    let answer = rig.request(bad, &packet);
    assert_eq!(answer.status(), (0x1E, 0), "some of the services are answered, the others say it each");
    assert_eq!(answer.data[answer.data.len() - 4..], [0x8E, 0, 0x11, 0]);
    rig.assert_good_scanner_is_served();
}

#[test]
fn a_packet_of_services_with_wrong_offsets_is_refused() {
    let (mut rig, bad) = rig();
    let packet = |data: &[u8]| [&[0x0A, 2, 0x20, 2, 0x24, 1][..], data].concat();
    for data in [&[][..], &[0, 0], &[0xFF, 0xFF], &[1, 0, 0xFF, 0xFF], &[2, 0, 6, 0, 4, 0, 1, 2]] {
        assert_eq!(rig.request(bad, &packet(data)).status(), (0x13, 0), "{data:02X?}");
    }
    rig.assert_good_scanner_is_served();
}

#[test]
fn services_within_services_come_to_an_end() {
    let (mut rig, bad) = rig();
    let mut request = VENDOR.to_vec();
    for _ in 0..60 {
        let mut outer = vec![0x52, 2, 0x20, 6, 0x24, 1, 0x0A, 0xF0];
        outer.extend((request.len() as u16).to_le_bytes());
        outer.extend(&request);
        outer.resize(outer.len().next_multiple_of(2), 0);
        outer.extend([0, 0]);
        request = outer;
    }
    assert_eq!(rig.request(bad, &request).status(), (0x02, 0));
    let mut packet = VENDOR.to_vec();
    for _ in 0..20 {
        packet = [&[0x0A, 2, 0x20, 2, 0x24, 1, 1, 0, 4, 0][..], &packet].concat();
    }
    assert_eq!(rig.request(bad, &packet).status(), (0x1E, 0));
    rig.assert_good_scanner_is_served();
}

#[test]
fn a_forward_open_that_is_cut_off_at_any_byte_opens_nothing() {
    let (mut rig, bad) = rig();
    for large in [false, true] {
        let whole = open_message(&heartbeat(1, INPUT_ONLY_PATH), large);
        for cut in 6..whole.len() {
            assert_eq!(rig.request(bad, &whole[..cut]).status(), (0x13, 0), "{large}, cut at {cut}");
        }
        let close = close_message(owner(1).triad, INPUT_ONLY_PATH);
        for cut in 6..close.len() {
            assert_eq!(rig.request(bad, &close[..cut]).status(), (0x13, 0), "Forward_Close cut at {cut}");
        }
    }
    assert_eq!(rig.adapter.connections(), (1, 0));
    rig.assert_good_scanner_is_served();
}

#[test]
fn a_data_or_key_segment_past_the_path_is_an_invalid_segment() {
    let (mut rig, bad) = rig();
    let paths: [&'static [u8]; 4] = [
        &[0x20, 4, 0x2C, 152, 0x2C, 100, 0x80, 200],
        &[0x20, 4, 0x2C, 152, 0x2C, 100, 0x34, 4],
        &[0x34, 4, 0, 0],
        &[0x20, 4, 0x2C, 152, 0x2C, 100, 0x91, 200],
    ];
    for path in paths {
        assert_eq!(rig.try_open(bad, &heartbeat(1, path)), Err((1, 0x0315)), "{path:02X?}");
    }
    rig.assert_good_scanner_is_served();
}

#[test]
fn packet_intervals_of_0_and_of_an_hour_and_multipliers_above_7_open_nothing() {
    let (mut rig, bad) = rig();
    for micros in [0, 1, 3_600_000_000, u32::MAX] {
        let mut request = heartbeat(1, INPUT_ONLY_PATH);
        (request.o_t_rpi_us, request.t_o_rpi_us) = (micros, micros);
        assert_eq!(rig.try_open(bad, &request), Err((1, 0x0112)), "{micros} µs");
    }
    for multiplier in [8, 128, 255] {
        let request = ethernet_ip::connection::OpenRequest { multiplier, ..heartbeat(1, INPUT_ONLY_PATH) };
        assert_eq!(rig.try_open(bad, &request), Err((1, 0x0133)), "code {multiplier}");
    }
    rig.assert_good_scanner_is_served();
}

#[test]
fn a_duplicate_of_the_owners_triad_leaves_the_owner_alone() {
    let (mut rig, bad) = rig();
    assert_eq!(rig.try_open(bad, &owner(0xFFFF)), Err((1, 0x0100)));
    rig.assert_good_scanner_is_served();
}

#[test]
fn io_payloads_of_0_1_2_and_4_bytes_are_counted_and_thrown_away() {
    let (mut rig, _) = rig();
    let before = rig.adapter.counters().malformed;
    for len in [0, 1, 2, 4] {
        rig.datagram(IO_PORT, peer(PLC, IO_PORT), &vec![0; len]);
    }
    assert_eq!(rig.adapter.counters().malformed, before + 4);
    let opened = {
        let client = rig.client();
        rig.open(client, &heartbeat(1, INPUT_ONLY_PATH))
    };
    for (sequence, len) in [1, 2, 255].into_iter().enumerate() {
        rig.io(PLC, opened.o_t_id, sequence as u32 + 1, None, &vec![0; len]);
    }
    assert_eq!(rig.adapter.counters().malformed, before + 7);
    // A data item that is too short even for its sequence count.
    for data in [&[][..], &[1]] {
        let frame = items(2, |writer| {
            write_item(writer, kind::SEQUENCED_ADDRESS, |writer| {
                writer.u32(opened.o_t_id);
                writer.u32(9);
            });
            write_item(writer, kind::CONNECTED_DATA, |writer| writer.bytes(data));
        });
        rig.datagram(IO_PORT, peer(PLC, IO_PORT), &frame[6..]);
    }
    assert_eq!(rig.adapter.counters().malformed, before + 9);
    rig.assert_good_scanner_is_served_beside(2);
}

#[test]
fn io_frames_with_wrong_items_are_malformed() {
    let (mut rig, _) = rig();
    let before = rig.adapter.counters().malformed;
    for (address, data) in [(kind::CONNECTED_ADDRESS, kind::CONNECTED_DATA), (kind::SEQUENCED_ADDRESS, 0xB2)]
    {
        let frame = items(2, |writer| {
            write_item(writer, address, |writer| writer.zeros(8));
            write_item(writer, data, |writer| writer.zeros(262));
        });
        rig.datagram(IO_PORT, peer(PLC, IO_PORT), &frame[6..]);
    }
    assert_eq!(rig.adapter.counters().malformed, before + 2);
    rig.assert_good_scanner_is_served();
}

#[test]
fn io_frames_of_a_foreign_source_or_of_no_connection_change_nothing() {
    let (mut rig, _) = rig();
    let id = 0x0100_0001;
    let before = rig.adapter.counters().foreign;
    rig.io(Ipv4Addr::new(192, 168, 64, 66), id, 1_000_000, Some(true), &[0xEE; 256]);
    rig.io(PLC, 0xDEAD_BEEF, 1_000_000, Some(true), &[0xEE; 256]);
    assert_eq!(rig.adapter.counters().foreign, before + 2);
    assert_ne!(rig.adapter.consumed(CONSUMED), Some(&[0xEE; 256][..]));
    rig.assert_good_scanner_is_served();
}

#[test]
fn io_frames_that_come_twice_or_late_are_thrown_away() {
    let (mut rig, _) = rig();
    let (id, late) = (0x0100_0001, rig.adapter.counters().late);
    rig.io(PLC, id, 1, Some(true), &[0xEE; 256]);
    assert_eq!(rig.adapter.counters().late, late + 1);
    assert_ne!(rig.adapter.consumed(CONSUMED), Some(&[0xEE; 256][..]));
    rig.assert_good_scanner_is_served();
}

#[test]
fn a_datagram_with_many_messages_is_thrown_away_whole() {
    let (mut rig, _) = rig();
    let many = message(Command::ListIdentity, 0, &[]).repeat(50);
    assert!(rig.ask_udp(&many).is_empty(), "one datagram must not be answered by fifty");
    let frame_twice = [2, 0, 2, 0x80, 8, 0, 1, 0, 0, 1, 1, 0, 0, 0, 0xB1, 0, 2, 0, 0, 0].repeat(2);
    let before = rig.adapter.counters().malformed;
    rig.datagram(IO_PORT, peer(PLC, IO_PORT), &frame_twice);
    assert_eq!(rig.adapter.counters().malformed, before + 1);
    rig.assert_good_scanner_is_served();
}

#[test]
fn a_flood_of_connections_takes_no_more_places_than_there_are_and_leaves_good_clients_theirs() {
    let (mut rig, _) = rig();
    for _ in 0..1_000 {
        rig.connect_from(ROBOT);
        rig.advance(Duration::from_micros(50));
    }
    assert_eq!(rig.adapter.sessions(), 16);
    let late = rig.client();
    assert_eq!(rig.request(late, VENDOR).data, [0xFF, 0xFF], "a new client that registers gets a place");
    rig.assert_good_scanner_is_served();
}

#[test]
fn a_flood_of_sessions_of_one_host_ends_its_own_ones_once_all_places_are_taken() {
    let (mut rig, _) = rig();
    let mut own = Vec::new();
    for _ in 0..100 {
        rig.advance(Duration::from_micros(10));
        own.push(rig.client_from(ROBOT).stream);
    }
    assert_eq!((&rig.closed[..], rig.adapter.sessions()), (&own[..86], 16));
    rig.client();
    rig.assert_good_scanner_is_served();
}

#[test]
fn a_flood_of_forward_opens_ends_where_the_connections_do() {
    let (mut rig, bad) = rig();
    for serial in 1..500 {
        let _ = rig.try_open(bad, &heartbeat(serial, INPUT_ONLY_PATH));
        let _ = rig.try_open(bad, &explicit(serial + 1_000));
    }
    assert_eq!(rig.adapter.connections(), (4, 7), "one place of each kind is left for another host");
    rig.assert_good_scanner_is_served_beside(4);
}

#[test]
fn three_sessions_and_more_are_served_side_by_side() {
    let (mut rig, _) = rig();
    let clients: Vec<_> = (0..12).map(|_| rig.client()).collect();
    for client in &clients {
        rig.send(client.stream, &message(Command::SendRRData, client.session, &unconnected(VENDOR))[..30]);
    }
    for client in &clients {
        rig.send(client.stream, &message(Command::SendRRData, client.session, &unconnected(VENDOR))[30..]);
        assert!(rig.read(client.stream).is_some());
    }
    rig.assert_good_scanner_is_served();
}

#[test]
fn bytes_of_a_connection_that_is_gone_are_ignored() {
    let (mut rig, bad) = rig();
    rig.hang_up(bad.stream);
    rig.send(bad.stream, &message(Command::ListServices, 0, &[]));
    rig.send(StreamId(0xFFFF), &message(Command::ListServices, 0, &[]));
    assert!(rig.read(bad.stream).is_none());
    rig.assert_good_scanner_is_served();
}
