//! The path of an arm by its plan: what it drives alone between two waits, over the law's time.

use std::ops::Range;

use plc_node::ExecutionType;
use robot_node::Controller;
use robot_node::arm::Joints;
use robot_node::rehearsal::{Calls, rehearse_watched};

use crate::planned_station::PlannedStation;

/// Path of an arm in a repetition of a type, section by section.
#[derive(Clone, Debug, Default)]
pub struct PlannedPath {
    sections: Vec<PlannedSection>,
}

/// Path of an arm between two waits.
#[derive(Clone, Debug)]
struct PlannedSection {
    /// Indices of its motions.
    pub motions: Range<usize>,
    /// The law's time driven in the section, in µs, and the joints there.
    pub points: Vec<(u64, Joints)>,
}

impl PlannedPath {
    /// Has the arm of a station execute its motions alone from these joints, at an override in %.
    ///
    /// # Errors
    ///
    /// The arm alone cannot execute the plan.
    pub fn rehearse(
        station: &PlannedStation,
        execution_type: ExecutionType,
        start: Joints,
        override_percent: u8,
    ) -> anyhow::Result<Self> {
        let planned = &station.planned;
        let calls = match execution_type {
            ExecutionType::Rc => Calls::Program,
            ExecutionType::Sm => Calls::Singles,
            ExecutionType::Cm => Calls::Continuous,
        };
        let mut path = Self::default();
        let mut end = start;
        for section in &station.sections {
            let from = end;
            let motions = planned.motions.get(section.motions.clone()).unwrap_or_default();
            let mut points = SectionPoints::new(from);
            let rehearsed = rehearse_watched(
                &planned.robot,
                from,
                motions,
                &section.stops,
                (calls, override_percent),
                &mut |controller| points.add(controller),
            )?;
            path.sections.push(PlannedSection { motions: section.motions.clone(), points: points.points });
            end = rehearsed.account.end;
        }
        Ok(path)
    }

    /// Returns the joints at a share of the law's time between two numbers of executed motions, which are the ends of sections.
    #[must_use]
    pub fn joints(&self, motions: Range<usize>, share: f64) -> Option<Joints> {
        let begins = |section: &&PlannedSection| section.motions.start == motions.start;
        if motions.is_empty() {
            return self.joints_after(motions.start);
        }
        self.sections.iter().find(begins).filter(|section| section.motions == motions)?.joints(share)
    }

    /// Returns the joints where so many motions are executed, which is the end of a section.
    fn joints_after(&self, executed: usize) -> Option<Joints> {
        if executed == 0 {
            return self.sections.first()?.joints(0.0);
        }
        self.sections.iter().find(|section| section.motions.end == executed)?.joints(1.0)
    }
}

impl PlannedSection {
    fn joints(&self, share: f64) -> Option<Joints> {
        let (all_us, _) = *self.points.last()?;
        let wanted = share * all_us as f64;
        let next = self.points.partition_point(|(us, _)| *us as f64 <= wanted);
        let before = self.points.get(next.saturating_sub(1))?;
        let after = self.points.get(next).unwrap_or(before);
        let span = after.0.saturating_sub(before.0) as f64;
        let share = if span > 0.0 { (wanted - before.0 as f64) / span } else { 0.0 };
        Some(between(&before.1, &after.1, share))
    }
}

/// Returns the joints at a share of the way between two.
pub(crate) fn between(from: &Joints, to: &Joints, share: f64) -> Joints {
    let mut joints = *from;
    joints.iter_mut().zip(to).for_each(|(value, to)| *value += (to - *value) * share);
    joints
}

/// The points of a section, over all of its skills.
struct SectionPoints {
    points: Vec<(u64, Joints)>,
    number: Option<u16>,
    /// Law time of the skills before, in µs.
    before: u64,
    driven: u64,
}

impl SectionPoints {
    fn new(from: Joints) -> Self {
        Self { points: vec![(0, from)], number: None, before: 0, driven: 0 }
    }

    fn add(&mut self, controller: &Controller) {
        let number = controller.feedback().number;
        if self.number.replace(number) != Some(number) {
            self.before += std::mem::take(&mut self.driven);
        }
        self.driven = (controller.progress_s() * 1e6 + 0.5) as u64;
        let at = self.before + self.driven;
        if self.points.last().is_none_or(|(last, _)| at > *last) {
            self.points.push((at, *controller.joints()));
        }
    }
}
