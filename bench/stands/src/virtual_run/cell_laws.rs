//! Laws of a cell that no fault may break: no arm goes beyond a mark before the others have come to it, and no two arms are in one
//! shared zone. They are watched at the robots themselves, by their own counts and joints, and not by what the PLC knows.

use std::time::Duration;

use machine::Instant;
use planning::{ArmVolume, WaitAt, ZoneSet};
use records::cell_stop::STANDS_MM_S;
use robot_node::Sample;

use super::cell::{RobotId, VirtualCell};
use crate::planned_station::PlannedStation;

/// Robot cycles within which an arm stands after its last motion before a mark, also where drives still bring it to rest.
const SETTLED: u32 = 10;

/// A law that a run has broken.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum BrokenLaw {
    /// An arm went beyond a mark too early.
    #[error("station {station} went beyond mark {mark} before station {other} had come to it")]
    Mark {
        /// Station of the arm.
        station: String,
        /// Number of the mark.
        mark: u32,
        /// A station whose arm had not come.
        other: String,
    },
    /// Two arms were in one shared zone.
    #[error("stations {} and {} were both in shared zone {zone} by their joints", stations[0], stations[1])]
    Zone {
        /// The two stations.
        stations: [String; 2],
        /// Number of the zone in the setup, counted from 1.
        zone: usize,
    },
}

/// The arms, and the first law that was broken.
pub(super) struct CellLaws {
    arms: Vec<WatchedArm>,
    interval: Duration,
    /// Watch over marks, on during a run.
    is_run: bool,
    broken: Option<BrokenLaw>,
}

struct WatchedArm {
    name: String,
    waits: Vec<WaitAt>,
    volume: Option<ArmVolume>,
    executed: ExecutedMotions,
    last_tick: Option<Instant>,
}

/// Motions that a robot has executed in a run, by its own count of each skill.
#[derive(Clone, Copy, Default, Debug)]
struct ExecutedMotions {
    /// Number of the skill before the run, which does not count.
    stale: u16,
    /// The skill under way: its number and its motions.
    skill: (u16, u32),
    /// Motions of the skills before.
    before: u32,
    /// Cycles for which the arm has moved since the last motion ended.
    moving: u32,
}

impl ExecutedMotions {
    fn begin(sample: &Sample) -> Self {
        Self { stale: sample.command, ..Self::default() }
    }

    fn see(&mut self, sample: &Sample) {
        if sample.command == self.stale && self.before == 0 && self.skill.1 == 0 {
            return;
        }
        let (number, executed) = self.skill;
        if sample.command != number {
            self.before += executed;
            self.moving = 0;
        }
        if sample.executed != executed {
            self.moving = 0;
        }
        self.skill = (sample.command, sample.executed);
        self.moving = if sample.path_speed_mm_s >= STANDS_MM_S { self.moving + 1 } else { 0 };
    }

    const fn total(&self) -> usize {
        (self.before + self.skill.1) as usize
    }

    /// Returns whether the arm is beyond the place after so many motions.
    const fn is_beyond(&self, after: usize) -> bool {
        self.total() > after || self.total() == after && self.moving > SETTLED
    }
}

impl CellLaws {
    pub(super) fn new(stations: &[PlannedStation]) -> Self {
        let arm = |station: &PlannedStation| WatchedArm {
            name: station.name.clone(),
            waits: station.waits.clone(),
            volume: station.zones.as_ref().map(|zones| zones.volume.clone()),
            executed: ExecutedMotions::default(),
            last_tick: None,
        };
        let cycle = stations.iter().map(|station| station.planned.robot.cycle).min().unwrap_or_default();
        Self {
            arms: stations.iter().map(arm).collect(),
            // So no robot cycle is missed.
            interval: (cycle / 2).max(Duration::from_micros(1)),
            is_run: false,
            broken: None,
        }
    }

    /// Returns when the arms have to be looked at next.
    pub(super) fn next_look(&self, now: Instant) -> Instant {
        now + self.interval
    }

    /// Begins a run: from now on its motions are counted.
    pub(super) fn begin(&mut self, cell: &VirtualCell) {
        self.is_run = true;
        for (number, arm) in self.arms.iter_mut().enumerate() {
            arm.executed = ExecutedMotions::begin(&cell.robot(RobotId(number)).sample());
        }
    }

    /// Ends the run: what the arms do from now on is the way to their starts.
    pub(super) const fn end(&mut self) {
        self.is_run = false;
    }

    /// Returns the first law that was broken.
    pub(super) const fn broken(&self) -> Option<&BrokenLaw> {
        self.broken.as_ref()
    }

    /// Looks at the arms.
    pub(super) fn look(&mut self, cell: &VirtualCell) {
        if self.broken.is_some() {
            return;
        }
        let mut has_ticked = false;
        for (number, arm) in self.arms.iter_mut().enumerate() {
            let robot = cell.robot(RobotId(number));
            if arm.last_tick.replace(robot.ticked_at()) != Some(robot.ticked_at()) {
                has_ticked = true;
                arm.executed.see(&robot.sample());
            }
        }
        if has_ticked {
            self.broken = self.two_in_a_zone(cell).or_else(|| self.beyond_a_mark());
        }
    }

    fn two_in_a_zone(&self, cell: &VirtualCell) -> Option<BrokenLaw> {
        let mut taken: Vec<(&str, ZoneSet)> = Vec::new();
        for (number, arm) in self.arms.iter().enumerate() {
            let zones = arm.volume.as_ref()?.at(&cell.robot(RobotId(number)).sample().joints);
            for (other, others) in &taken {
                if let Some(zone) = zones.zones().find(|zone| others.contains(*zone)) {
                    let stations = [(*other).to_owned(), arm.name.clone()];
                    return Some(BrokenLaw::Zone { stations, zone: zone + 1 });
                }
            }
            taken.push((&arm.name, zones));
        }
        None
    }

    fn beyond_a_mark(&self) -> Option<BrokenLaw> {
        if !self.is_run {
            return None;
        }
        let nth = |arm: &'_ WatchedArm, index: usize| {
            let mark = arm.waits.get(index)?.mark;
            Some((mark, arm.waits.iter().take(index).filter(|wait| wait.mark == mark).count()))
        };
        for arm in &self.arms {
            for (index, wait) in
                arm.waits.iter().enumerate().filter(|(_, it)| arm.executed.is_beyond(it.after))
            {
                let passage = nth(arm, index);
                let has_come = |other: &WatchedArm| {
                    let mut there = (0..other.waits.len()).filter(|at| nth(other, *at) == passage);
                    let after = there.next().and_then(|at| other.waits.get(at)).map(|wait| wait.after);
                    after.is_none_or(|after| other.executed.total() >= after)
                };
                if let Some(other) = self.arms.iter().find(|other| !has_come(other)) {
                    let (station, other) = (arm.name.clone(), other.name.clone());
                    return Some(BrokenLaw::Mark { station, mark: wait.mark, other });
                }
            }
        }
        None
    }
}
