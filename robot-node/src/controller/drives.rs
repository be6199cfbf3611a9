//! The drives that the set-points go to, where the arm has some: the arm is where they are, a skill ends once they are
//! where it ends, and where they stop without a command, it ends with an error. Then the controller follows them until
//! they are on again, so that the next motion starts where they stand.
//!
//! No state waits for a drive without a limit: after the set-points rest it must arrive within the settling time, and
//! after a reset all must be on within the time to switch on.

use machine::Instant;
use protocol::image::{ErrorNumber, Finding, State, Status};

use super::{Controller, Ending, RobotEvent};
use crate::arm::{Joints, distance};

/// What the drives report.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct DriveReport {
    /// Where the joints are, in degrees (mm).
    pub joints: Joints,
    /// Whether they follow the set-points.
    pub power: DrivePower,
}

/// Whether drives follow the set-points.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum DrivePower {
    /// Not yet: they are being switched on.
    Off {
        /// The first axis whose drive is off, from 1; 0 without a connection to the drives.
        axis: u8,
    },
    /// They do.
    On,
    /// Not any more, until a reset.
    Failed(DriveError),
}

/// Why drives do not follow any more.
#[derive(Clone, Copy, PartialEq, Debug, thiserror::Error)]
pub enum DriveError {
    /// A drive has a fault.
    #[error("the drive of axis {axis} has the fault 0x{code:04X}")]
    Fault {
        /// Which axis, from 1.
        axis: u8,
        /// Its error code, object 0x603F of CiA 402.
        code: u16,
    },
    /// A drive was too far from its set-points for too long.
    #[error(
        "the drive of axis {axis} was {away:.3}° (mm) from its set-point, and {allowed}° (mm) are allowed"
    )]
    FollowingError {
        /// Which axis, from 1.
        axis: u8,
        /// Position demand minus actual position, in degrees (mm).
        away: f64,
        /// Following error window, in degrees (mm).
        allowed: f64,
    },
    /// A drive did not arrive where its set-points came to rest.
    #[error("the drive of axis {axis} stands {away:.3}° (mm) short of its set-point after the settling time")]
    NotArrived {
        /// Which axis, from 1.
        axis: u8,
        /// Set-point minus actual position, in degrees (mm).
        away: f64,
        /// Window of the exact stop, in degrees (mm).
        allowed: f64,
    },
    /// The drives did not switch on after a reset.
    #[error(
        "the drive of axis {axis} did not switch on in time after a reset (0: no connection to the drives)"
    )]
    NotOn {
        /// Which axis, from 1; 0 without a connection.
        axis: u8,
    },
    /// A drive stopped, or took its torque away, without a command and without a fault.
    #[error("the drive of axis {axis} stopped without a command")]
    Stopped {
        /// Which axis, from 1.
        axis: u8,
    },
    /// There is no connection to the drives any more.
    #[error("the connection to the drives is lost")]
    Lost,
}

impl DriveError {
    /// Returns the axis that it names, from 1; 0 for none.
    const fn axis(self) -> u8 {
        match self {
            Self::Fault { axis, .. }
            | Self::FollowingError { axis, .. }
            | Self::NotArrived { axis, .. }
            | Self::NotOn { axis }
            | Self::Stopped { axis } => axis,
            Self::Lost => 0,
        }
    }

    /// Returns what the feedback image says.
    #[must_use]
    pub fn in_image(self) -> (ErrorNumber, Finding) {
        match self {
            Self::Fault { axis, code } => {
                (ErrorNumber::DriveFault, Finding::new(axis, f32::from(code), 0.0, 0.0))
            }
            Self::FollowingError { axis, away, allowed } => {
                (ErrorNumber::FollowingError, Finding::new(axis, away as f32, 0.0, allowed as f32))
            }
            Self::NotArrived { axis, away, allowed } => {
                (ErrorNumber::DriveNotArrived, Finding::new(axis, away as f32, 0.0, allowed as f32))
            }
            Self::NotOn { axis } => (ErrorNumber::DriveNotOn, Finding::new(axis, 0.0, 0.0, 0.0)),
            Self::Stopped { axis } => (ErrorNumber::DriveStopped, Finding::new(axis, 0.0, 0.0, 0.0)),
            Self::Lost => (ErrorNumber::DrivesLost, Finding::NONE),
        }
    }
}

impl Controller {
    /// Takes what the drives report in answer to the set-points of this cycle. The next tick acts on it.
    pub fn take_drives(&mut self, report: DriveReport) {
        let before = self.drives.replace(report);
        if let Some(before) = before {
            let tool = |joints: &Joints| self.config.arm.forward(joints).origin_of(&self.tool);
            let step_mm = distance(tool(&before.joints), tool(&report.joints));
            self.feedback.path_speed = (step_mm / self.config.cycle.as_secs_f64()) as f32;
        }
        self.feedback.status.set(Status::AT_REST, self.interpolator.is_at_rest() && self.is_in_place());
        self.report_position();
    }

    /// Returns, once, whether the drives are to leave their fault.
    pub const fn take_drive_reset(&mut self) -> bool {
        core::mem::replace(&mut self.resets_drives, false)
    }

    /// Acts on what the drives report.
    pub(super) fn follow_drives(&mut self, at: Instant) {
        let Some(DriveReport { joints, power }) = self.drives else { return };
        let failed = match power {
            DrivePower::Failed(error) => Some(error),
            DrivePower::Off { .. } | DrivePower::On => None,
        };
        let failed_before = core::mem::replace(&mut self.drive_error, failed);
        if let Some(error) = failed
            && failed_before != failed
        {
            self.end_for(error, at);
        }
        if power != DrivePower::On {
            self.interpolator.rest_at(&joints);
            self.away_since = None;
            self.limit_switching_on(power, at);
        } else if self.awaits_drives.take().is_some() {
            self.observer.rest_at(&self.config.arm, &joints);
            self.make_ready();
        }
        if power == DrivePower::On {
            self.limit_settling(at);
        }
    }

    /// Ends a reset whose drives do not switch on in time.
    fn limit_switching_on(&mut self, power: DrivePower, at: Instant) {
        let is_late = |since: Instant| at.since(since) >= self.config.servo.switch_on;
        if self.awaits_drives.is_some_and(is_late) {
            let axis = match power {
                DrivePower::Off { axis } => axis,
                DrivePower::Failed(error) => error.axis(),
                DrivePower::On => 0,
            };
            self.end_for(DriveError::NotOn { axis }, at);
        }
    }

    /// Ends what runs if the set-points rest and a drive has not arrived within the settling time. From then on the arm
    /// is set where it stands, so that a drive that comes free moves nothing.
    fn limit_settling(&mut self, at: Instant) {
        if !self.interpolator.is_at_rest() || self.is_in_place() {
            self.away_since = None;
            return;
        }
        let since = *self.away_since.get_or_insert(at);
        if at.since(since) < self.config.servo.settling {
            return;
        }
        let joints = *self.actual_joints();
        let away = self.interpolator.joints().iter().zip(&joints).map(|(set, actual)| set - actual);
        let farthest = away.enumerate().max_by(|(_, one), (_, other)| one.abs().total_cmp(&other.abs()));
        let (axis, away) = farthest.map_or((0, 0.0), |(index, away)| (index as u8 + 1, away));
        self.away_since = None;
        self.end_for(DriveError::NotArrived { axis, away, allowed: self.config.servo.in_position }, at);
        self.interpolator.rest_at(&joints);
    }

    /// Ends what runs: the drives have stopped the arm already, or are about to.
    fn end_for(&mut self, error: DriveError, at: Instant) {
        let (number, finding) = error.in_image();
        (self.pending, self.press, self.awaits_drives) = (None, None, None);
        self.event(RobotEvent::DrivesFailed(error));
        match self.execution {
            Some(execution) => {
                let motion = self.executed(&execution);
                self.finish(at, &execution, Ending::Fault { error: number, motion, finding });
            }
            None => {
                self.state = State::Halted;
                self.set_error(number, 0, finding);
            }
        }
    }

    /// Returns whether the joints follow what is set.
    pub(super) fn drives_are_on(&self) -> bool {
        self.drives.is_none_or(|drives| drives.power == DrivePower::On)
    }

    /// Returns where the joints are, in degrees (mm).
    pub(super) fn actual_joints(&self) -> &Joints {
        self.drives.as_ref().map_or(self.interpolator.joints(), |drives| &drives.joints)
    }

    /// Returns whether the joints are where they are set.
    pub(super) fn is_in_place(&self) -> bool {
        let places = self.actual_joints().iter().zip(self.interpolator.joints());
        let window = self.config.servo.in_position;
        self.drives.is_none() || places.into_iter().all(|(actual, set)| (actual - set).abs() <= window)
    }
}
