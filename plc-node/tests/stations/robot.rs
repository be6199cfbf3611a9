//! A robot that takes as long for each motion as a test says, with whatever bus end it is given.

use machine::ethernet::Mac;
use machine::{Cycle, Duration, Instant, Machine, Source, StreamChange, StreamId, Transmit};
use planning::MarkSignal;
use protocol::fieldbus::{Fieldbus, LinkEvent};
use protocol::image::{
    Command, Control, ErrorNumber, Feedback, FeedbackSealer, IMAGE_LEN, Image, Motion, Order, Skill, State,
    Status,
};
use std::net::Ipv4Addr;

pub(crate) const CYCLE: Duration = Duration::from_millis(4);

/// What the robot does, without its bus.
#[derive(Debug)]
pub(crate) struct RobotScript {
    cycle: Cycle,
    /// Robot cycles that a motion takes.
    pub(crate) motion_cycles: u32,
    /// Number of motions of each stored program, from number 1.
    pub(crate) programs: Vec<u32>,
    /// Marks of the first program, each with the motions before it.
    pub(crate) meetings: Vec<(u32, MarkSignal)>,
    /// Marks that it has passed.
    met: usize,
    /// The motion of all at which it gives up with an error.
    pub(crate) error_at: Option<usize>,
    pub(crate) feedback: Feedback,
    seen: u16,
    total: u32,
    left: u32,
    /// Motions that it took from the slots.
    pub(crate) taken: Vec<Motion>,
    /// When it had executed each motion, and when it began the next one.
    pub(crate) begun: Vec<Instant>,
    pub(crate) executed: Vec<Instant>,
    /// Skills and programs that it began.
    pub(crate) skills: Vec<(Skill, u16)>,
    pub(crate) outputs: Vec<(Instant, u16)>,
    pub(crate) overrides: Vec<u8>,
    /// Halts of skills that were under way.
    pub(crate) halts: u32,
}

impl RobotScript {
    pub(crate) fn new(first: Instant) -> Self {
        Self {
            cycle: Cycle::new(first, CYCLE),
            motion_cycles: 5,
            programs: vec![4],
            meetings: Vec::new(),
            met: 0,
            error_at: None,
            feedback: Feedback::default(),
            seen: 0,
            total: 0,
            left: 0,
            taken: Vec::new(),
            begun: Vec::new(),
            executed: Vec::new(),
            skills: Vec::new(),
            outputs: Vec::new(),
            overrides: Vec::new(),
            halts: 0,
        }
    }

    /// Forgets what it has recorded.
    pub(crate) fn clear(&mut self) {
        self.taken.clear();
        self.begun.clear();
        self.executed.clear();
        self.skills.clear();
        self.outputs.clear();
    }

    pub(crate) const fn next(&self) -> Instant {
        self.cycle.next()
    }

    /// Runs the cycle that is due, if one is. Returns the image for the PLC.
    pub(crate) fn cycle(&mut self, now: Instant, order: Order, input: Option<Image>) -> Option<Image> {
        self.cycle.tick(now)?;
        self.feedback.life = self.feedback.life.wrapping_add(1);
        self.feedback.clock_ns = now.as_nanos();
        if let Some(command) = input.and_then(|image| order.parse_command(&image).ok()) {
            self.follow(now, &command);
        }
        let mut image = [0; IMAGE_LEN];
        order.emit_feedback(&self.feedback, &mut image);
        let mut sealer = FeedbackSealer::default();
        sealer.take_tail(&image);
        sealer.seal(order, &mut image);
        Some(image)
    }

    fn follow(&mut self, now: Instant, command: &Command) {
        self.feedback.life_echo = command.life;
        if self.outputs.last().map_or(0, |(_, outputs)| *outputs) != command.outputs {
            self.outputs.push((now, command.outputs));
        }
        if self.overrides.last() != Some(&command.override_percent) {
            self.overrides.push(command.override_percent);
        }
        self.feedback.override_percent = command.override_percent;
        if self.feedback.state == State::Running {
            self.go_on(now, command);
        } else {
            self.wait(now, command);
        }
    }

    fn wait(&mut self, now: Instant, command: &Command) {
        let control = command.control;
        self.feedback.status.set(Status::ENABLED, control.contains(Control::ENABLE));
        self.feedback.status.set(Status::AT_REST, true);
        if control.contains(Control::HALT) {
            self.feedback.state = State::Halted;
        } else if control.contains(Control::RESET | Control::ENABLE) {
            self.feedback.status.set(Status::ERROR, false);
            self.feedback.state = State::Ready;
        }
        let is_new = control.contains(Control::EXECUTE) && command.number != self.seen;
        if is_new && self.feedback.state == State::Ready {
            self.take_up(now, command);
        }
    }

    fn take_up(&mut self, now: Instant, command: &Command) {
        self.seen = command.number;
        self.skills.push((command.skill, command.program));
        self.total = match command.skill {
            Skill::RunProgram => self.programs[usize::from(command.program) - 1],
            _ => command.total,
        };
        (self.feedback.number, self.feedback.state) = (command.number, State::Running);
        self.feedback.status = Status::BUSY | Status::ENABLED;
        (self.feedback.accepted, self.feedback.executed, self.left) = (0, 0, 0);
        if command.skill == Skill::RunProgram {
            let own = self.meetings.iter().fold(0, |own, (_, signal)| own | signal.mask());
            self.feedback.inputs &= !own;
            self.met = 0;
        }
        self.accept(command);
        self.begin_motion(now, command);
    }

    fn accept(&mut self, command: &Command) {
        while self.feedback.accepted < command.written {
            self.taken.push(*command.slot(self.feedback.accepted));
            self.feedback.accepted += 1;
        }
    }

    /// Passes the marks at which it stands, if the others have come. Returns whether it still waits at one.
    fn waits_at_mark(&mut self, command: &Command) -> bool {
        if command.skill != Skill::RunProgram || self.left > 0 {
            return false;
        }
        while let Some((_, signal)) =
            self.meetings.get(self.met).filter(|(after, _)| *after == self.feedback.executed)
        {
            // It switches its output in one cycle, and looks at the inputs in the next one.
            let before = self.feedback.inputs;
            self.feedback.inputs = signal.applied_to(before);
            if before != self.feedback.inputs || !signal.is_met_by(command.outputs) {
                return true;
            }
            self.met += 1;
        }
        false
    }

    /// Begins the next motion, if it has it.
    fn begin_motion(&mut self, now: Instant, command: &Command) {
        if self.waits_at_mark(command) || self.feedback.executed == self.total {
            return;
        }
        let has_it = command.skill == Skill::RunProgram || self.feedback.accepted > self.feedback.executed;
        if self.left == 0 && has_it {
            self.left = self.motion_cycles;
            self.begun.push(now);
        }
    }

    fn go_on(&mut self, now: Instant, command: &Command) {
        if command.control.contains(Control::HALT) {
            self.halts += 1;
            self.left = 0;
            return self.end(Status::ABORTED, State::Halted);
        }
        self.accept(command);
        if self.feedback.executed == self.total && !self.waits_at_mark(command) {
            return self.end(Status::DONE, State::Ready);
        }
        self.begin_motion(now, command);
        if self.left == 0 || command.override_percent == 0 {
            return;
        }
        self.left -= 1;
        if self.left > 0 {
            return;
        }
        self.feedback.executed += 1;
        self.executed.push(now);
        if let (Some(motion), true) = (self.taken.last(), command.skill != Skill::RunProgram) {
            self.feedback.joints = motion.target;
        } else {
            self.feedback.joints[0] += 1.0;
        }
        if self.error_at == Some(self.executed.len()) {
            self.feedback.error = ErrorNumber::AxisLimit;
            self.feedback.error_motion = self.feedback.executed - 1;
            self.end(Status::ERROR, State::Halted);
        } else if self.feedback.executed == self.total && !self.waits_at_mark(command) {
            self.end(Status::DONE, State::Ready);
        } else {
            self.begin_motion(now, command);
        }
    }

    fn end(&mut self, status: Status, state: State) {
        self.feedback.status = status | Status::AT_REST | Status::ENABLED;
        self.feedback.state = state;
    }
}

/// The robot with a bus end of its own.
#[derive(Debug)]
pub(crate) struct Robot<B> {
    pub(crate) script: RobotScript,
    pub(crate) bus: B,
}

impl<B: Fieldbus> Machine for Robot<B> {
    type Event = LinkEvent;

    machine::forward_ports!(bus);

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.bus.handle_frame(now, from, frame);
    }

    fn handle_broadcast(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.bus.handle_broadcast(now, from, frame);
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        self.bus.handle_stream(now, stream, change);
    }

    fn handle_wrong_neighbour(&mut self, now: Instant, address: Ipv4Addr, found: Mac) {
        self.bus.handle_wrong_neighbour(now, address, found);
    }

    fn handle_timeout(&mut self, now: Instant) {
        if let Some(image) = self.script.cycle(now, self.bus.byte_order(), self.bus.input()) {
            self.bus.set_output(&image);
        }
        if self.bus.poll_timeout().is_some_and(|due| due <= now) {
            self.bus.handle_timeout(now);
        }
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.bus.poll_transmit(now, buf)
    }

    fn poll_event(&mut self) -> Option<LinkEvent> {
        self.bus.poll_event()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        Instant::earlier(self.bus.poll_timeout(), Some(self.script.next()))
    }
}
