//! Leading the robot to `Ready`, whatever state it is found in.

use protocol::image::Control;

use crate::AxesGroup;
use crate::function_blocks::{Halt, Reset, is_executing, is_ready};

/// The part of the program that runs while no sequence does.
#[derive(Clone, Copy, Default, Debug)]
pub(crate) struct Readiness {
    halt: Halt,
    reset: Reset,
    /// A run failed: whether or not the robot shows it yet, its skill must not go on.
    must_halt: bool,
    /// PLC's life counter in the first image without a reset that did not help: robots that take a reset by its edge
    /// have to see it before the next one.
    reset_withdrawn: Option<u16>,
}

impl Readiness {
    /// Begins after a failed run.
    pub(crate) fn after_failure() -> Self {
        Self { must_halt: true, ..Self::default() }
    }

    /// Whether a robot that was ready still is.
    pub(crate) fn holds(group: &AxesGroup) -> bool {
        group.feedback().is_some_and(is_ready) && !group.is_silent()
    }

    /// One scan: keeps the robot enabled, halts a skill that no sequence knows, and resets the robot. Returns whether
    /// it has become ready.
    pub(crate) fn scan(&mut self, group: &mut AxesGroup) -> bool {
        let Some(executing) = group.feedback().map(is_executing) else { return false };
        group.set_control(Control::ENABLE, true);

        let halted = self.halt.call(executing || self.must_halt, group);
        if halted.done || halted.error {
            self.halt.call(false, group);
            self.must_halt &= halted.error;
        }

        if self.reset_withdrawn.is_some_and(|life| group.has_seen(life)) {
            self.reset_withdrawn = None;
        }
        let wanted = !executing && !self.must_halt && !halted.busy && self.reset_withdrawn.is_none();
        let reset = self.reset.call(wanted, group);
        if reset.done || reset.error {
            self.reset.call(false, group);
        }
        if reset.error {
            self.reset_withdrawn = Some(group.command().life);
        }
        wanted && reset.done && !group.is_silent()
    }
}
