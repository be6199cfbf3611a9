//! The robot's image: taken over in each scan, or refused because of its check or its age.

use machine::{Duration, Instant};
use protocol::image::{Age, Image, Verdict};

use super::{Station, StationState};
use crate::event::Events;
use crate::{FailureCause, PlcEvent};

/// Number of scans that is longer than any robot cycle: then the robot's image should have changed.
pub(super) const STALE_IMAGE_SCANS: u32 = 20;

/// Time with nothing but old images of the robot after which the connection counts as lost: a usual watchdog.
const OUTDATED_FOR: Duration = Duration::from_millis(100);

/// The robot in a scan, as the bus has it.
#[derive(Clone, Copy, Debug)]
pub(crate) enum RobotImage<'a> {
    /// The image of the scan before once more.
    Repeated,
    /// An image; `None` without a good one.
    Read(Option<&'a Image>),
}

impl Station {
    /// Returns whether the bus still has the image that the station's feedback was read from.
    pub(crate) fn has_again(&self, repeats: impl FnOnce(&Image) -> bool) -> bool {
        self.is_connected && self.group.feedback().is_some() && repeats(&self.inputs)
    }

    /// Takes over the robot's image of a scan; none without a connection. `received` are the frames of its connection so far.
    /// Returns why the robot counts as lost, if it does from now on.
    pub(crate) fn read_inputs(
        &mut self,
        now: Instant,
        input: RobotImage<'_>,
        received: u64,
        events: &mut Events,
    ) -> Option<FailureCause> {
        let input = match input {
            RobotImage::Read(_) if !self.is_connected => RobotImage::Read(None),
            RobotImage::Read(Some(image)) if self.has_again(|inputs| inputs == image) => RobotImage::Repeated,
            input => input,
        };
        let has_image = !matches!(input, RobotImage::Read(None));
        let is_bad = self.is_connected && !has_image;
        if core::mem::replace(&mut self.image_bad, is_bad) != is_bad && self.is_connected {
            events.push(self.index, if is_bad { PlcEvent::ImageBad } else { PlcEvent::ImageGood });
        }
        let lost = match input {
            RobotImage::Repeated => {
                self.outdated_since = None;
                self.group.read_again();
                None
            }
            RobotImage::Read(Some(image)) => self.take_over(now, image),
            RobotImage::Read(None) => {
                self.forget_images();
                self.group.read(None);
                None
            }
        };
        if has_image && self.life.take_still(now) {
            events.push(self.index, PlcEvent::LifeStill);
        }
        if self.group.still_scans() == STALE_IMAGE_SCANS {
            self.received_still = received;
            self.altered_still = self.checker.checks().altered;
        }
        lost
    }

    /// Takes over a new image of the robot. One that was altered on the way, or is an old one, is refused: the one before
    /// stands, as if the frame had been lost.
    fn take_over(&mut self, now: Instant, image: &Image) -> Option<FailureCause> {
        if self.checker.verify(self.order, image) == Verdict::Altered {
            self.keep_feedback();
            return None;
        }
        let feedback = self.order.parse_feedback(image).ok();
        // Before the robot is ready nothing can run: until then a late image may set the start.
        if self.state != StationState::Preparing {
            self.life.act();
        }
        if feedback.is_some_and(|feedback| self.life.judge_present(feedback.life) == Age::Outdated) {
            return self.refuse_outdated(now);
        }
        (self.inputs, self.outdated_since) = (*image, None);
        self.group.read(feedback);
        self.observe_clock();
        None
    }

    fn keep_feedback(&mut self) {
        if self.group.feedback().is_some() { self.group.read_again() } else { self.group.read(None) }
    }

    /// Refuses an old image. Nothing but these for a time is a lost connection, and the next image sets the start.
    fn refuse_outdated(&mut self, now: Instant) -> Option<FailureCause> {
        let since = *self.outdated_since.get_or_insert(now);
        if now.since(since) < OUTDATED_FOR {
            self.keep_feedback();
            return None;
        }
        let lost = FailureCause::RobotOutdated { scans: self.group.still_scans() };
        self.forget_images();
        self.group.read(None);
        Some(lost)
    }

    /// Forgets what was found about the robot's images: the next ones are those of another connection.
    pub(super) const fn forget_images(&mut self) {
        self.checker.disconnect();
        self.life.restart();
        self.outdated_since = None;
    }

    /// Returns the trouble that makes every run with this station impossible, whatever its blocks find. `received` are the
    /// frames of its connection so far.
    pub(crate) fn trouble(&self, received: u64) -> Option<FailureCause> {
        if self.group.feedback().is_none() {
            return Some(FailureCause::NoImage);
        }
        if !self.group.is_silent() {
            return None;
        }
        let scans = self.group.still_scans();
        let is_heard = received > self.received_still;
        Some(if self.checker.checks().altered > self.altered_still {
            FailureCause::RobotAltered { scans }
        } else if self.outdated_since.is_some() {
            FailureCause::RobotOutdated { scans }
        } else if is_heard {
            FailureCause::RobotSilent { scans }
        } else {
            FailureCause::RobotUnheard { scans }
        })
    }
}
