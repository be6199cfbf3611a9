//! The robot's controller under a PLC that alters what it commands, while the arm moves.

use std::sync::LazyLock;

use machine::Instant;
use protocol::image::{
    Command, CompactPoints, Control, Image, Motion, MotionKind, Order, PointHead, SLOTS, Skill, Slots,
};
use robot_node::{Controller, RobotConfig};
use virtual_time::hostile::{Choices as _, Script};

/// Cycles after the last choice: the arm gets to rest in them.
const AFTERWARDS: u32 = 200;

/// Share by which a joint may differ from its rated speed: differences are taken over a cycle.
const TOLERANCE: f64 = 1.001;

static CELL: LazyLock<(RobotConfig, Vec<Motion>)> = LazyLock::new(|| {
    let (setup, found) =
        planning::setup_with_application("A").unwrap_or_else(|error| panic!("Setup A: {error}"));
    let plan = found.plan(&setup).unwrap_or_else(|error| panic!("Setup A: {error}"));
    let robot = RobotConfig::from_setup(&setup).unwrap_or_else(|error| panic!("Setup A: {error}"));
    (robot, plan.wire_motions(&setup))
});

/// The same robot with compact points.
static CELL_OF_POINTS: LazyLock<RobotConfig> = LazyLock::new(|| {
    let setup = setup::setup("A").unwrap_or_else(|error| panic!("Setup A: {error}"));
    let setup = setup.with_queue_motions(64).with_compact_points();
    RobotConfig::from_setup(&setup).unwrap_or_else(|error| panic!("Setup A: {error}"))
});

/// Compact points of a trajectory.
const POINTS: u32 = 200;

/// Commands a continuous motion, and alters bytes of the image between the cycles.
pub(crate) fn robot(data: &[u8]) {
    let (config, motions) = &*CELL;
    let call = |command: &mut Command| {
        (command.skill, command.total) = (Skill::MoveContinuous, motions.len() as u32);
    };
    drive(data, config, call, |command, executed| supply(command, executed, motions));
}

/// Commands a trajectory of compact points, and alters bytes of the image between the cycles.
pub(crate) fn trajectory(data: &[u8]) {
    let call = |command: &mut Command| {
        let head = PointHead::of(
            &Motion {
                kind: MotionKind::Spline,
                target: [300.0, 0.0, 100.0, 0.0, 0.0, 180.0],
                velocity: 2_000,
                acceleration: 2_000,
                approximation: 50,
                base: 1,
                ..Motion::EMPTY
            },
            10,
            3,
        );
        (command.skill, command.total) = (Skill::MoveTrajectory, POINTS);
        command.control.set(Control::COMPACT, true);
        command.slots = Slots::Points(CompactPoints::new(head));
    };
    drive(data, &CELL_OF_POINTS, call, supply_points);
}

/// Drives the skill that `call` writes into the command and that `supply` supplies with motions.
fn drive(
    data: &[u8],
    config: &RobotConfig,
    call: impl FnOnce(&mut Command),
    mut supply: impl FnMut(&mut Command, u32),
) {
    let mut script = Script::new(data);
    let mut controller = Controller::new(config.clone(), Vec::new(), 0);
    let mut command = Command { control: Control::ENABLE | Control::RESET, ..Command::default() };
    let mut at = Instant::ZERO;
    let mut left = AFTERWARDS;
    controller.tick(at, Some(&command));
    command.control = Control::ENABLE | Control::EXECUTE;
    command.number = 1;
    call(&mut command);
    let rated = &config.arm.limits().speed;
    while left > 0 {
        supply(&mut command, controller.feedback().executed);
        let joints = *controller.joints();
        let sent = if script.is_over() { Some(command) } else { altered(&mut command, &mut script) };
        at += config.cycle;
        controller.tick(at, sent.as_ref());
        while controller.poll_event().is_some() {}
        for ((from, to), rated) in joints.iter().zip(controller.joints()).zip(rated) {
            let speed = (to - from).abs() / config.cycle.as_secs_f64();
            assert!(speed <= rated * TOLERANCE, "a joint at {speed} of {rated} degrees (mm) per second");
        }
        left -= u32::from(script.is_over());
    }
}

/// Writes the motions that have room, as the PLC's function block does.
fn supply(command: &mut Command, executed: u32, motions: &[Motion]) {
    let written = command.total.min(executed.saturating_add(SLOTS as u32)).min(motions.len() as u32);
    for index in command.written..written {
        motions.get(index as usize).into_iter().for_each(|motion| command.set_slot(index, *motion));
    }
    command.written = command.written.max(written);
}

/// Writes the points that have room, as the PLC's function block does: 5 mm each, in a bend.
fn supply_points(command: &mut Command, executed: u32) {
    let Slots::Points(points) = &mut command.slots else { return };
    let written = command.total.min(executed.saturating_add(points.head.capacity())).min(POINTS);
    for index in command.written..written {
        points.set_difference(index, [-20 * index as i16, 10_000, 0, 0, 0, 0]);
    }
    command.written = command.written.max(written);
}

/// Lets cycles pass, loses the connection for one, or changes bytes of the image: for this cycle or for good.
fn altered(command: &mut Command, script: &mut Script) -> Option<Command> {
    let kind = script.below(8);
    if kind == 0 {
        return None;
    }
    if kind <= 3 {
        return Some(*command);
    }
    let mut image: Image = [0; 256];
    Order::BigEndian.emit_command(command, &mut image);
    for _ in 0..=script.below(4) {
        let place = script.below(image.len());
        image[place] = script.below(256) as u8;
    }
    let read = Order::BigEndian.parse_command(&image).ok()?;
    if kind <= 5 {
        *command = read;
    }
    Some(read)
}
