//! Function blocks with the interface of PLCopen's motion control.
//!
//! | output | TRUE while |
//! |---|---|
//! | `Busy` | the block has something to do, from the rising edge of `Execute` on |
//! | `Active` | the robot executes the skill; only together with `Busy` |
//! | `CommandInterrupted` | the skill waits on its path; only together with `Busy`, never with `Active` |
//! | `Done` | the skill ended as wanted |
//! | `CommandAborted` | the skill was aborted |
//! | `Error` | something is wrong; `ErrorID` says what |
//!
//! PLCopen, Function blocks for motion control, Part 1, general rules: `Busy`, `Done`, `Error` and `CommandAborted`
//! exclude each other, and one of them is TRUE while `Execute` is. A rising edge of `Execute` starts the block with
//! the parameters of that call. A falling edge stops nothing; it takes `Done`, `Error` and `CommandAborted` back, and
//! if `Execute` fell before the end, they show for one scan. PLCopen lets a second rising edge restart a busy block
//! with new parameters; a robot that executes a skill takes up no other one, so here that edge is ignored.
//!
//! A block is called once a scan, whatever `Execute` is. A skill is aborted by [`GroupHalt`] or [`GroupStop`], or by another
//! block whose [`BufferMode`] is `Aborting`, not by its own block. A block that waits for another one is `Busy` and not
//! `Active`; whatever gives up the skill under way gives up the one that waits for it, but for the one that did so. The inputs of a
//! block of one motion have [engineering units](MotionInputs); [`MoveContinuous`] takes motions of the image, which
//! [`MotionInputs::motion`] makes of such inputs. Each block of a skill has the skill's state, [`SkillState`]. A block that
//! ends with an error after it asked the robot for something, while the robot may still move, stops the robot; a block that is
//! refused changes nothing.

mod buffer_mode;
mod error;
mod execute_interface;
mod group;
mod inputs;
mod move_continuous;
mod move_trajectory;
mod run_program;
mod set_override;
mod single_motion;
mod skill;

pub use buffer_mode::BufferMode;
pub use error::{BlockError, Real};
pub use execute_interface::{Outputs, SkillState};
pub use group::{GroupContinue, GroupDisable, GroupEnable, GroupHalt, GroupInterrupt, GroupReset, GroupStop};
pub(crate) use group::{is_at_rest, is_executing, is_ready};
pub use inputs::{Dynamics, MotionInputs};
pub use move_continuous::MoveContinuous;
pub use move_trajectory::MoveTrajectory;
pub use run_program::RunProgram;
pub use set_override::{EnableOutputs, GroupSetOverride, OverrideFactors};
pub use single_motion::{
    MoveCircular, MoveLinCartesian, MoveLinForceCartesian, MovePtpCartesian, MovePtpJoint, MoveSpline,
};
pub(crate) use skill::Tally;

#[cfg(test)]
mod exploration;
