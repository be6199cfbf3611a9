//! The check of the motion in the registers: the first thing that the robot does not execute becomes the error.

use super::ServedSkills;
use super::motion::error;
use super::words::{above, ask, both, differ, either, has, is, is_not, less, not, number, set, value, when};
use crate::ErrorNumber;
use crate::form::{Expression, FormOperation, Routine, Sense};
use crate::registers::REGISTERS;

/// Returns the routine `judge`, which sets `error`.
pub(super) fn routine(served: &ServedSkills) -> Routine {
    let fault = |condition, number| (condition, vec![set("error", error(number))]);
    let mut arms = vec![
        fault(either(is("kind", 0), above(value("kind"), number(6))), ErrorNumber::UnknownMotionKind),
        fault(both(is_not("skill", 16), differ("kind", "skill")), ErrorNumber::UnknownMotionKind),
        fault(is("kind", 6), ErrorNumber::MotionKindNotSupported),
        // The motions of a spline must be known before it begins, so one that comes through the slots is served alone.
        fault(
            if served.splines { both(is("kind", 5), is("skill", 16)) } else { is("kind", 5) },
            ErrorNumber::MotionKindNotSupported,
        ),
        fault(not(among("frames", 16, FormOperation::Divide, &served.tools)), ErrorNumber::UnknownTool),
        fault(not(among("frames", 16, FormOperation::Modulo, &served.bases)), ErrorNumber::UnknownBase),
    ];
    for (name, path, number) in [
        ("velocity", served.velocity, ErrorNumber::VelocityOutOfRange),
        ("acceleration", served.acceleration, ErrorNumber::AccelerationOutOfRange),
    ] {
        arms.push(fault(beyond(name, path), number));
        arms.push(fault(is(name, 0), number));
    }
    for (name, ..) in REGISTERS.iter().take(6) {
        arms.push(fault(ask(Sense::NotFinite(name)), ErrorNumber::TargetNotFinite));
    }
    for (name, ..) in REGISTERS.iter().skip(6).take(3) {
        let found = both(is("kind", 4), ask(Sense::NotFinite(name)));
        arms.push(fault(found, ErrorNumber::TargetNotFinite));
    }
    let has_options = || is_not("kind", 4);
    let other = both(is_not("deceleration", 0), differ("deceleration", "acceleration"));
    let deceleration = if served.decelerations { beyond("deceleration", served.acceleration) } else { other };
    arms.push(fault(both(has_options(), deceleration), ErrorNumber::DecelerationOutOfRange));
    arms.push(fault(both(has_options(), is_not("jerk", 0)), ErrorNumber::JerkOutOfRange));
    // A configuration with a turn, of a PTP to a pose: what a KUKA robot takes as S and T.
    let given = both(has_options(), has("status", 0x80));
    let with_turn = both(is("kind", 2), not(has("status", 0x40)));
    let refused = if served.configurations { both(given, not(with_turn)) } else { given };
    arms.push(fault(refused, ErrorNumber::ConfigurationMismatch));
    // One after the other, not one in the other: KRL has no ELSEIF.
    let mut body: Vec<_> =
        arms.into_iter().map(|(condition, then)| when(both(is("error", 0), condition), then)).collect();
    body.push(when(is("error", 0), vec![set("error", ask(Sense::Reach))]));
    let purpose = "Checks the motion in the registers; the first fault becomes the error.";
    Routine { name: "judge".into(), purpose, body }
}

/// Returns whether a value is above what the kind of motion allows: for PTP 100 %, in 0.01 %.
fn beyond(name: &'static str, path: u16) -> Expression {
    let axes = either(is("kind", 2), is("kind", 3));
    either(
        both(axes.clone(), above(value(name), number(10_000))),
        both(not(axes), above(value(name), number(path.into()))),
    )
}

/// Returns whether tool or base, a part of `frames`, is one of these.
fn among(
    name: &'static str,
    by: i64,
    operation: FormOperation,
    numbers: &std::collections::BTreeSet<u8>,
) -> Expression {
    let part = || super::words::pair(operation, value(name), number(by));
    let same = |one: &u8| super::words::pair(FormOperation::Equal, part(), number((*one).into()));
    numbers.iter().map(same).reduce(either).unwrap_or_else(|| less(number(1), number(0)))
}
