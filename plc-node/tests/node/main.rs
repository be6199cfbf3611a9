//! The PLC node against a scripted robot, in virtual time.
#![expect(clippy::panic, clippy::unwrap_used, reason = "a test that cannot go on stops")]

mod blocks;
mod disorder;
mod executions;
mod faults;
mod overrides;
mod scripted;
mod silence;
mod start_position;
mod stops;
