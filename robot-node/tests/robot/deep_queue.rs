//! A queue deeper than the slots, refilled by what the robot has accepted.

use std::f32::consts::TAU;
use std::time::Duration;

use hot_path::Steps;
use machine::Instant;
use proptest::prelude::*;
use protocol::image::{
    Command, Control, Digest, ErrorNumber, Motion, MotionKind, SLOTS, Services, Skill, State, Status,
};
use robot_node::{Controller, RobotConfig};
use setup::{LookAhead, SplineBlock};

use crate::plc;

/// Setup A's robot with a queue of this many motions, whose calls take no time.
fn config(queue: u32) -> RobotConfig {
    let setup = setup::setup("A").unwrap().with_queue_motions(queue);
    setup::check(&setup).unwrap();
    RobotConfig {
        interpreter_quantum: Duration::ZERO,
        start_quantum: Duration::ZERO,
        skill_overhead: Duration::ZERO,
        ..RobotConfig::from_setup(&setup).unwrap()
    }
}

/// Points a millimetre apart on a circle of 60 mm, at 500 mm/s and 5000 mm/s².
fn circle(kind: MotionKind, points: usize) -> Vec<Motion> {
    let point = |index: usize| {
        let angle = index as f32 / 60.0;
        Motion {
            kind,
            target: [150.0 + 60.0 * libm::cosf(angle), 60.0 * libm::sinf(angle), 100.0, 0.0, 0.0, 180.0],
            velocity: 5_000,
            acceleration: 5_000,
            approximation: 50,
            base: 1,
            ..Motion::EMPTY
        }
    };
    let start = Motion { kind: MotionKind::PtpCartesian, approximation: 0, ..point(0) };
    std::iter::once(start).chain((1..=points).map(point)).collect()
}

/// A robot whose slots are refilled by `accepted`, an image after each cycle.
struct Fed {
    controller: Controller,
    command: Command,
    motions: Vec<Motion>,
    at: Instant,
    cycle: Duration,
    queue: u32,
}

impl Fed {
    fn ready(queue: u32) -> Self {
        let config = config(queue);
        let cycle = config.cycle;
        let mut controller = Controller::new(config, Vec::new(), 1);
        let control = Control::ENABLE | Control::RESET;
        let mut command = Command { control, ..Command::default() };
        controller.tick(Instant::ZERO, Some(&command));
        command.control = Control::ENABLE;
        Self { controller, command, motions: Vec::new(), at: Instant::ZERO, cycle, queue }
    }

    fn call(&mut self, motions: Vec<Motion>) {
        self.motions = motions;
        let total = self.motions.len() as u32;
        let command = &mut self.command;
        (command.number, command.skill) = (command.number + 1, Skill::MoveContinuous);
        (command.total, command.written) = (total, 0);
        command.control = Control::ENABLE | Control::EXECUTE;
        self.refill(0);
    }

    fn refill(&mut self, accepted: u32) {
        while self.command.written < self.command.total.min(accepted + SLOTS as u32) {
            let index = self.command.written;
            self.command.set_slot(index, self.motions[index as usize]);
            self.command.written += 1;
        }
    }

    /// Runs a cycle; what the robot then has accepted is refilled if `is_supplied`.
    fn cycle(&mut self, is_supplied: bool) {
        self.at += self.cycle;
        let before = *self.controller.feedback();
        self.controller.tick(self.at, Some(&self.command));
        let after = *self.controller.feedback();
        assert!(after.accepted - after.executed <= self.queue.max(SLOTS as u32), "{after:?}");
        if before.number == after.number {
            assert!(before.executed <= after.executed && before.accepted <= after.accepted, "{after:?}");
        }
        if is_supplied && after.number == self.command.number {
            self.refill(after.accepted);
        }
    }

    /// Runs to the end of the skill. Returns the tool's speed in each cycle after the first motion.
    fn run(&mut self) -> Vec<f32> {
        let mut speeds = Vec::new();
        let ended = Status::DONE.0 | Status::ERROR.0 | Status::ABORTED.0;
        while self.controller.feedback().status.0 & ended == 0
            || self.controller.feedback().number != self.command.number
        {
            self.cycle(true);
            let feedback = self.controller.feedback();
            if feedback.number == self.command.number && feedback.executed > 0 {
                speeds.push(feedback.path_speed);
            }
            assert!(self.at < Instant::from_nanos(100_000_000_000), "never ends: {feedback:?}");
        }
        speeds
    }

    fn all_arrived(&self) {
        let feedback = self.controller.feedback();
        let total = self.motions.len() as u32;
        assert!(feedback.status.contains(Status::DONE), "{feedback:?}");
        assert_eq!((feedback.executed, feedback.accepted), (total, total));
        let mut digest = Digest::default();
        self.motions.iter().for_each(|motion| digest.add(motion));
        assert_eq!(self.controller.accepted().sum(), digest.sum());
    }
}

#[test]
fn a_spline_of_points_a_millimetre_apart_is_driven_at_its_programmed_speed_by_a_deep_queue() {
    let points = (60.0 * TAU) as usize + 130;
    // The highest speed that the arm does not fall below for 160 ms.
    let kept = |queue: u32| {
        let mut fed = Fed::ready(queue);
        fed.call(circle(MotionKind::Spline, points));
        let speeds = fed.run();
        fed.all_arrived();
        assert_eq!(fed.controller.feedback().blends_suppressed, 0);
        let lowest = |some: &[f32]| some.iter().copied().fold(f32::INFINITY, f32::min);
        speeds.windows(40).map(lowest).fold(0.0, f32::max)
    };
    let (five, deep) = (kept(5), kept(64));
    assert!(five < 200.0, "{five} mm/s with five motions");
    assert!(deep > 480.0, "{deep} mm/s with 64");
}

#[test]
fn a_robot_says_how_deep_its_queue_is_and_that_it_keeps_what_it_accepts_only_if_it_is_deeper_than_the_slots()
{
    for (queue, depth, keeps) in [(5, 0, false), (6, 6, true), (200, 200, true)] {
        let fed = Fed::ready(queue);
        let feedback = fed.controller.feedback();
        assert_eq!(feedback.queue_depth, depth);
        assert_eq!(feedback.services.contains(Services::KEEPS_ACCEPTED), keeps);
    }
}

#[test]
fn a_cycle_takes_all_that_the_slots_hold_until_the_queue_is_full() {
    let mut fed = Fed::ready(64);
    fed.call(circle(MotionKind::Spline, 400));
    let mut accepted = Vec::new();
    for _ in 0..60 {
        fed.cycle(true);
        accepted.push(fed.controller.feedback().accepted);
    }
    let taken: Vec<u32> = accepted.windows(2).map(|pair| pair[1] - pair[0]).collect();
    assert_eq!(taken.iter().max(), Some(&(SLOTS as u32)));
    let feedback = fed.controller.feedback();
    assert_eq!(feedback.accepted - feedback.executed, 64, "{accepted:?}");
}

/// Returns the longest time of a cycle that takes `taken` motions of a path and knows at least `known` then, where its fastest time in
/// several passes counts.
fn slowest_cycle(path: &[Motion], queue: u32, [taken, known]: [u32; 2]) -> Duration {
    let mut steps = Steps::default();
    let mut is_meant = Vec::new();
    for _ in 0..4 {
        let mut fed = Fed::ready(queue);
        fed.call(path.to_vec());
        steps.begin();
        is_meant.clear();
        while fed.controller.feedback().executed + 200 < path.len() as u32 {
            fed.at += fed.cycle;
            let before = *fed.controller.feedback();
            steps.time(|| fed.controller.tick(fed.at, Some(&fed.command)));
            let after = *fed.controller.feedback();
            let takes = after.accepted.saturating_sub(before.accepted) == taken;
            is_meant.push(takes && after.accepted - after.executed >= known && after.path_speed > 0.0);
            if after.number == fed.command.number {
                fed.refill(if queue as usize > SLOTS { after.accepted } else { after.executed });
            }
        }
    }
    let meant = is_meant.iter().zip(steps.fastest()).filter(|(is_meant, _)| **is_meant);
    let (count, slowest) =
        meant.fold((0, Duration::ZERO), |(count, most), (_, took)| (count + 1, most.max(*took)));
    assert!(count > 20, "{count} cycles take {taken} motions and know {known}");
    slowest
}

#[test]
fn a_cycle_that_takes_five_motions_of_a_deep_queue_costs_at_most_eight_times_one_that_takes_one_of_five() {
    let apart = circle(MotionKind::Spline, 500);
    // A quarter of a millimetre apart, so that a cycle at 300 mm/s takes nearly five.
    let close = (0..1_000).map(|index| {
        let angle = index as f32 / 240.0;
        let target = [150.0 + 60.0 * libm::cosf(angle), 60.0 * libm::sinf(angle), 100.0, 0.0, 0.0, 180.0];
        Motion { target, velocity: 3_000, ..apart[1] }
    });
    let close: Vec<_> = std::iter::once(apart[0]).chain(close.skip(1)).collect();
    // In turns, so that a busy host slows both.
    let ratios = (0..3).map(|_| {
        let one = slowest_cycle(&apart, 5, [1, 5]);
        let five = slowest_cycle(&close, 128, [5, 110]);
        println!("{one:?} for one motion of five, {five:?} for five of 128");
        five.as_secs_f64() / one.as_secs_f64()
    });
    let least = ratios.fold(f64::INFINITY, f64::min);
    assert!(least <= 8.0, "{least:.1} times");
}

#[test]
fn it_starts_with_what_came_with_the_command_and_does_not_wait_for_a_full_queue() {
    let started = |queue: u32| {
        let mut fed = Fed::ready(queue);
        let mut motions = circle(MotionKind::Spline, 400);
        // The arm is on its way at once.
        motions.remove(0);
        fed.call(motions);
        (1..100).find(|_| {
            fed.cycle(true);
            fed.controller.feedback().path_speed > 0.0
        })
    };
    assert!(started(200) <= started(5), "{:?} and {:?} cycles", started(200), started(5));
}

#[test]
fn nothing_of_a_queue_runs_after_a_halt_a_cancel_or_a_lost_connection() {
    for (stop, is_connected) in [(Control::HALT, true), (Control::CANCEL, true), (Control::default(), false)]
    {
        for queue in [5, 64, 200] {
            let mut fed = Fed::ready(queue);
            fed.call(circle(MotionKind::Spline, 400));
            (0..300).for_each(|_| fed.cycle(true));
            let moving = *fed.controller.feedback();
            assert!(moving.path_speed > 50.0, "{moving:?}");
            fed.command.control = Control::ENABLE | stop;
            for _ in 0..200 {
                fed.at += fed.cycle;
                fed.controller.tick(fed.at, is_connected.then_some(&fed.command));
            }
            let stopped = *fed.controller.feedback();
            assert!(stopped.status.contains(Status::AT_REST), "{stopped:?}");
            assert!(stopped.executed >= moving.executed && stopped.executed <= stopped.accepted);
            let joints = *fed.controller.joints();
            fed.command.control = Control::ENABLE;
            fed.cycle(false);
            fed.command.control = Control::ENABLE | Control::RESET;
            fed.cycle(false);
            fed.command.control = Control::ENABLE;
            (0..200).for_each(|_| fed.cycle(false));
            assert_eq!(fed.controller.joints(), &joints, "queue of {queue}");
            assert_eq!(fed.controller.feedback().state, State::Ready);
            let next = vec![Motion { velocity: 2_000, ..circle(MotionKind::PtpCartesian, 0)[0] }];
            fed.call(next);
            fed.run();
            fed.all_arrived();
        }
    }
}

#[test]
fn an_empty_deep_queue_stops_the_arm_at_its_last_motion_and_it_goes_on_when_more_come() {
    let mut fed = Fed::ready(64);
    fed.call(circle(MotionKind::Spline, 300));
    (0..250).for_each(|_| fed.cycle(true));
    (0..250).for_each(|_| fed.cycle(false));
    let starved = *fed.controller.feedback();
    assert!(
        starved.status.contains(Status::AT_REST | Status::BUSY) && starved.blends_suppressed == 1,
        "{starved:?}"
    );
    assert_eq!(starved.executed, starved.accepted);
    fed.refill(starved.accepted);
    fed.run();
    fed.all_arrived();
}

#[test]
fn more_than_five_motions_ahead_of_the_accepted_ones_is_an_error_for_a_deep_queue_too() {
    let mut fed = Fed::ready(64);
    fed.call(circle(MotionKind::Spline, 300));
    (0..100).for_each(|_| fed.cycle(true));
    fed.command.written += SLOTS as u32 + 1;
    (0..400).for_each(|_| fed.cycle(false));
    assert_eq!(fed.controller.feedback().error, ErrorNumber::QueueOverrun);
}

/// Runs a stored program of this robot. Returns the motions executed and the tool's speed in each cycle from the command on.
fn run_program(config: RobotConfig, motions: Vec<Motion>) -> Vec<(u32, f32)> {
    let cycle = config.cycle;
    let total = motions.len() as u32;
    let mut controller = Controller::new(config, vec![(1, motions.into())], 1);
    let mut command = Command { control: Control::ENABLE | Control::RESET, program: 1, ..Command::default() };
    let mut at = Instant::ZERO;
    controller.tick(at, Some(&command));
    (command.number, command.skill) = (1, Skill::RunProgram);
    command.control = Control::ENABLE | Control::EXECUTE;
    let mut speeds = Vec::new();
    while !controller.feedback().status.contains(Status::DONE) {
        at += cycle;
        controller.tick(at, Some(&command));
        speeds.push((controller.feedback().executed, controller.feedback().path_speed));
        assert!(speeds.len() < 20_000 && controller.feedback().error == ErrorNumber::None);
    }
    assert_eq!(controller.feedback().executed, total);
    speeds
}

#[test]
fn a_program_that_looks_ahead_over_a_whole_spline_is_faster_than_one_that_knows_five_motions() {
    let kept = |look_ahead: LookAhead| {
        let config = RobotConfig { program_look_ahead: look_ahead, ..config(5) };
        let cycles = run_program(config, circle(MotionKind::Spline, 500));
        let speeds: Vec<f32> =
            cycles.into_iter().filter(|(executed, _)| *executed > 0).map(|(_, speed)| speed).collect();
        let lowest = |some: &[f32]| some.iter().copied().fold(f32::INFINITY, f32::min);
        speeds.windows(40).map(lowest).fold(0.0, f32::max)
    };
    let five = kept(LookAhead::Motions(5));
    let [deep, whole] = [LookAhead::Motions(64), LookAhead::Block(SplineBlock::WholeSpline)].map(kept);
    assert!(five < 200.0 && deep > 480.0 && whole > 480.0, "{five}, {deep}, {whole} mm/s");
}

#[test]
fn a_long_program_starts_as_soon_as_a_short_one_since_it_is_checked_when_it_is_loaded() {
    let start = |points: usize| {
        let mut motions = circle(MotionKind::Spline, points);
        motions[0].target[0] -= 100.0;
        run_program(config(5), motions).iter().position(|(_, speed)| *speed > 0.0)
    };
    assert_eq!(start(1_000), start(10));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn every_motion_of_a_random_list_is_driven_once_at_any_depth_and_supply(
        points in proptest::collection::vec((0..4_u8, -60.0..60.0_f32, -60.0..60.0_f32, 0..3_u16), 10..60),
        steps in proptest::collection::vec(0.2..8.0_f32, 60),
        supply in proptest::collection::vec(any::<bool>(), 1..40),
        queue in prop_oneof![Just(5_u32), Just(64), Just(200)],
    ) {
        let mut motions = vec![plc::ptp(150.0, 0.0, 100.0, 0)];
        let mut place = [150.0_f32, 0.0];
        for ((kind, x, y, zone), step) in points.into_iter().zip(steps) {
            let length = libm::hypotf(x, y).max(1.0);
            let next = [place[0] + step * x / length, place[1] + step * y / length];
            // Within a square about the start.
            let next = if next.iter().zip([150.0, 0.0]).all(|(one, middle)| (one - middle).abs() < 60.0) {
                next
            } else {
                [150.0 + 0.3 * (place[0] - 150.0) + 0.1 * step, 0.3 * place[1]]
            };
            place = next;
            let kind = if kind == 0 { MotionKind::LinCartesian } else { MotionKind::Spline };
            let target = [place[0], place[1], 100.0, 0.0, 0.0, 180.0];
            motions.push(Motion { kind, target, approximation: zone * 50, ..circle(kind, 1)[1] });
        }
        let mut fed = Fed::ready(queue);
        fed.call(motions);
        let ended = Status::DONE.0 | Status::ERROR.0;
        for index in 0..20_000 {
            fed.cycle(supply[index % supply.len()] || index % 7 == 0);
            if fed.controller.feedback().status.0 & ended != 0 {
                break;
            }
        }
        fed.all_arrived();
    }
}
