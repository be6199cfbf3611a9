//! The feedback shows the pose of the present motion's tool in its base, however short the motion is.

use protocol::image::{ErrorNumber, Feedback, Motion, MotionKind, Skill};
use robot_node::RobotConfig;
use robot_node::arm::{Frame, Joints};

use crate::driven::{Driven, bare};

/// A robot with a second tool and a second base, so that a motion can change to them.
fn config(setup: &str) -> RobotConfig {
    let mut config = bare(setup);
    config.tools[2] = Some(Frame { position: [40.0, -25.0, 60.0], ..Frame::IDENTITY });
    config.bases[7] = Some(Frame { position: [-310.0, 140.0, 80.0], ..Frame::IDENTITY });
    config
}

/// The pose of a tool in a base when the joints are these.
fn pose(config: &RobotConfig, joints: &Joints, tool: u8, base: u8) -> [f32; 6] {
    let [tool, base] = [config.tools[usize::from(tool)], config.bases[usize::from(base)]];
    let in_base = base.unwrap_or(Frame::IDENTITY).inverse() * config.arm.forward(joints);
    (in_base * tool.unwrap_or(Frame::IDENTITY)).to_mm_deg().map(|coordinate| coordinate as f32)
}

/// Point to point to these joints, at full speed.
fn ptp(joints: &Joints, tool: u8, base: u8) -> Motion {
    Motion {
        kind: MotionKind::PtpJoint,
        target: joints.map(|joint| joint as f32),
        velocity: 10_000,
        acceleration: 10_000,
        tool,
        base,
        ..Motion::EMPTY
    }
}

/// The same place, given as a pose.
fn ptp_cartesian(config: &RobotConfig, joints: &Joints, tool: u8, base: u8) -> Motion {
    let target = pose(config, joints, tool, base);
    Motion { kind: MotionKind::PtpCartesian, target, ..ptp(joints, tool, base) }
}

/// A line of 0.002 mm from there, which takes less than a cycle.
fn short_line(config: &RobotConfig, joints: &Joints, tool: u8, base: u8) -> Motion {
    let mut target = pose(config, joints, tool, base);
    target[0] += 0.002;
    Motion {
        kind: MotionKind::LinCartesian,
        velocity: 2_500,
        acceleration: 5_000,
        target,
        ..ptp(joints, tool, base)
    }
}

#[track_caller]
fn assert_shows(config: &RobotConfig, feedback: &Feedback, joints: &Joints, motion: &Motion, what: &str) {
    let expected = pose(config, joints, motion.tool, motion.base);
    for (is, expected) in feedback.pose.iter().zip(expected).take(3) {
        assert!((is - expected).abs() < 0.01, "{what}: {:?} is not {expected:?}", feedback.pose);
    }
}

#[test]
fn a_motion_without_a_way_shows_its_own_tool_and_base_at_its_end() {
    for setup in ["A", "B", "D"] {
        let config = config(setup);
        // Where no arm is stretched out.
        let mut there = if setup == "D" { [0.0, -70.0, 80.0, -100.0, -90.0, 0.0] } else { config.home };
        there[0] += 12.0;
        let cases: Vec<(&str, Motion)> = [(2, 0), (0, 7), (2, 7)]
            .into_iter()
            .flat_map(|(tool, base)| {
                [
                    ("joints", ptp(&there, tool, base)),
                    ("a pose", ptp_cartesian(&config, &there, tool, base)),
                    ("a short line", short_line(&config, &there, tool, base)),
                ]
            })
            .collect();
        let (way, elsewhere) = (ptp(&there, 0, 0), ptp(&there, 2, 0));
        for (kind, last) in cases {
            let lists = [
                ("alone", vec![last]),
                ("last", vec![way, last]),
                ("after a change of the tool", vec![way, elsewhere, last]),
                ("after a blended motion", vec![Motion { approximation: 500, ..way }, last]),
            ];
            for (place, motions) in lists {
                for skill in [Skill::MoveContinuous, Skill::RunProgram, u8::from(last.kind).into()] {
                    let is_single = !matches!(skill, Skill::MoveContinuous | Skill::RunProgram);
                    if is_single && motions.len() > 1 {
                        continue;
                    }
                    let program = if skill == Skill::RunProgram { motions.clone() } else { Vec::new() };
                    let mut robot = Driven::ready(config.clone(), program.into());
                    robot.run(vec![way]);
                    robot.call(skill, motions.clone());
                    robot.wait_for_end();
                    let what = format!("{setup}, {kind}, {place}, {skill:?}");
                    assert!(robot.is_done(), "{what}: {:?}", robot.feedback());
                    assert_shows(&config, robot.feedback(), &there, &last, &what);
                }
            }
        }
    }
}

#[test]
fn a_motion_without_a_way_before_others_leaves_them_their_own_tool_and_base() {
    let config = config("B");
    let home = config.home;
    let mut there = home;
    there[0] += 12.0;
    let way = ptp(&there, 0, 7);
    let mut robot = Driven::ready(config.clone(), Vec::new().into());
    robot.run(vec![ptp(&home, 2, 0), way]);
    assert_shows(&config, robot.feedback(), &there, &way, "at the end of the second");
}

#[test]
fn a_line_that_only_changes_the_tool_is_refused_as_one_without_a_way() {
    let config = config("B");
    let mut robot = Driven::ready(config.clone(), Vec::new().into());
    let mut line = short_line(&config, &config.home, 2, 7);
    line.target = pose(&config, &config.home, 2, 7);
    robot.run(vec![line]);
    assert_eq!(robot.feedback().error, ErrorNumber::ZeroLength, "{:?}", robot.feedback());
}
