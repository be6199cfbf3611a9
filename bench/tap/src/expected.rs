//! The skills of a repetition, by the plan of setup and application.

use planning::{Plan, Switch};
use protocol::image::Motion;
use setup::Setup;

/// The skills of one repetition of each type.
#[derive(Clone, PartialEq, Debug)]
pub struct ExpectedRun {
    /// The motions: SM's skills.
    pub(crate) motions: Vec<Motion>,
    /// Motions of each continuous motion: CM's skills.
    pub(crate) continuous: Vec<u32>,
    /// Output that SM and CM switch at the end, with the time that they wait for it.
    pub(crate) last_switch: Option<Switch>,
}

impl ExpectedRun {
    /// Returns what a run of this plan in this setup consists of.
    #[must_use]
    pub fn of(plan: &Plan, setup: &Setup) -> Self {
        let motions = plan.wire_motions(setup);
        let stops = plan.stops();
        let total = u32::try_from(motions.len()).unwrap_or(u32::MAX);
        let ends = stops.iter().map(|stop| stop.after).filter(|after| *after < total).chain([total]);
        let mut begin = 0;
        let continuous = ends.map(|end| {
            let motions = end.saturating_sub(begin);
            begin = end;
            motions
        });
        let continuous = continuous.filter(|motions| *motions > 0).collect();
        let last = stops.iter().rfind(|stop| stop.after == total);
        Self { motions, continuous, last_switch: last.and_then(|stop| stop.then) }
    }
}
