//! Answers to the question that went to every device: each device waits a while of its own, so that not all answer at
//! once (volume 2, 2-4.2).

use alloc::vec::Vec;
use core::net::SocketAddrV4;

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::encapsulation::Header;
use machine::{Duration, Instant};

/// Questions that wait for their answer at most. Who asks while so many wait is not answered: the question comes again,
/// or it is a flood.
const ROOM: usize = 8;

/// The longest delay where the question leaves it to the device, in ms.
const DEFAULT_MS: u16 = 2_000;

/// The least that the longest delay may be, in ms: a question that names less means this.
const LEAST_MS: u16 = 500;

/// A question to all that waits for its answer.
#[derive(Debug)]
struct Waiting {
    due: Instant,
    peer: SocketAddrV4,
    header: Header,
}

/// All of them.
#[derive(Debug)]
pub(super) struct Delayed {
    waiting: Vec<Waiting>,
    random: Pcg64Mcg,
}

impl Delayed {
    /// Devices with different seeds wait for different times.
    pub(super) fn new(seed: u64) -> Self {
        Self { waiting: Vec::with_capacity(ROOM), random: Pcg64Mcg::seed_from_u64(seed) }
    }

    /// Takes a question. The first two bytes of its context are MaxResponseDelay, in ms.
    pub(super) fn ask(&mut self, now: Instant, peer: SocketAddrV4, header: Header) {
        let [low, high, ..] = header.context;
        let longest = match u16::from_le_bytes([low, high]) {
            0 => DEFAULT_MS,
            longest => longest.max(LEAST_MS),
        };
        if self.waiting.len() < ROOM {
            let longest_ns = u64::from(longest) * 1_000_000;
            let delay = Duration::from_nanos(self.random.next_u64() % (longest_ns + 1));
            self.waiting.push(Waiting { due: now + delay, peer, header });
        }
    }

    /// The next question whose answer is due.
    pub(super) fn next_due(&mut self, now: Instant) -> Option<(SocketAddrV4, Header)> {
        let index = self.waiting.iter().position(|waiting| waiting.due <= now)?;
        let Waiting { peer, header, .. } = self.waiting.swap_remove(index);
        Some((peer, header))
    }

    pub(super) fn next_timeout(&self) -> Option<Instant> {
        self.waiting.iter().map(|waiting| waiting.due).min()
    }
}
