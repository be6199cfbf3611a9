//! Cost of the robot cycles that take motions, with a queue of five and with deeper ones: points 0.25 mm apart on a circle.

#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    clippy::disallowed_types,
    reason = "an example that measures time"
)]

use std::time::{Duration, Instant as Clock};

use machine::Instant;
use protocol::image::{Command, Control, Motion, MotionKind, Skill, Status};
use robot_node::{Controller, RobotConfig};

fn main() {
    let kind = if std::env::args().any(|argument| argument == "lin") {
        MotionKind::LinCartesian
    } else {
        MotionKind::Spline
    };
    let step: f32 = std::env::args().find_map(|argument| argument.parse().ok()).unwrap_or(0.25);
    let five = slowest_cycles(5, kind, step);
    println!("queue of 5: a cycle that takes one with five known: {five:?}");
    for queue in [64, 128, 200] {
        let deep = slowest_cycles(queue, kind, step);
        let ratio = |index: usize| deep[index].as_secs_f64() / five[0].as_secs_f64();
        println!("queue of {queue}: {deep:?}: median {:.1}, slowest {:.1} times", ratio(0), ratio(1));
    }
}

/// Returns the median and the largest of the fastest times of each cycle that takes as many motions as it may with a full queue.
fn slowest_cycles(queue: u32, kind: MotionKind, step: f32) -> [Duration; 2] {
    let setup = setup::setup("A").unwrap().with_queue_motions(queue);
    let config = RobotConfig {
        interpreter_quantum: Duration::ZERO,
        start_quantum: Duration::ZERO,
        skill_overhead: Duration::ZERO,
        ..RobotConfig::from_setup(&setup).unwrap()
    };
    let motions: Vec<Motion> = (0..1_200)
        .map(|index| {
            let angle = step * index as f32 / 60.0;
            Motion {
                kind: if index == 0 { MotionKind::PtpCartesian } else { kind },
                target: [150.0 + 60.0 * libm::cosf(angle), 60.0 * libm::sinf(angle), 100.0, 0.0, 0.0, 180.0],
                velocity: 5_000,
                acceleration: 5_000,
                approximation: if index == 0 { 0 } else { 50 },
                base: 1,
                ..Motion::EMPTY
            }
        })
        .collect();
    let mut fastest: Vec<(Duration, bool)> = Vec::new();
    for _ in 0..8 {
        let mut controller = Controller::new(config.clone(), Vec::new(), 1);
        let mut command = Command { control: Control::ENABLE | Control::RESET, ..Command::default() };
        let mut at = Instant::ZERO;
        controller.tick(at, Some(&command));
        (command.number, command.skill, command.total) = (1, Skill::MoveContinuous, motions.len() as u32);
        command.control = Control::ENABLE | Control::EXECUTE;
        let mut cycle = 0;
        while !controller.feedback().status.contains(Status::DONE) {
            let before = *controller.feedback();
            let free = if before.number != 1 {
                0
            } else if queue > 5 {
                before.accepted
            } else {
                before.executed
            };
            while command.written < command.total.min(free + 5) {
                command.set_slot(command.written, motions[command.written as usize]);
                command.written += 1;
            }
            at += config.cycle;
            let start = Clock::now();
            controller.tick(at, Some(&command));
            let took = start.elapsed();
            let after = controller.feedback();
            let taken = after.accepted - before.accepted;
            let counts =
                after.number == 1 && taken >= 1 && before.accepted - before.executed + 6 >= queue.min(128);
            match fastest.get_mut(cycle) {
                Some(known) => known.0 = known.0.min(took),
                None => fastest.push((took, counts && before.executed > 1)),
            }
            cycle += 1;
        }
    }
    let mut counted: Vec<Duration> =
        fastest.into_iter().filter(|(_, counts)| *counts).map(|(took, _)| took).collect();
    counted.sort_unstable();
    [counted[counted.len() / 2], *counted.last().unwrap()]
}
