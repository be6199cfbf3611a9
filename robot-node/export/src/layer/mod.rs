//! The second layer of the paper, written once in the intermediate form: what a robot does with the process image.
//!
//! The cyclic task alone writes the image and owns the state, so that nothing moves after it has shown a halt. The motion task reads
//! commands and slots and asks the cyclic task before it moves, and after it:
//!
//! ```text
//! motion   command read twice ── start? ──┐            ┌── slots → motions ── end ──┐
//! cyclic   life, control, … status, echo  └─ granted ──┘  executed, HALT → stop     └─ DONE, ABORTED, ERROR
//! ```

mod cyclic;
mod judge;
mod motion;
mod self_test;
mod words;

use std::collections::BTreeSet;

use protocol::image::Motion;

use crate::form::{Declaration, Driven, Field, Kit, Routine, Statement, Trigger};
use crate::registers::REGISTERS;
pub use self_test::REALS;
use words::{call, number, set, value};

/// Digits of the requests that the motion task makes to the cyclic task.
pub(crate) mod request {
    /// May the command start?
    pub(crate) const START: i64 = 1;
    /// Refuse the command with this error.
    pub(crate) const REFUSE: i64 = 2;
    /// The skill has ended.
    pub(crate) const END: i64 = 3;
    /// Switch outputs.
    pub(crate) const SWITCH: i64 = 4;
}

/// Answers of the cyclic task.
pub(crate) mod grant {
    /// Refused, and the refusal is in the image.
    pub(crate) const NO: i64 = 0;
    /// Granted.
    pub(crate) const YES: i64 = 1;
    /// The command is not in the image any more, or must wait: look again.
    pub(crate) const LATER: i64 = 2;
}

/// A part of a stored program.
#[derive(Clone, PartialEq, Debug)]
pub enum ProgramPart {
    /// Consecutive motions that the language gives as one: a motion, or the pieces of one spline.
    Motions(Vec<Motion>),
    /// A stop that switches outputs and waits.
    Switch {
        /// Bits to switch.
        mask: u16,
        /// They are set, or else cleared.
        on: bool,
        /// Wait after it in ms.
        wait_ms: u32,
    },
}

/// Skills and options that a robot and its language serve.
#[derive(Clone, PartialEq, Debug)]
pub struct ServedSkills {
    /// Single splines, and splines of stored programs.
    pub splines: bool,
    /// The configuration of a PTP.
    pub configurations: bool,
    /// A deceleration other than the acceleration.
    pub decelerations: bool,
    /// Highest path velocity in 0.1 mm/s.
    pub velocity: u16,
    /// Highest path acceleration in mm/s².
    pub acceleration: u16,
    /// Numbers of the tools that are defined.
    pub tools: BTreeSet<u8>,
    /// Numbers of the bases that are defined.
    pub bases: BTreeSet<u8>,
    /// Programs by number.
    pub programs: Vec<(u16, Vec<ProgramPart>)>,
}

/// A mistake in the second layer, for tests that must find it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Flaw {
    /// The command number and `EXECUTE` are read once.
    SingleRead,
    /// The slot is read before `written`.
    SlotBeforeWritten,
    /// A motion counts when its path begins.
    CountAtBegin,
    /// A motion counts when the interpolator gets it.
    CountWhenGiven,
    /// The guard is not looked at after it is armed, as if it acted on a level.
    GuardByEdgeOnly,
    /// The cyclic task grants a start without looking whether the command is still in the image.
    GrantUnseen,
    /// The cyclic task reads the control bits of a start without reading the number again, so they may be those of the next command.
    ControlOfNext,
    /// The command number is written before the flags of the last command are cleared.
    NumberBeforeFlags,
    /// The life counter is read after the control bits.
    LifeAfterControl,
}

/// Builds the second layer, with a flaw for tests.
#[must_use]
pub fn kit(served: &ServedSkills, flaw: Option<Flaw>) -> Kit {
    let count = vec![set("executed", words::plus(value("executed"), 1))];
    let on_trigger = Routine {
        name: "moved".into(),
        purpose: "Counts an executed motion; called by the trigger of its path.",
        body: if flaw == Some(Flaw::CountWhenGiven) { Vec::new() } else { count },
    };
    let mut motion = motion::routines(served, flaw);
    motion.push(judge::routine(served));
    motion.extend(served.programs.iter().map(|(number, parts)| program(*number, parts, flaw)));
    let mut cyclic = cyclic::routines(flaw);
    cyclic.push(self_test::routine());
    let variables = variables();
    Kit { motion, on_trigger, cyclic, variables }
}

/// Returns the trigger of motions.
fn trigger(flaw: Option<Flaw>) -> Trigger {
    if flaw == Some(Flaw::CountAtBegin) { Trigger::Begin } else { Trigger::End }
}

/// Returns the name of the routine of a stored program.
fn program_name(number: u16) -> String {
    format!("program_{number}")
}

/// Writes a stored program.
fn program(program_number: u16, parts: &[ProgramPart], flaw: Option<Flaw>) -> Routine {
    let mut body = Vec::new();
    let mut given = 0;
    for part in parts {
        match part {
            ProgramPart::Motions(motions) => {
                given += i64::try_from(motions.len()).unwrap_or(i64::MAX);
                let driven = motions.iter().map(crate::registers::registers).collect();
                body.push(Statement::Move(Driven::Stored(driven), trigger(flaw)));
            }
            ProgramPart::Switch { mask, on, wait_ms } => {
                body.extend([
                    set("taken", number(given)),
                    call("arrive"),
                    set("switch_mask", number((*mask).into())),
                    set("switch_on", crate::form::Expression::Truth(*on)),
                    set("request", number(request::SWITCH)),
                    call("answered"),
                    Statement::Hold(*wait_ms),
                ]);
            }
        }
    }
    body.extend([set("taken", number(given)), call("arrive")]);
    Routine { name: program_name(program_number), purpose: "A stored program of the plan.", body }
}

/// Returns all variables with their first values.
fn variables() -> Vec<Declaration> {
    const NUMBERS: [&str; 46] = [
        "number",
        "number_again",
        "last",
        "control",
        "control_again",
        "skill",
        "total",
        "written",
        "program",
        "start_low",
        "start_high",
        "link",
        "seen_link",
        "links",
        "error",
        "error_motion",
        "depth",
        "index",
        "slot",
        "taken",
        "accepted",
        "executed",
        "late",
        "counted_late",
        "last_written",
        "request",
        "answer",
        "granted",
        "asked_number",
        "outcome",
        "switch_mask",
        "flags",
        "state",
        "shown_error",
        "shown_motion",
        "life",
        "last_life",
        "count",
        "override",
        "speed",
        "now",
        "seen_number",
        "seen_control",
        "outputs",
        "plc_outputs",
        "changed",
    ];
    const MORE: [&str; 8] =
        ["why", "stopping", "plc_last", "status_word", "shown_number", "seen_again", "old_number", "test"];
    const TRUTHS: [&str; 9] = [
        "stop",
        "switch_on",
        "connected",
        "enabled",
        "armed",
        "warned",
        "resting",
        "outputs_known",
        "defined",
    ];
    let numbers = NUMBERS.into_iter().chain(MORE).chain(REGISTERS.map(|(name, ..)| name));
    let first = |name| match name {
        "speed" => 100,
        // Until the self-test has passed.
        "test" => 1,
        _ => 0,
    };
    let numbers = numbers.map(|name| Declaration { name, number: Some(first(name)) });
    numbers.chain(TRUTHS.map(|name| Declaration { name, number: None })).collect()
}

/// Returns the signals of both images, inputs first: all that the second layer and the printers use.
#[must_use]
pub fn fields(kit: &Kit) -> (Vec<Field>, Vec<Field>) {
    let (mut inputs, mut outputs) = (Vec::<Field>::new(), Vec::<Field>::new());
    for routine in kit.motion.iter().chain(&kit.cyclic) {
        crate::form::walk(&routine.body, &mut |statement| {
            let (list, field) = match statement {
                Statement::Read(_, field) => (&mut inputs, field),
                Statement::Write(field, _) => (&mut outputs, field),
                _ => return,
            };
            if !list.contains(field) {
                list.push(field.clone());
            }
        });
    }
    outputs.extend(words::pose_fields());
    for list in [&mut inputs, &mut outputs] {
        list.sort_by_key(|field| (field.at, field.len));
    }
    (inputs, outputs)
}
