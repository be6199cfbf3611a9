//! All orders in which the sequences of arms with shared zones go on, with cables that are cut and arms that are lost, until no new
//! state appears. The robots get what the real stations command.

use std::collections::{BTreeSet, VecDeque};

use machine::{Duration, Instant};
use planning::{ZoneSet, ZoneVisit};
use protocol::image::{Command, Control, Feedback, Motion, MotionKind, Order, Skill, State, Status};

use super::{Sequences, StationWork};
use crate::{
    AfterLoss, ExecutionType, FailureCause, MotionList, PlcProgram, Progress, Station, StationConfig,
};

/// More scans than a sequence takes to follow what a robot has done.
const SETTLED: usize = 6;

/// Motions of an arm, and its visits: zone, after, until.
type VisitingArm = (u32, &'static [(usize, usize, usize)]);

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum MotionStep {
    Execute(usize),
    Cut(usize),
    Lose(usize),
}

/// A robot with the command that it got last, and the feedback that the PLC saw last.
#[derive(Default)]
struct CuttableRobot {
    feedback: Feedback,
    seen: Feedback,
    command: Command,
    skills: usize,
    /// Motions of the skills before this one.
    before: u32,
    is_cut: bool,
    is_lost: bool,
}

struct VisitedCell {
    arms: &'static [VisitingArm],
    program: Sequences,
    stations: Vec<Station>,
    robots: Vec<CuttableRobot>,
    now: Instant,
    is_ended: bool,
}

fn station(index: usize) -> Station {
    let config = StationConfig::patient(10_000);
    Station::new(index, config, Order::BigEndian, Duration::from_millis(1))
}

impl VisitedCell {
    fn new(arms: &'static [VisitingArm], execution_type: ExecutionType, has_grants: bool) -> Self {
        let motion = Motion { kind: MotionKind::LinCartesian, ..Motion::EMPTY };
        let work = |(motions, visits): &VisitingArm| StationWork {
            program: 1,
            queue_depth: 2,
            motions: Box::new(MotionList::from(vec![motion; *motions as usize])),
            stops: Vec::new(),
            waits: Vec::new(),
            visits: visits
                .iter()
                .filter(|_| has_grants)
                .map(|(zone, after, until)| ZoneVisit { zone: *zone, after: *after, until: *until })
                .collect(),
            zones: None,
        };
        let mut cell = Self {
            arms,
            program: Sequences::new(arms.iter().map(work).collect()),
            stations: (0..arms.len()).map(station).collect(),
            robots: arms.iter().map(|_| CuttableRobot::default()).collect(),
            now: Instant::ZERO,
            is_ended: false,
        };
        for robot in &mut cell.robots {
            (robot.feedback.state, robot.feedback.status) = (State::Ready, Status::ENABLED | Status::AT_REST);
        }
        cell.scan(false);
        cell.program.begin(cell.now, execution_type);
        cell.settle();
        cell
    }

    fn settle(&mut self) {
        (0..SETTLED).for_each(|_| self.scan(true));
        self.check();
    }

    fn step(&mut self, step: MotionStep) {
        match step {
            MotionStep::Execute(arm) => self.execute(arm),
            MotionStep::Cut(arm) => self.robots[arm].is_cut ^= true,
            MotionStep::Lose(arm) if self.is_ended || self.robots[arm].is_lost => {}
            MotionStep::Lose(arm) => {
                self.robots[arm].is_lost = true;
                self.is_ended = self.program.lose(arm, FailureCause::RobotHalted) == AfterLoss::EndRun;
            }
        }
        self.check();
        self.settle();
    }

    /// Returns the motions of the program that a robot executes, or that it executed last.
    fn section(&self, arm: usize) -> u32 {
        let (motions, visits) = self.arms[arm];
        let mut ends: Vec<u32> = visits.iter().map(|(_, after, _)| *after as u32).chain([motions]).collect();
        ends.retain(|end| *end > 0);
        ends.sort_unstable();
        ends.dedup();
        let end = ends[self.robots[arm].skills.saturating_sub(1)];
        end - self.robots[arm].before
    }

    fn has_next(&self, arm: usize) -> bool {
        let robot = &self.robots[arm];
        let got = match robot.command.skill {
            Skill::RunProgram => self.section(arm),
            _ => robot.command.written,
        };
        robot.feedback.state == State::Running && robot.feedback.executed < got
    }

    fn execute(&mut self, arm: usize) {
        if !self.has_next(arm) {
            return;
        }
        let total = match self.robots[arm].command.skill {
            Skill::RunProgram => self.section(arm),
            _ => self.robots[arm].command.total,
        };
        let feedback = &mut self.robots[arm].feedback;
        feedback.executed += 1;
        if feedback.executed == total {
            (feedback.state, feedback.status) =
                (State::Ready, Status::DONE | Status::ENABLED | Status::AT_REST);
        }
    }

    /// Returns the zones in which an arm may truly be.
    fn inside(&self, arm: usize) -> ZoneSet {
        let robot = &self.robots[arm];
        let executed = (robot.before + robot.feedback.executed) as usize;
        let moves = self.has_next(arm);
        let is_in = |(_, after, until): &&(usize, usize, usize)| {
            executed < *until && (*after < executed || *after == executed && moves)
        };
        let zones = self.arms[arm].1.iter().filter(is_in).map(|(zone, ..)| *zone);
        zones.fold(ZoneSet::NONE, |all, zone| all.with(ZoneSet::of(zone)))
    }

    fn check(&self) {
        let mut taken = ZoneSet::NONE;
        for arm in 0..self.arms.len() {
            let inside = self.inside(arm);
            assert!(!taken.meets(inside), "two arms are in a zone");
            taken = taken.with(inside);
        }
    }

    fn scan(&mut self, with_program: bool) {
        self.now += Duration::from_millis(1);
        for (robot, station) in self.robots.iter_mut().zip(&mut self.stations) {
            let command = *station.group().command();
            if !robot.is_cut && !robot.is_lost {
                robot.command = command;
                let is_new =
                    command.control.contains(Control::EXECUTE) && command.number != robot.feedback.number;
                if is_new && with_program {
                    robot.before += robot.feedback.executed;
                    (robot.feedback.number, robot.feedback.executed) = (command.number, 0);
                    (robot.feedback.state, robot.feedback.status) =
                        (State::Running, Status::BUSY | Status::ENABLED);
                    robot.skills += 1;
                }
                robot.feedback.accepted = command.written;
                robot.seen = robot.feedback;
            }
            robot.feedback.life = robot.feedback.life.wrapping_add(1);
            robot.seen.life = robot.feedback.life;
            robot.seen.life_echo = command.life;
            station.group_mut().read(Some(robot.seen));
        }
        if with_program && !self.is_ended {
            let progress = self.program.scan(self.now, &mut self.stations);
            self.is_ended = progress != Progress::Running;
            assert!(matches!(progress, Progress::Running | Progress::Done), "{progress:?}");
        }
    }

    /// Returns what makes this state another one.
    fn key(&self) -> impl Ord + use<> {
        let one = |(robot, station): (&CuttableRobot, &Station)| {
            let command = station.group().command();
            let executed = (robot.before, robot.feedback.executed, robot.seen.executed, robot.skills);
            (executed, robot.command.written, command.written, command.number, robot.is_cut, robot.is_lost)
        };
        let robots: Vec<_> = self.robots.iter().zip(&self.stations).map(one).collect();
        let held: Vec<_> = (0..self.arms.len()).map(|arm| self.program.zones().held(arm)).collect();
        (robots, held, self.is_ended)
    }

    /// Checks that the run ends once the cables are mended.
    fn ends(&mut self) -> bool {
        self.robots.iter_mut().for_each(|robot| robot.is_cut = false);
        self.settle();
        let steps = self.arms.iter().map(|(motions, _)| motions).sum::<u32>() as usize + 1;
        for step in 0..steps * self.arms.len() {
            self.step(MotionStep::Execute(step % self.arms.len()));
        }
        self.is_ended
    }
}

/// Explores all states of some arms; returns how many there are.
fn explore(arms: &'static [VisitingArm], execution_type: ExecutionType, has_grants: bool) -> usize {
    let replayed = |path: &[MotionStep]| {
        let mut cell = VisitedCell::new(arms, execution_type, has_grants);
        path.iter().for_each(|step| cell.step(*step));
        cell
    };
    let steps: Vec<MotionStep> = (0..arms.len())
        .flat_map(|arm| [MotionStep::Execute(arm), MotionStep::Cut(arm), MotionStep::Lose(arm)])
        .collect();
    let mut known = BTreeSet::new();
    // The shortest orders first: each is replayed from the start.
    let mut open = VecDeque::from([Vec::<MotionStep>::new()]);
    while let Some(path) = open.pop_front() {
        let mut cell = replayed(&path);
        if !known.insert(cell.key()) {
            continue;
        }
        assert!(cell.ends(), "{execution_type} {arms:?}: {path:?}");
        open.extend(steps.iter().map(|step| path.iter().copied().chain([*step]).collect::<Vec<_>>()));
    }
    known.len()
}

#[test]
fn no_order_of_motions_cuts_and_losses_gives_two_robots_motions_in_one_zone_or_leaves_a_run_without_end() {
    let cells: [&[VisitingArm]; 3] = [
        &[(3, &[(0, 1, 2)]), (3, &[(0, 0, 2)])],
        &[(3, &[(0, 0, 1), (1, 1, 3)]), (3, &[(0, 1, 2)])],
        &[(2, &[(0, 1, 2)]), (1, &[(0, 0, 1)]), (1, &[(0, 0, 1)])],
    ];
    for arms in cells {
        for execution_type in ExecutionType::ALL {
            let states = explore(arms, execution_type, true);
            assert!(states > 50, "{execution_type} {arms:?}: {states} states");
        }
    }
}

#[test]
#[should_panic(expected = "two arms are in a zone")]
fn without_grants_two_arms_come_into_a_zone() {
    explore(&[(2, &[(0, 0, 1)]), (2, &[(0, 0, 1)])], ExecutionType::Cm, false);
}
