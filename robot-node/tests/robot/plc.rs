//! A PLC that a test tells what to write, and a robot, on a cable without a protocol, in virtual time.

use std::time::Duration;

use machine::wire::BigEndian;
use machine::{Cycle, Instant, Machine, PortRequest, Source, Transmit};
use protocol::direct::Direct;
use protocol::fieldbus::Fieldbus;
use protocol::image::{
    Command, Control, Feedback, IMAGE_LEN, Motion, MotionKind, SLOTS, Skill, State, Status,
};
use robot_node::{RobotConfig, RobotEvent, RobotNode};
use virtual_time::{Clock, Event, Impairment, Pair, PairConfig};

/// Writes the command image every millisecond, and keeps the slots filled from a list.
pub(crate) struct Plc {
    bus: Direct,
    scan: Cycle,
    pub(crate) command: Command,
    pub(crate) feedback: Feedback,
    pub(crate) motions: Vec<Motion>,
    /// Motions that it keeps back for now.
    pub(crate) keep_back: usize,
    /// Whether its program stands still, while its bus sends on.
    pub(crate) stands: bool,
}

impl Plc {
    fn new() -> Self {
        let bus = Direct::new(Instant::from_micros(300), Duration::from_millis(1), Duration::from_millis(20));
        let scan = Cycle::new(Instant::from_micros(100), Duration::from_millis(1));
        Self {
            bus,
            scan,
            command: Command::default(),
            feedback: Feedback::default(),
            motions: Vec::new(),
            keep_back: 0,
            stands: false,
        }
    }

    fn scan(&mut self) {
        if let Some(image) = self.bus.input() {
            self.feedback = Feedback::parse::<BigEndian>(&image).unwrap();
        }
        self.write_motions();
        self.command.life = self.command.life.wrapping_add(1);
        let mut image = [0; IMAGE_LEN];
        self.command.emit::<BigEndian>(&mut image);
        self.bus.set_output(&image);
    }

    /// The paper's update logic: as soon as a motion is executed, the next one goes into its slot.
    fn write_motions(&mut self) {
        let executed = if self.feedback.number == self.command.number { self.feedback.executed } else { 0 };
        let there = self.motions.len() - self.keep_back;
        while (self.command.written as usize) < there.min(executed as usize + SLOTS) {
            let index = self.command.written;
            self.command.set_slot(index, self.motions[index as usize]);
            self.command.written += 1;
        }
    }
}

impl Machine for Plc {
    type Event = ();

    fn ports(&self) -> &[PortRequest] {
        self.bus.ports()
    }
    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.bus.handle_frame(now, from, frame);
    }
    fn handle_timeout(&mut self, now: Instant) {
        if self.scan.tick(now).is_some() && !self.stands {
            self.scan();
        }
        if self.bus.poll_timeout().is_some_and(|due| due <= now) {
            self.bus.handle_timeout(now);
        }
    }
    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.bus.poll_transmit(now, buf)
    }
    fn poll_event(&mut self) -> Option<()> {
        self.bus.poll_event().map(|_| ())
    }
    fn poll_timeout(&self) -> Option<Instant> {
        self.bus.poll_timeout().map(|bus| bus.min(self.scan.next()))
    }
}

/// PLC and robot.
pub(crate) struct Cell {
    pub(crate) pair: Pair<Plc, RobotNode<Direct>>,
    pub(crate) events: Vec<(Instant, RobotEvent)>,
}

impl Cell {
    /// Setup A with a program 1.
    pub(crate) fn new(program: Vec<Motion>) -> Self {
        Self::with(config(), program, 1)
    }

    pub(crate) fn with(config: RobotConfig, program: Vec<Motion>, seed: u64) -> Self {
        let bus = Direct::new(Instant::from_micros(700), Duration::from_millis(1), Duration::from_millis(20));
        let robot = RobotNode::new(config, vec![(1, program.into())], bus, seed, Instant::from_micros(2_200));
        let link = Impairment { delay: Duration::from_micros(25), ..Impairment::default() };
        let pair = PairConfig { seed, clocks: [Clock::default(); 2], links: [link; 2], addresses: [None; 2] };
        let mut cell = Self { pair: Pair::new(Plc::new(), robot, pair), events: Vec::new() };
        cell.run_ms(20);
        cell
    }

    /// A cell whose robot is `Ready`.
    pub(crate) fn ready(program: Vec<Motion>) -> Self {
        let mut cell = Self::new(program);
        cell.control(Control::ENABLE | Control::RESET);
        cell.run_ms(20);
        assert_eq!(cell.feedback().state, State::Ready);
        cell.control(Control::ENABLE);
        cell
    }

    pub(crate) fn control(&mut self, control: Control) {
        self.command(|command| command.control = control);
    }

    pub(crate) fn command(&mut self, change: impl FnOnce(&mut Command)) {
        self.pair.command_a(|plc, _| change(&mut plc.command));
    }

    /// Calls a skill with a new command number.
    pub(crate) fn call(&mut self, skill: Skill, motions: Vec<Motion>) {
        self.call_keeping_back(skill, motions, 0);
    }

    /// Calls a skill, but writes the last motions only when [`Plc::keep_back`] is taken back.
    pub(crate) fn call_keeping_back(&mut self, skill: Skill, motions: Vec<Motion>, keep_back: usize) {
        self.pair.command_a(|plc, _| {
            let number = plc.command.number + 1;
            plc.command = Command {
                control: Control::ENABLE | Control::EXECUTE,
                life: plc.command.life,
                number,
                skill,
                program: 1,
                total: motions.len() as u32,
                override_percent: plc.command.override_percent,
                ..Command::default()
            };
            (plc.motions, plc.keep_back) = (motions, keep_back);
        });
    }

    pub(crate) fn run_ms(&mut self, ms: u64) {
        let until = self.pair.now() + Duration::from_millis(ms);
        self.run_until(until, |_| false);
    }

    /// Runs until `condition` holds for the feedback that the PLC has, at most 20 s.
    #[track_caller]
    pub(crate) fn wait(&mut self, condition: impl Fn(&Feedback) -> bool) {
        let until = self.pair.now() + Duration::from_secs(20);
        assert!(self.run_until(until, condition), "waited in vain: {:?}", self.feedback());
    }

    #[track_caller]
    pub(crate) fn wait_for_end(&mut self) {
        let number = self.pair.a().command.number;
        self.wait(|feedback| {
            let ended = Status::DONE.0 | Status::ABORTED.0 | Status::ERROR.0;
            feedback.number == number && feedback.status.0 & ended != 0
        });
    }

    fn run_until(&mut self, until: Instant, condition: impl Fn(&Feedback) -> bool) -> bool {
        while self.pair.now() < until {
            let next = self.pair.now() + Duration::from_millis(1);
            while let Some(event) = self.pair.next_event(next) {
                if let Event::B(event) = event {
                    self.events.push((self.pair.now(), event));
                }
            }
            if condition(self.feedback()) {
                return true;
            }
        }
        false
    }

    pub(crate) fn feedback(&self) -> &Feedback {
        &self.pair.a().feedback
    }

    pub(crate) fn robot(&self) -> &RobotNode<Direct> {
        self.pair.b()
    }

    /// How many events fit.
    pub(crate) fn count(&self, is: impl Fn(&RobotEvent) -> bool) -> usize {
        self.events.iter().filter(|(_, event)| is(event)).count()
    }
}

/// Setup A as it is shipped.
pub(crate) fn shipped_config() -> RobotConfig {
    RobotConfig::from_setup(&setup::setup("A").unwrap()).unwrap()
}

/// Setup A, but with a controller that costs what these tests count on, however the setup is calibrated.
pub(crate) fn config() -> RobotConfig {
    let (quantum, overhead) = (Duration::from_millis(12), Duration::from_millis(140));
    RobotConfig { interpreter_quantum: quantum, skill_overhead: overhead, ..shipped_config() }
}

/// The shipped application on Setup A.
pub(crate) fn application() -> Vec<Motion> {
    let (setup, application) = planning::setup_with_application("A").unwrap();
    application.plan(&setup).unwrap().wire_motions(&setup)
}

/// A line in base 1 with the tool down: 250 mm/s, 5 m/s², blending by `approximation_mm`.
pub(crate) fn lin(x: f32, y: f32, z: f32, approximation_mm: u16) -> Motion {
    Motion {
        kind: MotionKind::LinCartesian,
        target: [x, y, z, 0.0, 0.0, 180.0],
        velocity: 2_500,
        acceleration: 5_000,
        approximation: approximation_mm * 100,
        base: 1,
        ..Motion::EMPTY
    }
}

/// Point to point in base 1 with the tool down: 25 % of the axis speeds.
pub(crate) fn ptp(x: f32, y: f32, z: f32, approximation_mm: u16) -> Motion {
    Motion {
        kind: MotionKind::PtpCartesian,
        velocity: 2_500,
        acceleration: 10_000,
        ..lin(x, y, z, approximation_mm)
    }
}
