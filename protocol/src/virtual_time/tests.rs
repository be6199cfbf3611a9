use super::*;
use crate::Duration;
use alloc::string::String;
use core::fmt::Write;

/// Sends a number every millisecond of its own clock and reports those that come in.
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
fn each_side_lives_by_its_own_clock() {
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
    };
    assert_eq!(transcript(7, link), transcript(7, link));
    assert_ne!(transcript(7, link), transcript(8, link));
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
