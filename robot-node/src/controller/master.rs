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

/// Where on its law the arm should be at a time.
#[derive(Clone, Copy, PartialEq, Debug)]
struct SetPoint {
    at: Instant,
    law_us: u32,
}

/// The master, as the last two set-points have it.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct Master {
    /// Start time and life counter of the last set-point's image.
    image: (u64, u16),
    last: SetPoint,
    /// Rate of the master, from 0 to 1.
    rate: f64,
    /// Rate of the arm that was asked for last.
    asked: f64,
}

impl Master {
    /// Returns the master after one more command; `before` is the one until now.
    fn after(before: Option<Self>, at: Instant, command: &Command) -> Self {
        let Command { start_time_ns, law_time_us: law_us, life, .. } = *command;
        let image = (start_time_ns, life);
        let holds_at = if start_time_ns == 0 { at } else { Instant::from_nanos(start_time_ns) };
        let last = SetPoint { at: holds_at, law_us };
        let Some(before) = before else { return Self { image, last, rate: 0.0, asked: 0.0 } };
        // The same image as in the cycle before; of a PLC without a life counter, or a clock, the law time alone tells.
        let is_same = if start_time_ns == 0 { before.image == image } else { before.last.at == holds_at };
        if is_same && before.last.law_us == law_us {
            return before;
        }
        let seconds = last.at.since(before.last.at).as_secs_f64();
        let law_s = (f64::from(law_us) - f64::from(before.last.law_us)) / 1e6;
        let rate = if seconds > 0.0 { (law_s / seconds).clamp(0.0, 1.0) } else { 0.0 };
        Self { image, last, rate, ..before }
    }

    /// Returns whether the arm is to stand.
    #[cfg(test)]
    pub(super) fn asks_for_rest(&self) -> bool {
        self.asked == 0.0
    }

    /// Returns the law's time in s that the arm should have at an instant, and the rate at which it passes then.
    fn at(&self, now: Instant) -> (f64, f64) {
        let (ahead, since) = (self.last.at.since(now), now.since(self.last.at));
        let rate = if ahead.max(since) <= HORIZON { self.rate } else { 0.0 };
        let seconds = since.min(HORIZON).as_secs_f64() - ahead.min(HORIZON).as_secs_f64();
        (f64::from(self.last.law_us) / 1e6 + self.rate * seconds, rate)
    }
}

impl Controller {
    /// Takes over the set-point of a command, if the arm is to follow a master.
    pub(super) fn take_master(&mut self, at: Instant, command: &Command) {
        if command.control.contains(Control::SYNC) {
            self.master = Some(Master::after(self.master, at, command));
        } else {
            self.leave_master();
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
            // From a rest the arm starts when the master passes, also between two cycles.
            let share = rate.min(most);
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
        let waits = self.master.is_some_and(|master| master.at(at).0 <= self.law_time(execution));
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
