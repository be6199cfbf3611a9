//! The controller's side of one drive: the control words that lead it to the wanted state.

use crate::error_code::ErrorCode;
use crate::process_data::{Inputs, Outputs};
use crate::state::{Mode, State, control};

/// What a controller wants its drives to do.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub enum Wanted {
    /// No voltage.
    #[default]
    Off,
    /// To follow targets.
    On,
    /// To stop as fast as they can.
    QuickStop,
    /// To leave a fault; then no voltage.
    Reset,
}

/// What a drive does.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub enum Power {
    /// Without torque.
    #[default]
    Off,
    /// It follows targets.
    On,
    /// It brakes.
    Stopping,
    /// It has a fault.
    Fault(ErrorCode),
}

/// One drive, for its controller.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub struct Axis {
    power: Power,
    /// As its last inputs show it.
    state: Option<State>,
    position: i32,
    following_error: i32,
    sent: u16,
}

impl Axis {
    /// Returns what the drive does, according to its last inputs.
    #[must_use]
    pub const fn power(&self) -> Power {
        self.power
    }

    /// Returns the actual position in increments.
    #[must_use]
    pub const fn position(&self) -> i32 {
        self.position
    }

    /// Returns target less actual position in increments.
    #[must_use]
    pub const fn following_error(&self) -> i32 {
        self.following_error
    }

    /// Takes what a drive reports.
    pub fn receive(&mut self, inputs: &Inputs) {
        (self.position, self.following_error) = (inputs.position, inputs.following_error);
        self.state = inputs.status_word.state();
        let follows = Mode::of(inputs.mode) == Mode::CyclicSynchronousPosition;
        self.power = match self.state {
            Some(State::OperationEnabled) if follows => Power::On,
            Some(State::QuickStopActive) => Power::Stopping,
            Some(State::FaultReactionActive | State::Fault) => Power::Fault(inputs.error),
            _ => Power::Off,
        };
    }

    /// Returns the next process data. The target is sent once the drive is on; before that, the drive's own position.
    pub fn send(&mut self, wanted: Wanted, target: i32) -> Outputs {
        self.sent = self.control_word(wanted);
        let target = if self.power == Power::On { target } else { self.position };
        Outputs { control_word: self.sent, target, mode: Mode::CyclicSynchronousPosition.number() }
    }

    const fn control_word(&self, wanted: Wanted) -> u16 {
        match (wanted, self.state) {
            (Wanted::On, Some(State::SwitchOnDisabled)) => control::SHUTDOWN,
            (Wanted::On, Some(State::ReadyToSwitchOn)) => control::SWITCH_ON,
            (Wanted::On, Some(State::SwitchedOn | State::OperationEnabled)) => control::ENABLE_OPERATION,
            (Wanted::QuickStop, Some(State::OperationEnabled | State::QuickStopActive)) => {
                control::QUICK_STOP
            }
            // Only a rising edge of this bit resets a fault.
            (Wanted::Reset, Some(State::Fault)) if self.sent & control::FAULT_RESET == 0 => {
                control::FAULT_RESET
            }
            _ => control::DISABLE_VOLTAGE,
        }
    }
}
