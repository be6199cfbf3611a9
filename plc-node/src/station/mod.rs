//! A station of the PLC: a robot as the PLC sees it, with its images and its readiness.
//!
//! ```text
//! clock       the robot's clock, by the instants at which its frames arrive
//! inputs      the robot's image: taken over, or refused
//! readiness   leads the robot to Ready, and the arm to where a run starts
//! described_arm   whether the robot is the arm of the setup
//! start_position  where that is, and how the PLC knows
//! silence     what the PLC waits for, and when it gives up a robot that shows no progress
//! ```

mod clock;
mod described_arm;
mod inputs;
mod readiness;
mod silence;
mod start_position;

use machine::{Duration, Instant};
use planning::{Stop, ToStart};
use protocol::fieldbus::Down;
use protocol::image::{
    Checks, Command, CommandSealer, FeedbackChecker, IMAGE_LEN, Image, LifeMonitor, Motion, Order,
};

use clock::StationClock;
use described_arm::ArmCheck;
pub use described_arm::{DescribedArm, PoseDifference};
pub(crate) use inputs::RobotImage;
use readiness::Readiness;
pub(crate) use readiness::WayToStart;
use silence::Silence;
pub(crate) use silence::Work;
use start_position::StartPosition;

use crate::function_blocks::is_at_rest;
use crate::{AxesGroup, Sample, SetOut, WaitLimits};

/// What a PLC knows of a station before it runs.
#[derive(Debug)]
pub struct StationConfig {
    /// Its name in messages; empty where it is the only one.
    pub name: String,
    /// How many scans the program waits for the robot.
    pub wait_limits: WaitLimits,
    /// How long the robot may take to take up a command.
    pub answer_timeout: Duration,
    /// The robot's cycle, in which it counts its life counter up.
    pub robot_cycle: Duration,
    /// The arm that the robot should be; `None` if that is not known.
    pub arm: Option<DescribedArm>,
    /// How the arm moves to where a run begins. Without a motion, a run begins where the arm stands.
    pub to_start: ToStart<Motion>,
    /// Where its continuous motions end: its robot may be silent for as long as it waits there.
    pub longest_stop: Duration,
}

impl StationConfig {
    /// Returns the longest wait of these stops.
    #[must_use]
    pub fn longest_of(stops: &[Stop]) -> Duration {
        stops.iter().filter_map(|stop| stop.then).map(|switch| switch.wait).max().unwrap_or(Duration::ZERO)
    }
}

/// What a station does outside of a run.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum StationState {
    /// The PLC leads the robot to `Ready`, if there is a robot.
    Preparing,
    /// The arm moves to where a run starts.
    MovingToStart,
    /// The robot is ready, and the arm where a run starts, as far as it could be moved there.
    Ready,
}

/// A robot of the PLC: its connection, its axes group, its images, and whether it is ready.
#[derive(Debug)]
pub struct Station {
    /// Its index among the stations of the PLC.
    index: usize,
    name: String,
    order: Order,
    group: AxesGroup,
    arm: ArmCheck,
    start_position: StartPosition,
    pub(crate) state: StationState,
    readiness: Readiness,
    /// Whether the last attempt to move the arm to the start failed.
    start_not_reached: bool,
    /// Reason for which the arm does not set out for the start in this scan; `None` if nothing keeps it.
    kept: Option<SetOut>,
    is_connected: bool,
    /// Whether the owner knows that the robot marks its data as bad.
    image_bad: bool,
    /// Frames received when the robot's image had not changed for [`STALE_IMAGE_SCANS`](inputs::STALE_IMAGE_SCANS) scans.
    received_still: u64,
    /// Images refused when the robot's image had not changed for [`STALE_IMAGE_SCANS`](inputs::STALE_IMAGE_SCANS) scans.
    altered_still: u64,
    /// The image that the group's feedback was read from: a robot that is slower than the scan repeats it.
    inputs: Image,
    /// The image of this scan as the bus has it.
    received: Option<Image>,
    checker: FeedbackChecker,
    pub(crate) life: LifeMonitor,
    /// Estimates the robot's clock, where arms start or move together.
    clock: Option<Box<StationClock>>,
    /// Since when all images were refused as outdated; `None` while they are not.
    outdated_since: Option<Instant>,
    /// The image that the last scan computed; on the bus once the scan's cost has passed.
    outputs: Image,
    sealer: CommandSealer,
    /// Command number and motions written as of the slots in `outputs`; `None` if they are others.
    emitted: Option<(u16, u32)>,
    /// Whether the program set the image of this scan itself.
    is_image_set: bool,
    silence: Silence,
}

#[cfg(test)]
impl StationConfig {
    /// Returns a robot with a cycle of 4 ms, which may be silent and take an answer for so many scans.
    pub(crate) fn patient(scans: u32) -> Self {
        Self {
            name: String::new(),
            wait_limits: WaitLimits { answer_scans: scans, silent_scans: scans },
            answer_timeout: Duration::from_secs(1),
            robot_cycle: Duration::from_millis(4),
            arm: None,
            to_start: ToStart::default(),
            longest_stop: Duration::ZERO,
        }
    }
}

impl Station {
    pub(crate) fn new(index: usize, config: StationConfig, order: Order, scan_cycle: Duration) -> Self {
        let StationConfig { name, wait_limits, answer_timeout, robot_cycle, arm, to_start, longest_stop } =
            config;
        Self {
            index,
            name,
            order,
            group: AxesGroup::new(wait_limits),
            arm: ArmCheck::new(arm),
            start_position: StartPosition::new(to_start),
            state: StationState::Preparing,
            readiness: Readiness::default(),
            start_not_reached: false,
            kept: None,
            is_connected: false,
            image_bad: false,
            received_still: 0,
            altered_still: 0,
            inputs: [0; IMAGE_LEN],
            received: None,
            checker: FeedbackChecker::default(),
            life: LifeMonitor::new(robot_cycle),
            clock: None,
            outdated_since: None,
            outputs: [0; IMAGE_LEN],
            sealer: CommandSealer::default(),
            emitted: None,
            is_image_set: false,
            silence: Silence::new(scan_cycle, answer_timeout, longest_stop),
        }
    }

    /// Returns the station's name; empty where it is the only one.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the robot as function blocks see it.
    #[must_use]
    pub const fn group(&self) -> &AxesGroup {
        &self.group
    }

    /// Returns the robot as function blocks see it, to command it.
    pub const fn group_mut(&mut self) -> &mut AxesGroup {
        &mut self.group
    }

    /// Returns whether the station is connected.
    #[must_use]
    pub const fn is_connected(&self) -> bool {
        self.is_connected
    }

    /// Returns whether the robot has shown on this connection that it is the arm of the setup, or nobody knows that arm.
    pub(crate) fn is_arm_of_setup(&self) -> bool {
        self.arm.is_passed()
    }

    /// Returns whether the robot is ready for a run, and the arm where it starts.
    #[must_use]
    pub fn is_ready(&self) -> bool {
        self.state == StationState::Ready
    }

    /// Returns the joints of an arm that rests without a command to move, in degrees (mm); `None` if that is not known.
    pub(crate) fn resting_joints(&self) -> Option<[f32; 6]> {
        let may_move = match self.state {
            StationState::Preparing => true,
            StationState::MovingToStart => self.start_position.has_set_out(),
            StationState::Ready => false,
        };
        let feedback = self.group.feedback().filter(|feedback| is_at_rest(feedback))?;
        (self.is_connected && !may_move && !self.group.is_silent()).then_some(feedback.joints)
    }

    /// Returns whether the arm moves to where a run starts.
    pub(crate) fn is_on_its_way(&self) -> bool {
        self.state == StationState::MovingToStart && self.start_position.has_set_out()
    }

    /// Returns whether the arm is to move to the start from the end of its application.
    pub(crate) const fn comes_from_end(&self) -> bool {
        self.start_position.comes_from_end()
    }

    /// Returns whether the PLC leads the robot to `Ready`, if there is a robot.
    #[cfg(all(feature = "real", target_os = "linux"))]
    pub(crate) fn is_preparing(&self) -> bool {
        self.state == StationState::Preparing
    }

    /// Returns the order in which the station's bus carries the bytes of a number.
    #[must_use]
    pub const fn byte_order(&self) -> Order {
        self.order
    }

    /// Returns the robot's image of this scan as it came; `None` without a connection. Its check and its age were accepted.
    #[must_use]
    pub fn image(&self) -> Option<&Image> {
        self.group.feedback().map(|_| &self.inputs)
    }

    /// Sets the image that goes to the robot after this scan as it is, in place of the axes group's command. The check in it is
    /// the program's too, and so are the command number, which must be new to the robot, and the life counter: continue from that
    /// of the axes group's command, which counts on meanwhile. In the scan in which the run fails or is aborted the image
    /// does not go out.
    pub fn set_image(&mut self, image: &Image) {
        (self.outputs, self.is_image_set, self.emitted) = (*image, true, None);
    }

    /// Sets the image like [`set_image`](Self::set_image), and takes its command over into the axes group, for all that reads the
    /// command there. Returns the command.
    pub(crate) fn take_command(&mut self, image: &Image) -> &Command {
        self.set_image(image);
        let before = &self.group.command;
        if let Ok(head) = self.order.parse_command_head(image) {
            let is_same = (head.number, head.written) == (before.number, before.written);
            let whole = if is_same { None } else { self.order.parse_command(image).ok() };
            self.group.command = whole.unwrap_or(Command { slots: before.slots, ..head });
        }
        &self.group.command
    }

    /// Returns the robot's image of this scan as its bus has it, before any check; `None` without a connection.
    pub(crate) fn keep_received(&mut self, image: Option<Image>) {
        self.received = image.filter(|_| self.is_connected);
    }

    pub(crate) const fn received(&self) -> Option<Image> {
        self.received
    }

    /// Returns the numbers of images by the results of their checks, and of outdated ones.
    #[must_use]
    pub const fn checks(&self) -> Checks {
        let Checks { altered, unchecked, .. } = self.checker.checks();
        Checks { altered, unchecked, outdated: self.life.outdated() }
    }

    /// Returns what the PLC commanded in scan number `scan`, the last one.
    pub(crate) fn sample(&self, scan: u64) -> Sample {
        let command = self.group.command();
        let feedback = self.group.feedback().filter(|feedback| feedback.number == command.number);
        let executed = feedback.map_or(0, |feedback| feedback.executed);
        Sample {
            scan,
            command: command.number,
            total: command.total,
            written: command.written,
            in_slots: command.written.saturating_sub(executed),
            altered: self.checker.checks().altered,
            ..Sample::default()
        }
    }

    /// Returns the image for the robot that the last scan computed.
    pub(crate) const fn outputs(&self) -> &Image {
        &self.outputs
    }

    /// Computes the output image. The slots take most of the time, and they change only with a new command or with
    /// motions written.
    pub(crate) fn emit(&mut self) {
        if std::mem::take(&mut self.is_image_set) {
            return;
        }
        let led = self.group.led_command();
        let command = led.as_ref().unwrap_or_else(|| self.group.command());
        let slots = Some((command.number, command.written));
        if std::mem::replace(&mut self.emitted, slots) == slots {
            self.order.emit_command_head(command, &mut self.outputs);
        } else {
            self.order.emit_command(command, &mut self.outputs);
            self.sealer.take_tail(&self.outputs);
        }
        self.sealer.seal(self.order, &mut self.outputs);
    }

    pub(crate) const fn connect(&mut self) {
        self.is_connected = true;
        self.silence.connected();
    }

    pub(crate) const fn note_down(&mut self, down: Down) {
        self.silence.not_connected(down);
    }

    /// Removes every command from the image, because the bus repeats its last image on the next connection.
    pub(crate) fn disarm(&mut self) {
        self.is_connected = false;
        self.arm.forget();
        self.forget_images();
        self.forget_clock();
        self.state = StationState::Preparing;
        self.readiness = Readiness::default();
        self.start_not_reached = false;
        self.group.disarm();
        self.is_image_set = false;
        self.emit();
    }

    /// Returns the joints and the clock of the robot.
    pub(crate) fn robot(&self) -> ([f32; 6], u64) {
        self.group.feedback().map_or(([0.0; 6], 0), |robot| (robot.joints, robot.clock_ns))
    }
}
