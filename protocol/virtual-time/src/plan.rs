//! The faults of a cable, from its start to its end.

use alloc::vec::Vec;
use core::time::Duration;

use crate::Impairment;

/// What the cable does to frames, and when it is cut.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct ImpairmentPlan {
    /// Impairments of the frames that the first end sends, and of those that the second end sends.
    pub links: [Impairment; 2],
    /// Times of cuts (true) and mends (false), counted from when both ends are ready; in order.
    pub cuts: Vec<(Duration, bool)>,
    /// Seed of the random decisions; it has the same meaning as for a virtual cable's links.
    pub seed: u64,
}
