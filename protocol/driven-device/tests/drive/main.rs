//! Devices of files, emulated and driven in virtual time: what one end sets the other end shows.

#![expect(clippy::panic, clippy::unwrap_used, reason = "a test")]
mod allocation;
mod bad_input;
mod cell;
mod exchange;
mod intervals;
mod mailbox;
mod modules;
mod parameters;
mod positions;
mod records;
mod several;
mod shapes;
