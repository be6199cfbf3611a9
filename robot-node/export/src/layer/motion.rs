//! The task that moves the arm: takes a command, checks it, asks, and turns slots into motions.

use super::words::{
    above, both, call, differ, either, first_of, has, is, is_not, less, minus, not, number, plus, read, same,
    set, truth, value, when,
};
use super::{Flaw, ServedSkills, grant, program_name, request, trigger};
use crate::ErrorNumber;
use crate::form::{Driven, Expression, FormOperation, Routine, Statement};
use crate::registers::{COUNT, REGISTERS, slot_field};

/// `EXECUTE` in the control word.
const EXECUTE: i64 = 2;

/// Slots of the image.
const SLOTS: i64 = 5;

/// Ways in which a skill ends.
pub(super) mod outcome {
    /// As commanded.
    pub(crate) const DONE: i64 = 1;
    /// By a stop.
    pub(crate) const STOPPED: i64 = 2;
    /// By an error of a motion.
    pub(crate) const ERROR: i64 = 3;
}

/// An error number as the layer counts.
pub(super) fn error(error: ErrorNumber) -> Expression {
    number(u16::from(error).into())
}

fn routine(name: &str, purpose: &'static str, body: Vec<Statement>) -> Routine {
    Routine { name: name.into(), purpose, body }
}

/// Returns the routines of the task, the one that runs first.
pub(super) fn routines(served: &ServedSkills, flaw: Option<Flaw>) -> Vec<Routine> {
    vec![
        routine("main", "Takes commands and executes them, for ever.", main()),
        routine("take", "Reads a command until two readings of its number and of EXECUTE agree.", take(flaw)),
        routine("check", "Checks a command and all motions that are written with it.", check(served, flaw)),
        routine("ask", "Asks the cyclic task whether the command may start, or refuses it.", ask()),
        routine("answered", "Waits for the answer of the cyclic task.", answered()),
        routine("perform", "Executes the skill; abandoned by a stop.", perform(served, flaw)),
        routine("stream", "Turns slots into motions, as they are written.", stream(flaw)),
        routine("look", "Reads how many motions are written, and the next one.", look(flaw)),
        routine("load", "Reads the slot into the registers.", load()),
        routine("arrive", "Waits until the arm has executed all motions that were taken.", arrive()),
    ]
}

fn main() -> Vec<Statement> {
    let is_new = both(pair_bits_set("control"), differ("number", "last"));
    let started = vec![
        set("outcome", number(outcome::STOPPED)),
        Statement::Guarded("perform".into()),
        // A stop may have come while outputs were being switched: the answer to that must not take this request away.
        call("answered"),
        set("request", number(request::END)),
        call("answered"),
    ];
    let execute = vec![
        call("check"),
        call("ask"),
        when(is_not("answer", grant::LATER), vec![set("last", value("number"))]),
        when(is("answer", grant::YES), started),
    ];
    // The first number of a connection is an old one. The cyclic task reads it, before it can show `Ready`.
    let steps = vec![
        when(
            differ("link", "seen_link"),
            vec![set("seen_link", value("link")), set("last", value("old_number"))],
        ),
        when(is_new, execute),
    ];
    let cycle = vec![
        Statement::Pause,
        set("link", value("links")),
        when(is_not("link", 0), [vec![call("take")], steps].concat()),
    ];
    // Nothing moves before the self-test has passed.
    vec![Statement::While(is_not("test", 0), vec![Statement::Pause]), Statement::Loop(cycle)]
}

fn pair_bits_set(name: &'static str) -> Expression {
    has(name, EXECUTE)
}

fn take(flaw: Option<Flaw>) -> Vec<Statement> {
    let head = vec![
        read("skill", "skill"),
        read("total", "total"),
        read("written", "written"),
        read("program", "program"),
        read("start_low", "start_1"),
        read("start_high", "start_2"),
    ];
    if flaw == Some(Flaw::SingleRead) {
        return [head, vec![read("number", "number"), read("control", "control")]].concat();
    }
    let once = [
        vec![read("number", "number"), read("control", "control")],
        head,
        vec![read("number_again", "number"), read("control_again", "control")],
    ]
    .concat();
    let execute = |name| super::words::bits(name, EXECUTE);
    let agree = super::words::pair(FormOperation::Equal, execute("control"), execute("control_again"));
    vec![Statement::Repeat(once, both(same("number", "number_again"), agree))]
}

fn check(served: &ServedSkills, flaw: Option<Flaw>) -> Vec<Statement> {
    let fault = |condition, number| (condition, vec![set("error", error(number))]);
    let is_one = |name| super::words::pair(FormOperation::Unequal, value(name), number(1));
    let programs = served.programs.iter().map(|(number, _)| is("program", (*number).into()));
    let known = programs.reduce(either).unwrap_or_else(|| truth(false));
    let is_single = both(above(value("skill"), number(0)), less(value("skill"), number(7)));
    let of_skill = vec![
        (is("skill", 17), vec![when(not(known), vec![set("error", error(ErrorNumber::UnknownProgram))])]),
        (
            is_single,
            first_of(
                vec![fault(either(is_one("total"), is_one("written")), ErrorNumber::NotOneMotion)],
                vec![set("depth", number(1))],
            ),
        ),
        (
            is("skill", 16),
            first_of(
                vec![
                    // A count beyond 2^31 is negative where numbers have a sign.
                    fault(less(value("total"), number(1)), ErrorNumber::NoMotions),
                    fault(above(value("written"), number(SLOTS)), ErrorNumber::QueueOverrun),
                    fault(above(value("written"), value("total")), ErrorNumber::QueueOverrun),
                    fault(less(value("written"), number(0)), ErrorNumber::QueueOverrun),
                ],
                vec![set("depth", value("written"))],
            ),
        ),
    ];
    let starts_later = either(is_not("start_low", 0), is_not("start_high", 0));
    let judged = vec![
        set("slot", value("index")),
        call("load"),
        call("judge"),
        Statement::If(
            is("error", 0),
            vec![set("index", plus(value("index"), 1))],
            vec![set("error_motion", value("index"))],
        ),
    ];
    let mut body = vec![set("error", number(0)), set("error_motion", number(0)), set("depth", number(0))];
    let otherwise = first_of(of_skill, vec![set("error", error(ErrorNumber::UnknownSkill))]);
    body.extend(first_of(vec![fault(starts_later, ErrorNumber::NotServed)], otherwise));
    body.push(set("index", number(0)));
    let more = both(less(value("index"), value("depth")), is("error", 0));
    body.push(Statement::While(more, judged));
    if flaw != Some(Flaw::SingleRead) {
        body.push(read("number_again", "number"));
    } else {
        body.push(set("number_again", value("number")));
    }
    body
}

fn ask() -> Vec<Statement> {
    // The slots belong to another command by now: look again.
    vec![Statement::If(
        differ("number", "number_again"),
        vec![set("answer", number(grant::LATER))],
        vec![
            set("asked_number", value("number")),
            set("executed", number(0)),
            set("accepted", number(0)),
            set("late", number(0)),
            Statement::If(
                is("error", 0),
                vec![set("request", number(request::START))],
                vec![set("request", number(request::REFUSE))],
            ),
            call("answered"),
            set("answer", value("granted")),
        ],
    )]
}

fn answered() -> Vec<Statement> {
    vec![Statement::While(is_not("request", 0), vec![Statement::Pause])]
}

fn perform(served: &ServedSkills, flaw: Option<Flaw>) -> Vec<Statement> {
    let programs = served
        .programs
        .iter()
        .map(|(number, _)| when(is("program", (*number).into()), vec![call(&program_name(*number))]));
    let executed = vec![
        Statement::If(is("skill", 17), programs.collect(), vec![call("stream")]),
        Statement::If(
            is("error", 0),
            vec![set("outcome", number(outcome::DONE))],
            vec![set("outcome", number(outcome::ERROR))],
        ),
    ];
    // The guard acts when `stop` rises: one that rose before is looked for here.
    let body =
        if flaw == Some(Flaw::GuardByEdgeOnly) { executed } else { vec![when(not(value("stop")), executed)] };
    [body, vec![Statement::EndGuard]].concat()
}

fn stream(flaw: Option<Flaw>) -> Vec<Statement> {
    let mut given = vec![
        Statement::Move(Driven::Registers, trigger(flaw)),
        set("taken", plus(value("taken"), 1)),
        set("accepted", value("taken")),
    ];
    if flaw == Some(Flaw::CountWhenGiven) {
        given.push(set("executed", plus(value("executed"), 1)));
    }
    let taken =
        vec![call("judge"), Statement::If(is("error", 0), given, vec![set("error_motion", value("taken"))])];
    // The arm has executed everything and the next motion is not there: if the last one was to be blended, it was not.
    let starved =
        both(both(same("executed", "taken"), differ("taken", "counted_late")), is_not("approximation", 0));
    let waits = vec![
        when(starved, vec![set("late", plus(value("late"), 1)), set("counted_late", value("taken"))]),
        Statement::Yield,
    ];
    let owns = both(above(value("written"), value("taken")), same("number_again", "asked_number"));
    let step = vec![call("look"), when(is("error", 0), vec![Statement::If(owns, taken, waits)])];
    vec![
        set("taken", number(0)),
        set("counted_late", number(0)),
        set("last_written", number(0)),
        set("approximation", number(0)),
        Statement::While(both(less(value("taken"), value("total")), is("error", 0)), step),
        call("arrive"),
    ]
}

fn look(flaw: Option<Flaw>) -> Vec<Statement> {
    let slot = set("slot", super::words::pair(FormOperation::Modulo, value("taken"), number(SLOTS)));
    let written = vec![
        read("written", "written"),
        // A `written` of another command says nothing of this one.
        read("number_again", "number"),
    ];
    let ahead = above(minus(value("written"), value("executed")), number(SLOTS));
    let wrong = either(
        less(value("written"), value("last_written")),
        either(above(value("written"), value("total")), ahead),
    );
    let judged = first_of(
        vec![(
            wrong,
            vec![set("error", error(ErrorNumber::QueueOverrun)), set("error_motion", value("taken"))],
        )],
        vec![set("last_written", value("written"))],
    );
    let own = same("number_again", "asked_number");
    // The slots are read after `written`, and the number after the slots: all of them are of this command then.
    if flaw == Some(Flaw::SlotBeforeWritten) {
        return [vec![slot, call("load")], written, vec![when(own, judged)]].concat();
    }
    let loaded = vec![slot, call("load"), read("number_again", "number")];
    let next = when(both(above(value("written"), value("taken")), is("error", 0)), loaded);
    [written, vec![when(own, [judged, vec![next]].concat())]].concat()
}

fn load() -> Vec<Statement> {
    let slot =
        |slot| (0..COUNT).map(move |at| Statement::Read(REGISTERS[at].0, slot_field(slot, at))).collect();
    let arms = (0..4).map(|at| (is("slot", at as i64), slot(at))).collect();
    first_of(arms, slot(4))
}

fn arrive() -> Vec<Statement> {
    vec![Statement::While(less(value("executed"), value("taken")), vec![Statement::Pause])]
}
