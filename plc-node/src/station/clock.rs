//! The robot's clock, by the instants at which its frames arrive.
//!
//! Scans read images on the PLC's own grid, so that they see a stamp up to a scan later, and always by as much. The instant of the
//! frame is better. An image counts when a scan has accepted it: with the instant at which a frame first had its stamp.

use machine::Instant;
use protocol::image::Image;

use super::Station;
use crate::robot_clock::{RobotClock, StampDelay};

/// A robot's clock, and the newest stamp that came in a frame.
#[derive(Debug)]
pub(super) struct StationClock {
    estimate: RobotClock,
    /// The stamp, and when the first frame with it arrived.
    newest: Option<(u64, Instant)>,
}

impl Station {
    /// Has the station estimate its robot's clock from now on.
    pub(crate) fn estimate_clock(&mut self, delay: StampDelay) {
        self.clock = Some(Box::new(StationClock { estimate: RobotClock::new(delay), newest: None }));
    }

    /// Returns the estimate of the robot's clock, where the PLC makes one.
    #[must_use]
    pub fn robot_clock(&self) -> Option<&RobotClock> {
        self.clock.as_ref().map(|clock| &clock.estimate)
    }

    /// Takes the image of a frame that arrived at `now`, if the clock is estimated.
    pub(crate) fn note_stamp(&mut self, now: Instant, image: impl FnOnce() -> Option<Image>) {
        let Some(clock) = &mut self.clock else { return };
        let Some(stamp) = image().map(|image| self.order.feedback_clock(&image)) else { return };
        if clock.newest.is_none_or(|(newest, _)| newest != stamp) {
            clock.newest = Some((stamp, now));
        }
    }

    /// Observes the stamp of an image that a scan has accepted.
    pub(super) fn observe_clock(&mut self) {
        let Some(clock) = &mut self.clock else { return };
        let accepted = self.group.feedback().map(|feedback| feedback.clock_ns);
        if let Some((stamp, at)) = clock.newest.filter(|(stamp, _)| Some(*stamp) == accepted) {
            clock.estimate.observe(at, stamp);
        }
    }

    /// Forgets the robot's clock: the next robot may be another one.
    pub(super) fn forget_clock(&mut self) {
        if let Some(clock) = &mut self.clock {
            clock.estimate.restart();
            clock.newest = None;
        }
    }
}
