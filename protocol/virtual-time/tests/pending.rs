//! A machine that says what it has is asked for nothing else.

#![expect(clippy::panic, reason = "a test fails by a panic")]

use machine::{Duration, Instant, Machine, Pending, Port, PortRequest, Source, StreamRequest, Transmit};
use virtual_time::{Clock, Impairment, Pair, PairConfig};

const MS: Duration = Duration::from_millis(1);

/// Sends a frame each millisecond, and counts how often it is asked for one.
struct Beacon {
    next: Instant,
    is_due: bool,
    received: u32,
    asked: u32,
}

impl Machine for Beacon {
    type Event = ();

    fn ports(&self) -> &[PortRequest] {
        &[]
    }

    fn handle_frame(&mut self, _now: Instant, _from: Source, _frame: &[u8]) {
        self.received += 1;
    }

    fn handle_timeout(&mut self, _now: Instant) {
        self.next += MS;
        self.is_due = true;
    }

    fn pending(&self, _now: Instant) -> Pending {
        Pending { frame: self.is_due, request: false, event: false }
    }

    fn poll_transmit(&mut self, _now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.asked += 1;
        let frame = buf.get_mut(..60)?;
        frame.fill(0);
        core::mem::take(&mut self.is_due).then_some(Transmit { port: Port::Ethernet, to: None, len: 60 })
    }

    fn poll_stream(&mut self) -> Option<StreamRequest> {
        panic!("it has no request");
    }

    fn poll_event(&mut self) -> Option<()> {
        panic!("it has no event");
    }

    fn poll_timeout(&self) -> Option<Instant> {
        Some(self.next)
    }
}

#[test]
fn a_machine_is_asked_for_a_frame_only_where_it_may_have_one() {
    let beacon = |first| Beacon { next: first, is_due: false, received: 0, asked: 0 };
    let config = PairConfig {
        seed: 1,
        clocks: [Clock::default(); 2],
        links: [Impairment { delay: Duration::from_micros(1), ..Impairment::default() }; 2],
        addresses: [None; 2],
    };
    let mut pair = Pair::new(beacon(Instant::ZERO), beacon(Instant::from_micros(300)), config);
    assert!(pair.next_event(Instant::from_micros(9_900)).is_none());
    for (station, received_by) in [(pair.a(), pair.b()), (pair.b(), pair.a())] {
        assert_eq!([station.asked, received_by.received], [10, 10]);
    }
}
