//! The image from the PLC to the robot.
//!
//! ```text
//! 0..2   control          bits
//! 2..4   life counter     u16   counts the PLC's scans
//! 4..6   command number   u16   a new one, with `execute` set, starts a skill
//! 6      skill            u8
//! 7      override         u8    % of every velocity, 0..=100; 0 stops the arm on its path
//! 8..12  total            u32   motions of the skill in all (totalNo)
//! 12..16 written          u32   motions written into the slots so far, counted from the skill's start
//! 16..18 program number   u16   what `RunProgram` runs
//! 18..20 digital outputs  u16   of the PLC, inputs of the robot
//! 20..28 start time       u64   ns on the robot's clock, 0 starts at once: for arms that must start together. With `SYNC`: when
//!                               the law time holds, 0 as soon as it is seen
//! 28..32 law time         u32   µs, with `SYNC`: where on its law the arm should be then
//! 32..36 check            u32   see Checker; 0 is none. Not part of the struct below
//! 36..256 five slots      5 × Motion, or CompactPoints
//! ```

use super::{CompactPoints, HEAD_LEN, Image, Motion, SLOTS, Slots, bits, codes};
use machine::wire::{ByteOrder, Reader, Truncated, Writer};

bits! {
    /// Requests of the PLC. All are levels except `EXECUTE`, which takes effect with a new command number.
    Control: u16 {
        /// The robot is allowed to move. Without it the robot halts.
        ENABLE = 0,
        /// Execute the skill of this command number.
        EXECUTE = 1,
        /// Stop on the path as fast as the limits allow and give up the skill. The robot is then `Halted`.
        HALT = 2,
        /// Stop on the path and keep the skill.
        SUSPEND = 3,
        /// Go on after a suspend.
        RESUME = 4,
        /// Leave `Halted`, or acknowledge an error: go to `Ready`.
        RESET = 5,
        /// Stop on the path as fast as the limits allow and give up the skill, like `HALT`, but be `Ready` then, without a
        /// reset. No skill starts while it is set.
        CANCEL = 6,
        /// The arm's law follows a master: see [`Command::law_time_us`].
        SYNC = 7,
        /// With [`Skill::MoveTrajectory`]: the slots hold [`CompactPoints`].
        COMPACT = 8,
    }
}

codes! {
    /// The skill that a command executes. Skills of one motion have the code of its [`super::MotionKind`].
    Skill: u8 {
        /// No skill.
        None = 0,
        /// One straight line to a Cartesian target.
        MoveLinCartesian = 1,
        /// One point-to-point motion to a Cartesian target.
        MovePtpCartesian = 2,
        /// One point-to-point motion to a joint target.
        MovePtpJoint = 3,
        /// One circle.
        MoveCircular = 4,
        /// One spline.
        MoveSpline = 5,
        /// One straight line into contact.
        MoveLinForceCartesian = 6,
        /// A sequence of motions of any kind without stops: the paper's MoveContinuousSkill.
        MoveContinuous = 16,
        /// A program in the robot controller: the paper's RC.
        RunProgram = 17,
        /// A path through [`CompactPoints`].
        MoveTrajectory = 18,
    }
}

/// The whole image from the PLC to the robot.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Command {
    /// Requests of the PLC.
    pub control: Control,
    /// Counts the PLC's scans, modulo 2^16.
    pub life: u16,
    /// Number of the command. The robot starts a skill when it sees a new one with [`Control::EXECUTE`].
    pub number: u16,
    /// The skill to execute.
    pub skill: Skill,
    /// Override in % of every velocity, 0..=100. At 0 the arm stops on its path; a higher one lets it continue. It may
    /// change at any time; a value above 100 is refused, and the last valid one stays in effect.
    pub override_percent: u8,
    /// Total motions of this skill: the paper's `totalNo`.
    pub total: u32,
    /// Motions of this skill written into the slots so far.
    pub written: u32,
    /// Program that [`Skill::RunProgram`] runs.
    pub program: u16,
    /// The PLC's digital outputs, which the robot reads as inputs.
    pub outputs: u16,
    /// When to start, in ns on the robot's clock; 0 starts at once. With [`Control::SYNC`] the time at which the law time
    /// holds; 0 is when the robot sees it.
    pub start_time_ns: u64,
    /// Time in µs on the arm's own law that it should have at the start time, with [`Control::SYNC`]: the position of the master.
    pub law_time_us: u32,
    /// Motion `k` in slot `k mod 5`, or compact points.
    pub slots: Slots,
}

impl Default for Command {
    fn default() -> Self {
        Self {
            control: Control::default(),
            life: 0,
            number: 0,
            skill: Skill::None,
            override_percent: 100,
            total: 0,
            written: 0,
            program: 0,
            outputs: 0,
            start_time_ns: 0,
            law_time_us: 0,
            slots: Slots::EMPTY,
        }
    }
}

impl Command {
    /// Parses the image. The robot checks the values.
    pub fn parse<O: ByteOrder>(image: &[u8]) -> Result<Self, Truncated> {
        let mut command = Self::parse_head::<O>(image)?;
        let mut reader = Reader::<O>::new(image);
        reader.skip(HEAD_LEN)?;
        if command.is_compact() {
            command.slots = Slots::Points(CompactPoints::parse(&mut reader)?);
        } else if let Slots::Motions(slots) = &mut command.slots {
            for slot in slots {
                *slot = Motion::parse(&mut reader)?;
            }
        }
        Ok(command)
    }

    /// Parses the head and leaves the slots empty, for a reader that knows that they did not change: the head changes
    /// with every scan.
    pub fn parse_head<O: ByteOrder>(image: &[u8]) -> Result<Self, Truncated> {
        let mut reader = Reader::<O>::new(image);
        Ok(Self {
            control: Control(reader.u16()?),
            life: reader.u16()?,
            number: reader.u16()?,
            skill: reader.u8()?.into(),
            override_percent: reader.u8()?,
            total: reader.u32()?,
            written: reader.u32()?,
            program: reader.u16()?,
            outputs: reader.u16()?,
            start_time_ns: reader.u64()?,
            law_time_us: reader.u32()?,
            slots: Slots::EMPTY,
        })
    }

    /// Writes the image.
    pub fn emit<O: ByteOrder>(&self, image: &mut Image) {
        self.emit_head::<O>(image);
        let (_, slots) = image.split_at_mut(HEAD_LEN);
        let mut writer = Writer::<O>::new(slots);
        match &self.slots {
            Slots::Motions(slots) => slots.iter().for_each(|slot| slot.emit(&mut writer)),
            Slots::Points(points) => points.emit(&mut writer),
        }
    }

    /// Returns whether bytes 36..256 hold compact points, by the head.
    #[must_use]
    pub fn is_compact(&self) -> bool {
        self.control.contains(Control::COMPACT) && self.skill == Skill::MoveTrajectory
    }

    /// Writes the head into an image that already contains this command's slots. Every scan changes the life counter,
    /// but rarely the slots.
    pub fn emit_head<O: ByteOrder>(&self, image: &mut Image) {
        let mut writer = Writer::<O>::new(image);
        writer.u16(self.control.0);
        writer.u16(self.life);
        writer.u16(self.number);
        writer.u8(self.skill.into());
        writer.u8(self.override_percent);
        writer.u32(self.total);
        writer.u32(self.written);
        writer.u16(self.program);
        writer.u16(self.outputs);
        writer.u64(self.start_time_ns);
        writer.u32(self.law_time_us);
        writer.pad_to(HEAD_LEN);
    }

    /// Returns the slot of motion `index`, counted from 0; an empty one where there are compact points.
    #[must_use]
    pub fn slot(&self, index: u32) -> &Motion {
        match &self.slots {
            Slots::Motions(slots) => slots.get(index as usize % SLOTS).unwrap_or(&Motion::EMPTY),
            Slots::Points(_) => &Motion::EMPTY,
        }
    }

    /// Writes motion `index`, counted from 0, into its slot. Does nothing where there are compact points.
    pub fn set_slot(&mut self, index: u32, motion: Motion) {
        if let Slots::Motions(slots) = &mut self.slots
            && let Some(slot) = slots.get_mut(index as usize % SLOTS)
        {
            *slot = motion;
        }
    }
}
