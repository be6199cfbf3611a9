//! A motion as the registers that the second layer reads from a slot, one signal each.

use protocol::image::{Configuration, Motion};

use crate::form::{Field, Variable};

/// Number of registers.
pub const COUNT: usize = crate::form::REGISTER_COUNT;

/// A register and its place in a slot: name, first byte, length.
///
/// `status` to `jerk` lie on the same bytes as the auxiliary point: which of them a motion has depends on its kind.
pub const REGISTERS: [(Variable, usize, usize); COUNT] = [
    ("t1", 0, 4),
    ("t2", 4, 4),
    ("t3", 8, 4),
    ("t4", 12, 4),
    ("t5", 16, 4),
    ("t6", 20, 4),
    ("x1", 24, 4),
    ("x2", 28, 4),
    ("x3", 32, 4),
    ("status", 24, 1),
    ("turn", 25, 1),
    ("deceleration", 26, 2),
    ("jerk", 28, 2),
    ("velocity", 36, 2),
    ("acceleration", 38, 2),
    ("approximation", 40, 2),
    ("kind", 42, 1),
    ("frames", 43, 1),
];

/// First byte of the slots in the command.
const SLOTS_AT: usize = 36;

/// Length of a slot in bytes.
const SLOT_LEN: usize = 44;

/// Returns the signal of a register in a slot.
#[must_use]
pub fn slot_field(slot: usize, register: usize) -> Field {
    let (name, at, len) = REGISTERS[register % COUNT];
    Field { name: format!("m{slot}_{name}"), at: SLOTS_AT + slot * SLOT_LEN + at, len }
}

/// Returns the registers of a motion. Those that its kind does not have are 0, as its reader takes them.
#[must_use]
pub fn registers(motion: &Motion) -> [u32; COUNT] {
    let mut values = [0; COUNT];
    for (value, coordinate) in values.iter_mut().zip(motion.target.iter().chain(&motion.auxiliary)) {
        *value = coordinate.to_bits();
    }
    if !motion.kind.has_auxiliary() {
        values[6..9].fill(0);
        if let Some(Configuration { status, turn }) = motion.configuration {
            values[9] = 0x80 | if turn.is_none() { 0x40 } else { 0 } | u32::from(status);
            values[10] = turn.unwrap_or(0).into();
        }
        (values[11], values[12]) = (motion.deceleration.into(), motion.jerk.into());
    }
    values[13] = motion.velocity.into();
    values[14] = motion.acceleration.into();
    values[15] = motion.approximation.into();
    values[16] = u8::from(motion.kind).into();
    values[17] = u32::from(motion.tool) << 4 | u32::from(motion.base);
    values
}
