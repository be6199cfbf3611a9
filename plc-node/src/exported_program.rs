//! The exported code as the program of a PLC: an instance of `SB_Core` in the place of the function blocks, in each scan, also
//! outside of runs. It gets the robot's image as it came, and its command goes out as it is.

mod account;
mod code;

use machine::Instant;
use protocol::image::{Digest, IMAGE_LEN, Image, Order, Sum};
use structured_text::Instance;

use account::RunAccount;
pub use code::{CodeError, ExportedCode, ProgramTrap};

use crate::program::{Led, PlcProgram, Progress, Totals};
use crate::{ExecutionType, FailureCause, MotionSource, Station};

/// Most steps of a scan. The first one builds the table of the check in some 20,000; a scan of a run takes a tenth of that.
const BUDGET: u64 = 200_000;

/// The mode of `SB_Core` in which the arm moves to the start.
const MOVES_TO_START: i64 = 1;

/// The exported code of a PLC with one station.
#[derive(Debug)]
pub struct ExportedProgram {
    code: ExportedCode,
    core: Instance,
    /// The image that the last scan computed.
    command: Image,
    /// Number of the station's scan in which the code ran last.
    scanned: u64,
    /// Why the code executes no more.
    trap: Option<ProgramTrap>,
    is_trap_reported: bool,
    /// TRUE if the code still ran a repetition when the last scan outside of a run began.
    was_busy: bool,
    account: RunAccount,
}

impl ExportedProgram {
    /// Creates the program; `motions` are those of the plan, which the code should send.
    ///
    /// # Errors
    ///
    /// The code has no instance of `SB_Core`.
    pub fn new(code: ExportedCode, motions: Box<dyn MotionSource>) -> Result<Self, CodeError> {
        Ok(Self {
            core: code.instance()?,
            code,
            command: [0; IMAGE_LEN],
            scanned: 0,
            trap: None,
            is_trap_reported: false,
            was_busy: false,
            account: RunAccount::new(motions),
        })
    }

    /// Returns the digest of the motions that the code sent in this run, or in the last one.
    #[must_use]
    pub const fn digest(&self) -> &Digest {
        self.account.digest()
    }

    /// Executes the code once, unless it was executed in this scan already.
    fn execute(&mut self, now: Instant, station: &mut Station, start: Option<ExecutionType>) {
        let scan = station.group().scans();
        if std::mem::replace(&mut self.scanned, scan) == scan {
            return;
        }
        if let Some(feedback) = station.group().feedback() {
            self.account.see_feedback(feedback);
        }
        // A run that the PLC ended is news to the code: without the robot's image it gives the run up.
        let is_busy = start.is_none() && self.is_busy();
        let gives_up = std::mem::replace(&mut self.was_busy, is_busy) && is_busy;
        let feedback = station.received().filter(|_| !gives_up);
        self.set_inputs(now, station, feedback, start);
        let scanned = match self.trap {
            Some(_) => return,
            None => self.core.scan(self.code.program(), BUDGET),
        };
        if let Err(error) = scanned {
            // A PLC that stops sets its outputs to 0: the robot is not enabled any more.
            self.command = [0; IMAGE_LEN];
            self.trap = Some(ProgramTrap::from(error));
            return;
        }
        self.core.get_bytes(self.code.variables().command, &mut self.command);
    }

    fn set_inputs(
        &mut self,
        now: Instant,
        station: &Station,
        feedback: Option<Image>,
        start: Option<ExecutionType>,
    ) {
        let variables = self.code.variables();
        self.core.set_bytes(variables.feedback, &feedback.unwrap_or([0; IMAGE_LEN]));
        let micros = now.as_nanos() / 1_000 % (1 << 32);
        let is_big = station.byte_order() == Order::BigEndian;
        let percent = station.group().command().override_percent;
        let number = start.map_or(0, number_of);
        for (variable, value) in [
            (variables.now_us, i64::try_from(micros).unwrap_or(0)),
            (variables.start, i64::from(start.is_some())),
            (variables.execution_type, number),
            (variables.repetitions, 1),
            (variables.big_endian, i64::from(is_big)),
            (variables.override_percent, i64::from(percent)),
        ] {
            self.core.set(variable, 0, value);
        }
    }

    fn is_set(&self, output: structured_text::Variable) -> bool {
        self.core.get(output, 0) != 0
    }

    fn is_busy(&self) -> bool {
        self.trap.is_none() && self.is_set(self.code.variables().busy)
    }

    fn moves_to_start(&self) -> bool {
        self.code.variables().mode.is_some_and(|mode| self.core.get(mode, 0) == MOVES_TO_START)
    }

    /// Returns why the code ended the run with its `error`.
    fn failure(&self, station: &Station) -> FailureCause {
        let id = self.core.get(self.code.variables().error_id, 0);
        let id = u16::try_from(id).unwrap_or(u16::MAX);
        let feedback = station.group().feedback();
        match feedback.filter(|feedback| (1..0x8000).contains(&id) && u16::from(feedback.error) == id) {
            Some(feedback) => FailureCause::Robot {
                number: feedback.error,
                motion: self.account.motions_before().saturating_add(feedback.error_motion),
                finding: feedback.finding,
            },
            None => FailureCause::Exported(id),
        }
    }
}

/// Returns the number of an execution type at the input of the code.
const fn number_of(execution_type: ExecutionType) -> i64 {
    match execution_type {
        ExecutionType::Rc => 1,
        ExecutionType::Sm => 2,
        ExecutionType::Cm => 3,
    }
}

impl PlcProgram for ExportedProgram {
    fn begin(&mut self, _now: Instant, execution_type: ExecutionType) {
        self.account.begin(execution_type);
        self.was_busy = false;
    }

    fn scan(&mut self, now: Instant, stations: &mut [Station]) -> Progress {
        let Some(station) = stations.first_mut() else { return Progress::Done };
        self.execute(now, station, Some(self.account.execution_type()));
        let command = *station.take_command(&self.command);
        // In the last scan the way back to the start begins; on the way to it nothing belongs to the run.
        if self.is_busy() && !self.moves_to_start() {
            self.account.see_command(&command);
        } else if self.is_busy() {
            self.account.restart();
        }
        if let Some(trap) = self.trap {
            self.is_trap_reported = true;
            return Progress::Ended { station: 0, cause: FailureCause::Trapped(trap) };
        }
        let variables = self.code.variables();
        if self.is_set(variables.error) {
            Progress::Ended { station: 0, cause: self.failure(station) }
        } else if self.is_set(variables.done) {
            Progress::Done
        } else if self.is_busy() {
            Progress::Running
        } else {
            Progress::Ended { station: 0, cause: FailureCause::Exported(0) }
        }
    }

    fn leads(&self) -> bool {
        true
    }

    fn lead(&mut self, now: Instant, stations: &mut [Station]) -> Led {
        let Some(station) = stations.first_mut() else { return Led::Preparing };
        self.execute(now, station, None);
        station.take_command(&self.command);
        match self.trap {
            Some(_) if self.is_trap_reported => Led::Preparing,
            Some(trap) => {
                self.is_trap_reported = true;
                Led::Ended(FailureCause::Trapped(trap))
            }
            None if self.is_set(self.code.variables().ready) => Led::Ready,
            None if self.moves_to_start() => Led::MovingToStart,
            None => Led::Preparing,
        }
    }

    /// The code itself counts the scans in which the robot shows no progress.
    fn waits(&self, _station: usize) -> bool {
        true
    }

    fn totals(&self, _station: usize) -> Totals {
        self.account.totals()
    }

    fn sent(&self, _station: usize) -> Sum {
        self.account.digest().sum()
    }

    fn execution_time_us(&self) -> Option<u64> {
        u64::try_from(self.core.get(self.code.variables().samples, 0)).ok()
    }
}

/// Describes an `error_id` that `SB_Core` adds to those of blocks and robots, and what to do.
pub(crate) fn exported_in_words(error_id: u16) -> String {
    let words = match error_id {
        0 => ": it neither started nor said why; look at `start`, `busy`, `done` and `error` of SB_Core",
        0x8001 => ": no image of the robot; look at its connection",
        0x8101 => ": the robot's life counter stands still; look at its node",
        0x8102 => ": the robot's images are old; look at `robot.cycle_us` and at the network",
        0x8103 => ": the robot was halted",
        0x8104 => ": `execution_type` must be 1 to 3",
        0x8105 => ": `repetitions` must be 1 to 100",
        0x8106 => ": the robot executes a skill and shows no progress; look at its drives",
        0x8107 => ": SB_SelfTest failed; look at its output `failed`",
        _ => ": docs/plcopen.md and docs/hardware-kit.md list them",
    };
    format!("the exported code ended the run with error_id 16#{error_id:04X}{words}")
}
