//! The PLC as a machine: scan, bus, readiness, runs.

use core::net::Ipv4Addr;
use std::collections::VecDeque;

use machine::{
    Instant, Lateness, Machine, Port, PortRequest, Source, StreamChange, StreamId, StreamRequest, Transmit,
};
use planning::Stop;
use protocol::fieldbus::{Counters, Fieldbus, LinkEvent};
use protocol::image::{Control, Digest, ErrorNumber, Feedback, IMAGE_LEN, Image, Skill, State, Status};

use crate::function_blocks::BlockError;
use crate::motion_source::Digested;
use crate::readiness::Readiness;
use crate::sequence::{Progress, Sequence};
use crate::start_position::StartPosition;
use crate::{
    AxesGroup, Execution, ExecutionType, Failure, FailureCause, MotionSource, Override, OverrideSchedule,
    PlcConfig, PlcEvent, Scan, StartError,
};

/// More events than one handler can bring about; the owner drains them after each.
const EVENTS: usize = 16;

/// A PLC with one robot on one bus.
///
/// While connected it keeps the robot enabled and leads it to `Ready` by itself: it halts a skill that is not one of
/// its own (left over from a failed run, or from before a restart of the PLC), resets the robot, and moves the arm to
/// where a run starts.
#[derive(Debug)]
pub struct PlcNode<B> {
    bus: B,
    scan: Scan,
    scans: u64,
    group: AxesGroup,
    program: u16,
    queue_depth: u32,
    motions: Digested,
    stops: Vec<Stop>,
    start_position: StartPosition,
    /// The arm could not be moved to the start the last time.
    start_not_reached: bool,
    connected: bool,
    mode: Mode,
    readiness: Readiness,
    run: Run,
    /// What becomes of the override in the runs that start from now on; none leaves it as it is.
    overrides: Option<OverrideSchedule>,
    /// The image that the group's feedback was read from: a robot that is slower than the scan repeats it.
    inputs: Image,
    /// The outputs that the last scan computed; on the bus once the scan's cost has passed.
    outputs: Image,
    /// Command number and motions written as of the slots in `outputs`.
    emitted: Option<(u16, u32)>,
    events: VecDeque<PlcEvent>,
}

/// What the program does in a scan.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Mode {
    /// Leads the robot to `Ready`, if there is a robot.
    Preparing,
    /// Moves the arm to where a run starts; the run that is wanted follows.
    MovingToStart(Option<ExecutionType>),
    /// The robot is ready, and the arm where a run starts, as far as it could be moved there.
    Idle,
    /// The next scan sets the start edge.
    Starting(ExecutionType),
    /// A run is under way.
    Running,
}

/// The run under way, or the last one.
#[derive(Debug)]
struct Run {
    sequence: Sequence,
    overrides: Option<OverrideSchedule>,
    /// Steps of them that are done.
    overridden: usize,
    started_at: Instant,
    started_in_scan: u64,
    frames_before: Counters,
}

/// What goes over the image at an instant, for traces.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Sample {
    /// Scans since the node started.
    pub scans: u64,
    /// Number of the last command.
    pub number: u16,
    /// Skill of the last command.
    pub skill: Skill,
    /// What the PLC wants.
    pub control: Control,
    /// Motions of the skill in all: `totalNo`.
    pub total: u32,
    /// Motions written into the slots so far.
    pub written: u32,
    /// The override, in %.
    pub override_percent: u8,
    /// Motions in the slots that the robot has not executed yet, 0..=5.
    pub queue_fill: u32,
    /// The robot's image of the last scan; none without a connection.
    pub feedback: Option<Feedback>,
}

impl<B: Fieldbus> PlcNode<B> {
    /// A PLC whose first scan is at `start`.
    #[must_use]
    pub fn new(config: PlcConfig, bus: B, start: Instant) -> Self {
        let patience = config.patience();
        Self {
            bus,
            scan: Scan::new(start, config.scan_cycle, config.scan_cost),
            scans: 0,
            group: AxesGroup::new(patience),
            program: config.program,
            queue_depth: config.queue_depth,
            motions: Digested::new(config.motions),
            stops: config.stops,
            start_position: StartPosition::new(config.to_start),
            start_not_reached: false,
            connected: false,
            mode: Mode::Preparing,
            readiness: Readiness::default(),
            run: Run {
                sequence: Sequence::new(ExecutionType::Rc, config.program, config.queue_depth),
                overrides: None,
                overridden: 0,
                started_at: start,
                started_in_scan: 0,
                frames_before: Counters::default(),
            },
            overrides: None,
            inputs: [0; IMAGE_LEN],
            outputs: [0; IMAGE_LEN],
            emitted: None,
            events: VecDeque::with_capacity(EVENTS),
        }
    }

    /// Has the next scan set the start edge of a run, or move the arm to where the run starts if it is not there; the start
    /// edge then follows.
    ///
    /// # Errors
    /// The robot is not connected or not ready, a run is under way, or there is nothing to run.
    pub fn start(&mut self, _now: Instant, execution_type: ExecutionType) -> Result<(), StartError> {
        match self.mode {
            Mode::Running => return Err(StartError::Running(self.run.sequence.execution_type())),
            Mode::Starting(other) | Mode::MovingToStart(Some(other)) => {
                return Err(StartError::Running(other));
            }
            _ if !self.connected => return Err(StartError::NotConnected),
            Mode::Preparing => return Err(self.not_ready()),
            Mode::Idle | Mode::MovingToStart(None) => {}
        }
        if execution_type != ExecutionType::Rc && self.motions.total() == 0 {
            return Err(StartError::NoMotions(execution_type));
        }
        self.mode = match self.mode {
            Mode::MovingToStart(_) => Mode::MovingToStart(Some(execution_type)),
            _ => Mode::Starting(execution_type),
        };
        Ok(())
    }

    /// Sets the override from the next scan on, whether a run is under way or not. It stays until it is set again, or until
    /// the next step of a run's schedule.
    pub const fn set_override(&mut self, _now: Instant, to: Override) {
        self.group.set_override(to);
    }

    /// Has every run that starts from now on change the override by this schedule; without one the override stays.
    pub const fn schedule_overrides(&mut self, schedule: Option<OverrideSchedule>) {
        self.overrides = schedule;
    }

    /// Gives the run up: it fails at once, and the next scan halts the robot. Does nothing without a run.
    pub fn abort(&mut self, _now: Instant) {
        self.fail(FailureCause::Aborted);
    }

    /// Gives a run up and ends the connection.
    pub fn disconnect(&mut self, now: Instant) {
        self.fail(FailureCause::Aborted);
        self.bus.disconnect(now);
        self.drain_bus();
        self.disarm();
    }

    /// Whether a run may start.
    #[must_use]
    pub fn is_ready(&self) -> bool {
        self.mode == Mode::Idle
    }

    /// How late scans started.
    #[must_use]
    pub const fn lateness(&self) -> &Lateness {
        self.scan.lateness()
    }

    /// The motions that this run, or the last one, took from their source, in that order: with SM and CM those that it
    /// sent. RC takes none.
    #[must_use]
    pub const fn sent(&self) -> &Digest {
        self.motions.given()
    }

    /// The bus endpoint.
    #[must_use]
    pub const fn bus(&self) -> &B {
        &self.bus
    }

    /// The bus endpoint, for commands of its own; poll the node afterwards.
    pub const fn bus_mut(&mut self) -> &mut B {
        &mut self.bus
    }

    /// What goes over the image as of the last scan.
    #[must_use]
    pub fn sample(&self) -> Sample {
        let command = self.group.command();
        let feedback = self.group.feedback().copied();
        let executed = feedback.filter(|feedback| feedback.number == command.number);
        let executed = executed.map_or(0, |feedback| feedback.executed);
        Sample {
            scans: self.scans,
            number: command.number,
            skill: command.skill,
            control: command.control,
            total: command.total,
            written: command.written,
            override_percent: command.override_percent,
            queue_fill: command.written.saturating_sub(executed),
            feedback,
        }
    }

    /// One scan: inputs, program, outputs.
    fn scan(&mut self, now: Instant) {
        self.scans += 1;
        self.read_inputs();
        if let Some(cause) = self.trouble() {
            self.fail(cause);
        }
        match self.mode {
            Mode::Starting(execution_type) if self.is_at_start() => self.begin_run(now, execution_type),
            Mode::Starting(execution_type) => self.move_to_start(false, Some(execution_type)),
            Mode::Running => self.run(now),
            Mode::MovingToStart(_) | Mode::Idle | Mode::Preparing => {}
        }
        if let Mode::MovingToStart(then) = self.mode {
            self.go_on_to_start(now, then);
        }
        // A run that has just failed is followed by the halt in the same scan.
        if matches!(self.mode, Mode::Idle | Mode::Preparing) {
            self.prepare();
        }
        self.emit();
    }

    /// Takes over the robot's image; none without a connection.
    fn read_inputs(&mut self) {
        match self.bus.input().filter(|_| self.connected) {
            Some(image) if self.inputs == image && self.group.feedback().is_some() => {
                self.group.read_again();
            }
            Some(image) => {
                self.inputs = image;
                self.group.read(Feedback::parse::<B::Order>(&image).ok());
            }
            None => self.group.read(None),
        }
    }

    /// The slots take most of the time, and they change only with a new command or with motions written.
    fn emit(&mut self) {
        let command = self.group.command();
        let slots = Some((command.number, command.written));
        if core::mem::replace(&mut self.emitted, slots) == slots {
            command.emit_head::<B::Order>(&mut self.outputs);
        } else {
            command.emit::<B::Order>(&mut self.outputs);
        }
    }

    /// What makes every run impossible, whatever its blocks find.
    fn trouble(&self) -> Option<FailureCause> {
        if self.group.feedback().is_none() {
            return Some(FailureCause::NoImage);
        }
        self.group.is_silent().then(|| FailureCause::RobotSilent { scans: self.group.still_scans() })
    }

    fn is_at_start(&self) -> bool {
        self.start_position.is_reached(self.group.feedback())
    }

    fn move_to_start(&mut self, is_at_end: bool, then: Option<ExecutionType>) {
        self.start_position.begin(is_at_end);
        self.mode = Mode::MovingToStart(then);
        self.push(PlcEvent::MovingToStart);
    }

    fn go_on_to_start(&mut self, now: Instant, then: Option<ExecutionType>) {
        match (self.start_position.scan(now, &mut self.group), then) {
            (Progress::Running, _) => {}
            (Progress::Done, Some(execution_type)) => self.mode = Mode::Starting(execution_type),
            (Progress::Done, None) => self.become_idle(),
            (Progress::Aborted, _) => self.fail(FailureCause::RobotHalted),
            (Progress::Failed { error, .. }, _) => self.fail(FailureCause::StartNotReached(error)),
        }
    }

    fn become_idle(&mut self) {
        self.mode = Mode::Idle;
        self.push(PlcEvent::Ready);
    }

    fn begin_run(&mut self, now: Instant, execution_type: ExecutionType) {
        self.run = Run {
            sequence: Sequence::new(execution_type, self.program, self.queue_depth),
            overrides: self.overrides,
            overridden: 0,
            started_at: now,
            started_in_scan: self.scans,
            frames_before: self.bus.counters(),
        };
        self.motions.restart();
        self.mode = Mode::Running;
        self.push(PlcEvent::Started { execution_type, at: now });
        self.run(now);
    }

    fn run(&mut self, now: Instant) {
        self.follow_overrides(now);
        match self.run.sequence.scan(now, &mut self.motions, &self.stops, &mut self.group) {
            Progress::Running => {}
            Progress::Done => self.finish(now),
            Progress::Aborted => self.fail(FailureCause::RobotHalted),
            Progress::Failed { motion, error } => self.fail(match error {
                BlockError::Robot { number, finding, .. } => FailureCause::Robot { number, motion, finding },
                error => FailureCause::Block { error, motion },
            }),
        }
    }

    /// Sets the override as the run's schedule says.
    fn follow_overrides(&mut self, now: Instant) {
        let Some(schedule) = &self.run.overrides else { return };
        let since = now.since(self.run.started_at);
        let due = schedule.steps().iter().skip(self.run.overridden).take_while(|step| step.after() <= since);
        for step in due {
            self.group.set_override(step.to);
            self.run.overridden += 1;
        }
    }

    fn finish(&mut self, now: Instant) {
        let totals = self.run.sequence.totals();
        let execution_time_ns = now.as_nanos().saturating_sub(self.run.started_at.as_nanos());
        self.push(PlcEvent::Finished(Execution {
            execution_type: self.run.sequence.execution_type(),
            execution_time_ns,
            robot_execution_ns: totals.robot_execution_ns,
            motions: totals.executed,
            blends_suppressed: totals.blends_suppressed,
            scans: self.scans - self.run.started_in_scan,
            frames: frames_between(self.run.frames_before, self.bus.counters()),
        }));
        if self.is_at_start() { self.become_idle() } else { self.move_to_start(true, None) }
    }

    /// Ends a run, if there is one, and has the next scans lead the robot to `Ready` again.
    fn fail(&mut self, cause: FailureCause) {
        let (execution_type, executed) = match self.mode {
            Mode::Running => (self.run.sequence.execution_type(), self.run.sequence.totals().executed),
            Mode::Starting(execution_type) | Mode::MovingToStart(Some(execution_type)) => (execution_type, 0),
            // Nobody waits for it: the next run tries again and says what is wrong.
            Mode::MovingToStart(None) => return self.prepare_again(true),
            Mode::Idle | Mode::Preparing => return,
        };
        self.prepare_again(matches!(self.mode, Mode::MovingToStart(_)));
        self.push(PlcEvent::Failed(Failure { execution_type, executed, cause }));
    }

    /// Has the next scans lead the robot to `Ready` again.
    fn prepare_again(&mut self, start_not_reached: bool) {
        self.group.release(self.group.command().number);
        self.mode = Mode::Preparing;
        self.readiness = Readiness::after_failure();
        self.start_not_reached = start_not_reached;
    }

    /// What the program does while no sequence runs.
    fn prepare(&mut self) {
        if self.mode == Mode::Idle && Readiness::holds(&self.group) {
            return;
        }
        self.mode = Mode::Preparing;
        if !self.readiness.scan(&mut self.group) {
            return;
        }
        // What has just failed, or what somebody halted, is not repeated without being asked for.
        if core::mem::take(&mut self.start_not_reached) || self.is_at_start() {
            self.become_idle();
        } else {
            self.move_to_start(false, None);
        }
    }

    fn not_ready(&self) -> StartError {
        let feedback = self.group.feedback();
        StartError::NotReady {
            state: feedback.map_or(State::Halted, |feedback| feedback.state),
            error: feedback
                .filter(|feedback| feedback.status.contains(Status::ERROR))
                .map_or(ErrorNumber::None, |feedback| feedback.error),
        }
    }

    /// Hands on what the bus has to say. A lost connection fails a run at once, not with the next scan.
    fn drain_bus(&mut self) {
        while let Some(event) = self.bus.poll_event() {
            self.push(PlcEvent::Link(event));
            match event {
                LinkEvent::Up => self.connected = true,
                LinkEvent::Down(down) => {
                    self.fail(FailureCause::ConnectionLost(down));
                    self.disarm();
                }
                LinkEvent::SetAddress { .. } => {}
            }
        }
    }

    /// The bus repeats its last image on the next connection: it must not hold a command then.
    fn disarm(&mut self) {
        self.connected = false;
        self.mode = Mode::Preparing;
        self.readiness = Readiness::default();
        self.start_not_reached = false;
        self.group.disarm();
        self.emit();
        self.scan.drop_outputs();
        self.bus.set_output(&self.outputs);
    }

    /// Never beyond the capacity that was taken at the start; the owner drains events after each handler.
    fn push(&mut self, event: PlcEvent) {
        if self.events.len() < EVENTS {
            self.events.push_back(event);
        }
    }

    fn write_outputs(&mut self, now: Instant) {
        if self.scan.take_outputs(now) {
            self.bus.set_output(&self.outputs);
        }
    }
}

impl<B: Fieldbus> Machine for PlcNode<B> {
    type Event = PlcEvent;

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.bus.handle_frame(now, from, frame);
        self.drain_bus();
    }

    fn handle_broadcast(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.bus.handle_broadcast(now, from, frame);
        self.drain_bus();
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        self.bus.handle_stream(now, stream, change);
        self.drain_bus();
    }

    fn ports(&self) -> &[PortRequest] {
        self.bus.ports()
    }

    fn listen_port(&self) -> Option<u16> {
        self.bus.listen_port()
    }

    fn poll_stream(&mut self) -> Option<StreamRequest> {
        self.bus.poll_stream()
    }

    fn dscp(&self, port: Port) -> u8 {
        self.bus.dscp(port)
    }

    fn group(&self, port: Port, index: usize) -> Option<Ipv4Addr> {
        self.bus.group(port, index)
    }

    /// The program comes before the bus: outputs that are written at the instant of a bus cycle leave with it.
    fn handle_timeout(&mut self, now: Instant) {
        self.write_outputs(now);
        if self.scan.begin(now).is_some() {
            self.scan(now);
            self.write_outputs(now);
        }
        if self.bus.poll_timeout().is_some_and(|due| due <= now) {
            self.bus.handle_timeout(now);
        }
        self.drain_bus();
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        self.bus.poll_transmit(now, buf)
    }

    fn poll_event(&mut self) -> Option<PlcEvent> {
        self.events.pop_front()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let scan = self.scan.poll_timeout();
        Some(self.bus.poll_timeout().map_or(scan, |bus| bus.min(scan)))
    }
}

fn frames_between(before: Counters, after: Counters) -> Counters {
    Counters {
        sent: after.sent.saturating_sub(before.sent),
        skipped: after.skipped.saturating_sub(before.skipped),
        received: after.received.saturating_sub(before.received),
        lost: after.lost.saturating_sub(before.lost),
        late: after.late.saturating_sub(before.late),
        malformed: after.malformed.saturating_sub(before.malformed),
        foreign: after.foreign.saturating_sub(before.foreign),
    }
}
