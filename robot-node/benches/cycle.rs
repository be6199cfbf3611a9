//! The robot's cycle, over a connection without a bus protocol.

#![expect(clippy::unwrap_used, reason = "a benchmark ends by panicking")]

use machine::wire::FRAME_CAPACITY;
use machine::{Duration, Instant, Machine as _};
use planning::PROGRAM;
use protocol::direct::Direct;
use robot_node::{RobotConfig, RobotNode};

const CYCLES: u32 = 10;

fn main() {
    hot_path::main(|paths| {
        for (arm, setup) in [("SCARA", "A"), ("six axes", "B")] {
            let name = format!("{CYCLES} cycles at rest, {arm}");
            paths.add(
                "robot",
                name,
                move || robot(setup),
                |mut robot: RobotNode<Direct>| {
                    let mut buf = [0; FRAME_CAPACITY];
                    let end = Instant::ZERO + Duration::from_millis(4) * CYCLES;
                    while let Some(now) = robot.poll_timeout().filter(|due| *due < end) {
                        robot.handle_timeout(now);
                        while robot.poll_transmit(now, &mut buf).is_some() {}
                        while robot.poll_event().is_some() {}
                    }
                    robot
                },
            );
        }
    });
}

fn robot(setup: &str) -> RobotNode<Direct> {
    let (setup, application) = planning::setup_with_application(setup).unwrap();
    let motions = application.plan(&setup).unwrap().wire_motions(&setup);
    let cycle = Duration::from_millis(1);
    let bus = Direct::new(Instant::ZERO, cycle, cycle * 20);
    let config = RobotConfig::from_setup(&setup).unwrap();
    RobotNode::new(config, vec![(PROGRAM, motions.into())], bus, 1, Instant::ZERO)
}
