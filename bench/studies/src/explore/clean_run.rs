//! The run without a fault, and runs of the same cell with faults, each in virtual time, and how they end.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

use anyhow::Context as _;
use plc_node::ExecutionType;
use setup::Setup;

use super::classes::{Class, Outcome};
use super::fault::{Extent, Injected, Lengths};
use records::conditions::Measured;
use records::faults::Fault;
use records::mode::Mode;
use records::schedule::{PAUSE, Schedule, Step};
use stands::planned_cell::PlannedCell;
use stands::verification::{DriveDeviation, Verification};
use stands::virtual_run::{Extras, NeverEnded, VirtualRun};

/// Runs that can begin while an axis is held for half a second.
const RUNS_WHILE_HELD: usize = 4;

/// The run of an execution type without a fault. Runs with faults are compared with it.
pub(super) struct CleanRun<'a> {
    setup: &'a Setup,
    planned: &'a PlannedCell,
    seed: u64,
    lengths: Lengths,
    /// Latest end of a run that is late by a bounded time, in ns.
    late_ns: i64,
    steps: Vec<Step>,
    verification: Verification,
    /// Times of as many repetitions as the longest fault takes.
    executions_ns: Vec<u64>,
    /// What faults are drawn from.
    pub(super) extent: Extent,
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
        longest_ms: u64,
    ) -> anyhow::Result<Self> {
        let mut verification = Verification::of(setup, planned.clone(), Mode::Virtual, &[])?;
        let mut run = VirtualRun::switch_on(setup, planned.clone(), seed, &Extras::default())?;
        run.connect()?;
        let first = Schedule::new(&[execution_type], 1, seed);
        let measured = run.execute_unrecorded(first.steps().next().context("a schedule without a run")?)?;
        verification.check(&measured)?;
        let extent = Extent {
            frames: run.frames_sent(),
            run_us: run.since_ready().as_micros().try_into().unwrap_or(u64::MAX),
            axes: planned.robot.arm.axes() as u64,
        };
        let mut executions_ns = vec![measured.execution.execution_time_ns];
        let repetitions = 1 + repetitions_in(longest_ms, executions_ns.iter().copied());
        let steps: Vec<_> = Schedule::new(&[execution_type], repetitions, seed).steps().collect();
        for step in steps.iter().skip(1) {
            let measured = run.execute_unrecorded(*step)?;
            verification.clone().check(&measured)?;
            executions_ns.push(measured.execution.execution_time_ns);
        }
        Ok(Self {
            setup,
            planned,
            seed,
            lengths,
            late_ns: i64::from(late_ms) * 1_000_000,
            steps,
            verification,
            executions_ns,
            extent,
        })
    }

    pub(super) fn execution_type(&self) -> ExecutionType {
        self.steps.first().map_or(ExecutionType::Rc, |step| step.execution_type)
    }

    /// Returns the number of repetitions until these faults have acted.
    pub(super) fn repetitions(&self, faults: &[Injected]) -> u32 {
        let lasts_ms = faults.iter().map(Injected::lasts_ms).max().unwrap_or(0);
        1 + repetitions_in(lasts_ms, self.executions_ns.iter().copied())
    }

    /// Makes the run with these faults.
    pub(super) fn with(&self, faults: &[Injected]) -> Outcome {
        let run = AssertUnwindSafe(|| {
            let repetitions = self.repetitions(faults);
            let faults = faults.iter().map(|fault| fault.fault(self.lengths)).collect::<Result<_, _>>()?;
            self.run(faults, repetitions)
        });
        match catch_unwind(run) {
            Ok(Ok(outcome)) => outcome,
            Ok(Err(error)) => Outcome::new(Class::Stuck, format!("{error:#}")),
            Err(panic) => Outcome::new(Class::Panicked, text_of(panic.as_ref())),
        }
    }

    fn run(&self, faults: Vec<Fault>, repetitions: u32) -> anyhow::Result<Outcome> {
        let extras = Extras { faults, ..Extras::default() };
        let mut run = VirtualRun::switch_on(self.setup, self.planned.clone(), self.seed, &extras)?;
        let mut worst = Outcome::new(Class::Same, String::new());
        let mut connected = run.connect();
        for (step, execution_ns) in self.steps.iter().zip(&self.executions_ns).take(repetitions as usize) {
            let ended = connected.and_then(|()| run.execute_unrecorded(*step));
            connected = Ok(());
            let outcome = match ended {
                Ok(measured) => match self.verify(&measured, &extras.faults) {
                    Ok(()) => self.passed(&measured, *execution_ns),
                    // The fault moved the arm off its path, and the run says so.
                    Err(deviation) if deviation.is::<DriveDeviation>() && moves_drives(&extras.faults) => {
                        return Ok(self.refused(run, *step, &extras.faults, &deviation));
                    }
                    Err(difference) => Outcome::new(Class::Altered, format!("{difference:#}")),
                },
                Err(reason) if reason.is::<NeverEnded>() => {
                    return Ok(Outcome::new(Class::Stuck, reason.to_string()));
                }
                Err(reason) => return Ok(self.refused(run, *step, &extras.faults, &reason)),
            };
            if (outcome.class, outcome.later_ns) > (worst.class, worst.later_ns) {
                worst = outcome;
            }
        }
        Ok(worst)
    }

    fn passed(&self, measured: &Measured, execution_ns: u64) -> Outcome {
        let signed = |nanos: u64| i64::try_from(nanos).unwrap_or(i64::MAX);
        let later_ns = signed(measured.execution.execution_time_ns) - signed(execution_ns);
        let (class, reason) = match later_ns {
            0 => (Class::Same, ""),
            later_ns if later_ns <= self.late_ns => (Class::Late, ""),
            _ => (Class::TooLate, "the run ended too late"),
        };
        Outcome { later_ns, ..Outcome::new(class, reason.to_owned()) }
    }

    fn verify(&self, measured: &Measured, faults: &[Fault]) -> anyhow::Result<()> {
        self.verification.clone().check(measured).or_else(|_| {
            // A frame that is held back may delay a call.
            Verification::of(self.setup, self.planned.clone(), Mode::Virtual, faults)?.check(measured)
        })
    }

    /// Checks whether a run passes after one that was refused. Each further fault may fail one more run, and an axis that is
    /// held every run that begins meanwhile.
    fn refused(&self, mut run: VirtualRun, step: Step, faults: &[Fault], reason: &anyhow::Error) -> Outcome {
        let mut again = || {
            run.recover()?;
            let measured = run.execute_unrecorded(step)?;
            self.verify(&measured, faults)
        };
        let most: usize =
            faults.iter().map(|fault| if fault.is_of_drive() { RUNS_WHILE_HELD } else { 1 }).sum();
        let attempts: Vec<_> = (0..most).map_while(|_| again().err()).collect();
        match attempts.get(most.saturating_sub(1)) {
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

/// Returns how many repetitions surely take so long, if each takes at least the shortest of these times and its pause.
fn repetitions_in(ms: u64, executions_ns: impl Iterator<Item = u64>) -> u32 {
    let shortest_ns = executions_ns.min().unwrap_or(0) + PAUSE.as_nanos() as u64;
    u32::try_from((ms * 1_000_000).div_ceil(shortest_ns)).unwrap_or(u32::MAX)
}

fn moves_drives(faults: &[Fault]) -> bool {
    faults.iter().any(Fault::is_of_drive)
}

fn text_of(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().cloned();
    text.or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_owned()))
        .unwrap_or_else(|| "a panic without a text".to_owned())
}
