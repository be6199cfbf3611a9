//! The run without a fault, and runs of the same cell with faults, each in virtual time, and how they end.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

use anyhow::Context as _;
use plc_node::ExecutionType;
use setup::Setup;

use super::classes::{Class, Outcome};
use super::fault::{Injected, Lengths};
use records::conditions::Measured;
use records::faults::Fault;
use records::mode::Mode;
use records::schedule::{Schedule, Step};
use stands::planned_cell::PlannedCell;
use stands::verification::Verification;
use stands::virtual_run::{Extras, NeverEnded, VirtualRun};

/// The run of an execution type without a fault. Runs with faults are compared with it.
pub(super) struct CleanRun<'a> {
    setup: &'a Setup,
    planned: &'a PlannedCell,
    seed: u64,
    lengths: Lengths,
    /// Latest end of a run that is late by a bounded time, in ns.
    late_ns: i64,
    step: Step,
    verification: Verification,
    execution_ns: u64,
    /// Frames to the robot and to the PLC.
    pub(super) frames: [u64; 2],
}

impl<'a> CleanRun<'a> {
    /// Makes the run without a fault.
    ///
    /// # Errors
    ///
    /// It does not pass.
    pub(super) fn of(
        execution_type: ExecutionType,
        setup: &'a Setup,
        planned: &'a PlannedCell,
        seed: u64,
        lengths: Lengths,
        late_ms: u32,
    ) -> anyhow::Result<Self> {
        let step =
            Schedule::new(&[execution_type], 1, seed).steps().next().context("a schedule without a run")?;
        let mut verification = Verification::of(setup, planned.clone(), Mode::Virtual, &[])?;
        let mut run = VirtualRun::switch_on(setup, planned.clone(), seed, &Extras::default())?;
        run.connect()?;
        let measured = run.execute_unrecorded(step)?;
        verification.check(&measured)?;
        Ok(Self {
            setup,
            planned,
            seed,
            lengths,
            late_ns: i64::from(late_ms) * 1_000_000,
            step,
            verification,
            execution_ns: measured.execution.execution_time_ns,
            frames: run.frames_sent(),
        })
    }

    pub(super) const fn execution_type(&self) -> ExecutionType {
        self.step.execution_type
    }

    /// Makes the run with these faults.
    pub(super) fn with(&self, faults: &[Injected]) -> Outcome {
        let run = AssertUnwindSafe(|| {
            let faults = faults.iter().map(|fault| fault.fault(self.lengths)).collect::<Result<_, _>>()?;
            self.run(faults)
        });
        match catch_unwind(run) {
            Ok(Ok(outcome)) => outcome,
            Ok(Err(error)) => Outcome::new(Class::Stuck, format!("{error:#}")),
            Err(panic) => Outcome::new(Class::Panicked, text_of(panic.as_ref())),
        }
    }

    fn run(&self, faults: Vec<Fault>) -> anyhow::Result<Outcome> {
        let extras = Extras { faults, ..Extras::default() };
        let mut run = VirtualRun::switch_on(self.setup, self.planned.clone(), self.seed, &extras)?;
        let ended = run.connect().and_then(|()| run.execute_unrecorded(self.step));
        match ended {
            Ok(measured) => Ok(self.passed(&measured, &extras.faults)),
            Err(reason) if reason.is::<NeverEnded>() => Ok(Outcome::new(Class::Stuck, reason.to_string())),
            Err(reason) => Ok(self.refused(run, &extras.faults, &reason)),
        }
    }

    fn passed(&self, measured: &Measured, faults: &[Fault]) -> Outcome {
        let signed = |nanos: u64| i64::try_from(nanos).unwrap_or(i64::MAX);
        let later_ns = signed(measured.execution.execution_time_ns) - signed(self.execution_ns);
        match self.verify(measured, faults) {
            Err(difference) => Outcome::new(Class::Altered, format!("{difference:#}")),
            Ok(()) if later_ns == 0 => Outcome::new(Class::Same, String::new()),
            Ok(()) if later_ns <= self.late_ns => {
                Outcome { later_ns, ..Outcome::new(Class::Late, String::new()) }
            }
            Ok(()) => {
                Outcome { later_ns, ..Outcome::new(Class::TooLate, "the run ended too late".to_owned()) }
            }
        }
    }

    fn verify(&self, measured: &Measured, faults: &[Fault]) -> anyhow::Result<()> {
        self.verification.clone().check(measured).or_else(|_| {
            // A frame that is held back may delay a call.
            Verification::of(self.setup, self.planned.clone(), Mode::Virtual, faults)?.check(measured)
        })
    }

    /// Checks whether a run passes after one that was refused. Each further fault may fail one more run.
    fn refused(&self, mut run: VirtualRun, faults: &[Fault], reason: &anyhow::Error) -> Outcome {
        let mut again = || {
            run.recover()?;
            let measured = run.execute_unrecorded(self.step)?;
            self.verify(&measured, faults)
        };
        let attempts: Vec<_> = faults.iter().map_while(|_| again().err()).collect();
        match attempts.get(faults.len().saturating_sub(1)) {
            None => Outcome::new(Class::Refused, format!("{reason:#}")),
            Some(then) => Outcome::new(Class::Stuck, format!("{reason:#}; and then no run passes: {then:#}")),
        }
    }

    /// Returns the fewest of these faults with which a run still ends in this class.
    pub(super) fn shrunk(&self, faults: &[Injected], class: Class) -> Vec<Injected> {
        let mut fewest = faults.to_vec();
        let mut index = 0;
        while fewest.len() > 1 && index < fewest.len() {
            let mut fewer = fewest.clone();
            fewer.remove(index);
            if self.with(&fewer).class == class {
                fewest = fewer;
            } else {
                index += 1;
            }
        }
        fewest
    }
}

fn text_of(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().cloned();
    text.or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_owned()))
        .unwrap_or_else(|| "a panic without a text".to_owned())
}
