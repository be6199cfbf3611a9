//! The distributed clock: a local clock with a small error, its system time, and the SYNC signals made from it.
//!
//! The datasheet defines the registers, but not how the chip filters. The control loop here is our own: it removes
//! a sixteenth of the difference at each comparison and estimates the clock's error, for any time between two
//! comparisons.

use machine::{Duration, Instant};

use super::memory::Memory;
use super::registers::{
    NEXT_SYNC1, PULSE_LENGTH, RECEIVE_TIME_UNIT, RECEIVE_TIMES, SPEED_COUNTER_DIFFERENCE,
    SPEED_COUNTER_START, SYNC_ACTIVATION, SYNC_START, SYNC0_CYCLE, SYNC1_CYCLE, SYSTEM_TIME,
    SYSTEM_TIME_DELAY, SYSTEM_TIME_DIFFERENCE, SYSTEM_TIME_OFFSET,
};

/// Parts of a nanosecond that the clock counts in.
const PARTS: i128 = 1_000_000_000;

/// Largest correction in parts per billion: 1 ns in each 128 ticks of 10 ns, as the chip's smallest speed counter.
const MAX_CORRECTION_PPB: i64 = 781_250;

/// Shortest SYNC cycle in nanoseconds, so that wrong registers do not keep a driver busy.
const MIN_CYCLE_NS: u64 = 1_000;

/// The time of a local clock at power-on, and the error of its speed.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct LocalClock {
    /// Its time in nanoseconds at power-on.
    pub start_ns: u64,
    /// How much too fast it runs, in parts per billion; negative if it runs too slow.
    pub error_ppb: i64,
}

/// A SYNC signal.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Sync {
    /// SYNC0.
    Sync0,
    /// SYNC1.
    Sync1,
}

/// A series of pulses, in system time.
#[derive(Clone, Copy, Debug)]
struct Pulses {
    next: u64,
    period: u64,
}

impl Pulses {
    /// Goes on to the first pulse behind a system time. Returns `false` if there is none.
    const fn skip(&mut self, system: u64) -> bool {
        if !is_ahead(self.next, system) {
            match system.wrapping_sub(self.next).checked_div(self.period) {
                Some(missed) => {
                    self.next = self.next.wrapping_add((missed + 1).saturating_mul(self.period));
                }
                None => return false,
            }
        }
        true
    }
}

/// The clock of a device.
#[derive(Debug)]
pub(crate) struct Clock {
    error_ppb: i64,
    correction_ppb: i64,
    /// The part of the correction that stays between comparisons.
    learned_ppb: i64,
    /// Local time at `base_at`, in parts of a nanosecond.
    base: i128,
    base_at: Instant,
    compared_at: Option<Instant>,
    /// Filtered difference to the received system times, in nanoseconds; positive if the local copy is ahead.
    difference: i64,
    latching: bool,
    /// When the frame arrived at each port.
    arrivals: [Option<Instant>; 4],
    /// Cyclic operation is activated.
    cyclic: bool,
    /// The next pulses since then, and whether they come out as signals.
    pulses: [Option<Pulses>; 2],
    generated: [bool; 2],
}

/// Returns whether a system time is in the future. The system time wraps after 2^64 ns, and an offset may put it just
/// before that.
const fn is_ahead(time: u64, system: u64) -> bool {
    let ahead = time.wrapping_sub(system);
    ahead != 0 && ahead <= u64::MAX / 2
}

impl Clock {
    pub(crate) fn new(now: Instant, local: LocalClock) -> Self {
        Self {
            error_ppb: local.error_ppb.clamp(-PARTS as i64 / 2, PARTS as i64),
            correction_ppb: 0,
            learned_ppb: 0,
            base: i128::from(local.start_ns) * PARTS,
            base_at: now,
            compared_at: None,
            difference: 0,
            latching: false,
            arrivals: [None; 4],
            cyclic: false,
            pulses: [None; 2],
            generated: [false; 2],
        }
    }

    fn rate(&self) -> i128 {
        PARTS + i128::from(self.error_ppb) + i128::from(self.correction_ppb)
    }

    fn parts(&self, now: Instant) -> i128 {
        self.base + i128::from(now.since(self.base_at).as_nanos() as u64) * self.rate()
    }

    /// Returns the local time in nanoseconds.
    pub(crate) fn local(&self, now: Instant) -> u64 {
        self.parts(now).div_euclid(PARTS) as u64
    }

    /// Returns the local copy of the system time.
    pub(crate) fn system(&self, now: Instant, memory: &Memory) -> u64 {
        self.local(now).wrapping_add(memory.u64(SYSTEM_TIME_OFFSET))
    }

    /// Latches the time at which the frame arrives at the processing unit and, if it latches those too, at the ports, as a
    /// write to the receive times asks for.
    pub(crate) fn latch(&mut self, now: Instant, ports: bool, memory: &mut Memory) {
        self.latching = ports;
        for (port, arrival) in self.arrivals.into_iter().enumerate() {
            if let Some(arrival) = arrival {
                self.latch_port(port, arrival, memory);
            }
        }
        let local = self.local(now);
        memory.set(RECEIVE_TIME_UNIT, &local.to_le_bytes());
    }

    /// Takes note of the time at which the frame arrives at a port, before or after the processing unit.
    pub(crate) fn arrive(&mut self, port: usize, now: Instant, memory: &mut Memory) {
        if let Some(arrival) = self.arrivals.get_mut(port) {
            *arrival = Some(now);
        }
        self.latch_port(port, now, memory);
    }

    fn latch_port(&self, port: usize, at: Instant, memory: &mut Memory) {
        if self.latching {
            let local = self.local(at) as u32;
            memory.set(RECEIVE_TIMES + port as u16 * 4, &local.to_le_bytes());
        }
    }

    /// Begins a new frame.
    pub(crate) const fn end_latch(&mut self) {
        self.latching = false;
        self.arrivals = [None; 4];
    }

    /// Shows the time and the next pulses in the registers.
    pub(crate) fn refresh(&self, now: Instant, memory: &mut Memory) {
        let delay = u64::from(memory.u32(SYSTEM_TIME_DELAY));
        let at_reference = self.system(now, memory).wrapping_sub(delay);
        memory.set(SYSTEM_TIME, &at_reference.to_le_bytes());
        let [sync0, sync1] = self.pulses;
        if let Some(pulses) = sync0 {
            memory.set(SYNC_START, &pulses.next.to_le_bytes());
        }
        memory.set(NEXT_SYNC1, &sync1.map_or(0, |pulses| pulses.next).to_le_bytes());
    }

    /// Compares a received system time with the local copy and corrects the clock's speed.
    pub(crate) fn compare(&mut self, now: Instant, received: u32, memory: &mut Memory) {
        let delay = u64::from(memory.u32(SYSTEM_TIME_DELAY));
        let local = self.system(now, memory).wrapping_sub(delay);
        // The chip compares 32 bits, because a MainDevice may write only these.
        let difference = i64::from((local as u32).wrapping_sub(received) as i32);
        let depth = memory.u8(0x0934) & 0x0F;
        self.difference =
            self.difference.saturating_add(difference.saturating_sub(self.difference) >> depth.min(15));
        self.show_difference(memory);
        let elapsed = self.compared_at.replace(now).map(|before| now.since(before).as_nanos() as i64);
        // The first value only sets the starting point.
        let Some(elapsed) = elapsed.filter(|elapsed| *elapsed > 0) else { return };
        self.base = self.parts(now);
        self.base_at = now;
        let limit = i128::from(MAX_CORRECTION_PPB);
        let error =
            (-i128::from(difference) * PARTS / i128::from(elapsed)).clamp(-limit * 1024, limit * 1024);
        let bandwidth = i128::from(memory.u16(SPEED_COUNTER_START).max(0x80));
        let proportional = error * 0x100 / bandwidth;
        // While the correction is at its limit, it does not show the clock's own error.
        if proportional.abs() < limit {
            let learned = i128::from(self.learned_ppb) + error * 4 / bandwidth;
            self.learned_ppb = learned.clamp(-limit, limit) as i64;
        }
        self.correction_ppb = (proportional + i128::from(self.learned_ppb)).clamp(-limit, limit) as i64;
        // In ticks of 10 ns: by how many the speed counter's period differs.
        let shown = i128::from(self.learned_ppb) * bandwidth / PARTS;
        memory.set(SPEED_COUNTER_DIFFERENCE, &(shown as i16).to_le_bytes());
    }

    fn show_difference(&self, memory: &mut Memory) {
        let amount = u32::try_from(self.difference.unsigned_abs()).unwrap_or(u32::MAX).min(0x7FFF_FFFF);
        // Bit 31: the local copy is not behind. Datasheets before version 2.8 say the opposite.
        let ahead = if self.difference < 0 { 0 } else { 0x8000_0000 };
        memory.set(SYSTEM_TIME_DIFFERENCE, &(amount | ahead).to_le_bytes());
    }

    /// Restarts the control loop, as a write to the speed counter does.
    pub(crate) fn reset_loop(&mut self, now: Instant, memory: &mut Memory) {
        self.base = self.parts(now);
        self.base_at = now;
        (self.correction_ppb, self.learned_ppb, self.difference) = (0, 0, 0);
        self.compared_at = None;
        memory.set(SYSTEM_TIME_DIFFERENCE, &[0; 4]);
        memory.set(SPEED_COUNTER_DIFFERENCE, &[0, 0]);
    }

    /// Starts or stops the SYNC signals by their activation register. Start and cycles are those of the moment at which
    /// bit 0 becomes 1; to write it once more changes nothing. The first pulse comes at the start time; the chip makes none
    /// if that has passed.
    pub(crate) fn activate(&mut self, now: Instant, memory: &mut Memory) {
        let activation = memory.u8(SYNC_ACTIVATION);
        let was_cyclic = core::mem::replace(&mut self.cyclic, activation & 1 != 0);
        let system = self.system(now, memory);
        if !was_cyclic || !self.cyclic {
            self.start_pulses(system, memory);
        }
        let generated = [activation & 2 != 0, activation & 4 != 0];
        let before = core::mem::replace(&mut self.generated, generated);
        for (slot, _) in self.pulses.iter_mut().zip(before).filter(|(_, before)| !before) {
            // A signal that was off does not make up for its pulses.
            if slot.as_mut().is_some_and(|pulses| !pulses.skip(system)) {
                *slot = None;
            }
        }
    }

    fn start_pulses(&mut self, system: u64, memory: &Memory) {
        let (start, cycle) = (memory.u64(SYNC_START), u64::from(memory.u32(SYNC0_CYCLE)));
        self.pulses = [None; 2];
        // A cycle that is no longer than a pulse would be no signal.
        let pulse = (u64::from(memory.u16(PULSE_LENGTH)) * 10).max(MIN_CYCLE_NS);
        if !self.cyclic || !is_ahead(start, system) || (1..=pulse).contains(&cycle) {
            return;
        }
        let shift = u64::from(memory.u32(SYNC1_CYCLE));
        let skipped = shift.checked_div(cycle).unwrap_or(0);
        let period = cycle.saturating_mul(skipped + 1);
        self.pulses = [
            Some(Pulses { next: start, period: cycle }),
            Some(Pulses { next: start.wrapping_add(shift), period }),
        ];
    }

    /// Returns whether the MainDevice has started SYNC signals that have not ended.
    pub(crate) const fn makes_pulses(&self) -> bool {
        let ([sync0, sync1], [makes0, makes1]) = (&self.pulses, self.generated);
        (makes0 && sync0.is_some()) || (makes1 && sync1.is_some())
    }

    /// Returns the time from one SYNC signal to the next; `None` without signals, or after a single one.
    pub(crate) fn period(&self) -> Option<Duration> {
        let mut pulses = self.pulses.iter().zip(self.generated).filter(|(_, generated)| *generated);
        let period = pulses.find_map(|(pulses, _)| pulses.as_ref())?.period;
        (period > 0).then(|| Duration::from_nanos(period))
    }

    /// Returns when the next SYNC signal is due.
    pub(crate) fn deadline(&self, memory: &Memory) -> Option<Instant> {
        let pulses = self.pulses.iter().zip(self.generated).filter(|(_, generated)| *generated);
        pulses.filter_map(|(pulses, _)| pulses.as_ref()).map(|pulses| self.instant(pulses.next, memory)).min()
    }

    /// Returns the next SYNC signal that is due now, with its system time.
    pub(crate) fn pulse(&mut self, now: Instant, memory: &Memory) -> Option<(Sync, u64)> {
        let system = self.system(now, memory);
        let ([sync0, sync1], [makes0, makes1]) = (&mut self.pulses, self.generated);
        for (sync, slot, generated) in [(Sync::Sync0, sync0, makes0), (Sync::Sync1, sync1, makes1)] {
            let due = slot.as_mut().filter(|pulses| generated && !is_ahead(pulses.next, system));
            let Some(pulses) = due else { continue };
            let at = pulses.next;
            // If the driver wakes up late, the clock makes one pulse, not a burst. Without a period there is a single one.
            if !pulses.skip(system) {
                *slot = None;
            }
            return Some((sync, at));
        }
        None
    }

    /// Returns when the local copy of the system time reaches `system`.
    fn instant(&self, system: u64, memory: &Memory) -> Instant {
        let local = i128::from(system.wrapping_sub(memory.u64(SYSTEM_TIME_OFFSET)));
        let left = (local * PARTS - self.base).max(0);
        let nanos = (left + self.rate() - 1) / self.rate();
        self.base_at + Duration::from_nanos(u64::try_from(nanos).unwrap_or(u64::MAX))
    }
}

#[cfg(test)]
mod tests;
