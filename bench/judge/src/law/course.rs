//! The tool is where the programmed lines and circles lead it, and only leaves them within the zones of corners.

use super::{Law, PLACE_DEG, PLACE_MM};
use crate::kinematics::distance;
use crate::violation::Class;

impl Law {
    pub(super) fn check_course(&mut self) {
        let sample = &self.samples[0];
        if !sample.among.is_one() || self.skill.has_ended {
            return;
        }
        let Some(way) = self.ways.get(sample.among.first) else { return };
        let Some(off) = way.off(&sample.flange.then(&way.tool)) else { return };
        if off.mm > PLACE_MM {
            let what = "the tool's distance from its course";
            return self.report_figure(Class::Course, what, [off.mm, PLACE_MM], "mm");
        }
        if off.turned_deg > PLACE_DEG {
            let what = "the tool's turn away from its course";
            self.report_figure(Class::Turn, what, [off.turned_deg, PLACE_DEG], "°");
        }
    }

    /// The arm stands: at the end of the motion that was executed last, or where the skill started.
    pub(super) fn stands_where_it_may(&self, executed: u32) -> bool {
        let flange = &self.samples[0].flange;
        let end = match (executed as usize).checked_sub(1) {
            None => &self.skill.start,
            Some(index) => match self.ways.get(index) {
                Some(way) => &way.end,
                None => return false,
            },
        };
        distance(flange.at, end.at) <= PLACE_MM && flange.angle_to(end) <= PLACE_DEG
    }
}
