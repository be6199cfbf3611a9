//! Verifies each repetition: the motions of the plan were sent and executed, at the override that the PLC commanded,
//! along the path that the controller takes without a bus; and the times of the two clocks differ by no more than the
//! cycles between them explain.

mod by_image;
#[cfg(test)]
mod by_image_tests;
mod difference;
mod drives;
mod of_station;
mod times;

use anyhow::Context as _;
use plc_node::ExecutionType;
use protocol::image::{Digest, Sum};
use robot_node::Account;
use robot_node::arm::{Joints, distance};
use robot_node::rehearsal::{Calls, Rehearsed, rehearse, rehearse_points};
use setup::Setup;

use crate::planned_cell::PlannedCell;
pub use difference::{Difference, Executed};
pub use drives::DriveDeviation;
pub use of_station::StationVerification;
use records::conditions::Measured;
use records::faults::Fault;
use records::mode::Mode;
use times::Times;

/// Largest difference of a joint from where it should be, in degrees (mm). The PLC takes a start within 0.001 for the
/// start, and a held force moves the arm by less.
const JOINT_TOLERANCE: f64 = 0.02;

/// Largest distance of the tool at the start from where the application starts, in mm.
const START_TOLERANCE_MM: f64 = 0.1;

/// What may differ in the length of the path, which is the sum of its chords from one robot cycle to the next: in mm, and
/// as a share of the length.
const LENGTH_TOLERANCE_MM: f64 = 0.1;
const LENGTH_TOLERANCE: f64 = 1e-3;

/// Override in %, at which chords are nearly as long as the path: what a chord lacks of its arc grows with the square of
/// the speed, so that it lacks a hundredth of what it lacks at 100 %.
const SLOW_PERCENT: u8 = 10;

/// What every repetition of a run is compared with.
#[derive(Clone, Debug)]
pub struct Verification {
    planned: PlannedCell,
    sent: Sum,
    /// Where the tool is at the start; `None` where the application names no start.
    start_mm: Option<[f64; 3]>,
    /// What the arm alone does in a type at an override in %, from the joints with which the last repetition started.
    rehearsed: Vec<(ExecutionType, u8, Rehearsed)>,
    times: Times,
}

/// Compares the motions that the PLC sent, and the number that the robot executed, with those of the plan.
fn check_sent(measured: &Measured, planned: Sum) -> Result<(), Difference> {
    let execution = &measured.execution;
    let found = Sum { motions: execution.commanded.motions, value: execution.commanded.digest };
    let is_rc = execution.execution_type == ExecutionType::Rc;
    let sent = if is_rc { Digest::default().sum() } else { planned };
    if found != sent {
        return Err(Difference::Sent { found, planned: sent });
    }
    if u64::from(execution.motions) != planned.motions {
        return Err(Difference::Count { found: execution.motions.into(), planned: planned.motions });
    }
    Ok(())
}

/// Compares the override that the robot followed with the commanded one; returns the lowest and the highest in %.
fn check_override(measured: &Measured, account: &Account) -> Result<[u8; 2], Difference> {
    let commanded = measured.execution.commanded.override_percent;
    let found = account.override_percent;
    if found[0] < commanded[0] || found[1] > commanded[1] {
        return Err(Difference::Override { found, commanded });
    }
    Ok(found)
}

/// Compares the executed motions and how they were called.
fn check_executed(account: &Account, planned: &Account) -> Result<(), Difference> {
    let (found, planned) = (Executed::of(account), Executed::of(planned));
    if found == planned { Ok(()) } else { Err(Difference::Executed { found, planned }) }
}

/// Compares where the arm ended, by the robot and by the PLC.
fn check_ends(measured: &Measured, account: &Account, planned: &Account) -> Result<(), Difference> {
    compare_ends("by the robot", &account.end, &planned.end)?;
    compare_ends("by the PLC", &measured.execution.commanded.end.map(f64::from), &planned.end)
}

/// Returns what may differ in a path of this length, in mm.
fn length_tolerance_mm(length_mm: f64) -> f64 {
    LENGTH_TOLERANCE_MM + LENGTH_TOLERANCE * length_mm
}

impl Verification {
    /// Prepares the verification of the runs of an application.
    ///
    /// # Errors
    ///
    /// The application cannot be planned, or the arm alone does not get to its start.
    pub fn new(
        setup: &Setup,
        application: &planning::Application,
        mode: Mode,
        faults: &[Fault],
    ) -> anyhow::Result<Self> {
        Self::of(setup, PlannedCell::of(setup, application)?, mode, faults)
    }

    /// Prepares the verification of the runs of an application that is planned already.
    pub fn of(setup: &Setup, planned: PlannedCell, mode: Mode, faults: &[Fault]) -> anyhow::Result<Self> {
        let mut sent = Digest::default();
        planned.motions.iter().for_each(|motion| sent.add(motion));
        let PlannedCell { robot, to_start, .. } = &planned;
        let way: Vec<_> = to_start.from_anywhere.into_iter().collect();
        let start_mm = match way.is_empty() {
            true => None,
            false => {
                let way = rehearse(robot, robot.home, &way, &[], Calls::Singles, 100);
                let end = way.context("the arm does not get to the application's start")?.account.end;
                Some(robot.arm.forward(&end).position)
            }
        };
        let times = Times::new(setup, &planned.stops, mode, faults);
        Ok(Self { planned, sent: sent.sum(), start_mm, rehearsed: Vec::new(), times })
    }

    /// Compares a repetition with the plan.
    ///
    /// # Errors
    ///
    /// The first difference.
    pub fn check(&mut self, measured: &Measured) -> anyhow::Result<()> {
        let Measured { execution, account, .. } = measured;
        let execution_type = execution.execution_type;
        check_sent(measured, self.sent)?;
        // A robot that is not our node gives no account.
        let Some(account) = account else { return self.check_by_image(measured) };
        let [_, high] = check_override(measured, account)?;
        if let Some(away_mm) = self.away_from_start(&account.start)
            && away_mm > START_TOLERANCE_MM
        {
            return Err(Difference::Start { away_mm }.into());
        }
        let alone = self.rehearsed(execution_type, &account.start, high)?;
        let planned = alone.account;
        check_executed(account, &planned)?;
        let robot = &self.planned.robot;
        if let Some(quality) = measured.quality.as_ref().filter(|_| robot.drives.is_some()) {
            drives::check(robot, quality, account, &alone)?;
        }
        drives::check_time(robot, measured, account, &planned)?;
        check_ends(measured, account, &planned)?;
        self.check_length(measured, alone.quality.path_length_mm)?;
        Ok(self.times.check(measured, planned.skills)?)
    }

    fn away_from_start(&self, joints: &Joints) -> Option<f64> {
        let tool = self.planned.robot.arm.forward(joints).position;
        self.start_mm.map(|start| distance(start, tool))
    }

    /// Compares the length of the path. At the highest override its chords are the longest, and their sum is the least; the
    /// slower the arm, the nearer the sum comes to the length of the path itself. A blend that became a stop lengthens it, at
    /// most to that of single motions.
    fn check_length(&mut self, measured: &Measured, shortest_mm: f64) -> anyhow::Result<()> {
        let Some((quality, account)) = measured.quality.zip(measured.account) else { return Ok(()) };
        let longest = match measured.execution.blends_suppressed {
            0 => measured.execution.execution_type,
            _ => ExecutionType::Sm,
        };
        let shortest_mm = shortest_mm - length_tolerance_mm(shortest_mm);
        let found_mm = quality.path_length_mm;
        let mut planned_mm = [shortest_mm; 2];
        // Rehearsing slowly takes longer, so only a path that is longer than at the highest override is compared with it.
        let highest = account.override_percent[1];
        for percent in [highest, highest.min(SLOW_PERCENT)] {
            let longest_mm = self.rehearsed(longest, &account.start, percent)?.quality.path_length_mm;
            planned_mm = [shortest_mm, longest_mm + length_tolerance_mm(longest_mm)];
            if (planned_mm[0]..=planned_mm[1]).contains(&found_mm) {
                return Ok(());
            }
            if found_mm < shortest_mm {
                break;
            }
        }
        Err(Difference::Length { found_mm, planned_mm }.into())
    }

    /// Returns what the arm alone does from these joints at an override in %. All repetitions of a run mostly begin with the
    /// same joints.
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
        let PlannedCell { robot, motions, points, stops, .. } = &self.planned;
        let calls = match execution_type {
            ExecutionType::Rc => Calls::Program,
            ExecutionType::Sm => Calls::Singles,
            ExecutionType::Cm => Calls::Continuous,
        };
        let alone = match points.as_ref().filter(|_| calls == Calls::Continuous) {
            Some(points) => rehearse_points(robot, *start, points, percent),
            None => rehearse(robot, *start, motions, stops, calls, percent),
        };
        let alone =
            alone.context("the repetition cannot be verified: the arm alone cannot execute the plan")?;
        self.rehearsed.retain(|it| !is_it(it));
        self.rehearsed.push((execution_type, percent, alone));
        Ok(alone)
    }
}

/// Returns the joint that differs most, counted from 0, and by how much.
fn largest_difference(a: &Joints, b: &Joints) -> (usize, f64) {
    let differences = a.iter().zip(b).map(|(a, b)| (a - b).abs()).enumerate();
    differences.max_by(|(_, a), (_, b)| a.total_cmp(b)).unwrap_or((0, 0.0))
}

fn compare_ends(seen_by: &'static str, found: &Joints, planned: &Joints) -> Result<(), Difference> {
    let (joint, away) = largest_difference(found, planned);
    // A value that is not a number is not within the tolerance.
    if away <= JOINT_TOLERANCE {
        return Ok(());
    }
    Err(Difference::End { seen_by, joint: joint + 1, found: found[joint], planned: planned[joint] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Stand as _;
    use crate::virtual_run::VirtualRun;
    use records::schedule::{PAUSE, Step};

    /// Runs the application of Setup A once, without faults; returns what verifies it and what was measured.
    pub(super) fn run(execution_type: ExecutionType) -> (Verification, Measured) {
        let (setup, found) = planning::setup_with_application("A").unwrap();
        run_of(&setup, &found, execution_type, None)
    }

    pub(super) fn run_of(
        setup: &Setup,
        found: &planning::Found,
        execution_type: ExecutionType,
        overrides: Option<&str>,
    ) -> (Verification, Measured) {
        let mut run = VirtualRun::start(setup, &found.application, 1).unwrap();
        let overrides = overrides.map(|text| text.parse().unwrap());
        let step = Step { execution_type, repetition: 2, pause: PAUSE, overrides };
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        let measured = runtime.block_on(run.execute(step)).unwrap();
        let verification = Verification::new(setup, &found.application, Mode::Virtual, &[]).unwrap();
        (verification, measured)
    }

    fn account(measured: &mut Measured) -> &mut Account {
        measured.account.as_mut().unwrap()
    }

    #[test]
    fn a_run_that_nothing_disturbs_is_what_the_plan_says_in_every_type() {
        for execution_type in ExecutionType::ALL {
            let (mut verification, measured) = run(execution_type);
            verification.check(&measured).unwrap();
        }
    }

    #[test]
    fn whatever_differs_from_the_plan_is_named() {
        let (mut verification, good) = run(ExecutionType::Sm);
        let mut said = |change: fn(&mut Measured)| {
            let mut measured = good;
            change(&mut measured);
            verification.check(&measured).unwrap_err().to_string()
        };
        for (change, words) in [
            ((|run| run.execution.commanded.digest ^= 1) as fn(&mut Measured), "the PLC sent other motions"),
            (|run| run.execution.commanded.motions -= 1, "the PLC sent other motions"),
            (|run| run.execution.motions = 12, "the robot executed 12 motions, and the plan has 13"),
            (|run| account(run).digest ^= 1, "the robot executed other motions"),
            (|run| account(run).skills = 12, "called them otherwise"),
            (|run| account(run).override_percent = [36, 100], "an override of 36 to 100 %, and the PLC"),
            (|run| account(run).start[0] += 1.0, "from the application's start"),
            (|run| account(run).end[1] += 0.1, "by the robot, joint 2 ended at"),
            (|run| run.execution.commanded.end[1] = f32::NAN, "by the PLC, joint 2 ended at"),
            (|run| run.quality.as_mut().unwrap().path_length_mm += 5.0, "the tool's path was"),
            (|run| run.execution.execution_time_ns += 200_000_000, "the PLC measured"),
            (|run| run.execution.execution_time_ns -= 200_000_000, "the PLC measured"),
        ] {
            let said = said(change);
            assert!(said.contains(words), "{said}");
        }
    }

    #[test]
    fn a_slow_run_is_as_long_as_its_path_although_the_chords_of_a_coarse_cycle_shorten_a_fast_one() {
        let mut setup = setup::setup("B").unwrap();
        setup.robot.cycle_us.value = 24_000;
        let engraving = planning::application("engraving", None).unwrap();
        let (mut verification, good) = run_of(&setup, &engraving, ExecutionType::Rc, Some("50"));
        verification.check(&good).unwrap();
        for wrong_mm in [4.0, -4.0] {
            let mut measured = good;
            measured.quality.as_mut().unwrap().path_length_mm += wrong_mm;
            let said = verification.check(&measured).unwrap_err().to_string();
            assert!(said.contains("the tool's path was"), "{wrong_mm} mm: {said}");
        }
    }

    #[test]
    fn cycles_that_a_node_missed_explain_a_later_end_and_no_earlier_one() {
        let (mut verification, good) = run(ExecutionType::Rc);
        let mut stalled = good;
        stalled.execution.execution_time_ns += 200_000_000;
        assert!(verification.check(&stalled).is_err());
        stalled.interference.missed[0] = 200;
        verification.check(&stalled).unwrap();
        stalled.execution.execution_time_ns -= 400_000_000;
        assert!(verification.check(&stalled).is_err());
    }
}
