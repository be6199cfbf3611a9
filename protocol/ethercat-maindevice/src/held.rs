//! Devices that are held in SAFE-OP, and let go to OP.

use ethercrab::{MainDevice, SubDeviceState};
use machine::Instant;

use crate::al::{self, REQUEST_OP, REQUEST_SAFE_OP};
use crate::process::PROCESS;
use crate::recovery::TO_OP;
use crate::time;

/// Place of the devices between SAFE-OP and OP.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum HeldStage {
    /// They are on their way to OP, or there.
    Op,
    /// They are held in SAFE-OP.
    Held,
    /// They were held, and get until this time to come to OP.
    Rising(Instant),
}

impl HeldStage {
    /// Follows what the owner wants. Returns whether OP was requested just now.
    pub(crate) async fn follow(&mut self, main: &MainDevice<'_>, devices: usize) -> bool {
        let holds = PROCESS.with_borrow(|process| process.holds_safe_op());
        let is_held = *self == Self::Held;
        if let Self::Rising(until) = self
            && *until < time::now()
        {
            *self = Self::Op;
        }
        if holds == is_held {
            return false;
        }
        *self = if holds { Self::Held } else { Self::Rising(time::now() + TO_OP) };
        for index in 0..devices {
            // A device that does not answer shows in the next cycle.
            let _ = al::request(main, index, if holds { REQUEST_SAFE_OP } else { REQUEST_OP }).await;
        }
        !holds
    }

    /// Notes the states of a good exchange.
    pub(crate) fn reached(&mut self, states: &[SubDeviceState]) {
        if matches!(self, Self::Rising(_)) && states.iter().all(|state| *state == SubDeviceState::Op) {
            *self = Self::Op;
        }
    }

    /// Returns whether devices in SAFE-OP are where they should be.
    pub(crate) fn takes_safe_op(self) -> bool {
        self != Self::Op
    }

    pub(crate) fn is_good(self, state: SubDeviceState) -> bool {
        state == SubDeviceState::Op || self.takes_safe_op() && state == SubDeviceState::SafeOp
    }
}
