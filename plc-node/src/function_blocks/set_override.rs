//! The override as a function block: PLCopen's MC_GroupSetOverride.

use super::BlockError;
use crate::{AxesGroup, Override};

/// The factors by which the programmed motion is multiplied.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct OverrideFactors {
    /// PLCopen's `VelFactor`: share of every programmed velocity, 0…1. At 0 the arm stops on its path and stays in its skill.
    pub velocity: f64,
    /// PLCopen's `AccFactor`: share of every programmed acceleration. The robot has 1 only.
    pub acceleration: f64,
    /// PLCopen's `JerkFactor`: share of every jerk. The robot has 1 only.
    pub jerk: f64,
}

impl Default for OverrideFactors {
    /// Creates the factors that leave the programmed motion unchanged.
    fn default() -> Self {
        Self { velocity: 1.0, acceleration: 1.0, jerk: 1.0 }
    }
}

/// The outputs of a block that works while `Enable` is TRUE. At most one of them is TRUE beside `Busy`.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug)]
pub struct EnableOutputs {
    /// The block writes the override into the image.
    pub busy: bool,
    /// The robot follows the override at the input.
    pub enabled: bool,
    /// Something is wrong; the override that was set last stands.
    pub error: bool,
    /// What is wrong, see [`BlockError::error_id`]; 0 without an error.
    pub error_id: u16,
}

/// Sets the override while `Enable` is TRUE, whether a skill runs or not. The robot changes its speed within its limits.
///
/// The override stays after the falling edge of `Enable`. An input out of its range is an error and is not written: the
/// running skill continues with the override before. An error is shown until `Enable` falls, even if its cause is gone.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug)]
pub struct GroupSetOverride {
    pub(super) phase: Phase,
}

#[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug)]
pub(super) enum Phase {
    #[default]
    Off,
    /// The image holds `to`.
    Busy {
        to: Override,
        /// The first scan with it.
        since: u64,
        /// Scans since then in which the robot did not go by it.
        waited: u32,
        enabled: bool,
    },
    Failed(BlockError),
}

impl GroupSetOverride {
    /// Runs one scan.
    pub fn call(&mut self, enable: bool, factors: &OverrideFactors, group: &mut AxesGroup) -> EnableOutputs {
        self.phase = match self.phase {
            _ if !enable => Phase::Off,
            Phase::Failed(error) => Phase::Failed(error),
            phase => set(phase, factors, group).unwrap_or_else(Phase::Failed),
        };
        self.outputs()
    }

    fn outputs(&self) -> EnableOutputs {
        match self.phase {
            Phase::Off => EnableOutputs::default(),
            Phase::Busy { enabled, .. } => EnableOutputs { busy: true, enabled, ..EnableOutputs::default() },
            Phase::Failed(error) => {
                EnableOutputs { error: true, error_id: error.error_id(), ..EnableOutputs::default() }
            }
        }
    }

    /// Returns the error behind `ErrorID`; `None` without an error.
    #[must_use]
    pub const fn error(&self) -> Option<BlockError> {
        match self.phase {
            Phase::Failed(error) => Some(error),
            _ => None,
        }
    }
}

fn set(phase: Phase, factors: &OverrideFactors, group: &mut AxesGroup) -> Result<Phase, BlockError> {
    for (name, factor) in [("AccFactor", factors.acceleration), ("JerkFactor", factors.jerk)] {
        if factor != 1.0 {
            return Err(BlockError::FactorNotSupported { name, found: factor.into() });
        }
    }
    let to = Override::from_percent(factors.velocity * 100.0)
        .map_err(|_| BlockError::OverrideOutOfRange { found: factors.velocity.into() })?;
    let Some(feedback) = group.feedback() else { return Err(BlockError::NotConnected) };
    let in_effect = feedback.override_percent;
    let (since, waited) = match phase {
        Phase::Busy { to: before, since, waited, .. } if before == to => (since, waited),
        _ => (group.scans(), 0),
    };
    let enabled = in_effect == to.percent() && group.has_seen(since);
    let scans = group.answer_scans();
    if !enabled && waited >= scans {
        return Err(BlockError::OverrideNotTaken { wanted: to.percent(), in_effect, scans });
    }
    group.set_override(to);
    Ok(Phase::Busy { to, since, waited: if enabled { 0 } else { waited.saturating_add(1) }, enabled })
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use protocol::image::Feedback;

    use super::*;
    use crate::WaitLimits;

    const PATIENCE: WaitLimits = WaitLimits { answer_scans: 3, silent_scans: u32::MAX };

    fn velocity(velocity: f64) -> OverrideFactors {
        OverrideFactors { velocity, ..OverrideFactors::default() }
    }

    fn group_with(feedback: Option<Feedback>) -> AxesGroup {
        let mut group = AxesGroup::new(PATIENCE);
        group.read(feedback);
        group
    }

    fn in_effect(override_percent: u8, life_echo: u16) -> Option<Feedback> {
        Some(Feedback { override_percent, life_echo, ..Feedback::default() })
    }

    #[test]
    fn it_is_enabled_once_the_robot_goes_by_the_override_and_again_after_each_change() {
        let mut group = AxesGroup::new(PATIENCE);
        let mut block = GroupSetOverride::default();
        let mut scan = |factor, feedback| {
            group.read(feedback);
            let outputs = block.call(true, &velocity(factor), &mut group);
            assert!(outputs.busy && !outputs.error, "{:?}", block.error());
            (group.command().override_percent, outputs.enabled)
        };
        assert_eq!(scan(0.0, in_effect(100, 0)), (0, false));
        assert_eq!(scan(0.0, in_effect(100, 1)), (0, false));
        assert_eq!(scan(0.0, in_effect(0, 2)), (0, true));
        assert_eq!(scan(0.5, in_effect(50, 3)), (50, false), "50 % from before this scan is no answer");
        assert_eq!(scan(0.5, in_effect(50, 4)), (50, true));
    }

    #[test]
    fn what_the_robot_does_not_have_is_refused_in_words_and_the_override_stays() {
        let refusals = [
            velocity(1.2),
            velocity(-0.1),
            velocity(f64::NAN),
            OverrideFactors { acceleration: 0.5, ..OverrideFactors::default() },
            OverrideFactors { jerk: 0.0, ..OverrideFactors::default() },
        ];
        let told: Vec<String> = refusals
            .iter()
            .map(|factors| {
                let mut group = group_with(in_effect(70, 0));
                group.set_override(Override::from_percent(70.0).unwrap());
                let mut block = GroupSetOverride::default();
                let outputs = block.call(true, factors, &mut group);
                assert!(outputs.error && outputs.error_id != 0 && group.command().override_percent == 70);
                block.error().unwrap().to_string()
            })
            .collect();
        insta::assert_snapshot!(told.join("\n"), @"
        VelFactor is 1.2, it may be 0 (the arm stops on its path) to 1; the override stays as it is
        VelFactor is -0.1, it may be 0 (the arm stops on its path) to 1; the override stays as it is
        VelFactor is NaN, it may be 0 (the arm stops on its path) to 1; the override stays as it is
        AccFactor is 0.5, but must be 1: this robot overrides only velocities; the override stays as it is
        JerkFactor is 0, but must be 1: this robot overrides only velocities; the override stays as it is
        ");
    }

    #[test]
    fn it_stays_enabled_for_longer_than_the_life_counter_counts() {
        let (mut group, mut block) = (AxesGroup::new(PATIENCE), GroupSetOverride::default());
        let mut echo = 0;
        for scan in 0..200_000 {
            group.read(in_effect(70, echo));
            let outputs = block.call(true, &velocity(0.7), &mut group);
            assert!(outputs.enabled || scan < 2, "scan {scan}: {:?}", block.error());
            echo = group.command().life;
        }
    }

    /// Every order of `Enable`, factors, robot images and lost connections.
    #[test]
    fn it_keeps_the_rules_in_every_order_of_events() {
        let images = [None, in_effect(100, 0), in_effect(100, 1), in_effect(0, 0), in_effect(0, 1)];
        let mut found = HashSet::from([(GroupSetOverride::default(), 100)]);
        let mut open: Vec<_> = found.iter().copied().collect();
        let mut shown = HashSet::new();
        while let Some((block, percent)) = open.pop() {
            for (image, factor) in
                images.iter().flat_map(|image| [0.0, 1.0, 1.2].map(|factor| (*image, factor)))
            {
                for enable in [false, true] {
                    let mut group = group_with(image);
                    group.set_override(Override::from_percent(f64::from(percent)).unwrap());
                    let mut next = block;
                    let outputs = next.call(enable, &velocity(factor), &mut group);
                    let written = group.command().override_percent;
                    assert!(enable || outputs == EnableOutputs::default());
                    assert!(!enable || outputs.busy != outputs.error, "one of them while Enable is TRUE");
                    assert!(outputs.busy || !outputs.enabled);
                    assert_eq!(outputs.error, outputs.error_id != 0);
                    assert!(outputs.busy || written == percent, "an error and a FALSE leave the override");
                    let as_wanted = f64::from(written) == factor * 100.0;
                    assert!(!outputs.busy || as_wanted);
                    let confirmed = image.is_some_and(|image| image.override_percent == written);
                    assert!(!outputs.enabled || confirmed, "enabled for no reason");
                    // The first image with an override is always that of this group's only scan.
                    if found.insert((next, written)) {
                        open.push((next, written));
                    }
                    shown.insert((outputs.busy, outputs.enabled, outputs.error_id));
                }
            }
        }
        let ids: HashSet<u16> = shown.iter().map(|(_, _, id)| *id).collect();
        assert_eq!(ids, HashSet::from([0, 0x8001, 0x800E, 0x8010]));
        assert!(shown.contains(&(true, true, 0)) && shown.contains(&(true, false, 0)));
    }
}
