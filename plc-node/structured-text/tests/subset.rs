//! What the checker refuses, where execution traps, and that no text makes either panic.
#![expect(clippy::panic, clippy::unwrap_used, reason = "a test that cannot go on stops")]

use proptest::prelude::*;
use structured_text::{Program, Source, Trap};

fn compile(text: &str) -> Result<Program, String> {
    Program::compile(&[Source { file: "t.st", text }]).map_err(|mistake| mistake.to_string())
}

/// Makes a block with some variables of this body.
fn block(body: &str) -> String {
    format!(
        "FUNCTION One : UINT VAR_INPUT amount : UINT; END_VAR One := amount; END_FUNCTION\n\
         FUNCTION_BLOCK Inner VAR_INPUT a : UINT; END_VAR VAR_IN_OUT b : UINT; END_VAR VAR_OUTPUT c : UINT; END_VAR \
         b := a; c := b; END_FUNCTION_BLOCK\n\
         FUNCTION_BLOCK Outer VAR_INPUT i : UINT; END_VAR VAR_OUTPUT x : UINT; END_VAR VAR CONSTANT k : UINT := 7; END_VAR VAR \
         n : DINT; s : USINT; r : REAL; d : DWORD; no : BOOL; kid : Inner; many : ARRAY[1..3] OF UINT := [10, 2(20)]; END_VAR\n\
         {body}\nEND_FUNCTION_BLOCK"
    )
}

/// Runs a body once; returns x, or the trap.
fn run(body: &str) -> Result<i64, Trap> {
    let program = compile(&block(body)).unwrap_or_else(|mistake| panic!("{body}: {mistake}"));
    let mut instance = program.instance("Outer").unwrap();
    let x = program.variable("Outer", "x").unwrap();
    instance.scan(&program, 10_000).map_err(|error| error.trap)?;
    Ok(instance.get(x, 0))
}

#[test]
fn what_a_plc_would_do_silently_is_a_trap() {
    for (body, trap) in [
        ("x := 65535; x := x + UINT#1;", Trap::Overflow),
        ("x := x - UINT#1;", Trap::Overflow),
        ("n := 300; s := DINT_TO_USINT(n);", Trap::Narrowing),
        ("n := 4; x := many[n];", Trap::Index),
        ("x := many[0];", Trap::Index),
        ("FOR n := 2 TO 4 DO IF many[n] <> UINT#20 THEN x := 1; END_IF; END_FOR;", Trap::Index),
        ("FOR n := 0 TO 3 DO IF many[n] <> UINT#20 THEN x := 1; END_IF; END_FOR;", Trap::Index),
        ("x := UINT#1 / x;", Trap::DivisionByZero),
        ("x := UINT#1 MOD x;", Trap::DivisionByZero),
        ("r := REAL#1.0 / r;", Trap::NotFinite),
        ("WHILE TRUE DO END_WHILE;", Trap::Steps),
        ("REPEAT x := 1; UNTIL FALSE END_REPEAT;", Trap::Steps),
        ("FOR s := 0 TO 255 DO x := 1; END_FOR;", Trap::Overflow),
        ("FOR n := 0 TO 3 BY 0 DO x := 1; END_FOR;", Trap::StepOfZero),
        ("r := REAL#3.0E38; n := REAL_TO_DINT(r);", Trap::Narrowing),
    ] {
        assert_eq!(run(body), Err(trap), "{body}");
    }
}

#[test]
fn statements_and_operators_compute_what_the_standard_says() {
    for (body, x) in [
        ("x := UINT#2 + UINT#3 * UINT#4;", 14),
        ("x := (UINT#2 + UINT#3) * UINT#4 MOD UINT#7;", 6),
        ("IF NOT (TRUE AND FALSE OR TRUE XOR TRUE) THEN x := 1; ELSIF TRUE THEN x := 2; END_IF;", 1),
        ("FOR n := 1 TO 3 DO x := x + many[n]; END_FOR;", 50),
        ("n := -2; CASE n OF 1: x := 1; -2: x := 2; END_CASE; (* * (* *)", 2),
        ("FOR n := 3 TO 1 BY -1 DO x := x * UINT#10 + many[n] / UINT#10; END_FOR;", 221),
        ("FOR n := 1 TO 3 DO IF n = 2 THEN EXIT; END_IF; x := x + UINT#1; END_FOR;", 1),
        ("CASE k OF 1, 2: x := 1; 7: x := 7; ELSE x := 9; END_CASE;", 7),
        ("kid(a := k, b := x); x := x + kid.c;", 14),
        ("x := One(One(3) + One(amount := UINT#4));", 7),
        ("d := SHL(DWORD#16#F0000000, 4) OR SHR(DWORD#16#F0, 4); x := DWORD_TO_UINT(d);", 15),
        ("n := -7; x := DINT_TO_UINT(ABS(n / DINT#2) * DINT#10 - n MOD DINT#2);", 31),
        ("r := REAL#2.5; x := REAL_TO_UINT(r) * UINT#10 + REAL_TO_UINT(r + REAL#1.0);", 24),
        ("x := 5; RETURN; x := 6;", 5),
        // Loops that search: what they find, and where the variable stands afterwards.
        ("FOR n := 1 TO 3 DO IF many[n] <> UINT#10 THEN x := DINT_TO_UINT(n); EXIT; END_IF; END_FOR;", 2),
        (
            "FOR n := 2 TO 3 DO IF many[n] <> UINT#20 THEN x := 9; END_IF; END_FOR; x := x + DINT_TO_UINT(n);",
            4,
        ),
        (
            "FOR n := 1 TO 3 DO IF many[n] <> many[n] THEN x := 9; END_IF; END_FOR; x := x + DINT_TO_UINT(n);",
            4,
        ),
        (
            "FOR n := 3 TO 1 DO IF many[n] <> UINT#20 THEN x := 9; END_IF; END_FOR; x := x + DINT_TO_UINT(n);",
            3,
        ),
        ("FOR n := 1 TO 3 DO IF many[n] <> UINT#20 THEN x := x + UINT#1; END_IF; END_FOR;", 1),
    ] {
        assert_eq!(run(body), Ok(x), "{body}");
    }
}

#[test]
fn the_checker_refuses_what_makers_treat_differently_and_names_the_place() {
    for (body, expected) in [
        ("x := n;", "t.st:4:6: expected UINT, found DINT; convert it explicitly"),
        ("x := 70000;", "t.st:4:6: 70000 is outside UINT"),
        ("x := no + x;", "t.st:4:11: expected BOOL, found UINT; convert it explicitly"),
        ("no := 1 = 2;", "t.st:4:11: literal without a type; write it as `UDINT#5`"),
        ("i := 1;", "t.st:4:1: input `i` cannot be assigned"),
        ("k := 1;", "t.st:4:1: constant `k` cannot be assigned"),
        ("kid.c := 1;", "t.st:4:1: outputs of instance `kid` cannot be assigned"),
        ("kid(a := 1);", "t.st:4:1: call of `Inner` without IN_OUT `b`"),
        ("kid(a := 1, b := i);", "t.st:4:18: input `i` cannot be assigned"),
        ("x := kid.b;", "t.st:4:10: `Inner` has no member or output `b`"),
        ("y := 1;", "t.st:4:1: `y` is not declared"),
        ("x := Two(1);", "t.st:4:6: function `Two` not declared before its use"),
        ("r := DWORD_TO_REAL(d);", "t.st:4:20: DWORD_TO_REAL: makers differ in it, or it is needless"),
        ("no := d < d;", "t.st:4:9: `<` does not apply to DWORD"),
        ("EXIT;", "t.st:4:1: EXIT outside a loop"),
        ("IF x THEN x := 1; END_IF;", "t.st:4:4: expected BOOL, found UINT; convert it explicitly"),
        ("x := 1", "t.st:5:1: `END_FUNCTION_BLOCK`: expected `;`"),
        ("CASE x OF 1: x := 1; 1: x := 2; END_CASE;", "t.st:4:22: label 1 is there twice"),
    ] {
        assert_eq!(compile(&block(body)).err().as_deref(), Some(expected), "{body}");
    }
}

#[test]
fn names_of_the_language_and_second_declarations_are_refused() {
    for text in [
        "FUNCTION_BLOCK limit END_FUNCTION_BLOCK",
        "FUNCTION_BLOCK A VAR word : BOOL; END_VAR END_FUNCTION_BLOCK",
        "FUNCTION_BLOCK A VAR b, B : BOOL; END_VAR END_FUNCTION_BLOCK",
        "FUNCTION_BLOCK A END_FUNCTION_BLOCK FUNCTION_BLOCK a END_FUNCTION_BLOCK",
        "TYPE A : ARRAY[0..2] OF A; END_TYPE",
        "TYPE A : ARRAY[0..2000000000] OF BOOL; END_TYPE",
        "TYPE A : ARRAY[3..2] OF BOOL; END_TYPE",
        "FUNCTION A : BOOL A := A(); END_FUNCTION",
        "FUNCTION_BLOCK A VAR on : BOOL; END_VAR END_FUNCTION_BLOCK",
        "FUNCTION_BLOCK ctud END_FUNCTION_BLOCK",
        "(*) FUNCTION_BLOCK A END_FUNCTION_BLOCK",
    ] {
        assert!(compile(text).is_err(), "{text}");
    }
}

#[test]
fn deep_nesting_is_refused_and_overflows_no_stack() {
    let deep = |open: &str, close: &str, times: usize| {
        format!("no := {}TRUE{};", open.repeat(times), close.repeat(times))
    };
    for body in [
        deep("(", ")", 100_000),
        deep("NOT ", "", 100_000),
        format!("no := TRUE{};", " AND TRUE".repeat(100_000)),
    ] {
        assert!(compile(&block(&body)).is_err());
    }
    let ifs = format!("{}x := 1;{}", "IF TRUE THEN ".repeat(100_000), " END_IF;".repeat(100_000));
    assert!(compile(&block(&ifs)).is_err());
}

/// Words and signs that programs are made of.
const PIECES: [&str; 44] = [
    "TYPE",
    "END_TYPE",
    "FUNCTION",
    "END_FUNCTION",
    "FUNCTION_BLOCK",
    "END_FUNCTION_BLOCK",
    "VAR",
    "VAR_INPUT",
    "VAR_IN_OUT",
    "END_VAR",
    "STRUCT",
    "END_STRUCT",
    "ARRAY",
    "[",
    "]",
    "..",
    "OF",
    "UINT",
    "BOOL",
    "a",
    "b",
    "A",
    ":",
    ":=",
    ";",
    ",",
    "(",
    ")",
    "IF",
    "THEN",
    "END_IF",
    "FOR",
    "TO",
    "DO",
    "END_FOR",
    "1",
    "UINT#16#FF",
    "2.5",
    "-",
    "AND",
    "NOT",
    "(*",
    "*)",
    ".",
];

proptest! {
    #[test]
    fn no_text_makes_the_checker_panic(text in "\\PC{0,200}") {
        let _ = compile(&text);
        let _ = compile(&block(&text));
    }

    #[test]
    fn no_order_of_words_makes_the_checker_or_the_execution_panic(
        pieces in proptest::collection::vec(proptest::sample::select(&PIECES[..]), 0..80),
    ) {
        let text = pieces.join(" ");
        for text in [text.clone(), block(&text)] {
            if let Ok(program) = compile(&text)
                && let Ok(mut instance) = program.instance("Outer")
            {
                let _ = instance.scan(&program, 1_000);
            }
        }
    }
}
