//! What the controller reports: the values of the feedback image, and events.

use machine::Instant;
use protocol::image::{Command, Control, ErrorNumber, Feedback, Finding, Status};

use super::{Controller, EVENTS, RobotEvent, press};
use crate::arm::{Frame, Violation, contact_force, length};

impl Controller {
    pub(super) fn cleared_feedback(&self) -> Feedback {
        let Feedback { life, life_echo, override_percent, joints, pose, contact_force, .. } = self.feedback;
        let Feedback { queue_depth, services, .. } = self.feedback;
        Feedback {
            life,
            life_echo,
            override_percent,
            joints,
            pose,
            contact_force,
            queue_depth,
            services,
            ..Feedback::default()
        }
    }

    pub(super) fn report(&mut self, at: Instant, command: Option<&Command>) {
        let at_rest = self.interpolator.is_at_rest() && self.is_in_place();
        // A motion that only begins, or has no length, may have another tool or base where the arm stands.
        let has_new_frames =
            self.execution.is_some() && self.present_frames() != (self.tool, self.base_inverse);
        if has_new_frames || self.reported != *self.actual_joints() {
            self.report_position();
        }
        if !self.config.surfaces.is_empty() {
            self.measure_contact_force();
        }
        self.warn();
        let busy = self.execution.is_some_and(|execution| self.shows(execution.number));
        let enabled = command.is_some_and(|command| command.control.contains(Control::ENABLE));
        let feedback = &mut self.feedback;
        feedback.state = self.state;
        feedback.inputs = self.outputs;
        feedback.status.set(Status::BUSY, busy);
        feedback.status.set(Status::AT_REST, at_rest);
        feedback.status.set(Status::ENABLED, enabled);
        feedback.path_speed = self.interpolator.path_speed() as f32;
        feedback.clock_ns = at.as_nanos();
        feedback.life = feedback.life.wrapping_add(1);
        if let Some(command) = command {
            feedback.life_echo = command.life;
        }
    }

    /// Returns whether the image shows the running skill, which has this number, and not a command that was refused meanwhile: a PLC
    /// that restarts may choose the number once more.
    pub(super) const fn shows(&self, number: u16) -> bool {
        self.feedback.number == number && !self.feedback.status.contains(Status::ERROR)
    }

    /// Shows what the robot does not take over while nothing worse is wrong.
    fn warn(&mut self) {
        let feedback = &mut self.feedback;
        if feedback.status.contains(Status::ERROR) {
            return;
        }
        let wrong = self.wrong_override.map(|percent| Violation::Override { percent });
        let refused = self.refused_images;
        if wrong.is_none() && refused.is_none() && !feedback.status.contains(Status::WARNING) {
            return;
        }
        feedback.status.set(Status::WARNING, wrong.is_some() || refused.is_some());
        let (error, finding) = match (refused, wrong) {
            (Some(refused), _) => (refused.number(), Finding::NONE),
            (None, Some(wrong)) => (wrong.number(), wrong.finding()),
            (None, None) => (ErrorNumber::None, Finding::NONE),
        };
        (feedback.error, feedback.finding) = (error, finding);
    }

    /// Measures the force of the surfaces on the tool.
    pub(super) fn measure_contact_force(&mut self) {
        let tool = self.interpolator.flange().origin_of(&self.tool);
        self.contact = contact_force(&self.config.surfaces, tool);
        self.feedback.contact_force = length(self.contact) as f32;
    }

    /// Returns the tool in the flange and the inverse of the base of the present motion, or of the last one.
    fn present_frames(&self) -> (Frame, Frame) {
        let pressing = self.press.as_ref().filter(|press| press.phase != press::Phase::Waiting);
        let leading = self.interpolator.path().current().map(|segment| (segment.tool, segment.base_inverse));
        let frames = leading.or(pressing.map(|press| (press.tool, press.base_inverse)));
        frames.unwrap_or((self.tool, self.base_inverse))
    }

    /// Takes over the frames of the motion at whose end the path ended. A motion without a way, or with one shorter than a
    /// cycle, ends before it was ever the present one.
    pub(super) fn take_last_frames(&mut self) {
        let frames = self.interpolator.path().last_frames();
        if let Some(frames) = frames.filter(|frames| *frames != (self.tool, self.base_inverse)) {
            (self.tool, self.base_inverse) = frames;
            self.report_position();
        }
    }

    /// Reports where the joints are, and the pose of the present motion's tool in its base.
    pub(super) fn report_position(&mut self) {
        (self.tool, self.base_inverse) = self.present_frames();
        let joints = *self.actual_joints();
        self.reported = joints;
        let flange = match self.drives {
            Some(_) => self.config.arm.forward(&joints),
            None => *self.interpolator.flange(),
        };
        let pose = self.base_inverse * (flange * self.tool);
        self.feedback.joints = joints.map(|joint| joint as f32);
        self.feedback.pose = pose.to_mm_deg().map(|coordinate| coordinate as f32);
    }

    /// Refuses a command: its number is echoed with the error.
    pub(super) fn refuse(&mut self, number: u16, motion: u32, cause: Violation) {
        self.feedback = Feedback { number, ..self.cleared_feedback() };
        self.set_error(cause.number(), motion, cause.finding());
        self.refuse_motion(number, motion, cause);
    }

    pub(super) fn refuse_motion(&mut self, number: u16, motion: u32, cause: Violation) {
        self.event(RobotEvent::Refused { number, error: cause.number(), motion, cause });
    }

    pub(super) fn set_error(&mut self, error: ErrorNumber, motion: u32, finding: Finding) {
        self.feedback.status.set(Status::ERROR, true);
        self.feedback.status.set(Status::WARNING, false);
        (self.feedback.error, self.feedback.error_motion, self.feedback.finding) = (error, motion, finding);
    }

    pub(super) fn suppressed(&mut self, motion: u32) {
        self.feedback.blends_suppressed = self.feedback.blends_suppressed.saturating_add(1);
        self.event(RobotEvent::BlendSuppressed { motion });
    }

    pub(super) fn event(&mut self, event: RobotEvent) {
        if self.events.len() == EVENTS {
            self.events.pop_front();
        }
        self.events.push_back(event);
    }
}
