#![doc = include_str!("../README.md")]
#![cfg_attr(not(test), no_std)]
#![warn(clippy::indexing_slicing)]

extern crate alloc;

mod clock;
pub mod hostile;
mod link;
mod network;
mod pair;
mod plan;
mod side;

pub use clock::Clock;
pub use link::{FrameFault, FrameFaults, Impairment, Link, LinkCounters, LinkEffect};
pub use network::{Network, StationId};
pub use pair::{Carrier, Event, Pair, PairConfig, Segment, Tapped};
pub use plan::ImpairmentPlan;
pub use side::Side;
