//! Function blocks with the face that PLCopen gives to motion control.
//!
//! | output | TRUE while |
//! |---|---|
//! | `Busy` | the block has something to do, from the rising edge of `Execute` on |
//! | `Active` | the robot has taken up the skill; only together with `Busy` |
//! | `Done` | the skill ended as wanted |
//! | `CommandAborted` | the robot gave the skill up |
//! | `Error` | something is wrong; `ErrorID` says what |
//!
//! PLCopen, Function blocks for motion control, Part 1, general rules: `Busy`, `Done`, `Error` and `CommandAborted`
//! exclude each other, and one of them is TRUE while `Execute` is. A rising edge of `Execute` starts the block with
//! the parameters of that call. A falling edge stops nothing; it takes `Done`, `Error` and `CommandAborted` back, and
//! if `Execute` fell before the end, they show for one scan. PLCopen lets a second rising edge restart a busy block
//! with new parameters; a robot that runs a skill takes up no other one, so here that edge is ignored.
//!
//! A block is called once a scan, whatever `Execute` is. A skill is given up by [`Halt`], not by its own block.

mod error;
mod face;
mod move_continuous;
mod run_program;
mod set_override;
mod single_motion;
mod skill;
mod state_commands;

pub use error::{BlockError, Real};
pub use face::Outputs;
pub use move_continuous::MoveContinuous;
pub use run_program::RunProgram;
pub use set_override::{EnableOutputs, GroupSetOverride, OverrideFactors};
pub use single_motion::{
    MoveCircular, MoveLinCartesian, MoveLinForceCartesian, MovePtpCartesian, MovePtpJoint, MoveSpline,
};
pub(crate) use skill::Tally;
pub use state_commands::{Halt, Reset, Resume, Suspend};
pub(crate) use state_commands::{is_executing, is_ready};

#[cfg(test)]
mod exploration;
