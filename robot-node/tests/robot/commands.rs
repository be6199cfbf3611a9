//! Whatever the PLC writes, the robot answers it, and a halt and a reset lead back to `Ready`.

use std::time::Duration;

use machine::wire::BigEndian;
use machine::{Instant, Machine, Port, Source};
use proptest::prelude::*;
use protocol::image::{Command, Control, IMAGE_LEN, SLOTS, State};
use robot_node::RobotNode;

use crate::plc;

/// A command that may start something: of all bit patterns hardly any would.
fn likely_command() -> impl Strategy<Value = Command> {
    let skill = prop_oneof![Just(1_u8), Just(2), Just(16), Just(17), any::<u8>()];
    let counts = (0..4_u32, 0..8_u32, 0..4_u32);
    (0..128_u16, 0..4_u16, skill, 0..120_u8, counts).prop_map(
        |(control, number, skill, override_percent, (program, written, more))| {
            let mut command = Command {
                control: Control(control | Control::ENABLE.0),
                number,
                skill: skill.into(),
                override_percent,
                total: written + more,
                written,
                program: program as u16,
                ..Command::default()
            };
            for index in 0..SLOTS as u32 {
                let x = 40.0 * index as f32;
                let motion =
                    if skill == 2 { plc::ptp(x, 0.0, 100.0, 10) } else { plc::lin(x, 0.0, 100.0, 10) };
                command.set_slot(index, motion);
            }
            command
        },
    )
}

fn image() -> impl Strategy<Value = Vec<u8>> {
    let likely = likely_command().prop_map(|command| {
        let mut image = [0; IMAGE_LEN];
        command.emit::<BigEndian>(&mut image);
        image.to_vec()
    });
    prop_oneof![9 => likely, 1 => proptest::collection::vec(any::<u8>(), IMAGE_LEN)]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_order_of_commands_keeps_a_halt_and_a_reset_from_leading_to_ready(
        images in proptest::collection::vec((image(), 1..400_u64), 1..12),
    ) {
        let bus = protocol::direct::Direct::new(Instant::ZERO, Duration::from_millis(1), Duration::from_millis(300));
        let mut robot = RobotNode::new(plc::config(), vec![(1, plc::application().into())], bus, 1, Instant::ZERO);
        let mut now = Instant::ZERO;
        let mut run = |image: &[u8], ms: u64| {
            for _ in 0..ms {
                now += Duration::from_millis(1);
                robot.handle_frame(now, Source { port: Port::Ethernet, peer: None }, image);
                robot.handle_timeout(now);
                while robot.poll_event().is_some() {}
            }
            robot.sample().state
        };
        for (image, ms) in images {
            run(&image, ms);
        }
        let mut image = [0; IMAGE_LEN];
        let command = Command { control: Control::ENABLE | Control::HALT, ..Command::default() };
        command.emit::<BigEndian>(&mut image);
        prop_assert_eq!(run(&image, 1_000), State::Halted);
        let command = Command { control: Control::ENABLE | Control::RESET, ..Command::default() };
        command.emit::<BigEndian>(&mut image);
        prop_assert_eq!(run(&image, 20), State::Ready);
    }
}
