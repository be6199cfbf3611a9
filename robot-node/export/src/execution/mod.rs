//! Executes the intermediate form: two tasks, each statement an instant of its own, and an arm with an advance run.
//!
//! Who owns a [`FormController`] decides what happens next: a step of one of the tasks, or a step of the arm. Between any two of them
//! the images may change. Nothing here draws at random or reads a clock.

mod adapter;
mod arm;
mod code;

use protocol::image::{ErrorNumber, IMAGE_LEN, Image, Order};

pub use adapter::AdapterFunctions;
pub use arm::Begun;
use arm::ExecutedArm;
pub use code::{FormCode, FormError};
use code::{FormStep, Value};

use crate::form::{Driven, Field, FormOperation, WatchTimer};
use crate::registers::COUNT;

/// Limit of the stopwatch of the PLC's life counter in ms, as in the exported code.
pub const LIFE_MS: u64 = 100;

/// Where a task is.
#[derive(Clone, Debug, Default)]
struct TaskPlace {
    step: usize,
    returns: Vec<usize>,
    /// Where a stop leads to, with the depth of the calls there; while a guard is armed.
    guard: Option<(usize, usize)>,
    /// `stop` rose under the guard.
    is_stopped: bool,
    /// End of a wait, in ms of the controller.
    held_until: Option<u64>,
}

/// A robot controller that executes the form.
#[derive(Clone, Debug)]
pub struct FormController<'a> {
    code: &'a FormCode,
    order: Order,
    values: Vec<i64>,
    motion: TaskPlace,
    cyclic: TaskPlace,
    arm: ExecutedArm,
    image: Image,
    /// The clock in ms.
    now: u64,
    watches: [u64; 2],
    /// Time of a robot cycle in ms.
    cycle_ms: u64,
    /// Steps that the arm takes to brake.
    braking: u32,
    reach: fn(&[u32; COUNT]) -> ErrorNumber,
    adapter: AdapterFunctions,
}

impl<'a> FormController<'a> {
    /// Creates a controller on a bus of this byte order, whose advance run is at most so many motions ahead.
    #[must_use]
    pub fn new(
        code: &'a FormCode,
        order: Order,
        advance: usize,
        reach: fn(&[u32; COUNT]) -> ErrorNumber,
    ) -> Self {
        Self {
            code,
            order,
            values: code.first.clone(),
            motion: TaskPlace::default(),
            cyclic: TaskPlace::default(),
            arm: ExecutedArm::new(advance),
            image: [0; IMAGE_LEN],
            now: 0,
            watches: [0; 2],
            cycle_ms: 4,
            braking: 3,
            reach,
            adapter: AdapterFunctions::default(),
        }
    }

    /// Returns the image that the PLC reads at this instant.
    #[must_use]
    pub const fn image(&self) -> &Image {
        &self.image
    }

    /// Returns the motions that the arm began, in order.
    #[must_use]
    pub fn begun(&self) -> &[Begun] {
        &self.arm.begun
    }

    /// Returns the value of a variable.
    #[must_use]
    pub fn value(&self, name: &str) -> Option<i64> {
        self.values.get(self.code.variable(name)?).copied()
    }

    /// Lets 1 ms pass.
    pub const fn pass_ms(&mut self) {
        self.now += 1;
    }

    /// Replaces the functions of the adapter, for tests that plant a fault there.
    pub const fn set_adapter(&mut self, adapter: AdapterFunctions) {
        self.adapter = adapter;
    }

    /// Lets the arm brake for so many of its steps from now on.
    pub const fn set_braking(&mut self, steps: u32) {
        self.braking = steps;
    }

    /// Lets the arm drive on.
    pub fn step_arm(&mut self) {
        self.arm.drive();
    }

    /// Executes one statement of the cyclic task.
    pub fn step_cyclic(&mut self, command: &Image) {
        let code = self.code;
        let mut place = core::mem::take(&mut self.cyclic);
        if let Some(step) = code.cyclic.get(place.step) {
            self.execute(step, &mut place, command);
        }
        self.cyclic = place;
    }

    /// Executes one statement of the motion task: of the routine of a trigger first, or brakes for a stop.
    pub fn step_motion(&mut self, command: &Image) {
        let code = self.code;
        let mut place = core::mem::take(&mut self.motion);
        if place.is_stopped {
            if self.arm.brake(self.braking)
                && let Some((exit, depth)) = place.guard.take()
            {
                place.returns.truncate(depth);
                (place.step, place.is_stopped, place.held_until) = (exit, false, None);
            }
        } else if self.arm.triggers > 0 {
            self.arm.triggers -= 1;
            let mut routine = TaskPlace::default();
            for step in code.on_trigger.iter().filter(|step| !matches!(step, FormStep::Return)) {
                self.execute(step, &mut routine, command);
            }
        } else if let Some(step) = code.motion.get(place.step) {
            self.execute(step, &mut place, command);
        }
        self.motion = place;
    }

    fn execute(&mut self, step: &FormStep, place: &mut TaskPlace, command: &Image) {
        let mut next = place.step + 1;
        match step {
            FormStep::Read(into, field) => self.values[*into] = self.number(command, field),
            FormStep::Write(field, value) => {
                let number = self.evaluate(value);
                self.write(field, number);
            }
            FormStep::Set(name, value) => {
                let to = self.evaluate(value);
                let rises = *name == self.code.stop && to != 0 && self.values[*name] == 0;
                self.values[*name] = to;
                // Only an edge acts, and only while the guard is armed. `stop` is set by the cyclic task.
                self.motion.is_stopped |= rises && self.motion.guard.is_some();
            }
            FormStep::JumpUnless(value, target) if self.evaluate(value) == 0 => next = *target,
            FormStep::JumpUnless(..) | FormStep::Yield | FormStep::Outputs | FormStep::Pose => {}
            FormStep::Jump(target) => next = *target,
            FormStep::Call(target) => {
                place.returns.push(next);
                next = *target;
            }
            FormStep::Return => next = place.returns.pop().unwrap_or(0),
            FormStep::Guard { exit } => place.guard = Some((*exit, place.returns.len())),
            FormStep::EndGuard => place.guard = None,
            FormStep::Move(driven, trigger) => {
                let number = self.values[self.code.asked_number] as u16;
                let registers = [self.registers()];
                let motions = match driven {
                    Driven::Registers => &registers[..],
                    Driven::Stored(motions) => motions,
                };
                if !self.arm.give(number, motions, *trigger) {
                    next = place.step;
                }
            }
            FormStep::Pause if !self.arm.is_done() => next = place.step,
            FormStep::Pause => {}
            FormStep::Hold(ms) => {
                let until = *place.held_until.get_or_insert(self.now + u64::from(*ms));
                if self.now < until {
                    next = place.step;
                } else {
                    place.held_until = None;
                }
            }
            FormStep::Restart(watch) => self.watches[*watch as usize] = (self.adapter.clock_ms)(self.now),
            FormStep::Speed(name) => self.arm.speed = self.values[*name],
        }
        place.step = next;
    }

    /// Returns the registers as the motion uses them: only those of its kind.
    fn registers(&self) -> [u32; COUNT] {
        let mut registers = self.code.registers.map(|register| self.values[register] as u32);
        if registers[16] == 4 {
            registers[9..13].fill(0);
        } else {
            registers[6..9].fill(0);
        }
        registers
    }

    fn number(&self, image: &Image, field: &Field) -> i64 {
        let bytes = image.get(field.at..field.at + field.len).unwrap_or(&[]);
        // A controller's signals are of the least significant byte first; its adapter swaps them.
        let raw = bytes.iter().rev().fold(0, |sum: u32, byte: &u8| sum << 8 | u32::from(*byte));
        let number = i64::from(self.adapter.in_order(self.order, field.len, raw));
        if self.code.has_sign && field.len == 4 { i64::from(number as i32) } else { number }
    }

    fn write(&mut self, field: &Field, number: i64) {
        let bytes = self.adapter.in_order(self.order, field.len, number as u32).to_le_bytes();
        let Some(bytes) = bytes.get(..field.len) else { return };
        for (place, byte) in self.image.iter_mut().skip(field.at).zip(bytes) {
            *place = *byte;
        }
    }

    /// Returns the reading of a stopwatch in ms.
    fn since(&self, watch: usize) -> u64 {
        (self.adapter.clock_ms)(self.now).saturating_sub(self.watches[watch])
    }

    fn evaluate(&self, value: &Value) -> i64 {
        match value {
            Value::Number(number) => *number,
            Value::Variable(index) => self.values[*index],
            Value::Not(inner) => (self.evaluate(inner) == 0).into(),
            Value::AtRest => self.arm.is_at_rest().into(),
            Value::DrivesOn => 1,
            Value::Expired(WatchTimer::Life) => (self.since(0) > LIFE_MS).into(),
            Value::Expired(WatchTimer::Count) => (self.since(1) >= self.cycle_ms).into(),
            Value::NotFinite(index) => (self.adapter.is_not_finite)(self.values[*index] as u32).into(),
            Value::Passes(test) => self.adapter.passes(self.order, *test).into(),
            Value::Reach => u16::from((self.reach)(&self.registers())).into(),
            Value::Pair(operation, operands) => {
                let [one, other] = &**operands;
                operate(*operation, self.evaluate(one), self.evaluate(other))
            }
        }
    }
}

fn operate(operation: FormOperation, one: i64, other: i64) -> i64 {
    match operation {
        FormOperation::Add => one.saturating_add(other),
        FormOperation::Subtract => one.saturating_sub(other),
        FormOperation::Divide => one.checked_div(other).unwrap_or(0),
        FormOperation::Modulo => one.checked_rem(other).unwrap_or(0),
        FormOperation::BitAnd => one & other,
        FormOperation::BitXor => one ^ other,
        FormOperation::Equal => (one == other).into(),
        FormOperation::Unequal => (one != other).into(),
        FormOperation::Less => (one < other).into(),
        FormOperation::Greater => (one > other).into(),
        FormOperation::And => (one != 0 && other != 0).into(),
        FormOperation::Or => (one != 0 || other != 0).into(),
    }
}
