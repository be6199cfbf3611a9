//! Configuration of an arm at a Cartesian target, which it can reach in several ways.

use core::fmt;

/// Status and turn of a Cartesian target, as in KUKA's controllers; ABB's `confdata` has the same content.
///
/// | bit of the status | set where |
/// |---|---|
/// | 0 | the wrist centre is behind axis 1 (six axes) |
/// | 1 | the forearm is bent forward against the upper arm (six axes); axis 2 is at 0° or above (SCARA) |
/// | 2 | axis 5 is at 0° or above in the model of the setup's kinematics (six axes) |
///
/// Bit i of the turn is set where axis i + 1 is below 0°. Status and turn determine the joints, except where two values of
/// a joint that differ by a whole turn have the same sign: the robot then takes the nearer one.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug)]
pub struct Configuration {
    /// Status, 0..=7. The image has seven bits for it; a robot refuses those that it does not have.
    pub status: u8,
    /// Turn: the signs of the joints.
    pub turn: u8,
}

impl Configuration {
    /// Bit of the status byte that says that a configuration is given.
    const GIVEN: u8 = 0x80;

    /// Parses the two bytes; none if bit 7 of the first is clear.
    pub(super) const fn from_bytes([status, turn]: [u8; 2]) -> Option<Self> {
        if status & Self::GIVEN == 0 { None } else { Some(Self { status: status & !Self::GIVEN, turn }) }
    }

    /// Returns the two bytes.
    pub(super) const fn to_bytes(configuration: Option<Self>) -> [u8; 2] {
        match configuration {
            Some(Self { status, turn }) => [status | Self::GIVEN, turn],
            None => [0; 2],
        }
    }
}

impl fmt::Display for Configuration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "status {}, turn {}", self.status, self.turn)
    }
}
