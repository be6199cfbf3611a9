//! Verifies what a run of a cell was at one station: like a robot that works alone, but for the times, which are also those of the
//! other arms at marks.

use anyhow::Context as _;
use plc_node::{ExecutionType, TogetherSection};
use protocol::image::{Digest, Sum};
use robot_node::arm::Joints;
use robot_node::rehearsal::{Calls, Rehearsed, rehearse, rehearse_points, rehearse_program};
use robot_node::{Account, Program};

use super::{
    Difference, DriveDeviation, JOINT_TOLERANCE, SLOW_PERCENT, check_ends, check_executed, check_override,
    check_sent, drives, largest_difference, length_tolerance_mm,
};
use crate::planned_station::PlannedStation;
use records::conditions::Measured;

/// The override of an arm whose master has the PLC's, in %.
const FULL: u8 = 100;

/// What every repetition of a station is compared with.
#[derive(Clone, Debug)]
pub struct StationVerification {
    station: PlannedStation,
    sent: Sum,
    /// What the arm alone does in a type at an override in %, and how long it moves.
    rehearsed: Vec<(ExecutionType, u8, Rehearsed)>,
}

impl StationVerification {
    /// Prepares the verification of a station.
    #[must_use]
    pub fn new(station: PlannedStation) -> Self {
        let mut sent = Digest::default();
        station.planned.motions.iter().for_each(|motion| sent.add(motion));
        Self { station, sent: sent.sum(), rehearsed: Vec::new() }
    }

    /// Compares a repetition with the station's plan.
    ///
    /// # Errors
    ///
    /// The first difference, with the station's name.
    pub fn check(&mut self, found: &Measured) -> anyhow::Result<()> {
        let name = self.station.name.clone();
        self.compare(found).with_context(|| format!("station {name}"))
    }

    fn compare(&mut self, measured: &Measured) -> anyhow::Result<()> {
        if let Some(quality) = &measured.quality {
            // What moves a drive moves its joint too.
            match quality.check_ratings() {
                Err(exceeded) if self.station.planned.robot.drives.is_some() => {
                    return Err(DriveDeviation::Rating(exceeded).into());
                }
                checked => checked?,
            }
        }
        let execution = &measured.execution;
        check_sent(measured, self.sent)?;
        let Some(account) = &measured.account else { return Ok(()) };
        check_override(measured, account)?;
        self.check_led_override(measured, account)?;
        let [_, highest] = account.whole_override_percent();
        let alone = self.rehearsed(execution.execution_type, &account.start, highest)?;
        let planned = alone.account;
        check_executed(account, &planned)?;
        let robot = &self.station.planned.robot;
        if let Some(quality) = measured.quality.as_ref().filter(|_| robot.drives.is_some()) {
            drives::check(robot, quality, account, &alone)?;
        }
        check_ends(measured, account, &planned)?;
        // A continuous motion that waits at a mark or before a zone takes longer by that.
        let waits_for_others = !self.station.waits.is_empty() || !self.station.visits.is_empty();
        let waits_in_skill = execution.execution_type == ExecutionType::Cm && waits_for_others;
        if !waits_in_skill {
            drives::check_time(&self.station.planned.robot, measured, account, &planned)?;
        } else if account.motion_time + self.station.planned.robot.cycle < planned.motion_time {
            let [found_ms, planned_ms] =
                [account.motion_time, planned.motion_time].map(|time| time.as_secs_f64() * 1e3);
            return Err(Difference::RobotTime { found_ms, planned_ms }.into());
        }
        let Some(quality) = measured.quality.filter(|_| execution.blends_suppressed == 0) else {
            return Ok(());
        };
        self.check_length(execution.execution_type, account, quality.path_length_mm, highest)
    }

    /// Compares the override under a master axis. It is full, since the master itself is slower by the override; where the arm also
    /// presses, which has no law, it is the commanded one.
    fn check_led_override(&self, measured: &Measured, account: &Account) -> Result<(), Difference> {
        let found = account.led_override_percent;
        let sections = self.station.in_step.iter().flat_map(|arm| &arm.sections);
        let [lowest, highest] = measured.execution.commanded.override_percent;
        let of_section =
            |section: &TogetherSection| if section.has_force { [lowest, highest] } else { [FULL; 2] };
        let is_led = measured.execution.execution_type == ExecutionType::Cm;
        let sent = sections
            .filter(|_| is_led)
            .map(of_section)
            .reduce(|[low, high], [other_low, other_high]| [low.min(other_low), high.max(other_high)]);
        let is_as_sent = match sent {
            Some([lowest, highest]) => lowest <= found[0] && (lowest..=highest).contains(&found[1]),
            None => found[1] == 0,
        };
        if is_as_sent {
            Ok(())
        } else {
            Err(Difference::LedOverride { found, sent: sent.unwrap_or_default() })
        }
    }

    /// Compares the length of the path, as for a robot that works alone: at the highest override its chords are the longest, and
    /// their sum is the least.
    fn check_length(
        &mut self,
        execution_type: ExecutionType,
        account: &Account,
        found_mm: f64,
        highest: u8,
    ) -> anyhow::Result<()> {
        let mut length_mm = |percent| -> anyhow::Result<f64> {
            Ok(self.rehearsed(execution_type, &account.start, percent)?.quality.path_length_mm)
        };
        let shortest_mm = length_mm(highest)?;
        let tolerance = length_tolerance_mm(shortest_mm);
        if (found_mm - shortest_mm).abs() <= tolerance {
            return Ok(());
        }
        let mut planned_mm = [shortest_mm - tolerance, shortest_mm + tolerance];
        // Where the arm was slower, or stood, its chords were shorter; rehearsing that takes longer.
        let follows_master = account.led_override_percent[1] > 0;
        if (follows_master || account.override_percent[0] < FULL) && found_mm > shortest_mm {
            let longest_mm = length_mm(highest.min(SLOW_PERCENT))?;
            planned_mm[1] = longest_mm + length_tolerance_mm(longest_mm);
            if found_mm <= planned_mm[1] {
                return Ok(());
            }
        }
        Err(Difference::Length { found_mm, planned_mm }.into())
    }

    /// Returns what the arm alone does from these joints, at an override in %.
    fn rehearsed(
        &mut self,
        execution_type: ExecutionType,
        start: &Joints,
        percent: u8,
    ) -> anyhow::Result<Rehearsed> {
        let percent = percent.max(1);
        let is_it = |(of, at, _): &(ExecutionType, u8, Rehearsed)| (*of, *at) == (execution_type, percent);
        let known = self.rehearsed.iter().find(|it| is_it(it)).map(|(.., known)| *known);
        if let Some(known) =
            known.filter(|known| largest_difference(&known.account.start, start).1 < JOINT_TOLERANCE)
        {
            return Ok(known);
        }
        let alone = self
            .rehearse(execution_type, *start, percent)
            .context("the repetition cannot be verified: the arm alone cannot execute the plan")?;
        self.rehearsed.retain(|it| !is_it(it));
        self.rehearsed.push((execution_type, percent, alone));
        Ok(alone)
    }

    fn rehearse(
        &self,
        execution_type: ExecutionType,
        start: Joints,
        percent: u8,
    ) -> anyhow::Result<Rehearsed> {
        if execution_type == ExecutionType::Rc {
            return self.rehearse_programs(start, percent);
        }
        let planned = &self.station.planned;
        if let Some(points) = planned.points.as_ref().filter(|_| execution_type == ExecutionType::Cm) {
            return Ok(rehearse_points(&planned.robot, start, points, percent)?);
        }
        let calls = if execution_type == ExecutionType::Sm { Calls::Singles } else { Calls::Continuous };
        Ok(rehearse(&planned.robot, start, &planned.motions, &planned.stops, calls, percent)?)
    }

    /// Has the arm alone execute its stored programs.
    fn rehearse_programs(&self, start: Joints, percent: u8) -> anyhow::Result<Rehearsed> {
        let planned = &self.station.planned;
        let mut total: Option<Rehearsed> = None;
        for section in &self.station.programs {
            let from = total.map_or(start, |before| before.account.end);
            let program = Program::of_section(&planned.motions, section);
            let rehearsed = rehearse_program(&planned.robot, from, program, percent)?;
            total = Some(total.map_or(rehearsed, |before| before.then(rehearsed)));
        }
        total.context("the plan has no motions")
    }
}
