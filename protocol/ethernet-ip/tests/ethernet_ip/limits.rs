//! Where an adapter's limits are: the last value that it takes, and the first that it does not.

use std::net::Ipv4Addr;

use crate::samples::{DEVICE, PRODUCED};
use ethernet_ip::cip::{General, Path};
use ethernet_ip::connection::{ConnectionType, OpenRequest, Parameters, Priority, Transport};
use ethernet_ip::description::Description;
use ethernet_ip::encapsulation::Command;
use ethernet_ip::{AdapterConfig, ENCAPSULATION_PORT};
use machine::wire::FRAME_CAPACITY;
use machine::{
    Allowed, Duration, ForeignRequest, LinkEvent, Machine, Peer, Port, PortRequest, Requested, Sender, Source,
};

use crate::cell::{PLC, adapter, adapter_config, data};
use crate::client::{
    INPUT_ONLY_PATH, LISTEN_ONLY_PATH, OWNER_PATH, Rig, close_message, connected, explicit, heartbeat,
    message, owner, parameters, peer,
};
use crate::hostile::VENDOR;

const OTHER: Ipv4Addr = Ipv4Addr::new(192, 168, 64, 9);

#[test]
fn an_adapter_asks_for_the_udp_ports_of_cyclic_data_and_of_explicit_messages() {
    assert_eq!(adapter().ports(), [PortRequest::Udp(2_222), PortRequest::Udp(44_818)]);
}

#[test]
fn a_producer_may_be_inhibited_for_the_whole_of_its_interval_and_for_no_longer() {
    let mut rig = Rig::new();
    let client = rig.client();
    // A segment with a production inhibit time of 20 ms.
    let path = Path(&[0x43, 20, 0x20, 4, 0x2C, 152, 0x2C, 100]);
    let request =
        |t_o_rpi_us| OpenRequest { path, t_o_rpi_us, transport: Transport(0x11), ..heartbeat(1, &[]) };
    assert_eq!(rig.try_open(client, &request(19_999)), Err((1, 0x011B)));
    rig.open(client, &request(20_000));
}

#[test]
fn listen_only_connections_are_as_many_as_described_and_the_last_one_is_for_another_host() {
    let mut rig = Rig::new();
    let client = rig.client();
    let other = rig.client_from(OTHER);
    rig.open(client, &owner(1));
    for serial in 2..=4 {
        rig.open(client, &heartbeat(serial, LISTEN_ONLY_PATH));
    }
    assert_eq!(rig.try_open(client, &heartbeat(5, LISTEN_ONLY_PATH)), Err((1, 0x011A)));
    rig.open(other, &heartbeat(5, LISTEN_ONLY_PATH));
    assert_eq!(rig.try_open(other, &heartbeat(6, LISTEN_ONLY_PATH)), Err((1, 0x011A)));
}

#[test]
fn a_device_with_one_place_for_input_only_gives_it_to_the_first_host_that_asks() {
    const ONE: Description = Description { input_only: 1, ..DEVICE };
    let mut rig = Rig::of(AdapterConfig { description: &ONE, ..adapter_config() });
    let client = rig.client();
    rig.open(client, &heartbeat(1, INPUT_ONLY_PATH));
    assert_eq!(rig.try_open(client, &heartbeat(2, INPUT_ONLY_PATH)), Err((1, 0x011A)));
}

#[test]
fn a_heartbeat_is_a_sequence_count_alone_or_with_a_header_of_four_bytes() {
    let mut rig = Rig::new();
    let client = rig.client();
    let of = |serial, size| {
        let o_t = parameters(ConnectionType::PointToPoint, size);
        OpenRequest { o_t, ..heartbeat(serial, INPUT_ONLY_PATH) }
    };
    for (serial, size) in [(1, 2), (2, 6)] {
        rig.open(client, &of(serial, size));
    }
    for size in [0, 1, 3, 4, 5, 7, 8] {
        assert_eq!(rig.try_open(client, &of(3, size)), Err((1, 0x0127)), "{size} bytes");
    }
}

#[test]
fn a_device_with_one_place_for_class_3_gives_it_to_the_first_host_that_asks() {
    const ONE: Description = Description { explicit: 1, ..DEVICE };
    let mut rig = Rig::of(AdapterConfig { description: &ONE, ..adapter_config() });
    let client = rig.client();
    rig.open(client, &explicit(1));
    assert_eq!(rig.try_open(client, &explicit(2)), Err((1, 0x0113)));
}

#[test]
fn a_request_over_class_3_may_fill_its_connection_and_not_be_longer_nor_empty() {
    let mut rig = Rig::new();
    let client = rig.client();
    // Connections of 504 bytes, of which the sequence count takes two.
    let opened = rig.open(client, &explicit(1));
    let get_list = |attributes: usize| {
        let mut request = vec![3, 2, 0x20, 1, 0x24, 1];
        request.extend(u16::try_from(attributes).unwrap().to_le_bytes());
        request.extend([0x63, 0].repeat(attributes));
        request
    };
    let fills = get_list(247);
    assert_eq!(fills.len(), 502);
    // The reply does not fit, which it says.
    assert_eq!(
        rig.request_connected(client, &opened, 1, &fills).unwrap().general,
        General::ReplyDataTooLarge
    );
    let before = rig.adapter.counters().malformed;
    let longer = [&fills[..], &[0]].concat();
    for (count, refused) in [(2, &longer[..]), (3, &[])] {
        assert_eq!(rig.request_connected(client, &opened, count, refused), None);
    }
    assert_eq!(rig.adapter.counters().malformed, before + 2);
}

#[test]
fn each_class_3_connection_has_a_last_reply_of_its_own() {
    let mut rig = Rig::new();
    let client = rig.client();
    let (first, second) = (rig.open(client, &explicit(1)), rig.open(client, &explicit(2)));
    let name = &[0x0E, 3, 0x20, 1, 0x24, 1, 0x30, 7];
    assert_eq!(rig.request_connected(client, &first, 1, VENDOR).unwrap().data, [0xFF, 0xFF]);
    // The same sequence count on another connection is not a repetition.
    assert_eq!(rig.request_connected(client, &second, 1, name).unwrap().data, b"\x10sample device 01");
    assert_eq!(rig.request_connected(client, &first, 1, VENDOR).unwrap().data, [0xFF, 0xFF]);
}

#[test]
fn no_connection_gets_a_number_that_an_open_one_has() {
    let mut rig = Rig::of(AdapterConfig { first_id: 0x500, ..adapter_config() });
    let client = rig.client();
    // The originator has chosen the number that the adapter would give next.
    let taken = OpenRequest { t_o_id: 0x502, ..heartbeat(1, INPUT_ONLY_PATH) };
    assert_eq!(rig.open(client, &taken).o_t_id, 0x501);
    assert_eq!(rig.open(client, &heartbeat(2, INPUT_ONLY_PATH)).o_t_id, 0x503);
}

#[test]
fn what_is_sent_to_one_host_alone_is_no_multicast_that_others_must_fit() {
    let mut rig = Rig::new();
    let client = rig.client();
    rig.open(client, &owner(1));
    let t_o = Parameters { priority: Priority::High, ..parameters(ConnectionType::Multicast, 258) };
    let opened = rig.open(client, &OpenRequest { t_o, ..heartbeat(2, INPUT_ONLY_PATH) });
    assert_ne!(opened.t_o_id, owner(1).t_o_id, "a multicast of its own");
}

#[test]
fn a_cyclic_connection_sends_new_data_when_its_interval_is_over_and_not_at_once() {
    let mut rig = Rig::new();
    let client = rig.client();
    rig.open(client, &OpenRequest { path: Path(OWNER_PATH), t_o_rpi_us: 10_000, ..owner(1) });
    let start = rig.now;
    for change in 1..=20 {
        rig.advance(Duration::from_millis(1));
        rig.adapter.set_produced(PRODUCED, &[change; 256]).unwrap();
        rig.settle();
    }
    let sent: Vec<_> =
        rig.datagrams.iter().map(|(at, .., bytes)| (at.since(start).as_millis(), bytes[20])).collect();
    assert_eq!(sent, [(5, 5), (15, 15)]);
}

#[test]
fn a_tcp_connection_is_kept_until_the_last_connection_that_was_opened_over_it_is_silent() {
    let mut rig = Rig::new();
    let client = rig.client();
    let silent = rig.open(client, &heartbeat(1, INPUT_ONLY_PATH));
    let kept = rig.open(client, &heartbeat(2, INPUT_ONLY_PATH));
    rig.io(PLC, silent.o_t_id, 1, None, &[]);
    for sequence in 1..=30 {
        rig.io(PLC, kept.o_t_id, sequence, None, &[]);
        rig.advance(Duration::from_millis(1));
    }
    assert_eq!((rig.adapter.connections().0, &rig.closed[..]), (1, &[][..]));
    rig.advance(Duration::from_millis(30));
    assert_eq!((rig.adapter.connections().0, &rig.closed[..]), (0, &[client.stream][..]));
}

#[test]
fn a_multicast_goes_on_when_another_taker_than_its_first_leaves() {
    let mut rig = Rig::new();
    let client = rig.client();
    let t_o = parameters(ConnectionType::Multicast, 258);
    for serial in [1, 2] {
        rig.open(client, &OpenRequest { t_o, ..heartbeat(serial, INPUT_ONLY_PATH) });
    }
    rig.request(client, &close_message(owner(2).triad, &[]));
    rig.advance(Duration::from_micros(3_600));
    assert_eq!(rig.datagrams.len(), 4);
}

#[test]
fn a_tcp_connection_that_was_silent_for_longer_than_the_limit_is_ended_however_late_that_is_seen() {
    // The limit of the TCP/IP object is 120 s at the start.
    for late in [Duration::ZERO, Duration::from_millis(7)] {
        let mut rig = Rig::new();
        let client = rig.client();
        rig.now += Duration::from_secs(120) - Duration::from_nanos(1);
        rig.adapter.handle_timeout(rig.now);
        rig.settle();
        assert!(rig.closed.is_empty());
        rig.now += Duration::from_nanos(1) + late;
        rig.adapter.handle_timeout(rig.now);
        rig.settle();
        assert_eq!(rig.closed, [client.stream]);
    }
}

#[test]
fn clients_that_ask_for_much_at_once_are_answered_in_turn() {
    let mut rig = Rig::new();
    let clients = [rig.client(), rig.client(), rig.client()];
    let questions = message(Command::ListServices, 0, &[]).repeat(3);
    for client in clients {
        let from = Source { port: Port::Stream(client.stream), peer: None };
        rig.adapter.handle_frame(rig.now, from, &questions);
    }
    let mut buf = vec![0; FRAME_CAPACITY];
    let answered: Vec<_> = std::iter::from_fn(|| rig.adapter.poll_transmit(rig.now, &mut buf))
        .map(|answer| answer.port)
        .collect();
    let round = clients.map(|client| Port::Stream(client.stream));
    assert_eq!(answered.len(), 9);
    for three in answered.chunks(3) {
        assert!(round.iter().all(|port| three.contains(port)), "{answered:?}");
    }
}

#[test]
fn a_client_takes_the_place_of_the_host_with_the_most_and_of_its_own_where_that_is_itself() {
    for (others, own) in [(9, 7), (8, 8)] {
        let mut rig = Rig::new();
        let first_of_other = rig.client_from(OTHER);
        (1..others).for_each(|_| _ = rig.client_from(OTHER));
        let first = rig.client();
        (1..own).for_each(|_| _ = rig.client());
        rig.connect_from(PLC);
        let replaced = if others > own { first_of_other } else { first };
        assert_eq!(rig.closed, [replaced.stream], "{others} and {own}");
    }
}

#[test]
fn a_client_that_never_registered_goes_before_one_with_a_session() {
    let mut rig = Rig::new();
    (0..8).for_each(|_| _ = rig.client_from(OTHER));
    // Of the host with fewer connections, and heard last: only that it has no session decides.
    (0..7).for_each(|_| _ = rig.client());
    rig.advance(Duration::from_millis(1));
    let unregistered = rig.connect_from(PLC);
    // It may still register.
    rig.advance(Duration::from_millis(999));
    rig.connect_from(Ipv4Addr::new(192, 168, 64, 10));
    assert!(rig.closed.len() == 1 && !rig.closed.contains(&unregistered), "{:?}", rig.closed);
    rig.advance(Duration::from_millis(1));
    rig.connect_from(Ipv4Addr::new(192, 168, 64, 11));
    assert_eq!(rig.closed[1..], [unregistered]);
}

/// Returns an Unconnected_Send of a message, along a route.
fn unconnected_send(message: &[u8], route: &[u8]) -> Vec<u8> {
    let mut cip = vec![0x52, 2, 0x20, 6, 0x24, 1, 0x0A, 0xF0];
    cip.extend(u16::try_from(message.len()).unwrap().to_le_bytes());
    cip.extend(message);
    cip.resize(cip.len().next_multiple_of(2), 0);
    cip.extend([u8::try_from(route.len() / 2).unwrap(), 0]);
    cip.extend(route);
    cip
}

#[test]
fn a_service_is_reached_within_two_others_and_not_within_three_nor_within_a_packet_of_services() {
    let mut rig = Rig::new();
    let client = rig.client();
    let packet = |service: &[u8]| [&[0x0A, 2, 0x20, 2, 0x24, 1, 1, 0, 4, 0][..], service].concat();
    let twice = unconnected_send(&unconnected_send(VENDOR, &[]), &[]);
    assert_eq!(rig.request(client, &twice).data, [0xFF, 0xFF]);
    let answer = rig.request(client, &unconnected_send(&packet(VENDOR), &[]));
    assert_eq!((answer.status(), &answer.data[4..]), ((0, 0), &[0x8E, 0, 0, 0, 0xFF, 0xFF][..]));
    assert_eq!(rig.request(client, &unconnected_send(&twice, &[])).status(), (0x02, 0));
    assert_eq!(
        rig.request(client, &unconnected_send(&unconnected_send(&packet(VENDOR), &[]), &[])).status(),
        (0x02, 0)
    );
    // Each of a packet says for itself that it is refused, also behind one that was served.
    let two = [&[0x0A, 2, 0x20, 2, 0x24, 1, 2, 0, 6, 0, 14, 0][..], VENDOR, &unconnected_send(VENDOR, &[])]
        .concat();
    let answer = rig.request(client, &two);
    assert_eq!((answer.status(), answer.data.len()), ((0x1E, 0), 16));
    assert_eq!(answer.data[6..], [0x8E, 0, 0, 0, 0xFF, 0xFF, 0xD2, 0, 0x02, 0]);
}

#[test]
fn only_a_refusal_of_the_route_names_what_is_left_of_it_also_behind_a_message_of_an_odd_length() {
    let mut rig = Rig::new();
    let client = rig.client();
    let mut refused = |request: &[u8]| {
        let answer = rig.request(client, request);
        (answer.status(), answer.data)
    };
    let odd = [VENDOR, &[0]].concat();
    assert_eq!(refused(&unconnected_send(&odd, &[1, 0])), ((1, 0x0311), vec![1, 0]));
    assert_eq!(refused(&unconnected_send(&[], &[1, 0])), ((1, 0x0205), vec![]), "no message");
}

#[test]
fn an_adapter_reports_the_hosts_that_it_refuses_and_no_other_requests() {
    let mut rig = Rig::new();
    let client = rig.client();
    rig.open(client, &OpenRequest { o_t_rpi_us: 1_000_000, ..owner(1) });
    let other = rig.client_from(OTHER);
    let set_vendor = &[0x10, 3, 0x20, 1, 0x24, 1, 0x30, 1, 0, 0];
    rig.request(other, VENDOR);
    assert_eq!(rig.request(client, set_vendor).status(), (0x0E, 0));
    assert_eq!(rig.try_open(client, &owner(2)), Err((1, 0x0106)));
    assert_eq!(rig.events, [], "a read, and mistakes of the owner itself");
    let report = |what| {
        let owner = Some(Sender::Ip(PLC));
        LinkEvent::Foreign(ForeignRequest { from: Sender::Ip(OTHER), what, owner, more: 0 })
    };
    rig.request(other, set_vendor);
    assert_eq!(rig.events, [report(Requested::Write)]);
    // There is one report in 10 s.
    rig.advance(Duration::from_secs(10));
    let other = rig.client_from(OTHER);
    assert_eq!(rig.try_open(other, &owner(2)), Err((1, 0x0106)));
    assert_eq!(rig.events[1..], [report(Requested::Connection)]);
}

#[test]
fn an_adapter_reports_an_originator_that_is_not_on_its_list() {
    let listed = Peer { serial_number: Some(7), ..Peer::default() };
    let mut rig = Rig::of(AdapterConfig { originators: Allowed(vec![listed]), ..adapter_config() });
    let client = rig.client();
    assert_eq!(rig.try_open(client, &owner(1)).map(drop), Err((0x0F, 0)));
    let report = ForeignRequest { from: Sender::Ip(PLC), what: Requested::Connection, owner: None, more: 0 };
    assert_eq!(rig.events, [LinkEvent::Foreign(report)]);
}

#[test]
fn an_adapter_that_disconnects_drops_its_connections_of_both_classes() {
    let mut rig = Rig::new();
    let client = rig.client();
    rig.open(client, &owner(1));
    rig.open(client, &explicit(2));
    rig.adapter.disconnect(rig.now);
    assert_eq!(rig.adapter.connections(), (0, 0));
}

#[test]
fn of_nine_questions_to_all_that_may_wait_a_minute_the_last_in_turn_is_answered_at_once() {
    let mut rig = Rig::new();
    let mut question = message(Command::ListIdentity, 0, &[]);
    question[12..14].copy_from_slice(&60_000_u16.to_le_bytes());
    for host in 1..=8 {
        rig.broadcast(ENCAPSULATION_PORT, peer(Ipv4Addr::new(192, 168, 64, 100 + host), 40_000), &question);
    }
    assert!(rig.datagrams.is_empty());
    rig.broadcast(ENCAPSULATION_PORT, peer(Ipv4Addr::new(192, 168, 64, 109), 40_000), &question);
    assert_eq!(rig.datagrams.len(), 1);
    rig.advance(Duration::from_secs(61));
    assert_eq!(rig.datagrams.len(), 9, "each is answered once");
}

#[test]
fn each_message_that_is_not_understood_or_not_for_the_adapter_is_counted_once() {
    let mut rig = Rig::new();
    let client = rig.client();
    let opened = rig.open(client, &explicit(1));
    let send = |rig: &mut Rig, command, data: &[u8]| {
        rig.send(client.stream, &message(command, client.session, data));
    };
    let with_options = |session| {
        let mut bytes = message(Command::ListServices, session, &[]);
        bytes[20] = 1;
        bytes
    };
    let counted = |rig: &Rig| (rig.adapter.counters().malformed, rig.adapter.counters().foreign);
    let one_byte = {
        // An item of connected data that ends within its sequence count.
        let mut data = connected(opened.o_t_id, 1, &[]);
        let len = data.len();
        data[len - 4] = 1;
        data.truncate(len - 1);
        data
    };
    let send_too_long = |rig: &mut Rig| {
        let bytes = message(Command::SendRRData, client.session, &[0; 20_000]);
        bytes.chunks(1_000).for_each(|chunk| rig.send(client.stream, chunk));
    };
    type Step<'a> = (&'a str, &'a dyn Fn(&mut Rig), (u64, u64));
    let steps: [Step<'_>; 10] = [
        ("options", &|rig| rig.send(client.stream, &with_options(client.session)), (1, 0)),
        ("a message that is too long", &send_too_long, (1, 0)),
        ("no items", &|rig| send(rig, Command::SendRRData, &[0; 8]), (1, 0)),
        ("an empty request", &|rig| send(rig, Command::SendRRData, &crate::client::unconnected(&[])), (1, 0)),
        ("no connected items", &|rig| send(rig, Command::SendUnitData, &[0; 8]), (1, 0)),
        ("no sequence count", &|rig| send(rig, Command::SendUnitData, &one_byte), (1, 0)),
        ("no such connection", &|rig| send(rig, Command::SendUnitData, &connected(9, 1, VENDOR)), (0, 1)),
        ("half a header", &|rig| rig.datagram(ENCAPSULATION_PORT, peer(PLC, 40_000), &[0; 12]), (1, 0)),
        (
            "more than a frame",
            &|rig| rig.datagram(ENCAPSULATION_PORT, peer(PLC, 40_000), &[0; 4_097]),
            (1, 0),
        ),
        ("another port", &|rig| rig.datagram(1_234, peer(PLC, 40_000), &[0; 24]), (0, 1)),
    ];
    for (what, step, (malformed, foreign)) in steps {
        // Each twice: a counter that stays at 1 counts nothing.
        for _ in 0..2 {
            let before = counted(&rig);
            step(&mut rig);
            assert_eq!(counted(&rig), (before.0 + malformed, before.1 + foreign), "{what}");
        }
    }
}

#[test]
fn an_owner_that_sends_nothing_is_named_with_the_time_that_its_connection_lasts() {
    let remark = |rig: &Rig| {
        let mut words = String::new();
        rig.adapter.remark(&mut words).unwrap();
        words
    };
    let mut rig = Rig::new();
    assert_eq!(remark(&rig), "");
    let stranger = rig.client_from(OTHER);
    // The longest interval of the device, and the largest multiplier: 512 intervals.
    let request = OpenRequest { multiplier: 7, o_t_rpi_us: 1_000_000, t_o_rpi_us: 1_000_000, ..owner(1) };
    let opened = rig.open(stranger, &request);
    let named = "the scanner 192.168.64.9 (serial number 0x0BADCAFE) owns the outputs and has sent no frame yet; its connection \
                 ends 512.0 s after its last frame";
    assert_eq!(remark(&rig), named);
    let client = rig.client();
    assert_eq!(rig.try_open(client, &owner(2)), Err((1, 0x0106)), "another owner is refused");
    rig.io(OTHER, opened.o_t_id, 1, Some(false), &data(1));
    assert!(remark(&rig).contains("sends that it is idle"), "{}", remark(&rig));
    rig.io(OTHER, opened.o_t_id, 2, Some(true), &data(2));
    assert_eq!(remark(&rig), "");
}

#[test]
fn whoever_is_refused_the_outputs_can_ask_for_their_owner() {
    let mut rig = Rig::new();
    let client = rig.client();
    let ask = |rig: &mut Rig, path: &[u8]| {
        let words = u8::try_from(path.len() / 2).unwrap();
        rig.request(client, &[&[0x5A, 2, 0x20, 6, 0x24, 1, 0, words], path].concat())
    };
    assert_eq!(ask(&mut rig, OWNER_PATH).data, [0; 12], "nobody owns them");
    let stranger = rig.client_from(OTHER);
    let opened = rig.open(stranger, &owner(0x1234));
    let named = |action| [1, 0, 0, action, 0x34, 0x12, 1, 0, 0xFE, 0xCA, 0xAD, 0x0B];
    assert_eq!(ask(&mut rig, OWNER_PATH).data, named(1));
    rig.io(OTHER, opened.o_t_id, 1, Some(true), &data(1));
    assert_eq!(ask(&mut rig, OWNER_PATH).data, named(2));
    assert_eq!(ask(&mut rig, INPUT_ONLY_PATH).data, [0; 12], "no outputs, no owner");
    // A path that is shorter than its size says, and one that makes no sense.
    for wrong in [&[0x5A, 2, 0x20, 6, 0x24, 1][..], &[0x5A, 2, 0x20, 6, 0x24, 1, 0, 9, 0x20, 4]] {
        assert_ne!(rig.request(client, wrong).general, General::Success);
    }
    assert_ne!(ask(&mut rig, &[0xFF, 0xFF]).general, General::Success);
}
