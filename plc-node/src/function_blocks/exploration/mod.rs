//! Every block in every order of `Execute`, robot images and lost connections, until no new state turns up.
//!
//! A state is all that a block and the command image remember. From each one found, every input is tried; the rules
//! of PLCopen are checked at every single step, so they hold along every sequence of any length.

mod blocks;
mod exported;

use std::collections::HashSet;
use std::fmt::Debug;
use std::hash::Hash;

use structured_text::Instance;

use protocol::image::{
    Control, ErrorNumber, Feedback, IMAGE_LEN, Image, Motion, MotionKind, Order, Slots, State, Status,
};

use exported::ExportedBlocks;

use super::*;
use crate::{AxesGroup, MotionList, MotionSource, WaitLimits};

const PATIENCE: WaitLimits = WaitLimits { answer_scans: 3, silent_scans: u32::MAX };
const STATES: [State; 5] = [State::Halted, State::Ready, State::Running, State::Suspended, State::Unknown(9)];

/// One scan's inputs of a block; no feedback is a lost connection.
#[derive(Clone, Copy, Debug)]
struct Input {
    execute: bool,
    feedback: Option<Feedback>,
}

/// What the rules need to know of a step.
struct Step {
    execute_before: bool,
    before: Outputs,
    input: Input,
    after: Outputs,
    control: Control,
    /// Whether the group stops the robot after an error.
    stops_for_error: bool,
}

trait Explored: Copy + Eq + Hash + Debug + Default + Send + Sync {
    /// Number of the exported block on its bench.
    const EXPORTED: u8;
    /// Returns whether the control bits are those of a busy block; `None` if a busy block does not change them.
    fn asks(control: Control) -> Option<bool>;
    /// Returns every image that a robot could send, whether it makes sense or not. The command's number is 1 in each
    /// state that is explored from, and 2 while the first call after it runs.
    fn images() -> Vec<Feedback>;
    fn call(&mut self, execute: bool, group: &mut AxesGroup) -> Outputs;
    fn error(&self) -> Option<BlockError>;
    /// Makes states equal that differ in running numbers only.
    fn normalise(&mut self, _group: &mut AxesGroup) {}
    /// Returns whether the robot's image entitles the block to say `Done`.
    fn may_be_done(feedback: &Feedback) -> bool;
    fn may_be_aborted(feedback: &Feedback) -> bool;
    /// Returns images that lead a block that was just started to `Done`.
    fn way_to_done() -> Vec<Feedback>;
    /// Returns whether a block may end with an error without stopping the robot: because the block does not move it, or
    /// because the robot reports that the skill has ended.
    fn may_leave(_feedback: Option<Feedback>) -> bool {
        true
    }
    /// Checks what must hold in each state of this block besides the common rules.
    fn check(&self, _group: &AxesGroup, _after: Outputs) {}
}

/// What a block and its image remember between scans.
type Remembered<F> = (F, bool, u16, (bool, bool), u32, u32);

#[derive(Clone, Copy)]
struct Explorer<F> {
    block: F,
    execute: bool,
    outputs: Outputs,
    control: Control,
    commanded: bool,
    stops_for_error: bool,
    counts: (u32, u32),
    slots: Slots,
    skill: protocol::image::Skill,
    program: u16,
}

impl<F: Explored> Explorer<F> {
    fn new() -> Self {
        let command = protocol::image::Command::default();
        Self {
            block: F::default(),
            execute: false,
            outputs: Outputs::default(),
            control: command.control,
            commanded: false,
            stops_for_error: false,
            counts: (0, 0),
            slots: command.slots,
            skill: command.skill,
            program: command.program,
        }
    }

    fn remembered(&self) -> Remembered<F> {
        let stops = (self.commanded, self.stops_for_error);
        (self.block, self.execute, self.control.0, stops, self.counts.0, self.counts.1)
    }

    /// Runs one scan from this state and checks it against the rules.
    fn step(self, input: Input) -> Self {
        self.step_with_image(input).0
    }

    /// Runs one scan like [`step`](Self::step); returns also the image that goes to the robot.
    fn step_with_image(mut self, input: Input) -> (Self, Image) {
        let mut group = AxesGroup::new(PATIENCE);
        group.command.control = self.control;
        group.command.number = 1;
        group.command.skill = self.skill;
        group.command.program = self.program;
        group.command.slots = self.slots;
        (group.command.total, group.command.written) = self.counts;
        group.commanded = self.commanded;
        group.error_stop = self.stops_for_error.then_some(1);
        group.read(input.feedback);

        let (before, execute_before) = (self.outputs, self.execute);
        let after = self.block.call(input.execute, &mut group);
        self.block.check(&group, after);
        let control = group.command.control;
        let stops_for_error = group.error_stop.is_some();
        check_rules::<F>(&Step { execute_before, before, input, after, control, stops_for_error });
        assert_eq!(self.block.error().map_or(0, BlockError::error_id), after.error_id);

        let mut image = [0; IMAGE_LEN];
        Order::BigEndian.emit_command(&group.command, &mut image);
        self.block.normalise(&mut group);
        let next = Self {
            block: self.block,
            execute: input.execute,
            outputs: after,
            control,
            commanded: group.commanded,
            stops_for_error,
            counts: (group.command.total, group.command.written),
            slots: group.command.slots,
            skill: group.command.skill,
            program: group.command.program,
        };
        (next, image)
    }
}

/// Checks the general rules of PLCopen Part 1, and what this handshake adds to them.
fn check_rules<F: Explored>(step: &Step) {
    let Step { execute_before, before, input: Input { execute, feedback }, after, control, stops_for_error } =
        step;
    let shown = |o: &Outputs| [o.busy, o.done, o.command_aborted, o.error].map(u8::from).iter().sum::<u8>();
    let ended = |o: &Outputs| o.done || o.command_aborted || o.error;
    let rising = *execute && !execute_before;

    assert!(shown(after) <= 1, "Busy, Done, CommandAborted and Error exclude each other: {after:?}");
    assert!(!execute || shown(after) == 1, "one of them shows while Execute is TRUE: {after:?}");
    assert!(after.busy || !after.active, "Active only with Busy: {after:?}");
    assert_eq!(after.error, after.error_id != 0, "ErrorID only with Error");
    assert!(after.busy || !after.command_interrupted, "CommandInterrupted only with Busy: {after:?}");
    assert!(!(after.active && after.command_interrupted), "Active and CommandInterrupted: {after:?}");
    let mut asked = *control;
    if *stops_for_error {
        // The group holds this bit, whichever block asks for it.
        asked.set(Control::HALT, after.busy);
    }
    assert!(F::asks(asked).is_none_or(|asks| asks == after.busy), "asked exactly while busy: {after:?}");
    let stops = control.contains(Control::HALT);
    assert!(
        stops || !(before.busy && after.error) || F::may_leave(*feedback),
        "an error leaves the arm moving"
    );

    if rising && !before.busy {
        assert!(after.busy || after.error, "a rising edge starts: {before:?} → {after:?}");
    }
    if ended(before) && *execute && *execute_before {
        assert_eq!(after, before, "an end shows while Execute stays TRUE");
    }
    if !before.busy && !execute {
        assert_eq!(*after, Outputs::default(), "an end shows for one scan after Execute fell");
    }
    if before.busy {
        match feedback {
            None => assert!(after.error, "a lost connection ends a busy block: {after:?}"),
            Some(feedback) => {
                assert!(!after.done || F::may_be_done(feedback), "Done for no reason: {feedback:?}");
                assert!(!after.command_aborted || F::may_be_aborted(feedback), "aborted for no reason");
            }
        }
        assert!(after.busy || ended(after), "a busy block ends visibly: {after:?}");
    }
}

/// Tries every input from every state, with the exported block beside it; returns how many states there are and every way the block ended.
fn explore<F: Explored>() -> (usize, HashSet<Outputs>) {
    let with_bytes = |feedback: Feedback| {
        let mut image = [0; IMAGE_LEN];
        Order::BigEndian.emit_feedback(&feedback, &mut image);
        (feedback, image)
    };
    let images = F::images().into_iter().map(|image| Some(with_bytes(image))).chain([None]);
    let inputs: Vec<SeenInput> = images.flat_map(|seen| [(seen, false), (seen, true)]).collect();
    // A core each: the exported block is interpreted, and no other test takes as long.
    let (one, other) = inputs.split_at(inputs.len() / 2);
    let exported = ExportedBlocks::new(F::EXPORTED);
    let mut found = HashSet::from([Explorer::<F>::new().remembered()]);
    let mut open = vec![(Explorer::<F>::new(), exported.instance())];
    let mut ends = HashSet::new();
    while let Some((state, instance)) = open.pop() {
        leads_to_done_again(state);
        let (known, from) = (&found, (state, &instance));
        let both = std::thread::scope(|scope| {
            let other = scope.spawn(|| follow(from, other, &exported, known));
            let one = follow(from, one, &exported, known);
            [one, other.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))]
        });
        for (next, shown) in both {
            ends.extend(shown);
            open.extend(next.into_iter().filter(|(next, _)| found.insert(next.remembered())));
        }
        assert!(found.len() < 20_000, "the exploration must end");
    }
    (found.len(), ends)
}

/// An image of the robot with its bytes, or a lost connection; and `Execute`.
type SeenInput = (Option<(Feedback, Image)>, bool);

/// Results of the inputs of a state: new states, each with that of the exported block, and all outputs.
type Followed<F> = (Vec<(Explorer<F>, Instance)>, HashSet<Outputs>);

/// Tries inputs from a state. Returns the states that are not known yet, each once, and all outputs.
fn follow<F: Explored>(
    (state, instance): (Explorer<F>, &Instance),
    inputs: &[SeenInput],
    exported: &ExportedBlocks,
    known: &HashSet<Remembered<F>>,
) -> Followed<F> {
    let (mut new, mut next_states, mut shown) = (HashSet::new(), Vec::new(), HashSet::new());
    for (seen, execute) in inputs {
        let feedback = seen.as_ref().map(|(feedback, _)| *feedback);
        let (next, image) = state.step_with_image(Input { execute: *execute, feedback });
        let bytes = seen.as_ref().map(|(_, image)| image);
        let twin = exported.step(instance, (*execute, bytes), (&image, &next.outputs));
        shown.insert(next.outputs);
        if !known.contains(&next.remembered()) && new.insert(next.remembered()) {
            next_states.push((next, twin));
        }
    }
    (next_states, shown)
}

/// Checks that every state leads to `Done` again: a lost connection, scans without `Execute` and a robot at rest make the
/// block idle, and the next `Execute` leads to `Done` if the robot does its part.
fn leads_to_done_again<F: Explored>(mut state: Explorer<F>) {
    let standing =
        Feedback { state: State::Ready, status: Status::AT_REST, life_echo: 1, ..Feedback::default() };
    for feedback in [None, None, Some(standing)] {
        state = state.step(Input { execute: false, feedback });
    }
    assert_eq!(state.outputs, Outputs::default(), "there is a state without a way back: {:?}", state.block);
    let way = F::way_to_done();
    // The first image is already there in the scan of the start edge; a skill's echo is then still an older one.
    let first = way.first().map(|image| Feedback { number: 0, ..*image });
    for feedback in first.into_iter().chain(way) {
        assert!(!state.outputs.done);
        state = state.step(Input { execute: true, feedback: Some(feedback) });
    }
    assert!(state.outputs.done, "{:?} did not lead to Done", state.block);
}

/// Asserts which ends were found, so that the exploration is known to reach them.
fn assert_ends<F: Explored>(done_aborted_error: [bool; 3]) -> HashSet<Outputs> {
    let (states, ends) = explore::<F>();
    let reached = |end: fn(&Outputs) -> bool| ends.iter().any(end);
    let found = [reached(|o| o.done), reached(|o| o.command_aborted), reached(|o| o.error)];
    assert_eq!(found, done_aborted_error, "of {states} states");
    assert!(reached(|o| o.busy && o.active) && reached(|o| o.busy && !o.active));
    ends
}

#[test]
fn a_single_motion_keeps_plcopens_rules_in_every_order_of_events() {
    assert_ends::<MoveLinCartesian>([true, true, true]);
}

#[test]
fn move_continuous_keeps_plcopens_rules_and_never_touches_a_slot_in_use_in_every_order_of_events() {
    let ends = assert_ends::<MoveContinuous>([true, true, true]);
    assert!(ends.iter().any(|outputs| outputs.command_interrupted));
    let ids: HashSet<u16> = ends.iter().map(|outputs| outputs.error_id).collect();
    for (id, name) in [
        (15, "the robot's own"),
        (0x8001, "no connection"),
        (0x8006, "no answer"),
        (0x8007, "forgotten"),
        (0x8008, "end unknown"),
        (0x8009, "counted too far"),
        (0x800A, "counted backwards"),
        (0x800B, "ended early"),
        (0x8012, "stopping after an error"),
    ] {
        assert!(ids.contains(&id), "{name} is not reached: {ids:?}");
    }
}

#[test]
fn run_program_keeps_plcopens_rules_in_every_order_of_events() {
    assert_ends::<RunProgram>([true, true, true]);
}

#[test]
fn the_group_commands_keep_plcopens_rules_in_every_order_of_events() {
    assert_ends::<GroupEnable>([true, false, true]);
    assert_ends::<GroupDisable>([true, false, true]);
    assert_ends::<GroupReset>([true, false, true]);
    assert_ends::<GroupHalt>([true, true, true]);
    assert_ends::<GroupStop>([true, false, true]);
    assert_ends::<GroupInterrupt>([true, true, true]);
    assert_ends::<GroupContinue>([true, true, true]);
}
