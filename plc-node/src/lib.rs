//! The PLC: a cyclic scan, one function block for each skill, and the three ways of running a sequence that the
//! paper compares.
//!
//! ```text
//! node                 PlcNode: a Machine over any Fieldbus; runs and failures
//! ├─ scan              inputs → program → outputs on an absolute grid
//! ├─ readiness         leads the robot to Ready
//! ├─ start_position    moves the arm to where a run starts
//! ├─ sequence          RC, SM and CM as a PLC program steps through them
//! ├─ function_blocks   PLCopen faces: Execute → Busy, Active, Done, CommandAborted, Error, ErrorID
//! └─ axes_group        the robot as the program sees it: one command, one feedback, the command number
//! ```
//!
//! Nothing here reads a clock, opens a socket or allocates after [`PlcNode::new`]; time and frames are arguments.

#![cfg_attr(not(test), warn(clippy::print_stdout, clippy::print_stderr))]

mod advice;
mod axes_group;
pub mod bus;
pub mod command_line;
mod config;
#[cfg(all(feature = "real", target_os = "linux"))]
mod discover;
mod event;
mod export;
mod export_command;
pub mod function_blocks;
mod motion_source;
mod node;
mod plan_command;
#[cfg(all(feature = "real", target_os = "linux"))]
pub mod process;
mod readiness;
mod sample;
mod scan;
mod sequence;
mod speed_override;
mod start_position;
mod waiting;

pub use axes_group::{AxesGroup, WaitLimits};
pub(crate) use axes_group::{Ticket, Turn};
pub use config::PlcConfig;
pub use event::{
    Commanded, Execution, ExecutionType, Failure, FailureCause, PlcEvent, Seen, StartError,
    UnknownExecutionType,
};
pub use motion_source::{MotionList, MotionSource};
pub use node::PlcNode;
pub use sample::Sample;
pub use scan::Scan;
pub use speed_override::{Override, OverrideError, OverrideSchedule, OverrideStep, ScheduleError};
pub use waiting::WaitingFor;
