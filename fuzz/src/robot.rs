//! The robot's controller under a PLC that alters what it commands, while the arm moves.

use std::sync::LazyLock;

use machine::Instant;
use protocol::image::{Command, Control, Image, Motion, Order, SLOTS, Skill};
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

/// Commands a continuous motion, and alters bytes of the image between the cycles.
pub(crate) fn robot(data: &[u8]) {
    let (config, motions) = &*CELL;
    let mut script = Script::new(data);
    let mut controller = Controller::new(config.clone(), Vec::new(), 0);
    let mut command = Command { control: Control::ENABLE | Control::RESET, ..Command::default() };
    let mut at = Instant::ZERO;
    let mut left = AFTERWARDS;
    controller.tick(at, Some(&command));
    command.control = Control::ENABLE | Control::EXECUTE;
    (command.number, command.skill, command.total) = (1, Skill::MoveContinuous, motions.len() as u32);
    let rated = &config.arm.limits().speed;
    while left > 0 {
        supply(&mut command, controller.feedback().executed, motions);
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
