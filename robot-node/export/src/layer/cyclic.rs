//! The task that exchanges the image: the only one that writes it, and the owner of the state.
//!
//! It reads the life counter before the control bits and echoes it after everything else, so that an echo says: the robot has
//! followed that image, or a later one. What the PLC may read between two writes is never a wrong end: the flags of the last
//! command are cleared before its number changes, counts and errors are there before the flags of an end, and a flag goes before
//! the error that it speaks of.

use super::motion::{error, outcome};
use super::words::{
    above, ask, both, call, differ, either, first_of, has, is, is_not, minus, not, number, pair, plus, read,
    same, set, truth, value, when, write,
};
use super::{Flaw, grant, request};
use crate::ErrorNumber;
use crate::form::{Expression, FormOperation, Routine, Sense, Statement, WatchTimer};

/// Bits of the control word.
mod control {
    pub(super) const ENABLE: i64 = 1;
    pub(super) const EXECUTE: i64 = 2;
    pub(super) const HALT: i64 = 4;
    pub(super) const SUSPEND: i64 = 8;
    pub(super) const RESET: i64 = 32;
    pub(super) const CANCEL: i64 = 64;
}

/// Bits of the status word.
mod status {
    pub(super) const BUSY: i64 = 1;
    pub(super) const DONE: i64 = 2;
    pub(super) const ABORTED: i64 = 4;
    pub(super) const ERROR: i64 = 8;
    pub(super) const AT_REST: i64 = 16;
    pub(super) const ENABLED: i64 = 32;
    pub(super) const WARNING: i64 = 64;
}

/// States of the image.
mod state {
    pub(super) const HALTED: i64 = 0;
    pub(super) const READY: i64 = 1;
    pub(super) const RUNNING: i64 = 2;
}

/// Reasons to stop that are no error numbers.
mod why {
    pub(super) const NOTHING: i64 = 0;
    pub(super) const HALT: i64 = 1000;
    pub(super) const CANCEL: i64 = 1001;
}

fn routine(name: &str, purpose: &'static str, body: Vec<Statement>) -> Routine {
    Routine { name: name.into(), purpose, body }
}

/// Returns the routines of the task, the one that runs first.
pub(super) fn routines(flaw: Option<Flaw>) -> Vec<Routine> {
    vec![
        routine(
            "exchange",
            "Exchanges the image, for ever.",
            vec![call("self_test"), Statement::Loop(vec![call("cycle")])],
        ),
        routine(
            "cycle",
            "Reads the command, follows it, answers the other task and writes the feedback.",
            cycle(flaw),
        ),
        routine("receive", "Reads life counter, control bits, override and outputs.", receive(flaw)),
        routine("follow", "Stops and resets by the control bits.", follow()),
        routine("serve", "Answers the request of the motion task.", serve()),
        routine("start", "Grants or refuses the start of a command.", start(flaw)),
        routine("refuse", "Shows a refused command; a skill that runs goes on.", refuse()),
        routine("overhear", "Refuses a command that comes while a skill runs.", overhear()),
        routine("end", "Notes how the skill ended.", end()),
        routine(
            "open",
            "Shows the number of a new command, after the flags of the last one are gone.",
            open(flaw),
        ),
        routine("warn", "Warns of an override above 100 % while a skill runs.", warn()),
        routine("show", "Writes the feedback, the status word after what it speaks of.", show()),
        routine("show_status", "Writes the status word.", show_status()),
    ]
}

fn cycle(flaw: Option<Flaw>) -> Vec<Statement> {
    let late = flaw == Some(Flaw::LifeAfterControl);
    let tail = if late { vec![read("life", "life")] } else { Vec::new() };
    [
        vec![
            call("receive"),
            call("follow"),
            when(is("state", state::RUNNING), vec![call("overhear")]),
            when(is_not("request", 0), vec![call("serve")]),
            call("warn"),
            call("show"),
        ],
        tail,
        vec![write("echo", value("life"))],
    ]
    .concat()
}

fn receive(flaw: Option<Flaw>) -> Vec<Statement> {
    let life = vec![
        read("life", "life"),
        Statement::If(
            differ("life", "last_life"),
            vec![
                set("last_life", value("life")),
                Statement::Restart(WatchTimer::Life),
                when(
                    not(value("connected")),
                    vec![
                        set("connected", truth(true)),
                        read("old_number", "number"),
                        set("links", plus(value("links"), 1)),
                    ],
                ),
            ],
            vec![when(ask(Sense::Expired(WatchTimer::Life)), vec![set("connected", truth(false))])],
        ),
    ];
    let outputs = vec![
        read("plc_outputs", "outputs"),
        Statement::If(
            both(value("connected"), value("outputs_known")),
            vec![set("changed", pair(FormOperation::BitXor, value("plc_outputs"), value("plc_last")))],
            vec![set("changed", number(0))],
        ),
        set("plc_last", value("plc_outputs")),
        set("outputs_known", value("connected")),
        when(is_not("changed", 0), switch(value("plc_outputs"))),
    ];
    let head = vec![
        read("now", "control"),
        set("enabled", both(value("connected"), both(has("now", control::ENABLE), ask(Sense::DrivesOn)))),
        read("override", "override"),
        when(
            both(
                value("connected"),
                both(not(above(value("override"), number(100))), differ("override", "speed")),
            ),
            vec![set("speed", value("override")), Statement::Speed("speed")],
        ),
    ];
    if flaw == Some(Flaw::LifeAfterControl) {
        return [head[..1].to_vec(), life, head[1..].to_vec(), outputs].concat();
    }
    [life, head, outputs].concat()
}

/// Takes the changed bits of the outputs from a word.
fn switch(from: Expression) -> Vec<Statement> {
    let masked = |word| pair(FormOperation::BitAnd, word, value("changed"));
    let kept = minus(value("outputs"), masked(value("outputs")));
    vec![set("outputs", pair(FormOperation::Add, kept, masked(from))), Statement::Outputs("outputs")]
}

fn follow() -> Vec<Statement> {
    let reason = |condition, reason| (condition, vec![set("why", reason)]);
    let reasons = vec![
        reason(not(value("connected")), error(ErrorNumber::ConnectionLost)),
        reason(not(value("enabled")), error(ErrorNumber::Disabled)),
        reason(has("now", control::HALT), number(why::HALT)),
        reason(has("now", control::SUSPEND), error(ErrorNumber::NotServed)),
        reason(has("now", control::CANCEL), number(why::CANCEL)),
    ];
    // An end that needs a reset takes precedence over one that does not.
    let stops = when(
        is_not("why", why::NOTHING),
        vec![
            when(
                either(is("stopping", why::NOTHING), is("stopping", why::CANCEL)),
                vec![set("stopping", value("why"))],
            ),
            set("stop", truth(true)),
        ],
    );
    let halts = either(
        is("why", why::HALT),
        either(
            is("why", u16::from(ErrorNumber::ConnectionLost).into()),
            is("why", u16::from(ErrorNumber::Disabled).into()),
        ),
    );
    let resets = both(both(has("now", control::RESET), value("armed")), not(is("why", why::HALT)));
    let reset = vec![
        set("armed", truth(false)),
        when(not(is("flags", status::DONE)), vec![set("flags", number(0)), call("show_status")]),
        set("shown_error", number(0)),
        set("shown_motion", number(0)),
        set("state", number(state::READY)),
    ];
    let rests = Statement::If(
        halts,
        vec![set("state", number(state::HALTED))],
        vec![when(both(resets, value("enabled")), reset)],
    );
    let mut body = first_of(reasons, vec![set("why", number(why::NOTHING))]);
    body.push(Statement::If(is("state", state::RUNNING), vec![stops], vec![rests]));
    body.push(when(
        either(not(value("connected")), not(has("now", control::RESET))),
        vec![set("armed", truth(true))],
    ));
    body
}

fn serve() -> Vec<Statement> {
    let outputs = [
        vec![
            set("changed", value("switch_mask")),
            Statement::If(
                value("switch_on"),
                vec![set("plc_outputs", value("switch_mask"))],
                vec![set("plc_outputs", number(0))],
            ),
        ],
        switch(value("plc_outputs")),
    ]
    .concat();
    // The end of a skill after which another command was refused: its flags stay.
    let arms =
        vec![(is("request", request::END), vec![call("end")]), (is("request", request::SWITCH), outputs)];
    [first_of(arms, vec![call("start")]), vec![set("request", number(0))]].concat()
}

fn start(flaw: Option<Flaw>) -> Vec<Statement> {
    let own = || set("shown_number", value("asked_number"));
    let refused = |number| {
        vec![set("shown_error", number), set("shown_motion", super::words::number(0)), own(), call("refuse")]
    };
    // The number is read again: between the two reads the control bits may become those of the next command.
    let mut look = vec![read("seen_number", "number"), read("seen_control", "control")];
    look.push(if flaw == Some(Flaw::ControlOfNext) {
        set("seen_again", value("seen_number"))
    } else {
        read("seen_again", "number")
    });
    let changed = either(differ("seen_number", "asked_number"), differ("seen_again", "seen_number"));
    let gone = either(changed, not(has("seen_control", control::EXECUTE)));
    let later = || vec![set("granted", number(grant::LATER))];
    let stops = either(has("seen_control", control::HALT), has("seen_control", control::CANCEL));
    let runs = vec![
        set("shown_error", number(0)),
        set("shown_motion", number(0)),
        own(),
        call("open"),
        set("stopping", number(why::NOTHING)),
        set("stop", truth(false)),
        set("state", number(state::RUNNING)),
        write("state", value("state")),
        set("flags", number(status::BUSY)),
        call("show_status"),
        set("granted", number(grant::YES)),
    ];
    let suspended =
        either(is("why", u16::from(ErrorNumber::NotServed).into()), has("seen_control", control::SUSPEND));
    let asked = vec![
        (not(is("state", state::READY)), refused(error(ErrorNumber::NotReady))),
        (stops.clone(), later()),
        (suspended, refused(error(ErrorNumber::NotServed))),
        (
            is("request", request::REFUSE),
            vec![
                set("shown_error", value("error")),
                set("shown_motion", value("error_motion")),
                own(),
                call("refuse"),
            ],
        ),
        (above(value("override"), number(100)), refused(error(ErrorNumber::OverrideOutOfRange))),
        // What stops without a bit of its own, such as a lost connection, is followed first.
        (is_not("why", why::NOTHING), later()),
    ];
    let asked = first_of(asked, runs);
    if matches!(flaw, Some(Flaw::GrantUnseen | Flaw::SingleRead)) {
        let copied = vec![set("seen_number", value("asked_number")), set("seen_control", value("now"))];
        return [copied, asked].concat();
    }
    let cancels = has("seen_control", control::CANCEL);
    // Refused already, while the skill before it ran.
    let is_known = same("asked_number", "shown_number");
    let known = (is_known, vec![set("granted", number(grant::NO))]);
    [look, first_of(vec![(gone, later()), (cancels, later()), known], asked)].concat()
}

fn open(flaw: Option<Flaw>) -> Vec<Statement> {
    let number_of = vec![write("number", value("shown_number"))];
    let flags = vec![set("flags", number(0)), call("show_status")];
    let counts = vec![
        write("executed", number(0)),
        write("accepted", number(0)),
        write("late", number(0)),
        write("error", value("shown_error")),
        write("error_motion", value("shown_motion")),
    ];
    if flaw == Some(Flaw::NumberBeforeFlags) {
        return [number_of, flags, counts].concat();
    }
    [flags, counts, number_of].concat()
}

fn refuse() -> Vec<Statement> {
    vec![
        call("open"),
        when(
            is_not("state", state::RUNNING),
            vec![set("state", number(state::HALTED)), write("state", value("state"))],
        ),
        set("flags", number(status::ERROR)),
        call("show_status"),
        set("granted", number(grant::NO)),
    ]
}

fn overhear() -> Vec<Statement> {
    let called = both(has("seen_control", control::EXECUTE), not(has("seen_control", control::CANCEL)));
    let is_new = both(same("seen_number", "seen_again"), differ("seen_number", "shown_number"));
    vec![
        read("seen_number", "number"),
        read("seen_control", "control"),
        read("seen_again", "number"),
        when(
            both(called, is_new),
            vec![
                set("shown_error", error(ErrorNumber::NotReady)),
                set("shown_motion", number(0)),
                set("shown_number", value("seen_number")),
                call("refuse"),
            ],
        ),
    ]
}

fn end() -> Vec<Statement> {
    let ended = |flags: i64, state| {
        let own = same("asked_number", "shown_number");
        vec![set("state", number(state)), when(own, vec![set("flags", number(flags))])]
    };
    let own = |statements| when(same("asked_number", "shown_number"), statements);
    let fault = |number, motion| {
        let figures = own(vec![set("shown_error", number), set("shown_motion", value(motion))]);
        [vec![figures], ended(status::ERROR, state::HALTED)].concat()
    };
    let needs_reset = both(is_not("stopping", why::NOTHING), is_not("stopping", why::CANCEL));
    let done =
        Statement::If(needs_reset, ended(status::DONE, state::HALTED), ended(status::DONE, state::READY));
    let arms = vec![
        (is("outcome", outcome::DONE), vec![done]),
        (is("outcome", outcome::ERROR), fault(value("error"), "error_motion")),
        (is("stopping", why::HALT), ended(status::ABORTED, state::HALTED)),
        (is("stopping", why::CANCEL), ended(status::ABORTED, state::READY)),
    ];
    let warning = when(
        value("warned"),
        vec![set("warned", truth(false)), call("show_status"), own(vec![set("shown_error", number(0))])],
    );
    let after = vec![
        set("stopping", number(why::NOTHING)),
        set("stop", truth(false)),
        set("granted", number(grant::NO)),
    ];
    [vec![warning], first_of(arms, fault(value("stopping"), "executed")), after].concat()
}

fn warn() -> Vec<Statement> {
    let runs = both(is("state", state::RUNNING), same("asked_number", "shown_number"));
    let wrong = both(runs, both(value("connected"), above(value("override"), number(100))));
    let begins = vec![set("warned", truth(true)), set("shown_error", error(ErrorNumber::OverrideOutOfRange))];
    let ends = vec![set("warned", truth(false)), call("show_status"), set("shown_error", number(0))];
    vec![Statement::If(wrong, vec![when(not(value("warned")), begins)], vec![when(value("warned"), ends)])]
}

fn show() -> Vec<Statement> {
    // The counts of the other task are those of the command that it asked for.
    let counts = vec![
        write("executed", value("executed")),
        write("accepted", value("accepted")),
        write("late", value("late")),
    ];
    vec![
        when(same("asked_number", "shown_number"), counts),
        write("error", value("shown_error")),
        write("error_motion", value("shown_motion")),
        write("inputs", value("outputs")),
        write("override", value("speed")),
        Statement::Pose,
        write("state", value("state")),
        call("show_status"),
        when(
            ask(Sense::Expired(WatchTimer::Count)),
            vec![
                Statement::Restart(WatchTimer::Count),
                set("count", bits_of_sum()),
                write("life", value("count")),
            ],
        ),
    ]
}

/// The robot's life counter, one more, in 16 bits.
fn bits_of_sum() -> Expression {
    pair(FormOperation::Modulo, plus(value("count"), 1), number(65_536))
}

fn show_status() -> Vec<Statement> {
    let add = |condition, bit| when(condition, vec![set("status_word", plus(value("status_word"), bit))]);
    vec![
        set("resting", ask(Sense::AtRest)),
        set("status_word", value("flags")),
        add(value("resting"), status::AT_REST),
        add(value("enabled"), status::ENABLED),
        add(value("warned"), status::WARNING),
        write("status", value("status_word")),
    ]
}
