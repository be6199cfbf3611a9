//! Two arms that move together, with robots that stall, are suspended, and go on in any order.

use std::collections::VecDeque;

use machine::{Duration, Instant};
use planning::WaitAt;
use proptest::prelude::*;
use protocol::image::{
    Command, Control, Feedback, IMAGE_LEN, Motion, MotionKind, Order, Services, State, Status,
};

use crate::arm_in_step::{ArmInStep, RobotTimes, TogetherLeg, TogetherSection};
use crate::event::Events;
use crate::program::{PlcProgram, Progress};
use crate::robot_clock::StampDelay;
use crate::station::RobotImage;
use crate::{ExecutionType, MotionList, Override, Sequences, Station, StationConfig, StationWork};

const MS: Duration = Duration::from_millis(1);

/// Law of each motion in s.
const MOTION_S: f64 = 0.1;

/// Motions of both arms, and those before both marks, between which they move together.
const MOTIONS: [usize; 2] = [4, 6];
const MARKS: [[usize; 2]; 2] = [[1, 3], [2, 5]];

/// Law of the slower arm's section in s.
const LONGEST_S: f64 = 0.3;

/// By how much both may be apart, as time on that law: set-points are sent 50 ms ahead, 25 ms late the master stands, and to slow
/// down takes it another 25.
const APART_S: f64 = 0.12;

/// The robots' clocks are ahead of the PLC's by so much.
const AHEAD_NS: [u64; 2] = [5_000_000_000, 70_000_000];

#[derive(Clone, Copy, PartialEq, Debug)]
enum Happening {
    /// The robot stands for no reason that it gives, or goes on.
    Stall(usize, bool),
    Suspend(usize),
    Resume(usize),
    Override(u8),
}

/// A robot that is exactly where it should be, as far as it may go on.
#[derive(Default)]
struct ExactRobot {
    feedback: Feedback,
    law_s: f64,
    stalls: bool,
    set_points: VecDeque<(u64, f64)>,
}

impl ExactRobot {
    fn go_on(&mut self, now: Instant, ahead_ns: u64, command: &Command, total: usize) {
        let clock_ns = now.as_nanos() + ahead_ns;
        let feedback = &mut self.feedback;
        (feedback.clock_ns, feedback.life) = (clock_ns, feedback.life.wrapping_add(1));
        (feedback.life_echo, feedback.override_percent) = (command.life, command.override_percent);
        if command.control.contains(Control::EXECUTE) && command.number != feedback.number {
            (feedback.number, feedback.executed, self.law_s) = (command.number, 0, 0.0);
            (feedback.state, feedback.status) = (State::Running, Status::BUSY | Status::ENABLED);
            self.set_points.clear();
        }
        let is_led = command.control.contains(Control::SYNC);
        let set_point = (command.start_time_ns, f64::from(command.law_time_us) / 1e6);
        if is_led && self.set_points.back() != Some(&set_point) {
            self.set_points.push_back(set_point);
        }
        match feedback.state {
            State::Running if command.control.contains(Control::SUSPEND) => feedback.state = State::Suspended,
            State::Suspended if command.control.contains(Control::RESUME) => feedback.state = State::Running,
            State::Running if !self.stalls => {
                let share = f64::from(command.override_percent) / 100.0;
                let may_s = self.law_s + 0.001 * share;
                let to_s = if is_led { wanted(&mut self.set_points, clock_ns).min(may_s) } else { may_s };
                self.law_s = to_s.max(self.law_s).min(f64::from(command.written) * MOTION_S);
            }
            _ => {}
        }
        feedback.accepted = command.written;
        feedback.executed = (self.law_s / MOTION_S + 1e-9) as u32;
        feedback.law_time_us = if is_led { (self.law_s * 1e6).round() as u32 } else { 0 };
        if feedback.executed as usize == total && feedback.state == State::Running {
            (feedback.state, feedback.status) = (State::Ready, Status::DONE | Status::ENABLED);
        }
    }
}

/// Returns the law's time that the set-points want now, in s; drops those that are over.
fn wanted(set_points: &mut VecDeque<(u64, f64)>, clock_ns: u64) -> f64 {
    while set_points.get(1).is_some_and(|(at, _)| *at <= clock_ns) {
        set_points.pop_front();
    }
    match (set_points.front(), set_points.get(1)) {
        (Some((from, one)), Some((to, two))) if *from <= clock_ns => {
            one + (two - one) * (clock_ns - from) as f64 / (to - from) as f64
        }
        (Some((from, one)), _) if *from <= clock_ns => *one,
        _ => 0.0,
    }
}

struct LedCell {
    program: Sequences,
    stations: Vec<Station>,
    robots: [ExactRobot; 2],
    events: Events,
    now: Instant,
}

fn station(index: usize) -> Station {
    let config = StationConfig { robot_cycle: MS, ..StationConfig::patient(1_000) };
    let mut station = Station::new(index, config, Order::LittleEndian, MS);
    station.connect();
    station.estimate_clock(StampDelay { least: Duration::ZERO, spread: Duration::ZERO });
    station
}

impl LedCell {
    fn new() -> Self {
        let motion = Motion { kind: MotionKind::LinCartesian, ..Motion::EMPTY };
        let work = |arm: usize| StationWork {
            program: 1,
            queue_depth: 5,
            refill: setup::Refill::Executed,
            motions: Box::new(MotionList::from(vec![motion; MOTIONS[arm]])),
            stops: Vec::new(),
            waits: (1..)
                .zip(MARKS[arm])
                .map(|(mark, after)| WaitAt { mark, after, after_action: false, signal: None })
                .collect(),
            visits: Vec::new(),
            zones: None,
        };
        let in_step = |arm: usize| {
            let [from, to] = MARKS[arm];
            let leg = TogetherLeg { end: to as u32, law: MS * ((to - from) as u32 * 100) };
            ArmInStep {
                stamp: StampDelay { least: Duration::ZERO, spread: Duration::ZERO },
                times: RobotTimes { image: MS * 2, cycle: MS, ..RobotTimes::default() },
                sections: vec![TogetherSection { mark: 1, legs: vec![leg], has_force: false }],
            }
        };
        let mut program = Sequences::new(vec![work(0), work(1)]);
        program.keep_in_step(vec![in_step(0), in_step(1)]);
        let mut cell = Self {
            program,
            stations: vec![station(0), station(1)],
            robots: Default::default(),
            events: Events::for_stations(2),
            now: Instant::from_millis(1_000),
        };
        for robot in &mut cell.robots {
            (robot.feedback.state, robot.feedback.status) = (State::Ready, Status::ENABLED | Status::AT_REST);
            robot.feedback.services = Services::SYNC;
        }
        (0..1_500).for_each(|_| cell.exchange());
        cell.program.begin(cell.now, ExecutionType::Cm);
        cell
    }

    /// Lets the robots take their commands, and the PLC their images.
    fn exchange(&mut self) {
        self.now += MS;
        for (index, (robot, station)) in self.robots.iter_mut().zip(&mut self.stations).enumerate() {
            let group = station.group();
            let command = group.led_command().unwrap_or_else(|| *group.command());
            robot.go_on(self.now, AHEAD_NS[index], &command, MOTIONS[index]);
            let mut image = [0; IMAGE_LEN];
            Order::LittleEndian.emit_feedback(&robot.feedback, &mut image);
            station.life.note_arrival(self.now, self.now.as_nanos());
            station.note_stamp(self.now, || Some(image));
            assert_eq!(
                station.read_inputs(self.now, RobotImage::Read(Some(&image)), 0, &mut self.events),
                None
            );
            while self.events.pop().is_some() {}
        }
    }

    fn scan(&mut self) -> Progress {
        self.exchange();
        let progress = self.program.scan(self.now, &mut self.stations);
        let [left, right] = [0, 1].map(|arm| self.share(arm));
        let is_between = self.robots.iter().all(|robot| robot.feedback.law_time_us > 0);
        assert!(!is_between || (left - right).abs() * LONGEST_S <= APART_S, "{left} and {right}");
        for arm in [0, 1] {
            let [from, _] = MARKS[arm];
            let other_came = self.robots[1 - arm].feedback.executed as usize >= MARKS[1 - arm][0];
            let is_beyond = self.robots[arm].law_s > from as f64 * MOTION_S + 1e-9;
            assert!(!is_beyond || other_came || self.robots[1 - arm].feedback.state == State::Ready);
        }
        progress
    }

    /// Returns the share of the section that an arm has driven.
    fn share(&self, arm: usize) -> f64 {
        let [from, to] = MARKS[arm].map(|motions| motions as f64 * MOTION_S);
        ((self.robots[arm].law_s - from) / (to - from)).clamp(0.0, 1.0)
    }

    fn happens(&mut self, what: Happening) {
        match what {
            Happening::Stall(arm, stalls) => self.robots[arm].stalls = stalls,
            Happening::Suspend(arm) => self.stations[arm].group_mut().set_control(Control::SUSPEND, true),
            Happening::Resume(arm) => {
                self.stations[arm].group_mut().set_control(Control::SUSPEND, false);
                self.stations[arm].group_mut().set_control(Control::RESUME, true);
            }
            Happening::Override(percent) => {
                let to = Override::from_percent(f64::from(percent)).expect("a percentage");
                self.stations.iter_mut().for_each(|station| station.group_mut().set_override(to));
            }
        }
    }
}

fn happening() -> impl Strategy<Value = Happening> {
    prop_oneof![
        (0..2_usize, any::<bool>()).prop_map(|(arm, stalls)| Happening::Stall(arm, stalls)),
        (0..2_usize).prop_map(Happening::Suspend),
        (0..2_usize).prop_map(Happening::Resume),
        (0..=100_u8).prop_map(Happening::Override),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn whatever_stalls_or_suspends_either_arm_both_stay_in_step_and_come_to_the_end(
        happenings in prop::collection::vec((0..300_u32, happening()), 0..12),
    ) {
        let mut cell = LedCell::new();
        let mut progress = Progress::Running;
        for (scans, what) in happenings {
            cell.happens(what);
            for _ in 0..scans {
                if progress == Progress::Running {
                    progress = cell.scan();
                }
            }
        }
        for arm in [0, 1] {
            cell.happens(Happening::Stall(arm, false));
            cell.happens(Happening::Resume(arm));
        }
        cell.happens(Happening::Override(100));
        for _ in 0..4_000 {
            if progress == Progress::Running {
                progress = cell.scan();
            }
        }
        prop_assert_eq!(progress, Progress::Done);
        for station in &cell.stations {
            prop_assert_eq!(station.group().led_command(), None);
        }
    }
}

#[test]
fn an_arm_that_waits_for_another_owes_no_progress_and_the_other_does() {
    let mut cell = LedCell::new();
    while cell.share(0) < 0.3 {
        assert_eq!(cell.scan(), Progress::Running);
    }
    assert!(!cell.program.waits(0) && !cell.program.waits(1));
    cell.happens(Happening::Stall(1, true));
    (0..300).for_each(|_| assert_eq!(cell.scan(), Progress::Running));
    assert!(cell.program.waits(0) && !cell.program.waits(1));
    cell.happens(Happening::Stall(1, false));
    while cell.share(0) < 0.8 {
        assert_eq!(cell.scan(), Progress::Running);
    }
    assert!(!cell.program.waits(0) && !cell.program.waits(1));
}
