//! What the PLC node and the robot node agree on: the skill process image and the fieldbus stacks.
//!
//! Everything here is a [`Machine`]: plain state that gets time and frames as arguments and hands out frames,
//! events and its next deadline. The crate is `no_std`, so it cannot name a clock, a socket, a thread or a file;
//! a driver (`protocol-linux` in real time, [`virtual_time`] without time) brings those.

#![cfg_attr(not(test), no_std)]
#![warn(clippy::indexing_slicing)]

extern crate alloc;

mod cycle;
pub mod direct;
pub mod ethernet_ip;
pub mod fieldbus;
pub mod image;
mod lateness;
mod machine;
pub mod profinet;
pub mod search;
mod time;
pub mod virtual_time;
pub mod wire;

pub use cycle::{Cycle, Tick};
pub use lateness::Lateness;
pub use machine::{Machine, Port, Source, StreamChange, StreamId, StreamRequest, Transmit};
pub use time::{Duration, Instant};
