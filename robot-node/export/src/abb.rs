//! The kit in RAPID, for ABB's IRC5 and OmniCore: written from documents, not tried on the maker's controller.
//!
//! The motion task and a semistatic background task share persistent variables of the same names. All numbers are `dnum`, which
//! holds 32 bits exactly; `num` does not.

use crate::application::{HEAD, RobotApplication, frame_numbers};
use crate::form::{AdapterTest, Driven, Field, FormOperation, Kit, Routine, Sense, Statement, WatchTimer};
use crate::layer::fields;
use crate::printed::{ExportFile, PrintedLines, Words, real, sign};
use crate::registers::COUNT;

/// The adapter of the motion task.
const MOTION_ADAPTER: &str = include_str!("../templates/abb-motion.mod");

/// The adapter of both tasks.
const SHARED_ADAPTER: &str = include_str!("../templates/abb-shared.sys");

/// The adapter of the background task.
const CYCLIC_ADAPTER: &str = include_str!("../templates/abb-cyclic.mod");

struct Rapid;

impl Words for Rapid {
    fn name(&self, name: &str) -> String {
        format!("sb_{name}")
    }

    fn sense(&self, sense: Sense) -> String {
        match sense {
            Sense::AtRest => "sb_at_rest()".into(),
            Sense::DrivesOn => "(DOutput(sbo_drives_on)=1)".into(),
            Sense::Expired(WatchTimer::Life) => "(ClkRead(sb_life_clock)*1000>sb_life_ms)".into(),
            Sense::Expired(WatchTimer::Count) => "(ClkRead(sb_count_clock)*1000>=sb_cycle_ms)".into(),
            Sense::NotFinite(name) => format!("sb_not_finite({})", self.name(name)),
            Sense::Reach => "sb_reach()".into(),
            Sense::Passes(test) => passes(test),
        }
    }

    fn pair(&self, operation: FormOperation, one: &str, other: &str) -> String {
        match operation {
            FormOperation::Equal => format!("({one}={other})"),
            FormOperation::Divide => format!("({one} DIV {other})"),
            FormOperation::Modulo => format!("({one} MOD {other})"),
            FormOperation::BitAnd => format!("BitAndDnum({one},{other})"),
            FormOperation::BitXor => format!("BitXOrDnum({one},{other})"),
            other_operation => format!("({one} {} {other})", sign(other_operation).unwrap_or("+")),
        }
    }
}

/// Returns a test of the adapter. All numbers are without a sign.
fn passes(test: AdapterTest) -> String {
    let swaps = |function: &str, value: u32, swapped: u32| {
        format!(
            "((sb_swap AND ({function}({value})={swapped})) OR ((NOT sb_swap) AND ({function}({value})={value})))"
        )
    };
    match test {
        AdapterTest::Word(value) => swaps("sb_word", value.into(), value.swap_bytes().into()),
        AdapterTest::DoubleWord(value) => swaps("sb_dword", value, value.swap_bytes()),
        AdapterTest::BitsOfReal(literal, bits) => format!("(sb_bits({literal})={bits})"),
        AdapterTest::RealOfBits(bits, literal) => format!("(sb_real({bits})={literal})"),
        AdapterTest::Finite(bits, is_finite) => {
            let not = if is_finite { "NOT " } else { "" };
            format!("({not}sb_not_finite({bits}))")
        }
    }
}

fn input(field: &Field) -> String {
    format!("sbi_{}", field.name)
}

fn output(field: &Field) -> String {
    format!("sbo_{}", field.name)
}

const fn swapped(len: usize) -> &'static str {
    match len {
        1 => "",
        2 => "sb_word",
        _ => "sb_dword",
    }
}

impl Rapid {
    fn statements(&self, statements: &[Statement], lines: &mut PrintedLines) {
        statements.iter().for_each(|statement| self.statement(statement, lines));
    }

    fn statement(&self, statement: &Statement, lines: &mut PrintedLines) {
        match statement {
            Statement::Read(into, field) => {
                let (name, swap) = (self.name(into), swapped(field.len));
                lines.line(format!("{name}:={swap}(GInputDnum({}));", input(field)));
            }
            Statement::Write(field, value) => {
                let (swap, value) = (swapped(field.len), self.expression(value));
                lines.line(format!("SetGO {},{swap}({value});", output(field)));
            }
            Statement::Set(name, value) => {
                lines.line(format!("{}:={};", self.name(name), self.expression(value)))
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
                lines.open(format!("WHILE {} DO", self.expression(condition)));
                self.statements(body, lines);
                lines.close("ENDWHILE");
            }
            // RAPID has no loop with its condition at the end.
            Statement::Repeat(body, until) => {
                lines.line("sb_again:=TRUE;");
                lines.open("WHILE sb_again DO");
                self.statements(body, lines);
                lines.line(format!("sb_again:=NOT {};", self.expression(until)));
                lines.close("ENDWHILE");
            }
            Statement::Loop(body) => {
                lines.open("WHILE TRUE DO");
                self.statements(body, lines);
                lines.close("ENDWHILE");
            }
            Statement::Call(name) => lines.line(format!("{};", self.name(name))),
            Statement::Guarded(name) => lines.line(format!("sb_guarded_{name};")),
            Statement::EndGuard => lines.line("ISleep sb_stop_number;"),
            Statement::Move(Driven::Registers, _) => lines.line("sb_move;"),
            Statement::Move(Driven::Stored(motions), _) => self.stored(motions, lines),
            Statement::Pause | Statement::Yield => lines.line("WaitTime 0.004;"),
            Statement::ShowFault => {
                lines.line("ErrWrite \"skillbench\",\"The self-test failed: look at sb_test.\";");
                lines.line("WaitTime 10;");
            }
            Statement::Hold(ms) => lines.line(format!("WaitTime {};", real(f64::from(*ms) / 1_000.0))),
            Statement::Restart(watch) => {
                let clock = if *watch == WatchTimer::Life { "sb_life_clock" } else { "sb_count_clock" };
                lines.line(format!("ClkStop {clock};"));
                lines.line(format!("ClkReset {clock};"));
                lines.line(format!("ClkStart {clock};"));
            }
            // The motion task takes it over by an interrupt: SpeedRefresh acts on its own task only.
            Statement::Speed(name) => lines.line(format!("sb_percent:={};", self.name(name))),
            Statement::Outputs(name) => lines.line(format!("SetGO sbo_gripper,{};", self.name(name))),
            Statement::Pose => lines.line("sb_pose;"),
        }
    }

    /// Writes a motion of a stored program.
    fn stored(&self, motions: &[[u32; COUNT]], lines: &mut PrintedLines) {
        for registers in motions {
            let [velocity, acceleration, approximation, kind, frames] =
                [13, 14, 15, 16, 17].map(|at| registers[at]);
            let deceleration = registers[11];
            lines.line(format!(
                "sb_prepare {velocity},{acceleration},{deceleration},{approximation},{kind},{frames};"
            ));
            let value = |at: usize| real(f32::from_bits(registers[at]).into());
            let six = (0..6).map(value).collect::<Vec<_>>().join(",");
            match kind {
                3 => lines.line(format!("sb_go_joints {six};")),
                4 => lines.line(format!("sb_go_circle {six},{},{},{};", value(6), value(7), value(8))),
                2 => lines.line(format!("sb_go_ptp {six};")),
                _ => lines.line(format!("sb_go_line {six};")),
            }
        }
    }

    fn routine(&self, routine: &Routine, lines: &mut PrintedLines) {
        lines.line("");
        lines.line(format!("! {}", routine.purpose));
        lines.open(format!("PROC {}()", self.name(&routine.name)));
        self.statements(&routine.body, lines);
        lines.close("ENDPROC");
    }
}

fn head(lines: &mut PrintedLines) {
    HEAD.lines().for_each(|line| lines.line(format!("! {line}").trim_end()));
    lines.line("! RAPID: the syntax was checked by rapidchecker, a grammar that others wrote; that names are declared, by a program of the same authors.");
}

fn module(path: &str, name: &str, rest: impl FnOnce(&mut PrintedLines)) -> ExportFile {
    let mut lines = PrintedLines::default();
    lines.open(format!("MODULE {name}"));
    head(&mut lines);
    rest(&mut lines);
    lines.close("ENDMODULE");
    ExportFile { path: path.into(), text: lines.finish() }
}

/// Returns the files for an ABB robot.
pub(crate) fn abb(application: &RobotApplication, kit: &Kit) -> Vec<ExportFile> {
    let motion = module("SB_Motion.mod", "SB_Motion", |lines| {
        lines.text(MOTION_ADAPTER);
        kit.motion.iter().for_each(|routine| Rapid.routine(routine, lines));
        lines.line("");
        lines.line(format!("! {}", kit.on_trigger.purpose));
        lines.open("TRAP sb_moved");
        Rapid.statements(&kit.on_trigger.body, lines);
        lines.close("ENDTRAP");
    });
    let cyclic = module("SB_Cyclic.mod", "SB_Cyclic", |lines| {
        lines.text(CYCLIC_ADAPTER);
        kit.cyclic.iter().for_each(|routine| Rapid.routine(routine, lines));
    });
    vec![motion, cyclic, shared(application, kit), signals(kit)]
}

/// Writes what both tasks have: variables and frames.
fn shared(application: &RobotApplication, kit: &Kit) -> ExportFile {
    module("SB_Shared.sys", "SB_Shared(SYSMODULE)", |lines| {
        for variable in &kit.variables {
            lines.line(match variable.number {
                Some(number) => format!("PERS dnum sb_{}:={number};", variable.name),
                None => format!("PERS bool sb_{}:=FALSE;", variable.name),
            });
        }
        lines.line("PERS dnum sb_percent:=100;");
        lines.line(format!("CONST bool sb_swap:={};", if application.big_endian { "TRUE" } else { "FALSE" }));
        lines.line("! ms without a new life counter after which the connection is lost; ms of a robot cycle");
        lines.line("CONST num sb_life_ms:=100;");
        lines.line(format!("CONST num sb_cycle_ms:={};", application.robot_cycle_us.div_ceil(1_000)));
        for (name, frames) in [("sb_tools", &application.tools), ("sb_bases", &application.bases)] {
            lines.line(format!(
                "! x, y, z in mm; angles about z, y', x'' in degrees; number n of {name} from 6 n + 1 on"
            ));
            let all = frame_numbers().map(|number| {
                let frame = frames.get(&number).copied().unwrap_or_default().map(real);
                frame.join(",")
            });
            lines.line(format!("CONST num {name}{{96}}:=[{}];", all.collect::<Vec<_>>().join(",")));
        }
        lines.text(SHARED_ADAPTER);
    })
}

/// Writes the signals of both images. A group has at most 32 signals.
fn signals(kit: &Kit) -> ExportFile {
    let (inputs, outputs) = fields(kit);
    let mut lines = PrintedLines::default();
    lines.line("EIO:CFG_1.0::");
    HEAD.lines().for_each(|line| lines.line(format!("# {line}").trim_end()));
    lines.line("# SB_PLC is the device with the modules of 256 bytes. Byte 0 of each image is at bit 0; add the distance otherwise.");
    lines.line("EIO_SIGNAL:");
    for (list, name, kind) in [(&inputs, input as fn(&Field) -> String, "GI"), (&outputs, output, "GO")] {
        for field in list {
            let (from, to) = (field.at * 8, (field.at + field.len) * 8 - 1);
            let name = name(field);
            lines.line("");
            lines.line(format!(
                "      -Name \"{name}\" -SignalType \"{kind}\" -Device \"SB_PLC\" -DeviceMap \"{from}-{to}\""
            ));
        }
    }
    lines.line("");
    lines.line("      -Name \"sbo_gripper\" -SignalType \"GO\" -Size 16");
    lines.line("");
    lines.line("      -Name \"sbo_drives_on\" -SignalType \"DO\"");
    lines.line("#");
    lines.line("SYSSIG_OUT:");
    lines.line("");
    lines.line("      -Status \"MotOnState\" -Signal \"sbo_drives_on\"");
    ExportFile { path: "EIO.cfg".into(), text: lines.finish() }
}
