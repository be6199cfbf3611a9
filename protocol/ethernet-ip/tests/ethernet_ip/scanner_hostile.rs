//! What a scanner must survive.
//!
//! In one file, because all of its short tests begin with the same set-up of a scanner.

use std::net::{Ipv4Addr, SocketAddrV4};

use ethernet_ip::cpf::{kind, write_address, write_item};
use ethernet_ip::encapsulation::{Command, Header, Status};
use ethernet_ip::{ConnectionConfig, ENCAPSULATION_PORT, IO_PORT, class1};
use machine::wire::{FRAME_CAPACITY, LittleEndian, Writer};
use machine::{Attempt, Duration, Instant, Machine, Port, Source, StreamChange, StreamId, StreamRequest};
use machine::{DownCause, LinkEvent};
use proptest::prelude::*;

use crate::cell::{Bus, PLC, ROBOT, bus_of, cable, run, up, wanted};
use crate::client::peer;
use crate::samples::CONSUMED;
use crate::single_connection::SingleConnection;

fn datagram(bus: &mut Bus, port: u16, from: Ipv4Addr, bytes: &[u8]) {
    bus.command_a(|scanner, now| {
        let source = Source { port: Port::Udp(port), peer: Some(peer(from, port)) };
        scanner.handle_frame(now, source, bytes);
    });
}

/// Asserts that data are exchanged: each side received 100 frames in the last 100 ms.
fn assert_exchanging(bus: &mut Bus) {
    let before = [bus.a().counters().received, bus.b().counters().received];
    run(bus, 100);
    let after = [bus.a().counters().received, bus.b().counters().received];
    for (before, after) in before.into_iter().zip(after) {
        assert!((99..=101).contains(&(after - before)), "{} frames in 100 ms", after - before);
    }
    assert!(bus.a().input().is_some() && bus.b().consumed(CONSUMED).is_some());
}

/// The number of the connection T→O: the scanner's first.
const T_O_ID: u32 = 0x5C00_0001;

#[test]
fn cyclic_datagrams_of_0_1_2_and_4_bytes_are_counted_and_thrown_away() {
    let mut bus = up(wanted());
    for len in [0, 1, 2, 4, 19] {
        datagram(&mut bus, IO_PORT, ROBOT, &vec![0; len]);
    }
    assert_eq!(bus.a().counters().malformed, 5);
    assert_exchanging(&mut bus);
}

#[test]
fn cyclic_frames_of_another_size_connection_or_source_change_nothing() {
    let mut bus = up(wanted());
    let mut buf = [0; 1_024];
    for len in [0, 1, 2, 4, 255, 257] {
        let len = class1::emit(&mut buf, (T_O_ID, 1 << 20, 1), None, &[0xEE; 257][..len]).unwrap();
        datagram(&mut bus, IO_PORT, ROBOT, &buf[..len]);
    }
    assert_eq!(bus.a().counters().malformed, 6);
    let len = class1::emit(&mut buf, (T_O_ID, 1 << 20, 1), None, &[0xEE; 256]).unwrap();
    datagram(&mut bus, IO_PORT, Ipv4Addr::new(192, 168, 64, 66), &buf[..len]);
    let len = class1::emit(&mut buf, (T_O_ID + 7, 1 << 20, 1), None, &[0xEE; 256]).unwrap();
    datagram(&mut bus, IO_PORT, ROBOT, &buf[..len]);
    assert_eq!(bus.a().counters().foreign, 2);
    assert_ne!(bus.a().input(), Some(&[0xEE; 256][..]));
    assert_exchanging(&mut bus);
}

#[test]
fn bytes_over_tcp_that_make_no_sense_do_not_disturb_the_images() {
    let mut bus = up(wanted());
    for length in [0, 24, 100, 4_000] {
        bus.command_a(|scanner, now| {
            // The only stream that the run has made.
            let source = Source { port: Port::Stream(StreamId(1)), peer: None };
            scanner.handle_frame(now, source, &vec![0xA5; length]);
        });
    }
    assert_exchanging(&mut bus);
}

#[test]
fn a_connection_that_nobody_asked_for_is_closed() {
    let mut scanner = SingleConnection::new(wanted(), Instant::from_millis(1));
    scanner.handle_stream(Instant::ZERO, StreamId(9), StreamChange::Connected(Attempt(0)));
    assert_eq!(scanner.poll_stream(), Some(StreamRequest::Close(StreamId(9))));
}

/// A scanner that talks to an adapter of the test's own making.
pub(crate) struct Dialogue {
    pub(crate) scanner: SingleConnection,
    now: Instant,
    stream: StreamId,
    streams: u32,
}

impl Dialogue {
    fn new() -> Self {
        Self::of(wanted())
    }

    fn of(config: ConnectionConfig) -> Self {
        let mut dialogue = Self {
            scanner: SingleConnection::new(config, Instant::from_millis(1)),
            now: Instant::from_millis(1),
            stream: StreamId(0),
            streams: 0,
        };
        dialogue.scanner.handle_timeout(dialogue.now);
        dialogue.settle();
        dialogue
    }

    /// Follows the contract; connections are made at once. Returns what was said, and what happened.
    fn settle(&mut self) -> (Vec<Vec<u8>>, Vec<LinkEvent>) {
        let (mut said, mut events) = (Vec::new(), Vec::new());
        let mut buf = vec![0; FRAME_CAPACITY];
        for step in 0.. {
            assert!(step < 100, "the scanner does not come to rest");
            let mut rest = true;
            while let Some(transmit) = self.scanner.poll_transmit(self.now, &mut buf) {
                rest = false;
                said.push(buf[..transmit.len].to_vec());
            }
            while let Some(request) = self.scanner.poll_stream() {
                rest = false;
                if let StreamRequest::Connect { to, attempt } = request {
                    assert_eq!(to, SocketAddrV4::new(ROBOT, ENCAPSULATION_PORT));
                    self.streams += 1;
                    self.stream = StreamId(self.streams);
                    self.scanner.handle_stream(self.now, self.stream, StreamChange::Connected(attempt));
                }
            }
            while let Some(event) = self.scanner.poll_event() {
                events.push(event);
            }
            if rest {
                break;
            }
        }
        (said, events)
    }

    fn receive(&mut self, bytes: &[u8]) -> (Vec<Vec<u8>>, Vec<LinkEvent>) {
        let source = Source { port: Port::Stream(self.stream), peer: None };
        self.scanner.handle_frame(self.now, source, bytes);
        self.settle()
    }

    /// Returns an encapsulation reply to a request.
    fn reply(
        &mut self,
        request: &[u8],
        session: u32,
        status: Status,
        data: &[u8],
    ) -> (Vec<Vec<u8>>, Vec<LinkEvent>) {
        let header = Header { session, ..Header::parse(request).unwrap().reply(status) };
        let mut buf = vec![0; 24 + data.len()];
        header.emit(&mut buf, |writer| writer.bytes(data)).unwrap();
        self.receive(&buf)
    }

    pub(crate) fn reply_cip(&mut self, request: &[u8], cip: &[u8]) -> (Vec<Vec<u8>>, Vec<LinkEvent>) {
        let mut buf = [0; 2_048];
        let mut writer = Writer::<LittleEndian>::new(&mut buf);
        writer.zeros(6);
        writer.u16(2);
        write_item(&mut writer, kind::NULL_ADDRESS, |_| {});
        write_item(&mut writer, kind::UNCONNECTED_DATA, |writer| writer.bytes(cip));
        let len = writer.finish().unwrap();
        self.reply(request, 7, Status::Success, &buf[..len])
    }
}

/// Returns a dialogue up to the question for the identity, which is returned.
fn asked_for_identity() -> (Dialogue, Vec<u8>) {
    asked_for_identity_by(wanted())
}

/// Returns the same of a scanner with this connection.
pub(crate) fn asked_for_identity_by(config: ConnectionConfig) -> (Dialogue, Vec<u8>) {
    let mut dialogue = Dialogue::of(config);
    let mut register = vec![0; 28];
    Header::request(Command::RegisterSession, 0).emit(&mut register, |writer| writer.zeros(4)).unwrap();
    let (said, _) = dialogue.reply(&register, 7, Status::Success, &[1, 0, 0, 0]);
    assert_eq!(said.len(), 1);
    let question = said[0].clone();
    (dialogue, question)
}

#[test]
fn an_adapter_that_refuses_the_session_is_named() {
    let mut dialogue = Dialogue::new();
    let mut register = vec![0; 28];
    Header::request(Command::RegisterSession, 0).emit(&mut register, |writer| writer.zeros(4)).unwrap();
    let (_, events) = dialogue.reply(&register, 0, Status::InsufficientMemory, &[]);
    let [LinkEvent::Down(down)] = events[..] else { panic!("{events:?}") };
    assert_eq!((down.cause, down.text), (DownCause::Refused, "the receiver has no memory for the command"));
}

#[test]
fn an_adapter_that_does_not_tell_who_it_is_is_still_connected_to() {
    let (mut dialogue, question) = asked_for_identity();
    let (said, events) = dialogue.reply_cip(&question, &[0x81, 0, 0x08, 0]);
    assert!(events.is_empty() && said.len() == 1);
    // SendRRData, and in it a Forward_Open.
    assert_eq!((said[0][0], said[0][40]), (0x6F, 0x54));
}

#[test]
fn the_identity_is_that_of_the_adapter_behind_the_bridge_and_not_of_the_bridge() {
    let route = || ConnectionConfig { route: vec![1, 3], ..wanted() };
    let (mut dialogue, question) = asked_for_identity_by(route());
    // SendRRData, and in it an Unconnected_Send: 31 ticks of 32 ms, 6 bytes of Get_Attributes_All, one word of route.
    let expected = b"\x52\x02\x20\x06\x24\x01\x05\x1F\x06\0\x01\x02\x20\x01\x24\x01\x01\0\x01\x03";
    assert_eq!((question[0], &question[40..]), (0x6F, &expected[..]));
    let identity = b"\x81\0\0\0\xFF\xFF\x2B\0\x01\0\x01\x01\x34\0\x78\x56\x34\x12\x01d\x03";
    let (said, events) = dialogue.reply_cip(&question, identity);
    assert!(events.is_empty() && said.len() == 1);
    assert_eq!((said[0][0], said[0][40]), (0x6F, 0x54), "a Forward_Open");
    // A bridge that has no such port says how many words of the route are left.
    let (mut dialogue, question) = asked_for_identity_by(route());
    let (said, events) = dialogue.reply_cip(&question, &[0xD2, 0, 1, 1, 0x11, 3, 1, 0]);
    assert!(events.is_empty() && said.len() == 1);
    assert_eq!((said[0][0], said[0][40]), (0x6F, 0x54), "its refusal will say why");
    let (_, events) = dialogue.reply_cip(&said[0], &[0xD4, 0, 1, 1, 0x11, 3]);
    let [LinkEvent::Down(down)] = events[..] else { panic!("{events:?}") };
    assert_eq!((down.cause, down.code), (DownCause::Refused, 0x0001_0311));
}

#[test]
fn replies_that_are_cut_off_or_answer_nothing_are_waited_out() {
    let (mut dialogue, question) = asked_for_identity();
    for cip in [&[][..], &[0x81], &[0x81, 0, 0], &[0x81, 0, 0, 9], &[0xCE, 0, 0, 0], &[0x0E, 0, 0, 0]] {
        let (said, events) = dialogue.reply_cip(&question, cip);
        assert!(said.is_empty() && events.is_empty(), "{cip:02X?}");
    }
    dialogue.now += Duration::from_secs(1);
    dialogue.scanner.handle_timeout(dialogue.now);
    let (said, events) = dialogue.settle();
    let [LinkEvent::Down(down)] = events[..] else { panic!("{events:?}") };
    assert_eq!(down.cause, DownCause::NoAnswer);
    assert_eq!(said[0][0], 0x66, "the session is given back");
    assert_eq!(dialogue.scanner.poll_timeout(), Some(dialogue.now + Duration::from_secs(1)));
}

/// Returns the reply to a Forward_Open with one interval for both directions, in µs.
fn opened(serial: u16, interval_us: u32) -> Vec<u8> {
    let mut reply = vec![0xD4, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0x5C];
    reply.extend(serial.to_le_bytes());
    reply.extend([0xFF, 0xFF, 1, 0, 0, 0]);
    reply.extend(interval_us.to_le_bytes());
    reply.extend(interval_us.to_le_bytes());
    reply.extend([0, 0]);
    reply
}

#[test]
fn a_forward_open_reply_that_is_cut_off_or_of_another_connection_opens_nothing() {
    let (mut dialogue, question) = asked_for_identity();
    let (said, _) = dialogue.reply_cip(&question, &[0x81, 0, 0x08, 0]);
    let request = said[0].clone();
    for reply in [opened(99, 1_000), opened(1, 1_000)[..20].to_vec()] {
        let (said, events) = dialogue.reply_cip(&request, &reply);
        assert!(said.is_empty() && events.is_empty());
    }
    let (said, _) = dialogue.reply_cip(&request, &opened(1, 1_000));
    assert_eq!(said[0].len(), 280, "and the good one starts the cyclic data");
}

#[test]
fn an_adapter_that_wants_data_all_the_time_gets_none_and_its_connection_closed() {
    for interval_us in [0, 1, 99] {
        let (mut dialogue, question) = asked_for_identity();
        let (said, _) = dialogue.reply_cip(&question, &[0x81, 0, 0x08, 0]);
        let (said, events) = dialogue.reply_cip(&said[0], &opened(1, interval_us));
        let [LinkEvent::Down(down)] = events[..] else { panic!("{events:?}") };
        assert_eq!((down.cause, down.code), (DownCause::Refused, interval_us));
        // SendRRData with a Forward_Close, and UnRegisterSession.
        assert_eq!((said.len(), said[0][0], said[0][40], said[1][0]), (2, 0x6F, 0x4E, 0x66));
    }
}

#[test]
fn an_adapter_that_names_the_intervals_it_would_serve_is_quoted() {
    let (mut dialogue, question) = asked_for_identity();
    let (said, _) = dialogue.reply_cip(&question, &[0x81, 0, 0x08, 0]);
    // Extended status 0x0112, two minima, 2000 µs O→T and 4000 µs T→O.
    let reply = [0xD4, 0, 1, 6, 0x12, 1, 2, 2, 0xD0, 7, 0, 0, 0xA0, 0x0F, 0, 0];
    let request = said[0].clone();
    dialogue.reply_cip(&request, &reply);
    let words = dialogue.scanner.connection().refusal().unwrap().to_string();
    assert!(
        words.ends_with("the device would take at least 2000 µs O→T and at least 4000 µs T→O; ask for another packet interval"),
        "{words}"
    );
}

#[test]
fn an_adapter_that_wants_configuration_data_is_quoted_with_their_size_in_bytes() {
    let (mut dialogue, question) = asked_for_identity();
    let (said, _) = dialogue.reply_cip(&question, &[0x81, 0, 0x08, 0]);
    // Extended status 0x0126, 5 words.
    dialogue.reply_cip(&said[0], &[0xD4, 0, 1, 2, 0x26, 1, 5, 0]);
    let words = dialogue.scanner.connection().refusal().unwrap().to_string();
    assert!(
        words.contains("; the device has 10 bytes of configuration data; configure the device"),
        "{words}"
    );
}

#[test]
fn an_adapter_whose_interval_is_more_than_four_times_as_long_as_asked_gets_no_data() {
    for (interval_us, is_served) in [(4_000, true), (4_001, false), (u32::MAX, false)] {
        let (mut dialogue, question) = asked_for_identity();
        let (said, _) = dialogue.reply_cip(&question, &[0x81, 0, 0x08, 0]);
        let (said, events) = dialogue.reply_cip(&said[0], &opened(1, interval_us));
        if is_served {
            assert_eq!((said[0].len(), events.len()), (280, 0));
        } else {
            let [LinkEvent::Down(down)] = events[..] else { panic!("{events:?}") };
            assert_eq!((down.cause, down.code), (DownCause::Refused, interval_us));
            assert_eq!(said[0][40], 0x4E, "and its connection is closed");
        }
    }
}

/// Returns a CIP reply in whose packet the adapter names the receiver of its data.
fn with_receiver(cip: &[u8], receiver: SocketAddrV4) -> Vec<u8> {
    let mut buf = [0; 2_048];
    let mut writer = Writer::<LittleEndian>::new(&mut buf);
    writer.zeros(6);
    writer.u16(3);
    write_item(&mut writer, kind::NULL_ADDRESS, |_| {});
    write_item(&mut writer, kind::UNCONNECTED_DATA, |writer| writer.bytes(cip));
    write_item(&mut writer, kind::SOCKET_ADDRESS_O_T, |writer| write_address(writer, receiver));
    let len = writer.finish().unwrap();
    buf[..len].to_vec()
}

#[test]
fn data_go_to_the_adapter_at_the_port_that_it_names_and_to_no_third_host() {
    let third = Ipv4Addr::new(192, 168, 64, 77);
    let cases = [
        (peer(Ipv4Addr::UNSPECIFIED, 50_000), Some(peer(ROBOT, 50_000))),
        (peer(ROBOT, 0), Some(peer(ROBOT, IO_PORT))),
        (peer(third, IO_PORT), None),
    ];
    for (named, expected) in cases {
        let (mut dialogue, question) = asked_for_identity();
        let (said, _) = dialogue.reply_cip(&question, &[0x81, 0, 0x08, 0]);
        let items = with_receiver(&opened(1, 1_000), named);
        let header = Header { session: 7, ..Header::parse(&said[0]).unwrap().reply(Status::Success) };
        let mut buf = vec![0; 24 + items.len()];
        header.emit(&mut buf, |writer| writer.bytes(&items)).unwrap();
        let source = Source { port: Port::Stream(dialogue.stream), peer: None };
        dialogue.scanner.handle_frame(dialogue.now, source, &buf);
        let mut frame = vec![0; FRAME_CAPACITY];
        let sent = dialogue.scanner.poll_transmit(dialogue.now, &mut frame).unwrap();
        assert_eq!(sent.to, expected, "{named}");
        if expected.is_none() {
            let (_, events) = dialogue.settle();
            let [LinkEvent::Down(down)] = events[..] else { panic!("{events:?}") };
            assert_eq!((down.cause, down.code), (DownCause::Refused, third.to_bits()));
        }
    }
}

#[test]
fn a_connection_that_an_attempt_without_an_answer_left_open_is_closed_before_the_next_one() {
    let (mut dialogue, question) = asked_for_identity();
    let (said, _) = dialogue.reply_cip(&question, &[0x81, 0, 0x08, 0]);
    let triad = said[0][56..64].to_vec();
    // The adapter opens the connection; its answer and the TCP connection are lost.
    dialogue.scanner.handle_stream(dialogue.now, dialogue.stream, StreamChange::Closed);
    dialogue.settle();
    dialogue.now += Duration::from_secs(1);
    dialogue.scanner.handle_timeout(dialogue.now);
    let (said, _) = dialogue.settle();
    assert_eq!(said[0][0], 0x65, "RegisterSession");
    let (said, _) = dialogue.reply(&said[0].clone(), 7, Status::Success, &[1, 0, 0, 0]);
    assert_eq!((said.len(), said[0][40]), (1, 0x4E), "Forward_Close");
    assert_eq!(said[0][48..56], triad);
    // Connection not found: the adapter had given it up itself.
    let (said, _) = dialogue.reply_cip(&said[0].clone(), &[0xCE, 0, 1, 1, 7, 1]);
    assert_eq!((said.len(), said[0][40]), (1, 0x01), "the question for the identity");
}

#[test]
fn an_adapter_with_another_serial_number_than_listed_is_not_opened() {
    for (serial_number, is_up) in [(0x1234_5678, true), (0x1234_5679, false)] {
        let config = ConnectionConfig { serial_number: Some(serial_number), ..wanted() };
        let mut bus = bus_of(config, cable(), 1);
        let events = run(&mut bus, 50);
        assert_eq!(bus.a().input().is_some(), is_up, "{events:?}");
        assert_eq!(bus.b().connections().0, usize::from(is_up));
    }
}

#[test]
fn another_device_is_refused_for_its_identity_and_not_for_what_its_reply_adds() {
    let (mut dialogue, question) = asked_for_identity();
    // Success, with a word of additional status that says "invalid connection size", and all attributes of a stranger.
    let mut reply = vec![0x81, 0, 0, 1, 0x09, 0x01];
    reply.extend([0x99, 0x99, 1, 0, 1, 0, 1, 1, 0, 0, 1, 0, 0, 0, 1, b'x']);
    let (_, events) = dialogue.reply_cip(&question, &reply);
    let [LinkEvent::Down(down)] = events[..] else { panic!("{events:?}") };
    assert_eq!((down.cause, down.code), (DownCause::Refused, 0x25 << 16), "{}", down.text);
}

#[test]
fn a_stream_that_grows_without_a_message_is_ended() {
    let mut dialogue = Dialogue::new();
    let mut endless = vec![0; 24];
    endless[2..4].copy_from_slice(&4_000_u16.to_le_bytes());
    endless.resize(4_000, 0);
    // Never complete: each is cut before its end, and the next begins in it.
    for _ in 0..10_000 {
        dialogue.receive(&endless[..3_999]);
        dialogue.now += Duration::from_micros(10);
    }
    assert!(dialogue.scanner.poll_timeout().is_some());
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 100, ..ProptestConfig::default() })]

    #[test]
    fn no_datagram_on_any_port_makes_the_scanner_panic_or_miss_its_grid(
        frames in prop::collection::vec((any::<bool>(), prop::collection::vec(any::<u8>(), 0..400)), 1..20),
    ) {
        let mut bus = up(wanted());
        for (from_robot, frame) in frames {
            datagram(&mut bus, IO_PORT, if from_robot { ROBOT } else { PLC }, &frame);
            datagram(&mut bus, ENCAPSULATION_PORT, ROBOT, &frame);
        }
        assert_exchanging(&mut bus);
    }

    #[test]
    fn no_bytes_over_tcp_make_the_scanner_panic_or_stop_trying(
        steps in prop::collection::vec((0..4_u8, prop::collection::vec(any::<u8>(), 0..120), any::<u16>()), 1..30),
    ) {
        let mut dialogue = Dialogue::new();
        for (kind, bytes, time) in steps {
            match kind {
                0 => { dialogue.receive(&bytes); }
                1 => {
                    let mut request = [0; 24];
                    request[0] = 0x65 + (time % 12) as u8;
                    request[12] = (time % 5) as u8;
                    dialogue.reply(&request, 7, Status::Success, &bytes);
                }
                2 => {
                    let mut request = [0; 24];
                    request[0] = 0x6F;
                    request[12] = (time % 5) as u8;
                    let service = [0x81, 0xD4, 0xCE][usize::from(time) % 3];
                    dialogue.reply_cip(&request, &[&[service, 0, 0, 0][..], &bytes].concat());
                }
                _ => {
                    dialogue.now += Duration::from_millis(u64::from(time) % 700);
                    dialogue.scanner.handle_timeout(dialogue.now);
                    dialogue.settle();
                }
            }
        }
        prop_assert!(dialogue.scanner.poll_timeout().is_some(), "a scanner always has a next step");
    }

    #[test]
    fn after_each_bad_input_the_good_adapters_data_still_come_on_time(
        inputs in prop::collection::vec((0..3_u8, prop::collection::vec(any::<u8>(), 0..400)), 1..8),
    ) {
        let mut bus = up(wanted());
        for (port, bytes) in inputs {
            match port {
                0 => datagram(&mut bus, IO_PORT, ROBOT, &bytes),
                1 => datagram(&mut bus, ENCAPSULATION_PORT, ROBOT, &bytes),
                _ => bus.command_a(|scanner, now| {
                    let source = Source { port: Port::Stream(StreamId(1)), peer: None };
                    scanner.handle_frame(now, source, &bytes);
                }),
            }
            let before = bus.a().counters().received;
            run(&mut bus, 10);
            let received = bus.a().counters().received - before;
            prop_assert!((9..=11).contains(&received), "{received} frames in 10 ms");
        }
        assert_exchanging(&mut bus);
    }

    #[test]
    fn a_scanner_that_is_fed_garbage_at_any_step_of_its_start_still_comes_up_with_a_good_adapter(
        inputs in prop::collection::vec(
            (900..1_400_u64, any::<bool>(), prop::collection::vec(any::<u8>(), 0..200)), 1..6,
        ),
    ) {
        let mut inputs = inputs;
        inputs.sort();
        let mut bus = bus_of(wanted(), cable(), 3);
        for (micros, over_tcp, bytes) in inputs {
            bus.next_event(Instant::from_micros(micros));
            if over_tcp {
                bus.command_a(|scanner, now| {
                    let source = Source { port: Port::Stream(StreamId(1)), peer: None };
                    scanner.handle_frame(now, source, &bytes);
                });
            } else {
                datagram(&mut bus, IO_PORT, ROBOT, &bytes);
            }
        }
        // At worst the answer it waits for was buried: one request's timeout, one pause, and the next attempt. What the
        // first attempt opened may have to time out before.
        run(&mut bus, 16_000);
        assert_exchanging(&mut bus);
    }

    #[test]
    fn a_scanner_that_was_fed_garbage_over_tcp_still_closes_and_comes_up_again(
        bytes in prop::collection::vec(any::<u8>(), 0..600),
    ) {
        let mut bus = up(wanted());
        bus.command_a(|scanner, now| {
            scanner.handle_frame(now, Source { port: Port::Stream(StreamId(1)), peer: None }, &bytes);
        });
        bus.set_cut(true);
        run(&mut bus, 4_000);
        bus.set_cut(false);
        run(&mut bus, 4_000);
        assert_exchanging(&mut bus);
    }
}
