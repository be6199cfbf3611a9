//! Moving together: the arm follows a master axis in the PLC.
//!
//! The PLC sends set-points: the time on the arm's own law that it should have at a time of the robot's clock. The arm follows
//! by the rate at which its law's time passes, as it follows the override: within all limits, and never off its path.

use machine::{Duration, Instant};
use protocol::image::{Command, Control};

use super::Controller;
use super::execution::Execution;

/// Farthest time between a set-point and the robot's clock over which its rate counts: a usual watchdog.
const HORIZON: Duration = Duration::from_millis(100);

/// Share of a deviation from the set-point that is corrected in a second.
const GAIN: f64 = 20.0;

/// The rate stays as long as it changes by less.
const STEADY: f64 = 2e-4;

/// Set-points that are kept, one a cycle: of as much time as the horizon in cycles of 2 ms.
const KEPT: usize = 50;

/// Where on its law the arm should be at a time.
#[derive(Clone, Copy, PartialEq, Debug)]
struct SetPoint {
    at: Instant,
    law_us: u32,
}

impl SetPoint {
    fn law_s(&self) -> f64 {
        f64::from(self.law_us) / 1e6
    }

    /// Returns the rate of a master from this set-point to a later one, from 0 to 1.
    fn rate_to(&self, later: &Self) -> f64 {
        let seconds = later.at.since(self.at).as_secs_f64();
        if seconds > 0.0 { ((later.law_s() - self.law_s()) / seconds).clamp(0.0, 1.0) } else { 0.0 }
    }
}

/// The master, as the last set-points have it.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Master {
    /// Start time and life counter of the last set-point's image.
    image: (u64, u16),
    /// The last set-points, in a ring, with times that grow.
    ring: [SetPoint; KEPT],
    count: usize,
    /// Rate of the master at the end of them, from 0 to 1.
    rate: f64,
    /// Rate of the arm that was asked for last.
    asked: f64,
}

impl Master {
    /// Creates a master that has sent one set-point.
    fn first(at: Instant, command: &Command) -> Self {
        let (image, first) = Self::read(at, command);
        Self { image, ring: [first; KEPT], count: 1, rate: 0.0, asked: 0.0 }
    }

    fn read(at: Instant, command: &Command) -> ((u64, u16), SetPoint) {
        let Command { start_time_ns, law_time_us: law_us, life, .. } = *command;
        let holds_at = if start_time_ns == 0 { at } else { Instant::from_nanos(start_time_ns) };
        ((start_time_ns, life), SetPoint { at: holds_at, law_us })
    }

    /// Takes one more command.
    fn take(&mut self, at: Instant, command: &Command) {
        let (image, next) = Self::read(at, command);
        let last = self.last();
        // The same image as in the cycle before; of a PLC without a life counter, or a clock, the law time alone tells.
        let is_same = if command.start_time_ns == 0 { self.image == image } else { last.at == next.at };
        if is_same && last.law_us == next.law_us {
            return;
        }
        if next.at <= last.at {
            // One in place of those before.
            self.count = 0;
        }
        self.rate = last.rate_to(&next);
        self.image = image;
        if let Some(place) = self.ring.get_mut(self.count % KEPT) {
            *place = next;
        }
        self.count += 1;
    }

    /// Returns one of the set-points, counted back from the last one.
    fn back(&self, index: usize) -> Option<SetPoint> {
        let number = self.count.checked_sub(index + 1).filter(|_| index < KEPT)?;
        self.ring.get(number % KEPT).copied()
    }

    fn last(&self) -> SetPoint {
        self.back(0).unwrap_or(SetPoint { at: Instant::ZERO, law_us: 0 })
    }

    /// Returns whether the arm is to stand.
    #[cfg(test)]
    pub(super) fn asks_for_rest(&self) -> bool {
        self.asked == 0.0
    }

    /// Returns the same between two set-points: the master goes evenly from one to the other. One that stood before has started
    /// meanwhile with the rate that it has after: images with more set-points were lost.
    fn between(&self, now: Instant) -> Option<(f64, f64)> {
        let index = (1..KEPT).find(|index| self.back(*index).is_none_or(|earlier| earlier.at <= now))?;
        let (earlier, later) = (self.back(index)?, self.back(index - 1)?);
        let stood = self.back(index + 1).is_none_or(|before| before.law_us >= earlier.law_us);
        let after = index.checked_sub(2).and_then(|after| self.back(after));
        let (rate, rate_after) = (earlier.rate_to(&later), after.map_or(0.0, |after| later.rate_to(&after)));
        if stood && rate_after > rate {
            let law_s = later.law_s() - rate_after * later.at.since(now).as_secs_f64();
            let is_on = law_s > earlier.law_s();
            return Some(if is_on { (law_s, rate_after) } else { (earlier.law_s(), 0.0) });
        }
        let share = now.since(earlier.at).as_secs_f64() / later.at.since(earlier.at).as_secs_f64();
        Some((earlier.law_s() + share * (later.law_s() - earlier.law_s()), rate))
    }

    /// Returns the law's time in s that the arm should have at an instant, and the rate at which it passes then.
    fn at(&self, now: Instant) -> (f64, f64) {
        let later = self.last();
        let (ahead, since) = (later.at.since(now), now.since(later.at));
        let is_near = !ahead.is_zero() && ahead <= HORIZON;
        if let Some(found) = is_near.then(|| self.between(now)).flatten() {
            return found;
        }
        let rate = if ahead.max(since) <= HORIZON { self.rate } else { 0.0 };
        let seconds = since.min(HORIZON).as_secs_f64() - ahead.min(HORIZON).as_secs_f64();
        (later.law_s() + self.rate * seconds, rate)
    }
}

impl Controller {
    /// Takes over the set-point of a command, if the arm is to follow a master.
    pub(super) fn take_master(&mut self, at: Instant, command: &Command) {
        if command.control.contains(Control::SYNC) {
            match &mut self.master {
                Some(master) => master.take(at, command),
                None => self.master = Some(Master::first(at, command)),
            }
        } else {
            self.leave_master();
        }
    }

    /// Begins anew with the set-point of the command that starts a skill: those before were on the law of another one.
    pub(super) fn begin_master(&mut self, at: Instant, command: &Command) {
        if let Some(master) = &mut self.master {
            *master = Master::first(at, command);
        }
    }

    pub(super) const fn leave_master(&mut self) {
        (self.master, self.feedback.law_time_us) = (None, 0);
    }

    /// Returns the law's time of a skill that the arm has driven, in s.
    fn law_time(&self, execution: &Execution) -> f64 {
        self.interpolator.path().driven_s() - execution.law_before_s
    }

    /// Returns the rate of the programmed speeds with which the arm drives until `at`: the override, or what brings it to the
    /// master without exceeding the override.
    pub(super) fn rate(&mut self, at: Instant, execution: &Execution) -> f64 {
        let (most, law_s) = (self.factor, self.law_time(execution));
        let Some(master) = &mut self.master else { return most };
        let cycle_s = self.config.cycle.as_secs_f64();
        let (wanted_s, rate) = master.at(at);
        let missing_s = wanted_s - law_s;
        let rests = self.interpolator.path().rests();
        if rests && missing_s <= 0.0 {
            master.asked = 0.0;
            return 0.0;
        }
        if rests {
            // From a rest the arm starts when the master passes, also between two cycles, and with the rate that the master then
            // has: it may itself have started between two set-points.
            let later = [1, 2].map(|cycles| master.at(at + self.config.cycle * cycles).1);
            let share = later.into_iter().fold(rate, f64::max).min(most);
            master.asked = share;
            if share > 0.0 {
                self.interpolator.start_later((share * cycle_s - missing_s).max(0.0));
                return share;
            }
        }
        let wanted = (rate + GAIN * (missing_s - rate * cycle_s)).clamp(0.0, most);
        if (wanted - master.asked).abs() > STEADY || wanted == 0.0 || wanted == most {
            master.asked = wanted;
        }
        master.asked.min(most)
    }

    /// Returns the share of the programmed speed with which a LIN force goes: 0 until the master has passed the arm, then the
    /// override, since a force has no law.
    pub(super) fn press_rate(&self, at: Instant, execution: &Execution) -> f64 {
        let waits = self.master.as_ref().is_some_and(|master| master.at(at).0 <= self.law_time(execution));
        if waits { 0.0 } else { self.factor }
    }

    /// Reports the law's time of the skill that runs, to the PLC only if the arm follows a master.
    pub(super) fn report_law_time(&mut self, execution: &Execution) {
        self.progress_s = self.law_time(execution);
        if self.master.is_some() {
            self.feedback.law_time_us = (self.progress_s * 1e6 + 0.5) as u32;
        }
    }
}
