//! Targets with a configuration: status and turn select one of the ways to reach a pose.

use protocol::image::Configuration;

use super::{Arm, Frame, Joints, Violation};

/// Distance from 0° in degrees within which a joint may count as below 0° or not; single precision on the wire causes
/// less.
const SIGN_TOLERANCE_DEG: f64 = 0.01;

/// Largest difference of joints, in degrees (mm), that belong to one configuration.
const SAME_DEG: f64 = 0.02;

/// Number of whole turns in each direction that are tried: more than any joint has.
const TURNS: i32 = 3;

impl Arm {
    /// Returns the joints for this pose of the flange in a configuration. Where a joint may have values that differ by whole
    /// turns, it has the one next to `near`.
    ///
    /// # Errors
    ///
    /// The arm does not have the configuration, a joint would leave its range, or the pose is out of reach.
    pub fn inverse_in(
        &self,
        flange: &Frame,
        configuration: Configuration,
        near: &Joints,
    ) -> Result<Joints, Violation> {
        self.has(configuration)?;
        let mut joints = self.kinematics.inverse_with(flange, configuration.status, near)?;
        match configuration.turn {
            Some(turn) => {
                for axis in self.turning() {
                    joints[axis] = self.turned(axis, joints[axis], turn & 1 << axis != 0, near[axis])?;
                }
            }
            None => joints = self.turned_least(&joints, near),
        }
        self.within_range(&joints)?;
        Ok(joints)
    }

    /// Refuses a configuration other than that of these joints, in which a path ends.
    ///
    /// # Errors
    ///
    /// [`Violation::Status`] and [`Violation::TurnBits`] where this arm has no such configuration, else
    /// [`Violation::OtherConfiguration`].
    pub fn ends_in(&self, joints: &Joints, configuration: Configuration) -> Result<(), Violation> {
        self.has(configuration)?;
        // Where two configurations meet, the same joints belong to both.
        let same =
            |other: &Joints| joints.iter().zip(other).all(|(one, other)| (one - other).abs() < SAME_DEG);
        let found = self.inverse_in(&self.forward(joints), configuration, joints);
        if found.is_ok_and(|found| same(&found)) {
            return Ok(());
        }
        Err(Violation::OtherConfiguration { wanted: configuration, found: self.configuration(joints) })
    }

    /// Returns the configuration of the arm in these joints.
    #[must_use]
    pub fn configuration(&self, joints: &Joints) -> Configuration {
        let negative = self.turning().filter(|axis| joints[*axis] < 0.0);
        Configuration {
            status: self.kinematics.status(joints),
            turn: Some(negative.fold(0, |turn, axis| turn | 1 << axis)),
        }
    }

    /// Returns the status of each of this arm's configurations.
    pub fn statuses(&self) -> impl Iterator<Item = u8> + use<> {
        let bits = self.kinematics.status_bits();
        (0..=bits).filter(move |status| status & !bits == 0)
    }

    /// Returns the rotary axes.
    fn turning(&self) -> impl Iterator<Item = usize> {
        let rotary = self.rotary;
        (0..self.axes).filter(move |axis| rotary[*axis])
    }

    /// Refuses a status or turn with bits that no configuration of this arm has.
    fn has(&self, Configuration { status, turn }: Configuration) -> Result<(), Violation> {
        let status_bits = self.kinematics.status_bits();
        if status & !status_bits != 0 {
            return Err(Violation::Status { status, bits: status_bits });
        }
        let turn_bits = self.turning().fold(0, |bits, axis| bits | 1 << axis);
        match turn {
            Some(turn) if turn & !turn_bits != 0 => Err(Violation::TurnBits { turn, bits: turn_bits }),
            _ => Ok(()),
        }
    }

    /// Returns the value of a joint, changed by whole turns so that it has this sign and is within its range; of several
    /// such values the one nearest to `near`.
    fn turned(&self, axis: usize, value: f64, is_negative: bool, near: f64) -> Result<f64, Violation> {
        let (lower, upper) = (self.limits.lower[axis], self.limits.upper[axis]);
        let first = value - 360.0 * (value / 360.0).floor();
        let has_sign = |turned: &f64| {
            if is_negative { *turned < SIGN_TOLERANCE_DEG } else { *turned > -SIGN_TOLERANCE_DEG }
        };
        let turned = || (-TURNS..=TURNS).map(|turns| first + 360.0 * f64::from(turns)).filter(has_sign);
        let nearest = |one: &f64, other: &f64| (one - near).abs().total_cmp(&(other - near).abs());
        let within = turned().filter(|turned| (lower - 1e-6..=upper + 1e-6).contains(turned));
        within.min_by(nearest).ok_or_else(|| {
            let least = turned().min_by(|one, other| one.abs().total_cmp(&other.abs()));
            Violation::Turn { axis: axis as u8 + 1, value: least.unwrap_or(value), lower, upper }
        })
    }
}
