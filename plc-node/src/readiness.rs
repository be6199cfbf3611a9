//! Leading the robot to `Ready`, whatever state it is found in.

use protocol::image::Control;

use crate::AxesGroup;
use crate::function_blocks::{GroupReset, GroupStop, is_executing, is_ready};

/// The part of the program that runs while no sequence does.
#[derive(Clone, Copy, Default, Debug)]
pub(crate) struct Readiness {
    stop: GroupStop,
    reset: GroupReset,
    /// A run failed: whether or not the robot shows it yet, its skill must not go on.
    must_stop: bool,
    /// The first scan without a reset that did not help: robots that take a reset by its edge have to see it before the
    /// next one.
    reset_withdrawn: Option<u64>,
}

impl Readiness {
    /// Begins after a failed run.
    pub(crate) fn after_failure() -> Self {
        Self { must_stop: true, ..Self::default() }
    }

    /// Returns whether a robot that was ready still is.
    pub(crate) fn holds(group: &AxesGroup) -> bool {
        group.feedback().is_some_and(is_ready) && !group.is_silent()
    }

    /// Runs one scan: keeps the robot enabled, stops a skill that does not belong to a sequence, and resets the robot.
    /// Returns whether it has become ready.
    pub(crate) fn scan(&mut self, group: &mut AxesGroup) -> bool {
        let Some(executing) = group.feedback().map(is_executing) else { return false };
        group.set_control(Control::ENABLE, true);

        let stopped = self.stop.call(executing || self.must_stop, group);
        if stopped.done || stopped.error {
            self.stop.call(false, group);
            self.must_stop &= stopped.error;
        }

        if self.reset_withdrawn.is_some_and(|scan| group.has_seen(scan)) {
            self.reset_withdrawn = None;
        }
        let wanted = !executing && !self.must_stop && !stopped.busy && self.reset_withdrawn.is_none();
        let reset = self.reset.call(wanted, group);
        if reset.done || reset.error {
            self.reset.call(false, group);
        }
        if reset.error {
            self.reset_withdrawn = Some(group.scans());
        }
        wanted && reset.done && !group.is_silent()
    }
}
