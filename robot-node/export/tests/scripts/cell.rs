//! The PLC, the robot, and the images between them, which change between any two statements of the robot.

use std::collections::VecDeque;

use plc_node::Override;
use plc_node::function_blocks::{BufferMode, Outputs};
use protocol::image::{ErrorNumber, IMAGE_LEN, Image, Order, Status};
use robot_export::execution::{FormCode, FormController};
use robot_export::layer::{Flaw, ProgramPart, ServedSkills, kit};
use robot_export::registers::{COUNT, registers};

use super::causes::{BlockFailure, Causes};
use super::plc::{
    BLOCKS, DISABLE, HALT, LINE, LOWEST, OTHER, PROGRAM, PlcBlocks, SKILLS, STOP, WAY, program,
};
use super::rules::{Broken, Rule, Rules, broken};

/// Motion of a bad list that is out of reach.
pub(crate) const BAD_MOTION: u32 = 6;

/// Returns the second layer with a flaw or without, translated.
pub(crate) fn code(flaw: Option<Flaw>, has_sign: bool) -> FormCode {
    let motions = program();
    let (before, after) = motions.split_at(3);
    let single = |motion: &protocol::image::Motion| ProgramPart::Motions(vec![*motion]);
    let stop = ProgramPart::Switch { mask: 4, on: true, wait_ms: 3 };
    // Two motions of the program are the pieces of one spline: what counts them is the same.
    let spline = ProgramPart::Motions(after[..2].to_vec());
    let parts = before.iter().map(single).chain([stop, spline]).chain(after[2..].iter().map(single));
    let served = ServedSkills {
        splines: true,
        configurations: true,
        decelerations: false,
        velocity: 20_000,
        acceleration: 10_000,
        tools: [0].into(),
        bases: [0, 1].into(),
        programs: vec![(1, parts.collect())],
    };
    let kit = kit(&served, flaw);
    assert_eq!(kit.faults(), Vec::<String>::new());
    FormCode::of(&kit, has_sign).unwrap()
}

/// Returns a robot whose self-test has passed.
pub(crate) fn tested(
    code: &FormCode,
    order: Order,
    advance: usize,
    reach: fn(&[u32; COUNT]) -> ErrorNumber,
) -> FormController<'_> {
    let mut robot = FormController::new(code, order, advance, reach);
    let image = [0; IMAGE_LEN];
    for _ in 0..10_000 {
        match robot.value("test") {
            Some(0) => break,
            // The stopwatch runs.
            Some(17) => robot.pass_ms(),
            _ => {}
        }
        robot.step_cyclic(&image);
    }
    assert_eq!(robot.value("test"), Some(0));
    // Both tasks leave it.
    robot.step_cyclic(&image);
    robot.step_motion(&image);
    robot
}

fn reach(registers: &[u32; COUNT]) -> ErrorNumber {
    if f32::from_bits(registers[2]) < LOWEST { ErrorNumber::Unreachable } else { ErrorNumber::None }
}

/// Speed of each part.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CellPace {
    /// Statements and steps of the arm in a scan of the PLC.
    pub(crate) steps: u32,
    /// Shares of motion task, cyclic task and arm in them.
    pub(crate) shares: [u32; 3],
    pub(crate) delays: [usize; 2],
}

pub(crate) struct ScriptCell<'a> {
    pub(crate) plc: PlcBlocks,
    pub(crate) robot: FormController<'a>,
    order: Order,
    pub(crate) execute: [bool; BLOCKS],
    /// Blocks that are set until they have ended.
    pub(crate) pulses: [bool; BLOCKS],
    pub(crate) outputs: [Outputs; BLOCKS],
    pub(crate) mode: BufferMode,
    commands: VecDeque<Image>,
    command: Image,
    feedbacks: VecDeque<Image>,
    feedback: Image,
    /// Scans for which the command, and the feedback, stay as they are.
    pub(crate) stale: [u32; 2],
    /// Scans without a connection.
    pub(crate) lost: u32,
    rules: Rules,
    causes: Causes,
    /// First bytes of the robot's image when it was last compared with the rules.
    compared: [u8; 28],
    /// Highest number before each block's start.
    before: [u16; BLOCKS],
}

impl<'a> ScriptCell<'a> {
    pub(crate) fn new(code: &'a FormCode, order: Order, advance: usize) -> Self {
        Self {
            plc: PlcBlocks::new(),
            robot: tested(code, order, advance, reach),
            order,
            execute: [false; BLOCKS],
            pulses: [false; BLOCKS],
            outputs: [Outputs::default(); BLOCKS],
            mode: BufferMode::Aborting,
            commands: VecDeque::new(),
            command: [0; IMAGE_LEN],
            feedbacks: VecDeque::new(),
            feedback: [0; IMAGE_LEN],
            stale: [0; 2],
            lost: 0,
            rules: Rules::default(),
            causes: Causes::default(),
            compared: [0; 28],
            before: [0; BLOCKS],
        }
    }

    /// Runs a scan of the PLC and what the robot does meanwhile, drawn by `draw`.
    pub(crate) fn scan(&mut self, pace: CellPace, draw: &mut impl FnMut(u32) -> u32) -> Result<(), Broken> {
        let is_lost = self.lost > 0;
        let feedback = (!is_lost).then(|| self.order.parse_feedback(&self.feedback).unwrap());
        if is_lost {
            self.lost -= 1;
            self.plc.group.disarm();
        }
        self.plc.group.read(feedback);
        for block in 0..BLOCKS {
            self.call(block)?;
        }
        self.causes.note_scan(&self.plc.group, is_lost, &self.outputs);
        if self.lost == 0 {
            self.exchange(pace);
        }
        self.robot.pass_ms();
        let total = pace.shares.iter().sum();
        for _ in 0..pace.steps {
            let drawn = draw(total);
            if drawn < pace.shares[0] {
                self.robot.step_motion(&self.command);
            } else if drawn < pace.shares[0] + pace.shares[1] {
                self.robot.step_cyclic(&self.command);
                self.compare()?;
            } else {
                self.robot.step_arm();
            }
        }
        self.rules.begun(self.robot.begun())
    }

    /// Compares the robot's image with the rules after each statement that changed it: what the PLC may read at any instant.
    fn compare(&mut self) -> Result<(), Broken> {
        let head: [u8; 28] = self.robot.image()[..28].try_into().unwrap();
        if head == self.compared {
            return Ok(());
        }
        self.compared = head;
        self.rules.begun(self.robot.begun())?;
        let shown = self.order.parse_feedback(self.robot.image()).unwrap();
        self.causes.note_image(self.plc.group.scans(), &shown)?;
        self.rules.shown(&shown)
    }

    fn call(&mut self, block: usize) -> Result<(), Broken> {
        let was = self.outputs[block];
        let before = self.plc.group.command().number;
        let highest = self.rules.highest();
        let outputs = self.plc.call(block, self.execute[block], self.mode);
        if outputs.busy && !was.busy {
            self.before[block] = highest;
            self.causes.note_start(block, &self.plc.group);
        }
        let number = self.plc.group.command().number;
        if number != before {
            self.causes.note_start(block, &self.plc.group);
            let motions = match block {
                PROGRAM => program(),
                // Its block makes the motion of engineering units.
                LINE => vec![*self.plc.group.command().slot(0)],
                _ => self.plc.supplies[block].motions.clone(),
            };
            self.rules.commanded(number, motions.iter().map(registers).collect());
        }
        let ended = !outputs.busy && was.busy;
        if let Some(error) = self.plc.error(block)
            && (ended || outputs.error && !was.error)
        {
            let supply = self.plc.supplies.get(block);
            let has_bad =
                supply.is_some_and(|supply| supply.motions.iter().any(|motion| motion.target[2] < LOWEST));
            let Self { causes, rules, plc, outputs: all, mode, .. } = &*self;
            let failure =
                BlockFailure { block, error, group: &plc.group, outputs: all, mode: *mode, has_bad };
            if !causes.explain(&failure, rules) {
                return broken(Rule::Explained, format!("block {block} fails: {error}; {causes:?}"));
            }
        }
        if outputs.done && !was.done && matches!(block, HALT | STOP | DISABLE) {
            self.rules.close(self.before[block], "a halt was done");
        }
        if self.pulses[block] && !outputs.busy {
            (self.execute[block], self.pulses[block]) = (false, false);
        }
        self.outputs[block] = outputs;
        Ok(())
    }

    fn exchange(&mut self, pace: CellPace) {
        let mut image = [0; IMAGE_LEN];
        self.order.emit_command(self.plc.group.command(), &mut image);
        self.commands.push_back(image);
        self.feedbacks.push_back(*self.robot.image());
        let [command_is_stale, feedback_is_stale] = self.stale.map(|stale| stale > 0);
        self.stale = self.stale.map(|stale| stale.saturating_sub(1));
        while self.commands.len() > pace.delays[0] {
            let command = self.commands.pop_front();
            self.command = command.filter(|_| !command_is_stale).unwrap_or(self.command);
        }
        while self.feedbacks.len() > pace.delays[1] {
            let feedback = self.feedbacks.pop_front();
            self.feedback = feedback.filter(|_| !feedback_is_stale).unwrap_or(self.feedback);
        }
    }

    /// Returns what the robot's variables say, for a script that fails.
    pub(crate) fn describe(&self) -> String {
        let names = [
            "state",
            "why",
            "now",
            "request",
            "granted",
            "links",
            "seen_link",
            "connected",
            "number",
            "last",
            "stop",
            "stopping",
            "taken",
            "executed",
            "written",
            "speed",
            "error",
            "override",
        ];
        let values = names.map(|name| format!("{name} {}", self.robot.value(name).unwrap()));
        values.join(", ")
    }

    /// Sets a block until it has ended.
    pub(crate) fn pulse(&mut self, block: usize) {
        (self.execute[block], self.pulses[block]) = (true, true);
    }

    pub(crate) fn set_override(&mut self, percent: f64) {
        self.plc.group.set_override(Override::from_percent(percent).unwrap());
    }

    /// Returns whether a block is under way.
    pub(crate) fn is_busy(&self) -> bool {
        self.outputs.iter().any(|outputs| outputs.busy)
    }

    /// Waits until the robot has followed an image of now: a bit that is cleared for less is not cleared for it.
    pub(crate) fn settle(&mut self, pace: CellPace, draw: &mut impl FnMut(u32) -> u32) -> Result<(), Broken> {
        // Its echo says that it follows this image or a later one, the second echo that it has done so.
        for _ in 0..2 {
            let until = self.plc.group.scans() + 1;
            for _ in 0..4_000 {
                self.scan(pace, draw)?;
                if self.plc.group.has_seen(until) {
                    break;
                }
            }
        }
        Ok(())
    }

    /// Runs one block to its end.
    pub(crate) fn run(
        &mut self,
        block: usize,
        pace: CellPace,
        draw: &mut impl FnMut(u32) -> u32,
    ) -> Result<Outputs, Broken> {
        self.execute[block] = true;
        for _ in 0..40_000 {
            self.scan(pace, draw)?;
            let outputs = self.outputs[block];
            if !outputs.busy {
                self.execute[block] = false;
                self.settle(pace, draw)?;
                return Ok(outputs);
            }
            if block < SKILLS {
                self.plc.supplies[block].available += 1;
            }
        }
        let shown = self.order.parse_feedback(self.robot.image());
        broken(Rule::Recovers, format!("block {block} does not end: {shown:?}"))
    }

    /// Returns whether the robot is enabled, as it shows it.
    pub(crate) fn is_enabled(&self) -> bool {
        let feedback = self.order.parse_feedback(self.robot.image()).unwrap();
        feedback.status.contains(Status::ENABLED)
    }
}

/// Blocks that take motions from a supply.
pub(crate) const SUPPLIED: [usize; 2] = [WAY, OTHER];
