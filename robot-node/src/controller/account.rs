//! Account of what one skill did, for the verification of a run: which motions, at which override, from which joints to
//! which, and how long it took.

use core::time::Duration;

use machine::Instant;
use protocol::image::{Skill, Sum};
use serde::{Deserialize, Serialize};

use crate::arm::{AXES, Joints};

/// Prime of the hash FNV-1a with 64 bits, which joins the digests of consecutive skills.
const PRIME: u64 = 0x0000_0100_0000_01B3;

/// Account of a skill, or of several after each other.
#[derive(Clone, Copy, PartialEq, Debug, Serialize, Deserialize)]
pub struct Account {
    /// Number of skills.
    pub skills: u32,
    /// Number of motions that were put on the path.
    pub motions: u64,
    /// Digest of these motions, of the skills' codes and of where one skill ended and the next began.
    pub digest: u64,
    /// Lowest and highest override that was in effect while the arm followed no master axis, in %; 255 and 0 if there was none.
    pub override_percent: [u8; 2],
    /// Lowest and highest override that was in effect while the arm followed a master axis, in %; 255 and 0 if there was none.
    #[serde(default = "no_override")]
    pub led_override_percent: [u8; 2],
    /// Time from the first motion's start to the end of the skill, without `at_marks`: what neither a phase of the interpreter nor other arms
    /// change.
    #[serde(default)]
    pub motion_time: Duration,
    /// Time of this for which set-points were at rest, and drives had not arrived.
    #[serde(default)]
    pub waited: Duration,
    /// Time for which the program stood at marks and the other arms had not come.
    #[serde(default)]
    pub at_marks: Duration,
    /// When the first motion started.
    #[serde(skip)]
    pub(super) began: Option<Instant>,
    /// Joints at the start, in degrees (mm).
    pub start: Joints,
    /// Joints at the end, in degrees (mm).
    pub end: Joints,
}

impl Default for Account {
    /// Returns the account of no skill.
    fn default() -> Self {
        Self {
            skills: 0,
            motions: 0,
            digest: 0,
            override_percent: no_override(),
            led_override_percent: no_override(),
            motion_time: Duration::ZERO,
            waited: Duration::ZERO,
            at_marks: Duration::ZERO,
            began: None,
            start: [0.0; AXES],
            end: [0.0; AXES],
        }
    }
}

impl Account {
    /// Begins the account of a skill that starts at these joints.
    pub(super) fn begin(start: Joints) -> Self {
        Self { skills: 1, start, end: start, ..Self::default() }
    }

    /// Notes the override of a cycle, in which the arm followed a master axis or none.
    pub(super) fn note_override(&mut self, percent: u8, is_led: bool) {
        let of_cycles = if is_led { &mut self.led_override_percent } else { &mut self.override_percent };
        *of_cycles = both(*of_cycles, [percent; 2]);
    }

    /// Returns the lowest and the highest override of all cycles, in %.
    #[must_use]
    pub fn whole_override_percent(&self) -> [u8; 2] {
        both(self.override_percent, self.led_override_percent)
    }

    /// Returns the account of the skill as it ended at `at`.
    pub(super) fn close(self, skill: Skill, accepted: Sum, end: Joints, at: Instant) -> Self {
        let digest = join(accepted.value, u64::from(u8::from(skill)));
        let motion_time =
            self.began.map_or(Duration::ZERO, |began| at.since(began).saturating_sub(self.at_marks));
        Self { motions: accepted.motions, digest, motion_time, began: None, end, ..self }
    }

    /// Returns the account of this and then the other.
    #[must_use]
    pub fn then(self, other: Self) -> Self {
        if self.skills == 0 {
            return other;
        }
        Self {
            skills: self.skills.saturating_add(other.skills),
            motions: self.motions.saturating_add(other.motions),
            digest: join(self.digest, other.digest),
            override_percent: both(self.override_percent, other.override_percent),
            led_override_percent: both(self.led_override_percent, other.led_override_percent),
            motion_time: self.motion_time.saturating_add(other.motion_time),
            waited: self.waited.saturating_add(other.waited),
            at_marks: self.at_marks.saturating_add(other.at_marks),
            began: None,
            start: self.start,
            end: other.end,
        }
    }
}

/// Returns the range of no cycle.
const fn no_override() -> [u8; 2] {
    [u8::MAX, 0]
}

/// Returns the range that covers both.
fn both([low, high]: [u8; 2], [other_low, other_high]: [u8; 2]) -> [u8; 2] {
    [low.min(other_low), high.max(other_high)]
}

fn join(digest: u64, next: u64) -> u64 {
    next.to_be_bytes().iter().fold(digest, |value, byte| (value ^ u64::from(*byte)).wrapping_mul(PRIME))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn account(digest: u64, override_percent: [u8; 2]) -> Account {
        Account { skills: 1, motions: 2, digest, override_percent, ..Account::default() }
    }

    #[test]
    fn accounts_of_skills_add_up_and_their_order_counts() {
        let (one, other) = (account(1, [80, 100]), account(2, [50, 90]));
        let both = one.then(other);
        assert_eq!((both.skills, both.motions, both.override_percent), (2, 4, [50, 100]));
        assert_eq!((both.led_override_percent, both.whole_override_percent()), ([255, 0], [50, 100]));
        assert_ne!(both.digest, other.then(one).digest);
        assert_eq!(Account::default().then(one), one);
    }
}
