//! What the PLC node and the robot node share: the skill process image and the fieldbus stacks.
//!
//! Everything here is a [`machine::Machine`]: plain state that gets time and frames as arguments and returns frames,
//! events and its next deadline. The crate is `no_std`, so it cannot use a clock, a socket, a thread or a file; a
//! driver provides those (`protocol-linux` in real time, `virtual_time` in virtual time).

#![cfg_attr(not(test), no_std)]
#![warn(clippy::indexing_slicing)]

extern crate alloc;

pub mod bus_polls;
pub mod buses;
pub mod direct;
pub mod fieldbus;
pub mod image;
pub mod one_station;
pub mod search;
pub mod stations;
