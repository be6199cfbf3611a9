//! Submodules that are plugged while data are exchanged: each gets its parameters, as at startup, or it never gets ready
//! (IEC 61158-6-10, Plug; ControlBlockPlug).
//!
//! ```text
//! device  plug alarm  ──▶          acknowledged as every alarm
//!         ◀── Write ...            the parameter records of this submodule
//!         ◀── PrmEnd               with the number of the alarm
//!         ApplicationReady ──▶     with the same number
//! ```

use alloc::collections::VecDeque;

use super::{Ar, ArPhase};
use crate::alarm::Notification;
use crate::connect::API;
use crate::control::Command;
use crate::rpc::Operation;
use machine::Instant;

/// AlarmType: a submodule was plugged.
const PLUG: u16 = 0x0004;
/// AlarmType: a supervisor released a submodule, which needs its parameters again.
const RELEASED: u16 = 0x0009;
/// Bits 0 to 10 of AlarmSpecifier: the number of the alarm.
const SEQUENCE: u16 = 0x07FF;

/// A submodule that waits for its parameters.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Plugged {
    slot: u16,
    subslot: u16,
    alarm: u16,
}

impl Plugged {
    /// Returns the submodule of an alarm, if it needs its parameters now.
    pub(super) const fn from_alarm(notification: &Notification<'_>) -> Option<Self> {
        let head = &notification.head;
        if !matches!(head.alarm_type, PLUG | RELEASED) || head.api != API {
            return None;
        }
        Some(Self { slot: head.slot, subslot: head.subslot, alarm: notification.specifier & SEQUENCE })
    }

    /// The slot and the subslot.
    const fn place(&self) -> (u16, u16) {
        (self.slot, self.subslot)
    }
}

/// The plugged submodules of an AR, in the order of their alarms.
#[derive(Debug)]
pub(super) struct Plugs {
    waiting: VecDeque<Plugged>,
    /// The first one's next step; `None` until the first call for it.
    step: Option<Step>,
}

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Step {
    /// The parameter record of this index is being written.
    Writing { parameter: usize },
    /// PrmEnd is called.
    Ending,
}

impl Plugs {
    /// Allocates the memory for a device with so many submodules; nothing later allocates.
    pub(super) fn new(submodules: usize) -> Self {
        // Each of them once, and the one that is served once more.
        Self { waiting: VecDeque::with_capacity(submodules + 1), step: None }
    }

    /// Adds one of the device's submodules. If it is plugged again before its turn, its last alarm counts.
    fn add(&mut self, plugged: Plugged) {
        let served = usize::from(self.step.is_some());
        let mut unserved = self.waiting.iter_mut().skip(served);
        match unserved.find(|other| other.place() == plugged.place()) {
            Some(same) => *same = plugged,
            None => self.waiting.push_back(plugged),
        }
    }

    /// Returns whether no submodule waits for its parameters.
    pub(super) fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    pub(super) fn clear(&mut self) {
        self.waiting.clear();
        self.step = None;
    }
}

impl Ar {
    /// A submodule was plugged; one that is not the AR's gets nothing.
    pub(super) fn plugged(&mut self, plugged: Plugged) {
        if self.config.description.submodule(plugged.slot, plugged.subslot).is_some() {
            self.plugs.add(plugged);
        }
    }

    /// Starts with the next plugged submodule, if data are exchanged and the device has its AlarmAck.
    pub(super) fn continue_plug(&mut self, now: Instant) {
        let acknowledged = self.link.as_ref().is_some_and(|link| link.alarms.are_acknowledged());
        let is_free = self.plugs.step.is_none() && !self.awaits_record();
        if self.phase == ArPhase::Exchanging && acknowledged && is_free {
            self.next_plug_step(now, 0);
        }
    }

    /// Takes the next step after an answer to a call for a plugged submodule.
    pub(super) fn plug_answered(&mut self, now: Instant) {
        match self.plugs.step {
            Some(Step::Writing { parameter }) => self.next_plug_step(now, parameter + 1),
            Some(Step::Ending) => {
                self.plugs.step = None;
                self.plugs.waiting.pop_front();
                self.continue_plug(now);
            }
            None => {}
        }
    }

    /// Writes the first record of the plugged submodule from this index on; after the last one, calls PrmEnd.
    fn next_plug_step(&mut self, now: Instant, from: usize) {
        let Some(Plugged { slot, subslot, alarm }) = self.plugs.waiting.front().copied() else { return };
        let mut parameters = self.config.parameters.iter().enumerate().skip(from);
        let next = parameters.find(|(_, parameter)| (parameter.slot, parameter.subslot) == (slot, subslot));
        if let Some((parameter, _)) = next
            && self.call_write(now, parameter).is_ok()
        {
            self.plugs.step = Some(Step::Writing { parameter });
        } else {
            self.plugs.step = Some(Step::Ending);
            self.control(now, Operation::Control, Command::PrmEndPlug { alarm });
        }
    }
}
