#![doc = include_str!("../README.md")]
#![cfg_attr(not(test), no_std)]
#![warn(clippy::indexing_slicing)]

extern crate alloc;

mod clock;
mod either;
pub mod hostile;
mod link;
mod network;
mod pair;
mod plan;
mod side;

pub use clock::Clock;
pub use either::{Either, Event};
pub use link::{FrameFault, FrameFaults, Impairment, Link, LinkCounters, LinkEffect};
pub use network::{
    CableId, Carrier, Network, NicId, NodeId, Plug, Segment, StationConfig, SwitchConfig, SwitchCounters,
    SwitchId, Tapped,
};
pub use pair::{Pair, PairConfig};
pub use plan::ImpairmentPlan;
pub use side::Side;
