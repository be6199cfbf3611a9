//! Commands whose bytes were altered on the way are refused, and the PLC learns of it.

use std::time::Duration;

use machine::wire::BigEndian;
use machine::{Instant, Machine, Port, Source};
use protocol::direct::Direct;
use protocol::fieldbus::LinkEvent;
use protocol::image::{
    Command, CommandSealer, Control, ErrorNumber, Feedback, FeedbackChecker, IMAGE_LEN, Image, Order, State,
    Status, Verdict,
};
use robot_node::{ImageFault, RobotEvent, RobotNode};

use crate::plc;

/// A robot that gets an image every millisecond.
struct Robot {
    node: RobotNode<Direct>,
    now: Instant,
    /// What it reported of the PLC's images and of the connection.
    reports: Vec<RobotEvent>,
}

impl Robot {
    fn new() -> Self {
        let bus = Direct::new(Instant::ZERO, Duration::from_millis(1), Duration::from_millis(300));
        let programs = vec![(1, plc::application().into())];
        let node = RobotNode::new(plc::config(), programs, bus, 1, Instant::ZERO);
        Self { node, now: Instant::ZERO, reports: Vec::new() }
    }

    /// Sends this image for so long, and returns the robot's last one.
    fn get(&mut self, image: &Image, ms: u64) -> Feedback {
        self.get_or_wait(Some(image), ms)
    }

    /// The same, or sends nothing for so long.
    fn get_or_wait(&mut self, image: Option<&Image>, ms: u64) -> Feedback {
        let mut sent = [0; 1_500];
        let (mut feedback, mut checker) = (Feedback::default(), FeedbackChecker::default());
        for _ in 0..ms {
            self.now += Duration::from_millis(1);
            if let Some(image) = image {
                self.node.handle_frame(self.now, Source { port: Port::Ethernet, peer: None }, image);
            }
            self.node.handle_timeout(self.now);
            while let Some(event) = self.node.poll_event() {
                if matches!(event, RobotEvent::ImagesRefused { .. } | RobotEvent::Link(_)) {
                    self.reports.push(event);
                }
            }
            while self.node.poll_transmit(self.now, &mut sent).is_some() {
                let image = sent[..IMAGE_LEN].try_into().unwrap();
                assert_eq!(checker.verify(Order::BigEndian, &image), Verdict::Intact);
                feedback = Feedback::parse::<BigEndian>(&image).unwrap();
            }
        }
        feedback
    }
}

fn sealed(command: &Command) -> Image {
    let mut image = [0; IMAGE_LEN];
    command.emit::<BigEndian>(&mut image);
    let mut sealer = CommandSealer::default();
    sealer.take_tail(&image);
    sealer.seal(Order::BigEndian, &mut image);
    image
}

fn flipped(mut image: Image, byte: usize) -> Image {
    image[byte] ^= 0x10;
    image
}

#[test]
fn an_altered_command_is_refused_wherever_its_byte_was_altered_and_the_one_before_stands() {
    let command = Command { control: Control::ENABLE, life: 7, ..Command::default() };
    let (good, later) = (sealed(&command), sealed(&Command { life: 8, ..command }));
    for byte in 0..IMAGE_LEN {
        let mut robot = Robot::new();
        assert_eq!(robot.get(&good, 20).life_echo, 7);
        assert_eq!(robot.get(&flipped(later, byte), 20).life_echo, 7, "byte {byte}");
        assert_eq!(robot.get(&later, 20).life_echo, 8);
        assert_eq!(robot.node.checks().unchecked, 0);
    }
}

#[test]
fn nothing_but_altered_commands_ends_the_skill_and_warns_until_a_good_one_comes() {
    let mut robot = Robot::new();
    let ready = Command { control: Control::ENABLE | Control::RESET, life: 7, ..Command::default() };
    assert_eq!(robot.get(&sealed(&ready), 20).state, State::Ready);
    let skill = Command {
        control: Control::ENABLE | Control::EXECUTE,
        number: 1,
        skill: protocol::image::Skill::RunProgram,
        program: 1,
        ..ready
    };
    let good = sealed(&skill);
    assert_eq!(robot.get(&good, 300).state, State::Running);
    assert_eq!(robot.get(&flipped(good, 40), 90).state, State::Running, "a fault that passes");
    assert_eq!(robot.get(&good, 20).state, State::Running);

    let feedback = robot.get(&flipped(good, 40), 1_500);
    assert_eq!((feedback.state, feedback.error), (State::Halted, ErrorNumber::ConnectionLost));
    let idle = sealed(&Command { control: Control::ENABLE | Control::RESET, ..skill });
    assert_eq!(robot.get(&idle, 20).error, ErrorNumber::None);

    let feedback = robot.get(&flipped(idle, 40), 200);
    assert_eq!(feedback.error, ErrorNumber::WrongCheck);
    assert!(feedback.status.contains(Status::WARNING) && !feedback.status.contains(Status::ENABLED));
    let feedback = robot.get(&idle, 20);
    assert!(feedback.error == ErrorNumber::None && !feedback.status.contains(Status::WARNING));
}

#[test]
fn the_end_of_a_connection_is_not_reported_as_a_recovery_and_the_next_good_image_is() {
    let idle = Command { control: Control::ENABLE, life: 7, ..Command::default() };
    let (good, refused) =
        (sealed(&idle), |is_refused| RobotEvent::ImagesRefused { fault: ImageFault::Altered, is_refused });
    let mut robot = Robot::new();
    robot.get(&good, 20);
    robot.get(&flipped(good, 40), 200);
    let feedback = robot.get_or_wait(None, 400);
    assert_eq!(feedback.error, ErrorNumber::None, "a connection that has ended refuses nothing");
    let [RobotEvent::Link(LinkEvent::Up), is_refused, RobotEvent::Link(LinkEvent::Down(_))] =
        robot.reports[..]
    else {
        panic!("{:?}", robot.reports)
    };
    assert_eq!(is_refused, refused(true));
    robot.reports.clear();
    // The next connection begins with altered images: the first report still holds.
    robot.get(&flipped(good, 40), 200);
    assert_eq!(robot.reports, [RobotEvent::Link(LinkEvent::Up)]);
    robot.get(&good, 20);
    assert_eq!(robot.reports[1..], [refused(false)]);
}
