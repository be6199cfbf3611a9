//! Properties by which the PLC has an arm start together with others, and move together with them.

use machine::Duration;
use planning::{PlannedCell, PlannedStation, WaitAt};
use protocol::image::MotionKind;
use robot_node::{RobotConfig, rehearsal};
use setup::{BusKind, Setup};

use crate::ExecutionType;
use crate::robot_clock::StampDelay;

/// Robot cycles in which a robot takes the motions that are written at the start, one a cycle, with one more for the first.
const TAKING_CYCLES: u32 = 6;

/// Motions of a stored program that a robot checks in a cycle before it starts, at least.
const CHECKED_IN_CYCLE: u32 = 3;

/// An arm that starts, and moves, together with others.
#[derive(Clone, Debug)]
pub struct ArmInStep {
    /// Delay of its images from the robot's stamp to the PLC.
    pub stamp: StampDelay,
    /// Times of its robot.
    pub times: RobotTimes,
    /// Where it moves together with others, in order.
    pub sections: Vec<TogetherSection>,
}

/// The longest times of a robot that does as its setup says.
#[derive(Clone, Copy, Default, PartialEq, Eq, Debug)]
pub struct RobotTimes {
    /// From a scan of the PLC to the robot's cycle that has its image.
    pub image: Duration,
    /// The robot's cycle.
    pub cycle: Duration,
    /// From that cycle until the robot takes up a single motion.
    pub notice: Duration,
    /// The same for a program or a MoveContinuousSkill.
    pub notice_start: Duration,
    /// From then until the arm may move.
    pub prepare: Duration,
    /// The same for a MoveContinuousSkill.
    pub prepare_continuous: Duration,
}

/// The motions of an arm from a mark to the next one between which it moves together with others.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct TogetherSection {
    /// The mark at which it begins.
    pub mark: u32,
    /// Its parts, each from one rest of the arm to the next.
    pub legs: Vec<TogetherLeg>,
    /// Set where one of its motions is a LIN force: then the override stays with the arm.
    pub has_force: bool,
}

/// Motions of an arm from one rest to the next.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct TogetherLeg {
    /// Motions of the plan before its end.
    pub end: u32,
    /// Time on the arm's law from its start to its end.
    pub law: Duration,
}

impl RobotTimes {
    /// Returns the longest time from a scan that sets the start edge until the arm may move, of a skill of this execution type
    /// with so many motions.
    #[must_use]
    pub fn start(&self, execution_type: ExecutionType, motions: u32) -> Duration {
        let (notice, prepare, checks) = match execution_type {
            ExecutionType::Sm => (self.notice, self.prepare, 1),
            ExecutionType::Cm => (self.notice_start, self.prepare_continuous, 0),
            ExecutionType::Rc => (self.notice_start, self.prepare, motions.div_ceil(CHECKED_IN_CYCLE)),
        };
        let takes = self.cycle.saturating_mul(TAKING_CYCLES.saturating_add(checks));
        self.image + self.cycle + notice + prepare.max(takes)
    }

    fn of(setup: &Setup) -> Self {
        let micros = |value: u32| Duration::from_micros(value.into());
        let (robot, bus) = (&setup.robot, &setup.bus);
        let cycle = micros(robot.cycle_us.value);
        let notice = micros(robot.interpreter_quantum_us.value);
        let start_quantum = robot.start_quantum_us.as_ref().map_or(0, |quantum| quantum.value);
        let start_cycles = robot.continuous_start_cycles.as_ref().map_or(0, |cycles| cycles.value);
        let prepare = micros(robot.skill_overhead_us.value) / 2;
        Self {
            image: micros(setup.plc.scan_cost_us.value)
                + micros(bus.cycle_us.value)
                + micros(bus.cable_delay_us.value)
                + cycle,
            cycle,
            notice,
            notice_start: notice + micros(start_quantum),
            prepare,
            prepare_continuous: prepare + cycle.saturating_mul(start_cycles),
        }
    }
}

/// Returns the delay of a robot's images.
///
/// A robot on PROFINET or EtherNet/IP sends by its own clock: from its cycle to the frame it is always the same part of a bus
/// cycle. Which part no image shows, so half of one is assumed, with an error of half of one. A frame of EtherCAT fetches the
/// image in the PLC's cycle, up to a bus cycle later; drift shows by how much.
fn stamp_delay(setup: &Setup) -> StampDelay {
    let micros = |value: u32| Duration::from_micros(value.into());
    let (cable, cycle) = (micros(setup.bus.cable_delay_us.value), micros(setup.bus.cycle_us.value));
    match setup.bus.kind {
        BusKind::Ethercat(..) => StampDelay { least: cable, spread: cycle },
        BusKind::Profinet(..) | BusKind::EthernetIp(..) => {
            StampDelay { least: cable + cycle / 2, spread: Duration::ZERO }
        }
    }
}

impl ArmInStep {
    /// Describes the arms of a planned cell. Where some move together, their laws are those of a rehearsal.
    ///
    /// # Errors
    /// A setup describes no robot, or an arm that moves together with others does not execute its motions.
    pub fn all(cell: &PlannedCell) -> anyhow::Result<Vec<Self>> {
        let is_together = |mark: u32| cell.marks.iter().any(|other| other.number == mark && other.together);
        cell.stations.iter().map(|station| Self::of(station, is_together)).collect()
    }

    fn of(station: &PlannedStation, is_together: impl Fn(u32) -> bool) -> anyhow::Result<Self> {
        let PlannedStation { setup, plan, .. } = station;
        let together: Vec<[&WaitAt; 2]> = plan
            .waits
            .iter()
            .zip(plan.waits.iter().skip(1))
            .filter(|(from, _)| is_together(from.mark))
            .map(|(from, to)| [from, to])
            .collect();
        let mut sections = Vec::new();
        if !together.is_empty() {
            let legs = legs(station)?;
            for [from, to] in together {
                let within = |leg: &&TogetherLeg| {
                    let end = leg.end as usize;
                    from.after < end && end <= to.after
                };
                let motions = plan.motions.get(from.after..to.after).unwrap_or_default();
                sections.push(TogetherSection {
                    mark: from.mark,
                    legs: legs.iter().filter(within).copied().collect(),
                    has_force: motions.iter().any(|motion| motion.kind == MotionKind::LinForceCartesian),
                });
            }
        }
        Ok(Self { stamp: stamp_delay(setup), times: RobotTimes::of(setup), sections })
    }
}

/// Returns the law times of all legs of a station's plan, from rest to rest.
fn legs(station: &PlannedStation) -> anyhow::Result<Vec<TogetherLeg>> {
    let PlannedStation { setup, application, plan, reached, .. } = station;
    let robot = RobotConfig::from_setup(setup)?.in_cell_of(application, &plan.wire_to_start(setup))?;
    let stops = plan.stops();
    let rests = stops.iter().map(|stop| stop.after as usize).chain(plan.waits.iter().map(|wait| wait.after));
    let mut ends: Vec<usize> = rests.chain([plan.motions.len()]).filter(|end| *end > 0).collect();
    ends.sort_unstable();
    ends.dedup();
    let times = rehearsal::law_times(&robot, reached.start, &plan.wire_motions(setup), &ends)?;
    let leg =
        |(end, law): (usize, Duration)| TogetherLeg { end: u32::try_from(end).unwrap_or(u32::MAX), law };
    Ok(ends.into_iter().zip(times).map(leg).collect())
}
