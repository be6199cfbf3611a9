//! A bus endpoint that takes the time of each number on its way to the other end and back.
//!
//! Both ends are in one process and so have one clock. The PLC's end writes a number, the robot's end writes what it
//! received at once into its own data, and when the number is back the PLC's end writes the next one. A bus with
//! cycles at both ends holds a number at the robot until the robot's next frame is due. How long that takes depends
//! on how the cycles lie to each other, not on the program; so the time on the way is the time of the frame that
//! brought the number there and of the frame that brought it back.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use machine::{Instant, LinkEvent, Machine, Source, StreamChange, StreamId, Transmit};
use protocol::fieldbus::Fieldbus;
use protocol::image::{IMAGE_LEN, Image};
use protocol_linux::clock;

/// Shorter frames are not cyclic: the smallest cyclic frame in the comparison has 256 bytes of data.
pub(super) const CYCLIC_LEN: usize = IMAGE_LEN;

/// Numbers of a turn: more than one a cycle cannot be.
const CAPACITY: usize = 8_192;

/// The way of a number.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct RoundTrip {
    /// When it was back.
    pub(super) at: Instant,
    /// Time of the two frames that carried it.
    pub(super) on_the_way: Duration,
    /// Time from the first frame with the number until it was back; unknown for raw frames.
    pub(super) whole: Option<Duration>,
}

/// Times that the two ends share in memory, in ns of their common clock.
#[derive(Default, Debug)]
pub(super) struct Times {
    plc_sent: AtomicU64,
    robot_sent: AtomicU64,
    /// Time of the last frame that brought the robot a new number.
    there: AtomicU64,
}

impl Times {
    /// Returns how long before the PLC's last frame the robot's was sent, in a cycle of this length.
    pub(super) fn phase(&self, cycle: Duration) -> Duration {
        let cycle = u64::try_from(cycle.as_nanos()).unwrap_or(u64::MAX).max(1);
        let sent = |time: &AtomicU64| time.load(Ordering::Acquire) % cycle;
        Duration::from_nanos((cycle + sent(&self.plc_sent) - sent(&self.robot_sent)) % cycle)
    }
}

/// Which end, and what only this one has.
#[derive(Debug)]
enum End {
    Plc { asked_at: Option<Instant>, round_trips: Vec<RoundTrip> },
    Robot,
}

/// An endpoint that takes times.
#[derive(Debug)]
pub(super) struct Stopwatch<B> {
    bus: B,
    end: End,
    times: Arc<Times>,
    /// The number that this end sends.
    number: u32,
    /// When this end began with what it is about to send.
    began: Instant,
}

impl<B: Fieldbus> Stopwatch<B> {
    pub(super) fn of_plc(bus: B, times: Arc<Times>) -> Self {
        let end = End::Plc { asked_at: None, round_trips: Vec::with_capacity(CAPACITY) };
        let mut own = Self { bus, end, times, number: 0, began: Instant::ZERO };
        own.set_number(1);
        own
    }

    pub(super) const fn of_robot(bus: B, times: Arc<Times>) -> Self {
        Self { bus, end: End::Robot, times, number: 0, began: Instant::ZERO }
    }

    pub(super) const fn bus_mut(&mut self) -> &mut B {
        &mut self.bus
    }

    pub(super) fn round_trips(&self) -> &[RoundTrip] {
        match &self.end {
            End::Plc { round_trips, .. } => round_trips,
            End::Robot => &[],
        }
    }

    fn set_number(&mut self, number: u32) {
        self.number = number;
        let mut image: Image = [0; IMAGE_LEN];
        image.iter_mut().zip(number.to_le_bytes()).for_each(|(place, byte)| *place = byte);
        self.bus.set_output(&image);
    }

    /// Takes the time if a number arrived that is new here.
    fn take_time(&mut self) {
        let received =
            self.bus.input().and_then(|image| image.first_chunk().copied().map(u32::from_le_bytes));
        let now = clock::now();
        let since = |sent: &AtomicU64| now.since(Instant::from_nanos(sent.load(Ordering::Acquire)));
        match &mut self.end {
            End::Robot => {
                if let Some(number) = received.filter(|number| *number != self.number) {
                    let there = u64::try_from(since(&self.times.plc_sent).as_nanos()).unwrap_or(u64::MAX);
                    self.times.there.store(there, Ordering::Release);
                    self.set_number(number);
                }
            }
            End::Plc { asked_at, round_trips } => {
                if received == Some(self.number) {
                    let there = Duration::from_nanos(self.times.there.load(Ordering::Acquire));
                    if round_trips.len() < CAPACITY {
                        let on_the_way = there + since(&self.times.robot_sent);
                        let whole = asked_at.take().map(|asked| now.since(asked));
                        round_trips.push(RoundTrip { at: now, on_the_way, whole });
                    }
                    self.set_number(self.number.wrapping_add(1));
                }
            }
        }
        self.began = clock::now();
    }
}

impl<B: Fieldbus> Machine for Stopwatch<B> {
    type Event = LinkEvent;

    machine::forward_ports!(bus);

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.bus.handle_frame(now, from, frame);
        self.take_time();
    }

    fn handle_broadcast(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.bus.handle_broadcast(now, from, frame);
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        self.bus.handle_stream(now, stream, change);
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.began = now;
        self.bus.handle_timeout(now);
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        let transmit = self.bus.poll_transmit(now, buf)?;
        if transmit.len >= CYCLIC_LEN {
            let sent = match &mut self.end {
                End::Plc { asked_at, .. } => {
                    asked_at.get_or_insert(self.began);
                    &self.times.plc_sent
                }
                End::Robot => &self.times.robot_sent,
            };
            sent.store(self.began.as_nanos(), Ordering::Release);
        }
        Some(transmit)
    }

    fn poll_event(&mut self) -> Option<LinkEvent> {
        self.bus.poll_event()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.bus.poll_timeout()
    }
}
