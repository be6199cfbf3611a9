#![doc = include_str!("../README.md")]
#![cfg_attr(not(test), no_std)]
#![warn(clippy::indexing_slicing)]

extern crate alloc;

mod allowed;
pub mod arp;
mod contract;
mod cycle;
pub mod ethernet;
mod foreign;
mod lateness;
mod link;
mod link_status;
mod machines;
mod multihomed;
mod owner_report;
mod schedule;
pub mod search;
mod sequence;
mod time;
pub mod wire;

pub use allowed::{Allowed, Peer};
pub use contract::{
    Attempt, Machine, Pending, Port, PortRequest, Source, StreamChange, StreamId, StreamRequest, Transmit,
};
pub use cycle::{Cycle, Tick};
pub use foreign::{ForeignRequest, ForeignRequests, Requested, Sender};
pub use lateness::Lateness;
pub use link::{Counters, Down, DownCause, LinkEvent, StationConflict};
pub use link_status::{LinkCounters, LinkStatus, Medium};
pub use machines::Machines;
pub use multihomed::{InterfaceId, Multihomed};
pub use owner_report::{OwnerReport, OwnerReports};
pub use schedule::{Deadlines, Directory, Numbers, Turns};
pub use sequence::{Numbering, Sequence};
pub use time::{Duration, Instant};
