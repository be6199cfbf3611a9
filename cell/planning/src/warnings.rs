//! The warnings of a plan: where a person should look at it. Those of one kind in one step are one sentence.

use std::fmt::Write as _;

use crate::plan::{Plan, Reason};
use crate::reach::Reached;
use crate::stopped::{Stopped, Unfit};
use crate::zone::{TANGENT_DEG, Why};

impl Plan {
    /// Returns the warnings of the plan as sentences that name the motions concerned.
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        let mut groups: Vec<Vec<&Reason>> = Vec::new();
        for reason in self.reasons.iter().filter(|reason| reason.why.is_warning()) {
            let belongs = |group: &&mut Vec<&Reason>| {
                group.first().is_some_and(|first| {
                    self.step_of(first) == self.step_of(reason) && are_alike(&first.why, &reason.why)
                })
            };
            match groups.iter_mut().find(belongs) {
                Some(group) => group.push(reason),
                None => groups.push(vec![reason]),
            }
        }
        let unused = self.unused.iter().map(|it| format!("{it} is in the application, and no step uses it"));
        groups.iter().map(|group| self.sentence(group)).chain(unused).collect()
    }

    fn step_of(&self, reason: &Reason) -> Option<usize> {
        self.motions.get(reason.motion).map(|motion| motion.step)
    }

    fn sentence(&self, group: &[&Reason]) -> String {
        let [first, .., last] = group else {
            return group.first().map_or_else(String::new, |one| self.one(one));
        };
        let step = self.step_of(first).and_then(|step| self.labels.get(step)).map_or("", |step| &step.step);
        let (count, from, to) = (group.len(), first.motion + 1, last.motion + 1);
        let of_them = if to + 1 - from == count { "" } else { "some of " };
        let motions = format!("step `{step}`, {of_them}motions {from} to {to}");
        match &first.why {
            Why::PathCorner { .. } => {
                let corners = group.iter().filter_map(|reason| match reason.why {
                    Why::PathCorner { corner_deg } => corner_deg,
                    _ => None,
                });
                if corners.clone().any(is_smooth) {
                    return format!("{motions}: the arm stops at {count} smooth junctions; {HAS_TOLERANCE}");
                }
                let angles =
                    range(corners, 0, "°").map_or_else(String::new, |angles| format!(" of {angles}"));
                format!("{motions}: {count} corners{angles} stop the arm on its path; {KEEPS_MOVING}")
            }
            Why::Shrunk { wanted_mm, .. } => {
                let zones =
                    group.iter().filter_map(|reason| self.motions.get(reason.motion)).map(|it| it.zone_mm);
                let zones = range(zones, 2, " mm").unwrap_or_default();
                format!(
                    "{motions} blend by {zones} instead of {wanted_mm} mm, {count} times: a motion gives at most half of \
                     its length"
                )
            }
            why => format!("{motions}: {why}"),
        }
    }

    fn one(&self, reason: &Reason) -> String {
        let called = |index: usize| {
            let name = self.motions.get(index).map_or("", |motion| motion.name.as_str());
            format!("motion {} `{name}`", index + 1)
        };
        let this = called(reason.motion);
        let zone = self.motions.get(reason.motion).map_or(0.0, |motion| motion.zone_mm);
        match &reason.why {
            Why::Shrunk { wanted_mm, short } => {
                let length = self.motions.get(*short).map_or(0.0, |motion| motion.length_mm);
                let (neighbour, cause) = if *short == reason.motion {
                    (*short + 1, "it".to_owned())
                } else {
                    (*short, called(*short))
                };
                format!(
                    "{this} blends into {} by {zone:.2} mm instead of {wanted_mm} mm: {cause} is only {length:.2} mm \
                     long and gives at most half",
                    called(neighbour)
                )
            }
            Why::SwallowsPoint { circle, .. } if *circle != reason.motion => {
                format!("{this}, before {}: {}", called(*circle), reason.why)
            }
            why @ Why::PathCorner { corner_deg } => {
                let is_smooth = corner_deg.is_some_and(is_smooth);
                format!("{this}: {why}; {}", if is_smooth { HAS_TOLERANCE } else { KEEPS_MOVING })
            }
            why => format!("{this}: {why}"),
        }
    }
}

/// The remedy for a corner on a path at which the arm stops.
const KEEPS_MOVING: &str = "use `spline` or `circle`, or the label `blending`";

/// The remedy for a junction that is smooth, on a path that may not be left.
const HAS_TOLERANCE: &str = "allow a deviation by `path_tolerance_mm`";

/// Returns whether a corner of this angle in degrees is a smooth junction.
fn is_smooth(corner_deg: f64) -> bool {
    corner_deg < TANGENT_DEG
}

/// Returns whether one sentence can say both.
fn are_alike(one: &Why, other: &Why) -> bool {
    match (one, other) {
        (Why::PathCorner { corner_deg: one }, Why::PathCorner { corner_deg: other }) => {
            one.is_some_and(is_smooth) == other.is_some_and(is_smooth)
        }
        (Why::Shrunk { wanted_mm: one, .. }, Why::Shrunk { wanted_mm: other, .. }) => one == other,
        (Why::Slower { .. }, Why::Slower { .. }) => one == other,
        _ => false,
    }
}

/// Returns the lowest and the highest value, or the only one, as printed with this many decimals; `None` without values.
fn range(values: impl Iterator<Item = f64>, decimals: usize, unit: &str) -> Option<String> {
    let (lowest, highest) = values.fold(None, |range: Option<(f64, f64)>, value| {
        Some(range.map_or((value, value), |(lowest, highest)| (lowest.min(value), highest.max(value))))
    })?;
    let (lowest, highest) = (format!("{lowest:.decimals$}"), format!("{highest:.decimals$}"));
    Some(if lowest == highest { lowest + unit } else { format!("{lowest} to {highest}{unit}") })
}

impl Reached {
    /// Returns where the arm stops although the plan passes, as sentences: one for each cause.
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        let mut groups: Vec<Vec<&Stopped>> = Vec::new();
        for stopped in &self.stopped {
            let is_cause =
                |one: &&Stopped| one.unfit == stopped.unfit || both_corners(one.unfit, stopped.unfit);
            match groups.iter_mut().find(|group| group.first().is_some_and(is_cause)) {
                Some(group) => group.push(stopped),
                None => groups.push(vec![stopped]),
            }
        }
        groups.iter().map(|group| places(group)).collect()
    }
}

/// Returns whether the arm cannot follow either corner, wherever on it.
const fn both_corners(one: Unfit, other: Unfit) -> bool {
    matches!((one, other), (Unfit::Corner(_), Unfit::Corner(_)))
}

/// Returns the first place of a cause as a sentence, and how many there are.
fn places(group: &[&Stopped]) -> String {
    let Some((first, more)) = group.split_first() else { return String::new() };
    let mut sentence = first.to_string();
    if let Some(last) = more.last() {
        let count = more.len();
        let places = if count == 1 { "place" } else { "places" };
        // Writing into a string does not fail.
        let _ = write!(
            sentence,
            "; likewise at {count} more {places}, the last before motion {}",
            last.number + 1
        );
    }
    sentence
}
