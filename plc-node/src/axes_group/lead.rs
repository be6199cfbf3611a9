//! The set-points of a master that leads the arm: see `docs/process-image.md`, Moving together.

use protocol::image::{Command, Control};

use super::AxesGroup;

/// The override of an arm whose master has the PLC's: what the arm can do at most.
const FULL: u8 = 100;

/// Where on its law a master wants the arm to be.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Lead {
    /// When, on the robot's clock in ns; 0 is when the robot sees it.
    pub(crate) start_time_ns: u64,
    /// The time on the law, in µs.
    pub(crate) law_time_us: u32,
    /// Set where the override stays with the arm, and is not the master's.
    pub(crate) keeps_override: bool,
    /// Set once a suspend reaches the robot. Before, the master slows down for all arms.
    pub(crate) lets_suspend: bool,
}

impl AxesGroup {
    /// Has a master lead the arm, or none.
    pub(crate) const fn set_lead(&mut self, lead: Option<Lead>) {
        self.lead = lead;
    }

    /// Has the skill that is commanded in this scan start at this time of the robot's clock.
    pub(crate) const fn start_at(&mut self, start_time_ns: u64) {
        self.command.start_time_ns = start_time_ns;
    }

    /// Returns the command as the robot gets it where a master leads the arm; `None` where it is the program's.
    pub(crate) fn led_command(&self) -> Option<Command> {
        let Lead { start_time_ns, law_time_us, keeps_override, lets_suspend } = self.lead?;
        let mut command = Command { start_time_ns, law_time_us, ..self.command };
        command.control.set(Control::SYNC, true);
        if !lets_suspend {
            command.control.set(Control::SUSPEND, false);
        }
        if !keeps_override {
            command.override_percent = FULL;
        }
        Some(command)
    }
}
