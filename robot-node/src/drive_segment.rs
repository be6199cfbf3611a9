//! The drives of the robot controller: emulated ones on an EtherCAT cable of their own, and the MainDevice that drives
//! them.
//!
//! ```text
//! robot cycle    set-points ─▶ Axes ─▶ MainDevice ══ cable ══ Drives ─▶ motors
//!                report     ◀─ Axes ◀─ MainDevice ══       ══ Drives ◀─
//! ```
//!
//! Both ends of the cable are machines within the robot's machine, and it takes no time: so one exchange of process data
//! belongs to each robot cycle, in real and in virtual time alike. A set-point that goes out in a cycle is where the drive is
//! in the next one.

use ethercat_drive::{
    Axes, Axis, AxisError, Cause, DRIVE, DriveConfig, Drives, ErrorCode, INPUT_LEN, OUTPUT_LEN, Power, Wanted,
};
use ethercat_maindevice::{Config, ExpectedDevice, GroupMainDevice};
use machine::ethernet::Mac;
use machine::{Counters, Instant, LinkEvent, Machine, Port, Source};
use serde::{Deserialize, Serialize};
use setup::Drives as DrivesOfSetup;

use crate::RobotConfig;
use crate::arm::{AXES, Joints};
use crate::controller::{DriveError, DrivePower, DriveReport};

/// Robot cycles without process data after which either side gives the other up.
const WATCHDOG_CYCLES: u32 = 10;

/// Frames between both ends in one robot cycle at most. While the MainDevice brings the drives up, it may ask again and
/// again for what only time changes.
const FRAMES_PER_CYCLE: u32 = 500;

/// Longest Ethernet frame in bytes.
const LONGEST_FRAME: usize = 1514;

/// Address of the MainDevice. Its cable has no other one.
const MAC: Mac = Mac([0x02, 0, 0, 0, 0, 1]);

/// What happens to a drive, for tests of what a PLC makes of it.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Disturbance {
    /// It has an over-current.
    Fault,
    /// An input of its own stops it.
    Stop,
    /// Something holds its shaft.
    Block,
    /// Nothing holds its shaft any more.
    Release,
}

/// Drives, their cable and their MainDevice.
#[derive(Debug)]
pub struct DriveSegment {
    main: GroupMainDevice,
    axes: Axes,
    drives: Drives,
    targets: [i32; AXES],
    /// Good exchanges of process data so far.
    exchanges: u64,
    /// The connection was lost since the last reset.
    lost: bool,
    /// The drives are told to leave their faults.
    resetting: bool,
    report: DriveReport,
    /// Following error window in degrees (mm).
    following_error: f64,
    frame: Box<[u8; LONGEST_FRAME]>,
    answer: Box<[u8; LONGEST_FRAME]>,
}

impl DriveSegment {
    /// Creates the drives of a robot, at home and off; `None` for a robot without drives of its own.
    #[must_use]
    pub fn of(config: &RobotConfig, start: Instant) -> Option<Self> {
        let Some(DrivesOfSetup::Ethercat) = config.drives else { return None };
        let (axes, cycle) = (config.arm.axes(), config.cycle);
        let expected = ExpectedDevice {
            vendor: DRIVE.vendor_id,
            product: DRIVE.product_code,
            revision: Some(DRIVE.revision),
            output_bytes: OUTPUT_LEN,
            input_bytes: INPUT_LEN,
        };
        let watchdog = cycle * WATCHDOG_CYCLES;
        let main = Config { mac: MAC, devices: vec![expected; axes], cycle, watchdog };
        Some(Self {
            main: GroupMainDevice::new(main, start),
            axes: Axes::new(axes),
            drives: Drives::new(&configs(config), cycle, start),
            targets: [0; AXES],
            exchanges: 0,
            lost: false,
            resetting: false,
            report: DriveReport { joints: config.home, power: DrivePower::Off { axis: 0 } },
            following_error: config.servo.following_error,
            frame: Box::new([0; LONGEST_FRAME]),
            answer: Box::new([0; LONGEST_FRAME]),
        })
    }

    /// Returns the counters of the exchanges: `lost` are those without the full working counter.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.main.counters()
    }

    /// Tells the drives to leave their faults; once none has one, they are switched on.
    pub fn reset(&mut self) {
        (self.lost, self.resetting) = (false, true);
        self.axes.want(Wanted::Reset);
    }

    /// Disturbs the drive of an axis, counted from 1. Returns `None` if there is no such axis.
    pub fn disturb(&mut self, axis: usize, disturbance: Disturbance) -> Option<()> {
        let index = axis.checked_sub(1)?;
        match disturbance {
            Disturbance::Stop => self.drives.stop(index),
            Disturbance::Fault => {
                self.drives.drive_mut(index).map(|drive| drive.trip(ErrorCode::OVER_CURRENT))
            }
            Disturbance::Block | Disturbance::Release => {
                let is_blocked = disturbance == Disturbance::Block;
                self.drives.drive_mut(index).map(|drive| drive.block(is_blocked))
            }
        }
    }

    /// Cuts the cable before the drives, or mends it.
    pub fn set_cut(&mut self, cut: bool) {
        self.drives.segment_mut().set_cut(ethercat_subdevice::DeviceId(0), cut);
    }

    /// Runs one cycle at `at`: sends these set-points, in degrees (mm), and returns what the drives report.
    pub fn exchange(&mut self, at: Instant, joints: &Joints) -> DriveReport {
        self.drives.handle_timeout(at);
        for (target, joint) in self.targets.iter_mut().zip(joints) {
            *target = increments(*joint);
        }
        self.axes.send(&self.targets, self.main.outputs_mut());
        self.main.handle_timeout(at);
        self.pass_frames(at);
        while let Some(event) = self.main.poll_event() {
            match event {
                LinkEvent::Up if !self.lost && !self.resetting => self.axes.want(Wanted::On),
                LinkEvent::Down(_) => self.lost |= self.exchanges > 0,
                LinkEvent::Up
                | LinkEvent::SetAddress { .. }
                | LinkEvent::Store
                | LinkEvent::Foreign(_)
                | LinkEvent::Owner(_)
                | LinkEvent::Conflict(_)
                | LinkEvent::Health => {}
            }
        }
        // They are for who looks at drives alone.
        while self.drives.poll_event().is_some() {}
        self.receive();
        self.report
    }

    /// Passes frames both ways until there are none.
    fn pass_frames(&mut self, at: Instant) {
        let from = Source { port: Port::Ethernet, peer: None };
        for _ in 0..FRAMES_PER_CYCLE {
            let Some(sent) = self.main.poll_transmit(at, &mut *self.frame) else {
                if self.main.poll_timeout().is_none_or(|due| due > at) {
                    return;
                }
                self.main.handle_timeout(at);
                continue;
            };
            self.drives.handle_frame(at, from, self.frame.get(..sent.len).unwrap_or_default());
            while let Some(sent) = self.drives.poll_transmit(at, &mut *self.answer) {
                self.main.handle_frame(at, from, self.answer.get(..sent.len).unwrap_or_default());
            }
        }
    }

    /// Takes what the drives report, if the exchange was good.
    fn receive(&mut self) {
        let received = self.main.counters().received;
        if let Some(inputs) = self.main.inputs()
            && received != self.exchanges
        {
            self.exchanges = received;
            self.axes.receive(inputs);
            if self.resetting && self.axes.are_off() {
                self.resetting = false;
                self.axes.want(Wanted::On);
            }
            for (joint, axis) in self.report.joints.iter_mut().zip(self.axes.axes()) {
                *joint = f64::from(axis.position()) / DrivesOfSetup::INCREMENTS;
            }
        }
        self.report.power = match self.axes.error() {
            _ if self.lost => DrivePower::Failed(DriveError::Lost),
            Some(error) => DrivePower::Failed(self.failure(error)),
            None if self.main.inputs().is_none() => DrivePower::Off { axis: 0 },
            None if self.axes.are_on() => DrivePower::On,
            None => {
                let off = self.axes.axes().iter().position(|axis| axis.power() != Power::On);
                DrivePower::Off { axis: off.map_or(0, |index| index as u8 + 1) }
            }
        };
    }

    fn failure(&self, AxisError { axis, cause }: AxisError) -> DriveError {
        let lag =
            axis.checked_sub(1).and_then(|index| self.axes.axes().get(index)).map(Axis::following_error);
        let axis = axis as u8;
        match cause {
            Cause::Fault(ErrorCode::FOLLOWING_ERROR) => DriveError::FollowingError {
                axis,
                away: f64::from(lag.unwrap_or(0)) / DrivesOfSetup::INCREMENTS,
                allowed: self.following_error,
            },
            Cause::Fault(ErrorCode(code)) => DriveError::Fault { axis, code },
            Cause::QuickStop | Cause::SwitchedOff => DriveError::Stopped { axis },
        }
    }
}

/// Returns the drives of a robot whose joints stand at home.
fn configs(config: &RobotConfig) -> Vec<DriveConfig> {
    let RobotConfig { arm, home, servo, .. } = config;
    let limits = arm.limits();
    let config = |axis: usize| {
        let acceleration = limits.acceleration[axis] * DrivesOfSetup::INCREMENTS;
        DriveConfig {
            serial_number: axis as u32 + 1,
            position: increments(home[axis]),
            max_speed: limits.speed[axis] * servo.speed * DrivesOfSetup::INCREMENTS,
            acceleration,
            // `as` saturates: what is too much for a register is as much as it takes.
            window: (servo.following_error * DrivesOfSetup::INCREMENTS) as u32,
            window_time: servo.following_error_for.as_millis() as u16,
            max_torque: (servo.torque * 1e3) as u16,
            deceleration: acceleration as u32,
        }
    };
    (0..arm.axes()).map(config).collect()
}

/// Returns the nearest increment to a joint in degrees (mm).
fn increments(joint: f64) -> i32 {
    // `as` saturates; a setup's joints are within its range.
    (joint * DrivesOfSetup::INCREMENTS).round() as i32
}
