//! The scan: inputs → program → outputs, on an absolute grid.

use machine::{Cycle, Duration, Instant, Lateness, Tick};

/// When the program runs and when its outputs reach the bus.
///
/// Inputs are read at the start of a scan. Outputs are written `cost` later, which models the program's run time
/// where CPU time is not real. A bus frame that is sent in between still carries the old outputs. A scan that costs
/// more than the cycle delays the next one, as in a real PLC; grid points that pass meanwhile are skipped.
#[derive(Clone, Debug)]
pub struct Scan {
    cycle: Cycle,
    cost: Duration,
    outputs_due: Option<Instant>,
    lateness: Lateness,
}

impl Scan {
    /// Creates scans at `first` and every `period` after it; each writes its outputs `cost` after it read its inputs.
    #[must_use]
    pub fn new(first: Instant, period: Duration, cost: Duration) -> Self {
        Self { cycle: Cycle::new(first, period), cost, outputs_due: None, lateness: Lateness::default() }
    }

    /// Starts the scan that is due at `now`, if there is one and the previous scan has written its outputs.
    pub fn begin(&mut self, now: Instant) -> Option<Tick> {
        if self.outputs_due.is_some() {
            return None;
        }
        let tick = self.cycle.tick(now)?;
        self.lateness.record(&tick);
        self.outputs_due = Some(now + self.cost);
        Some(tick)
    }

    /// Returns whether the scan's outputs must be written now; true only once per scan.
    pub fn take_outputs(&mut self, now: Instant) -> bool {
        self.outputs_due.take_if(|due| *due <= now).is_some()
    }

    /// Returns whether the scan's outputs were to be written before `now`.
    pub fn is_overdue(&self, now: Instant) -> bool {
        self.outputs_due.is_some_and(|due| due < now)
    }

    /// Drops the outputs of the current scan: their connection is gone.
    pub const fn drop_outputs(&mut self) {
        self.outputs_due = None;
    }

    /// Returns when the next scan begins: at the latest then the outputs of this one have to be written. Whoever calls the bus
    /// before writes those that are due first: no frame leaves a bus that nobody calls.
    #[must_use]
    pub fn poll_timeout(&self) -> Instant {
        self.outputs_due.map_or(self.cycle.next(), |due| due.max(self.cycle.next()))
    }

    /// Returns the time from one scan to the next.
    #[must_use]
    pub const fn period(&self) -> Duration {
        self.cycle.period()
    }

    /// Returns the lateness of the scans' starts.
    #[must_use]
    pub const fn lateness(&self) -> &Lateness {
        &self.lateness
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn outputs_are_written_one_scan_cost_after_the_inputs_were_read() {
        let mut scan = Scan::new(Instant::from_millis(1), MS, Duration::from_micros(150));
        assert!(scan.begin(Instant::from_micros(999)).is_none());
        assert!(scan.begin(Instant::from_millis(1)).is_some());
        assert!(!scan.take_outputs(Instant::from_micros(1_149)));
        assert_eq!(scan.poll_timeout(), Instant::from_millis(2), "nobody has to call it before");
        assert!(
            !scan.is_overdue(Instant::from_micros(1_150)) && scan.is_overdue(Instant::from_micros(1_151))
        );
        assert!(scan.take_outputs(Instant::from_micros(1_150)));
        assert!(!scan.take_outputs(Instant::from_micros(1_150)), "outputs are written once");
        assert_eq!(scan.poll_timeout(), Instant::from_millis(2));
    }

    #[test]
    fn a_scan_without_cost_writes_its_outputs_at_once() {
        let mut scan = Scan::new(Instant::ZERO, MS, Duration::ZERO);
        assert!(scan.begin(Instant::ZERO).is_some() && scan.take_outputs(Instant::ZERO));
    }

    #[test]
    fn a_scan_that_costs_more_than_the_cycle_delays_the_next_one_and_skips_cycles() {
        let mut scan = Scan::new(Instant::ZERO, MS, Duration::from_micros(2_500));
        assert!(scan.begin(Instant::ZERO).is_some());
        assert!(scan.begin(Instant::from_millis(1)).is_none(), "the program still runs");
        assert!(scan.take_outputs(Instant::from_micros(2_500)));
        let tick = scan.begin(Instant::from_micros(2_500)).unwrap();
        assert_eq!((tick.due, tick.skipped), (Instant::from_millis(1), 1));
        assert_eq!((scan.lateness().runs(), scan.lateness().missed()), (2, 1));
    }
}
