//! The exported code, executed as text, beside the PLC's own function blocks: both get each image of the robot, and each byte of
//! both commands is compared in each scan. The robot obeys the exported code.
#![expect(clippy::panic, clippy::unwrap_used, reason = "a test that cannot go on stops")]

mod bed;
mod dialects;
mod directory;
mod faults;
mod leading;
mod long;
mod random;
mod read_back;
mod runs;
