//! The second layer, executed against the PLC's own function blocks over random scripts: the images change between any two reads,
//! and the motions that the arm begins are compared with those commanded.
#![expect(clippy::unwrap_used, clippy::panic, reason = "a test that cannot go on stops")]

mod causes;
mod cell;
mod plc;
mod random;
mod rules;
mod scripts;
mod self_test;
