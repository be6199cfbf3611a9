//! The skills of one motion each: six blocks over one inner one.

use protocol::image::{Command, Motion, MotionKind, SLOTS, Skill};

use super::skill::{SkillCall, Tally};
use super::{BlockError, Outputs, SkillState};
use crate::AxesGroup;

/// What the six have in common.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug)]
pub(super) struct SingleMotion {
    pub(super) call: SkillCall,
}

impl SingleMotion {
    fn call(
        &mut self,
        execute: bool,
        skill: Skill,
        kind: MotionKind,
        motion: &Motion,
        group: &mut AxesGroup,
    ) -> Outputs {
        self.call.call(execute, group, |command| {
            write(command, skill, Motion { kind, approximation: 0, ..*motion });
            Ok(true)
        });
        self.call.outputs()
    }
}

fn write(command: &mut Command, skill: Skill, motion: Motion) {
    command.skill = skill;
    command.slots = [Motion::EMPTY; SLOTS];
    command.set_slot(0, motion);
    (command.total, command.written) = (1, 1);
}

macro_rules! single_motion_blocks {
    ($($(#[$doc:meta])* $name:ident: $skill:ident, $kind:ident;)*) => {$(
        $(#[$doc])*
        ///
        /// A single motion ends in an exact stop, so its approximation distance is not used.
        #[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug)]
        pub struct $name {
            pub(super) inner: SingleMotion,
        }

        impl $name {
            /// One scan. Parameters of `motion` count at the rising edge of `execute`; its kind is the block's.
            pub fn call(&mut self, execute: bool, motion: &Motion, group: &mut AxesGroup) -> Outputs {
                self.inner.call(execute, Skill::$skill, MotionKind::$kind, motion, group)
            }

            /// What `ErrorID` stands for; none without an error.
            #[must_use]
            pub const fn error(&self) -> Option<BlockError> {
                self.inner.call.face.error()
            }

            /// Where the skill stands.
            #[must_use]
            pub const fn state(&self) -> SkillState {
                self.inner.call.state()
            }

            /// Motions of the skill that are executed: the paper's `curExec`. Stays until the next start.
            #[must_use]
            pub const fn executed(&self) -> u32 {
                self.inner.call.tally.executed
            }

            pub(crate) const fn tally(&self) -> Tally {
                self.inner.call.tally
            }
        }
    )*};
}

single_motion_blocks! {
    /// Moves the tool on a straight line to a Cartesian target.
    MoveLinCartesian: MoveLinCartesian, LinCartesian;
    /// Moves all axes together to a Cartesian target.
    MovePtpCartesian: MovePtpCartesian, PtpCartesian;
    /// Moves all axes together to a joint target.
    MovePtpJoint: MovePtpJoint, PtpJoint;
    /// Moves the tool on a circle through the intermediate point to a Cartesian target.
    MoveCircular: MoveCircular, Circular;
    /// Moves the tool on a spline to a Cartesian target.
    MoveSpline: MoveSpline, Spline;
    /// Moves the tool on a straight line into contact and holds the force.
    MoveLinForceCartesian: MoveLinForceCartesian, LinForceCartesian;
}
