//! The arm of the executed form: motions one after another, an advance run, an override, a brake.

use std::collections::VecDeque;

use crate::form::Trigger;
use crate::registers::COUNT;

/// A motion that the arm began.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Begun {
    /// Command number for which it was begun.
    pub number: u16,
    /// Its registers.
    pub registers: [u32; COUNT],
    /// It was executed to its end.
    pub is_complete: bool,
}

/// A motion that waits for its turn, or is under way.
#[derive(Clone, Copy, Debug)]
struct Queued {
    number: u16,
    registers: [u32; COUNT],
    trigger: Trigger,
    has_begun: bool,
}

/// The arm.
#[derive(Clone, Debug)]
pub(super) struct ExecutedArm {
    queue: VecDeque<Queued>,
    /// Motions that the advance run may be ahead of the one under way.
    advance: usize,
    pub(super) begun: Vec<Begun>,
    /// Triggers that fired and whose routine did not run yet.
    pub(super) triggers: usize,
    pub(super) speed: i64,
    /// Steps that the arm still brakes.
    braking: Option<u32>,
}

impl ExecutedArm {
    pub(super) fn new(advance: usize) -> Self {
        Self { queue: VecDeque::new(), advance, begun: Vec::new(), triggers: 0, speed: 100, braking: None }
    }

    /// Gives motions to the interpolator, unless the advance run is as far ahead as it may be.
    pub(super) fn give(&mut self, number: u16, motions: &[[u32; COUNT]], trigger: Trigger) -> bool {
        if self.queue.len() > self.advance {
            return false;
        }
        let queued =
            |registers: &[u32; COUNT]| Queued { number, registers: *registers, trigger, has_begun: false };
        self.queue.extend(motions.iter().map(queued));
        true
    }

    pub(super) fn is_done(&self) -> bool {
        self.queue.is_empty()
    }

    pub(super) fn is_at_rest(&self) -> bool {
        self.braking.is_none() && (self.queue.is_empty() || self.speed == 0)
    }

    /// Brakes for so many steps; returns whether the arm stands and has dropped its motions.
    pub(super) fn brake(&mut self, steps: u32) -> bool {
        match *self.braking.get_or_insert(steps) {
            0 => {
                self.queue.clear();
                // RESUME and RAISE leave routines that were called: a trigger that has fired is lost.
                (self.braking, self.triggers) = (None, 0);
                true
            }
            _ => false,
        }
    }

    /// Drives on: a motion begins, or the one under way ends and the next one begins.
    pub(super) fn drive(&mut self) {
        if let Some(steps) = &mut self.braking {
            *steps = steps.saturating_sub(1);
            return;
        }
        if self.speed == 0 {
            return;
        }
        if let Some(queued) = self.queue.pop_front_if(|queued| queued.has_begun) {
            if let Some(begun) = self.begun.last_mut() {
                begun.is_complete = true;
            }
            self.triggers += usize::from(queued.trigger == Trigger::End);
        }
        if let Some(queued) = self.queue.front_mut() {
            queued.has_begun = true;
            let Queued { number, registers, trigger, .. } = *queued;
            self.triggers += usize::from(trigger == Trigger::Begin);
            self.begun.push(Begun { number, registers, is_complete: false });
        }
    }
}
