//! One direction of a cable, and what it does to frames.

use core::fmt;

use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

use machine::wire::FRAME_CAPACITY;
use machine::{Duration, Instant};

/// What a cable does to the frames of one direction. Rates are in parts per million of the frames.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct Impairment {
    /// Delay of every frame.
    pub delay: Duration,
    /// Largest additional delay, evenly distributed.
    pub jitter: Duration,
    /// Frames that are lost.
    pub loss_ppm: u32,
    /// Frames that arrive twice.
    pub duplicate_ppm: u32,
    /// Frames that are held back by [`Self::reorder_by`], so that later ones overtake them.
    pub reorder_ppm: u32,
    /// How long a reordered frame is held back.
    pub reorder_by: Duration,
    /// Frames in which one bit flips behind the checksums, in the memory of a switch for instance: the bit reaches the machine.
    pub corrupt_ppm: u32,
    /// Frames in which one bit flips on the wire: the frame's checksum finds it, so that the frame is lost.
    pub corrupt_on_wire_ppm: u32,
    /// What happens to single frames.
    pub strikes: Strikes,
}

/// What happens to one frame.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Strike {
    /// It is lost; of a TCP stream, a segment is lost once and sent again.
    Lose,
    /// It arrives twice. TCP drops the second one.
    Double,
    /// It is held back, so that later ones may overtake it.
    Hold(Duration),
    /// This bit of it flips behind the checksums, counted from the lowest bit of the first byte and from there again
    /// behind the end.
    Flip(u32),
    /// A bit of it flips on the wire: the frame's checksum finds it, so that the frame is lost. A segment of a TCP
    /// stream is sent again.
    FlipOnWire,
}

/// What happens to single frames, by their numbers among those that were put in, counted from 1.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct Strikes([Option<(u64, Strike)>; Strikes::MOST]);

impl Strikes {
    /// Most strikes of one direction.
    pub const MOST: usize = 4;
    /// No frame is struck.
    pub const NONE: Self = Self([None; Self::MOST]);

    /// Adds a strike. Returns whether there was room for it.
    pub fn add(&mut self, frame: u64, strike: Strike) -> bool {
        let room = self.0.iter_mut().find(|one| one.is_none());
        room.map(|room| *room = Some((frame, strike))).is_some()
    }

    /// Returns all strikes.
    pub fn iter(&self) -> impl Iterator<Item = (u64, Strike)> + '_ {
        self.0.iter().flatten().copied()
    }

    /// Returns the longest time for which it holds a frame back.
    #[must_use]
    pub fn longest_hold(&self) -> Duration {
        let hold = |(_, strike)| match strike {
            Strike::Hold(by) => Some(by),
            _ => None,
        };
        self.iter().filter_map(hold).max().unwrap_or_default()
    }
}

/// All that strikes one frame.
#[derive(Clone, Copy, Default)]
struct Struck {
    is_lost: bool,
    is_doubled: bool,
    held: Option<Duration>,
    flipped: Option<u32>,
    flips_on_wire: bool,
}

/// A piece of a TCP stream that passed.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Passed {
    pub(super) arrival: Instant,
    /// How often it was lost before.
    pub(super) losses: u32,
    /// Which of its bits flips behind the checksums.
    pub(super) flipped_bit: Option<u32>,
}

/// What a cable did to the frames of one direction.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct LinkCounters {
    /// Frames put in.
    pub sent: u64,
    /// Frames lost, by chance or a cut.
    pub lost: u64,
    /// Frames that arrived twice.
    pub duplicated: u64,
    /// Frames that were held back.
    pub reordered: u64,
    /// Frames in which a bit flipped behind the checksums.
    pub corrupted: u64,
    /// Frames in which a bit flipped on the wire; they count as lost as well.
    pub corrupted_on_wire: u64,
}

/// What a cable did to one frame, besides delaying it. Displayed as a capture's comment.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Debug)]
pub struct Fate {
    /// It is lost by chance.
    pub lost: bool,
    /// It is lost because the cable is cut.
    pub cut: bool,
    /// It arrives twice.
    pub duplicated: bool,
    /// Time that it is held back, so that later frames may overtake it.
    pub held_back: Option<Duration>,
    /// Index of its flipped bit, counted from the lowest bit of the first byte.
    pub flipped_bit: Option<u32>,
    /// It is lost because a bit flipped on the wire, which its checksum finds.
    pub failed_checksum: bool,
}

impl Fate {
    /// Returns whether nothing was done to it.
    #[must_use]
    pub fn is_clean(&self) -> bool {
        *self == Self::default()
    }
}

impl fmt::Display for Fate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { lost, cut, duplicated, held_back, flipped_bit, failed_checksum } = *self;
        let mut separator = "fault: ";
        let mut part = |f: &mut fmt::Formatter<'_>, text: fmt::Arguments<'_>| {
            write!(f, "{separator}{text}")?;
            separator = ", ";
            Ok(())
        };
        if cut {
            part(f, format_args!("lost, the cable is cut"))?;
        }
        if lost {
            part(f, format_args!("lost"))?;
        }
        if failed_checksum {
            part(f, format_args!("lost, its checksum is wrong"))?;
        }
        if duplicated {
            part(f, format_args!("arrives twice"))?;
        }
        if let Some(by) = held_back {
            part(f, format_args!("held back by {by:?}"))?;
        }
        if let Some(bit) = flipped_bit {
            part(f, format_args!("bit {} of byte {} flipped", bit % 8, bit / 8))?;
        }
        Ok(())
    }
}

/// One direction of a cable. Its seed decides what happens to each frame. It has no clock and no queue, so that it
/// serves both a cable in virtual time and one between real sockets.
#[derive(Debug)]
pub struct Link {
    impairment: Impairment,
    cut: bool,
    random: Pcg64Mcg,
    counters: LinkCounters,
    /// Arrival of the last frame in order. Without reordering a cable keeps the order, whatever the jitter.
    last_arrival: Instant,
}

impl Link {
    /// Creates a link that is not cut. `stream` distinguishes links with the same seed: 0 is what A sends, 1 what B
    /// sends.
    #[must_use]
    pub fn new(impairment: Impairment, seed: u64, stream: u64) -> Self {
        Self {
            impairment,
            cut: false,
            random: Pcg64Mcg::seed_from_u64(
                seed.rotate_left(17) ^ stream.wrapping_mul(0x9E37_79B9_7F4A_7C15),
            ),
            counters: LinkCounters::default(),
            last_arrival: Instant::ZERO,
        }
    }

    pub(super) const fn set_impairment(&mut self, impairment: Impairment) {
        self.impairment = impairment;
    }

    /// Cuts or mends the link.
    pub const fn set_cut(&mut self, cut: bool) {
        self.cut = cut;
    }

    /// Returns the counters so far.
    #[must_use]
    pub const fn counters(&self) -> LinkCounters {
        self.counters
    }

    /// Counts a frame that was in flight when the cable was cut.
    pub const fn lose_in_flight(&mut self) {
        self.counters.lost += 1;
    }

    /// Calls `arrive` for each copy of the frame that gets through, with its arrival time. An empty frame cannot be
    /// corrupted.
    pub fn pass(&mut self, now: Instant, frame: &[u8], mut arrive: impl FnMut(Instant, Fate, &[u8])) -> Fate {
        let (fate, arrival) = self.decide(now, frame.len());
        let Some(arrival) = arrival else { return fate };
        let copies = if fate.duplicated { 2 } else { 1 };
        let mut corrupted = [0; FRAME_CAPACITY];
        let frame = match (fate.flipped_bit, corrupted.get_mut(..frame.len())) {
            (Some(bit), Some(corrupted)) => {
                corrupted.copy_from_slice(frame);
                flip(corrupted, bit);
                corrupted
            }
            _ => frame,
        };
        (0..copies).for_each(|_| arrive(arrival, fate, frame));
        fate
    }

    /// Decides what happens to a frame of `len` bytes sent now, and when it arrives; `None` if it is lost.
    pub(super) fn decide(&mut self, now: Instant, len: usize) -> (Fate, Option<Instant>) {
        self.counters.sent += 1;
        let Impairment {
            delay,
            jitter,
            loss_ppm,
            duplicate_ppm,
            reorder_ppm,
            reorder_by,
            corrupt_ppm,
            corrupt_on_wire_ppm,
            strikes: _,
        } = self.impairment;
        let struck = self.struck();
        let mut fate = Fate { cut: self.cut, ..Fate::default() };
        fate.lost = !fate.cut && (self.chance(loss_ppm) || struck.is_lost);
        fate.failed_checksum =
            !fate.cut && !fate.lost && (self.chance(corrupt_on_wire_ppm) || struck.flips_on_wire);
        self.counters.corrupted_on_wire += u64::from(fate.failed_checksum);
        if fate.cut || fate.lost || fate.failed_checksum {
            self.counters.lost += 1;
            return (fate, None);
        }
        let mut arrival = now + delay + self.up_to(jitter);
        let held = struck.held.or_else(|| self.chance(reorder_ppm).then_some(reorder_by));
        if let Some(by) = held {
            self.counters.reordered += 1;
            fate.held_back = Some(by);
            arrival += by;
        } else {
            arrival = arrival.max(self.last_arrival);
            self.last_arrival = arrival;
        }
        fate.duplicated = self.chance(duplicate_ppm) || struck.is_doubled;
        self.counters.duplicated += u64::from(fate.duplicated);
        if (1..=FRAME_CAPACITY).contains(&len) {
            let chance = self.chance(corrupt_ppm).then(|| self.below(len as u64 * 8) as u32);
            fate.flipped_bit = chance.or_else(|| Some(struck.flipped? % (len as u32 * 8)));
            self.counters.corrupted += u64::from(fate.flipped_bit.is_some());
        }
        (fate, Some(arrival))
    }

    /// Returns how a piece of `len` bytes of a TCP stream sent now arrives: where a datagram would be lost, it arrives
    /// later. `None` while cut. Of its bits only a strike flips one behind the checksums.
    pub(super) fn pass_stream(
        &mut self,
        now: Instant,
        len: usize,
        retransmission: Duration,
    ) -> Option<Passed> {
        self.counters.sent += 1;
        if self.cut {
            return None;
        }
        let struck = self.struck();
        let mut arrival = now + self.impairment.delay + self.up_to(self.impairment.jitter);
        arrival += struck.held.unwrap_or_default();
        let mut losses = u32::from(struck.is_lost || struck.flips_on_wire);
        self.counters.corrupted_on_wire += u64::from(struck.flips_on_wire);
        while self.chance(self.impairment.loss_ppm.min(900_000)) {
            losses += 1;
        }
        self.counters.lost += u64::from(losses);
        arrival += retransmission * losses;
        let flipped_bit = struck.flipped.filter(|_| (1..=FRAME_CAPACITY).contains(&len));
        let flipped_bit = flipped_bit.map(|bit| bit % (len as u32 * 8));
        self.counters.corrupted += u64::from(flipped_bit.is_some());
        Some(Passed { arrival, losses, flipped_bit })
    }

    /// Returns what strikes the frame that was counted last.
    fn struck(&self) -> Struck {
        let mut struck = Struck::default();
        for (number, strike) in self.impairment.strikes.iter() {
            if number == self.counters.sent {
                match strike {
                    Strike::Lose => struck.is_lost = true,
                    Strike::Double => struck.is_doubled = true,
                    Strike::Hold(by) => struck.held = Some(by),
                    Strike::Flip(bit) => struck.flipped = Some(bit),
                    Strike::FlipOnWire => struck.flips_on_wire = true,
                }
            }
        }
        struck
    }

    /// Draws no random number if the rate is zero, so that switching on one fault does not shift the others.
    fn chance(&mut self, ppm: u32) -> bool {
        ppm > 0 && self.below(1_000_000) < u64::from(ppm)
    }

    fn up_to(&mut self, limit: Duration) -> Duration {
        if limit.is_zero() {
            return limit;
        }
        let limit = u64::try_from(limit.as_nanos()).unwrap_or(u64::MAX);
        Duration::from_nanos(self.below(limit))
    }

    fn below(&mut self, bound: u64) -> u64 {
        ((u128::from(self.random.next_u64()) * u128::from(bound)) >> 64) as u64
    }
}

/// Flips one bit of a frame, counted from the lowest bit of the first byte.
pub(super) fn flip(frame: &mut [u8], bit: u32) {
    if let Some(byte) = frame.get_mut(bit as usize / 8) {
        *byte ^= 1 << (bit % 8);
    }
}
