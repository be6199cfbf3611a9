//! A program that is chosen when the PLC starts: the paper's sequences, or exported code.

use machine::{Duration, Instant};
use protocol::image::{Digest, Sum};

use crate::exported_program::ExportedProgram;
use crate::program::{AfterLoss, Led, PlcProgram, Progress, SetOut, Totals};
use crate::{ArmInStep, ExecutionType, FailureCause, MarkPassage, Sequences, StartError, Station};

/// The program of a PLC.
#[derive(Debug)]
pub enum AnyProgram {
    /// The function blocks of this crate.
    Sequences(Sequences),
    /// The exported code, executed.
    Exported(Box<ExportedProgram>),
}

/// Calls a method of the program that is there.
macro_rules! of_program {
    ($self:ident, $program:ident => $call:expr) => {
        match $self {
            AnyProgram::Sequences($program) => $call,
            AnyProgram::Exported($program) => $call,
        }
    };
}

impl AnyProgram {
    /// Returns the digest of the motions that were sent to a station in this run, or in the last one.
    #[must_use]
    pub fn digest(&self, station: usize) -> Digest {
        match self {
            Self::Sequences(program) => program.digest(station).copied().unwrap_or_default(),
            Self::Exported(program) => *program.digest(),
        }
    }

    /// Returns the sequences; `None` where exported code is the program.
    #[must_use]
    pub const fn sequences(&self) -> Option<&Sequences> {
        match self {
            Self::Sequences(program) => Some(program),
            Self::Exported(_) => None,
        }
    }
}

impl From<Sequences> for AnyProgram {
    fn from(program: Sequences) -> Self {
        Self::Sequences(program)
    }
}

impl From<ExportedProgram> for AnyProgram {
    fn from(program: ExportedProgram) -> Self {
        Self::Exported(Box::new(program))
    }
}

impl PlcProgram for AnyProgram {
    fn check(&self, execution_type: ExecutionType, stations: &[Station]) -> Result<(), StartError> {
        of_program!(self, program => program.check(execution_type, stations))
    }

    fn keep_in_step(&mut self, arms: Vec<ArmInStep>) {
        of_program!(self, program => program.keep_in_step(arms));
    }

    fn set_out(&mut self, station: usize, stations: &[Station]) -> SetOut {
        of_program!(self, program => program.set_out(station, stations))
    }

    fn begin(&mut self, now: Instant, execution_type: ExecutionType) {
        of_program!(self, program => program.begin(now, execution_type));
    }

    fn scan(&mut self, now: Instant, stations: &mut [Station]) -> Progress {
        of_program!(self, program => program.scan(now, stations))
    }

    fn leads(&self) -> bool {
        of_program!(self, program => program.leads())
    }

    fn lead(&mut self, now: Instant, stations: &mut [Station]) -> Led {
        of_program!(self, program => program.lead(now, stations))
    }

    fn lose(&mut self, station: usize, cause: FailureCause) -> AfterLoss {
        of_program!(self, program => program.lose(station, cause))
    }

    fn waits(&self, station: usize) -> bool {
        of_program!(self, program => program.waits(station))
    }

    fn marks(&self, station: usize) -> [u32; 2] {
        of_program!(self, program => program.marks(station))
    }

    fn passages(&self, station: usize) -> &[MarkPassage] {
        of_program!(self, program => program.passages(station))
    }

    fn waited_for_zones(&self, station: usize) -> Option<Duration> {
        of_program!(self, program => program.waited_for_zones(station))
    }

    fn totals(&self, station: usize) -> Totals {
        of_program!(self, program => program.totals(station))
    }

    fn sent(&self, station: usize) -> Sum {
        of_program!(self, program => program.sent(station))
    }

    fn execution_time_us(&self) -> Option<u64> {
        of_program!(self, program => program.execution_time_us())
    }
}
