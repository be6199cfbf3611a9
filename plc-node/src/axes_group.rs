//! The robot as the PLC program sees it: what PLCopen calls an axes group and hands to every block by reference.

mod lead;
mod turn;

use protocol::image::{Command, Control, Feedback, Status};

pub(crate) use lead::Lead;
use turn::Waiting;
pub(crate) use turn::{Ticket, Turn};

use crate::Override;
use crate::function_blocks::{BlockError, is_at_rest};

/// How many scans the program waits for the robot.
///
/// Scans are counted, and no time is measured, so that a stalled PLC does not report the robot.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct WaitLimits {
    /// Scans until a command must be echoed.
    pub answer_scans: u32,
    /// Scans for which the robot's life counter may stand still.
    pub silent_scans: u32,
}

/// One robot behind the process image: inputs of this scan, outputs of this scan, and the block that commands.
#[derive(Clone, PartialEq, Debug)]
pub struct AxesGroup {
    pub(crate) command: Command,
    pub(crate) feedback: Option<Feedback>,
    /// Whether a block's skill is under way.
    pub(crate) commanded: bool,
    /// The skill that waits for the one under way.
    waiting: Option<Waiting>,
    /// The set-point of a master that leads the arm in place of the override.
    lead: Option<Lead>,
    /// Number of the last ticket.
    tickets: u16,
    /// Whether a `GroupHalt` is busy.
    halting: bool,
    /// Number of this scan, from 1. The life counter is its lower 16 bits.
    scans: u64,
    /// Scans since the robot's life counter changed.
    still_scans: u32,
    /// Whether the arm has moved between the images of the scan before and of this one.
    moving: bool,
    /// The first scan of a stop that an error of a block asks for, until the robot stands.
    pub(crate) error_stop: Option<u64>,
    wait_limits: WaitLimits,
}

impl AxesGroup {
    /// Creates an axes group that knows nothing of its robot yet.
    #[must_use]
    pub fn new(wait_limits: WaitLimits) -> Self {
        Self {
            command: Command::default(),
            feedback: None,
            commanded: false,
            waiting: None,
            lead: None,
            tickets: 0,
            halting: false,
            scans: 0,
            still_scans: 0,
            moving: false,
            error_stop: None,
            wait_limits,
        }
    }

    /// Begins a scan: takes over the robot's image, or `None` without a connection, and counts up the PLC's life counter.
    pub fn read(&mut self, feedback: Option<Feedback>) {
        self.count_scan();
        self.still_scans = match (&self.feedback, &feedback) {
            (Some(before), Some(after)) if before.life == after.life => self.still_scans.saturating_add(1),
            _ => 0,
        };
        self.moving = match (&self.feedback, &feedback) {
            (Some(before), Some(after)) => {
                before.joints != after.joints && !after.status.contains(Status::AT_REST)
            }
            _ => false,
        };
        self.feedback = feedback;
        self.end_error_stop();
    }

    /// Begins a scan in which the robot's image is still that of the scan before.
    pub const fn read_again(&mut self) {
        self.count_scan();
        self.moving = false;
        self.still_scans = if self.feedback.is_some() { self.still_scans.saturating_add(1) } else { 0 };
    }

    const fn count_scan(&mut self) {
        self.scans += 1;
        self.command.life = self.scans as u16;
    }

    /// Returns the robot's image of this scan; none without a connection.
    #[must_use]
    pub const fn feedback(&self) -> Option<&Feedback> {
        self.feedback.as_ref()
    }

    /// Returns the command image of this scan.
    #[must_use]
    pub const fn command(&self) -> &Command {
        &self.command
    }

    /// Returns whether the robot's life counter has stood still for longer than it may.
    #[must_use]
    pub const fn is_silent(&self) -> bool {
        self.still_scans >= self.wait_limits.silent_scans
    }

    /// Returns the number of scans since the robot's life counter changed.
    #[must_use]
    pub const fn still_scans(&self) -> u32 {
        self.still_scans
    }

    /// Returns the number of scans that the robot may take to echo a command.
    #[must_use]
    pub const fn answer_scans(&self) -> u32 {
        self.wait_limits.answer_scans
    }

    /// Counts a scan in which a block waits for the robot to get into a state; returns how many these are. They begin anew
    /// whenever the arm moves: it may brake as slowly as its motion says, and takes longer then than a robot may to answer.
    pub(crate) const fn count_wait(&self, waited: u32) -> u32 {
        if self.moving { 0 } else { waited.saturating_add(1) }
    }

    /// Returns the number of this scan, from 1.
    #[must_use]
    pub const fn scans(&self) -> u64 {
        self.scans
    }

    /// Returns whether the robot has seen the image of this scan, or a later one. The echo of the life counter tells how old
    /// the image is that the robot saw last.
    #[must_use]
    pub fn has_seen(&self, scan: u64) -> bool {
        self.feedback.as_ref().is_some_and(|feedback| {
            let age = self.command.life.wrapping_sub(feedback.life_echo);
            self.scans.checked_sub(age.into()).is_some_and(|seen| seen >= scan)
        })
    }

    /// Sets or clears control bits. A stop that an error asks for cannot be cleared.
    pub const fn set_control(&mut self, bits: Control, on: bool) {
        self.command.control.set(bits, on);
        if self.error_stop.is_some() {
            self.command.control.set(Control::HALT, true);
        }
    }

    /// Stops the robot because a block ended with an error while it may still move.
    pub(crate) const fn stop_for_error(&mut self) {
        self.error_stop = Some(self.scans);
        self.command.control.set(Control::HALT, true);
    }

    /// Ends that stop once the robot stands.
    fn end_error_stop(&mut self) {
        let Some(since) = self.error_stop else { return };
        if self.has_seen(since) && self.feedback.as_ref().is_some_and(is_at_rest) {
            self.error_stop = None;
            self.command.control.set(Control::HALT, false);
        }
    }

    /// Sets the override; the robot changes to it as fast as its limits allow.
    pub const fn set_override(&mut self, to: Override) {
        self.command.override_percent = to.percent();
    }

    /// Returns the PLC's digital outputs.
    pub(crate) const fn outputs(&self) -> u16 {
        self.command.outputs
    }

    /// Sets all of the PLC's digital outputs.
    pub(crate) const fn set_outputs(&mut self, outputs: u16) {
        self.command.outputs = outputs;
    }

    /// Clears everything but the number, the override and the digital outputs. This image must be on the bus while there is no
    /// command, so that a robot that starts meanwhile finds nothing to execute.
    pub fn disarm(&mut self) {
        self.command.control = Control::default();
        self.command.start_time_ns = 0;
        self.commanded = false;
        (self.waiting, self.lead) = (None, None);
        self.halting = false;
        self.error_stop = None;
        self.feedback = None;
        self.still_scans = 0;
        self.moving = false;
    }

    /// Claims the robot for the skill whose turn it is, and gives the command a number that is new to the robot.
    ///
    /// A PLC that was restarted does not know the number it used last, so the robot's echo is avoided too; 0 is left
    /// out because it stands for no command on a robot that was just switched on.
    pub(crate) fn issue(&mut self) -> Result<u16, BlockError> {
        let Some(feedback) = &self.feedback else { return Err(BlockError::NotConnected) };
        if self.error_stop.is_some() {
            return Err(BlockError::Stopping);
        }
        let mut number = self.command.number.wrapping_add(1);
        while number == 0 || number == feedback.number {
            number = number.wrapping_add(1);
        }
        (self.command.number, self.command.start_time_ns) = (number, 0);
        self.command.control.set(Control::EXECUTE, true);
        // Only MoveTrajectory sets it again.
        self.command.control.set(Control::COMPACT, false);
        self.commanded = true;
        Ok(number)
    }

    /// Returns whether the skill with this number is under way.
    pub(crate) const fn is_commanded(&self, number: u16) -> bool {
        self.commanded && self.command.number == number
    }

    /// Gives up the skill that waits, and the one under way if the robot has not taken up its command yet: it would take it
    /// up when nothing stops it any more.
    pub(crate) fn give_up(&mut self) {
        self.withdraw();
        let number = self.command.number;
        if self.commanded && self.feedback.as_ref().is_none_or(|feedback| feedback.number != number) {
            self.release(number, false);
        }
    }

    /// Asks the robot to cancel its skill while a `GroupHalt` is busy. What a block starts meanwhile is not aborted.
    pub(crate) fn halt(&mut self, is_busy: bool) {
        if is_busy && !self.halting {
            self.give_up();
        }
        self.halting = is_busy;
        self.set_control(Control::CANCEL, is_busy);
    }

    /// Ends the claim of the skill with this number, which is done, has failed or was aborted.
    pub(crate) const fn release(&mut self, number: u16, is_done: bool) {
        if self.command.number == number {
            self.command.control.set(Control::EXECUTE, false);
            self.commanded = false;
            self.end_skill(is_done);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn group() -> AxesGroup {
        AxesGroup::new(WaitLimits { answer_scans: 10, silent_scans: 3 })
    }

    #[test]
    fn a_restarted_plc_does_not_reuse_the_number_that_the_robot_still_echoes() {
        let mut group = group();
        group.read(Some(Feedback { number: 1, ..Feedback::default() }));
        assert_eq!(group.issue(), Ok(2));
    }

    #[test]
    fn numbers_wrap_around_zero_which_stands_for_no_command() {
        let mut group = group();
        group.command.number = u16::MAX;
        group.read(Some(Feedback::default()));
        assert_eq!(group.issue(), Ok(1));
    }

    #[test]
    fn a_life_counter_that_stands_still_for_as_many_scans_as_allowed_means_a_silent_robot() {
        let mut group = group();
        for (life, silent) in [(7, false), (7, false), (7, false), (7, true), (8, false)] {
            group.read(Some(Feedback { life, ..Feedback::default() }));
            assert_eq!(group.is_silent(), silent);
        }
    }

    #[test]
    fn an_image_that_is_read_again_counts_as_the_same_image_read_anew() {
        let (mut again, mut anew) = (group(), group());
        let feedback = Some(Feedback { life: 7, ..Feedback::default() });
        again.read(feedback);
        again.read_again();
        (0..2).for_each(|_| anew.read(feedback));
        assert_eq!(again, anew);
    }

    #[test]
    fn an_echo_from_before_the_counter_wrapped_is_not_taken_for_a_later_one() {
        let mut group = AxesGroup { scans: 0x1_0005, ..group() };
        group.read(Some(Feedback { life_echo: 0xFFF0, ..Feedback::default() }));
        assert!(group.has_seen(0xFFF0) && !group.has_seen(0xFFF1));
        group.read(Some(Feedback { life_echo: 6, ..Feedback::default() }));
        assert!(group.has_seen(0x1_0006) && !group.has_seen(0x1_0007));
    }

    #[test]
    fn an_echo_from_before_the_plc_restarted_is_not_taken_for_one_of_its_images() {
        let mut group = group();
        for life_echo in [1_000, 20_000, 40_000] {
            group.read(Some(Feedback { life_echo, ..Feedback::default() }));
            group.stop_for_error();
            group.read(Some(Feedback { life_echo, status: Status::AT_REST, ..Feedback::default() }));
            assert!(group.error_stop.is_some(), "{life_echo}");
        }
    }

    #[test]
    fn a_stop_for_an_error_ends_once_the_robot_is_back_however_long_that_takes() {
        for scans in [10, 40_000, 70_000] {
            let mut group = group();
            group.stop_for_error();
            (0..scans).for_each(|_| group.read(None));
            for _ in 0..2 {
                let life_echo = group.command().life;
                group.read(Some(Feedback { life_echo, status: Status::AT_REST, ..Feedback::default() }));
            }
            assert!(!group.command().control.contains(Control::HALT), "after {scans} scans");
        }
    }
}
