//! Faults of the robot controller's drives.

use std::time::Duration;

use robot_node::Disturbance;
use setup::Setup;

use super::{Change, FaultError, time};

/// A fault of the drive of one axis.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct DriveFault {
    /// Which axis, from 1.
    axis: u8,
    disturbance: Disturbance,
    at: Duration,
    /// When a shaft is released again; `None` for faults that happen at one moment.
    until: Option<Duration>,
}

impl DriveFault {
    /// Parses a fault from its key and its value, such as `drive-fault` and `3@2s`; `None` for a key of others.
    pub(super) fn parse(key: &str, value: &str) -> Option<Result<Self, FaultError>> {
        let disturbance = match key {
            "drive-fault" => Disturbance::Fault,
            "drive-stop" => Disturbance::Stop,
            "drive-block" => Disturbance::Block,
            _ => return None,
        };
        Some(Self::of(disturbance, value))
    }

    fn of(disturbance: Disturbance, value: &str) -> Result<Self, FaultError> {
        let unknown = || FaultError::Axis(value.to_owned());
        let (axis, when) = value.split_once('@').ok_or_else(unknown)?;
        let axis = axis.parse().ok().filter(|axis| *axis > 0).ok_or_else(unknown)?;
        let (at, until) = match when.split_once("..") {
            Some((at, until)) if disturbance == Disturbance::Block => (time(at)?, Some(time(until)?)),
            _ => (time(when)?, None),
        };
        if until.is_some_and(|until| until <= at) {
            return Err(FaultError::Backwards(value.to_owned()));
        }
        Ok(Self { axis, disturbance, at, until })
    }

    /// Returns when it begins.
    pub(super) const fn at(self) -> Duration {
        self.at
    }

    /// Returns what it changes, and when.
    pub(super) fn changes(self) -> Vec<(Duration, Change)> {
        let Self { axis, disturbance, at, until } = self;
        let release = until.map(|until| (until, Change::Drive(axis, Disturbance::Release)));
        [(at, Change::Drive(axis, disturbance))].into_iter().chain(release).collect()
    }

    /// Checks that the setup has such a drive.
    ///
    /// # Errors
    ///
    /// It has none, or fewer axes.
    pub(super) fn check(self, setup: &Setup) -> Result<(), NoSuchDrive> {
        let axes = setup.robot.axes.lower_deg.value.len();
        match setup.robot.drives {
            None => Err(NoSuchDrive::NoDrives { setup: setup.name.clone() }),
            Some(_) if usize::from(self.axis) > axes => Err(NoSuchDrive::Axis { axis: self.axis, axes }),
            Some(_) => Ok(()),
        }
    }
}

/// A fault of a drive that the robot does not have.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum NoSuchDrive {
    /// The joints of the setup have no drives.
    #[error(
        "drive-fault, drive-stop and drive-block need drives, and setup {setup} has none: add --drives ethercat"
    )]
    NoDrives {
        /// Its name.
        setup: String,
    },
    /// The arm has fewer axes.
    #[error("there is no drive of axis {axis}: this arm has axes 1 to {axes}")]
    Axis {
        /// As asked for.
        axis: u8,
        /// Those of the arm.
        axes: usize,
    },
}
