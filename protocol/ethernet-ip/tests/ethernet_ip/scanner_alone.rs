//! A scanner without an adapter: what it tells its driver, and what it does with frames that are for nobody.

use std::net::Ipv4Addr;

use ethernet_ip::cip::Path;
use ethernet_ip::connection::{CloseRequest, OpenReply, OpenRequest, RealTimeFormat, Triad};
use ethernet_ip::encapsulation::{Command, HEADER_LEN, Header, Status};
use ethernet_ip::scanner::ExplicitAnswer;
use ethernet_ip::{ConnectionConfig, ConnectionId, IO_PORT, Scanner, class1};
use machine::wire::{FRAME_CAPACITY, LittleEndian, Writer};
use machine::{
    Attempt, Counters, DownCause, Duration, Instant, LinkEvent, Machine, Port, PortRequest, Source,
    StreamChange, StreamId, StreamRequest,
};

use crate::cell::{PLC, ROBOT, wanted};
use crate::client::{peer, unconnected};
use crate::samples::DEVICE;
use crate::single_connection::SCANNER;

#[test]
fn a_scanner_asks_for_the_udp_ports_of_cyclic_data_and_of_explicit_messages() {
    assert_eq!(Scanner::new(SCANNER).ports(), [PortRequest::Udp(2_222), PortRequest::Udp(44_818)]);
}

#[test]
fn a_scanner_marks_cyclic_frames_47_and_explicit_messages_27() {
    // The defaults of a device's QoS object for scheduled data and for explicit messages (volume 2, 5-7).
    let scanner = Scanner::new(SCANNER);
    assert_eq!(scanner.dscp(Port::Udp(IO_PORT)), 47);
    assert_eq!(scanner.dscp(Port::Stream(StreamId(1))), 27);
}

#[test]
fn each_frame_that_is_for_no_connection_of_a_scanner_is_counted_once() {
    let mut scanner = Scanner::new(SCANNER);
    scanner.connect(wanted(), Instant::from_millis(1)).unwrap();
    let mut frame = [0; 64];
    let len = class1::emit(&mut frame, (9, 1, 1), None, &[]).unwrap();
    let from = |port, ip: Option<Ipv4Addr>| Source { port, peer: ip.map(|ip| peer(ip, IO_PORT)) };
    let cyclic = Port::Udp(IO_PORT);
    let foreign = [
        ("no such connection", from(cyclic, Some(ROBOT))),
        ("no sender", from(cyclic, None)),
        ("no such TCP connection", from(Port::Stream(StreamId(7)), None)),
        ("another port", from(Port::Udp(1_234), Some(PLC))),
    ];
    for (what, source) in foreign {
        // Each twice: a counter that stays at 1 counts nothing.
        for _ in 0..2 {
            let before = scanner.counters();
            scanner.handle_frame(Instant::from_millis(1), source, &frame[..len]);
            let counters = scanner.counters();
            assert_eq!(
                (counters.foreign, counters.malformed),
                (before.foreign + 1, before.malformed),
                "{what}"
            );
        }
    }
}

#[test]
fn a_large_forward_open_is_for_connections_of_more_than_511_bytes() {
    // Nine bits of a plain Forward_Open hold the size. With the sequence count, and in O→T the header of four bytes:
    for (o_t_size, t_o_size, is_large) in [(505, 509, false), (506, 509, true), (505, 510, true)] {
        let config = ConnectionConfig {
            o_t_size,
            t_o_size,
            ..ConnectionConfig::exclusive_owner(ROBOT, &DEVICE, 1_000)
        };
        assert_eq!(config.is_large(), is_large, "{o_t_size} and {t_o_size} bytes");
    }
}

/// A scanner with one connection to an adapter that the test plays.
pub(crate) struct Dialogue {
    pub(crate) scanner: Scanner,
    pub(crate) id: ConnectionId,
    pub(crate) now: Instant,
    stream: StreamId,
    /// The TCP connection that it asks for.
    attempt: Option<Attempt>,
    /// The context of the last request, which its reply must have.
    context: [u8; 8],
    /// The triad of the last Forward_Open or Forward_Close.
    triad: Option<Triad>,
}

/// What a scanner sent over TCP: the command, and the service of a CIP request.
type Sent = (Command, u8);

const IDENTIFY: Sent = (Command::SendRRData, 0x01);
const OPEN: Sent = (Command::SendRRData, 0x54);
const EXPLICIT: Sent = (Command::SendRRData, 0x0E);
const CLOSE: Sent = (Command::SendRRData, 0x4E);

impl Dialogue {
    /// Starts a scanner; it has asked for a TCP connection.
    fn start() -> Self {
        Self::of(wanted())
    }

    fn of(config: ConnectionConfig) -> Self {
        let now = Instant::from_millis(1);
        let mut scanner = Scanner::new(SCANNER);
        let id = scanner.connect(config, now).unwrap();
        let mut dialogue =
            Self { scanner, id, now, stream: StreamId(0), attempt: None, context: [0; 8], triad: None };
        dialogue.scanner.handle_timeout(now);
        dialogue.assert_asks_for_tcp();
        dialogue
    }

    fn assert_asks_for_tcp(&mut self) {
        while let Some(request) = self.scanner.poll_stream() {
            if let StreamRequest::Connect { attempt, .. } = request {
                self.attempt = Some(attempt);
                return;
            }
        }
        panic!("it does not ask for a TCP connection");
    }

    fn accept(&mut self) {
        self.stream = StreamId(self.stream.0 + 1);
        let attempt = self.attempt.take().unwrap();
        self.scanner.handle_stream(self.now, self.stream, StreamChange::Connected(attempt));
        assert_eq!(self.sent(), [(Command::RegisterSession, 0)]);
    }

    /// Returns what the scanner sent over TCP since the last call.
    fn sent(&mut self) -> Vec<Sent> {
        let mut buf = vec![0; FRAME_CAPACITY];
        let mut sent = Vec::new();
        while let Some(transmit) = self.scanner.poll_transmit(self.now, &mut buf) {
            if transmit.port == Port::Udp(IO_PORT) {
                continue;
            }
            let header = Header::parse(&buf).unwrap();
            let cip = buf.get(HEADER_LEN + 16..transmit.len).unwrap_or_default();
            let service = cip.first().copied().unwrap_or(0);
            match service {
                0x54 => self.triad = Some(OpenRequest::parse(&cip[6..], false).unwrap().triad),
                0x4E => self.triad = Some(CloseRequest::parse(&cip[6..]).unwrap().triad),
                _ => {}
            }
            self.context = header.context;
            sent.push((header.command, service));
        }
        sent
    }

    fn receive(&mut self, bytes: &[u8]) {
        let from = Source { port: Port::Stream(self.stream), peer: None };
        self.scanner.handle_frame(self.now, from, bytes);
    }

    fn answer(&mut self, command: Command, context: [u8; 8], data: &[u8]) {
        let mut buf = vec![0; HEADER_LEN + data.len()];
        let header = Header { context, ..Header::request(command, 7) };
        header.emit(&mut buf, |writer| writer.bytes(data)).unwrap();
        self.receive(&buf);
    }

    fn register(&mut self) {
        self.answer(Command::RegisterSession, [0; 8], &[1, 0, 0, 0]);
    }

    /// Answers the last request by a CIP reply.
    fn reply(&mut self, cip: &[u8]) {
        self.answer(Command::SendRRData, self.context, &unconnected(cip));
    }

    fn identify(&mut self) {
        let identity = b"\xFF\xFF\x2B\0\x01\0\x01\x01\x34\0\x78\x56\x34\x12\x10sample device 01\x03";
        self.reply(&[&[0x81, 0, 0, 0], &identity[..]].concat());
    }

    /// Answers the Forward_Open, with this interval of O→T data.
    pub(crate) fn open(&mut self, o_t_api_us: u32) {
        let opened =
            OpenReply { o_t_id: 1, t_o_id: 2, triad: self.triad.unwrap(), o_t_api_us, t_o_api_us: 1_000 };
        let mut buf = [0; 30];
        let mut writer = Writer::<LittleEndian>::new(&mut buf);
        writer.bytes(&[0xD4, 0, 0, 0]);
        opened.emit(&mut writer);
        let len = writer.finish().unwrap();
        self.reply(&buf[..len]);
    }

    /// Returns a scanner that has sent its Forward_Open.
    fn opening() -> Self {
        Self::opening_of(wanted())
    }

    /// Returns the same for a connection of this configuration.
    pub(crate) fn opening_of(config: ConnectionConfig) -> Self {
        let mut dialogue = Self::of(config);
        dialogue.accept();
        dialogue.register();
        assert_eq!(dialogue.sent(), [IDENTIFY]);
        dialogue.identify();
        assert_eq!(dialogue.sent(), [OPEN]);
        dialogue
    }

    /// Waits for the scanner's next attempt, and accepts it up to the session.
    fn begin_again(&mut self) {
        self.advance(SECOND);
        self.assert_asks_for_tcp();
        self.accept();
        self.register();
    }

    fn advance(&mut self, time: Duration) {
        self.now += time;
        self.scanner.handle_timeout(self.now);
    }

    /// Returns why the connection went down since the last call.
    fn down(&mut self) -> Option<(DownCause, &'static str)> {
        std::iter::from_fn(|| self.scanner.poll_event()).find_map(|(_, event)| match event {
            LinkEvent::Down(down) => Some((down.cause, down.text)),
            _ => None,
        })
    }

    pub(crate) fn counters(&self) -> Counters {
        self.scanner.connection(self.id).unwrap().counters()
    }
}

/// A scanner waits for an answer, and for its next attempt, for a second each.
const SECOND: Duration = Duration::from_secs(1);

/// And for the answer to a Forward_Open for longer, since a device may configure itself first.
const OPENING: Duration = Duration::from_secs(5);

#[test]
fn a_scanner_says_which_of_its_questions_was_not_answered() {
    let silent_for = |time: Duration, mut dialogue: Dialogue| {
        dialogue.advance(time - Duration::from_nanos(1));
        assert_eq!(dialogue.down(), None);
        dialogue.advance(Duration::from_nanos(1));
        let (cause, text) = dialogue.down().unwrap();
        assert_eq!(cause, DownCause::NoAnswer);
        text
    };
    let silent = |dialogue| silent_for(SECOND, dialogue);
    assert!(silent(Dialogue::start()).contains("TCP port 44818 of the adapter does not answer"));
    let mut dialogue = Dialogue::start();
    dialogue.accept();
    assert!(silent(dialogue).contains("RegisterSession"));
    let mut dialogue = Dialogue::start();
    dialogue.accept();
    dialogue.register();
    assert!(silent(dialogue).contains("identity"));
    assert!(silent_for(OPENING, Dialogue::opening()).contains("did not answer the Forward_Open"));
    let mut dialogue = Dialogue::opening();
    dialogue.advance(OPENING);
    dialogue.sent();
    dialogue.down();
    dialogue.begin_again();
    assert_eq!(dialogue.sent(), [CLOSE]);
    assert!(silent(dialogue).contains("Forward_Close of an earlier attempt"));
}

#[test]
fn a_scanner_that_was_refused_its_tcp_connection_says_so_at_once_and_once() {
    let mut dialogue = Dialogue::start();
    let attempt = dialogue.attempt.unwrap();
    dialogue.scanner.handle_stream(dialogue.now, StreamId(0), StreamChange::NotConnected(attempt));
    assert_eq!(dialogue.down().map(|(cause, _)| cause), Some(DownCause::NoAnswer));
    let again = dialogue.now + SECOND;
    assert_eq!(dialogue.scanner.poll_timeout(), Some(again));
    // Told once more, in the pause: it does not begin anew.
    dialogue.now += Duration::from_millis(300);
    dialogue.scanner.handle_stream(dialogue.now, StreamId(0), StreamChange::NotConnected(attempt));
    assert_eq!((dialogue.down(), dialogue.scanner.poll_timeout()), (None, Some(again)));
}

#[test]
fn a_scanner_closes_first_what_an_unanswered_forward_open_may_have_opened_and_nothing_else() {
    // Unanswered: the adapter may hold the connection.
    let mut dialogue = Dialogue::opening();
    let opened = dialogue.triad;
    dialogue.advance(OPENING);
    dialogue.sent();
    dialogue.begin_again();
    assert_eq!((dialogue.sent(), dialogue.triad), (vec![CLOSE], opened));
    // Not even asked.
    let mut dialogue = Dialogue::start();
    dialogue.accept();
    dialogue.advance(SECOND);
    dialogue.sent();
    dialogue.begin_again();
    assert_eq!(dialogue.sent(), [IDENTIFY]);
    // Silent after it was open: the scanner has closed it over its TCP connection.
    let mut dialogue = Dialogue::opening();
    dialogue.open(1_000);
    dialogue.advance(Duration::from_secs(10));
    assert_eq!(dialogue.down().map(|(cause, _)| cause), Some(DownCause::Watchdog));
    assert_eq!(dialogue.sent(), [CLOSE, (Command::UnRegisterSession, 0)]);
    dialogue.begin_again();
    assert_eq!(dialogue.sent(), [IDENTIFY]);
}

#[test]
fn a_scanner_asks_an_adapter_once_to_close_what_it_may_hold_and_then_goes_on_without() {
    type Fail = fn(&mut Dialogue);
    let failures: [(&str, Fail); 3] = [
        ("no answer", |dialogue| dialogue.advance(SECOND)),
        ("end of TCP", |dialogue| {
            dialogue.scanner.handle_stream(dialogue.now, dialogue.stream, StreamChange::Closed);
        }),
        ("encapsulation error", |dialogue| {
            let mut buf = [0; HEADER_LEN];
            let request = Header::request(Command::SendRRData, 7);
            let header = Header { context: dialogue.context, status: Status::InvalidCommand, ..request };
            header.emit(&mut buf, |_| {}).unwrap();
            dialogue.receive(&buf);
        }),
    ];
    for (what, fail) in failures {
        let mut dialogue = Dialogue::opening();
        dialogue.advance(OPENING);
        dialogue.sent();
        dialogue.begin_again();
        assert_eq!(dialogue.sent(), [CLOSE], "{what}");
        fail(&mut dialogue);
        assert!(dialogue.down().is_some(), "{what}");
        dialogue.sent();
        dialogue.begin_again();
        assert_eq!(dialogue.sent(), [IDENTIFY], "{what}");
    }
}

#[test]
fn a_scanner_that_is_disconnected_before_it_is_connected_ends_for_good() {
    let mut dialogue = Dialogue::start();
    let now = dialogue.now;
    dialogue.scanner.connection_mut(dialogue.id).unwrap().disconnect(now);
    assert_eq!(dialogue.down(), Some((DownCause::ClosedHere, "")));
    assert_eq!(dialogue.scanner.poll_timeout(), None);
}

#[test]
fn a_connection_that_is_removed_closes_its_tcp_connection() {
    let mut dialogue = Dialogue::opening();
    assert!(dialogue.scanner.remove(dialogue.id).is_some());
    assert_eq!(dialogue.scanner.poll_stream(), Some(StreamRequest::Close(dialogue.stream)));
}

#[test]
fn an_interval_of_100_microseconds_is_the_shortest_that_a_scanner_accepts() {
    for (o_t_api_us, is_accepted) in [(99, false), (100, true)] {
        let mut dialogue = Dialogue::opening();
        dialogue.open(o_t_api_us);
        assert_eq!(dialogue.down().is_none(), is_accepted, "{o_t_api_us} µs");
    }
}

#[test]
fn each_message_that_a_scanner_cannot_use_is_counted_once_and_changes_nothing() {
    let mut dialogue = Dialogue::opening();
    let context = dialogue.context;
    let earlier = {
        let mut context = context;
        context[0] = context[0].wrapping_sub(1);
        context
    };
    let too_long = {
        let mut buf = vec![0; 20_000];
        Header::request(Command::SendRRData, 7).emit(&mut buf, |writer| writer.zeros(19_000)).unwrap();
        buf.truncate(HEADER_LEN + 19_000);
        buf
    };
    let refusal = unconnected(&[0xD4, 0, 0x01, 1, 0x13, 0x01]);
    type Step<'a> = (&'a str, &'a dyn Fn(&mut Dialogue), (u64, u64));
    let steps: [Step<'_>; 6] = [
        ("a message that is too long", &|d| too_long.chunks(1_000).for_each(|part| d.receive(part)), (1, 0)),
        ("no items", &|d| d.answer(Command::SendRRData, context, &[0; 8]), (1, 0)),
        (
            "half a reply",
            &|d| d.answer(Command::SendRRData, context, &unconnected(&[0xD4, 0, 0, 0, 1])),
            (1, 0),
        ),
        ("the answer to an earlier request", &|d| d.answer(Command::SendRRData, earlier, &refusal), (0, 1)),
        ("another command", &|d| d.answer(Command::ListServices, context, &[]), (0, 1)),
        (
            "another service",
            &|d| d.answer(Command::SendRRData, context, &unconnected(&[0x8E, 0, 0, 0])),
            (0, 1),
        ),
    ];
    for (what, step, (malformed, foreign)) in steps {
        // Each twice: a counter that stays at 1 counts nothing.
        for _ in 0..2 {
            let before = dialogue.counters();
            step(&mut dialogue);
            let after = dialogue.counters();
            let counted = (after.malformed - before.malformed, after.foreign - before.foreign);
            assert_eq!(counted, (malformed, foreign), "{what}");
            assert_eq!((dialogue.down(), dialogue.sent()), (None, vec![]), "{what}");
        }
    }
    dialogue.open(1_000);
    assert_eq!(dialogue.counters(), Counters { malformed: 6, foreign: 6, ..Counters::default() });
}

#[test]
fn data_behind_a_header_follow_its_run_bit_and_each_frame_is_counted_for_what_it_is() {
    let mut dialogue =
        Dialogue::opening_of(ConnectionConfig { produced_format: RealTimeFormat::RunIdleHeader, ..wanted() });
    dialogue.open(1_000);
    let mut receive = |sequence, run, data: &[u8]| {
        let mut frame = [0; 512];
        let len = class1::emit(&mut frame, (2, sequence, sequence as u16), run, data).unwrap();
        let from = Source { port: Port::Udp(IO_PORT), peer: Some(peer(ROBOT, IO_PORT)) };
        dialogue.scanner.handle_frame(dialogue.now, from, &frame[..len]);
        let connection = dialogue.scanner.connection(dialogue.id).unwrap();
        (connection.is_up(), connection.input().map(|input| input[0]), connection.counters())
    };
    let counted =
        |received, lost, late, malformed| Counters { received, lost, late, malformed, ..Counters::default() };
    assert_eq!(receive(1, Some(true), &[7; 256]), (true, Some(7), counted(1, 0, 0, 0)));
    assert_eq!(receive(2, None, &[8; 256]), (true, Some(7), counted(1, 0, 0, 1)), "without a header");
    assert_eq!(receive(5, Some(true), &[9; 256]), (true, Some(9), counted(2, 3, 0, 1)), "three are missing");
    assert_eq!(receive(5, Some(true), &[1; 256]), (true, Some(9), counted(2, 3, 1, 1)), "again");
    assert_eq!(receive(3, Some(true), &[1; 256]), (true, Some(9), counted(2, 3, 2, 1)), "late");
    assert_eq!(receive(6, Some(false), &[2; 256]), (false, None, counted(3, 3, 2, 1)), "idle");
}

#[test]
fn a_scanner_knows_whom_it_asked_and_explains_what_a_place_that_is_missing_means() {
    let mut dialogue = Dialogue::opening();
    let explained = |dialogue: &Dialogue| {
        let mut words = String::new();
        dialogue.scanner.connection(dialogue.id).unwrap().explain(&mut words).unwrap();
        words
    };
    let identity = dialogue.scanner.connection(dialogue.id).unwrap().identity().copied();
    assert_eq!(identity.map(|identity| identity.serial_number), Some(0x1234_5678));
    assert_eq!(explained(&dialogue), "");
    dialogue.reply(&[0xD4, 0, 0x01, 1, 0x13, 0x01]);
    assert_eq!(dialogue.down().map(|(cause, _)| cause), Some(DownCause::Refused));
    let words = explained(&dialogue);
    assert!(
        words.contains("connections for 1 owner, 4 input-only, 4 listen-only and 8 of class 3"),
        "{words}"
    );
}

#[test]
fn outputs_that_are_changed_in_place_are_in_the_next_frame() {
    let mut dialogue = Dialogue::opening();
    dialogue.open(1_000);
    dialogue.scanner.connection_mut(dialogue.id).unwrap().output_mut().fill(5);
    let mut buf = vec![0; FRAME_CAPACITY];
    let frame = dialogue.scanner.poll_transmit(dialogue.now, &mut buf).unwrap();
    assert_eq!((frame.port, &buf[frame.len - 256..frame.len]), (Port::Udp(IO_PORT), &[5; 256][..]));
}

#[test]
fn an_identity_in_a_reply_that_is_no_success_is_not_the_adapters() {
    let mut dialogue = Dialogue::start();
    dialogue.accept();
    dialogue.register();
    assert_eq!(dialogue.sent(), [IDENTIFY]);
    // Partial data of a device of vendor 9, which is not the one that is wanted.
    dialogue.reply(b"\x81\0\x06\0\x09\0\x2B\0\x01\0\x01\x01\x34\0\x78\x56\x34\x12\x04name\x03");
    assert_eq!((dialogue.sent(), dialogue.down()), (vec![OPEN], None));
    assert_eq!(dialogue.scanner.connection(dialogue.id).unwrap().identity(), None);
}

#[test]
fn an_open_connection_without_data_is_reported_within_seconds_and_comes_up_when_they_come() {
    let produced_format = RealTimeFormat::RunIdleHeader;
    for (is_idle, cause, expected) in [
        (false, DownCause::NoAnswer, "has sent no frame yet"),
        (true, DownCause::PeerIdle, "the adapter's program does not run"),
    ] {
        let mut dialogue = Dialogue::opening_of(ConnectionConfig { produced_format, ..wanted() });
        dialogue.open(1_000);
        let mut sequence = 0;
        let mut receive = |dialogue: &mut Dialogue, run: bool| {
            sequence += 1;
            let mut frame = [0; FRAME_CAPACITY];
            let data = vec![7; usize::from(wanted().t_o_size)];
            let len = class1::emit(&mut frame, (2, sequence, sequence as u16), Some(run), &data).unwrap();
            let from = Source { port: Port::Udp(IO_PORT), peer: Some(peer(ROBOT, IO_PORT)) };
            dialogue.scanner.handle_frame(dialogue.now, from, &frame[..len]);
        };
        let mut reported = Vec::new();
        for tenth in 1..=90 {
            if is_idle {
                receive(&mut dialogue, false);
            }
            dialogue.advance(Duration::from_millis(100));
            reported.extend(dialogue.down().map(|down| (tenth, down)));
        }
        let [(20, (found, text))] = reported[..] else { panic!("{reported:?}") };
        assert!(found == cause && text.contains(expected), "{found:?}: {text}");
        // It is the same connection: no Forward_Close, and data bring it up.
        assert_eq!(dialogue.sent(), []);
        receive(&mut dialogue, true);
        assert!(dialogue.scanner.connection(dialogue.id).unwrap().is_up());
    }
}

#[test]
fn a_scanner_says_that_its_adapter_granted_other_intervals_than_asked_while_the_connection_is_up() {
    for (granted_us, expected) in [
        (1_000, ""),
        (
            900,
            "faster than asked: it grants a packet every 900 µs O→T and 1000 µs T→O, asked were 1000 and 1000 µs",
        ),
        (4_000, "it grants a packet every 4000 µs O→T and 1000 µs T→O"),
    ] {
        let mut dialogue = Dialogue::opening();
        dialogue.open(granted_us);
        let remark = |dialogue: &Dialogue| {
            let mut words = String::new();
            dialogue.scanner.connection(dialogue.id).unwrap().remark(&mut words).unwrap();
            words
        };
        assert_eq!(remark(&dialogue), "");
        let mut frame = [0; FRAME_CAPACITY];
        let data = vec![7; usize::from(wanted().t_o_size)];
        let len = class1::emit(&mut frame, (2, 1, 1), None, &data).unwrap();
        let from = Source { port: Port::Udp(IO_PORT), peer: Some(peer(ROBOT, IO_PORT)) };
        dialogue.scanner.handle_frame(dialogue.now, from, &frame[..len]);
        assert!(dialogue.scanner.connection(dialogue.id).unwrap().is_up());
        let said = remark(&dialogue);
        assert!(said.contains(expected) && said.is_empty() == expected.is_empty(), "{granted_us}: {said}");
    }
}

#[test]
fn an_adapter_whose_outputs_are_owned_is_asked_once_by_whom_and_its_silence_changes_nothing() {
    const OWNER: Sent = (Command::SendRRData, 0x5A);
    const DATA: Sent = (Command::SendRRData, 0x57);
    // The owner's connection: 10 s O→T, multiplier 7.
    let data = [
        &[0xD7, 0, 0, 0, 1, 0, 3, 0, 2, 0, 0, 0, 5, 0, 0x34, 0x12, 0xEF, 0xBE, 0xAD, 0xDE][..],
        &[0, 0, 0, 0, 1, 0, 0, 0, 7, 0, 0, 0, 0x80, 0x96, 0x98, 0, 0x80, 0x96, 0x98, 0].repeat(2),
    ]
    .concat();
    let owned = [0xD4, 0, 1, 1, 6, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
    let answers: [(&str, Option<&[u8]>, &str); 3] = [
        (
            "named",
            Some(&[0xDA, 0, 0, 0, 1, 0, 0, 1, 5, 0, 0x34, 0x12, 0xEF, 0xBE, 0xAD, 0xDE]),
            "vendor 4660, serial number 0xDEADBEEF, idle or silent, with a packet every 10000000 µs and a time-out of 5120 s",
        ),
        ("not supported", Some(&[0xDA, 0, 8, 0]), ""),
        ("no answer", None, ""),
    ];
    for (what, answer, expected) in answers {
        let mut dialogue = Dialogue::opening();
        dialogue.reply(&owned);
        assert_eq!((dialogue.sent(), dialogue.down()), (vec![OWNER], None), "{what}");
        match answer {
            Some(answer) => dialogue.reply(answer),
            None => dialogue.advance(SECOND),
        }
        if what == "named" {
            assert_eq!((dialogue.sent(), dialogue.down()), (vec![DATA], None));
            dialogue.reply(&data);
        }
        assert_eq!(dialogue.down().map(|(cause, _)| cause), Some(DownCause::Refused), "{what}");
        let said = dialogue.scanner.connection(dialogue.id).unwrap().refusal().unwrap().to_string();
        assert!(
            said.contains("another scanner owns the outputs") && said.contains(expected),
            "{what}: {said}"
        );
        assert_eq!(said.contains("; the owner is "), !expected.is_empty(), "{what}: {said}");
        // There is nothing to close.
        assert_eq!(dialogue.sent(), [(Command::UnRegisterSession, 0)], "{what}");
    }
}

#[test]
fn a_late_answer_to_an_explicit_request_does_not_end_the_cyclic_data() {
    for status in [Status::Success, Status::InsufficientMemory] {
        let mut dialogue = Dialogue::opening();
        dialogue.open(1_000);
        let (id, now) = (dialogue.id, dialogue.now);
        let connection = dialogue.scanner.connection_mut(id).unwrap();
        connection.request(now, 0x0E, Path(&[0x20, 1, 0x24, 1, 0x30, 1]), &[]).unwrap();
        assert_eq!(dialogue.sent(), [EXPLICIT]);
        dialogue.advance(SECOND);
        let connection = dialogue.scanner.connection_mut(id).unwrap();
        assert_eq!(connection.take_answer().map(|(answer, _)| answer), Some(ExplicitAnswer::NoAnswer));
        let before = dialogue.counters().foreign;
        let mut buf = [0; HEADER_LEN];
        let header = Header { context: dialogue.context, status, ..Header::request(Command::SendRRData, 7) };
        header.emit(&mut buf, |_| {}).unwrap();
        dialogue.receive(&buf);
        assert_eq!((dialogue.down(), dialogue.counters().foreign), (None, before + 1), "{status:?}");
    }
}
