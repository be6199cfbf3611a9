//! Compact points: the PLC's block and the robot's controller together, and heads that no robot can use.

use std::f64::consts::TAU;
use std::time::Duration;

use machine::Instant;
use planning::CompactPath;
use plc_node::function_blocks::{
    BlockError, BufferMode, MotionInputs, MovePtpCartesian, MoveTrajectory, Outputs,
};
use plc_node::{AxesGroup, MotionSource, PointList, WaitLimits};
use protocol::image::{
    Command, CompactPoints, Control, Digest, ErrorNumber, Feedback, Motion, MotionKind, PointHead, Services,
    Skill, Slots, State, Status,
};
use robot_node::{Controller, RobotConfig};
use setup::Refill;

use crate::plc::Cell;

/// Setup A's robot with compact points and a queue of this many, whose calls take no time.
fn config(queue: u32) -> RobotConfig {
    let setup = setup::setup("A").unwrap().with_queue_motions(queue).with_compact_points();
    setup::check(&setup).unwrap();
    RobotConfig {
        interpreter_quantum: Duration::ZERO,
        start_quantum: Duration::ZERO,
        skill_overhead: Duration::ZERO,
        ..RobotConfig::from_setup(&setup).unwrap()
    }
}

const HEAD: PointHead = PointHead::of(
    &Motion {
        kind: MotionKind::Spline,
        target: [210.0, 0.0, 100.0, 0.0, 0.0, 180.0],
        velocity: 5_000,
        acceleration: 5_000,
        approximation: 50,
        base: 1,
        ..Motion::EMPTY
    },
    1,
    3,
);

/// Points on a circle of 60 mm that begins at the origin.
fn circle(points: u32, spacing_mm: f64) -> CompactPath {
    let place = |point: u32| {
        let angle = f64::from(point) * spacing_mm / 60.0;
        [150.0 + 60.0 * libm::cos(angle), 60.0 * libm::sin(angle), 100.0, 0.0, 0.0, 180.0]
    };
    let targets: Vec<_> = (1..=points).map(place).collect();
    let resolution = CompactPath::finest_resolution(HEAD.origin.map(f64::from), &targets);
    CompactPath::of(PointHead { resolution, ..HEAD }, targets).unwrap()
}

/// A PLC with a block of compact points on a robot: four scans in a robot cycle.
struct PointCell {
    controller: Controller,
    group: AxesGroup,
    block: MoveTrajectory,
    source: PointList,
    path: CompactPath,
    at: Instant,
    queue: u32,
    outputs: Outputs,
}

impl PointCell {
    /// A cell whose arm stands at the origin of the path.
    fn at_origin(path: CompactPath, queue: u32, refill: Refill) -> Self {
        let mut controller = Controller::new(config(queue), Vec::new(), 1);
        let mut group = AxesGroup::new(WaitLimits { answer_scans: 10_000, silent_scans: u32::MAX });
        group.read(Some(*controller.feedback()));
        group.set_control(Control::ENABLE | Control::RESET, true);
        controller.tick(Instant::ZERO, Some(group.command()));
        group.set_control(Control::RESET, false);
        let mut cell = Self {
            controller,
            group,
            block: MoveTrajectory::default().refilled_by(refill),
            source: PointList::from(path.clone()),
            path,
            at: Instant::ZERO,
            queue,
            outputs: Outputs::default(),
        };
        let start = Motion {
            kind: MotionKind::PtpCartesian,
            target: cell.path.head.origin,
            velocity: 5_000,
            acceleration: 5_000,
            base: 1,
            ..Motion::EMPTY
        };
        let (inputs, mut ptp) = (MotionInputs::from(&start), MovePtpCartesian::default());
        for _ in 0..2_000 {
            cell.group.read(Some(*cell.controller.feedback()));
            if ptp.call(true, &inputs, BufferMode::default(), &mut cell.group).done {
                return cell;
            }
            cell.tick(true);
        }
        panic!("the arm does not come to the origin: {:?}", cell.feedback());
    }

    const fn feedback(&self) -> &Feedback {
        self.controller.feedback()
    }

    fn tick(&mut self, is_connected: bool) {
        self.at += Duration::from_millis(4);
        self.controller.tick(self.at, is_connected.then_some(self.group.command()));
    }

    /// Runs a robot cycle after the PLC's scans; the block is called if `is_supplied`.
    fn cycle(&mut self, is_supplied: bool) {
        for _ in 0..4 {
            self.group.read(Some(*self.controller.feedback()));
            if is_supplied {
                self.outputs =
                    self.block.call(true, &mut self.source, BufferMode::default(), &mut self.group);
            }
        }
        let before = *self.feedback();
        self.tick(true);
        let after = self.feedback();
        assert!(after.accepted - after.executed <= self.queue, "{after:?}");
        if before.number == after.number {
            assert!(before.executed <= after.executed && before.accepted <= after.accepted, "{after:?}");
        }
    }

    /// Runs to the end. Returns the tool's speed in each cycle.
    fn run(&mut self) -> Vec<f32> {
        let mut speeds = Vec::new();
        while !self.outputs.done {
            self.cycle(true);
            assert!(!self.outputs.error, "{:?}", self.block.error());
            speeds.push(self.feedback().path_speed);
            assert!(speeds.len() < 50_000, "never ends: {:?}", self.feedback());
        }
        speeds
    }

    fn all_arrived(&self) {
        let (feedback, total) = (self.feedback(), self.path.differences.len() as u32);
        assert!(feedback.status.contains(Status::DONE), "{feedback:?}");
        assert_eq!((feedback.executed, feedback.accepted), (total, total));
        let (mut digest, mut again) = (Digest::default(), PointList::from(self.path.clone()));
        (0..total).for_each(|index| digest.add(&again.get(index).unwrap()));
        assert_eq!(self.controller.accepted().sum(), digest.sum());
    }
}

#[test]
fn points_of_a_quarter_millimetre_are_driven_at_a_mean_of_three_hundred_mm_per_s_and_each_once() {
    let points = (2.0 * 60.0 * TAU / 0.25) as u32;
    let mut cell = PointCell::at_origin(circle(points, 0.25), 128, Refill::Accepted);
    let speeds = cell.run();
    cell.all_arrived();
    assert_eq!(cell.feedback().blends_suppressed, 0);
    // Without the first and the last 400 ms, in which the arm starts and brakes.
    let middle = &speeds[100..speeds.len() - 100];
    let mean = middle.iter().sum::<f32>() / middle.len() as f32;
    let lowest = middle.iter().copied().fold(f32::INFINITY, f32::min);
    assert!(mean > 300.0, "mean {mean} mm/s, lowest {lowest} mm/s in {} cycles", middle.len());
}

#[test]
fn a_cycle_takes_ten_points_and_never_more() {
    let mut cell = PointCell::at_origin(circle(300, 0.25), 128, Refill::Accepted);
    let mut taken = Vec::new();
    while !cell.outputs.done {
        let before = cell.feedback().accepted;
        cell.cycle(true);
        taken.push(cell.feedback().accepted.saturating_sub(before));
    }
    cell.all_arrived();
    assert_eq!(taken.iter().max(), Some(&10));
    assert!(taken.iter().filter(|taken| **taken == 10).count() >= 10, "{taken:?}");
}

#[test]
fn every_point_is_driven_once_by_either_count_and_with_lines_and_angles_too() {
    let with_angles = {
        let head = PointHead { coordinates: 6, resolution: 5, kind: MotionKind::LinCartesian, ..HEAD };
        let place = |point: u32| {
            let way = f64::from(point);
            [210.0, way, 100.0, 0.5 * way, 0.0, 180.0]
        };
        CompactPath::of(head, (1..=60).map(place)).unwrap()
    };
    for refill in [Refill::Executed, Refill::Accepted] {
        for path in [circle(100, 0.25), with_angles.clone()] {
            let mut cell = PointCell::at_origin(path, 64, refill);
            cell.run();
            cell.all_arrived();
            let [x, y, ..] = cell.feedback().pose;
            let mut again = PointList::from(cell.path.clone());
            let last = again.get(cell.path.differences.len() as u32 - 1).unwrap();
            assert!((x - last.target[0]).abs() < 0.01 && (y - last.target[1]).abs() < 0.01, "{x}, {y}");
        }
    }
}

#[test]
fn no_point_runs_after_a_halt_a_cancel_or_a_lost_connection() {
    for (stop, is_connected) in [(Control::HALT, true), (Control::CANCEL, true), (Control::default(), false)]
    {
        let mut cell = PointCell::at_origin(circle(1_200, 0.25), 128, Refill::Accepted);
        (0..150).for_each(|_| cell.cycle(true));
        let moving = *cell.feedback();
        assert!(moving.path_speed > 50.0, "{moving:?}");
        cell.group.set_control(stop, true);
        (0..200).for_each(|_| cell.tick(is_connected));
        let stopped = *cell.feedback();
        assert!(stopped.status.contains(Status::AT_REST), "{stopped:?}");
        assert!(stopped.executed >= moving.executed && stopped.executed <= stopped.accepted);
        let joints = *cell.controller.joints();
        cell.group.set_control(stop | Control::EXECUTE, false);
        cell.tick(true);
        cell.group.set_control(Control::RESET, true);
        cell.tick(true);
        cell.group.set_control(Control::RESET, false);
        (0..200).for_each(|_| cell.tick(true));
        assert_eq!(cell.controller.joints(), &joints);
        assert_eq!(cell.feedback().state, State::Ready);
    }
}

#[test]
fn an_empty_ring_stops_the_arm_at_its_last_point_and_it_goes_on_when_more_come() {
    let mut cell = PointCell::at_origin(circle(1_200, 0.25), 64, Refill::Accepted);
    (0..150).for_each(|_| cell.cycle(true));
    (0..250).for_each(|_| cell.cycle(false));
    let starved = *cell.feedback();
    assert!(starved.status.contains(Status::AT_REST | Status::BUSY), "{starved:?}");
    assert_eq!((starved.executed, starved.blends_suppressed), (starved.accepted, 1));
    cell.run();
    cell.all_arrived();
}

/// Has a robot take up a command. Returns its error, and the index of the finding.
fn answer(config: RobotConfig, change: impl FnOnce(&mut Command)) -> (u16, u8) {
    let mut controller = Controller::new(config, Vec::new(), 1);
    let control = Control::ENABLE | Control::RESET;
    let mut command = Command { control, ..Command::default() };
    controller.tick(Instant::ZERO, Some(&command));
    let mut points = CompactPoints::new(HEAD);
    points.set_difference(0, [0, 30_000, 0, 0, 0, 0]);
    command = Command {
        control: Control::ENABLE | Control::EXECUTE | Control::COMPACT,
        number: 1,
        skill: Skill::MoveTrajectory,
        total: 1,
        written: 1,
        slots: Slots::Points(points),
        ..command
    };
    change(&mut command);
    for cycle in 1..100 {
        controller.tick(Instant::from_nanos(cycle * 4_000_000), Some(&command));
    }
    let feedback = controller.feedback();
    (feedback.error.into(), feedback.finding.index)
}

#[test]
fn a_robot_refuses_a_head_that_it_cannot_use_and_one_without_the_form_refuses_the_skill() {
    let with = |change: fn(&mut PointHead)| {
        answer(config(64), |command| {
            if let Slots::Points(points) = &mut command.slots {
                change(&mut points.head);
            }
        })
    };
    let plain = RobotConfig::from_setup(&setup::setup("A").unwrap()).unwrap();
    assert_eq!(answer(plain, |_| ()), (ErrorNumber::CompactNotServed.into(), 0));
    assert_eq!(answer(config(64), |command| command.slots = Slots::EMPTY), (44, 4));
    assert_eq!(with(|head| head.resolution = 0), (44, 1));
    assert_eq!(with(|head| head.coordinates = 5), (44, 2));
    assert_eq!(with(|head| head.content = 1), (44, 3));
    assert_eq!(with(|head| head.kind = MotionKind::PtpCartesian).0, 3);
    assert_eq!(with(|head| head.velocity = 0).0, 10);
    assert_eq!(with(|head| head.acceleration = 0).0, 11);
    assert_eq!(with(|head| head.base = 9).0, 9);
    assert_eq!(with(|head| head.origin[0] = f32::NAN).0, 13);
    assert_eq!(answer(config(64), |command| command.written = 31).0, 7);
}

#[test]
fn a_robot_says_that_it_takes_compact_points_only_if_its_setup_does() {
    let has = |config| Controller::new(config, Vec::new(), 1).feedback().services.contains(Services::COMPACT);
    assert!(has(config(30)));
    assert!(!has(RobotConfig { compact_points: false, ..config(64) }));
    let mut cell = PointCell::at_origin(circle(100, 0.25), 64, Refill::Accepted);
    cell.controller = Controller::new(RobotConfig { compact_points: false, ..config(64) }, Vec::new(), 1);
    cell.cycle(true);
    assert_eq!(cell.block.error(), Some(BlockError::CompactNotServed));
}

#[test]
fn the_form_follows_the_control_bit_where_the_bytes_of_the_slots_stay_the_same() {
    let mut cell = Cell::with(config(64), Vec::new(), 1);
    let origin = cell.feedback().pose;
    let mut points = CompactPoints::new(PointHead { origin, base: 0, resolution: 100, ..HEAD });
    (0..4).for_each(|point| points.set_difference(point, [0, 1_000, 0, 0, 0, 0]));
    let mut ends = Vec::new();
    for form in [Control::default(), Control::COMPACT, Control::default(), Control::COMPACT] {
        cell.control(Control::ENABLE | Control::RESET);
        cell.run_ms(20);
        cell.call(Skill::MoveTrajectory, Vec::new());
        cell.command(|command| {
            command.control.set(form, true);
            (command.total, command.written, command.slots) = (4, 4, Slots::Points(points));
        });
        cell.wait_for_end();
        ends.push((cell.feedback().error, cell.feedback().executed));
    }
    let [refused, driven] = [(ErrorNumber::PointHead, 0), (ErrorNumber::None, 4)];
    assert_eq!(ends, [refused, driven, refused, driven]);
}
