//! Verifies each repetition: the motions of the plan were sent and executed, at the override that the PLC commanded,
//! along the path that the controller takes without a bus; and the times of the two clocks differ by no more than the
//! cycles between them explain.

mod by_image;
#[cfg(test)]
mod by_image_tests;
mod drives;
mod of_station;
mod times;

use std::fmt;

use anyhow::Context as _;
use plc_node::ExecutionType;
use protocol::image::{Digest, Sum};
use robot_node::Account;
use robot_node::arm::{Joints, distance};
use robot_node::rehearsal::{Calls, Rehearsed, rehearse};
use setup::Setup;

use crate::planned_cell::PlannedCell;
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

/// What differs in a repetition.
#[derive(Clone, Copy, PartialEq, Debug, thiserror::Error)]
pub enum Difference {
    /// The PLC sent other motions.
    #[error("the PLC sent other motions than the plan has: {found}, and the plan has {planned}")]
    Sent {
        /// What it sent.
        found: Sum,
        /// What it should send.
        planned: Sum,
    },
    /// The robot counted another number of motions.
    #[error("the robot executed {found} motions, and the plan has {planned}")]
    Count {
        /// What it counted.
        found: u64,
        /// What it should count.
        planned: u64,
    },
    /// The robot executed other motions, or in other skills.
    #[error(
        "the robot executed other motions than the plan has, or called them otherwise: {found}, and the plan has {planned}"
    )]
    Executed {
        /// What it executed.
        found: Executed,
        /// What it should execute.
        planned: Executed,
    },
    /// The robot followed another override.
    #[error(
        "the robot moved at an override of {} to {} %, and the PLC commanded {} to {} %",
        found[0], found[1], commanded[0], commanded[1]
    )]
    Override {
        /// Lowest and highest, in %.
        found: [u8; 2],
        /// Lowest and highest, in %.
        commanded: [u8; 2],
    },
    /// The arm began elsewhere.
    #[error("the tool began {away_mm:.3} mm from the application's start")]
    Start {
        /// Distance of the tool, in mm.
        away_mm: f64,
    },
    /// The arm ended elsewhere.
    #[error("{seen_by}, joint {joint} ended at {found:.4}° (mm), and the plan ends at {planned:.4}")]
    End {
        /// By whose account.
        seen_by: &'static str,
        /// Its number, counted from 1.
        joint: usize,
        /// In degrees (mm).
        found: f64,
        /// In degrees (mm).
        planned: f64,
    },
    /// The tool ended elsewhere, as the robot reports its pose.
    #[error(
        "by the robot's image the tool ended at x {:.3}, y {:.3}, z {:.3} mm in its base, {away_mm:.3} mm from the plan's \
         {:.3}, {:.3}, {:.3}",
        found[0], found[1], found[2], planned[0], planned[1], planned[2]
    )]
    EndPose {
        /// Distance of both, in mm.
        away_mm: f64,
        /// Position of the tool in the base, in mm.
        found: [f64; 3],
        /// Where it should be, in mm.
        planned: [f64; 3],
    },
    /// The robot's clock runs at another speed.
    #[error(
        "by the robot's own clock the run took {:.3} ms, by the PLC's {:.3} ms, and the cycles between them explain {:.3} ms: \
         does the clock in its image count ns?",
        *found_ns as f64 / 1e6, *plc_ns as f64 / 1e6, *allowed_ns as f64 / 1e6
    )]
    Clock {
        /// By the robot's clock.
        found_ns: i64,
        /// By the PLC's.
        plc_ns: i64,
        /// Largest difference.
        allowed_ns: i64,
    },
    /// The path had another length.
    #[error("the tool's path was {found_mm:.3} mm long, and the plan's is {:.3} to {:.3} mm", planned_mm[0], planned_mm[1])]
    Length {
        /// Length of the path.
        found_mm: f64,
        /// Shortest and longest.
        planned_mm: [f64; 2],
    },
    /// The robot took another time.
    #[error(
        "the robot took {found_ms:.1} ms for its motions by its own clock, and {planned_ms:.1} ms in the rehearsal"
    )]
    RobotTime {
        /// Time by the robot's clock, in ms.
        found_ms: f64,
        /// Rehearsed time, in ms.
        planned_ms: f64,
    },
    /// The two clocks disagree.
    #[error(
        "the PLC measured {:.3} ms more than the robot, and the cycles between them take {:.3} to {:.3} ms",
        *found_ns as f64 / 1e6, allowed_ns[0] as f64 / 1e6, allowed_ns[1] as f64 / 1e6
    )]
    Times {
        /// The PLC's execution time less the robot's.
        found_ns: i64,
        /// Least and most.
        allowed_ns: [i64; 2],
    },
}

/// Motions of an account, and how they were called.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Executed {
    motions: u64,
    skills: u32,
    digest: u64,
}

impl Executed {
    const fn of(account: &Account) -> Self {
        Self { motions: account.motions, skills: account.skills, digest: account.digest }
    }
}

impl fmt::Display for Executed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { motions, skills, digest } = self;
        write!(f, "{digest:016x} over {motions} motions in {skills} skills")
    }
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
        let found = Sum { motions: execution.commanded.motions, value: execution.commanded.digest };
        let planned = if execution_type == ExecutionType::Rc { Digest::default().sum() } else { self.sent };
        if found != planned {
            return Err(Difference::Sent { found, planned }.into());
        }
        if u64::from(execution.motions) != self.sent.motions {
            let found = execution.motions.into();
            return Err(Difference::Count { found, planned: self.sent.motions }.into());
        }
        // A robot that is not our node gives no account.
        let Some(account) = account else { return self.check_by_image(measured) };
        let ([low, high], commanded) = (account.override_percent, execution.commanded.override_percent);
        if low < commanded[0] || high > commanded[1] {
            return Err(Difference::Override { found: [low, high], commanded }.into());
        }
        if let Some(away_mm) = self.away_from_start(&account.start)
            && away_mm > START_TOLERANCE_MM
        {
            return Err(Difference::Start { away_mm }.into());
        }
        let alone = self.rehearsed(execution_type, &account.start, high)?;
        let planned = alone.account;
        let (found, wanted) = (Executed::of(account), Executed::of(&planned));
        if found != wanted {
            return Err(Difference::Executed { found, planned: wanted }.into());
        }
        let robot = &self.planned.robot;
        if let Some(quality) = measured.quality.as_ref().filter(|_| robot.drives.is_some()) {
            drives::check(robot, quality, account, &alone)?;
        }
        drives::check_time(robot, measured, account, &planned)?;
        compare_ends("by the robot", &account.end, &planned.end)?;
        compare_ends("by the PLC", &execution.commanded.end.map(f64::from), &planned.end)?;
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
        let tolerance = |length_mm: f64| LENGTH_TOLERANCE_MM + LENGTH_TOLERANCE * length_mm;
        let shortest_mm = shortest_mm - tolerance(shortest_mm);
        let found_mm = quality.path_length_mm;
        let mut planned_mm = [shortest_mm; 2];
        // Rehearsing slowly takes longer, so only a path that is longer than at the highest override is compared with it.
        let highest = account.override_percent[1];
        for percent in [highest, highest.min(SLOW_PERCENT)] {
            let longest_mm = self.rehearsed(longest, &account.start, percent)?.quality.path_length_mm;
            planned_mm = [shortest_mm, longest_mm + tolerance(longest_mm)];
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
        let PlannedCell { robot, motions, stops, .. } = &self.planned;
        let calls = match execution_type {
            ExecutionType::Rc => Calls::Program,
            ExecutionType::Sm => Calls::Singles,
            ExecutionType::Cm => Calls::Continuous,
        };
        let alone = rehearse(robot, *start, motions, stops, calls, percent)
            .context("the repetition cannot be verified: the arm alone cannot execute the plan")?;
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
