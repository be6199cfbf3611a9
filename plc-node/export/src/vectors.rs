//! Vectors for the code: what it gets in each scan and what it must answer, so that a compiler or a PLC can be tried without a robot.
//!
//! They come from the interpreter and a robot that executes each motion in [`MOTION_SCANS`] scans at once.

use std::fmt::Write as _;

use ::structured_text::{Program, RunError, Source};
use protocol::image::{
    Command, Control, Feedback, FeedbackSealer, IMAGE_LEN, Image, Order, Skill, State, Status,
};

use crate::{ExportedApplication, FILE};

/// Name of the file.
pub const VECTORS: &str = "vectors.jsonl";

/// Scans for each motion.
const MOTION_SCANS: u32 = 3;

/// Most scans of a run.
const MOST_SCANS: u32 = 1_000;

/// Time from one scan to the next in us.
const SCAN_US: u32 = 1_000;

/// Most steps of a scan.
const BUDGET: u64 = 100_000;

/// Why vectors could not be made.
#[derive(Debug, thiserror::Error)]
pub enum VectorsError {
    /// The text is not in the subset.
    #[error(transparent)]
    Mistake(#[from] structured_text::Mistake),
    /// The code went wrong.
    #[error(transparent)]
    Run(#[from] RunError),
}

/// Returns one line for each scan: RC, SM and CM once each, first in the one byte order and then in the other. Each run begins
/// with scan 1 of a new instance, and is cut after 1,000 scans.
///
/// # Errors
/// The text does not compile or goes wrong; never for a text of [`structured_text`](crate::structured_text()).
pub fn vectors(text: &str, application: &ExportedApplication) -> Result<String, VectorsError> {
    let program = Program::compile(&[Source { file: FILE, text }])?;
    let mut lines = String::new();
    for order in [Order::BigEndian, Order::LittleEndian] {
        for execution_type in 1..=3 {
            one_run(&program, application, order, execution_type, &mut lines)?;
        }
    }
    Ok(lines)
}

fn one_run(
    program: &Program,
    application: &ExportedApplication,
    order: Order,
    execution_type: i64,
    lines: &mut String,
) -> Result<(), VectorsError> {
    let variable = |name: &str| program.variable("SB_Core", name);
    let (feedback, command) = (variable("feedback_bytes")?, variable("command_bytes")?);
    let (ready, start, of_type) = (variable("ready")?, variable("start")?, variable("execution_type")?);
    let (now, repetitions, big) =
        (variable("now_us")?, variable("repetitions")?, variable("bus_big_endian")?);
    let mut core = program.instance("SB_Core")?;
    let mut robot = Robot::new(order, application.with_check);
    let is_big = order == Order::BigEndian;
    core.set(big, 0, i64::from(is_big));
    core.set(repetitions, 0, 1);
    core.set(of_type, 0, execution_type);
    let mut has_started = false;
    for scan in 1..=MOST_SCANS {
        let is_ready = core.get(ready, 0) == 1;
        let is_start = core.get(start, 0) == 1;
        if has_started && is_ready && !is_start {
            break;
        }
        // The edge comes once the code is ready, and stays until it has begun.
        let starts = if is_start { !is_ready } else { is_ready };
        has_started |= starts;
        core.set(start, 0, i64::from(starts));
        core.set(now, 0, i64::from(scan * SCAN_US));
        core.set_bytes(feedback, &robot.image);
        core.scan(program, BUDGET)?;
        let mut answer = [0; IMAGE_LEN];
        core.get_bytes(command, &mut answer);
        let _ = writeln!(
            lines,
            "{{\"scan\":{scan},\"now_us\":{},\"start\":{starts},\"execution_type\":{execution_type},\"repetitions\":1,\
             \"bus_big_endian\":{is_big},\"feedback\":\"{}\",\"command\":\"{}\"}}",
            scan * SCAN_US,
            hex(&robot.image),
            hex(&answer),
        );
        robot.scan(&answer);
    }
    Ok(())
}

/// Returns the bytes as hexadecimal digits. The images are most of the file, so the formatter is too slow for them.
fn hex(image: &Image) -> String {
    let digit = |nibble: u8| char::from(if nibble < 10 { b'0' + nibble } else { b'a' - 10 + nibble });
    let mut text = String::with_capacity(2 * IMAGE_LEN);
    image.iter().for_each(|byte| text.extend([digit(byte >> 4), digit(byte & 0xF)]));
    text
}

/// A robot that keeps to the handshake and counts motions.
struct Robot {
    order: Order,
    with_check: bool,
    feedback: Feedback,
    /// Scans that the motion under way still takes.
    left: u32,
    total: u32,
    image: Image,
}

impl Robot {
    fn new(order: Order, with_check: bool) -> Self {
        let feedback = Feedback { status: Status::AT_REST, override_percent: 100, ..Feedback::default() };
        Self { order, with_check, feedback, left: 0, total: 0, image: [0; IMAGE_LEN] }
    }

    fn scan(&mut self, image: &Image) {
        if let Ok(command) = self.order.parse_command(image) {
            self.obey(&command);
        }
        self.feedback.life = self.feedback.life.wrapping_add(1);
        self.feedback.clock_ns += u64::from(SCAN_US) * 1_000;
        self.order.emit_feedback(&self.feedback, &mut self.image);
        if self.with_check {
            FeedbackSealer::default().seal(self.order, &mut self.image);
        }
    }

    fn obey(&mut self, command: &Command) {
        let feedback = &mut self.feedback;
        feedback.life_echo = command.life;
        feedback.status.set(Status::ENABLED, command.control.contains(Control::ENABLE));
        if command.control.contains(Control::RESET) && feedback.state == State::Halted {
            feedback.state = State::Ready;
        }
        let executes = command.control.contains(Control::EXECUTE);
        if executes && feedback.number != command.number && feedback.state == State::Ready {
            (feedback.number, feedback.executed, feedback.accepted) = (command.number, 0, 0);
            feedback.state = State::Running;
            feedback.status.set(Status::DONE, false);
            feedback.status.set(Status::AT_REST, false);
            feedback.status.set(Status::BUSY, true);
            self.total = if command.skill == Skill::RunProgram { 1 } else { command.total };
            self.left = MOTION_SCANS;
            return;
        }
        if feedback.state != State::Running {
            return;
        }
        let is_program = command.skill == Skill::RunProgram;
        feedback.accepted = if is_program { 0 } else { command.written };
        self.left = self.left.saturating_sub(1);
        if self.left > 0 || !is_program && feedback.executed >= command.written {
            return;
        }
        feedback.executed += 1;
        self.left = MOTION_SCANS;
        if !is_program {
            feedback.joints = command.slot(feedback.executed - 1).target;
        }
        if feedback.executed == self.total {
            feedback.state = State::Ready;
            feedback.status.set(Status::BUSY, false);
            feedback.status.set(Status::DONE, true);
            feedback.status.set(Status::AT_REST, true);
        }
    }
}
