//! The application layer's state machine (ETG.1000.6, 6.4; ETG.1020).

mod status_code;

use core::fmt;

pub use status_code::AlStatusCode;

/// The error indication in AL status, and the acknowledgement in AL control.
const ERROR: u16 = 0x10;

/// State of a SubDevice. States with process data are greater than those without.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub enum AlState {
    /// No mailbox, no process data.
    Init = 1,
    /// Mailbox.
    PreOp = 2,
    /// Mailbox, for files only.
    Boot = 3,
    /// Mailbox and inputs; outputs stay safe.
    SafeOp = 4,
    /// Mailbox, inputs and outputs.
    Op = 8,
}

impl AlState {
    const fn from_control(control: u16) -> Option<Self> {
        Some(match control & 0x0F {
            1 => Self::Init,
            2 => Self::PreOp,
            3 => Self::Boot,
            4 => Self::SafeOp,
            8 => Self::Op,
            _ => return None,
        })
    }

    /// Returns whether one request leads from this state to another.
    const fn leads_to(self, to: Self) -> bool {
        use AlState::{Boot, Init, Op, PreOp, SafeOp};
        matches!(
            (self, to),
            (_, Init)
                | (Init, PreOp | Boot)
                | (PreOp, PreOp | SafeOp)
                | (Boot, Boot)
                | (SafeOp | Op, PreOp | SafeOp | Op)
        )
    }
}

impl fmt::Display for AlState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Init => "INIT",
            Self::PreOp => "PRE-OP",
            Self::Boot => "BOOT",
            Self::SafeOp => "SAFE-OP",
            Self::Op => "OP",
        })
    }
}

/// State and error indication.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct StateMachine {
    state: AlState,
    error: AlStatusCode,
}

impl StateMachine {
    pub(crate) const fn new() -> Self {
        Self { state: AlState::Init, error: AlStatusCode::NO_ERROR }
    }

    pub(crate) const fn state(&self) -> AlState {
        self.state
    }

    /// Returns the error that is indicated, or `NO_ERROR`.
    pub(crate) const fn error(&self) -> AlStatusCode {
        self.error
    }

    /// Returns the AL status.
    pub(crate) fn status(&self) -> u8 {
        self.state as u8 | if self.error == AlStatusCode::NO_ERROR { 0 } else { ERROR as u8 }
    }

    /// Follows a request of the MainDevice for a state other than INIT, also for the present one, if `check` returns that
    /// the device is configured for it. A device that refuses a request falls to a state that it is configured for, and
    /// from OP in any case to SAFE-OP: a device that indicates an error does not follow outputs.
    pub(crate) fn request(&mut self, control: u16, check: impl FnOnce(AlState) -> Result<(), AlStatusCode>) {
        let acknowledged = control & ERROR != 0;
        let wanted = AlState::from_control(control);
        let failed = self.error != AlStatusCode::NO_ERROR;
        // The MainDevice has to acknowledge first, whichever state it wants. INIT alone needs no acknowledgement.
        if failed && !acknowledged && wanted != Some(AlState::Init) {
            return;
        }
        let result = match wanted {
            None => Err(AlStatusCode::UNKNOWN_STATE),
            Some(wanted) if !self.state.leads_to(wanted) => Err(AlStatusCode::INVALID_STATE_CHANGE),
            Some(AlState::Init) => Ok(AlState::Init),
            Some(wanted) => check(wanted).map(|()| wanted),
        };
        match result {
            Ok(state) => (self.state, self.error) = (state, AlStatusCode::NO_ERROR),
            Err(error) => self.fail(error.highest_state(), error),
        }
    }

    /// Falls to a state with an error.
    pub(crate) fn fail(&mut self, state: AlState, error: AlStatusCode) {
        self.state = self.state.min(state);
        self.error = error;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn machine_in(state: AlState) -> StateMachine {
        StateMachine { state, error: AlStatusCode::NO_ERROR }
    }

    #[test]
    fn the_way_to_each_state_but_init_is_checked_and_a_device_whose_outputs_do_not_fit_falls_to_pre_op() {
        use AlState::{Init, Op, PreOp, SafeOp};
        let request = |from, to: AlState| {
            let mut machine = machine_in(from);
            machine.request(to as u16, |_| Err(AlStatusCode::INVALID_OUTPUTS));
            (machine.state(), machine.error())
        };
        for from in [Init, PreOp, SafeOp, Op] {
            assert_eq!(request(from, Init), (Init, AlStatusCode::NO_ERROR), "{from:?}");
        }
        for (from, to) in [(Init, PreOp), (PreOp, PreOp), (PreOp, SafeOp), (SafeOp, SafeOp), (SafeOp, Op)] {
            let refused = (from.min(PreOp), AlStatusCode::INVALID_OUTPUTS);
            assert_eq!(request(from, to), refused, "{from:?} to {to:?}");
        }
        for (from, to) in [(Op, Op), (Op, SafeOp), (Op, PreOp), (SafeOp, PreOp)] {
            assert_eq!(request(from, to), (PreOp, AlStatusCode::INVALID_OUTPUTS), "{from:?} to {to:?}");
        }
    }

    #[test]
    fn every_pair_of_states_is_allowed_or_refused_as_in_the_standards_table() {
        use AlState::{Boot, Init, Op, PreOp, SafeOp};
        let allowed = [
            (Init, &[Init, PreOp, Boot][..]),
            (PreOp, &[Init, PreOp, SafeOp]),
            (Boot, &[Init, Boot]),
            (SafeOp, &[Init, PreOp, SafeOp, Op]),
            (Op, &[Init, PreOp, SafeOp, Op]),
        ];
        for (from, allowed) in allowed {
            for to in [Init, PreOp, Boot, SafeOp, Op] {
                let mut machine = machine_in(from);
                machine.request(to as u16, |_| Ok(()));
                let expected = if allowed.contains(&to) { to as u8 } else { from.min(SafeOp) as u8 | 0x10 };
                assert_eq!(machine.status(), expected, "{from} to {to}");
            }
        }
    }

    #[test]
    fn a_device_in_op_leaves_it_for_safe_op_at_each_request_that_it_refuses() {
        for control in (0..=0x0F_u16).chain(0x10..=0x1F) {
            let code = match control & 0x0F {
                1 | 2 | 4 | 8 => continue,
                3 => AlStatusCode::INVALID_STATE_CHANGE,
                _ => AlStatusCode::UNKNOWN_STATE,
            };
            let mut machine = machine_in(AlState::Op);
            machine.request(control, |_| Ok(()));
            assert_eq!((machine.status(), machine.error()), (0x14, code), "0x{control:02X}");
        }
    }

    #[test]
    fn after_an_error_a_higher_state_needs_an_acknowledgement_first() {
        let mut machine = machine_in(AlState::Op);
        machine.fail(AlState::SafeOp, AlStatusCode::WATCHDOG);
        assert_eq!(machine.status(), 0x14);
        machine.request(0x08, |_| Ok(()));
        assert_eq!(machine.status(), 0x14);
        machine.request(0x18, |_| Ok(()));
        assert_eq!((machine.status(), machine.error()), (0x08, AlStatusCode::NO_ERROR));
    }

    #[test]
    fn after_an_error_the_same_or_a_lower_state_is_no_acknowledgement_but_init_is() {
        for (control, expected) in
            [(0x04, 0x14), (0x02, 0x14), (0x03, 0x14), (0x06, 0x14), (0x01, 0x01), (0x14, 0x04), (0x12, 0x02)]
        {
            let mut machine = machine_in(AlState::Op);
            machine.fail(AlState::SafeOp, AlStatusCode::WATCHDOG);
            machine.request(control, |_| Ok(()));
            assert_eq!(machine.status(), expected, "0x{control:02X}");
        }
    }

    #[test]
    fn a_state_that_does_not_exist_is_refused() {
        let mut machine = machine_in(AlState::PreOp);
        machine.request(0x06, |_| Ok(()));
        assert_eq!((machine.status(), machine.error()), (0x12, AlStatusCode::UNKNOWN_STATE));
    }
}
