//! Result of one run on a stand, and the conditions of the measurement.

use std::time::Duration;

use ::node::report::ImageChecks;
use plc_node::Execution;
use protocol::fieldbus::Counters;
use robot_node::{Account, Quality};

use crate::faults::FaultReport;
use crate::lateness::CycleLateness;

/// One finished run.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Measured {
    /// The PLC's report of the run.
    pub execution: Execution,
    /// Quality of the arm's motion, measured by the robot; `None` if it did not report every motion.
    pub quality: Option<Quality>,
    /// The robot's account of its skills; `None` if it did not report every motion.
    pub account: Option<Account>,
    /// What host and bus did to the nodes meanwhile.
    pub interference: Interference,
}

/// The robot's reports on its skills in one run, summed up.
#[derive(Clone, Copy, Debug, Default)]
pub struct MotionTotals {
    /// Motions that were executed.
    pub motions: u32,
    /// Quality of all of them.
    pub quality: Quality,
    /// Account of all of them.
    pub account: Account,
}

impl MotionTotals {
    /// Adds a skill.
    pub fn add(&mut self, motions: u32, quality: Quality, account: Account) {
        self.motions = self.motions.saturating_add(motions);
        self.quality = self.quality.then(quality);
        self.account = self.account.then(account);
    }

    /// Returns itself if it contains as many motions as the run had.
    #[must_use]
    pub fn of(self, motions: u32) -> Option<Self> {
        (self.motions == motions).then_some(self)
    }
}

/// A robot node's report on a skill.
#[derive(Debug)]
struct SkillReport {
    number: u16,
    totals: MotionTotals,
    /// When the first motion began, by the host's clock.
    began_ns: Option<u64>,
}

/// A robot node's reports on its skills since a run was asked for. A run may begin with a move to the start, which is not
/// part of it.
#[derive(Debug, Default)]
pub struct ReportedSkills {
    reports: Vec<SkillReport>,
    /// Number of the last command before those of the run, if the run has begun.
    after: Option<u16>,
}

impl ReportedSkills {
    /// The PLC began the run: its skills have the numbers after this one.
    pub fn begin_after(&mut self, number: u16) {
        self.after = Some(number);
    }

    /// Adds the robot node's report on the skill of this number.
    pub fn add(
        &mut self,
        number: u16,
        motions: u32,
        began_ns: Option<u64>,
        quality: Quality,
        account: Account,
    ) {
        let mut totals = MotionTotals::default();
        totals.add(motions, quality, account);
        self.reports.push(SkillReport { number, totals, began_ns });
    }

    /// Returns the skills of the run, in order.
    fn skills(&self) -> impl Iterator<Item = &SkillReport> {
        // Numbers go round.
        let is_of_run = |number: u16| self.after.is_none_or(|after| number.wrapping_sub(after) as i16 > 0);
        self.reports.iter().filter(move |skill| is_of_run(skill.number))
    }

    /// Returns when the first motion of the run began, by the host's clock; `None` if the node did not report it.
    #[must_use]
    pub fn began_ns(&self) -> Option<u64> {
        self.skills().find_map(|skill| skill.began_ns)
    }

    /// Returns the totals of the skills of the run.
    #[must_use]
    pub fn of_run(&self) -> MotionTotals {
        let mut totals = MotionTotals::default();
        for SkillReport { totals: of_skill, .. } in self.skills() {
            totals.add(of_skill.motions, of_skill.quality, of_skill.account);
        }
        totals
    }
}

/// What host and bus did to both nodes during one run.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Interference {
    /// Cycles of PLC and robot that passed without a run, because the host stalled the node. The robot makes up for them.
    pub missed: [u64; 2],
    /// Cycles of PLC and robot that ran.
    pub runs: [u64; 2],
    /// Bus cycles in which either node sent nothing because its host stalled it.
    pub skipped: u64,
    /// Frames that one node sent and the other did not accept.
    pub lost: u64,
    /// Images that PLC and robot refused, because a byte was altered.
    pub altered: [u64; 2],
}

/// Counts of both nodes at some moment.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Counts {
    /// Cycles missed so far: PLC, robot.
    pub missed: [u64; 2],
    /// Cycles run so far: PLC, robot.
    pub runs: [u64; 2],
    /// Frames counted so far: PLC, robot.
    pub bus: [Counters; 2],
    /// Received images so far: PLC, robot.
    pub images: [ImageChecks; 2],
}

impl Counts {
    /// Returns what happened since an earlier moment.
    #[must_use]
    pub fn since(&self, before: &Self) -> Interference {
        let more = |counter: fn(&Self) -> u64| counter(self).saturating_sub(counter(before));
        Interference {
            missed: [more(|counts| counts.missed[0]), more(|counts| counts.missed[1])],
            runs: [more(|counts| counts.runs[0]), more(|counts| counts.runs[1])],
            skipped: more(|counts| counts.bus.iter().map(|bus| bus.skipped).sum()),
            lost: more(|counts| counts.bus.iter().map(|bus| bus.lost + bus.late).sum()),
            altered: [more(|counts| counts.images[0].altered), more(|counts| counts.images[1].altered)],
        }
    }
}

impl Measured {
    /// Returns a run of one motion that took this long by both clocks, for tests of what is shown.
    #[must_use]
    pub fn lasting(time: Duration) -> Self {
        let nanos = u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
        let execution = Execution {
            execution_type: plc_node::ExecutionType::Cm,
            execution_time_ns: nanos,
            robot_execution_ns: nanos,
            motions: 1,
            blends_suppressed: 0,
            scans: 1,
            frames: Counters::default(),
            commanded: plc_node::Commanded {
                motions: 1,
                digest: 0,
                override_percent: [100; 2],
                end: [0.0; 6],
            },
            seen: None,
            after: None,
            zone_wait_ns: None,
        };
        Self { execution, quality: None, account: None, interference: Interference::default() }
    }
}

/// Conditions of a measurement.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Health {
    /// Lateness of the PLC's scans.
    pub plc: CycleLateness,
    /// Lateness of the robot's interpolation cycles.
    pub robot: CycleLateness,
    /// Cyclic frames counted by the PLC.
    pub bus: Counters,
    /// Cyclic frames counted by the robot.
    pub robot_bus: Counters,
    /// Received images by their checks: PLC, robot.
    pub images: [ImageChecks; 2],
    /// Time from the start of the nodes until the robot was ready; `None` in virtual mode and if the nodes already
    /// ran.
    pub connected_after: Option<Duration>,
    /// Allocations of the PLC's and of the robot's cyclic thread since the connection was up; `None` if they are not
    /// counted.
    pub allocations: Option<[u64; 2]>,
    /// Repetitions that were run again because the host stalled a node until the connection was lost: which, and why.
    pub repeated: Vec<String>,
    /// What was remarkable about the connection.
    pub remarks: Vec<String>,
    /// Result of the injected faults, if any.
    pub faults: Option<FaultReport>,
}

impl Health {
    /// Returns how many frames of either direction were sent and not received. A side counts cycles without a frame;
    /// those that the other side skipped were not lost.
    #[must_use]
    pub const fn frames_lost(&self) -> u64 {
        let towards_plc = self.bus.lost.saturating_sub(self.robot_bus.skipped);
        towards_plc + self.robot_bus.lost.saturating_sub(self.bus.skipped)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_move_to_the_start_is_no_part_of_the_run_whenever_it_is_told() {
        let (quality, account) = (Quality::default(), Account::default());
        for (moved, run) in [(7, 8), (u16::MAX, 0)] {
            for is_late in [false, true] {
                let mut skills = ReportedSkills::default();
                if !is_late {
                    skills.add(moved, 1, None, quality, account);
                }
                skills.begin_after(moved);
                if is_late {
                    skills.add(moved, 1, None, quality, account);
                }
                skills.add(run, 12, None, quality, account);
                skills.add(run + 1, 1, None, quality, account);
                assert_eq!(skills.of_run().motions, 13, "moved by {moved}, late: {is_late}");
            }
        }
    }
}
