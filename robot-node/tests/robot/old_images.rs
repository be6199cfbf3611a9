//! Commands that are older than the last one are refused, and the PLC learns of it if there are no others.

use std::time::Duration;

use machine::wire::BigEndian;
use machine::{Instant, Machine, Port, Source};
use protocol::direct::Direct;
use protocol::fieldbus::{Fieldbus, LinkEvent};
use protocol::image::{Command, Control, ErrorNumber, Feedback, IMAGE_LEN, Skill, State, Status};
use robot_node::{ImageFault, RobotEvent, RobotNode};

use crate::plc;

/// A robot that gets a command every millisecond.
struct Robot {
    node: RobotNode<Direct>,
    now: Instant,
    events: Vec<RobotEvent>,
}

impl Robot {
    fn new() -> Self {
        let bus = Direct::new(Instant::ZERO, Duration::from_millis(1), Duration::from_millis(300));
        let programs = vec![(1, plc::application().into())];
        let node = RobotNode::new(plc::config(), programs, bus, 1, Instant::ZERO);
        Self { node, now: Instant::ZERO, events: Vec::new() }
    }

    /// A robot that is `Ready`, and the last command to it.
    fn ready() -> (Self, Command) {
        let mut robot = Self::new();
        let control = Control::ENABLE | Control::RESET;
        let mut command = Command { control, number: 14, program: 1, ..Command::default() };
        robot.get(&mut command, 40);
        assert_eq!(robot.feedback().state, State::Ready);
        command.control = Control::ENABLE;
        robot.get(&mut command, 3_000);
        (robot, command)
    }

    /// Sends this command for so long, with a life counter that counts.
    fn get(&mut self, command: &mut Command, ms: u64) {
        for _ in 0..ms {
            command.life = command.life.wrapping_add(1);
            self.get_once(command);
        }
    }

    fn get_once(&mut self, command: &Command) {
        let mut image = [0; IMAGE_LEN];
        command.emit::<BigEndian>(&mut image);
        self.now += Duration::from_millis(1);
        self.node.handle_frame(self.now, Source { port: Port::Ethernet, peer: None }, &image);
        self.wait();
    }

    fn wait(&mut self) {
        self.node.handle_timeout(self.now);
        self.events.extend(core::iter::from_fn(|| self.node.poll_event()));
        let mut sent = [0; 1_500];
        while self.node.poll_transmit(self.now, &mut sent).is_some() {}
    }

    fn feedback(&self) -> &Feedback {
        self.node.controller().feedback()
    }

    fn refusals(&self) -> Vec<(ImageFault, bool)> {
        self.events
            .iter()
            .filter_map(|event| match event {
                RobotEvent::ImagesRefused { fault, is_refused } => Some((*fault, *is_refused)),
                _ => None,
            })
            .collect()
    }
}

/// The command that ran a program so many images before.
fn old(command: &Command, images: u16) -> Command {
    let control = Control::ENABLE | Control::EXECUTE;
    Command { control, skill: Skill::RunProgram, number: 13, life: command.life - images, ..*command }
}

#[test]
fn an_old_command_starts_no_skill_whenever_it_arrives() {
    for images in [5, 20, 300, 2_046, 2_900] {
        let (mut robot, mut command) = Robot::ready();
        for phase in 0..8 {
            robot.get(&mut command, 9 + phase);
            // The robot reads every fourth image: it must see it.
            (0..5).for_each(|_| robot.get_once(&old(&command, images)));
            command.life += 5;
            robot.get(&mut command, 40);
            assert_eq!((robot.feedback().state, robot.feedback().error), (State::Ready, ErrorNumber::None));
        }
        assert_eq!(robot.node.checks().outdated, 8, "each counts once, however often it is read");
        assert_eq!(robot.refusals(), []);
    }
}

#[test]
fn nothing_but_old_commands_ends_the_skill_and_warns_until_they_are_accepted_for_a_second() {
    let (mut robot, mut command) = Robot::ready();
    command.number += 1;
    (command.control, command.skill) = (Control::ENABLE | Control::EXECUTE, Skill::RunProgram);
    robot.get(&mut command, 300);
    assert_eq!(robot.feedback().state, State::Running);
    let mut behind = old(&command, 2_000);
    robot.get(&mut behind, 90);
    assert_eq!(robot.feedback().state, State::Running, "a fault that passes");
    command.life += 90;
    robot.get(&mut command, 20);
    assert_eq!(robot.feedback().state, State::Running);

    // These set a new start once the connection counts as lost. Their number is then an old one.
    let mut behind = old(&command, 2_000);
    robot.get(&mut behind, 1_500);
    assert_eq!(
        (robot.feedback().state, robot.feedback().error),
        (State::Halted, ErrorNumber::ConnectionLost)
    );
    assert_eq!(robot.refusals(), [(ImageFault::Outdated, true), (ImageFault::Outdated, false)]);
    behind.control = Control::ENABLE | Control::RESET;
    robot.get(&mut behind, 40);
    assert_eq!((robot.feedback().state, robot.feedback().error), (State::Ready, ErrorNumber::None));
}

#[test]
fn a_plc_that_counts_too_fast_reads_what_is_wrong_and_floods_no_log() {
    let (mut robot, mut command) = Robot::ready();
    robot.events.clear();
    for _ in 0..3_000 {
        command.life = command.life.wrapping_add(8);
        // A PLC resets the robot whenever it is `Halted`.
        let is_halted = robot.feedback().state == State::Halted;
        command.control = Control::ENABLE | if is_halted { Control::RESET } else { Control::default() };
        robot.get_once(&command);
    }
    assert_eq!(robot.refusals(), [(ImageFault::Outdated, true)]);
    let feedback = robot.feedback();
    assert_eq!(feedback.error, ErrorNumber::WrongLifeCounter);
    assert!(feedback.status.contains(Status::WARNING));
}

#[test]
fn a_counter_that_never_moves_is_named_once_for_each_connection_and_its_commands_are_followed() {
    let mut robot = Robot::new();
    let command = Command { control: Control::ENABLE | Control::RESET, life: 7, ..Command::default() };
    let named = |robot: &Robot| robot.events.iter().filter(|event| **event == RobotEvent::LifeStill).count();
    (0..3_000).for_each(|_| robot.get_once(&command));
    assert_eq!((named(&robot), robot.feedback().state), (1, State::Ready));
    for _ in 0..400 {
        robot.now += Duration::from_millis(1);
        robot.wait();
    }
    (0..3_000).for_each(|_| robot.get_once(&command));
    assert_eq!((named(&robot), robot.node.checks().outdated), (2, 0));
}

#[test]
fn a_connection_that_ends_and_begins_again_within_one_robot_cycle_ends_the_skill() {
    let (mut robot, mut command) = Robot::ready();
    command.number += 1;
    (command.control, command.skill) = (Control::ENABLE | Control::EXECUTE, Skill::RunProgram);
    robot.get(&mut command, 300);
    // Just after a robot cycle, so that the next image comes before the next cycle.
    while robot.node.ticked_at() != robot.now {
        robot.get(&mut command, 1);
    }
    robot.events.clear();
    robot.node.bus_mut().disconnect(robot.now);
    robot.wait();
    robot.get(&mut command, 500);
    let links: Vec<_> = robot.events.iter().filter(|event| matches!(event, RobotEvent::Link(_))).collect();
    assert!(matches!(links[..], [RobotEvent::Link(LinkEvent::Down(_)), RobotEvent::Link(LinkEvent::Up)]));
    assert_eq!(robot.feedback().error, ErrorNumber::ConnectionLost);
}
