//! A plan as compact points, for a PLC that sends these.

use protocol::image::Motion;
use setup::{Setup, SlotForm};

use crate::application::Application;
use crate::arms::Mark;
use crate::plan::Plan;
use crate::points::{CompactError, CompactPath};

/// Why the motions of a plan have no compact form.
#[derive(Clone, PartialEq, Debug, thiserror::Error)]
pub enum NotCompact {
    /// The points have no place to begin at.
    #[error("compact points follow on the place where the arm stands: give the application a start")]
    NoStart,
    /// The plan has no motions.
    #[error("the application has no motions")]
    Empty,
    /// The arm stops on the way.
    #[error(
        "the arm stops after motion {after} of {motions}: compact points are one continuous motion, so leave out its stops"
    )]
    Stops {
        /// Motions before the stop.
        after: usize,
        /// Motions of the plan.
        motions: usize,
    },
    /// A motion of another kind, speed or zone than the first one.
    #[error(
        "motion {motion} has another {what} than motion 1: compact points are alike but for their targets"
    )]
    Differs {
        /// Its number, counted from 1.
        motion: usize,
        /// The field that differs.
        what: &'static str,
    },
    /// The arm moves together with others.
    #[error(
        "the arm moves together with others from mark `{mark}`: their master counts the law of full motions, which compact points do not share; leave plc.form out, or `together` of the mark"
    )]
    MovesTogether {
        /// The mark's name.
        mark: String,
    },
    /// A motion that is to end in a configuration of the arm.
    #[error("motion {motion} has a configuration, which compact points do not carry: leave it out")]
    Configuration {
        /// Its number, counted from 1.
        motion: usize,
    },
    /// A target that no difference carries.
    #[error(transparent)]
    Point(#[from] CompactError),
}

/// Checks that an arm moves together with nobody, where its setup's PLC sends compact points.
pub(crate) fn check_alone(
    application: &Application,
    setup: &Setup,
    marks: &[Mark],
) -> Result<(), NotCompact> {
    let waits = |mark: &Mark| application.waits.iter().any(|wait| wait.mark == mark.number);
    let is_here = |mark: &&Mark| mark.together && waits(mark);
    match marks.iter().find(is_here) {
        Some(mark) if setup.plc.sends_in_form() == SlotForm::Compact => {
            Err(NotCompact::MovesTogether { mark: mark.name.clone() })
        }
        _ => Ok(()),
    }
}

impl Plan {
    /// Returns the motions as compact points, in steps as fine as the longest of them allows; `None` where the setup's PLC sends full
    /// motions.
    ///
    /// # Errors
    ///
    /// [`NotCompact`]: the motions have no compact form.
    pub fn wire_points(&self, setup: &Setup) -> Result<Option<CompactPath>, NotCompact> {
        if setup.plc.sends_in_form() == SlotForm::Full {
            return Ok(None);
        }
        let start = self.to_start.from_anywhere.as_ref().ok_or(NotCompact::NoStart)?;
        let motions: Vec<_> = self.motions.iter().map(|motion| motion.wire(setup)).collect();
        let count = motions.len();
        // The list ends at its last point, and the arm rests at a mark, whatever the zone there.
        let rests =
            |index: usize| index + 1 == count || self.waits.iter().any(|wait| wait.after == index + 1);
        let passing = motions.iter().enumerate().find(|(index, _)| !rests(*index)).map(|(_, motion)| motion);
        let first = passing.or_else(|| motions.first()).ok_or(NotCompact::Empty)?;
        if let Some(stop) = self.continuous.iter().map(|it| it.motions.end).find(|end| *end < count) {
            return Err(NotCompact::Stops { after: stop, motions: count });
        }
        for (index, motion) in motions.iter().enumerate() {
            if motion.configuration != Motion::EMPTY.configuration {
                return Err(NotCompact::Configuration { motion: index + 1 });
            }
            let differing = [
                ("kind", motion.kind != first.kind),
                ("velocity", motion.velocity != first.velocity),
                ("acceleration", motion.acceleration != first.acceleration),
                ("tool", motion.tool != first.tool),
                ("base", motion.base != first.base),
                ("zone", motion.approximation != first.approximation && !rests(index)),
            ];
            if let Some((what, _)) = differing.into_iter().find(|(_, differs)| *differs) {
                return Err(NotCompact::Differs { motion: index + 1, what });
            }
        }
        let targets: Vec<_> = self.motions.iter().map(|motion| motion.target.mm_deg()).collect();
        Ok(Some(CompactPath::like(first, start.target.mm_deg(), &targets, None)?))
    }
}
