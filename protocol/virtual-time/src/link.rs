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
    /// Faults of single frames.
    pub frame_faults: FrameFaults,
}

impl Impairment {
    /// Returns whether it does nothing to a frame but delay it, so that no random number is drawn.
    fn is_plain(&self) -> bool {
        *self == Self { delay: self.delay, reorder_by: self.reorder_by, ..Self::default() }
    }
}

/// A fault of a single frame.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum FrameFault {
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
pub struct FrameFaults([Option<(u64, FrameFault)>; FrameFaults::MOST]);

impl FrameFaults {
    /// Largest number of faults of single frames in one direction.
    pub const MOST: usize = 4;
    /// No frame has a fault of its own.
    pub const NONE: Self = Self([None; Self::MOST]);

    /// Adds a fault. Returns whether there was room for it.
    pub fn add(&mut self, frame: u64, frame_fault: FrameFault) -> bool {
        let room = self.0.iter_mut().find(|one| one.is_none());
        room.map(|room| *room = Some((frame, frame_fault))).is_some()
    }

    /// Returns all faults, each with the number of its frame.
    pub fn iter(&self) -> impl Iterator<Item = (u64, FrameFault)> + '_ {
        self.0.iter().flatten().copied()
    }

    /// Returns the longest time for which it holds a frame back.
    #[must_use]
    pub fn longest_hold(&self) -> Duration {
        let hold = |(_, frame_fault)| match frame_fault {
            FrameFault::Hold(by) => Some(by),
            _ => None,
        };
        self.iter().filter_map(hold).max().unwrap_or_default()
    }
}

/// All faults of one frame.
#[derive(Clone, Copy, Default)]
struct CombinedFault {
    is_lost: bool,
    is_doubled: bool,
    held: Option<Duration>,
    flipped: Option<u32>,
    flips_on_wire: bool,
}

/// A piece of a TCP stream that passed.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct SentPiece {
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
pub struct LinkEffect {
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

impl LinkEffect {
    /// Returns whether nothing was done to it.
    #[must_use]
    pub fn is_clean(&self) -> bool {
        *self == Self::default()
    }
}

impl fmt::Display for LinkEffect {
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
    /// True while it only delays frames.
    is_plain: bool,
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
            is_plain: impairment.is_plain(),
            random: Pcg64Mcg::seed_from_u64(
                seed.rotate_left(17) ^ stream.wrapping_mul(0x9E37_79B9_7F4A_7C15),
            ),
            counters: LinkCounters::default(),
            last_arrival: Instant::ZERO,
        }
    }

    pub(super) fn set_impairment(&mut self, impairment: Impairment) {
        self.impairment = impairment;
        self.is_plain = impairment.is_plain() && !self.cut;
    }

    pub(super) const fn delay(&self) -> Duration {
        self.impairment.delay
    }

    /// Cuts or mends the link.
    pub fn set_cut(&mut self, cut: bool) {
        self.cut = cut;
        self.is_plain = self.impairment.is_plain() && !cut;
    }

    pub(crate) const fn is_cut(&self) -> bool {
        self.cut
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
    pub fn pass(
        &mut self,
        now: Instant,
        frame: &[u8],
        mut arrive: impl FnMut(Instant, LinkEffect, &[u8]),
    ) -> LinkEffect {
        let (effect, arrival) = self.decide(now, frame.len());
        let Some(arrival) = arrival else { return effect };
        let copies = if effect.duplicated { 2 } else { 1 };
        let mut corrupted = [0; FRAME_CAPACITY];
        let frame = match (effect.flipped_bit, corrupted.get_mut(..frame.len())) {
            (Some(bit), Some(corrupted)) => {
                corrupted.copy_from_slice(frame);
                flip(corrupted, bit);
                corrupted
            }
            _ => frame,
        };
        (0..copies).for_each(|_| arrive(arrival, effect, frame));
        effect
    }

    /// Decides what happens to a frame of `len` bytes sent now, and when it arrives; `None` if it is lost.
    pub(super) fn decide(&mut self, now: Instant, len: usize) -> (LinkEffect, Option<Instant>) {
        self.counters.sent += 1;
        if self.is_plain {
            self.last_arrival = self.last_arrival.max(now + self.impairment.delay);
            return (LinkEffect::default(), Some(self.last_arrival));
        }
        let Impairment {
            delay,
            jitter,
            loss_ppm,
            duplicate_ppm,
            reorder_ppm,
            reorder_by,
            corrupt_ppm,
            corrupt_on_wire_ppm,
            frame_faults: _,
        } = self.impairment;
        let combined = self.combined();
        let mut effect = LinkEffect { cut: self.cut, ..LinkEffect::default() };
        effect.lost = !effect.cut && (self.chance(loss_ppm) || combined.is_lost);
        effect.failed_checksum =
            !effect.cut && !effect.lost && (self.chance(corrupt_on_wire_ppm) || combined.flips_on_wire);
        self.counters.corrupted_on_wire += u64::from(effect.failed_checksum);
        if effect.cut || effect.lost || effect.failed_checksum {
            self.counters.lost += 1;
            return (effect, None);
        }
        let mut arrival = now + delay + self.up_to(jitter);
        let held = combined.held.or_else(|| self.chance(reorder_ppm).then_some(reorder_by));
        if let Some(by) = held {
            self.counters.reordered += 1;
            effect.held_back = Some(by);
            arrival += by;
        } else {
            arrival = arrival.max(self.last_arrival);
            self.last_arrival = arrival;
        }
        effect.duplicated = self.chance(duplicate_ppm) || combined.is_doubled;
        self.counters.duplicated += u64::from(effect.duplicated);
        if (1..=FRAME_CAPACITY).contains(&len) {
            let chance = self.chance(corrupt_ppm).then(|| self.below(len as u64 * 8) as u32);
            effect.flipped_bit = chance.or_else(|| Some(combined.flipped? % (len as u32 * 8)));
            self.counters.corrupted += u64::from(effect.flipped_bit.is_some());
        }
        (effect, Some(arrival))
    }

    /// Returns when a frame between the two hosts that no machine counts, as ARP, arrives; `None` while cut. It meets no fault, as
    /// on an impaired real cable.
    pub(super) fn pass_of_hosts(&mut self, now: Instant) -> Option<Instant> {
        self.last_arrival = self.last_arrival.max(now + self.impairment.delay);
        (!self.cut).then_some(self.last_arrival)
    }

    /// Returns how a piece of `len` bytes of a TCP stream sent now arrives: where a datagram would be lost, it arrives
    /// later. `None` while cut. Only a fault of this single frame flips one of its bits behind the checksums.
    pub(super) fn pass_stream(
        &mut self,
        now: Instant,
        len: usize,
        retransmission: Duration,
    ) -> Option<SentPiece> {
        self.counters.sent += 1;
        if self.cut {
            return None;
        }
        let combined = self.combined();
        let mut arrival = now + self.impairment.delay + self.up_to(self.impairment.jitter);
        arrival += combined.held.unwrap_or_default();
        let mut losses = u32::from(combined.is_lost || combined.flips_on_wire);
        self.counters.corrupted_on_wire += u64::from(combined.flips_on_wire);
        while self.chance(self.impairment.loss_ppm.min(900_000)) {
            losses += 1;
        }
        self.counters.lost += u64::from(losses);
        arrival += retransmission * losses;
        let flipped_bit = combined.flipped.filter(|_| (1..=FRAME_CAPACITY).contains(&len));
        let flipped_bit = flipped_bit.map(|bit| bit % (len as u32 * 8));
        self.counters.corrupted += u64::from(flipped_bit.is_some());
        Some(SentPiece { arrival, losses, flipped_bit })
    }

    /// Returns the faults of the frame that was counted last.
    fn combined(&self) -> CombinedFault {
        let mut combined = CombinedFault::default();
        for (number, frame_fault) in self.impairment.frame_faults.iter() {
            if number == self.counters.sent {
                match frame_fault {
                    FrameFault::Lose => combined.is_lost = true,
                    FrameFault::Double => combined.is_doubled = true,
                    FrameFault::Hold(by) => combined.held = Some(by),
                    FrameFault::Flip(bit) => combined.flipped = Some(bit),
                    FrameFault::FlipOnWire => combined.flips_on_wire = true,
                }
            }
        }
        combined
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_cable_that_only_delays_decides_as_one_whose_faults_never_come(
            delay_ns in 0..2_000_000_u64,
            reorder_ns in 0..5_000_u64,
            steps in prop::collection::vec((0..1_000_000_u64, 0..1_600_usize, any::<bool>()), 1..40),
        ) {
            let [delay, reorder_by] = [delay_ns, reorder_ns].map(Duration::from_nanos);
            let plain = Impairment { delay, reorder_by, ..Impairment::default() };
            let mut never = FrameFaults::NONE;
            never.add(u64::MAX, FrameFault::Lose);
            let mut links = [plain, Impairment { frame_faults: never, ..plain }].map(|one| Link::new(one, 7, 0));
            prop_assert_eq!(links.each_ref().map(|link| link.is_plain), [true, false]);
            let mut now = Instant::ZERO;
            for (after, len, cuts) in steps {
                now += Duration::from_nanos(after);
                let [one, other] = &mut links;
                one.set_cut(cuts);
                other.set_cut(cuts);
                prop_assert_eq!(one.decide(now, len), other.decide(now, len));
                prop_assert_eq!(one.counters(), other.counters());
                prop_assert_eq!(one.random.clone().next_u64(), other.random.clone().next_u64());
            }
        }
    }
}
