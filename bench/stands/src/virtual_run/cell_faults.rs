//! The faults of a cell in virtual time: what they do to its cables from the start, and when they change a cable, a node or a drive.

use machine::Instant;
use records::faults::{self, Change, Fault, FaultReport};
use virtual_time::{LinkCounters, Side};

use super::cell::{RobotId, VirtualCell};
use super::changes::Changes;
use crate::planned_station::PlannedStation;

/// The faults of each station, and those of the PLC.
#[derive(Debug)]
pub(super) struct CellFaults {
    /// Those of each station, in their order, and what they still have to change.
    of_stations: Vec<(Vec<Fault>, Changes)>,
    /// Those of the PLC itself.
    of_plc: (Vec<Fault>, Changes),
    /// When the robots were ready.
    ready: Option<Instant>,
    is_plc_killed: bool,
}

/// Returns the faults of a station.
pub(super) fn of_station(name: &str, faults: &[Fault]) -> Vec<Fault> {
    faults.iter().filter(|fault| fault.station() == Some(name)).cloned().collect()
}

/// Returns whether a fault starts a node again.
pub(super) fn restart(faults: &[Fault]) -> bool {
    faults::at_frames(faults).any(|at| at.restarted().is_some())
}

impl CellFaults {
    pub(super) fn of(stations: &[PlannedStation], faults: &[Fault]) -> Self {
        let with_changes = |faults: Vec<Fault>| {
            let changes = Changes::of(&faults);
            (faults, changes)
        };
        let of_plc = faults.iter().filter(|fault| fault.station().is_none()).cloned().collect();
        let of_stations = stations.iter().map(|station| with_changes(of_station(&station.name, faults)));
        Self {
            of_stations: of_stations.collect(),
            of_plc: with_changes(of_plc),
            ready: None,
            is_plc_killed: false,
        }
    }

    /// Starts the time that changes count from, once: the robots are ready.
    pub(super) fn begin(&mut self, now: Instant) {
        if self.ready.replace(self.ready.unwrap_or(now)).is_none() {
            self.all_mut().for_each(|changes| changes.ready(now));
        }
    }

    /// Returns the time since the robots were ready first; `None` before.
    pub(super) fn ready(&self) -> Option<Instant> {
        self.ready
    }

    /// Returns whether there is any fault.
    pub(super) fn are_any(&self) -> bool {
        self.of_stations.iter().chain([&self.of_plc]).any(|(faults, _)| !faults.is_empty())
    }

    fn all_mut(&mut self) -> impl Iterator<Item = &mut Changes> {
        self.of_stations.iter_mut().map(|(_, changes)| changes).chain([&mut self.of_plc.1])
    }

    /// Returns the instant of the next change that has one.
    pub(super) fn next(&self) -> Option<Instant> {
        let all = self.of_stations.iter().map(|(_, changes)| changes).chain([&self.of_plc.1]);
        all.filter_map(Changes::next).min()
    }

    /// Has the cell stop at the next frame of each cable with which a change begins.
    pub(super) fn stop_at_frames(&self, cell: &mut VirtualCell) {
        for (station, (_, changes)) in self.of_stations.iter().enumerate() {
            for side in [Side::A, Side::B] {
                cell.stop_at_frame(RobotId(station), side, changes.next_frame(side));
            }
        }
    }

    /// Takes a change that is due, with its station; that of the PLC itself has none.
    pub(super) fn take_due(&mut self, cell: &VirtualCell) -> Option<(Option<usize>, Change)> {
        let now = cell.now();
        for (station, (_, changes)) in self.of_stations.iter_mut().enumerate() {
            let sent = |side| cell.link_counters(RobotId(station), side).sent;
            if let Some(change) = changes.take_at(now, sent) {
                return Some((Some(station), change));
            }
        }
        let first = self.next().filter(|at| *at <= now)?;
        let is_first = |changes: &Changes| changes.next() == Some(first);
        for (station, (_, changes)) in self.of_stations.iter_mut().enumerate() {
            if is_first(changes) {
                return Some((Some(station), changes.take()?));
            }
        }
        Some((None, self.of_plc.1.take()?))
    }

    /// Counts a cut of a station's cable or its end; returns whether the cable is cut now.
    pub(super) fn count_cut(&mut self, station: usize, begins: bool) -> bool {
        self.of_stations.get_mut(station).is_some_and(|(_, changes)| changes.count_cut(begins))
    }

    /// Notes that the PLC was killed, or started again.
    pub(super) const fn note_plc(&mut self, is_killed: bool) {
        self.is_plc_killed = is_killed;
    }

    /// Returns whether a fault has killed the PLC for good so far.
    pub(super) const fn has_killed_plc(&self) -> bool {
        self.is_plc_killed
    }

    /// Returns what the faults did so far; `None` without faults.
    pub(super) fn report(&self, cell: &VirtualCell) -> Option<FaultReport> {
        let since_ready = self.ready.map(|ready| cell.now().since(ready));
        let of_stations = self.of_stations.iter().enumerate().map(|(index, (faults, _))| {
            (faults, [Side::A, Side::B].map(|side| cell.link_counters(RobotId(index), side)))
        });
        // The PLC itself has no cable.
        let all = of_stations.chain([(&self.of_plc.0, [LinkCounters::default(); 2])]);
        all.filter(|(faults, _)| !faults.is_empty())
            .map(|(faults, links)| FaultReport::new(faults, links, since_ready))
            .reduce(FaultReport::and)
    }
}
