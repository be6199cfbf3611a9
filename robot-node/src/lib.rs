//! The robot node: an arm, its controller, and the fieldbus endpoint that feeds it.
//!
//! Top down: [`RobotNode`] is the machine that a driver runs. On every robot cycle it hands the command image to the
//! [`Controller`], which dispatches skills and keeps the queue of motions; the [`motion`] module turns the queue into
//! one path and a speed along it; the [`arm`] module knows the joints; [`quality`] watches how well they move.
//!
//! Lengths are in mm, angles in degrees and joints in degrees (mm on a linear joint) everywhere, as on the wire.

#![cfg_attr(not(test), warn(clippy::print_stdout, clippy::print_stderr))]

/// The arm: what the crate `arm` has.
pub mod arm {
    pub use ::arm::*;
}
pub mod bus;
mod cell;
mod config;
pub mod controller;
mod drive_segment;
#[cfg(all(feature = "real", target_os = "linux"))]
pub mod emulate;
#[cfg(all(feature = "real", target_os = "linux"))]
mod export_command;
pub mod motion;
mod node;
#[cfg(all(feature = "real", target_os = "linux"))]
pub mod process;
pub mod quality;
pub mod rehearsal;
mod robot_in_line;
mod sample;
mod waiting;

pub use arm::ConfigError;
pub use cell::StartOutOfReach;
pub use config::{ForceControl, RobotConfig, ServoLimits};
pub use controller::{Account, Controller, Ending, ImageFault, Program, RobotEvent};
pub use drive_segment::{Disturbance, DriveSegment};
pub use node::RobotNode;
pub use quality::Quality;
pub use robot_in_line::RobotInLine;
pub use sample::{Positions, Sample};
pub use waiting::WaitingFor;
