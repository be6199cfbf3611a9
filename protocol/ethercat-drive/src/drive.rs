//! An emulated drive: power state machine, cyclic synchronous position, following error, quick stop, faults.

use machine::Duration;

use crate::error_code::ErrorCode;
use crate::motor::Motor;
use crate::process_data::{Inputs, Outputs};
use crate::state::{Command, Mode, State, StatusWord, control};

/// What a drive does at a quick stop, object 0x605A.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum QuickStop {
    /// 0: takes the torque away at once, then switch on disabled.
    Disable,
    /// 1 and 2: brakes, then switch on disabled.
    Brake,
    /// 5 and 6: brakes and stays in quick stop active.
    BrakeAndStay,
}

impl QuickStop {
    /// Returns what an option code means. For a code that only the owner of the drive can set, it brakes by its ramp.
    #[must_use]
    pub const fn of(code: i16) -> Self {
        match code {
            0 => Self::Disable,
            5 | 6 => Self::BrakeAndStay,
            _ => Self::Brake,
        }
    }

    /// Returns the state that it leads to.
    const fn state(self) -> State {
        match self {
            Self::Disable => State::SwitchOnDisabled,
            Self::Brake | Self::BrakeAndStay => State::QuickStopActive,
        }
    }
}

/// Settings of a drive, by SDO.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Parameters {
    /// Largest following error in increments; `None` for any (0xFFFFFFFF in object 0x6065).
    pub window: Option<u32>,
    /// Time outside of the window after which the drive has a fault.
    pub window_time: Duration,
    /// What happens at a quick stop.
    pub quick_stop: QuickStop,
    /// Deceleration of a quick stop and of a fault, in increments/s². The torque limits it, too.
    pub deceleration: f64,
    /// Largest torque as a share of the rated one.
    pub torque: f64,
}

/// A drive.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Drive {
    state: State,
    mode: Mode,
    motor: Motor,
    /// Acceleration at rated torque, in increments/s².
    acceleration: f64,
    error: ErrorCode,
    /// The following error with which a following error became a fault, in increments.
    fault_lag: i32,
    /// The cause of a fault, while the cause lasts.
    cause: ErrorCode,
    /// Time that the following error has been outside of its window.
    outside: Duration,
    reset_before: bool,
    /// The command before this one.
    command: Command,
    /// Time from one target to the next.
    period: Duration,
    /// Speed before the last cycle, in increments/s, and the time of that cycle.
    cycle_before: (f64, Duration),
}

impl Drive {
    /// Creates a drive whose motor stands at `position`, turns at most at `max_speed`, in increments/s, and reaches this
    /// `acceleration` at rated torque, in increments/s². A new target comes each `period`.
    #[must_use]
    pub const fn new(position: i32, max_speed: f64, acceleration: f64, period: Duration) -> Self {
        Self {
            state: State::NotReadyToSwitchOn,
            mode: Mode::None,
            motor: Motor::new(position, max_speed),
            acceleration,
            error: ErrorCode::NONE,
            fault_lag: 0,
            cause: ErrorCode::NONE,
            outside: Duration::ZERO,
            reset_before: false,
            command: Command::DisableVoltage,
            period,
            cycle_before: (0.0, Duration::ZERO),
        }
    }

    /// Returns the state.
    #[must_use]
    pub const fn state(&self) -> State {
        self.state
    }

    /// Returns the actual position in increments.
    #[must_use]
    pub fn position(&self) -> i32 {
        self.motor.position()
    }

    /// Returns where the shaft should be now, in increments, object 0x6062.
    #[must_use]
    pub fn position_demand(&self) -> i32 {
        self.motor.demand()
    }

    /// Returns the actual velocity in increments/s, object 0x606C.
    #[must_use]
    pub const fn velocity(&self) -> i32 {
        // `as` saturates.
        self.motor.speed() as i32
    }

    /// Returns the actual torque in ‰ of the rated torque, object 0x6077: what accelerated the motor in the last cycle.
    #[must_use]
    pub fn torque(&self) -> i16 {
        let (speed, time) = self.cycle_before;
        if time.is_zero() {
            return 0;
        }
        let acceleration = (self.motor.speed() - speed) / time.as_secs_f64();
        (1e3 * acceleration / self.acceleration) as i16
    }

    /// Returns the time from one target to the next.
    #[must_use]
    pub const fn period(&self) -> Duration {
        self.period
    }

    /// Sets the time from one target to the next, object 0x60C2.
    pub const fn set_period(&mut self, period: Duration) {
        self.period = period;
    }

    /// Blocks the shaft, or releases it.
    pub const fn block(&mut self, blocked: bool) {
        self.motor.blocked = blocked;
    }

    /// Starts a cause of a fault. [`ErrorCode::NONE`] ends the cause, so that a fault reset is possible.
    pub const fn set_cause(&mut self, cause: ErrorCode) {
        self.cause = cause;
    }

    /// Causes a fault whose cause ends at once.
    pub fn trip(&mut self, error: ErrorCode) {
        self.fail(error);
    }

    /// Stops the drive as one of its own inputs does: by a quick stop without a command.
    pub fn stop(&mut self, quick_stop: QuickStop) {
        if self.state == State::OperationEnabled {
            self.state = quick_stop.state();
        }
    }

    /// Runs the drive for `time`. `outputs` are the controller's last ones, `None` while the device is not in OP.
    pub fn cycle(&mut self, time: Duration, outputs: Option<&Outputs>, parameters: &Parameters) {
        self.cycle_before = (self.motor.speed(), time);
        self.look_for_faults(outputs.is_none());
        if let Some(outputs) = outputs {
            // 0 changes nothing (IEC 61800-7-201, 0x6060).
            if outputs.mode != 0 {
                self.mode = Mode::of(outputs.mode);
            }
            self.follow_command(outputs, parameters);
        } else {
            (self.reset_before, self.command) = (false, Command::DisableVoltage);
            self.start();
        }
        self.turn(time, outputs, parameters);
    }

    /// Returns what the controller reads.
    #[must_use]
    pub fn inputs(&self) -> Inputs {
        let follows = self.state == State::OperationEnabled && self.mode == Mode::CyclicSynchronousPosition;
        let mut word = self.state.bits() | StatusWord::REMOTE;
        for (bit, is_set) in [
            (StatusWord::VOLTAGE, self.state.has_voltage()),
            (StatusWord::LIMIT, follows && self.motor.is_limited()),
            (StatusWord::FOLLOWS, follows),
            (
                StatusWord::FOLLOWING_ERROR,
                !self.outside.is_zero() || self.error == ErrorCode::FOLLOWING_ERROR,
            ),
        ] {
            word |= if is_set { bit } else { 0 };
        }
        Inputs {
            status_word: StatusWord(word),
            position: self.position(),
            following_error: self.following_error(),
            error: self.error,
            mode: self.mode.number(),
        }
    }

    /// Returns position demand minus actual position, object 0x60F4. After a following error it stays until the reset: the
    /// fault ends the demand, and its cause would be lost.
    fn following_error(&self) -> i32 {
        if self.error == ErrorCode::FOLLOWING_ERROR { self.fault_lag } else { self.motor.following_error() }
    }

    /// Returns the highest acceleration that the torque gives, in increments/s².
    fn most_acceleration(&self, parameters: &Parameters) -> f64 {
        self.acceleration * parameters.torque
    }

    /// Leaves the state in which the drive starts.
    fn start(&mut self) {
        if self.state == State::NotReadyToSwitchOn {
            self.state = State::SwitchOnDisabled;
        }
    }

    fn look_for_faults(&mut self, is_alone: bool) {
        let runs = matches!(self.state, State::SwitchedOn | State::OperationEnabled | State::QuickStopActive);
        if self.cause != ErrorCode::NONE {
            self.fail(self.cause);
        } else if runs && is_alone {
            self.fail(ErrorCode::COMMUNICATION);
        }
    }

    fn fail(&mut self, error: ErrorCode) {
        if !matches!(self.state, State::FaultReactionActive | State::Fault) {
            self.error = error;
            self.state = if self.motor.stands_still() { State::Fault } else { State::FaultReactionActive };
        }
    }

    fn follow_command(&mut self, outputs: &Outputs, parameters: &Parameters) {
        let reset = outputs.control_word & control::FAULT_RESET != 0;
        let reset_before = core::mem::replace(&mut self.reset_before, reset);
        let edge = reset && !reset_before;
        let command = Command::of(outputs.control_word);
        // A drive that stopped without a command does not go on with the command that it had.
        let is_new = core::mem::replace(&mut self.command, command) != command;
        self.state = match (self.state, command) {
            (State::NotReadyToSwitchOn, _) => State::SwitchOnDisabled,
            (State::Fault, _) if edge && self.cause == ErrorCode::NONE => {
                self.error = ErrorCode::NONE;
                State::SwitchOnDisabled
            }
            (state @ (State::Fault | State::FaultReactionActive), _) => state,
            (_, Command::DisableVoltage) => State::SwitchOnDisabled,
            (State::OperationEnabled, Command::QuickStop) => parameters.quick_stop.state(),
            (State::QuickStopActive, Command::EnableOperation)
                if is_new && parameters.quick_stop == QuickStop::BrakeAndStay =>
            {
                State::OperationEnabled
            }
            (State::QuickStopActive, _) => State::QuickStopActive,
            (_, Command::QuickStop) => State::SwitchOnDisabled,
            (State::SwitchOnDisabled, Command::Shutdown) => State::ReadyToSwitchOn,
            (State::SwitchOnDisabled, _) => State::SwitchOnDisabled,
            (_, Command::Shutdown) => State::ReadyToSwitchOn,
            // One transition in each cycle: on the way to operation enabled, the drive passes switched on.
            (State::ReadyToSwitchOn, Command::SwitchOn | Command::EnableOperation) => State::SwitchedOn,
            (_, Command::SwitchOn) => State::SwitchedOn,
            (_, Command::EnableOperation) => State::OperationEnabled,
        };
    }

    /// Moves the motor as the state requires.
    fn turn(&mut self, time: Duration, outputs: Option<&Outputs>, parameters: &Parameters) {
        match (self.state, outputs) {
            (State::OperationEnabled, Some(outputs)) if self.mode == Mode::CyclicSynchronousPosition => {
                self.motor.follow(outputs.target, self.period, time, self.most_acceleration(parameters));
                self.watch_following_error(time, parameters);
                return;
            }
            (State::OperationEnabled | State::QuickStopActive | State::FaultReactionActive, _) => {
                let most = self.most_acceleration(parameters);
                self.motor.brake(parameters.deceleration.min(most), time);
                if self.motor.stands_still() {
                    self.state = match self.state {
                        State::FaultReactionActive => State::Fault,
                        State::QuickStopActive if parameters.quick_stop == QuickStop::Brake => {
                            State::SwitchOnDisabled
                        }
                        state => state,
                    };
                }
            }
            _ => self.motor.hold(),
        }
        self.outside = Duration::ZERO;
    }

    fn watch_following_error(&mut self, time: Duration, parameters: &Parameters) {
        let is_outside =
            parameters.window.is_some_and(|window| self.following_error().unsigned_abs() > window);
        self.outside = if is_outside { self.outside + time } else { Duration::ZERO };
        if self.outside > parameters.window_time {
            self.fault_lag = self.motor.following_error();
            self.fail(ErrorCode::FOLLOWING_ERROR);
        }
    }
}
