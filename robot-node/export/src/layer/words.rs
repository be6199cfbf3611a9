//! The words in which the second layer is written: short constructors of the intermediate form, and the fields of both images.

use crate::form::{Expression, Field, FormOperation, Sense, Statement, Variable};

pub(super) fn number(value: i64) -> Expression {
    Expression::Number(value)
}

pub(super) fn value(name: Variable) -> Expression {
    Expression::Value(name)
}

pub(super) fn truth(value: bool) -> Expression {
    Expression::Truth(value)
}

pub(super) fn pair(operation: FormOperation, one: Expression, other: Expression) -> Expression {
    Expression::Pair(operation, Box::new(one), Box::new(other))
}

pub(super) fn not(inner: Expression) -> Expression {
    Expression::Not(Box::new(inner))
}

pub(super) fn ask(sense: Sense) -> Expression {
    Expression::Ask(sense)
}

pub(super) fn plus(one: Expression, other: i64) -> Expression {
    pair(FormOperation::Add, one, number(other))
}

pub(super) fn minus(one: Expression, other: Expression) -> Expression {
    pair(FormOperation::Subtract, one, other)
}

pub(super) fn is(name: Variable, other: i64) -> Expression {
    pair(FormOperation::Equal, value(name), number(other))
}

pub(super) fn is_not(name: Variable, other: i64) -> Expression {
    pair(FormOperation::Unequal, value(name), number(other))
}

pub(super) fn same(one: Variable, other: Variable) -> Expression {
    pair(FormOperation::Equal, value(one), value(other))
}

pub(super) fn differ(one: Variable, other: Variable) -> Expression {
    pair(FormOperation::Unequal, value(one), value(other))
}

pub(super) fn less(one: Expression, other: Expression) -> Expression {
    pair(FormOperation::Less, one, other)
}

pub(super) fn above(one: Expression, other: Expression) -> Expression {
    pair(FormOperation::Greater, one, other)
}

pub(super) fn both(one: Expression, other: Expression) -> Expression {
    pair(FormOperation::And, one, other)
}

pub(super) fn either(one: Expression, other: Expression) -> Expression {
    pair(FormOperation::Or, one, other)
}

/// Bits of a variable.
pub(super) fn bits(name: Variable, mask: i64) -> Expression {
    pair(FormOperation::BitAnd, value(name), number(mask))
}

/// Returns the condition that one bit of a variable is set.
pub(super) fn has(name: Variable, mask: i64) -> Expression {
    pair(FormOperation::Unequal, bits(name, mask), number(0))
}

pub(super) fn set(name: Variable, to: Expression) -> Statement {
    Statement::Set(name, to)
}

pub(super) fn call(name: &str) -> Statement {
    Statement::Call(name.into())
}

pub(super) fn when(condition: Expression, then: Vec<Statement>) -> Statement {
    Statement::If(condition, then, Vec::new())
}

/// Writes a list of conditions of which the first that holds counts.
pub(super) fn first_of(arms: Vec<(Expression, Vec<Statement>)>, otherwise: Vec<Statement>) -> Vec<Statement> {
    arms.into_iter()
        .rev()
        .fold(otherwise, |rest, (condition, then)| vec![Statement::If(condition, then, rest)])
}

fn field(name: &str, at: usize, len: usize) -> Field {
    Field { name: name.into(), at, len }
}

/// Reads a field of the head of the command.
pub(super) fn read(into: Variable, name: &str) -> Statement {
    const HEAD: [(&str, usize, usize); 11] = [
        ("control", 0, 2),
        ("life", 2, 2),
        ("number", 4, 2),
        ("skill", 6, 1),
        ("override", 7, 1),
        ("total", 8, 4),
        ("written", 12, 4),
        ("program", 16, 2),
        ("outputs", 18, 2),
        ("start_1", 20, 4),
        ("start_2", 24, 4),
    ];
    let found = HEAD.iter().find(|(known, ..)| *known == name);
    let (name, at, len) = found.copied().unwrap_or(("control", 0, 2));
    Statement::Read(into, field(name, at, len))
}

/// Writes a field of the feedback.
pub(super) fn write(name: &str, to: Expression) -> Statement {
    const HEAD: [(&str, usize, usize); 12] = [
        ("status", 0, 2),
        ("state", 2, 1),
        ("override", 3, 1),
        ("number", 4, 2),
        ("error", 6, 2),
        ("executed", 8, 4),
        ("accepted", 12, 4),
        ("error_motion", 16, 4),
        ("inputs", 20, 2),
        ("echo", 22, 2),
        ("life", 24, 2),
        ("late", 26, 2),
    ];
    let found = HEAD.iter().find(|(known, ..)| *known == name);
    let (name, at, len) = found.copied().unwrap_or(("status", 0, 2));
    Statement::Write(field(name, at, len), to)
}

/// Returns the fields that [`Statement::Pose`] writes: six joints, the pose, the path speed.
pub(super) fn pose_fields() -> Vec<Field> {
    let joints = (0..6).map(|axis| field(&format!("joint_{}", axis + 1), 44 + 4 * axis, 4));
    let pose = (0..6).map(|coordinate| field(&format!("pose_{}", coordinate + 1), 68 + 4 * coordinate, 4));
    joints.chain(pose).chain([field("path_speed", 92, 4)]).collect()
}
