//! Execution of a program on a memory of its own.

use crate::compile::MOST_ARGUMENTS;
use crate::compile::code::{
    Argument, Arithmetic, Bitwise, Code, ComparisonOperator, Element, Function, Instruction, Located,
    VariableAddress,
};
use crate::{Place, Program, RunError, Scalar, Trap, Variable};

/// An instance of a function block with its memory.
#[derive(Clone, Debug)]
pub struct Instance {
    /// The variables of all functions, then those of the instance.
    pub(crate) memory: Vec<i64>,
    base: usize,
    unit: usize,
    scans: u64,
    pub(crate) steps: u64,
    /// The trap under way: where, in which unit.
    trap: Option<(Trap, Place, usize)>,
    /// The unit that runs.
    running: usize,
}

/// A trap was found; the instance knows which.
#[derive(Debug)]
pub(crate) struct Trapped;

/// What follows a statement.
#[derive(PartialEq, Eq)]
enum Flow {
    Next,
    Exit,
    Return,
}

pub(crate) type Run<T> = Result<T, Trapped>;

impl Instance {
    pub(crate) fn new(program: &Program, unit: usize) -> Self {
        let mut memory = program.frames.clone();
        let base = memory.len();
        memory.extend_from_slice(&program.units[unit].layout.initial);
        Self { memory, base, unit, scans: 0, steps: 0, trap: None, running: unit }
    }

    /// Returns a value; 0 past the end of the variable.
    #[must_use]
    pub fn get(&self, variable: Variable, index: u32) -> i64 {
        if index >= variable.len {
            return 0;
        }
        self.memory.get(self.base + (variable.offset + index) as usize).copied().unwrap_or(0)
    }

    /// Sets a value. One that is outside the type, or past the end of the variable, is ignored.
    pub fn set(&mut self, variable: Variable, index: u32, value: i64) {
        if index < variable.len
            && variable.scalar.holds(value)
            && let Some(slot) = self.memory.get_mut(self.base + (variable.offset + index) as usize)
        {
            *slot = value;
        }
    }

    /// Sets the values of a variable of `USINT` or `BYTE` from its beginning on. Bytes past its end are ignored.
    pub fn set_bytes(&mut self, variable: Variable, bytes: &[u8]) {
        let slots = self.slots_mut(variable).into_iter().flatten();
        slots.zip(bytes).for_each(|(slot, byte)| *slot = i64::from(*byte));
    }

    /// Reads the values of a variable of `USINT` or `BYTE` from its beginning on. Bytes past its end stay as they are.
    pub fn get_bytes(&self, variable: Variable, bytes: &mut [u8]) {
        let slots = self.memory.get(self.base + variable.offset as usize..).unwrap_or_default();
        let slots = slots.get(..variable.len as usize).unwrap_or(slots);
        // A byte's slot holds 0 to 255.
        bytes.iter_mut().zip(slots).for_each(|(byte, slot)| *byte = *slot as u8);
    }

    fn slots_mut(&mut self, variable: Variable) -> Option<&mut [i64]> {
        let is_byte = matches!(variable.scalar, Scalar::Usint | Scalar::Byte);
        let first = self.base + variable.offset as usize;
        self.memory.get_mut(first..first + variable.len as usize).filter(|_| is_byte)
    }

    /// Runs the body of the function block once, in at most so many steps: statements and passes of loops. The program must
    /// be the one that made the instance. Allocates nothing.
    ///
    /// # Errors
    /// A trap. The variables keep the values that they had then.
    pub fn scan(&mut self, program: &Program, budget: u64) -> Result<(), RunError> {
        self.scans += 1;
        self.steps = budget;
        self.running = self.unit;
        let Some(unit) = program.units.get(self.unit) else { return Ok(()) };
        match self.body(program, &unit.body, self.base) {
            Ok(_) => Ok(()),
            Err(Trapped) => {
                let (trap, place, unit) =
                    self.trap.take().unwrap_or((Trap::Steps, Place::default(), self.unit));
                let file = program.units.get(unit).map_or_else(String::new, |unit| unit.file.to_string());
                Err(RunError { file, place, scan: self.scans, trap })
            }
        }
    }

    #[cold]
    fn trap<T>(&mut self, trap: Trap, place: Place) -> Run<T> {
        self.trap = Some((trap, place, self.running));
        Err(Trapped)
    }

    #[inline(always)]
    fn step(&mut self, place: Place) -> Run<()> {
        match self.steps.checked_sub(1) {
            Some(steps) => {
                self.steps = steps;
                Ok(())
            }
            None => self.trap(Trap::Steps, place),
        }
    }

    fn body(&mut self, program: &Program, statements: &[Located], this: usize) -> Run<Flow> {
        for statement in statements {
            self.step(statement.place)?;
            let flow = self.instruction(program, statement, this)?;
            if flow != Flow::Next {
                return Ok(flow);
            }
        }
        Ok(Flow::Next)
    }

    fn instruction(&mut self, program: &Program, statement: &Located, this: usize) -> Run<Flow> {
        match &statement.instruction {
            Instruction::Store(address, code) => {
                let value = self.value(program, code, this)?;
                let slot = self.slot(program, address, this)?;
                self.memory[slot] = value;
            }
            Instruction::Copy(to, from, len) => {
                let from = self.slot(program, from, this)?;
                let to = self.slot(program, to, this)?;
                self.memory.copy_within(from..from + *len as usize, to);
            }
            Instruction::Call(unit, address, arguments) => {
                let instance = self.slot(program, address, this)?;
                for argument in arguments {
                    self.pass(program, argument, this, instance)?;
                }
                self.enter(program, *unit, instance)?;
            }
            Instruction::If(branches, otherwise) => {
                for (condition, body) in branches {
                    if self.test(program, condition, this)? {
                        return self.body(program, body, this);
                    }
                }
                return self.body(program, otherwise, this);
            }
            Instruction::Case(value, branches, otherwise) => {
                let value = self.value(program, value, this)?;
                let found = branches.iter().find(|(labels, _)| labels.contains(&value));
                return self.body(program, found.map_or(otherwise, |(_, body)| body), this);
            }
            Instruction::For(of) => return self.for_loop(program, of, statement.place, this),
            Instruction::While(condition, body) => {
                while self.test(program, condition, this)? {
                    self.step(statement.place)?;
                    match self.body(program, body, this)? {
                        Flow::Next => {}
                        Flow::Exit => break,
                        Flow::Return => return Ok(Flow::Return),
                    }
                }
            }
            Instruction::Repeat(body, condition) => loop {
                self.step(statement.place)?;
                match self.body(program, body, this)? {
                    Flow::Next => {}
                    Flow::Exit => break,
                    Flow::Return => return Ok(Flow::Return),
                }
                if self.value(program, condition, this)? != 0 {
                    break;
                }
            },
            Instruction::Exit => return Ok(Flow::Exit),
            Instruction::Return => return Ok(Flow::Return),
        }
        Ok(Flow::Next)
    }

    fn for_loop(
        &mut self,
        program: &Program,
        of: &crate::compile::code::For,
        place: Place,
        this: usize,
    ) -> Run<Flow> {
        let variable = self.slot(program, &of.variable, this)?;
        let mut value = self.value(program, &of.from, this)?;
        let to = self.value(program, &of.to, this)?;
        let by = self.value(program, &of.by, this)?;
        if by == 0 {
            return self.trap(Trap::StepOfZero, place);
        }
        let idle = self.idle_passes(program, of, value, to, this)?;
        self.steps -= 2 * idle as u64;
        value += idle as i64;
        if !of.scalar.holds(value) {
            return self.trap(Trap::Overflow, place);
        }
        self.memory[variable] = value;
        while if by > 0 { value <= to } else { value >= to } {
            self.step(place)?;
            match self.body(program, &of.body, this)? {
                Flow::Next => {}
                Flow::Exit => break,
                Flow::Return => return Ok(Flow::Return),
            }
            value = self.memory[variable] + by;
            if !of.scalar.holds(value) {
                return self.trap(Trap::Overflow, place);
            }
            self.memory[variable] = value;
        }
        Ok(Flow::Next)
    }

    /// Writes a parameter into the slots of the unit that is called.
    fn pass(&mut self, program: &Program, argument: &Argument, this: usize, callee: usize) -> Run<()> {
        match argument {
            Argument::Value(slot, code) => {
                let value = self.value(program, code, this)?;
                self.memory[callee + *slot as usize] = value;
            }
            Argument::Reference(slot, address) => {
                let referred = self.slot(program, address, this)?;
                self.memory[callee + *slot as usize] = referred as i64;
            }
            Argument::Copy(slot, address, len) => {
                let from = self.slot(program, address, this)?;
                self.memory.copy_within(from..from + *len as usize, callee + *slot as usize);
            }
        }
        Ok(())
    }

    fn enter(&mut self, program: &Program, unit: usize, this: usize) -> Run<()> {
        let caller = core::mem::replace(&mut self.running, unit);
        self.body(program, &program.units[unit].body, this)?;
        self.running = caller;
        Ok(())
    }

    fn function(&mut self, program: &Program, call: &Function, this: usize) -> Run<i64> {
        // A parameter may call the same function: all are computed before the first is written.
        let mut values = [0; MOST_ARGUMENTS];
        for (value, argument) in values.iter_mut().zip(&call.arguments) {
            *value = match argument {
                Argument::Value(_, code) => self.value(program, code, this)?,
                Argument::Reference(_, address) | Argument::Copy(_, address, _) => {
                    self.slot(program, address, this)? as i64
                }
            };
        }
        let unit = &program.units[call.unit];
        self.memory[unit.frame..unit.frame + unit.layout.initial.len()].copy_from_slice(&unit.layout.initial);
        for (value, argument) in values.into_iter().zip(&call.arguments) {
            let (Argument::Value(slot, _) | Argument::Reference(slot, _) | Argument::Copy(slot, ..)) =
                argument;
            self.memory[unit.frame + *slot as usize] = value;
        }
        self.enter(program, call.unit, unit.frame)?;
        Ok(self.memory[unit.frame])
    }

    #[inline(always)]
    pub(crate) fn slot(&mut self, program: &Program, address: &VariableAddress, this: usize) -> Run<usize> {
        match address {
            VariableAddress::Local(offset) => Ok(this + *offset as usize),
            VariableAddress::Through(slot, offset) => Ok(self.through(*slot, *offset, this)),
            VariableAddress::Element(element) => self.element(program, element, this),
        }
    }

    /// Returns the slot of what an IN_OUT refers to.
    #[inline(always)]
    fn through(&self, slot: u32, offset: u32, this: usize) -> usize {
        self.memory[this + slot as usize] as usize + offset as usize
    }

    fn element(&mut self, program: &Program, element: &Element, this: usize) -> Run<usize> {
        let index = self.value(program, &element.index, this)? - element.low;
        if index < 0 || index >= i64::from(element.len) {
            return self.trap(Trap::Index, element.place);
        }
        let base = match &element.base {
            VariableAddress::Local(offset) => this + *offset as usize,
            VariableAddress::Through(slot, offset) => self.through(*slot, *offset, this),
            VariableAddress::Element(outer) => self.element(program, outer, this)?,
        };
        Ok(base + index as usize * element.stride as usize + element.offset as usize)
    }

    #[inline(always)]
    fn pair(&mut self, program: &Program, operands: &[Code; 2], this: usize) -> Run<(i64, i64)> {
        let [left, right] = operands;
        Ok((self.value(program, left, this)?, self.value(program, right, this)?))
    }

    /// Computes an expression. Most operands are constants and plain variables: these need no call, which takes longer than
    /// they do.
    #[inline(always)]
    fn value(&mut self, program: &Program, code: &Code, this: usize) -> Run<i64> {
        match code {
            Code::Constant(value) => Ok(*value),
            Code::Load(VariableAddress::Local(offset)) => Ok(self.memory[this + *offset as usize]),
            Code::Load(VariableAddress::Through(slot, offset)) => {
                Ok(self.memory[self.through(*slot, *offset, this)])
            }
            code => self.compound(program, code, this),
        }
    }

    /// Computes a condition; the usual one is a comparison of two plain values.
    #[inline(always)]
    fn test(&mut self, program: &Program, code: &Code, this: usize) -> Run<bool> {
        if let Code::Compare(comparison, operands) = code {
            let (left, right) = self.pair(program, operands, this)?;
            return Ok(compare(*comparison, &left, &right));
        }
        Ok(self.value(program, code, this)? != 0)
    }

    fn compound(&mut self, program: &Program, code: &Code, this: usize) -> Run<i64> {
        match code {
            Code::Constant(value) => Ok(*value),
            Code::Load(address) => {
                let slot = self.slot(program, address, this)?;
                Ok(self.memory[slot])
            }
            Code::Flip(value, bits) => Ok(self.value(program, value, this)? ^ bits),
            Code::Negate(value, Scalar::Real, _) => Ok(self.value(program, value, this)? ^ 0x8000_0000),
            Code::Absolute(value, Scalar::Real, _) => Ok(self.value(program, value, this)? & 0x7FFF_FFFF),
            Code::Negate(value, scalar, place) => {
                let value = -self.value(program, value, this)?;
                self.within(*scalar, Some(value), *place)
            }
            Code::Absolute(value, scalar, place) => {
                let value = self.value(program, value, this)?.abs();
                self.within(*scalar, Some(value), *place)
            }
            Code::Integer(operation, scalar, operands, place) => {
                let (left, right) = self.pair(program, operands, this)?;
                if right == 0 && matches!(operation, Arithmetic::Divide | Arithmetic::Modulo) {
                    return self.trap(Trap::DivisionByZero, *place);
                }
                let value = match operation {
                    Arithmetic::Add => left.checked_add(right),
                    Arithmetic::Subtract => left.checked_sub(right),
                    Arithmetic::Multiply => left.checked_mul(right),
                    Arithmetic::Divide => left.checked_div(right),
                    Arithmetic::Modulo => left.checked_rem(right),
                };
                self.within(*scalar, value, *place)
            }
            Code::Real(operation, operands, place) => {
                let (left, right) = self.pair(program, operands, this)?;
                let (left, right) = (real(left), real(right));
                let value = match operation {
                    Arithmetic::Add => left + right,
                    Arithmetic::Subtract => left - right,
                    Arithmetic::Multiply => left * right,
                    Arithmetic::Divide | Arithmetic::Modulo => left / right,
                };
                if value.is_finite() {
                    Ok(i64::from(value.to_bits()))
                } else {
                    self.trap(Trap::NotFinite, *place)
                }
            }
            Code::Compare(comparison, operands) => {
                let (left, right) = self.pair(program, operands, this)?;
                Ok(i64::from(compare(*comparison, &left, &right)))
            }
            Code::CompareReal(comparison, operands) => {
                let (left, right) = self.pair(program, operands, this)?;
                Ok(i64::from(compare(*comparison, &real(left), &real(right))))
            }
            Code::Bits(operation, operands) => {
                let (left, right) = self.pair(program, operands, this)?;
                Ok(match operation {
                    Bitwise::And => left & right,
                    Bitwise::Or => left | right,
                    Bitwise::Xor => left ^ right,
                })
            }
            Code::Shift(is_left, scalar, operands, place) => {
                let (value, by) = self.pair(program, operands, this)?;
                match by {
                    0..=31 if *is_left => Ok((value << by) & scalar.range().1),
                    0..=31 => Ok(value >> by),
                    _ => self.trap(Trap::Overflow, *place),
                }
            }
            Code::Convert(from, to, value, place) => {
                let value = self.value(program, value, this)?;
                self.convert(*from, *to, value, *place)
            }
            Code::Function(call) => self.function(program, call, this),
        }
    }

    #[inline(always)]
    fn within(&mut self, scalar: Scalar, value: Option<i64>, place: Place) -> Run<i64> {
        match value {
            Some(value) if scalar.holds(value) => Ok(value),
            _ => self.trap(Trap::Overflow, place),
        }
    }

    fn convert(&mut self, from: Scalar, to: Scalar, value: i64, place: Place) -> Run<i64> {
        if to == Scalar::Real {
            return Ok(i64::from((value as f32).to_bits()));
        }
        // IEC 61131-3, table 22: REAL is rounded to the nearest integer, halves to the even one.
        let value =
            if from == Scalar::Real { f64::from(real(value)).round_ties_even() as i64 } else { value };
        if to.holds(value) { Ok(value) } else { self.trap(Trap::Narrowing, place) }
    }
}

fn real(slot: i64) -> f32 {
    f32::from_bits(slot as u32)
}

#[inline(always)]
fn compare<T: PartialOrd>(comparison: ComparisonOperator, left: &T, right: &T) -> bool {
    match comparison {
        ComparisonOperator::Equal => left == right,
        ComparisonOperator::NotEqual => left != right,
        ComparisonOperator::Less => left < right,
        ComparisonOperator::LessOrEqual => left <= right,
        ComparisonOperator::Greater => left > right,
        ComparisonOperator::GreaterOrEqual => left >= right,
    }
}
