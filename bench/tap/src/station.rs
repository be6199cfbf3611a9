//! All that a capture shows of one robot and of the PLC that commands it.

use protocol::image::{CommandChecker, FeedbackChecker, Verdict};

use crate::address::{CyclicBus, EndAddress};
use crate::content::ImageDirection;
use crate::cyclic::FlowKey;
use crate::expected::ExpectedRun;
use crate::flow::NewImage;
use crate::repetition::Repetitions;
use crate::skill::{SkillEnd, SkillRecord, SkillWatch};

/// PLCs of one robot that are remembered.
const MAX_PLCS: usize = 8;

/// Skills by how they ended.
#[derive(Clone, Copy, PartialEq, Eq, Default, Debug)]
pub(crate) struct SkillCounts {
    pub(crate) done: u64,
    pub(crate) aborted: u64,
    pub(crate) failed: u64,
    pub(crate) unfinished: u64,
}

/// One robot.
#[derive(Debug)]
pub(crate) struct WatchedRobot {
    pub(crate) bus: CyclicBus,
    pub(crate) robot: EndAddress,
    /// Who commands it.
    pub(crate) plcs: Vec<EndAddress>,
    pub(crate) watch: SkillWatch,
    pub(crate) repetitions: Repetitions,
    pub(crate) skills: SkillCounts,
    pub(crate) commands: u64,
    pub(crate) feedbacks: u64,
    command_checker: CommandChecker,
    feedback_checker: FeedbackChecker,
}

impl WatchedRobot {
    pub(crate) fn new(bus: CyclicBus, robot: EndAddress, expected: &ExpectedRun) -> Self {
        Self {
            bus,
            robot,
            plcs: Vec::new(),
            watch: SkillWatch::default(),
            repetitions: Repetitions::new(expected),
            skills: SkillCounts::default(),
            commands: 0,
            feedbacks: 0,
            command_checker: CommandChecker::default(),
            feedback_checker: FeedbackChecker::default(),
        }
    }

    /// Takes an image of a new frame.
    pub(crate) fn handle_image(&mut self, now_ns: u64, key: &FlowKey, new: &NewImage) {
        let NewImage { direction, order, image } = new;
        match direction {
            ImageDirection::Command => {
                self.commands += 1;
                if !self.plcs.contains(&key.from) && self.plcs.len() < MAX_PLCS {
                    self.plcs.push(key.from);
                }
                if self.command_checker.verify(*order, image) == Verdict::Altered {
                    return;
                }
                let Ok(command) = order.parse_command(image) else { return };
                let ended = self.watch.handle_command(now_ns, &command);
                self.handle_end(ended);
                self.repetitions.handle_outputs(now_ns, command.outputs);
            }
            ImageDirection::Feedback => {
                self.feedbacks += 1;
                if self.feedback_checker.verify(*order, image) == Verdict::Altered {
                    return;
                }
                let Ok(feedback) = order.parse_feedback(image) else { return };
                self.watch.handle_feedback(now_ns, &feedback);
            }
        }
    }

    /// Ends the capture.
    pub(crate) fn end(&mut self) {
        let unfinished = self.watch.finish();
        self.handle_end(unfinished);
        self.repetitions.end();
    }

    /// Returns how many images were altered on the way: commands and feedbacks.
    pub(crate) const fn altered(&self) -> [u64; 2] {
        [self.command_checker.checks().altered, self.feedback_checker.checks().altered]
    }

    fn handle_end(&mut self, ended: Option<SkillRecord>) {
        let Some(record) = ended else { return };
        let count = match record.end {
            SkillEnd::Done => &mut self.skills.done,
            SkillEnd::Aborted => &mut self.skills.aborted,
            SkillEnd::Failed(_) => &mut self.skills.failed,
            SkillEnd::Replaced | SkillEnd::Unfinished => &mut self.skills.unfinished,
        };
        *count += 1;
        self.repetitions.handle_skill(record);
    }
}
