//! The PLC: scan, bus, readiness, runs.
//!
//! ```text
//! as_machine  the PLC as a machine: program and bus by time and frames
//! inputs      the robot's image: taken over, or refused
//! run         the way to the start of a run, its scans and its end; readiness in between
//! silence     what the PLC waits for, and when it gives up a robot that shows no progress
//! ```

mod as_machine;
mod inputs;
mod run;
mod silence;

use std::collections::VecDeque;

use machine::{Duration, Instant, Lateness};
use planning::Stop;
use protocol::fieldbus::{Counters, Fieldbus, LinkEvent};
use protocol::image::{
    Checks, Command, CommandSealer, Digest, FeedbackChecker, IMAGE_LEN, Image, LifeMonitor,
};

use silence::Silence;

use crate::motion_source::Digested;
use crate::readiness::Readiness;
use crate::sequence::Sequence;
use crate::start_position::StartPosition;
use crate::{
    AxesGroup, ExecutionType, FailureCause, MotionSource, Override, OverrideSchedule, PlcConfig, PlcEvent,
    Sample, Scan, StartError,
};

/// Capacity for events: more than one handler can cause; the owner drains them after each.
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
    /// Whether the last attempt to move the arm to the start failed.
    start_not_reached: bool,
    connected: bool,
    /// Whether the owner knows that the robot marks its data as bad.
    image_bad: bool,
    /// Frames received when the robot's image had not changed for [`STILL`](inputs::STILL) scans.
    received_still: u64,
    mode: Mode,
    readiness: Readiness,
    run: Run,
    /// Changes of the override in the runs that start from now on; `None` leaves it unchanged.
    overrides: Option<OverrideSchedule>,
    /// The image that the group's feedback was read from: a robot that is slower than the scan repeats it.
    inputs: Image,
    checker: FeedbackChecker,
    life: LifeMonitor,
    /// Since when all images were refused as outdated; `None` while they are not.
    outdated_since: Option<Instant>,
    /// Images refused when the robot's image had not changed for [`STILL`](inputs::STILL) scans.
    altered_still: u64,
    /// The outputs that the last scan computed; on the bus once the scan's cost has passed.
    outputs: Image,
    sealer: CommandSealer,
    silence: Silence,
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
    /// Lowest and highest override so far, in %.
    override_percent: [u8; 2],
    started_at: Instant,
    started_in_scan: u64,
    /// The robot's joints and clock in that scan.
    robot_before: ([f32; 6], u64),
    frames_before: Counters,
}

impl<B: Fieldbus> PlcNode<B> {
    /// Creates a PLC whose first scan is at `start`.
    #[must_use]
    pub fn new(config: PlcConfig, bus: B, start: Instant) -> Self {
        let wait_limits = config.wait_limits();
        let longest_stop = config.stops.iter().filter_map(|stop| stop.then).map(|switch| switch.wait).max();
        let silence =
            Silence::new(config.scan_cycle, config.answer_timeout, longest_stop.unwrap_or(Duration::ZERO));
        Self {
            bus,
            scan: Scan::new(start, config.scan_cycle, config.scan_cost),
            scans: 0,
            group: AxesGroup::new(wait_limits),
            program: config.program,
            queue_depth: config.queue_depth,
            motions: Digested::new(config.motions),
            stops: config.stops,
            start_position: StartPosition::new(config.to_start),
            start_not_reached: false,
            connected: false,
            image_bad: false,
            received_still: 0,
            mode: Mode::Preparing,
            readiness: Readiness::default(),
            run: Run {
                sequence: Sequence::new(ExecutionType::Rc, config.program, config.queue_depth),
                overrides: None,
                overridden: 0,
                override_percent: [u8::MAX, 0],
                started_at: start,
                started_in_scan: 0,
                robot_before: ([0.0; 6], 0),
                frames_before: Counters::default(),
            },
            overrides: None,
            inputs: [0; IMAGE_LEN],
            checker: FeedbackChecker::default(),
            life: LifeMonitor::new(config.robot_cycle),
            outdated_since: None,
            altered_still: 0,
            outputs: [0; IMAGE_LEN],
            sealer: CommandSealer::default(),
            silence,
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

    /// Returns whether a run may start.
    #[must_use]
    pub fn is_ready(&self) -> bool {
        self.mode == Mode::Idle
    }

    /// Returns the lateness of the scans.
    #[must_use]
    pub const fn lateness(&self) -> &Lateness {
        self.scan.lateness()
    }

    /// Returns the numbers of images by the results of their checks, and of outdated ones.
    #[must_use]
    pub const fn checks(&self) -> Checks {
        let Checks { altered, unchecked, .. } = self.checker.checks();
        Checks { altered, unchecked, outdated: self.life.outdated() }
    }

    /// Returns the digest of the motions that this run, or the last one, took from their source: with SM and CM those
    /// that it sent. RC takes none.
    #[must_use]
    pub const fn sent(&self) -> &Digest {
        self.motions.given()
    }

    /// Returns the bus endpoint.
    #[must_use]
    pub const fn bus(&self) -> &B {
        &self.bus
    }

    /// Returns the bus endpoint, for commands of its own; poll the node afterwards.
    pub const fn bus_mut(&mut self) -> &mut B {
        &mut self.bus
    }

    /// Returns the command to the robot as of the last scan.
    #[must_use]
    pub const fn command(&self) -> &Command {
        self.group.command()
    }

    /// Returns how many scans have run.
    #[must_use]
    pub const fn scans(&self) -> u64 {
        self.scans
    }

    /// Returns what the PLC did in its last scan.
    #[must_use]
    pub fn sample(&self) -> Sample {
        let command = self.command();
        let feedback = self.group.feedback().filter(|feedback| feedback.number == command.number);
        let executed = feedback.map_or(0, |feedback| feedback.executed);
        Sample {
            scan: self.scans,
            command: command.number,
            total: command.total,
            written: command.written,
            in_slots: command.written.saturating_sub(executed),
            altered: self.checker.checks().altered,
        }
    }

    /// Runs one scan: inputs, program, outputs.
    fn scan(&mut self, now: Instant) {
        self.scans += 1;
        self.read_inputs(now);
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
        self.watch_silence();
        // A run that has just failed is followed by the halt in the same scan.
        if matches!(self.mode, Mode::Idle | Mode::Preparing) {
            self.prepare();
        }
        self.emit();
    }

    /// Computes the output image. The slots take most of the time, and they change only with a new command or with
    /// motions written.
    fn emit(&mut self) {
        let command = self.group.command();
        let slots = Some((command.number, command.written));
        let order = self.bus.byte_order();
        if core::mem::replace(&mut self.emitted, slots) == slots {
            order.emit_command_head(command, &mut self.outputs);
        } else {
            order.emit_command(command, &mut self.outputs);
            self.sealer.take_tail(&self.outputs);
        }
        self.sealer.seal(order, &mut self.outputs);
    }

    /// Handles what the bus has received and reported.
    fn after_bus(&mut self, now: Instant) {
        self.life.note_arrival(now, self.bus.counters().received);
        self.drain_bus();
    }

    /// Passes on the events of the bus. A lost connection fails a run at once, not with the next scan.
    fn drain_bus(&mut self) {
        while let Some(event) = self.bus.poll_event() {
            self.push(PlcEvent::Link(event));
            match event {
                LinkEvent::Up => {
                    self.connected = true;
                    self.silence.connected();
                }
                LinkEvent::Down(down) => {
                    self.silence.not_connected(down);
                    self.fail(FailureCause::ConnectionLost(down));
                    self.disarm();
                }
                LinkEvent::SetAddress { .. }
                | LinkEvent::Store
                | LinkEvent::Foreign(_)
                | LinkEvent::Conflict(_) => {}
            }
        }
    }

    /// Removes every command from the image, because the bus repeats its last image on the next connection.
    fn disarm(&mut self) {
        self.connected = false;
        self.forget_images();
        self.mode = Mode::Preparing;
        self.readiness = Readiness::default();
        self.start_not_reached = false;
        self.group.disarm();
        self.emit();
        self.scan.drop_outputs();
        self.bus.set_output(&self.outputs);
    }

    /// Adds an event. The capacity taken at the start is never exceeded, because the owner drains events after each
    /// handler.
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
