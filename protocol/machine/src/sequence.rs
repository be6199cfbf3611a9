//! The position of a receiver in a stream of numbered frames: which frames are newer than all before, and how the
//! receiver finds its position again after a single frame with a wrong number.

use crate::time::nanos;
use crate::{Duration, Instant};

/// How a bus numbers its frames.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Numbering {
    /// All bits of a number.
    pub mask: u32,
    /// Largest distance at which a frame counts as newer; beyond it the frame counts as older.
    pub newer: u32,
    /// Largest distance at which a newer frame is accepted at once, besides what the time since the last frame allows.
    pub slack: u32,
    /// Distance from one frame to the next.
    pub step: u32,
    /// Time from one frame to the next.
    pub cycle: Duration,
}

/// A frame that comes late moves the instant at which the next one is due by at most this share of a cycle.
const LATE_SHARE: u64 = 64;

/// The receiver's place.
#[derive(Clone, Copy, Debug)]
pub struct Sequence {
    numbering: Numbering,
    /// Time from one frame to the next, in ns: this is computed for each frame.
    cycle_ns: u64,
    last: Option<Last>,
    elsewhere: Option<Elsewhere>,
}

#[derive(Clone, Copy, Debug)]
struct Last {
    number: u32,
    at: Instant,
    /// When it was due, by the frames before it.
    due: Instant,
    /// Whether it did not come before it was due, so that the sender is not behind it.
    is_timely: bool,
}

impl Last {
    /// Returns the place after an accepted frame that is so far ahead.
    fn next(&self, numbering: &Numbering, cycle_ns: u64, now: Instant, ahead: u32) -> Self {
        let Numbering { mask, step, .. } = *numbering;
        // Nearly always it is the next one, and a division takes as long as all the rest here.
        let cycles = if ahead == step { 1 } else { ahead.div_ceil(step.max(1)) };
        let (now_ns, before_ns) = (now.as_nanos(), self.due.as_nanos());
        let due_ns = before_ns.saturating_add(cycle_ns.saturating_mul(cycles.into()));
        let is_timely = due_ns.saturating_sub(now_ns).saturating_mul(2) <= cycle_ns;
        // One late frame says little about those behind it; a sender that is slower or stood still shifts all of them.
        let due_ns = now_ns.min(due_ns.saturating_add(cycle_ns / LATE_SHARE));
        let due = Instant::from_nanos(due_ns);
        Self { number: self.number.wrapping_add(ahead) & mask, at: now, due, is_timely }
    }
}

/// Frames that follow each other, but not the last accepted one.
#[derive(Clone, Copy, Debug)]
struct Elsewhere {
    number: u32,
    since: Instant,
}

impl Sequence {
    /// Creates a receiver that accepts the first frame at any number.
    #[must_use]
    pub const fn new(numbering: Numbering) -> Self {
        Self { numbering, cycle_ns: nanos(numbering.cycle), last: None, elsewhere: None }
    }

    /// Returns whether a frame was accepted.
    #[must_use]
    pub const fn has_started(&self) -> bool {
        self.last.is_some()
    }

    /// Returns the number of the last accepted frame.
    #[must_use]
    pub fn last(&self) -> Option<u32> {
        self.last.map(|last| last.number)
    }

    /// Returns how far a frame is ahead of the last accepted one; `None` if it is not to be used.
    ///
    /// A frame is accepted if it is newer, and not further ahead than time since the last frame allows. Frames at another
    /// place are refused, until they follow each other there for a cycle without one at the old place between them: then
    /// the sender is there. This is in time for the shortest watchdogs of the buses, three and four cycles.
    ///
    /// Frames a little older than the last one never are such a place, if that one came when its number was due: they were
    /// held up on the way, even if several of them come in their order. If it came early, its number may be wrong.
    pub fn accept(&mut self, now: Instant, number: u32) -> Option<u32> {
        let Numbering { mask, newer, slack, step, .. } = self.numbering;
        let Some(last) = &mut self.last else {
            self.last = Some(Last { number, at: now, due: now, is_timely: false });
            return Some(step);
        };
        let ahead = number.wrapping_sub(last.number) & mask;
        let is_newer = (1..=newer).contains(&ahead);
        if ahead == step || is_newer && is_plausible(&self.numbering, ahead, now.since(last.at)) {
            *last = last.next(&self.numbering, self.cycle_ns, now, ahead);
            self.elsewhere = None;
            return Some(ahead);
        }
        let behind = last.number.wrapping_sub(number) & mask;
        if behind <= slack && !is_newer && (last.is_timely || behind == 0) {
            return None;
        }
        if self.is_place(now, number) {
            self.last = Some(Last { number, at: now, due: now, is_timely: true });
            self.elsewhere = None;
            return Some(step);
        }
        None
    }

    /// Returns whether frames have followed each other at another place for a cycle.
    fn is_place(&mut self, now: Instant, number: u32) -> bool {
        let Numbering { mask, slack, cycle, .. } = self.numbering;
        let Some(elsewhere) = &mut self.elsewhere else {
            self.elsewhere = Some(Elsewhere { number, since: now });
            return false;
        };
        match number.wrapping_sub(elsewhere.number) & mask {
            0 => return false,
            ahead if ahead <= slack => elsewhere.number = number,
            _ => *elsewhere = Elsewhere { number, since: now },
        }
        now.since(elsewhere.since) >= cycle
    }
}

/// Returns whether the sender can be so far ahead after this time, with half as long a cycle as agreed.
fn is_plausible(numbering: &Numbering, ahead: u32, elapsed: Duration) -> bool {
    let Numbering { slack, step, cycle, .. } = *numbering;
    let Some(beyond) = ahead.checked_sub(slack).filter(|beyond| *beyond > 0) else { return true };
    u128::from(beyond) * cycle.as_nanos() <= 2 * elapsed.as_nanos() * u128::from(step)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a sequence of frames of 1 ms, numbered one by one with 32 bits.
    fn sequence() -> Sequence {
        let cycle = Duration::from_millis(1);
        Sequence::new(Numbering { mask: u32::MAX, newer: 0x7FFF_FFFF, slack: 100, step: 1, cycle })
    }

    fn at(millis: u64) -> Instant {
        Instant::from_millis(1_000 + millis)
    }

    #[test]
    fn the_sequence_continues_after_its_wrap_and_late_or_repeated_frames_are_refused() {
        let mut sequence = sequence();
        assert_eq!(sequence.accept(at(0), u32::MAX - 1), Some(1));
        assert_eq!(sequence.accept(at(1), u32::MAX - 1), None);
        assert_eq!(sequence.accept(at(2), 1), Some(3));
        assert_eq!(sequence.accept(at(2), 0), None);
    }

    #[test]
    fn after_one_frame_with_any_bit_flipped_the_second_frame_at_the_latest_is_accepted() {
        for bit in 0..32 {
            let mut sequence = sequence();
            for millis in 0..10 {
                sequence.accept(at(millis), 500 + millis as u32);
            }
            let wrong = sequence.accept(at(10), 510 ^ 1 << bit);
            assert!(wrong.is_none_or(|ahead| ahead <= 100), "bit {bit}: {wrong:?} ahead");
            let accepted: Vec<_> =
                (11..14).map(|millis| sequence.accept(at(millis), 500 + millis as u32)).collect();
            assert!(accepted[1].is_some_and(|ahead| ahead <= 2), "bit {bit}: {accepted:?}");
        }
    }

    #[test]
    fn a_sender_that_was_silent_may_be_as_far_ahead_as_the_time_allows() {
        let mut sequence = sequence();
        sequence.accept(at(0), 1);
        assert_eq!(sequence.accept(at(5_000), 5_001), Some(5_000));
        let (a, b, c) = (at(5_001), at(5_002), at(5_003));
        let restarted =
            [(a, 3_000_000), (b, 3_000_001), (c, 3_000_002)].map(|(at, n)| sequence.accept(at, n));
        assert_eq!(restarted, [None, Some(1), Some(1)], "at a new place nothing is missing");
    }

    #[test]
    fn old_frames_that_were_held_up_and_come_in_one_burst_are_refused() {
        let mut sequence = sequence();
        for millis in 0..20 {
            sequence.accept(at(millis), millis as u32);
        }
        for held in 5..15 {
            assert_eq!(sequence.accept(at(20), held), None);
        }
        assert_eq!(sequence.accept(at(20), 20), Some(1));
    }

    #[test]
    #[cfg_attr(miri, ignore = "takes hours there")]
    fn whichever_frames_are_held_back_no_frame_is_accepted_behind_a_newer_one() {
        const FRAMES: u64 = 14;
        for held_ms in 1..6 {
            for held in 0..1_u32 << FRAMES {
                let mut arrivals: Vec<_> = (0..FRAMES)
                    .map(
                        |frame| {
                            if held >> frame & 1 == 1 { (frame + held_ms, frame) } else { (frame, frame) }
                        },
                    )
                    .collect();
                // In one instant, the frame that was held back comes first.
                arrivals.sort_unstable();
                let mut sequence = sequence();
                // The connection has been up for some frames.
                (0..3).for_each(|millis| _ = sequence.accept(at(millis), millis as u32));
                let accepted: Vec<_> = arrivals
                    .into_iter()
                    .filter(|(millis, frame)| sequence.accept(at(3 + millis), 3 + *frame as u32).is_some())
                    .map(|(_, frame)| frame)
                    .collect();
                assert!(accepted.is_sorted(), "{held:b} held back for {held_ms} ms: {accepted:?}");
            }
        }
    }

    #[test]
    fn a_number_that_is_too_far_ahead_by_up_to_the_slack_is_left_again_after_a_cycle() {
        for ahead in 4..=100 {
            let mut sequence = sequence();
            (0..10).for_each(|millis| _ = sequence.accept(at(millis), millis as u32));
            assert_eq!(sequence.accept(at(10), 9 + ahead), Some(ahead));
            let true_numbers = (11..13).map(|millis| sequence.accept(at(millis), millis as u32));
            assert_eq!(true_numbers.collect::<Vec<_>>(), [None, Some(1)], "{ahead} ahead");
        }
    }

    #[test]
    fn the_next_frame_of_a_slow_sender_is_due_when_it_comes_so_that_a_wrong_number_is_still_early() {
        // Each cycle is a hundredth longer than agreed.
        let at = |frame: u64| Instant::from_nanos(frame * 1_010_000);
        let mut sequence = sequence();
        (0..1_000).for_each(|frame| _ = sequence.accept(at(frame), frame as u32));
        assert_eq!(sequence.accept(at(1_000), 1_003), Some(4));
        let true_numbers = (1_001..1_003).map(|frame| sequence.accept(at(frame), frame as u32));
        assert_eq!(true_numbers.collect::<Vec<_>>(), [None, Some(1)]);
    }

    #[test]
    fn the_next_frame_of_a_fast_sender_is_due_when_it_comes_so_that_its_old_frames_are_refused() {
        // Each cycle is a hundredth shorter than agreed.
        let at = |frame: u64| Instant::from_nanos(frame * 990_000);
        let mut sequence = sequence();
        (0..1_000).for_each(|frame| _ = sequence.accept(at(frame), frame as u32));
        let held_up = [(1_001, 980), (1_003, 981), (1_005, 982)];
        assert_eq!(held_up.map(|(when, frame)| sequence.accept(at(when), frame)), [None; 3]);
    }

    #[test]
    fn after_a_silence_a_frame_may_be_ahead_by_the_slack_and_twice_what_the_time_allows_and_no_more() {
        for (step, slack) in [(1, 100), (32, 320)] {
            let cycle = Duration::from_millis(1);
            let numbering = Numbering { mask: u32::MAX, newer: 0x7FFF_FFFF, slack, step, cycle };
            let most = slack + 2 * 5_000 * step;
            for (ahead, accepted) in [(most, Some(most)), (most + 1, None)] {
                let mut sequence = Sequence::new(numbering);
                sequence.accept(at(0), 7);
                assert_eq!(sequence.accept(at(5_000), 7 + ahead), accepted, "step {step}");
            }
        }
    }

    #[test]
    fn frames_that_do_not_follow_each_other_are_no_place() {
        let mut sequence = sequence();
        sequence.accept(at(0), 50);
        for frame in 1..100 {
            assert_eq!(sequence.accept(at(frame.into()), frame * 10_000_000), None);
        }
    }

    #[test]
    fn a_sequence_has_started_with_its_first_frame() {
        let mut sequence = sequence();
        assert!(!sequence.has_started());
        sequence.accept(at(0), 7);
        assert!(sequence.has_started());
    }

    #[test]
    fn a_repeated_old_frame_never_becomes_the_place() {
        let mut sequence = sequence();
        sequence.accept(at(0), 50);
        assert!((1..100).all(|millis| sequence.accept(at(millis), 40).is_none()));
    }
}
