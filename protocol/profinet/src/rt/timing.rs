//! The cycle of an IOCR: send clock, reduction ratio and cycle counter.

use super::receiver::NEWER_WINDOW;
use machine::ethernet::Mac;
use machine::{Duration, Instant};

/// One count of the cycle counter and unit of the send clock in nanoseconds: 31.25 µs.
pub const COUNT_NANOS: u64 = 31_250;

/// Largest WatchdogFactor and DataHoldFactor (IEC 61158-6-10).
const MAX_HOLD_FACTOR: u16 = 7_680;

/// Returns the cycle counter at `at`: the clock in counts of 31.25 µs, modulo 2^16.
#[must_use]
pub const fn cycle_counter(at: Instant) -> u16 {
    (at.as_nanos() / COUNT_NANOS) as u16
}

/// Transport of the cyclic frames.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub enum Transport {
    /// RT_CLASS_1: EtherType 0x8892.
    Rt1,
    /// RT_CLASS_UDP: UDP port 34962.
    Udp,
}

impl Transport {
    /// Returns the shortest C_SDU in bytes: over Ethernet it fills the smallest frame.
    #[must_use]
    pub const fn min_c_sdu_len(self) -> usize {
        match self {
            Self::Rt1 => 40,
            Self::Udp => 12,
        }
    }

    /// Returns the largest reduction ratio.
    #[must_use]
    pub const fn max_reduction_ratio(self) -> u16 {
        match self {
            Self::Rt1 => 512,
            Self::Udp => 16_384,
        }
    }

    /// Returns the longest time from one frame to the next, in counts of the cycle counter.
    ///
    /// Over Ethernet it is 512 ms. Over UDP the standard names ratios of up to 16 s, but the counter has 16 bits: from 1.92 s
    /// on, the next frame counts as an older one, and every 2.048 s it has the same number.
    #[must_use]
    pub const fn max_counts(self) -> u32 {
        match self {
            Self::Rt1 => 16_384,
            Self::Udp => NEWER_WINDOW,
        }
    }

    /// Returns the longest watchdog time and data hold time.
    #[must_use]
    pub const fn max_hold_time(self) -> Duration {
        match self {
            Self::Rt1 => Duration::from_millis(1_920),
            Self::Udp => Duration::from_millis(61_440),
        }
    }

    /// Returns the largest WatchdogFactor and DataHoldFactor of frames that come every `period`: no factor exceeds 7680, and
    /// none makes more than [`max_hold_time`](Self::max_hold_time).
    #[must_use]
    pub fn max_hold_factor(self, period: Duration) -> u16 {
        let fitting = self.max_hold_time().as_nanos() / period.as_nanos().max(1);
        u16::try_from(fitting).unwrap_or(u16::MAX).min(MAX_HOLD_FACTOR)
    }
}

/// Time from one frame of an IOCR to the next.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug)]
pub struct CycleTime {
    /// The send clock in counts of 31.25 µs: a power of two up to 128.
    pub send_clock_factor: u16,
    /// Number of send clocks per frame.
    pub reduction_ratio: u16,
}

/// A cycle that no send clock and reduction ratio can express.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
#[error(
    "PROFINET has no cycle of {} µs: allowed are, over UDP, a power of two of 31.25 µs or whole ms up to 1920; \
     over Ethernet, the first or a power of two of ms up to 512",
    .0.as_nanos() as f64 / 1000.0
)]
pub struct UnsupportedCycle(pub Duration);

impl CycleTime {
    /// Finds the factors of a cycle of `period`. From 1 ms on the send clock is 1 ms, which every device supports.
    pub fn new(period: Duration, transport: Transport) -> Result<Self, UnsupportedCycle> {
        let unfit = UnsupportedCycle(period);
        let nanos = u64::try_from(period.as_nanos()).map_err(|_| unfit)?;
        let counts = nanos / COUNT_NANOS;
        let (clock, ratio) = if counts <= 32 { (counts, 1) } else { (32, counts / 32) };
        let cycle = Self {
            send_clock_factor: u16::try_from(clock).map_err(|_| unfit)?,
            reduction_ratio: u16::try_from(ratio).map_err(|_| unfit)?,
        };
        let fits = cycle.period() == period
            && cycle.send_clock_factor.is_power_of_two()
            && cycle.reduction_ratio >= 1
            && cycle.counts() <= transport.max_counts()
            && (transport == Transport::Udp || cycle.reduction_ratio.is_power_of_two());
        if fits { Ok(cycle) } else { Err(unfit) }
    }

    /// Returns the time from one frame to the next, in counts of the cycle counter.
    #[must_use]
    pub const fn counts(self) -> u32 {
        self.send_clock_factor as u32 * self.reduction_ratio as u32
    }

    /// Returns the time from one frame to the next.
    #[must_use]
    pub const fn period(self) -> Duration {
        Duration::from_nanos(COUNT_NANOS * self.counts() as u64)
    }

    /// Returns `factor` cycles, as a watchdog time or a data hold time.
    #[must_use]
    pub fn multiplied(self, factor: u16) -> Duration {
        self.period().saturating_mul(u32::from(factor))
    }

    /// Returns when a station with this address sends its first frame after `now`: on the grid of its clock, shifted
    /// by its address, so that stations that started together do not all send at once.
    #[must_use]
    pub fn first(self, now: Instant, mac: Mac) -> Instant {
        let [.., low] = mac.0;
        let period = u64::try_from(self.period().as_nanos()).unwrap_or(u64::MAX).max(COUNT_NANOS);
        let phase = u64::from(low) * COUNT_NANOS % period;
        let grid = now.as_nanos() / period * period;
        let this_cycle = Instant::from_nanos(grid.saturating_add(phase));
        if this_cycle > now { this_cycle } else { this_cycle + self.period() }
    }
}
