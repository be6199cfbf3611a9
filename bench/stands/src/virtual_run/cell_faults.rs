//! The faults of a cell in virtual time: what they do to its cables from the start, and when they change a cable, a node or a drive.

use std::time::Duration;

use machine::Instant;
use records::faults::{self, Change, Fault, FaultReport};
use virtual_time::Side;

use super::cell::{CellNode, RobotId, VirtualCell};
use crate::planned_station::PlannedStation;
use node::role::NodeRole;

/// The faults of each station, and those of the PLC.
#[derive(Debug, Default)]
pub(super) struct CellFaults {
    /// Faults of each station, in their order.
    of_stations: Vec<Vec<Fault>>,
    /// Changes with the index of their station, the next one last; their times count from when the robots are ready.
    changes: Vec<(Duration, usize, Change)>,
    /// When the robots were ready.
    ready: Option<Instant>,
    /// Number of cuts of each cable that last.
    cuts: Vec<u32>,
    has_killed_plc: bool,
}

/// Returns the faults of a station.
pub(super) fn of_station(name: &str, faults: &[Fault]) -> Vec<Fault> {
    faults.iter().filter(|fault| fault.station() == Some(name)).cloned().collect()
}

impl CellFaults {
    pub(super) fn of(stations: &[PlannedStation], faults: &[Fault]) -> Self {
        let of_stations: Vec<_> = stations.iter().map(|station| of_station(&station.name, faults)).collect();
        let of_plc: Vec<_> = faults.iter().filter(|fault| fault.station().is_none()).cloned().collect();
        let numbered = of_stations.iter().enumerate().chain([(0, &of_plc)]);
        let mut changes: Vec<_> = numbered
            .flat_map(|(index, faults)| {
                faults::changes(faults).into_iter().map(move |(at, change)| (at, index, change))
            })
            .collect();
        changes.sort_by_key(|(at, ..)| std::cmp::Reverse(*at));
        Self { cuts: vec![0; of_stations.len()], of_stations, changes, ready: None, has_killed_plc: false }
    }

    /// Starts the time that changes count from, once: the robots are ready.
    pub(super) fn begin(&mut self, now: Instant) {
        self.ready.get_or_insert(now);
    }

    /// Returns the instant of the next change.
    pub(super) fn next(&self) -> Option<Instant> {
        let (after, ..) = self.changes.last()?;
        Some(self.ready? + *after)
    }

    /// Makes the change that is due; returns whether there is one.
    pub(super) fn apply(&mut self, cell: &mut VirtualCell) -> bool {
        if self.next().is_none_or(|at| at > cell.now()) {
            return false;
        }
        let Some((_, station, change)) = self.changes.pop() else { return false };
        let robot = RobotId(station);
        match change {
            Change::Cut | Change::Mend => {
                let Some(cuts) = self.cuts.get_mut(station) else { return true };
                *cuts = if change == Change::Cut { *cuts + 1 } else { cuts.saturating_sub(1) };
                cell.set_cut(robot, *cuts > 0);
            }
            Change::Kill(NodeRole::Plc) => {
                self.has_killed_plc = true;
                cell.kill(CellNode::Plc);
            }
            Change::Kill(NodeRole::Robot) => cell.kill(CellNode::Robot(robot)),
            Change::Drive(axis, disturbance) => {
                cell.command_robot(robot, |robot, _| robot.disturb_drive(axis, disturbance));
            }
            // It begins with a frame, which the options of a cell refuse.
            Change::Restart(_) => {}
        }
        true
    }

    /// Returns whether a fault has killed the PLC.
    pub(super) const fn has_killed_plc(&self) -> bool {
        self.has_killed_plc
    }

    /// Returns what the faults did so far; `None` without faults at a station.
    pub(super) fn report(&self, cell: &VirtualCell) -> Option<FaultReport> {
        let since_ready = self.ready.map(|ready| cell.now().since(ready));
        let with_faults = self.of_stations.iter().enumerate().filter(|(_, faults)| !faults.is_empty());
        let reports = with_faults.map(|(index, faults)| {
            let links = [Side::A, Side::B].map(|side| cell.link_counters(RobotId(index), side));
            FaultReport::new(faults, links, since_ready)
        });
        reports.reduce(FaultReport::and)
    }
}
