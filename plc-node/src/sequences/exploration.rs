//! All orders in which two arms execute motions, are lost and begin anew, until no new state appears.

use std::collections::{BTreeSet, VecDeque};

use machine::{Duration, Instant};
use planning::{WaitAt, assign_mark_signals};
use protocol::image::{Control, Feedback, Motion, MotionKind, Order, Skill, State, Status};

use super::{Sequences, StationWork};
use crate::{
    AfterLoss, ExecutionType, FailureCause, MotionList, PlcProgram, Progress, Station, StationConfig,
};

/// More scans than a sequence takes to follow what a robot has done.
const SETTLED: usize = 8;

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Step {
    /// The robot executes its next motion, if it has one.
    Execute(usize),
    Lose(usize),
    /// The run is aborted, or has ended, and the next one begins with both robots.
    Begin,
}

const STEPS: [Step; 5] = [Step::Execute(0), Step::Execute(1), Step::Lose(0), Step::Lose(1), Step::Begin];

/// A robot that executes a motion when it is told to.
#[derive(Default)]
struct Robot {
    feedback: Feedback,
    skills: usize,
    executed: usize,
    /// Marks that its program has passed.
    met: usize,
    is_lost: bool,
}

/// An arm of a cell: how many motions it has, and its waits by mark and place.
type Arm = (usize, &'static [(u32, usize)]);

/// An execution type, and whether stored programs meet by outputs.
type Kind = (ExecutionType, bool);

/// What makes a state another one: of each arm motions executed, skills, motions written or marks passed by its program, whether it executes
/// and whether it is lost; the marks met, whether the run has ended, and the outputs of both robots.
type Key = (Vec<(usize, usize, u32, bool, bool)>, Vec<u32>, bool, [u16; 2]);

struct Cell {
    arms: [Arm; 2],
    /// The waits of each arm.
    waits: [Vec<WaitAt>; 2],
    execution_type: ExecutionType,
    program: Sequences,
    stations: Vec<Station>,
    robots: [Robot; 2],
    now: Instant,
    progress: Progress,
    is_ended: bool,
    /// Marks at which both arms have stood.
    met: BTreeSet<u32>,
}

fn station(index: usize) -> Station {
    let config = StationConfig::patient(1_000);
    let mut station = Station::new(index, config, Order::BigEndian, Duration::from_millis(1));
    station.connect();
    station
}

impl Cell {
    /// Creates the cell. With RC its programs meet by outputs, or end at each mark.
    fn new(arms: [Arm; 2], (execution_type, by_outputs): Kind) -> Self {
        let motion = Motion { kind: MotionKind::LinCartesian, ..Motion::EMPTY };
        let at = |(mark, after): &(u32, usize)| WaitAt {
            mark: *mark,
            after: *after,
            after_action: false,
            signal: None,
        };
        let mut waits = arms.map(|(_, waits)| waits.iter().map(at).collect::<Vec<_>>());
        if by_outputs {
            let [one, other] = &mut waits;
            assert!(assign_mark_signals(&mut [one, other], 0));
        }
        let work = |((motions, _), waits): (Arm, &Vec<WaitAt>)| StationWork {
            program: 1,
            queue_depth: 5,
            refill: setup::Refill::Executed,
            motions: Box::new(MotionList::from(vec![motion; motions])),
            stops: Vec::new(),
            waits: waits.clone(),
            visits: Vec::new(),
            zones: None,
        };
        let mut cell = Self {
            arms,
            execution_type,
            program: Sequences::new(arms.into_iter().zip(&waits).map(work).collect()),
            waits,
            stations: vec![station(0), station(1)],
            robots: Default::default(),
            now: Instant::ZERO,
            progress: Progress::Running,
            is_ended: true,
            met: BTreeSet::new(),
        };
        cell.step(Step::Begin);
        cell
    }

    fn places(&self, arm: usize) -> impl Iterator<Item = (u32, usize)> + use<> {
        self.arms[arm].1.iter().copied()
    }

    /// Returns how far an arm may go: to its first mark at which not both have stood.
    fn limit(&self, arm: usize) -> usize {
        let mut open = self.places(arm).filter(|(mark, _)| !self.met.contains(mark));
        open.next().map_or(usize::MAX, |(_, after)| after)
    }

    fn meet(&mut self) {
        loop {
            let stands = |arm: usize, mark: u32| {
                let mut open = self.places(arm).filter(|(mark, _)| !self.met.contains(mark));
                open.next().is_some_and(|(at, after)| at == mark && after <= self.robots[arm].executed)
                    // What it has shown before it was lost, the other has.
                    && (self.meets(arm) || !self.robots[arm].is_lost)
            };
            let Some((mark, _)) = self.places(0).find(|(mark, _)| stands(0, *mark) && stands(1, *mark))
            else {
                return;
            };
            self.met.insert(mark);
        }
    }

    fn step(&mut self, step: Step) {
        match step {
            Step::Begin => {
                for (robot, station) in self.robots.iter_mut().zip(&mut self.stations) {
                    // Its outputs stay as they were.
                    *robot = Robot { feedback: robot.feedback, ..Robot::default() };
                    robot.feedback.state = State::Ready;
                    robot.feedback.status = Status::ENABLED | Status::AT_REST;
                    let number = station.group().command().number;
                    station.group_mut().release(number, false);
                }
                self.met.clear();
                self.meet();
                self.is_ended = false;
                self.scan(false);
                self.program.begin(self.now, self.execution_type);
            }
            Step::Execute(arm) => self.execute(arm),
            Step::Lose(arm) => self.lose(arm),
        }
        (0..SETTLED).for_each(|_| self.scan(true));
    }

    fn execute(&mut self, arm: usize) {
        let command = *self.stations[arm].group().command();
        let meets = self.meets(arm);
        let robot = &mut self.robots[arm];
        let is_running = robot.feedback.state == State::Running;
        let total = match command.skill {
            Skill::RunProgram if meets => self.arms[arm].0 as u32,
            Skill::RunProgram => sections(self.arms[arm])[robot.skills - usize::from(robot.skills > 0)],
            _ => command.total,
        };
        let has_one = match command.skill {
            Skill::RunProgram if meets => {
                let next = self.waits[arm].get(robot.met);
                next.is_none_or(|wait| wait.after > robot.executed) && robot.feedback.executed < total
            }
            Skill::RunProgram => true,
            _ => robot.feedback.executed < command.written,
        };
        if !is_running || !has_one || robot.is_lost {
            return;
        }
        robot.feedback.executed += 1;
        robot.executed += 1;
        if robot.feedback.executed == total && !meets {
            (robot.feedback.state, robot.feedback.status) =
                (State::Ready, Status::DONE | Status::ENABLED | Status::AT_REST);
        }
        assert!(robot.executed <= self.limit(arm), "arm {arm} goes beyond a mark");
        self.meet();
    }

    /// Returns whether the program of an arm meets others by outputs.
    fn meets(&self, arm: usize) -> bool {
        let is_rc = self.execution_type == ExecutionType::Rc;
        is_rc && self.waits[arm].first().is_some_and(|wait| wait.signal.is_some())
    }

    /// Has the program of an arm show the mark at which it stands, pass it if the other has come, or end.
    fn follow_marks(&mut self, arm: usize) {
        let (inputs, meets) = (self.stations[arm].group().command().outputs, self.meets(arm));
        let robot = &mut self.robots[arm];
        if !meets || robot.is_lost || robot.feedback.state != State::Running {
            return;
        }
        match self.waits[arm].get(robot.met).filter(|wait| wait.after <= robot.executed) {
            Some(wait) => {
                let signal = wait.signal.unwrap();
                robot.feedback.inputs = signal.applied_to(robot.feedback.inputs);
                if signal.is_met_by(inputs) {
                    assert!(self.met.contains(&wait.mark), "arm {arm} passes mark {}", wait.mark);
                    robot.met += 1;
                }
            }
            None if robot.executed == self.arms[arm].0 => {
                (robot.feedback.state, robot.feedback.status) =
                    (State::Ready, Status::DONE | Status::ENABLED | Status::AT_REST);
            }
            None => {}
        }
    }

    fn lose(&mut self, arm: usize) {
        let other = 1 - arm;
        if self.is_ended || self.robots[arm].is_lost {
            return;
        }
        self.robots[arm].is_lost = true;
        // An arm at a mark at its very end has nothing to wait for.
        let is_other_done = self.robots[other].is_lost || self.robots[other].executed == self.arms[other].0;
        let shares = self
            .places(arm)
            .any(|(mark, _)| !self.met.contains(&mark) && self.places(other).any(|(its, _)| its == mark));
        let after = self.program.lose(arm, FailureCause::RobotHalted);
        if is_other_done || shares {
            assert_eq!(after, AfterLoss::EndRun, "arm {arm} is lost");
        } else {
            assert_eq!(after, AfterLoss::GoOn, "arm {arm} is lost");
        }
        self.is_ended = after == AfterLoss::EndRun;
    }

    fn scan(&mut self, with_program: bool) {
        self.now += Duration::from_millis(1);
        (0..self.arms.len()).for_each(|arm| self.follow_marks(arm));
        for (robot, station) in self.robots.iter_mut().zip(&mut self.stations) {
            let command = *station.group().command();
            let feedback = &mut robot.feedback;
            (feedback.life, feedback.life_echo) = (feedback.life.wrapping_add(1), command.life);
            let is_new = command.control.contains(Control::EXECUTE) && command.number != feedback.number;
            if is_new && with_program && !robot.is_lost {
                (feedback.number, feedback.executed) = (command.number, 0);
                (feedback.state, feedback.status) = (State::Running, Status::BUSY | Status::ENABLED);
                robot.skills += 1;
                // It clears what it showed in the last run, as each program that meets others does.
                feedback.inputs = 0;
            }
            feedback.accepted = command.written;
            station.group_mut().read(Some(*feedback));
        }
        if with_program && !self.is_ended {
            self.progress = self.program.scan(self.now, &mut self.stations);
            self.is_ended = self.progress != Progress::Running;
            assert!(matches!(self.progress, Progress::Running | Progress::Done), "{:?}", self.progress);
        }
    }

    fn key(&self) -> Key {
        let station = |(robot, station): (&Robot, &Station)| {
            let command = station.group().command();
            let executes = command.control.contains(Control::EXECUTE);
            let written = command.written + robot.met as u32;
            (robot.executed, robot.skills, written, executes, robot.is_lost)
        };
        let stations = self.robots.iter().zip(&self.stations).map(station).collect();
        let outputs = [0, 1].map(|arm: usize| self.robots[arm].feedback.inputs);
        (stations, self.met.iter().copied().collect(), self.is_ended, outputs)
    }

    /// Checks that the run ends when the arms that are left execute what they get.
    fn ends(&mut self) -> bool {
        let steps = self.arms.iter().map(|(motions, _)| motions).sum::<usize>() * 2 + 2;
        (0..steps).for_each(|step| self.step(Step::Execute(step % 2)));
        self.is_ended
    }
}

/// Returns the number of motions of each program of an arm.
fn sections((motions, waits): Arm) -> Vec<u32> {
    let mut begin = 0;
    let ends = waits.iter().map(|(_, after)| *after).chain([motions]);
    ends.map(|end| (end - std::mem::replace(&mut begin, end)) as u32).filter(|motions| *motions > 0).collect()
}

fn replayed(arms: [Arm; 2], kind: Kind, path: &[Step]) -> Cell {
    let mut cell = Cell::new(arms, kind);
    path.iter().for_each(|step| cell.step(*step));
    cell
}

#[test]
fn no_order_of_motions_losses_and_new_runs_lets_an_arm_beyond_a_mark_or_leaves_a_run_without_end() {
    let cells: [[Arm; 2]; 5] = [
        [(3, &[(1, 1), (2, 1), (3, 2), (4, 3)]), (3, &[(1, 0), (2, 2), (3, 3), (4, 3)])],
        [(3, &[(1, 2)]), (4, &[(1, 1)])],
        [(2, &[(1, 0), (2, 2)]), (3, &[(1, 0), (2, 3)])],
        [(3, &[(1, 1), (2, 1)]), (2, &[(1, 0), (2, 2)])],
        [(2, &[]), (3, &[])],
    ];
    for arms in cells {
        let kinds = ExecutionType::ALL.map(|execution_type| (execution_type, true));
        for kind in kinds.into_iter().chain([(ExecutionType::Rc, false)]) {
            let mut known = BTreeSet::new();
            // The shortest orders first: each is replayed from the start.
            let mut open = VecDeque::from([Vec::new()]);
            while let Some(path) = open.pop_front() {
                let mut cell = replayed(arms, kind, &path);
                if !known.insert(cell.key()) {
                    continue;
                }
                assert!(cell.ends(), "{kind:?} {arms:?}: {path:?}");
                open.extend(STEPS.iter().map(|step| path.iter().copied().chain([*step]).collect::<Vec<_>>()));
            }
            assert!(known.len() > 20, "{} states", known.len());
        }
    }
}
