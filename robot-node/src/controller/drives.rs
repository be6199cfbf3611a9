//! The drives that the set-points go to, where the arm has some: the arm is where they are, a skill ends once they are
//! where it ends, and where they stop by themselves, it ends with an error. Then the controller follows them until they
//! are on again, so that the next motion starts where they stand.

use machine::Instant;
use protocol::image::{ErrorNumber, Finding, State, Status};

use super::{Controller, Ending, RobotEvent};
use crate::arm::Joints;
use crate::quality::Observer;

/// Largest distance of a joint from where it is set that counts as there, in degrees (mm).
const IN_PLACE: f64 = 5e-4;

/// What the drives report.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct DriveReport {
    /// Where the joints are, in degrees (mm).
    pub joints: Joints,
    /// Whether they follow the set-points.
    pub power: DrivePower,
}

/// Whether drives follow the set-points.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum DrivePower {
    /// Not yet: they are being switched on.
    Off,
    /// They do.
    On,
    /// Not any more, until a reset.
    Failed(DriveError),
}

/// Why drives do not follow any more.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum DriveError {
    /// A drive has a fault.
    #[error("the drive of axis {axis} has the fault 0x{code:04X}")]
    Fault {
        /// Which axis, from 1.
        axis: u8,
        /// Its error code, object 0x603F of CiA 402.
        code: u16,
    },
    /// A drive stopped, or took its torque away, without a command and without a fault.
    #[error("the drive of axis {axis} stopped by itself")]
    Stopped {
        /// Which axis, from 1.
        axis: u8,
    },
    /// There is no connection to the drives any more.
    #[error("the connection to the drives is lost")]
    Lost,
}

impl DriveError {
    /// Returns what the feedback image says.
    #[must_use]
    pub fn in_image(self) -> (ErrorNumber, Finding) {
        match self {
            Self::Fault { axis, code } => {
                (ErrorNumber::DriveFault, Finding::new(axis, f32::from(code), 0.0, 0.0))
            }
            Self::Stopped { axis } => (ErrorNumber::DriveStopped, Finding::new(axis, 0.0, 0.0, 0.0)),
            Self::Lost => (ErrorNumber::DrivesLost, Finding::NONE),
        }
    }
}

impl Controller {
    /// Takes what the drives report in answer to the set-points of this cycle. The next tick acts on it.
    pub fn take_drives(&mut self, report: DriveReport) {
        self.drives = Some(report);
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
            DrivePower::Off | DrivePower::On => None,
        };
        let failed_before = core::mem::replace(&mut self.drive_error, failed);
        if let Some(error) = failed
            && failed_before != failed
        {
            self.end_for(error, at);
        }
        if power != DrivePower::On {
            self.interpolator.rest_at(&joints);
        } else if core::mem::replace(&mut self.awaits_drives, false) {
            self.observer = Observer::at_rest(&self.config.arm, &joints, self.config.cycle.as_secs_f64());
            self.make_ready();
        }
    }

    /// Ends what runs: the drives have stopped the arm already, or are about to.
    fn end_for(&mut self, error: DriveError, at: Instant) {
        let (number, finding) = error.in_image();
        (self.pending, self.press, self.awaits_drives) = (None, None, false);
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
        self.drives.is_none() || places.into_iter().all(|(actual, set)| (actual - set).abs() <= IN_PLACE)
    }
}
