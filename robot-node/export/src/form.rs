//! The intermediate form: tasks of statements, which the printers write as KRL and RAPID and which [`crate::execution`] executes.
//!
//! Each statement is an instant of its own: the image may change between any two of them, and the other task may run. So a
//! statement reads at most one signal, and its expression at most one variable that the other task sets: [`Kit::faults`] checks both.
//! Numbers are whole; a coordinate is kept as the bits of its REAL until a motion uses it.

use std::collections::{BTreeMap, BTreeSet};

/// Number of registers of a motion.
pub const REGISTER_COUNT: usize = 18;

/// Name of a variable, without the prefix of the files.
pub type Variable = &'static str;

/// A part of the image, which a controller sees as a signal of its own.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Field {
    /// Its name, without the prefix of the files.
    pub name: String,
    /// Its first byte.
    pub at: usize,
    /// Its length: 1, 2 or 4 bytes.
    pub len: usize,
}

/// An operation on two values.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum FormOperation {
    /// Sum.
    Add,
    /// Difference.
    Subtract,
    /// Quotient without its remainder.
    Divide,
    /// Remainder.
    Modulo,
    /// Bits that both have.
    BitAnd,
    /// Bits that one has.
    BitXor,
    /// Equality.
    Equal,
    /// Inequality.
    Unequal,
    /// Less than.
    Less,
    /// Greater than.
    Greater,
    /// Both.
    And,
    /// One or both.
    Or,
}

/// A stopwatch of the controller.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub enum WatchTimer {
    /// Time since the life counter of the PLC changed.
    Life,
    /// Time since the robot counted its own.
    Count,
}

/// A question to the controller.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Sense {
    /// The arm stands still.
    AtRest,
    /// The drives are on.
    DrivesOn,
    /// The stopwatch has passed its limit.
    Expired(WatchTimer),
    /// The bits in this variable are not those of a finite REAL.
    NotFinite(Variable),
    /// Error number of the motion in the registers, by the inverse kinematics of the controller: 0, 14 or 15.
    Reach,
    /// The adapter does with this value as it must.
    Passes(AdapterTest),
}

/// A test of the adapter, in which each language has its own way of doing the same. Literals are numbers that a REAL has exactly.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum AdapterTest {
    /// The bytes of two are swapped for a bus with the most significant byte first, and kept for others.
    Word(u16),
    /// The same for four bytes.
    DoubleWord(u32),
    /// The REAL of the literal has these bits.
    BitsOfReal(&'static str, u32),
    /// These bits are the REAL of the literal.
    RealOfBits(u32, &'static str),
    /// These bits are a finite REAL, or else are not.
    Finite(u32, bool),
}

/// An expression.
#[derive(Clone, PartialEq, Debug)]
pub enum Expression {
    /// A whole number.
    Number(i64),
    /// A truth value.
    Truth(bool),
    /// The value of a variable.
    Value(Variable),
    /// An operation.
    Pair(FormOperation, Box<Expression>, Box<Expression>),
    /// Negation.
    Not(Box<Expression>),
    /// A question to the controller.
    Ask(Sense),
}

/// When a motion raises the count of executed motions.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Trigger {
    /// At the end of its path, or in the middle of the corner there.
    End,
    /// Where its path begins. A fault for tests: the motion counts before it was executed.
    Begin,
}

/// The motion of a statement.
#[derive(Clone, PartialEq, Debug)]
pub enum Driven {
    /// The motion in the registers.
    Registers,
    /// Consecutive motions of a stored program, each with its registers: one, or the pieces of one spline.
    Stored(Vec<[u32; REGISTER_COUNT]>),
}

/// A statement.
#[derive(Clone, PartialEq, Debug)]
pub enum Statement {
    /// Reads a signal into a variable.
    Read(Variable, Field),
    /// Writes a signal.
    Write(Field, Expression),
    /// Sets a variable.
    Set(Variable, Expression),
    /// Executes the first list if the condition holds, otherwise the second one.
    If(Expression, Vec<Statement>, Vec<Statement>),
    /// Executes the list while the condition holds.
    While(Expression, Vec<Statement>),
    /// Executes the list until the condition holds after it.
    Repeat(Vec<Statement>, Expression),
    /// Executes the list for ever.
    Loop(Vec<Statement>),
    /// Calls a routine.
    Call(String),
    /// Calls a routine that is abandoned when `stop` rises: the arm brakes, and its motions are dropped.
    Guarded(String),
    /// Ends the guard: the last statement of a guarded routine.
    EndGuard,
    /// Gives a motion to the interpolator; waits while the advance run is as far ahead as it may be.
    Move(Driven, Trigger),
    /// Waits some ms; the advance run waits until the arm has executed all motions.
    Pause,
    /// Gives the processor to others for a moment. The advance run does not wait.
    Yield,
    /// Shows that a test of the adapter failed; the number of the test is in `test`.
    ShowFault,
    /// Waits at a stop of a stored program, in ms.
    Hold(u32),
    /// Starts a stopwatch anew.
    Restart(WatchTimer),
    /// Sets the override of the controller to a variable, in %.
    Speed(Variable),
    /// Sets the digital outputs of the robot to a variable.
    Outputs(Variable),
    /// Writes joints, pose and speed into the image.
    Pose,
}

/// A routine of a task.
#[derive(Clone, PartialEq, Debug)]
pub struct Routine {
    /// Its name, without the prefix of the files.
    pub name: String,
    /// Its purpose, for the files.
    pub purpose: &'static str,
    /// Its statements.
    pub body: Vec<Statement>,
}

/// A variable with its first value.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Declaration {
    /// Its name.
    pub name: Variable,
    /// Its first value; `None` for a truth value, which begins as FALSE.
    pub number: Option<i64>,
}

/// The whole second layer. The first routine of each task is the one that runs.
#[derive(Clone, PartialEq, Debug)]
pub struct Kit {
    /// The task that moves the arm.
    pub motion: Vec<Routine>,
    /// The routine that a trigger calls, in the task that moves the arm.
    pub on_trigger: Routine,
    /// The task that exchanges the image: submit interpreter or background task.
    pub cyclic: Vec<Routine>,
    /// The variables.
    pub variables: Vec<Declaration>,
}

impl Expression {
    /// Collects the variables of an expression.
    fn variables(&self, into: &mut BTreeSet<Variable>) {
        match self {
            Self::Value(name) | Self::Ask(Sense::NotFinite(name)) => {
                into.insert(name);
            }
            Self::Pair(_, one, other) => {
                one.variables(into);
                other.variables(into);
            }
            Self::Not(inner) => inner.variables(into),
            Self::Number(_) | Self::Truth(_) | Self::Ask(_) => {}
        }
    }
}

/// Calls `visit` with each statement, those in others included.
pub fn walk<'a>(statements: &'a [Statement], visit: &mut impl FnMut(&'a Statement)) {
    for statement in statements {
        visit(statement);
        match statement {
            Statement::If(_, then, otherwise) => {
                walk(then, visit);
                walk(otherwise, visit);
            }
            Statement::While(_, body) | Statement::Repeat(body, _) | Statement::Loop(body) => {
                walk(body, visit)
            }
            _ => {}
        }
    }
}

/// Returns the variables that some routines set.
fn set_by<'a>(routines: impl IntoIterator<Item = &'a Routine>) -> BTreeSet<Variable> {
    let mut set = BTreeSet::new();
    for routine in routines {
        walk(&routine.body, &mut |statement| {
            if let Statement::Read(name, _) | Statement::Set(name, _) = statement {
                set.insert(*name);
            }
        });
    }
    set
}

impl Kit {
    /// Returns the faults of the form: names that are not declared, routines that are not there, and statements that are more than
    /// one instant.
    #[must_use]
    pub fn faults(&self) -> Vec<String> {
        let mut faults = Vec::new();
        let declared: BTreeMap<_, _> =
            self.variables.iter().map(|variable| (variable.name, variable)).collect();
        let moving = || self.motion.iter().chain([&self.on_trigger]);
        let (by_motion, by_cyclic) = (set_by(moving()), set_by(&self.cyclic));
        for (routines, foreign) in
            [(moving().collect::<Vec<_>>(), &by_cyclic), (self.cyclic.iter().collect(), &by_motion)]
        {
            for routine in &routines {
                walk(&routine.body, &mut |statement| {
                    let mut names = BTreeSet::new();
                    match statement {
                        Statement::Read(name, _) | Statement::Speed(name) | Statement::Outputs(name) => {
                            names.insert(*name);
                        }
                        Statement::Set(name, value) => {
                            value.variables(&mut names);
                            if names.iter().filter(|name| foreign.contains(*name)).count() > 1 {
                                faults.push(format!(
                                    "{}: {statement:?} is more than one instant",
                                    routine.name
                                ));
                            }
                            names.insert(name);
                        }
                        Statement::Write(_, value)
                        | Statement::If(value, ..)
                        | Statement::While(value, _)
                        | Statement::Repeat(_, value) => value.variables(&mut names),
                        Statement::Call(name) | Statement::Guarded(name)
                            if !routines.iter().any(|routine| routine.name == *name) =>
                        {
                            faults.push(format!("{}: no routine {name}", routine.name));
                        }
                        _ => {}
                    }
                    if !matches!(statement, Statement::Set(..))
                        && names.iter().filter(|name| foreign.contains(*name)).count() > 1
                    {
                        faults.push(format!("{}: {statement:?} is more than one instant", routine.name));
                    }
                    let missing = names.iter().filter(|name| !declared.contains_key(*name));
                    faults.extend(missing.map(|name| format!("{}: {name} is not declared", routine.name)));
                });
            }
        }
        faults
    }
}
