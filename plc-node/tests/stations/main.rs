//! A PLC with two stations, in virtual time.
#![expect(clippy::panic, clippy::unwrap_used, reason = "a test that cannot go on stops")]

mod buses;
mod cell;
mod in_step;
mod line;
mod losses;
mod marks;
mod raw_images;
mod robot;
