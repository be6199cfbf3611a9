//! Numbers of motions across the commands of a repetition.

use protocol::image::SLOTS;

/// Numbers the motions of a run across its commands: the first motion of a command follows the last one of the command
/// before.
#[derive(Default, Debug)]
pub(crate) struct Numbering {
    command: Option<u16>,
    before: u32,
    /// Motions of the command so far.
    motions: u32,
}

impl Numbering {
    /// Returns the number of motions of the earlier commands; `motions` is the number of motions of this command so far.
    fn before(&mut self, command: u16, motions: u32) -> u32 {
        if self.command.replace(command) != Some(command) {
            self.before += std::mem::take(&mut self.motions);
        }
        self.motions = self.motions.max(motions);
        self.before
    }

    /// Follows the robot to its next cycle and returns the motions done.
    pub(crate) fn done(&mut self, sample: &robot_node::Sample) -> u32 {
        self.before(sample.command, sample.executed) + sample.executed
    }

    /// Follows the PLC to its next scan and returns the number of the motion in each slot, 0 for an empty one: motion k of a
    /// command lies in slot k mod 5.
    pub(crate) fn slots(&mut self, scan: &plc_node::Sample) -> [u32; SLOTS] {
        let before = self.before(scan.command, scan.written);
        let mut slots = [0; SLOTS];
        for motion in scan.written.saturating_sub(scan.in_slots)..scan.written {
            if let Some(slot) = slots.get_mut(motion as usize % SLOTS) {
                *slot = before + motion + 1;
            }
        }
        slots
    }
}
