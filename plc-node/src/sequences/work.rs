//! The work of a station: its motions, and where among them its arm waits for others.

use machine::Instant;
use planning::{StationZones, Stop, WaitAt, ZoneVisit};
use setup::Refill;

use crate::MotionSource;

/// What a station runs.
#[derive(Debug)]
pub struct StationWork {
    /// The program in the robot controller that RC runs.
    pub program: u16,
    /// How many motions MoveContinuous writes ahead of those that are executed, 1..=5.
    pub queue_depth: u32,
    /// The count of the robot by which it refills slots.
    pub refill: Refill,
    /// The motions that SM and CM run.
    pub motions: Box<dyn MotionSource>,
    /// Where their continuous motions end, in order, and what the PLC switches there.
    pub stops: Vec<Stop>,
    /// Where the arm waits for others, in order; none where it works alone.
    pub waits: Vec<WaitAt>,
    /// Visits of the arm in shared zones, in order.
    pub visits: Vec<ZoneVisit>,
    /// Volume of its arm in the cell; `None` in a cell without shared zones.
    pub zones: Option<StationZones>,
}

impl StationWork {
    /// Returns this work in a cell with shared zones.
    #[must_use]
    pub fn in_zones(self, visits: &[ZoneVisit], zones: Option<&StationZones>) -> Self {
        Self { visits: visits.to_vec(), zones: zones.cloned(), ..self }
    }
}

/// When an arm came to a mark, and when it went on, by the scans of the PLC.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct MarkPassage {
    /// Number of the mark.
    pub mark: u32,
    /// The first scan in which the PLC saw the arm stand there.
    pub came: Instant,
    /// The scan that let it pass; `None` while it waits.
    pub passed: Option<Instant>,
}
