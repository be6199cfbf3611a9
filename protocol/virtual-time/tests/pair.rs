//! Two machines on one cable.

use std::collections::VecDeque;
use std::fmt::Write;
use std::net::{Ipv4Addr, SocketAddrV4};

use machine::{
    Attempt, Duration, Instant, Machine, Port, PortRequest, Source, StreamChange, StreamId, StreamRequest,
    Transmit,
};
use virtual_time::{Clock, Event, FrameFault, FrameFaults, Impairment, Link, Pair, PairConfig, Side};

/// Sends a number every millisecond of its own clock and reports received numbers.
struct Counter {
    next: Instant,
    sent: u8,
    due: bool,
    received: VecDeque<(Instant, u8)>,
}

impl Counter {
    fn new(first: Instant) -> Self {
        Self { next: first, sent: 0, due: false, received: VecDeque::new() }
    }
}

impl Machine for Counter {
    type Event = (Instant, u8);

    fn ports(&self) -> &[PortRequest] {
        &[]
    }

    fn handle_frame(&mut self, now: Instant, _from: Source, frame: &[u8]) {
        self.received.push_back((now, frame[0]));
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.next = self.next.next_on_grid(Duration::from_millis(1), now).0;
        self.due = true;
    }

    fn poll_transmit(&mut self, _now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        core::mem::take(&mut self.due).then(|| {
            self.sent += 1;
            buf[0] = self.sent;
            Transmit { port: Port::Ethernet, to: None, len: 1 }
        })
    }

    fn poll_event(&mut self) -> Option<Self::Event> {
        self.received.pop_front()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        Some(self.next)
    }
}

fn transcript(seed: u64, link: Impairment) -> String {
    let clocks = [Clock { offset_ns: 0, drift_ppb: 0 }, Clock { offset_ns: 500_000, drift_ppb: 40_000 }];
    let config = PairConfig { seed, clocks, links: [link; 2], addresses: [None; 2] };
    let first = Instant::from_millis(1);
    let mut pair = Pair::new(Counter::new(first), Counter::new(first), config);
    let mut text = String::new();
    while let Some(event) = pair.next_event(Instant::from_millis(6)) {
        let _ = match event {
            Event::A((at, number)) => writeln!(text, "A got {number} at {at:?}"),
            Event::B((at, number)) => writeln!(text, "B got {number} at {at:?}"),
        };
    }
    text
}

#[test]
fn each_side_uses_its_own_clock() {
    let link = Impairment { delay: Duration::from_micros(30), ..Impairment::default() };
    insta::assert_snapshot!(transcript(1, link), @r"
    A got 1 at 0.000529981s
    B got 1 at 0.001530041s
    A got 2 at 0.001529941s
    B got 2 at 0.002530081s
    A got 3 at 0.002529901s
    B got 3 at 0.003530121s
    A got 4 at 0.003529861s
    B got 4 at 0.004530161s
    A got 5 at 0.004529821s
    B got 5 at 0.005530201s
    A got 6 at 0.005529781s
    ");
}

#[test]
fn the_same_seed_gives_the_same_nanoseconds_under_every_fault() {
    let link = Impairment {
        delay: Duration::from_micros(30),
        jitter: Duration::from_micros(200),
        loss_ppm: 200_000,
        duplicate_ppm: 200_000,
        reorder_ppm: 200_000,
        reorder_by: Duration::from_millis(2),
        corrupt_ppm: 200_000,
        corrupt_on_wire_ppm: 200_000,
        frame_faults: FrameFaults::NONE,
    };
    assert_eq!(transcript(7, link), transcript(7, link));
    assert_ne!(transcript(7, link), transcript(8, link));
}

#[test]
fn a_bit_that_flips_on_the_wire_loses_the_frame_and_one_behind_the_checksum_arrives() {
    for (on_wire, arrived) in [(0, 9), (1_000_000, 0)] {
        let link =
            Impairment { corrupt_ppm: 1_000_000, corrupt_on_wire_ppm: on_wire, ..Impairment::default() };
        let mut link = Link::new(link, 1, 0);
        let mut arrivals = 0;
        for _ in 0..9 {
            link.pass(Instant::ZERO, &[0; 8], |_, _, frame| {
                arrivals += 1;
                assert_eq!(frame.iter().map(|byte| byte.count_ones()).sum::<u32>(), 1);
            });
        }
        let counters = link.counters();
        assert_eq!(
            (arrivals, counters.corrupted, counters.corrupted_on_wire),
            (arrived, arrived, 9 - arrived)
        );
        assert_eq!(counters.lost, 9 - arrived);
    }
}

#[test]
fn a_strike_hits_the_frame_of_its_number_and_no_other() {
    let by = Duration::from_millis(2);
    let none = [0; 8];
    let flipped = [0, 0x20, 0, 0, 0, 0, 0, 0];
    for (frame_fault, copies, latest_ms, third) in [
        (FrameFault::Lose, [1, 1, 0, 1], 0, None),
        (FrameFault::Double, [1, 1, 2, 1], 0, Some(none)),
        (FrameFault::Hold(by), [1; 4], 2, Some(none)),
        (FrameFault::FlipOnWire, [1, 1, 0, 1], 0, None),
        // Bit 77 of 64 is bit 13.
        (FrameFault::Flip(77), [1; 4], 0, Some(flipped)),
    ] {
        let mut frame_faults = FrameFaults::NONE;
        assert!(frame_faults.add(3, frame_fault));
        let mut link = Link::new(Impairment { frame_faults, ..Impairment::default() }, 1, 0);
        let mut latest = Instant::ZERO;
        let arrivals = [1, 2, 3, 4].map(|number| {
            let mut copies = 0;
            link.pass(Instant::ZERO, &none, |at, _, frame| {
                (copies, latest) = (copies + 1, latest.max(at));
                assert_eq!(frame, if number == 3 { third.unwrap() } else { none }, "{frame_fault:?}");
            });
            copies
        });
        assert_eq!((arrivals, latest), (copies, Instant::from_millis(latest_ms)), "{frame_fault:?}");
    }
}

#[test]
fn a_direction_has_room_for_a_few_strikes_and_all_of_them_hit() {
    let mut frame_faults = FrameFaults::NONE;
    assert!((1..=4).all(|frame| frame_faults.add(2 * frame, FrameFault::Lose)));
    assert!(!frame_faults.add(10, FrameFault::Lose));
    let mut link = Link::new(Impairment { frame_faults, ..Impairment::default() }, 1, 0);
    let arrives = [(); 10].map(|()| {
        let mut arrives = false;
        link.pass(Instant::ZERO, &[0], |_, _, _| arrives = true);
        arrives
    });
    assert_eq!(arrives, [true, false, true, false, true, false, true, false, true, true]);
}

#[test]
fn a_cut_cable_and_a_killed_node_deliver_nothing() {
    let first = Instant::from_millis(1);
    let mut pair = Pair::new(
        Counter::new(first),
        Counter::new(first),
        PairConfig {
            seed: 0,
            clocks: [Clock::default(); 2],
            links: [Impairment::default(); 2],
            addresses: [None; 2],
        },
    );
    pair.set_cut(true);
    assert_eq!(pair.next_event(Instant::from_millis(3)), None);
    assert_eq!(pair.link_counters(Side::A).lost, 3);
    pair.set_cut(false);
    pair.kill(Side::B);
    assert_eq!(pair.next_event(Instant::from_millis(9)), None);
    assert_eq!(pair.link_counters(Side::A).sent, 9);
    assert_eq!(pair.link_counters(Side::B).sent, 3);
}

#[test]
fn a_pair_stops_at_a_frame_and_a_node_that_is_started_again_counts_from_one() {
    let first = Instant::from_millis(1);
    let config = PairConfig {
        seed: 0,
        clocks: [Clock::default(); 2],
        links: [Impairment::default(); 2],
        addresses: [None; 2],
    };
    let mut pair = Pair::new(Counter::new(first), Counter::new(first), config);
    pair.stop_at_frame(Side::B, Some(3));
    while pair.next_event(Instant::from_millis(9)).is_some() {}
    assert_eq!(pair.now(), Instant::from_millis(3));
    pair.kill(Side::B);
    while pair.next_event(Instant::from_millis(5)).is_some() {}
    assert_eq!(pair.now(), Instant::from_millis(5));
    pair.restart_b(Counter::new(Instant::from_millis(6)));
    let numbers: Vec<_> = std::iter::from_fn(|| pair.next_event(Instant::from_millis(7))).collect();
    let at = Instant::from_millis;
    let (six, seven) =
        ([Event::B((at(6), 6)), Event::A((at(6), 1))], [Event::B((at(7), 7)), Event::A((at(7), 2))]);
    assert_eq!(numbers, [six, seven].concat());
}

/// Connects to TCP port 7 of its peer, or listens there, sends all its bytes, and records what it receives.
#[derive(Default)]
struct Talker {
    connect: Option<SocketAddrV4>,
    say: Vec<u8>,
    stream: Option<StreamId>,
    close: bool,
    heard: Vec<u8>,
    pieces: usize,
    changes: Vec<(Instant, StreamChange)>,
}

impl Machine for Talker {
    type Event = ();

    fn ports(&self) -> &[PortRequest] {
        &[]
    }

    fn handle_frame(&mut self, _now: Instant, _from: Source, frame: &[u8]) {
        self.heard.extend_from_slice(frame);
        self.pieces += 1;
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        self.changes.push((now, change));
        self.stream =
            matches!(change, StreamChange::Accepted(_) | StreamChange::Connected(_)).then_some(stream);
    }

    fn listen_port(&self) -> Option<u16> {
        Some(7)
    }

    fn poll_stream(&mut self) -> Option<StreamRequest> {
        if core::mem::take(&mut self.close) {
            return self.stream.take().map(StreamRequest::Close);
        }
        self.connect.take().map(|to| StreamRequest::Connect { to, attempt: Attempt(0) })
    }

    fn handle_timeout(&mut self, _now: Instant) {}

    fn poll_transmit(&mut self, _now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let stream = self.stream.filter(|_| !self.say.is_empty())?;
        let len = self.say.len().min(buf.len());
        buf[..len].copy_from_slice(&self.say[..len]);
        self.say.drain(..len);
        Some(Transmit { port: Port::Stream(stream), to: None, len })
    }

    fn poll_event(&mut self) -> Option<()> {
        None
    }

    fn poll_timeout(&self) -> Option<Instant> {
        None
    }
}

fn talk(to: SocketAddrV4, say: &[u8], link: Impairment) -> Pair<Talker, Talker> {
    let config = PairConfig {
        seed: 3,
        clocks: [Clock::default(); 2],
        links: [link; 2],
        addresses: [Some(Ipv4Addr::new(10, 0, 0, 1)), Some(Ipv4Addr::new(10, 0, 0, 2))],
    };
    let talker = Talker { connect: Some(to), say: say.to_vec(), ..Talker::default() };
    Pair::new(talker, Talker::default(), config)
}

const LISTENER: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::new(10, 0, 0, 2), 7);

#[test]
fn a_stream_arrives_in_pieces_complete_and_in_order_even_over_a_lossy_cable() {
    let said: Vec<u8> = (0..20_000_u32).map(|number| number as u8 ^ (number >> 8) as u8).collect();
    let jitter = Duration::from_millis(1);
    let link = Impairment { jitter, loss_ppm: 100_000, duplicate_ppm: 100_000, ..Impairment::default() };
    let mut pair = talk(LISTENER, &said, link);
    assert_eq!(pair.next_event(Instant::from_millis(60_000)), None);
    assert!(pair.b().heard == said && pair.b().pieces > 20, "{} pieces", pair.b().pieces);
}

#[test]
fn a_connection_that_nobody_accepts_is_reported_closed() {
    let mut pair = talk(SocketAddrV4::new(*LISTENER.ip(), 8), b"", Impairment::default());
    pair.next_event(Instant::from_millis(10));
    assert_eq!(pair.a().changes, [(Instant::ZERO, StreamChange::NotConnected(Attempt(0)))]);
    let mut pair = talk(SocketAddrV4::new(Ipv4Addr::new(10, 0, 0, 3), 7), b"", Impairment::default());
    pair.next_event(Instant::from_millis(10_000));
    assert_eq!(pair.a().changes, [(Instant::from_millis(3_000), StreamChange::NotConnected(Attempt(0)))]);
}

#[test]
fn a_stream_survives_a_short_cut_and_closes_at_both_ends_in_a_long_one() {
    let mut pair = talk(LISTENER, b"before", Impairment::default());
    pair.next_event(Instant::from_millis(10));
    pair.set_cut(true);
    pair.command_a(|a, _| a.say.extend_from_slice(b" and after"));
    pair.next_event(Instant::from_millis(1_000));
    assert_eq!(pair.b().heard, b"before");
    pair.set_cut(false);
    pair.next_event(Instant::from_millis(1_001));
    assert_eq!(pair.b().heard, b"before and after");

    pair.set_cut(true);
    pair.command_a(|a, _| a.say.extend_from_slice(b", never"));
    pair.next_event(Instant::from_millis(9_000));
    let closed = (Instant::from_millis(4_001), StreamChange::Closed);
    assert_eq!((pair.a().changes.last(), pair.b().changes.last()), (Some(&closed), Some(&closed)));
}

#[test]
fn bytes_sent_before_the_close_still_arrive() {
    let link = Impairment { delay: Duration::from_micros(50), ..Impairment::default() };
    let mut pair = talk(LISTENER, b"", link);
    pair.next_event(Instant::from_millis(1));
    pair.command_a(|a, _| {
        a.say.extend_from_slice(b"goodbye");
        a.close = true;
    });
    pair.next_event(Instant::from_millis(2));
    assert_eq!(pair.b().heard, b"goodbye");
    assert_eq!(pair.b().changes.last(), Some(&(Instant::from_micros(1_050), StreamChange::Closed)));
    assert!(pair.a().changes.iter().all(|(_, change)| *change != StreamChange::Closed));
}
