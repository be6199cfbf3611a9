//! Configuration of an arm at a Cartesian target, which selects one of several ways to reach it.

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
    /// Status, 0..=7. The image has six bits for it; a robot refuses those that it does not have.
    pub status: u8,
    /// Turn: the signs of the joints. Without one each joint turns as little as possible.
    pub turn: Option<u8>,
}

impl Configuration {
    /// Bit of the status byte that says that a configuration is given.
    const GIVEN: u8 = 0x80;

    /// Bit of the status byte that says that it has no turn.
    const ANY_TURN: u8 = 0x40;

    /// Highest status that the image carries.
    pub const HIGHEST_STATUS: u8 = Self::ANY_TURN - 1;

    /// Parses the two bytes; none if bit 7 of the first is clear.
    pub(super) const fn from_bytes([status, turn]: [u8; 2]) -> Option<Self> {
        if status & Self::GIVEN == 0 {
            return None;
        }
        let turn = if status & Self::ANY_TURN == 0 { Some(turn) } else { None };
        Some(Self { status: status & Self::HIGHEST_STATUS, turn })
    }

    /// Returns the two bytes.
    pub(super) const fn to_bytes(configuration: Option<Self>) -> [u8; 2] {
        match configuration {
            Some(Self { status, turn: Some(turn) }) => [Self::GIVEN | status & Self::HIGHEST_STATUS, turn],
            Some(Self { status, turn: None }) => {
                [Self::GIVEN | Self::ANY_TURN | status & Self::HIGHEST_STATUS, 0]
            }
            None => [0; 2],
        }
    }
}

impl fmt::Display for Configuration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "status {}", self.status)?;
        self.turn.map_or(Ok(()), |turn| write!(f, ", turn {turn}"))
    }
}
