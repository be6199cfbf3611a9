//! Records each run of a cell: every station's robot and the PLC's scans for it, in true time.

use std::time::Duration;

use machine::Instant;
use records::trace::{PlcScan, Recording, RobotTick};
use virtual_time::Clock;

use super::cell::{RobotId, VirtualCell};

/// The clocks of the nodes of a cell.
#[derive(Clone, Debug)]
pub(super) struct CellClocks {
    pub(super) plc: Clock,
    /// In the order of the stations.
    pub(super) robots: Vec<Clock>,
}

/// The recording of the current run, or of the last one.
pub(super) struct CellWatch {
    clocks: CellClocks,
    /// True time of the start edge; `None` outside of a run.
    start: Option<Instant>,
    stations: Vec<Recording>,
    last_ticks: Vec<Option<Instant>>,
    last_scan: u64,
    /// Half of the shortest cycle: looked at so often, no cycle is missed. It takes no virtual time.
    interval: Duration,
}

impl CellWatch {
    /// Prepares recordings of a cell whose shortest cycle is this one.
    pub(super) fn new(clocks: CellClocks, shortest: Duration) -> Self {
        let count = clocks.robots.len();
        let stations = (0..count).map(|_| Recording::default()).collect();
        let interval = (shortest / 2).max(Duration::from_micros(1));
        Self { clocks, start: None, stations, last_ticks: vec![None; count], last_scan: 0, interval }
    }

    /// Returns when the nodes have to be looked at next; `None` outside of a run.
    pub(super) fn next_look(&self, now: Instant) -> Option<Instant> {
        self.start.map(|_| now + self.interval)
    }

    /// Begins the recording of a run; `at` is its start edge by the PLC's clock.
    pub(super) fn begin(&mut self, at: Instant) {
        self.start = Some(self.true_time_of_plc(at));
        self.stations.iter_mut().for_each(Recording::clear);
    }

    /// Ends the recording.
    pub(super) const fn end(&mut self) {
        self.start = None;
    }

    /// Converts an instant of the PLC's clock to true time.
    pub(super) fn true_time_of_plc(&self, at: Instant) -> Instant {
        self.clocks.plc.true_time(at)
    }

    /// Converts an instant of a robot's clock to true time.
    #[cfg(test)]
    pub(super) fn true_time_of_robot(&self, number: usize, at: Instant) -> Option<Instant> {
        self.clocks.robots.get(number).map(|clock| clock.true_time(at))
    }

    /// Returns the recording of each station.
    pub(super) fn recordings(&self) -> &[Recording] {
        &self.stations
    }

    /// Adds the cycles that the nodes have run since the last look.
    pub(super) fn look(&mut self, cell: &VirtualCell) {
        let Some(start) = self.start else { return };
        let since_ns = |at: Instant| at.as_nanos() as f64 - start.as_nanos() as f64;
        let plc = cell.plc();
        let has_scanned = plc.scans() != self.last_scan;
        self.last_scan = plc.scans();
        let scanned_at = self.clocks.plc.true_time(plc.scanned_at());
        for (number, recording) in self.stations.iter_mut().enumerate() {
            if has_scanned {
                let at_us = (since_ns(scanned_at) / 1e3).round() as i64;
                let (true_ns, sample) = (scanned_at.as_nanos(), plc.sample_of(number));
                recording.plc(PlcScan { at_us, true_ns, sample });
            }
            let robot = cell.robot(RobotId(number));
            let (Some(last), Some(clock)) = (self.last_ticks.get_mut(number), self.clocks.robots.get(number))
            else {
                continue;
            };
            if last.replace(robot.ticked_at()) != Some(robot.ticked_at()) {
                let at = clock.true_time(robot.ticked_at());
                let (at_ms, true_ns) = (since_ns(at) / 1e6, at.as_nanos());
                recording.robot(RobotTick { at_ms, true_ns, sample: robot.sample() });
            }
        }
    }
}
