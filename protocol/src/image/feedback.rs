//! The image from the robot to the PLC.
//!
//! ```text
//! 0..2    status            bits
//! 2       state             u8
//! 3       override          u8    %, the one in effect
//! 4..6    command number    u16   the last one that was accepted or refused
//! 6..8    error number      u16   0 is none
//! 8..12   executed          u32   motions of the skill that are executed (curExec)
//! 12..16  accepted          u32   motions of the skill that the robot has taken from the slots so far
//! 16..20  error motion      u32   which motion, counted from 0, the error number speaks of
//! 20..22  digital inputs    u16   of the PLC, outputs of the robot
//! 22..24  life counter echo u16   of the last command seen
//! 24..26  life counter      u16   counts the robot's cycles
//! 26..28  blends suppressed u16   of the skill: motions that ended in a stop because the next one was not there
//! 28..36  clock             u64   ns, the robot's own
//! 36..44  execution time    u64   ns, the robot's own measure of the last skill
//! 44..68  joints            6 × f32   degrees, mm on a linear axis
//! 68..92  pose              6 × f32   mm and degrees (x y z a b c), tool in base
//! 92..96  path speed        f32   mm/s
//! 96..100 contact force     f32   N, what the tool presses on surfaces with
//! 100     error index       u8    which joint, coordinate or number the error number speaks of
//! 101..104 zero
//! 104..116 error finding    3 × f32   value, least and most allowed; see Finding
//! 116..120 check            u32   see Checker; 0 is none. Not part of the struct below
//! 120..124 law time         u32   µs, with `SYNC`: time on its own law that the arm has
//! 124..126 queue depth      u16   motions that the robot keeps, if more than the five slots; else 0
//! 126..128 services         bits  what this robot serves beyond what every robot does
//! 128..256 zero
//! ```

use super::{ErrorNumber, Finding, Image, bits, codes};
use machine::wire::{ByteOrder, Reader, Truncated, Writer};

bits! {
    /// What the robot reports besides its state.
    Status: u16 {
        /// The skill of the echoed command number is being executed.
        BUSY = 0,
        /// The skill of the echoed command number ended successfully. Stays set until the next command.
        DONE = 1,
        /// A halt or a cancel ended the skill.
        ABORTED = 2,
        /// The error number gives the reason.
        ERROR = 3,
        /// The arm stands still.
        AT_REST = 4,
        /// Drives are on: `enable` is set and nothing prevents motion.
        ENABLED = 5,
        /// Nothing ended, but the error number says what the robot refuses: an override above 100 %. Never set together
        /// with `ERROR`; cleared when its cause is gone.
        WARNING = 6,
    }
}

codes! {
    /// The state of the robot's skill execution (OPC UA Part 10, program states).
    State: u8 {
        /// No skill runs; a reset leads to `Ready`.
        Halted = 0,
        /// A skill may start.
        Ready = 1,
        /// A skill runs.
        Running = 2,
        /// A skill is paused on its path.
        Suspended = 3,
    }
}

bits! {
    /// What a robot serves beyond what every robot does.
    Services: u16 {
        /// It follows a master with [`Control::SYNC`](super::Control::SYNC).
        SYNC = 0,
        /// It takes [`CompactPoints`](super::CompactPoints).
        COMPACT = 1,
        /// It keeps the motions that it has accepted: their slots may be filled again at once. See [`Feedback::queue_depth`].
        KEEPS_ACCEPTED = 2,
    }
}

/// The whole image from the robot to the PLC.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Feedback {
    /// What the robot reports besides the state.
    pub status: Status,
    /// State of the skill execution.
    pub state: State,
    /// The override in effect, in %.
    pub override_percent: u8,
    /// Number of the command that state, counters and error refer to.
    pub number: u16,
    /// The error, if any.
    pub error: ErrorNumber,
    /// Motions of the skill that were executed: the paper's `curExec`.
    pub executed: u32,
    /// Motions of the skill that the robot has taken from the slots so far.
    pub accepted: u32,
    /// The motion of the skill, counted from 0, that the error refers to.
    pub error_motion: u32,
    /// The robot's digital outputs, which the PLC reads as inputs.
    pub inputs: u16,
    /// Life counter of the last command seen.
    pub life_echo: u16,
    /// Counts the robot's cycles, modulo 2^16.
    pub life: u16,
    /// Motions of the skill that ended in a stop because the next motion did not arrive in time.
    pub blends_suppressed: u16,
    /// The robot's own clock in ns.
    pub clock_ns: u64,
    /// Duration of the last skill in ns, measured by the robot: from its acceptance to its end.
    pub execution_ns: u64,
    /// Joint values in degrees; in mm for a linear axis.
    pub joints: [f32; 6],
    /// Pose of the tool in the base frame: x, y, z in mm; a, b, c in degrees.
    pub pose: [f32; 6],
    /// Speed of the tool along its path in mm/s.
    pub path_speed: f32,
    /// Force with which the tool presses on surfaces, in N.
    pub contact_force: f32,
    /// The quantity that [`error`](Self::error) refers to, and its limits.
    pub finding: Finding,
    /// Time in µs on its own law that the arm has; 0 without [`Control::SYNC`](super::Control::SYNC).
    pub law_time_us: u32,
    /// Motions that the robot's queue holds, if more than the five slots; else 0.
    pub queue_depth: u16,
    /// What the robot serves.
    pub services: Services,
}

impl Default for Feedback {
    fn default() -> Self {
        Self {
            status: Status::default(),
            state: State::Halted,
            override_percent: 100,
            number: 0,
            error: ErrorNumber::None,
            executed: 0,
            accepted: 0,
            error_motion: 0,
            inputs: 0,
            life_echo: 0,
            life: 0,
            blends_suppressed: 0,
            clock_ns: 0,
            execution_ns: 0,
            joints: [0.0; 6],
            pose: [0.0; 6],
            path_speed: 0.0,
            contact_force: 0.0,
            finding: Finding::NONE,
            law_time_us: 0,
            queue_depth: 0,
            services: Services::default(),
        }
    }
}

impl Feedback {
    /// Parses the image.
    pub fn parse<O: ByteOrder>(image: &[u8]) -> Result<Self, Truncated> {
        let mut reader = Reader::<O>::new(image);
        let status = Status(reader.u16()?);
        let state = reader.u8()?.into();
        let override_percent = reader.u8()?;
        let mut feedback = Self {
            status,
            state,
            override_percent,
            number: reader.u16()?,
            error: reader.u16()?.into(),
            executed: reader.u32()?,
            accepted: reader.u32()?,
            error_motion: reader.u32()?,
            inputs: reader.u16()?,
            life_echo: reader.u16()?,
            life: reader.u16()?,
            blends_suppressed: reader.u16()?,
            clock_ns: reader.u64()?,
            execution_ns: reader.u64()?,
            ..Self::default()
        };
        for value in feedback.joints.iter_mut().chain(&mut feedback.pose) {
            *value = reader.f32()?;
        }
        feedback.path_speed = reader.f32()?;
        feedback.contact_force = reader.f32()?;
        let index = reader.u8()?;
        reader.skip(3)?;
        feedback.finding = Finding::new(index, reader.f32()?, reader.f32()?, reader.f32()?);
        reader.skip(4)?; // the check
        feedback.law_time_us = reader.u32()?;
        feedback.queue_depth = reader.u16()?;
        feedback.services = Services(reader.u16()?);
        Ok(feedback)
    }

    /// Writes the image.
    pub fn emit<O: ByteOrder>(&self, image: &mut Image) {
        let len = image.len();
        let mut writer = Writer::<O>::new(image);
        writer.u16(self.status.0);
        writer.u8(self.state.into());
        writer.u8(self.override_percent);
        writer.u16(self.number);
        writer.u16(self.error.into());
        writer.u32(self.executed);
        writer.u32(self.accepted);
        writer.u32(self.error_motion);
        writer.u16(self.inputs);
        writer.u16(self.life_echo);
        writer.u16(self.life);
        writer.u16(self.blends_suppressed);
        writer.u64(self.clock_ns);
        writer.u64(self.execution_ns);
        for value in self.joints.iter().chain(&self.pose) {
            writer.f32(*value);
        }
        writer.f32(self.path_speed);
        writer.f32(self.contact_force);
        writer.u8(self.finding.index);
        (0..3).for_each(|_| writer.u8(0));
        for value in [self.finding.value(), self.finding.lower(), self.finding.upper()] {
            writer.f32(value);
        }
        writer.u32(0); // the check
        writer.u32(self.law_time_us);
        writer.u16(self.queue_depth);
        writer.u16(self.services.0);
        writer.pad_to(len);
    }
}
