//! Answers to requests that went to every device: each device waits for its own delay, so that not all answer at once
//! (volume 2, 2-4.2).

use alloc::vec::Vec;
use core::net::SocketAddrV4;

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::encapsulation::Header;
use machine::{Duration, Instant};

/// Largest number of waiting requests. If there are more, the one that would wait longest is answered at once, so that
/// requests with long delays cannot silence the device.
const ROOM: usize = 8;

/// Largest number of waiting requests of one host; further ones are not answered.
const OF_ONE_HOST: usize = 2;

/// Longest delay in ms if the request leaves it to the device.
const DEFAULT_MS: u16 = 2_000;

/// Part of the longest delay in which an answer comes: tools stop to listen after a second, although they leave the delay to the
/// device.
const PART: u64 = 4;

/// Smallest value of the longest delay, in ms: a request with a smaller one means this.
const LEAST_MS: u16 = 500;

/// A request to all devices whose answer is delayed.
#[derive(Debug)]
struct Waiting {
    due: Instant,
    peer: SocketAddrV4,
    header: Header,
}

/// All requests whose answers are delayed.
#[derive(Debug)]
pub(super) struct Delayed {
    waiting: Vec<Waiting>,
    random: Pcg64Mcg,
}

impl Delayed {
    /// Creates an empty list. Devices with different seeds wait for different times.
    pub(super) fn new(seed: u64) -> Self {
        Self { waiting: Vec::with_capacity(ROOM + 1), random: Pcg64Mcg::seed_from_u64(seed) }
    }

    /// Adds a request. The first two bytes of its context are MaxResponseDelay, in ms.
    pub(super) fn add(&mut self, now: Instant, peer: SocketAddrV4, header: Header) {
        let [low, high, ..] = header.context;
        let longest = match u16::from_le_bytes([low, high]) {
            0 => DEFAULT_MS,
            longest => longest.max(LEAST_MS),
        };
        let own = self.waiting.iter().filter(|waiting| waiting.peer.ip() == peer.ip()).count();
        if own >= OF_ONE_HOST || self.waiting.len() > ROOM {
            return;
        }
        let longest_ns = u64::from(longest) * 1_000_000 / PART;
        let delay = Duration::from_nanos(self.random.next_u64() % (longest_ns + 1));
        self.waiting.push(Waiting { due: now + delay, peer, header });
        if self.waiting.len() > ROOM
            && let Some(last) = self.waiting.iter_mut().max_by_key(|waiting| waiting.due)
        {
            last.due = now;
        }
    }

    /// Returns the next request whose answer is due.
    pub(super) fn next_due(&mut self, now: Instant) -> Option<(SocketAddrV4, Header)> {
        let index = self.waiting.iter().position(|waiting| waiting.due <= now)?;
        let Waiting { peer, header, .. } = self.waiting.swap_remove(index);
        Some((peer, header))
    }

    pub(super) fn next_timeout(&self) -> Option<Instant> {
        self.waiting.iter().map(|waiting| waiting.due).min()
    }
}
