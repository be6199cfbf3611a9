//! The image as tables: each field's bytes, type and unit, by which other programs are made to read it.
//!
//! `docs/process-image.md` has the same tables for people, the Wireshark dissector and the device files (crate `devices`) are
//! made from them. Tests hold them against the page and against [`Command`], [`Feedback`] and [`Motion`].

use super::{
    COMMAND_CHECK, Control, ErrorNumber, FEEDBACK_CHECK, HEAD_LEN, IMAGE_LEN, MOTION_LEN, MotionKind,
    RING_AT, RING_DIFFERENCES, SLOTS, Services, Skill, State, Status,
};

/// Type of a field, in the terms of IEC 61131-3, and what its values mean where they have names.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum FieldType {
    /// A number of 8 bits.
    Usint,
    /// A number of 16 bits.
    Uint,
    /// A number of 32 bits.
    Udint,
    /// A number of 64 bits.
    Ulint,
    /// 16 bits with these names from bit 0; those after the last name have none.
    Word(&'static [&'static str]),
    /// So many numbers of 32 bits in the form of IEEE 754.
    Real(usize),
    /// So many signed numbers of 16 bits.
    Int(usize),
    /// A code.
    Code(CodeTable),
    /// A checksum of 32 bits over all other bytes, see [`Checker`](super::Checker).
    Check,
    /// One [`Motion`](super::Motion).
    Motion,
    /// So many bytes that are sent as 0.
    Reserved(usize),
}

/// Table that gives the codes of a field their names.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum CodeTable {
    /// [`Skill`]
    Skill,
    /// [`State`]
    State,
    /// [`ErrorNumber`]
    Error,
    /// [`MotionKind`]
    Kind,
}

impl FieldType {
    /// Returns the length in bytes.
    #[must_use]
    pub const fn len(self) -> usize {
        match self {
            Self::Usint | Self::Code(CodeTable::Skill | CodeTable::State | CodeTable::Kind) => 1,
            Self::Uint | Self::Word(_) | Self::Code(CodeTable::Error) => 2,
            Self::Udint | Self::Check => 4,
            Self::Ulint => 8,
            Self::Real(count) => 4 * count,
            Self::Int(count) => 2 * count,
            Self::Motion => MOTION_LEN,
            Self::Reserved(len) => len,
        }
    }

    /// Returns whether the field has no bytes.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.len() == 0
    }
}

/// One field of the image, or of a motion in it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct ImageField {
    /// First byte, counted from the begin of the image or motion.
    pub first: usize,
    /// Name on the page of the image.
    pub name: &'static str,
    /// Type.
    pub form: FieldType,
    /// Unit; empty where there is none.
    pub unit: &'static str,
}

const fn field(first: usize, name: &'static str, form: FieldType, unit: &'static str) -> ImageField {
    ImageField { first, name, form, unit }
}

const fn reserved(first: usize, until: usize) -> ImageField {
    field(first, "reserved", FieldType::Reserved(until - first), "")
}

const fn slot(index: usize, name: &'static str) -> ImageField {
    field(HEAD_LEN + index * MOTION_LEN, name, FieldType::Motion, "")
}

/// Fields of the command, from the PLC to the robot.
pub const COMMAND_FIELDS: &[ImageField] = {
    use FieldType::{Check, Code, Udint, Uint, Ulint, Usint, Word};
    &[
        field(0, "control", Word(Control::NAMES), "bits"),
        field(2, "life counter", Uint, ""),
        field(4, "command number", Uint, ""),
        field(6, "skill", Code(CodeTable::Skill), ""),
        field(7, "override", Usint, "%"),
        field(8, "total", Udint, "motions"),
        field(12, "written", Udint, "motions"),
        field(16, "program number", Uint, ""),
        field(18, "digital outputs", Word(&[]), "bits"),
        field(20, "start time", Ulint, "ns"),
        field(28, "law time", Udint, "µs"),
        field(COMMAND_CHECK, "check", Check, ""),
        slot(0, "slot 0"),
        slot(1, "slot 1"),
        slot(2, "slot 2"),
        slot(3, "slot 3"),
        slot(4, "slot 4"),
    ]
};

/// Fields of the feedback, from the robot to the PLC.
pub const FEEDBACK_FIELDS: &[ImageField] = {
    use FieldType::{Check, Code, Real, Udint, Uint, Ulint, Usint, Word};
    &[
        field(0, "status", Word(Status::NAMES), "bits"),
        field(2, "state", Code(CodeTable::State), ""),
        field(3, "override", Usint, "%"),
        field(4, "command number", Uint, ""),
        field(6, "error number", Code(CodeTable::Error), ""),
        field(8, "executed", Udint, "motions"),
        field(12, "accepted", Udint, "motions"),
        field(16, "error motion", Udint, ""),
        field(20, "digital inputs", Word(&[]), "bits"),
        field(22, "life counter echo", Uint, ""),
        field(24, "life counter", Uint, ""),
        field(26, "blends suppressed", Uint, "motions"),
        field(28, "clock", Ulint, "ns"),
        field(36, "execution time", Ulint, "ns"),
        field(44, "joints", Real(6), "degrees (mm)"),
        field(68, "pose", Real(6), "mm, degrees"),
        field(92, "path speed", Real(1), "mm/s"),
        field(96, "contact force", Real(1), "N"),
        field(100, "error index", Usint, ""),
        reserved(101, 104),
        field(104, "error value", Real(1), "by the error"),
        field(108, "error lower limit", Real(1), "by the error"),
        field(112, "error upper limit", Real(1), "by the error"),
        field(FEEDBACK_CHECK, "check", Check, ""),
        field(120, "law time", Udint, "µs"),
        field(124, "queue depth", Uint, "motions"),
        field(126, "services", Word(Services::NAMES), "bits"),
        reserved(128, IMAGE_LEN),
    ]
};

/// Fields of a motion.
pub const MOTION_FIELDS: &[ImageField] = {
    use FieldType::{Code, Real, Uint, Usint};
    &[
        field(0, "target", Real(6), "mm, degrees"),
        field(24, "auxiliary", Real(3), "mm or N"),
        field(36, "velocity", Uint, "0.1 mm/s or 0.01 %"),
        field(38, "acceleration", Uint, "1 mm/s² or 0.01 %"),
        field(40, "approximation", Uint, "0.01 mm"),
        field(42, "kind", Code(CodeTable::Kind), ""),
        field(43, "tool and base", Usint, ""),
    ]
};

/// Fields in the auxiliary bytes of a motion whose kind has neither point nor force there
/// ([`AuxiliaryForm::Options`](super::AuxiliaryForm::Options)), counted from the motion's begin.
pub const OPTION_FIELDS: &[ImageField] = {
    use FieldType::{Uint, Usint};
    &[
        field(24, "status", Usint, ""),
        field(25, "turn", Usint, ""),
        field(26, "deceleration", Uint, "1 mm/s² or 0.01 %"),
        field(28, "jerk", Uint, "10 mm/s³ or 0.01 %"),
        reserved(30, 36),
    ]
};

/// Fields of bytes 36..256 of a command with compact points, counted from the begin of the image.
pub const POINT_FIELDS: &[ImageField] = {
    use FieldType::{Code, Int, Real, Uint, Usint};
    &[
        field(HEAD_LEN, "origin", Real(6), "mm, degrees"),
        field(60, "velocity", Uint, "0.1 mm/s"),
        field(62, "acceleration", Uint, "1 mm/s²"),
        field(64, "deceleration", Uint, "1 mm/s²"),
        field(66, "jerk", Uint, "10 mm/s³"),
        field(68, "zone", Uint, "0.01 mm"),
        field(70, "kind", Code(CodeTable::Kind), ""),
        field(71, "tool and base", Usint, ""),
        field(72, "resolution", Uint, "0.01 µm, 0.00001 degrees"),
        field(74, "coordinates", Usint, ""),
        field(75, "content", Usint, ""),
        field(RING_AT, "ring", Int(RING_DIFFERENCES), "steps"),
    ]
};

/// Returns whether each field of a table begins where the one before it ends, and the last one ends there.
const fn is_complete(fields: &[ImageField], from: usize, until: usize) -> bool {
    let (mut at, mut index) = (from, 0);
    while index < fields.len() {
        #[expect(clippy::indexing_slicing, reason = "the loop ends before the length, while compiling")]
        let field = &fields[index];
        if field.first != at {
            return false;
        }
        at += field.form.len();
        index += 1;
    }
    at == until
}

const _: () = assert!(is_complete(COMMAND_FIELDS, 0, IMAGE_LEN) && COMMAND_FIELDS.len() == 12 + SLOTS);
const _: () = assert!(is_complete(FEEDBACK_FIELDS, 0, IMAGE_LEN));
const _: () = assert!(is_complete(MOTION_FIELDS, 0, MOTION_LEN));
const _: () = assert!(is_complete(OPTION_FIELDS, 24, 36));
const _: () = assert!(is_complete(POINT_FIELDS, HEAD_LEN, IMAGE_LEN));

impl CodeTable {
    /// Calls `each` with every code that has a name, in words of the code: `MoveLinCartesian`.
    pub fn for_each(self, mut each: impl FnMut(u16, &dyn core::fmt::Debug)) {
        match self {
            Self::Skill => Skill::NAMED.iter().for_each(|skill| each(u8::from(*skill).into(), skill)),
            Self::State => State::NAMED.iter().for_each(|state| each(u8::from(*state).into(), state)),
            Self::Error => ErrorNumber::NAMED.iter().for_each(|error| each(u16::from(*error), error)),
            Self::Kind => MotionKind::NAMED.iter().for_each(|kind| each(u8::from(*kind).into(), kind)),
        }
    }
}
