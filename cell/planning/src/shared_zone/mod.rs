//! Shared zones: volumes of the cell that only one arm may be in.
//!
//! ```text
//! volume   what of the cell an arm takes up: capsules about its links and tools, and the zones that they are in
//! visits   which motions of a plan go into a zone, and which is the first one after it
//! turns    whether the arms can take turns in every order, or wait for each other in a ring
//! ```
//!
//! A motion is the unit: an arm may execute the motions before a visit without asking, and stands at the exact end of the last
//! one, outside of the zone, until the PLC grants it. It has left once the PLC has seen the last motion of the visit executed.

mod turns;
mod visits;
mod volume;

pub use turns::{NoTurns, Waited, check_turns};
pub use visits::StationZones;
pub use volume::{ArmVolume, MOST_ZONES, ZoneSet};

pub(crate) use visits::find;
