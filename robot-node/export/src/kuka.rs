//! The kit in KRL, for KUKA's KR C4 and KR C5: written from documents, not tried on the maker's controller.
//!
//! Signals are read and written in the advance run: `CONTINUE` before a line keeps it from waiting for the arm. The cyclic task
//! runs in the submit interpreter, which has no advance run.

use crate::application::{HEAD, RobotApplication, frame_numbers};
use crate::form::{AdapterTest, Driven, Field, FormOperation, Kit, Routine, Sense, Statement, WatchTimer};
use crate::layer::fields;
use crate::printed::{ExportFile, PrintedLines, Words, real, sign};
use crate::registers::COUNT;

/// First variables of the timers that the code uses.
const TIMERS: [(&str, WatchTimer); 2] =
    [("SB_TIMER_LIFE", WatchTimer::Life), ("SB_TIMER_COUNT", WatchTimer::Count)];

/// The adapter in KRL.
const ADAPTER: &str = include_str!("../templates/kuka-adapter.src");

struct Krl {
    /// The lines run in the robot interpreter, which has an advance run.
    has_advance: bool,
}

impl Words for Krl {
    fn name(&self, name: &str) -> String {
        format!("SB_{}", name.to_uppercase())
    }

    fn sense(&self, sense: Sense) -> String {
        match sense {
            Sense::AtRest => "$ROB_STOPPED".into(),
            Sense::DrivesOn => "$PERI_RDY".into(),
            Sense::Expired(watch) => format!("$TIMER_FLAG[{}]", timer(watch)),
            Sense::NotFinite(name) => format!("SB_NOT_FINITE({})", self.name(name)),
            Sense::Reach => "SB_REACH()".into(),
            Sense::Passes(test) => passes(test),
        }
    }

    fn pair(&self, operation: FormOperation, one: &str, other: &str) -> String {
        match operation {
            FormOperation::Equal => format!("({one}=={other})"),
            FormOperation::Divide => format!("({one}/{other})"),
            // KRL has no remainder.
            FormOperation::Modulo => format!("({one}-({one}/{other})*{other})"),
            FormOperation::BitAnd => format!("({one} B_AND {other})"),
            FormOperation::BitXor => format!("({one} B_EXOR {other})"),
            other_operation => format!("({one} {} {other})", sign(other_operation).unwrap_or("+")),
        }
    }
}

/// Returns a test of the adapter. INT has a sign.
fn passes(test: AdapterTest) -> String {
    let swaps = |function: &str, value: i32, swapped: i32| {
        format!(
            "((SB_SWAP AND ({function}({value})=={swapped})) OR ((NOT SB_SWAP) AND ({function}({value})=={value})))"
        )
    };
    match test {
        AdapterTest::Word(value) => swaps("SB_WORD", value.into(), value.swap_bytes().into()),
        AdapterTest::DoubleWord(value) => {
            swaps("SB_DWORD", value.cast_signed(), value.swap_bytes().cast_signed())
        }
        AdapterTest::BitsOfReal(literal, bits) => format!("(SB_BITS({literal})=={})", bits.cast_signed()),
        AdapterTest::RealOfBits(bits, literal) => format!("(SB_REAL({})=={literal})", bits.cast_signed()),
        AdapterTest::Finite(bits, is_finite) => {
            let not = if is_finite { "NOT " } else { "" };
            format!("({not}SB_NOT_FINITE({}))", bits.cast_signed())
        }
    }
}

fn timer(watch: WatchTimer) -> &'static str {
    TIMERS.iter().find(|(_, known)| *known == watch).map_or("SB_TIMER_LIFE", |(name, _)| name)
}

/// Returns the name of a signal of the inputs.
fn input(field: &Field) -> String {
    format!("SBI_{}", field.name.to_uppercase())
}

/// Returns the name of a signal of the outputs.
fn output(field: &Field) -> String {
    format!("SBO_{}", field.name.to_uppercase())
}

/// Returns the function of the adapter that brings a number of this length into the byte order of the bus, or takes it from there.
const fn swapped(len: usize) -> &'static str {
    match len {
        1 => "",
        2 => "SB_WORD",
        _ => "SB_DWORD",
    }
}

impl Krl {
    fn advance(&self, lines: &mut PrintedLines) {
        if self.has_advance {
            lines.line("CONTINUE");
        }
    }

    fn statements(&self, statements: &[Statement], lines: &mut PrintedLines) {
        statements.iter().for_each(|statement| self.statement(statement, lines));
    }

    fn statement(&self, statement: &Statement, lines: &mut PrintedLines) {
        match statement {
            Statement::Read(into, field) => {
                self.advance(lines);
                lines.line(format!("{}={}({})", self.name(into), swapped(field.len), input(field)));
            }
            Statement::Write(field, value) => {
                self.advance(lines);
                lines.line(format!("{}={}({})", output(field), swapped(field.len), self.expression(value)));
            }
            Statement::Set(name, value) => {
                lines.line(format!("{}={}", self.name(name), self.expression(value)))
            }
            Statement::If(condition, then, otherwise) => {
                lines.open(format!("IF {} THEN", self.expression(condition)));
                self.statements(then, lines);
                if !otherwise.is_empty() {
                    lines.middle("ELSE");
                    self.statements(otherwise, lines);
                }
                lines.close("ENDIF");
            }
            Statement::While(condition, body) => {
                lines.open(format!("WHILE {}", self.expression(condition)));
                self.statements(body, lines);
                lines.close("ENDWHILE");
            }
            Statement::Repeat(body, until) => {
                lines.open("REPEAT");
                self.statements(body, lines);
                lines.close(format!("UNTIL {}", self.expression(until)));
            }
            Statement::Loop(body) => {
                lines.open("LOOP");
                self.statements(body, lines);
                lines.close("ENDLOOP");
            }
            Statement::Call(name) => lines.line(format!("{}()", self.name(name))),
            Statement::Guarded(name) => {
                lines.line("INTERRUPT DECL 21 WHEN SB_STOP==TRUE DO SB_BRAKE()");
                lines.line("INTERRUPT ON 21");
                lines.line(format!("{}()", self.name(name)));
                lines.line("INTERRUPT OFF 21");
            }
            Statement::EndGuard => lines.line("INTERRUPT OFF 21"),
            Statement::Move(Driven::Registers, _) => lines.line("SB_MOVE()"),
            Statement::Move(Driven::Stored(motions), _) => self.stored(motions, lines),
            Statement::Pause => lines.line("WAIT SEC 0.004"),
            Statement::Yield => lines.line("; the advance run looks again, and waits for nothing"),
            Statement::ShowFault => lines.line("; SB_TEST shows the number of the test, and nothing is sent"),
            Statement::Hold(ms) => lines.line(format!("WAIT SEC {}", real(f64::from(*ms) / 1_000.0))),
            Statement::Restart(watch) => {
                let limit = if *watch == WatchTimer::Life { "SB_LIFE_MS" } else { "SB_CYCLE_MS" };
                lines.line(format!("$TIMER[{}]=-{limit}", timer(*watch)));
                lines.line(format!("$TIMER_STOP[{}]=FALSE", timer(*watch)));
            }
            Statement::Speed(name) => lines.line(format!("$OV_PRO={}", self.name(name))),
            Statement::Outputs(name) => lines.line(format!("SB_TOOL_OUTPUTS({})", self.name(name))),
            Statement::Pose => lines.line("SB_POSE()"),
        }
    }

    /// Writes motions of a stored program: one, or the pieces of one spline.
    fn stored(&self, motions: &[[u32; COUNT]], lines: &mut PrintedLines) {
        let [first, ..] = motions else { return };
        lines.line(format!(
            "SB_PREPARE({},{},{},{},{})",
            first[13], first[14], first[15], first[16], first[17]
        ));
        let trigger = "TRIGGER WHEN DISTANCE=1 DELAY=0 DO SB_MOVED() PRIO=-1";
        let exact = first[15] == 0;
        let approximated = if exact { "" } else { " C_DIS" };
        match first[16] {
            2 => {
                lines.line(trigger);
                lines.line(format!("PTP {}{approximated}", target(first, first[9])));
            }
            3 => {
                lines.line(trigger);
                lines.line(format!("PTP {}{approximated}", joints(first)));
            }
            4 => {
                lines.line(trigger);
                let [x, y, z] = [6, 7, 8].map(|at| coordinate(first[at]));
                lines.line(format!("CIRC {{X {x},Y {y},Z {z}}},{}{approximated}", target(first, 0)));
            }
            5 => {
                lines.open("SPLINE");
                for piece in motions {
                    lines.line("TRIGGER WHEN PATH=0 DELAY=0 DO SB_MOVED() PRIO=-1");
                    lines.line(format!("SPL {}", target(piece, 0)));
                }
                lines.close("ENDSPLINE");
            }
            _ => {
                lines.line(trigger);
                lines.line(format!("LIN {}{approximated}", target(first, 0)));
            }
        }
    }
}

fn coordinate(bits: u32) -> String {
    real(f32::from_bits(bits).into())
}

fn target(registers: &[u32; COUNT], status: u32) -> String {
    let [x, y, z, a, b, c] = [0, 1, 2, 3, 4, 5].map(|at| coordinate(registers[at]));
    let configuration =
        if status & 0x80 == 0 { String::new() } else { format!(",S {},T {}", status % 8, registers[10]) };
    format!("{{X {x},Y {y},Z {z},A {a},B {b},C {c}{configuration}}}")
}

fn joints(registers: &[u32; COUNT]) -> String {
    let axes = (0..6).map(|at| format!("A{} {}", at + 1, coordinate(registers[at])));
    format!("{{{}}}", axes.collect::<Vec<_>>().join(","))
}

/// Writes routines as subprograms.
fn routines<'a>(routines: impl IntoIterator<Item = &'a Routine>, krl: &Krl, lines: &mut PrintedLines) {
    for routine in routines {
        lines.line("");
        lines.open(format!("GLOBAL DEF {}( )", krl.name(&routine.name)));
        lines.line(format!("; {}", routine.purpose));
        krl.statements(&routine.body, lines);
        lines.close("END");
    }
}

fn source(name: &str, rest: impl FnOnce(&mut PrintedLines)) -> ExportFile {
    let mut lines = PrintedLines::default();
    lines.line("&ACCESS RVO");
    lines.line("&REL 1");
    rest(&mut lines);
    ExportFile { path: name.into(), text: lines.finish() }
}

fn head(lines: &mut PrintedLines) {
    HEAD.lines().for_each(|line| lines.line(format!("; {line}").trim_end()));
    lines.line("; KRL: tokens, blocks and that names are declared were checked by a program of the same authors; no grammar of KRL is public.");
}

/// Returns the files for a KUKA robot.
pub(crate) fn kuka(application: &RobotApplication, kit: &Kit) -> Vec<ExportFile> {
    let robot = Krl { has_advance: true };
    let submit = Krl { has_advance: false };
    // The first routine of a task has the name of its file.
    let main = source("SB_MAIN.src", |lines| {
        lines.open("DEF SB_MAIN( )");
        head(lines);
        lines.line("SB_INIT_MOTION()");
        if let Some(first) = kit.motion.first() {
            robot.statements(&first.body, lines);
        }
        lines.close("END");
        routines(kit.motion.iter().skip(1).chain([&kit.on_trigger]), &robot, lines);
        lines.text(ADAPTER);
    });
    let cyclic = source("SB_SUBMIT.sub", |lines| {
        lines.open("DEF SB_SUBMIT( )");
        head(lines);
        if let Some(first) = kit.cyclic.first() {
            submit.statements(&first.body, lines);
        }
        lines.close("END");
        routines(kit.cyclic.iter().skip(1), &submit, lines);
    });
    vec![main, cyclic, data(application, kit), signals(kit)]
}

/// Writes variables and frames.
fn data(application: &RobotApplication, kit: &Kit) -> ExportFile {
    source("SB_DATA.dat", |lines| {
        lines.open("DEFDAT SB_DATA PUBLIC");
        head(lines);
        for variable in &kit.variables {
            let name = variable.name.to_uppercase();
            lines.line(match variable.number {
                Some(number) => format!("DECL GLOBAL INT SB_{name}={number}"),
                None => format!("DECL GLOBAL BOOL SB_{name}=FALSE"),
            });
        }
        lines.line(format!(
            "DECL GLOBAL BOOL SB_SWAP={}",
            if application.big_endian { "TRUE" } else { "FALSE" }
        ));
        lines.line("; ms without a new life counter after which the connection is lost; ms of a robot cycle");
        lines.line("DECL GLOBAL INT SB_LIFE_MS=100");
        lines.line(format!("DECL GLOBAL INT SB_CYCLE_MS={}", application.robot_cycle_us.div_ceil(1_000)));
        lines.line(
            "; timers of the controller that nobody else may use; first output of the gripper, 0 is none",
        );
        for (at, (name, _)) in TIMERS.iter().enumerate() {
            lines.line(format!("DECL GLOBAL INT {name}={}", 61 + at));
        }
        lines.line("DECL GLOBAL INT SB_FIRST_OUTPUT=0");
        for (name, frames) in [("SB_TOOLS", &application.tools), ("SB_BASES", &application.bases)] {
            lines.line(format!("DECL GLOBAL FRAME {name}[16]"));
            for number in frame_numbers() {
                let [x, y, z, a, b, c] = frames.get(&number).copied().unwrap_or_default().map(real);
                let at = number + 1;
                lines.line(format!("{name}[{at}]={{X {x},Y {y},Z {z},A {a},B {b},C {c}}}"));
            }
        }
        lines.close("ENDDAT");
    })
}

/// Writes the signals of both images.
fn signals(kit: &Kit) -> ExportFile {
    let (inputs, outputs) = fields(kit);
    source("SB_SIGNALS.dat", |lines| {
        lines.open("DEFDAT SB_SIGNALS PUBLIC");
        head(lines);
        lines.line("; Byte 0 of each image is at $IN[1] and $OUT[1]. If the modules are mapped elsewhere, add the distance.");
        for (list, name, of) in [(&inputs, input as fn(&Field) -> String, "$IN"), (&outputs, output, "$OUT")]
        {
            for field in list {
                let (from, to) = (field.at * 8 + 1, (field.at + field.len) * 8);
                lines.line(format!("GLOBAL SIGNAL {} {of}[{from}] TO {of}[{to}]", name(field)));
            }
        }
        lines.close("ENDDAT");
    })
}
