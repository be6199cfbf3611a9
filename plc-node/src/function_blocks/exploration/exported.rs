//! The exported blocks beside those that are explored: each input steps both, and their bytes, outputs and ErrorIDs are compared.

use plc_export::{ExportedApplication, Maker};
use protocol::image::{IMAGE_LEN, Image, Motion, MotionKind, Order};
use structured_text::{Instance, Program, Source, Variable};

use super::{Outputs, PATIENCE};
use crate::MotionSource as _;

/// Calls one block in each scan, on a group that begins each scan as that of the exploration does.
const BENCH: &str = "
FUNCTION_BLOCK SB_Bench
VAR_INPUT
    block : USINT; execute : BOOL; is_connected : BOOL; feedback_bytes : SB_Bytes;
END_VAR
VAR_OUTPUT
    command_bytes : SB_Bytes; busy : BOOL; active : BOOL; interrupted : BOOL; done : BOOL; aborted : BOOL; error : BOOL; error_id : UINT;
END_VAR
VAR
    group : SB_AxesGroup; received : SB_Bytes; command : SB_Bytes; take : SB_TakeFeedback; write : SB_WriteCommand;
    single : SB_SingleMotion; continuous : SB_MoveContinuous; run : SB_RunProgram; change : SB_GroupCommand;
    motions : SB_Motions := [@MOTIONS@];
END_VAR
group.scans := 1; group.c_life := 1; group.waiting := FALSE; group.waiting_aborts := FALSE; group.tickets := 0;
group.halting := FALSE; group.f_valid := FALSE; group.still_scans := 0; group.moving := FALSE;
IF group.stopping THEN group.stopping_since := 1; END_IF;
IF is_connected THEN
    received := feedback_bytes;
    take(high_first := TRUE, image := received, group := group);
END_IF;
CASE block OF
    10: single(execute := execute, clear := FALSE, aborting := TRUE, motion := 6, answer_scans := 3, group := group, motions := motions);
        busy := single.busy; active := single.active; interrupted := single.command_interrupted; done := single.done;
        aborted := single.command_aborted; error := single.error; error_id := single.error_id;
    11: continuous(execute := execute, clear := FALSE, aborting := TRUE, first := 0, total := 6, queue_depth := 5, answer_scans := 3,
            group := group, motions := motions);
        busy := continuous.busy; active := continuous.active; interrupted := continuous.command_interrupted; done := continuous.done;
        aborted := continuous.command_aborted; error := continuous.error; error_id := continuous.error_id;
    12: run(execute := execute, clear := FALSE, aborting := TRUE, program_number := 1, answer_scans := 3, group := group);
        busy := run.busy; active := run.active; interrupted := run.command_interrupted; done := run.done;
        aborted := run.command_aborted; error := run.error; error_id := run.error_id;
ELSE
    change(execute := execute, clear := FALSE, command_kind := block, answer_scans := 3, group := group);
    busy := change.busy; active := change.active; done := change.done; aborted := change.command_aborted; error := change.error;
    error_id := change.error_id;
END_CASE;
write(high_first := TRUE, with_check := FALSE, image := command, group := group);
command_bytes := command;
END_FUNCTION_BLOCK
";

/// Most steps of a scan.
const BUDGET: u64 = 100_000;

/// The exported code with the variables of its bench.
pub(super) struct ExportedBlocks {
    program: Program,
    block: u8,
    inputs: [Variable; 4],
    outputs: [Variable; 7],
    command: Variable,
    /// The number of the command, and what remembers it.
    number: Variable,
    remembered: [Variable; 4],
}

impl ExportedBlocks {
    /// Compiles the exported code; `block` is the number of one in [`BENCH`].
    pub(super) fn new(block: u8) -> Self {
        let mut list = super::blocks::list();
        let mut motions: Vec<Motion> = (0..list.total()).filter_map(|index| list.get(index)).collect();
        motions.push(Motion { kind: MotionKind::LinCartesian, ..Motion::EMPTY });
        let application = ExportedApplication {
            motions,
            from_anywhere: None,
            from_end: Vec::new(),
            stops: Vec::new(),
            answer_scans: PATIENCE.answer_scans,
            silent_scans: PATIENCE.silent_scans,
            progress_scans: u32::MAX,
            most_motions: Maker::most_motions(Maker::St.memory_kib()),
            scan_us: 1_000,
            big_endian: true,
            robot_cycle_us: 4_000,
            queue_depth: 5,
            program: 1,
            with_check: false,
        };
        let text = plc_export::structured_text(&application).unwrap();
        // The bench has the data of SB_Core.
        let data = text.split_once("motions : SB_Motions := [").and_then(|(_, rest)| rest.split_once(']'));
        let text = format!("{text}\n{}", BENCH.replace("@MOTIONS@", data.unwrap().0));
        let program = Program::compile(&[Source { file: "bench.st", text: &text }])
            .unwrap_or_else(|mistake| panic!("{mistake}"));
        let variable = |name: &str| program.variable("SB_Bench", name).unwrap();
        Self {
            block,
            inputs: ["block", "execute", "is_connected", "feedback_bytes"].map(variable),
            outputs: ["busy", "active", "interrupted", "done", "aborted", "error", "error_id"].map(variable),
            command: variable("command_bytes"),
            number: variable("group.c_number"),
            remembered: [
                "single.skill.number",
                "continuous.skill.number",
                "run.skill.number",
                "write.written_number",
            ]
            .map(variable),
            program,
        }
    }

    /// Creates an instance before its first scan. The number of the command is 1 in each state that is explored from.
    pub(super) fn instance(&self) -> Instance {
        let mut instance = self.program.instance("SB_Bench").unwrap();
        instance.set(self.number, 0, 1);
        instance
    }

    /// Runs one scan from a state; compares it with the image and the outputs of the block that is explored, and returns the next
    /// state, in which the number of the command is 1 again.
    pub(super) fn step(
        &self,
        from: &Instance,
        (execute, feedback): (bool, Option<&Image>),
        (image, outputs): (&Image, &Outputs),
    ) -> Instance {
        let mut instance = from.clone();
        let [block, execute_input, is_connected, feedback_bytes] = self.inputs;
        instance.set(block, 0, self.block.into());
        instance.set(execute_input, 0, execute.into());
        instance.set(is_connected, 0, feedback.is_some().into());
        feedback.into_iter().for_each(|feedback| instance.set_bytes(feedback_bytes, feedback));
        instance.scan(&self.program, BUDGET).unwrap_or_else(|trap| panic!("{trap}"));
        let mut bytes = [0; IMAGE_LEN];
        instance.get_bytes(self.command, &mut bytes);
        let parsed = |image: &Image| Order::BigEndian.parse_command(image);
        assert_eq!(bytes, *image, "{:?} and {:?}", parsed(&bytes), parsed(image));
        let found = self.outputs.map(|output| instance.get(output, 0));
        let Outputs { busy, active, command_interrupted, done, command_aborted, error, error_id } = *outputs;
        let expected = [busy, active, command_interrupted, done, command_aborted, error].map(i64::from);
        assert_eq!((&found[..6], found[6]), (&expected[..], error_id.into()));
        let number = instance.get(self.number, 0);
        for remembered in self.remembered {
            if instance.get(remembered, 0) == number {
                instance.set(remembered, 0, 1);
            }
        }
        instance.set(self.number, 0, 1);
        instance
    }
}
