//! The PLC: a cyclic scan, one function block for each skill, and the three ways of running a sequence that the
//! paper compares.
//!
//! ```text
//! plc                  PlcNode: buses, stations and a program, on an interface for each bus; runs and failures
//! ├─ scan              inputs → program → outputs on an absolute grid
//! ├─ station           a robot: its images, its readiness, the way to where a run starts, its silence
//! ├─ program           PlcProgram: what runs over the stations
//! ├─ sequences         the program of the paper: RC, SM and CM at each station; marks between them
//! ├─ exported_program  exported code in the place of all that; any_program is the choice
//! ├─ zones             shared zones: which arm may be in which one
//! ├─ sequence          one of them, as a PLC program steps through it
//! ├─ function_blocks   PLCopen faces: Execute → Busy, Active, Done, CommandAborted, Error, ErrorID
//! ├─ axes_group        the robot as the program sees it: one command, one feedback, the command number
//! └─ robot_clock       a robot's clock, estimated from its feedback; start times for several robots
//! ```
//!
//! Nothing here reads a clock, opens a socket or allocates after [`PlcNode::new`]; time and frames are arguments.

#![cfg_attr(not(test), warn(clippy::print_stdout, clippy::print_stderr))]

mod advice;
mod any_program;
mod arm_in_step;
mod axes_group;
pub mod bus;
pub mod command_line;
mod config;
mod describe;
#[cfg(all(feature = "real", target_os = "linux"))]
pub mod dialogue;
#[cfg(all(feature = "real", target_os = "linux"))]
pub mod discover;
mod event;
mod export;
mod export_command;
mod exported_program;
pub mod function_blocks;
#[cfg(all(feature = "real", target_os = "linux"))]
pub mod io;
pub mod master_axis;
mod motion_source;
mod plan_command;
mod plc;
mod printable;
#[cfg(all(feature = "real", target_os = "linux"))]
pub mod process;
mod program;
mod program_file;
pub mod robot_clock;
mod sample;
mod scan;
mod sequence;
mod sequences;
#[cfg(all(feature = "real", target_os = "linux"))]
mod set_adapter;
#[cfg(all(feature = "real", target_os = "linux"))]
mod set_station;
mod speed_override;
mod station;
#[cfg(all(feature = "real", target_os = "linux"))]
mod station_error;
mod waiting;
mod zones;

pub use any_program::AnyProgram;
pub use arm_in_step::{ArmInStep, RobotTimes, TogetherLeg, TogetherSection};
pub use axes_group::{AxesGroup, WaitLimits};
pub(crate) use axes_group::{Ticket, Turn};
pub use config::PlcConfig;
pub use event::{
    Commanded, Execution, ExecutionType, Failure, FailureCause, PlcEvent, PlcReport, Seen, StartError,
    UnknownExecutionType,
};
pub use exported_program::{CodeError, ExportedCode, ExportedProgram, ProgramTrap};
pub use motion_source::{MotionList, MotionSource, PointList, motion_source};
pub use plc::{PlacedStation, PlcNode};
pub use program::{AfterLoss, Led, PlcProgram, Progress, SetOut, Totals};
pub use program_file::{ProgramFileError, read_program};
pub use sample::Sample;
pub use scan::Scan;
pub use sequences::{MarkPassage, Sequences, StationWork, ZoneWait};
pub use speed_override::{Override, OverrideError, OverrideSchedule, OverrideStep, ScheduleError};
pub use station::{DescribedArm, PoseDifference, Station, StationConfig};
pub use waiting::WaitingFor;
pub use zones::Zones;
