#![doc = include_str!("../README.md")]
#![cfg_attr(not(test), no_std)]
#![warn(clippy::indexing_slicing)]

extern crate alloc;

mod axes;
mod axis;
mod description;
mod drive;
mod drives;
mod error_code;
mod motor;
mod objects;
mod process_data;
mod state;

pub use axes::{Axes, AxisError, Cause};
pub use axis::{Axis, Power, Wanted};
pub use description::DRIVE;
pub use drive::{Drive, Parameters, QuickStop};
pub use drives::{DriveConfig, DriveEvent, Drives};
pub use error_code::ErrorCode;
pub use process_data::{INPUT_LEN, Inputs, OUTPUT_LEN, Outputs};
pub use state::{Command, Mode, State, StatusWord, control};
