//! The feedback tells where the arm is, and what the tool presses with.

use protocol::image::{Feedback, Status};

use super::{Law, Seen, joint};
use crate::kinematics::{Pose, Vector, difference, dot, length};
use crate::violation::{Broken, Class};

/// Single precision: half a unit in the last place of the largest value, as a share of it.
const SINGLE: f64 = 6e-8;

/// Single precision of the three angles of an orientation, in degrees.
const ANGLES_DEG: f64 = 5e-5;

/// Law's time that passes in a cycle at most, as a share of it: corrections take up to a tenth.
const LAW_PER_CYCLE: f64 = 1.11;

impl Law {
    pub(super) fn check_feedback(&mut self, seen: &Seen<'_>) {
        let feedback = seen.feedback;
        for axis in 0..self.axes {
            let figure = f64::from(feedback.joints[axis]);
            let limit = seen.joints[axis];
            if feedback.joints[axis] != limit as f32 {
                return self.report(Class::Feedback, joint(axis, figure, limit, "° (mm) in the feedback"));
            }
        }
        // A skill that ends says so in the cycle in which the arm arrives.
        let has_ended = self.before.is_some_and(|before| before.state != feedback.state);
        if feedback.status.contains(Status::AT_REST) == self.has_moved() && !has_ended {
            return self.report(Class::Feedback, Broken::Words("`at rest` contradicts what the joints do"));
        }
        if !self.shows(feedback, self.shown) && !self.takes_up_what_is_shown(feedback) {
            return self
                .report(Class::Feedback, Broken::Words("the pose is not that of the tool in its base"));
        }
        if self.pace.is_led
            && let Some(before) = self.before.filter(|before| before.number == feedback.number)
        {
            let passed_us = feedback.law_time_us.checked_sub(before.law_time_us);
            // It passes as fast as the arm alone goes, but for a correction; without a master it is 0.
            let most_us = (LAW_PER_CYCLE * self.cycle_s * 1e6) as u32;
            if before.law_time_us > 0 && passed_us.is_none_or(|passed| passed > most_us) {
                return self.report(
                    Class::Feedback,
                    Broken::Words("the law time goes back, or on faster than the arm goes alone"),
                );
            }
        }
        let told = f64::from(feedback.path_speed);
        let is_tools = |tool: &Pose| {
            let [now, before, ..] = self.tools(tool);
            let speed = length(difference(before, now)) / self.cycle_s;
            (told - speed).abs() <= 2.0 * SINGLE * speed + 1e-6
        };
        if !has_ended && !is_tools(&self.shown.0) && !self.candidates().any(|(tool, _)| is_tools(&tool)) {
            let [now, before, ..] = self.tools(&self.shown.0);
            let limit = length(difference(before, now)) / self.cycle_s;
            let what = "the path speed in the feedback";
            return self.report_figure(Class::Feedback, what, [told, limit], "mm/s");
        }
        if !self.surfaces.is_empty() {
            self.check_contact(feedback);
        }
    }

    /// Tool and base of the motions that the feedback may show now.
    fn candidates(&self) -> impl Iterator<Item = (Pose, Pose)> + '_ {
        let index = self.skill.executed as usize;
        // In a long cycle the arm may pass several motions.
        let before = self.samples[1].among.first;
        let near = index.saturating_sub(1).min(before)..index + 2;
        self.ways
            .get(near.start..near.end.min(self.ways.len()))
            .unwrap_or(&[])
            .iter()
            .map(|way| (way.tool, way.root_in_base))
    }

    fn shows(&self, feedback: &Feedback, (tool, root_in_base): (Pose, Pose)) -> bool {
        let pose = root_in_base.then(&self.samples[0].flange).then(&tool);
        let told = Pose::from_mm_deg(feedback.pose.map(f64::from));
        let is_near =
            |axis: usize| (pose.at[axis] - told.at[axis]).abs() <= SINGLE * pose.at[axis].abs() + 1e-6;
        (0..3).all(is_near) && pose.angle_to(&told) <= ANGLES_DEG
    }

    fn takes_up_what_is_shown(&mut self, feedback: &Feedback) -> bool {
        let found = self.candidates().find(|candidate| self.shows(feedback, *candidate));
        self.shown = found.unwrap_or(self.shown);
        found.is_some()
    }

    fn check_contact(&mut self, feedback: &Feedback) {
        let told = f64::from(feedback.contact_force);
        let force = length(self.contact(&self.shown.0));
        if (told - force).abs() > SINGLE * force + 1e-4 {
            let what = "the contact force in the feedback";
            return self.report_figure(Class::Feedback, what, [told, force], "N");
        }
        let way = self.ways.get(self.skill.executed as usize).filter(|_| !self.skill.has_ended);
        let wanted = way.map_or(0.0, |way| way.force_n);
        let is_soft =
            self.surfaces.iter().all(|surface| surface.stiffness_n_per_mm <= self.stiffest_n_per_mm);
        let most = wanted + self.force_tolerance_n;
        // A line may start in a surface. From outside, the force does not overshoot.
        let was_less = self.before.is_some_and(|before| f64::from(before.contact_force) <= most);
        if wanted > 0.0 && is_soft && self.surfaces.len() == 1 && was_less && told > most {
            self.report_figure(Class::Force, "the contact force", [told, wanted], "N");
        }
    }

    /// What the surfaces push the tool with.
    fn contact(&self, tool: &Pose) -> Vector {
        let place = self.samples[0].flange.point(tool.at);
        let mut sum = [0.0; 3];
        for surface in &self.surfaces {
            let depth = -dot(difference(surface.point_mm, place), surface.normal);
            if depth > 0.0 {
                for (part, normal) in sum.iter_mut().zip(surface.normal) {
                    *part += surface.stiffness_n_per_mm * depth * normal;
                }
            }
        }
        sum
    }
}
