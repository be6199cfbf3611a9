//! The result of planning.

use std::ops::Range;

use crate::application::{Action, Application, Labels};
use crate::mark_signal::MarkSignal;
use crate::motion::Motion;
use crate::zone::Why;
use setup::Setup;

/// The motions of an application on a setup, with the reason for each zone. It prints itself; `{:#}` prints every
/// cycle, and a width, `{:60}`, makes it fit a screen of that many characters.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct Plan {
    /// The application's name.
    pub name: String,
    /// What happens in it.
    pub title: String,
    /// The setup's name.
    pub setup: String,
    /// All motions in order.
    pub motions: Vec<Motion>,
    /// What comes before a repetition and is no part of it.
    pub to_start: ToStart,
    /// The continuous motions: each is one MoveContinuousSkill and ends in an accurate stop.
    pub continuous: Vec<Continuous>,
    /// The labels at process level.
    pub labels: Vec<StepLabels>,
    /// Why things are as they are: one reason of a zone for each motion, and more where there is more to say; ordered
    /// by motion.
    pub reasons: Vec<Reason>,
    /// Index of the first motion of each cycle.
    pub cycles: Vec<usize>,
    /// Where the arm waits for others, in order; empty where one arm works alone.
    pub waits: Vec<WaitAt>,
    /// Visits of the arm in shared zones of its cell, in order; empty without such zones.
    pub visits: Vec<ZoneVisit>,
    /// The tools and bases that the application has and does not use.
    pub unused: Vec<String>,
}

/// A place in the list of motions at which the arm rests until the other arms of a mark have come: the PLC writes no motion
/// beyond it before.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct WaitAt {
    /// Number of the mark.
    pub mark: u32,
    /// How many motions of the plan are executed there; the last of them ends in an exact stop.
    pub after: usize,
    /// Whether the action at this stop comes first, and not after the wait.
    pub after_action: bool,
    /// Outputs by which the robot's stored program waits there itself; without them the PLC starts another program after the mark.
    pub signal: Option<MarkSignal>,
}

/// A part of a plan in which the arm may be in a shared zone.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ZoneVisit {
    /// Number of the zone in the setup, from 0.
    pub zone: usize,
    /// Number of motions that the arm may execute before the zone is granted to it: at the end of the last one it stands outside.
    pub after: usize,
    /// Number of motions that are executed when it has left the zone.
    pub until: usize,
}

/// How the arm moves to the place of the tool before the first step. The PLC moves it there before a repetition, unless
/// it is there; this is not measured.
#[derive(Clone, PartialEq, Debug)]
pub struct ToStart<M = Motion> {
    /// Point to point from anywhere; `None` if the start is not known.
    pub from_anywhere: Option<M>,
    /// On a way that is free of obstacles, from the end of the last motion; empty if that is the start.
    pub from_end: Vec<M>,
}

impl<M> Default for ToStart<M> {
    fn default() -> Self {
        Self { from_anywhere: None, from_end: Vec::new() }
    }
}

/// A sequence of motions without an accurate stop but at its end.
#[derive(Clone, PartialEq, Debug)]
pub struct Continuous {
    /// Indices of its motions.
    pub motions: Range<usize>,
    /// What happens at its end.
    pub then: Option<Action>,
}

/// What a step asks for.
#[derive(Clone, PartialEq, Debug)]
pub struct StepLabels {
    /// The step's name.
    pub step: String,
    /// What it is for.
    pub does: String,
    /// Its labels.
    pub labels: Labels,
}

/// A reason and what it is the reason of.
#[derive(Clone, PartialEq, Debug)]
pub struct Reason {
    /// Index of the motion.
    pub motion: usize,
    /// Why it is as it is.
    pub why: Why,
}

impl Plan {
    /// Creates a plan without motions, with the labels at process level.
    pub(crate) fn empty(application: &Application, setup: &Setup) -> Self {
        let labels = application.steps.iter().map(|step| StepLabels {
            step: step.name.clone(),
            does: step.does.clone(),
            labels: step.labels,
        });
        Self {
            name: application.name.clone(),
            title: application.title.clone(),
            setup: setup.name.clone(),
            labels: labels.collect(),
            unused: application.unused.clone(),
            ..Self::default()
        }
    }

    /// Forgets the motions and keeps their memory.
    pub(crate) fn clear(&mut self) {
        self.motions.clear();
        self.continuous.clear();
        self.reasons.clear();
        self.cycles.clear();
        self.waits.clear();
        self.visits.clear();
    }

    /// Returns the marks at which the arm waits once this many motions are executed, in order.
    pub fn waits_after(&self, motions: usize) -> impl Iterator<Item = &WaitAt> {
        let first = self.waits.partition_point(|wait| wait.after < motions);
        self.waits.iter().skip(first).take_while(move |wait| wait.after == motions)
    }

    /// Returns whether the arm rests once this many motions are executed: at the end of a continuous motion, or at a mark.
    pub(crate) fn rests_after(&self, motions: usize) -> bool {
        self.continuous.last().is_some_and(|it| it.motions.end == motions)
            || self.waits_after(motions).next().is_some()
    }
}
