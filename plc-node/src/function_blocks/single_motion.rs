//! The skills of one motion each: six blocks over one inner one.

use core::hash::{Hash, Hasher};

use machine::wire::{BigEndian, Writer};
use protocol::image::{Command, MOTION_LEN, Motion, MotionKind, Skill, Slots};

use super::skill::{SkillCall, skill_outputs};
use super::{BufferMode, MotionInputs, Outputs};
use crate::AxesGroup;

/// The block inside all six.
#[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug)]
pub(super) struct SingleMotion {
    pub(super) call: SkillCall<Latched>,
}

/// A motion as the image holds it, which makes numbers comparable that are no numbers too.
#[derive(Clone, Copy, Debug)]
pub(super) struct Latched(Motion);

impl Latched {
    fn bytes(&self) -> [u8; MOTION_LEN] {
        let mut bytes = [0; MOTION_LEN];
        self.0.emit(&mut Writer::<BigEndian>::new(&mut bytes));
        bytes
    }
}

impl PartialEq for Latched {
    fn eq(&self, other: &Self) -> bool {
        self.bytes() == other.bytes()
    }
}

impl Eq for Latched {}

impl Hash for Latched {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.bytes().hash(state);
    }
}

impl SingleMotion {
    fn call(
        &mut self,
        execute: bool,
        kind: MotionKind,
        inputs: &MotionInputs,
        mode: BufferMode,
        group: &mut AxesGroup,
    ) -> Outputs {
        let read = || Ok(Latched(Motion { approximation: 0, ..inputs.motion(kind)? }));
        self.call.call(execute, mode, group, read, |command, Latched(motion)| {
            write(command, kind.skill(), motion);
            Ok(true)
        });
        self.call.outputs()
    }
}

fn write(command: &mut Command, skill: Skill, motion: Motion) {
    command.skill = skill;
    command.slots = Slots::EMPTY;
    command.set_slot(0, motion);
    (command.total, command.written) = (1, 1);
}

macro_rules! single_motion_blocks {
    ($($(#[$doc:meta])* $name:ident: $kind:ident;)*) => {$(
        $(#[$doc])*
        ///
        /// A single motion ends in an exact stop, so its approximation distance is not used.
        #[derive(Clone, Copy, PartialEq, Eq, Hash, Default, Debug)]
        pub struct $name {
            pub(super) inner: SingleMotion,
        }

        impl $name {
            /// Runs one scan. `inputs` and `mode` are read at the rising edge of `execute`.
            pub fn call(
                &mut self,
                execute: bool,
                inputs: &MotionInputs,
                mode: BufferMode,
                group: &mut AxesGroup,
            ) -> Outputs {
                self.inner.call(execute, MotionKind::$kind, inputs, mode, group)
            }
        }

        skill_outputs!($name: inner.call);
    )*};
}

single_motion_blocks! {
    /// Moves the tool on a straight line to a Cartesian target.
    MoveLinCartesian: LinCartesian;
    /// Moves all axes together to a Cartesian target.
    MovePtpCartesian: PtpCartesian;
    /// Moves all axes together to a joint target.
    MovePtpJoint: PtpJoint;
    /// Moves the tool on a circle through the intermediate point to a Cartesian target.
    MoveCircular: Circular;
    /// Moves the tool on a spline to a Cartesian target.
    MoveSpline: Spline;
    /// Moves the tool on a straight line into contact and holds the force.
    MoveLinForceCartesian: LinForceCartesian;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::WaitLimits;
    use protocol::image::Feedback;

    #[test]
    fn a_single_motion_is_sent_without_an_approximation_distance() {
        let mut group = AxesGroup::new(WaitLimits { answer_scans: 5, silent_scans: 5 });
        group.read(Some(Feedback::default()));
        let blended = Motion { kind: MotionKind::LinCartesian, approximation: 50, ..Motion::EMPTY };
        let inputs = MotionInputs::from(&blended);
        let mut block = MoveLinCartesian::default();
        assert!(block.call(true, &inputs, BufferMode::Aborting, &mut group).busy);
        let sent = *group.command.slot(0);
        assert_eq!((sent.kind, sent.approximation), (MotionKind::LinCartesian, 0));
        assert_eq!(inputs.motion(MotionKind::LinCartesian).unwrap().approximation, 50);
    }

    #[test]
    fn motions_are_the_same_to_a_block_if_their_bytes_in_the_image_are() {
        let hash = |motion| {
            let mut hasher = std::hash::DefaultHasher::new();
            Latched(motion).hash(&mut hasher);
            hasher.finish()
        };
        let at = |x| Motion { target: [x, 0.0, 0.0, 0.0, 0.0, 0.0], ..Motion::EMPTY };
        let (here, there, nowhere) = (at(1.0), at(2.0), at(f32::NAN));
        assert_eq!(Latched(nowhere), Latched(nowhere), "although NaN is not NaN");
        assert_eq!(hash(nowhere), hash(nowhere));
        assert_ne!(Latched(here), Latched(there));
        assert_ne!(hash(here), hash(there));
    }
}
