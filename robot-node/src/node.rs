//! The robot as a machine: a bus endpoint and a controller, which exchange images every robot cycle.

use std::collections::VecDeque;

use machine::{
    Cycle, Duration, Instant, Lateness, Machine, Pending, Source, StreamChange, StreamId, Transmit,
};
use protocol::bus_polls::BusPolls;
use protocol::fieldbus::{Fieldbus, LinkEvent};
use protocol::image::{
    Age, Checks, Command, CommandChecker, FeedbackSealer, HEAD_LEN, IMAGE_LEN, Image, LifeMonitor, Services,
    State, Verdict,
};

use crate::sample::Positions;
use crate::waiting::{Wait, WaitingFor};
use crate::{Controller, Disturbance, DriveSegment, ImageFault, Program, RobotConfig, RobotEvent, Sample};

/// Cycles that the controller runs at once after a stall of its host: a second at 4 ms.
const CATCH_UP: u64 = 250;

/// Time with nothing but refused images after which the connection counts as lost: a usual watchdog.
const REFUSED_FOR: Duration = Duration::from_millis(100);

/// Time without an outdated image after which such images are reported as accepted again. Those of a PLC that counts too fast
/// are refused, set a new start and are refused again.
const ACCEPTED_FOR: Duration = Duration::from_secs(1);

/// Capacity for events of the connection that wait for the owner.
const LINK_EVENTS: usize = 16;

/// The robot on its bus.
#[derive(Debug)]
pub struct RobotNode<B: Fieldbus> {
    bus: B,
    polled: BusPolls,
    controller: Controller,
    /// The drives that the set-points go to, if the robot has some.
    drives: Option<DriveSegment>,
    cycle: Cycle,
    lateness: Lateness,
    /// The image that the command below was read from.
    image: Image,
    command: Command,
    connected: bool,
    checker: CommandChecker,
    life: LifeMonitor,
    /// Since when all images were refused; `None` while they are not.
    refused_since: Option<Instant>,
    /// When an image was last refused.
    refused_at: Instant,
    /// Whether the connection ended since the last cycle, even if there is another one already.
    was_lost: bool,
    output: Image,
    sealer: FeedbackSealer,
    /// What the sealer has of the feedback's bytes behind the check.
    sealed: (u32, Services),
    link_events: VecDeque<RobotEvent>,
    /// Whether the bus has a connection.
    linked: bool,
    wait: Wait,
    ticked_at: Instant,
}

impl<B: Fieldbus> RobotNode<B> {
    /// Creates a robot with its programs by number. Its cycles start at `start`, which fixes their phase; `seed` feeds
    /// the interpreter's random phase.
    #[must_use]
    pub fn new(
        config: RobotConfig,
        programs: Vec<(u16, Program)>,
        bus: B,
        seed: u64,
        start: Instant,
    ) -> Self {
        let cycle = Cycle::new(start, config.cycle);
        let drives = DriveSegment::of(&config, start);
        let life = LifeMonitor::new(config.plc_cycle);
        let controller = Controller::new(config, programs, seed);
        let mut node = Self {
            bus,
            polled: BusPolls::called(),
            controller,
            drives,
            cycle,
            lateness: Lateness::default(),
            image: [0; IMAGE_LEN],
            command: Command::default(),
            connected: false,
            checker: CommandChecker::default(),
            life,
            refused_since: None,
            refused_at: start,
            was_lost: false,
            output: [0; IMAGE_LEN],
            sealer: FeedbackSealer::default(),
            sealed: (0, Services::default()),
            link_events: VecDeque::with_capacity(LINK_EVENTS),
            linked: false,
            wait: Wait::default(),
            ticked_at: start,
        };
        node.write_feedback();
        node
    }

    /// Returns the bus endpoint.
    #[must_use]
    pub const fn bus(&self) -> &B {
        &self.bus
    }

    /// Returns the bus endpoint, for commands to it.
    pub fn bus_mut(&mut self) -> &mut B {
        self.polled = BusPolls::called();
        &mut self.bus
    }

    fn bus_timeout(&self) -> Option<Instant> {
        self.polled.timeout(|| self.bus.poll_timeout())
    }

    /// Returns the controller.
    #[must_use]
    pub const fn controller(&self) -> &Controller {
        &self.controller
    }

    /// Returns the drives behind the controller, if the robot has some.
    #[must_use]
    pub const fn drives(&self) -> Option<&DriveSegment> {
        self.drives.as_ref()
    }

    /// Disturbs the drive of an axis, counted from 1; does nothing if there is no such drive.
    pub fn disturb_drive(&mut self, axis: u8, disturbance: Disturbance) {
        self.drives.as_mut().and_then(|drives| drives.disturb(axis.into(), disturbance));
    }

    /// Returns the drives behind the controller, to disturb their cable.
    pub const fn drives_mut(&mut self) -> Option<&mut DriveSegment> {
        self.drives.as_mut()
    }

    /// Returns the lateness of the robot's cycles.
    #[must_use]
    pub const fn lateness(&self) -> &Lateness {
        &self.lateness
    }

    /// Returns the numbers of images by the results of their checks, and of outdated ones.
    #[must_use]
    pub const fn checks(&self) -> Checks {
        let Checks { altered, unchecked, .. } = self.checker.checks();
        Checks { altered, unchecked, outdated: self.life.outdated() }
    }

    /// Returns the instant of the robot's next cycle.
    #[must_use]
    pub const fn next_tick(&self) -> Instant {
        self.cycle.next()
    }

    /// Returns when the last cycle ran.
    #[must_use]
    pub const fn ticked_at(&self) -> Instant {
        self.ticked_at
    }

    /// Returns what the robot did in its last cycle.
    #[must_use]
    pub const fn sample(&self) -> Sample {
        let feedback = self.controller.feedback();
        Sample {
            state: feedback.state,
            command: feedback.number,
            executed: feedback.executed,
            accepted: feedback.accepted,
            blends_suppressed: feedback.blends_suppressed,
            path_speed_mm_s: feedback.path_speed,
            pose: feedback.pose,
            joints: *self.controller.reported_joints(),
            altered: self.checker.checks().altered,
            positions: if self.drives.is_some() { Positions::Drives } else { Positions::SetPoints },
            progress_us: (self.controller.progress_s() * 1e6 + 0.5) as u64,
        }
    }

    /// Runs the robot's cycle if it is due. A real controller does not stall when this host does: cycles that were
    /// missed are made up for, with the command as it was known then, so that a stall does not lengthen a motion.
    fn tick(&mut self, now: Instant) {
        let Some(tick) = self.cycle.tick(now) else { return };
        self.lateness.record(&tick);
        let period = self.cycle.period();
        let mut at = tick.due;
        if tick.skipped > CATCH_UP {
            at += period * u32::try_from(tick.skipped - CATCH_UP).unwrap_or(u32::MAX);
        }
        for _ in 0..tick.skipped.min(CATCH_UP) {
            self.interpolate(at);
            at += period;
        }
        self.read_command(at);
        self.interpolate(at);
        self.ticked_at = at;
        self.write_feedback();
        self.watch_wait(at);
    }

    /// Reports what the robot waits for, every ten seconds.
    fn watch_wait(&mut self, at: Instant) {
        let is_still = self.wait.is_still(self.command.life);
        let for_what = if !self.linked {
            self.wait.disconnect();
            Some(WaitingFor::Plc)
        } else if !self.bus.has_input() {
            Some(WaitingFor::GoodData)
        } else if self.refused_since.is_some() {
            Some(WaitingFor::RightCheck { altered: self.checker.checks().altered })
        } else if is_still {
            Some(WaitingFor::Life { life: self.command.life })
        } else {
            WaitingFor::of(&self.command, self.controller.feedback()).or_else(|| self.waits_for_arms())
        };
        if let Some((for_what, seconds)) = self.wait.see(at, for_what) {
            self.push(RobotEvent::Waiting { for_what, seconds });
        }
    }

    /// Returns the other arms, if the stored program waits for them at a mark.
    fn waits_for_arms(&self) -> Option<WaitingFor> {
        let signal = self.controller.meets()?;
        let number = self.controller.feedback().number;
        Some(WaitingFor::OtherArms { number, inputs: signal.inputs, set: signal.set })
    }

    /// Runs the controller for one cycle, and the drives.
    fn interpolate(&mut self, at: Instant) {
        let Self { controller, drives, .. } = self;
        controller.tick(at, self.connected.then_some(&self.command));
        let Some(drives) = drives else { return };
        if controller.take_drive_reset() {
            drives.reset();
        }
        controller.take_drives(drives.exchange(at, controller.joints()));
    }

    fn read_command(&mut self, at: Instant) {
        let was_lost = core::mem::take(&mut self.was_lost);
        let Some(image) = self.bus.input().filter(|_| !was_lost) else {
            (self.connected, self.refused_since) = (false, None);
            self.checker.disconnect();
            self.life.restart();
            return self.controller.forget_images();
        };
        if self.checker.verify(self.bus.byte_order(), &image) == Verdict::Altered {
            return self.refuse(at, ImageFault::Altered);
        }
        // Every scan changes the head, but the slots only change with the motions.
        let order = self.bus.byte_order();
        let slots = self.command.slots;
        let has_same_form = |head: &Command| head.is_compact() == slots.points().is_some();
        let head = match self.image.get(HEAD_LEN..) == image.get(HEAD_LEN..) {
            true => order.parse_command_head(&image).ok().filter(has_same_form),
            false => None,
        };
        let command = match head {
            Some(head) => Command { slots, ..head },
            None => match order.parse_command(&image) {
                Ok(command) => command,
                Err(_) => return,
            },
        };
        // Without a reset no skill can start: until then a late image may set the start.
        if self.controller.feedback().state != State::Halted {
            self.life.act();
        }
        if self.life.judge_present(command.life) == Age::Outdated {
            return self.refuse(at, ImageFault::Outdated);
        }
        (self.command, self.image, self.connected) = (command, image, true);
        self.accept(at);
    }

    /// Refuses an image: the command before stands, as if the frame had been lost.
    fn refuse(&mut self, at: Instant, fault: ImageFault) {
        self.refused_at = at;
        let since = *self.refused_since.get_or_insert(at);
        if at.since(since) < REFUSED_FOR {
            return;
        }
        self.connected = false;
        self.controller.refuse_images(fault);
        if fault == ImageFault::Outdated {
            // The next image sets the start, as that of another connection.
            self.life.restart();
            self.refused_since = None;
        }
    }

    fn accept(&mut self, at: Instant) {
        self.refused_since = None;
        let is_recent = at.since(self.refused_at) < ACCEPTED_FOR;
        if !(is_recent && self.controller.refused_images() == Some(ImageFault::Outdated)) {
            self.controller.accept_images();
        }
        if self.life.take_still(at) {
            self.push(RobotEvent::LifeStill);
        }
    }

    fn write_feedback(&mut self) {
        let order = self.bus.byte_order();
        let feedback = self.controller.feedback();
        order.emit_feedback(feedback, &mut self.output);
        let behind = (feedback.law_time_us, feedback.services);
        if self.sealed != behind {
            self.sealed = behind;
            self.sealer.take_tail(&self.output);
        }
        self.sealer.seal(order, &mut self.output);
        self.polled = BusPolls::called();
        self.bus.set_output(&self.output);
    }

    fn take_link_events(&mut self) {
        if !self.polled.take_may_report() {
            return;
        }
        while let Some(event) = self.bus.poll_event() {
            match event {
                LinkEvent::Up => self.linked = true,
                LinkEvent::Down(_) => (self.linked, self.was_lost) = (false, true),
                LinkEvent::SetAddress { .. }
                | LinkEvent::Store
                | LinkEvent::Foreign(_)
                | LinkEvent::Owner(_)
                | LinkEvent::Conflict(_)
                | LinkEvent::Health => {}
            }
            self.push(RobotEvent::Link(event));
        }
    }

    /// Adds an event, in place of the oldest one if there are too many.
    fn push(&mut self, event: RobotEvent) {
        if self.link_events.len() == LINK_EVENTS {
            self.link_events.pop_front();
        }
        self.link_events.push_back(event);
    }

    /// Handles what the bus has received and reported.
    fn after_bus(&mut self, now: Instant) {
        self.polled.narrow(self.bus.pending(now));
        self.life.note_arrival(now, self.bus.received());
        self.take_link_events();
    }
}

impl<B: Fieldbus> Machine for RobotNode<B> {
    type Event = RobotEvent;

    machine::forward_ports!(bus);

    fn handle_frame(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.bus_mut().handle_frame(now, from, frame);
        self.after_bus(now);
    }

    fn handle_broadcast(&mut self, now: Instant, from: Source, frame: &[u8]) {
        self.bus_mut().handle_broadcast(now, from, frame);
        self.after_bus(now);
    }

    fn handle_stream(&mut self, now: Instant, stream: StreamId, change: StreamChange) {
        self.bus_mut().handle_stream(now, stream, change);
        self.take_link_events();
    }

    fn handle_timeout(&mut self, now: Instant) {
        if self.bus_timeout().is_some_and(|due| due <= now) {
            self.bus_mut().handle_timeout(now);
            self.after_bus(now);
        }
        self.tick(now);
    }

    fn pending(&self, _now: Instant) -> Pending {
        let event = self.polled.may_report() || !self.link_events.is_empty() || self.controller.has_event();
        Pending { frame: self.polled.may_send, request: self.polled.may_connect, event }
    }

    fn poll_transmit(&mut self, now: Instant, buf: &mut [u8]) -> Option<Transmit> {
        if !self.polled.may_send {
            return None;
        }
        let transmit = self.bus_mut().poll_transmit(now, buf);
        match transmit {
            Some(_) => self.polled.narrow(self.bus.pending(now)),
            None => self.polled.end_sending(),
        }
        transmit
    }

    fn poll_event(&mut self) -> Option<RobotEvent> {
        // A bus may also have events after a command or a transmission.
        self.take_link_events();
        self.link_events.pop_front().or_else(|| self.controller.poll_event())
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let tick = self.cycle.next();
        Some(self.bus_timeout().map_or(tick, |bus| bus.min(tick)))
    }
}
