//! The intermediate form as a list of steps for each task, with variables by number.

use std::collections::HashMap;

use crate::form::{
    AdapterTest, Declaration, Driven, Expression, Field, FormOperation, Kit, Routine, Sense, Statement,
    Trigger, WatchTimer,
};
use crate::registers::{COUNT, REGISTERS};

/// An expression with variables by number.
#[derive(Clone, Debug)]
pub(super) enum Value {
    Number(i64),
    Variable(usize),
    Pair(FormOperation, Box<[Self; 2]>),
    Not(Box<Self>),
    AtRest,
    DrivesOn,
    Expired(WatchTimer),
    NotFinite(usize),
    Reach,
    Passes(AdapterTest),
}

/// One step of a task. Targets are numbers of steps.
#[derive(Clone, Debug)]
pub(super) enum FormStep {
    Read(usize, Field),
    Write(Field, Value),
    Set(usize, Value),
    JumpUnless(Value, usize),
    Jump(usize),
    Call(usize),
    Return,
    Guard { exit: usize },
    EndGuard,
    Move(Driven, Trigger),
    Pause,
    Yield,
    Hold(u32),
    Restart(WatchTimer),
    Speed(usize),
    Outputs,
    Pose,
}

/// Why a form cannot be executed.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum FormError {
    /// A name that no declaration has.
    #[error("variable {0}: not declared; add it to the kit's variables")]
    Variable(String),
    /// A routine that the task does not have.
    #[error("routine {0}: not in this task; add it to the kit's routines")]
    Routine(String),
}

/// The steps of both tasks and of the trigger's routine.
#[derive(Clone, Debug)]
pub struct FormCode {
    pub(super) motion: Vec<FormStep>,
    pub(super) cyclic: Vec<FormStep>,
    pub(super) on_trigger: Vec<FormStep>,
    /// First values, by number.
    pub(super) first: Vec<i64>,
    names: HashMap<&'static str, usize>,
    pub(super) registers: [usize; COUNT],
    pub(super) stop: usize,
    pub(super) asked_number: usize,
    /// A count of 32 bits has a sign, as INT in KRL.
    pub(super) has_sign: bool,
}

impl FormCode {
    /// Translates a kit. `has_sign` says that numbers of 32 bits have a sign, as INT in KRL has.
    ///
    /// # Errors
    /// A name that is not declared, or a routine that is not there.
    pub fn of(kit: &Kit, has_sign: bool) -> Result<Self, FormError> {
        let names: HashMap<_, _> =
            kit.variables.iter().enumerate().map(|(at, Declaration { name, .. })| (*name, at)).collect();
        let index = |name: &str| names.get(name).copied().ok_or_else(|| FormError::Variable(name.into()));
        let mut registers = [0; COUNT];
        for (register, (name, ..)) in registers.iter_mut().zip(REGISTERS) {
            *register = index(name)?;
        }
        let task = |routines: &[Routine]| TaskTranslation::translate(routines, &names);
        Ok(Self {
            motion: task(&kit.motion)?,
            cyclic: task(&kit.cyclic)?,
            on_trigger: task(core::slice::from_ref(&kit.on_trigger))?,
            first: kit.variables.iter().map(|variable| variable.number.unwrap_or(0)).collect(),
            registers,
            stop: index("stop")?,
            asked_number: index("asked_number")?,
            has_sign,
            names,
        })
    }

    /// Returns the number of a variable, if there is one of this name.
    #[must_use]
    pub fn variable(&self, name: &str) -> Option<usize> {
        self.names.get(name).copied()
    }
}

/// A task under translation.
struct TaskTranslation<'a> {
    names: &'a HashMap<&'static str, usize>,
    steps: Vec<FormStep>,
    /// Calls whose target is not known yet: the step, the routine.
    calls: Vec<(usize, String)>,
}

impl<'a> TaskTranslation<'a> {
    fn translate(
        routines: &[Routine],
        names: &'a HashMap<&'static str, usize>,
    ) -> Result<Vec<FormStep>, FormError> {
        let mut task = Self { names, steps: Vec::new(), calls: Vec::new() };
        let mut entries = HashMap::new();
        for routine in routines {
            entries.insert(routine.name.as_str(), task.steps.len());
            task.block(&routine.body)?;
            task.steps.push(FormStep::Return);
        }
        for (at, name) in task.calls {
            let entry = entries.get(name.as_str()).ok_or(FormError::Routine(name))?;
            task.steps[at] = FormStep::Call(*entry);
        }
        Ok(task.steps)
    }

    fn index(&self, name: &str) -> Result<usize, FormError> {
        self.names.get(name).copied().ok_or_else(|| FormError::Variable(name.into()))
    }

    fn value(&self, expression: &Expression) -> Result<Value, FormError> {
        Ok(match expression {
            Expression::Number(number) => Value::Number(*number),
            Expression::Truth(truth) => Value::Number((*truth).into()),
            Expression::Value(name) => Value::Variable(self.index(name)?),
            Expression::Pair(operation, one, other) => {
                Value::Pair(*operation, Box::new([self.value(one)?, self.value(other)?]))
            }
            Expression::Not(inner) => Value::Not(Box::new(self.value(inner)?)),
            Expression::Ask(Sense::AtRest) => Value::AtRest,
            Expression::Ask(Sense::DrivesOn) => Value::DrivesOn,
            Expression::Ask(Sense::Expired(stopwatch)) => Value::Expired(*stopwatch),
            Expression::Ask(Sense::NotFinite(name)) => Value::NotFinite(self.index(name)?),
            Expression::Ask(Sense::Reach) => Value::Reach,
            Expression::Ask(Sense::Passes(test)) => Value::Passes(*test),
        })
    }

    fn call(&mut self, name: &str) {
        self.calls.push((self.steps.len(), name.to_owned()));
        self.steps.push(FormStep::Return);
    }

    fn block(&mut self, statements: &[Statement]) -> Result<(), FormError> {
        statements.iter().try_for_each(|statement| self.statement(statement))
    }

    /// Sets the target of a jump to the next step.
    fn land(&mut self, jump: usize) {
        let next = self.steps.len();
        if let Some(
            FormStep::JumpUnless(_, target) | FormStep::Jump(target) | FormStep::Guard { exit: target },
        ) = self.steps.get_mut(jump)
        {
            *target = next;
        }
    }

    fn jump_unless(&mut self, condition: &Expression, target: usize) -> Result<usize, FormError> {
        let value = self.value(condition)?;
        self.steps.push(FormStep::JumpUnless(value, target));
        Ok(self.steps.len() - 1)
    }

    fn statement(&mut self, statement: &Statement) -> Result<(), FormError> {
        let here = self.steps.len();
        let step = match statement {
            Statement::If(condition, then, otherwise) => {
                let over = self.jump_unless(condition, 0)?;
                self.block(then)?;
                let end = self.steps.len();
                self.steps.push(FormStep::Jump(0));
                self.land(over);
                self.block(otherwise)?;
                self.land(end);
                return Ok(());
            }
            Statement::While(condition, body) => {
                let over = self.jump_unless(condition, 0)?;
                self.block(body)?;
                self.steps.push(FormStep::Jump(here));
                self.land(over);
                return Ok(());
            }
            Statement::Repeat(body, until) => {
                self.block(body)?;
                self.jump_unless(until, here)?;
                return Ok(());
            }
            Statement::Loop(body) => {
                self.block(body)?;
                FormStep::Jump(here)
            }
            Statement::Call(name) => {
                self.call(name);
                return Ok(());
            }
            Statement::Guarded(name) => {
                self.steps.push(FormStep::Guard { exit: 0 });
                self.call(name);
                self.land(here);
                FormStep::EndGuard
            }
            Statement::Read(name, field) => FormStep::Read(self.index(name)?, field.clone()),
            Statement::Write(field, value) => FormStep::Write(field.clone(), self.value(value)?),
            Statement::Set(name, value) => FormStep::Set(self.index(name)?, self.value(value)?),
            Statement::EndGuard => FormStep::EndGuard,
            Statement::Move(driven, trigger) => FormStep::Move(driven.clone(), *trigger),
            Statement::Pause => FormStep::Pause,
            // Only people see the fault.
            Statement::Yield | Statement::ShowFault => FormStep::Yield,
            Statement::Hold(ms) => FormStep::Hold(*ms),
            Statement::Restart(stopwatch) => FormStep::Restart(*stopwatch),
            Statement::Speed(name) => FormStep::Speed(self.index(name)?),
            Statement::Outputs(_) => FormStep::Outputs,
            Statement::Pose => FormStep::Pose,
        };
        self.steps.push(step);
        Ok(())
    }
}
