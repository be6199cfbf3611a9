//! The power state machine of a drive, its control word and its status word (IEC 61800-7-201, CiA 402-2).
//!
//! ```text
//! control word, 0x6040                    status word, 0x6041
//! bit 0  switch on                        bit 0  ready to switch on    bit 6   switch on disabled
//! bit 1  enable voltage                   bit 1  switched on           bit 9   remote
//! bit 2  no quick stop                    bit 2  operation enabled     bit 11  internal limit active
//! bit 3  enable operation                 bit 3  fault                 bit 12  the drive follows its target
//! bit 7  fault reset, on its edge         bit 4  voltage enabled       bit 13  following error
//!                                         bit 5  no quick stop
//! ```

/// Control words.
pub mod control {
    /// Leads to ready to switch on.
    pub const SHUTDOWN: u16 = 0x0006;
    /// Leads to switched on.
    pub const SWITCH_ON: u16 = 0x0007;
    /// Leads to operation enabled.
    pub const ENABLE_OPERATION: u16 = 0x000F;
    /// Leads to quick stop active.
    pub const QUICK_STOP: u16 = 0x0002;
    /// Leads to switch on disabled.
    pub const DISABLE_VOLTAGE: u16 = 0x0000;
    /// Bit 7: ends a fault when it changes from 0 to 1.
    pub const FAULT_RESET: u16 = 0x0080;
}

/// What a control word requests by its bits 0 to 3. Bit 7 is handled separately.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Command {
    /// Bit 1 is 0.
    DisableVoltage,
    /// Bit 2 is 0.
    QuickStop,
    /// Bit 0 is 0.
    Shutdown,
    /// Bits 0 to 2 are 1. In operation enabled it disables the operation.
    SwitchOn,
    /// Bits 0 to 3 are 1.
    EnableOperation,
}

impl Command {
    /// Returns what a control word requests by its bits 0 to 3.
    #[must_use]
    pub const fn of(control_word: u16) -> Self {
        match control_word & 0x0F {
            word if word & 0b0010 == 0 => Self::DisableVoltage,
            word if word & 0b0100 == 0 => Self::QuickStop,
            word if word & 0b0001 == 0 => Self::Shutdown,
            0b0111 => Self::SwitchOn,
            _ => Self::EnableOperation,
        }
    }
}

/// State of a drive.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub enum State {
    /// Starts.
    #[default]
    NotReadyToSwitchOn,
    /// No voltage; waits for a shutdown.
    SwitchOnDisabled,
    /// Voltage may be switched on.
    ReadyToSwitchOn,
    /// Voltage is on, the motor has no torque.
    SwitchedOn,
    /// The motor follows its target.
    OperationEnabled,
    /// The motor stops, or stands still, by the command quick stop.
    QuickStopActive,
    /// The motor stops because of a fault.
    FaultReactionActive,
    /// Ended by a fault.
    Fault,
}

impl State {
    /// Returns the state that a status word shows; `None` if it shows none.
    #[must_use]
    pub const fn of(status_word: u16) -> Option<Self> {
        Some(match status_word & 0x6F {
            0x27 => Self::OperationEnabled,
            0x23 => Self::SwitchedOn,
            0x21 => Self::ReadyToSwitchOn,
            0x07 => Self::QuickStopActive,
            // In the other states, bit 5 has no meaning.
            word => match word & 0x4F {
                0x00 => Self::NotReadyToSwitchOn,
                0x40 => Self::SwitchOnDisabled,
                0x0F => Self::FaultReactionActive,
                0x08 => Self::Fault,
                _ => return None,
            },
        })
    }

    /// Returns the state's bits of the status word.
    #[must_use]
    pub const fn bits(self) -> u16 {
        match self {
            Self::NotReadyToSwitchOn => 0x00,
            Self::SwitchOnDisabled => 0x40,
            Self::ReadyToSwitchOn => 0x21,
            Self::SwitchedOn => 0x23,
            Self::OperationEnabled => 0x27,
            Self::QuickStopActive => 0x07,
            Self::FaultReactionActive => 0x0F,
            Self::Fault => 0x08,
        }
    }

    /// Returns whether voltage is on.
    #[must_use]
    pub const fn has_voltage(self) -> bool {
        matches!(
            self,
            Self::SwitchedOn | Self::OperationEnabled | Self::QuickStopActive | Self::FaultReactionActive
        )
    }
}

/// A status word.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct StatusWord(pub u16);

impl StatusWord {
    /// Bit 4: voltage is on.
    pub const VOLTAGE: u16 = 1 << 4;
    /// Bit 9: the drive takes commands from the bus.
    pub const REMOTE: u16 = 1 << 9;
    /// Bit 11: the drive cannot follow because of a limit of its own.
    pub const LIMIT: u16 = 1 << 11;
    /// Bit 12: the drive follows its target.
    pub const FOLLOWS: u16 = 1 << 12;
    /// Bit 13: the following error is outside of its window.
    pub const FOLLOWING_ERROR: u16 = 1 << 13;

    /// Returns the state; `None` for a word that shows none.
    #[must_use]
    pub const fn state(self) -> Option<State> {
        State::of(self.0)
    }

    /// Returns whether these bits are set.
    #[must_use]
    pub const fn has(self, bits: u16) -> bool {
        self.0 & bits == bits
    }
}

/// Mode of operation, objects 0x6060 and 0x6061.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub enum Mode {
    /// No mode that the drive has.
    #[default]
    None,
    /// Cyclic synchronous position.
    CyclicSynchronousPosition,
}

impl Mode {
    /// Returns the mode of a number; the drive has no others.
    #[must_use]
    pub const fn of(number: i8) -> Self {
        if number == 8 { Self::CyclicSynchronousPosition } else { Self::None }
    }

    /// Returns the mode's number.
    #[must_use]
    pub const fn number(self) -> i8 {
        match self {
            Self::None => 0,
            Self::CyclicSynchronousPosition => 8,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_control_word_asks_for_what_the_table_says() {
        for high in [0, 0x0010, 0x0080, 0xFF00] {
            for low in 0..16_u16 {
                let expected = match low {
                    0b0110 | 0b1110 => Command::Shutdown,
                    0b0111 => Command::SwitchOn,
                    0b1111 => Command::EnableOperation,
                    _ if low & 0b0010 == 0 => Command::DisableVoltage,
                    _ => Command::QuickStop,
                };
                assert_eq!(Command::of(high | low), expected, "{low:04b}");
            }
        }
    }

    #[test]
    fn a_status_word_shows_the_state_that_it_was_made_of_and_no_other() {
        use State::{
            Fault, FaultReactionActive, NotReadyToSwitchOn, OperationEnabled, QuickStopActive,
            ReadyToSwitchOn, SwitchOnDisabled, SwitchedOn,
        };
        let all = [
            NotReadyToSwitchOn,
            SwitchOnDisabled,
            ReadyToSwitchOn,
            SwitchedOn,
            OperationEnabled,
            QuickStopActive,
            FaultReactionActive,
            Fault,
        ];
        for state in all {
            for others in [0, StatusWord::VOLTAGE, StatusWord::REMOTE | StatusWord::FOLLOWS, 0x8080] {
                assert_eq!(State::of(state.bits() | others), Some(state));
            }
        }
        assert_eq!(State::of(0x0001), None, "ready to switch on without bit 5");
        assert_eq!(State::of(0x006F), None);
    }
}
