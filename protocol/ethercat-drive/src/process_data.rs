//! Process data of a drive.
//!
//! ```text
//! outputs, RxPDO 0x1600                       inputs, TxPDO 0x1A00
//! 0..2  control word, 0x6040                  0..2    status word, 0x6041
//! 2..6  target position, 0x607A               2..6    actual position, 0x6064
//! 6     mode of operation, 0x6060             6..10   actual following error, 0x60F4
//! 7     gap                                   10..12  error code, 0x603F
//!                                             12      mode in use, 0x6061
//!                                             13      gap
//! ```

use crate::error_code::ErrorCode;
use crate::state::StatusWord;

/// Bytes from the controller to a drive.
pub const OUTPUT_LEN: usize = 8;

/// Bytes from a drive to the controller.
pub const INPUT_LEN: usize = 14;

/// Process data from the controller to a drive. Positions are in increments.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct Outputs {
    /// Object 0x6040.
    pub control_word: u16,
    /// Object 0x607A.
    pub target: i32,
    /// Object 0x6060.
    pub mode: i8,
}

impl Outputs {
    /// Reads them from process data; `None` if these have another length.
    #[must_use]
    pub fn parse(bytes: &[u8]) -> Option<Self> {
        let [a, b, c, d, e, f, mode, _] = *<&[u8; OUTPUT_LEN]>::try_from(bytes).ok()?;
        Some(Self {
            control_word: u16::from_le_bytes([a, b]),
            target: i32::from_le_bytes([c, d, e, f]),
            mode: mode as i8,
        })
    }

    /// Returns them as process data.
    #[must_use]
    pub const fn bytes(self) -> [u8; OUTPUT_LEN] {
        let ([a, b], [c, d, e, f]) = (self.control_word.to_le_bytes(), self.target.to_le_bytes());
        [a, b, c, d, e, f, self.mode as u8, 0]
    }
}

/// Process data from a drive to its controller. Positions are in increments.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct Inputs {
    /// Object 0x6041.
    pub status_word: StatusWord,
    /// Object 0x6064.
    pub position: i32,
    /// Object 0x60F4: target less actual position.
    pub following_error: i32,
    /// Object 0x603F.
    pub error: ErrorCode,
    /// Object 0x6061.
    pub mode: i8,
}

impl Inputs {
    /// Reads them from process data; `None` if these have another length.
    #[must_use]
    pub fn parse(bytes: &[u8]) -> Option<Self> {
        let [a, b, c, d, e, f, g, h, i, j, k, l, mode, _] = *<&[u8; INPUT_LEN]>::try_from(bytes).ok()?;
        Some(Self {
            status_word: StatusWord(u16::from_le_bytes([a, b])),
            position: i32::from_le_bytes([c, d, e, f]),
            following_error: i32::from_le_bytes([g, h, i, j]),
            error: ErrorCode(u16::from_le_bytes([k, l])),
            mode: mode as i8,
        })
    }

    /// Returns them as process data.
    #[must_use]
    pub const fn bytes(self) -> [u8; INPUT_LEN] {
        let [a, b] = self.status_word.0.to_le_bytes();
        let [c, d, e, f] = self.position.to_le_bytes();
        let [g, h, i, j] = self.following_error.to_le_bytes();
        let [k, l] = self.error.0.to_le_bytes();
        [a, b, c, d, e, f, g, h, i, j, k, l, self.mode as u8, 0]
    }
}
