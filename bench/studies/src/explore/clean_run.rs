//! The run without a fault, and runs of the same cell with faults, each in virtual time, and how they end.

use std::panic::{AssertUnwindSafe, catch_unwind};

use anyhow::Context as _;
use plc_node::ExecutionType;

use super::classes::{Class, Outcome};
use super::explored::{ExploredRun, FaultTarget, RunEnd};
use super::fault::{Extent, FaultTexts, Injected};
use crate::engine::job::text_of;
use records::faults::Fault;
use records::schedule::{PAUSE, Schedule, Step};

/// Runs that can begin while an axis is held for half a second.
const RUNS_WHILE_HELD: usize = 4;

/// The run of an execution type without a fault. Runs with faults are compared with it.
pub(super) struct CleanRun<'a> {
    explored: Box<dyn FaultTarget>,
    seed: u64,
    texts: &'a FaultTexts,
    /// Latest end of a run that is late by a bounded time, in ns.
    late_ns: i64,
    steps: Vec<Step>,
    /// Times of as many repetitions as the longest fault takes.
    executions_ns: Vec<u64>,
    /// Extent that faults are drawn from, at each station.
    pub(super) extents: Vec<Extent>,
}

impl<'a> CleanRun<'a> {
    /// Makes the run without a fault.
    ///
    /// # Errors
    ///
    /// It does not pass, or breaks a law of the cell.
    pub(super) fn of(
        execution_type: ExecutionType,
        explored: &dyn FaultTarget,
        seed: u64,
        texts: &'a FaultTexts,
        late_ms: u32,
        longest_ms: u64,
    ) -> anyhow::Result<Self> {
        let mut run = explored.switch_on(seed, &[])?;
        run.connect()?;
        let first = Schedule::new(&[execution_type], 1, seed);
        let first = first.steps().next().context("a schedule without a run")?;
        let mut executions_ns = vec![execute(&mut *run, first)?];
        let extents = run.extents();
        let repetitions = 1 + repetitions_in(longest_ms, executions_ns.iter().copied());
        let steps: Vec<_> = Schedule::new(&[execution_type], repetitions, seed).steps().collect();
        for step in steps.iter().skip(1) {
            executions_ns.push(execute(&mut *run, *step)?);
        }
        if let Some(law) = run.broken_law() {
            anyhow::bail!("without a fault, {law}");
        }
        let explored = run.rehearsed();
        drop(run);
        Ok(Self {
            explored,
            seed,
            texts,
            late_ns: i64::from(late_ms) * 1_000_000,
            steps,
            executions_ns,
            extents,
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
            let faults: Vec<_> =
                faults.iter().map(|fault| self.texts.fault(fault)).collect::<Result<_, _>>()?;
            self.run(&faults, repetitions)
        });
        match catch_unwind(run) {
            Ok(Ok(outcome)) => outcome,
            Ok(Err(error)) => Outcome::new(Class::Stuck, format!("{error:#}")),
            Err(panic) => Outcome::new(Class::Panicked, text_of(panic.as_ref())),
        }
    }

    fn run(&self, faults: &[Fault], repetitions: u32) -> anyhow::Result<Outcome> {
        let mut run = self.explored.switch_on(self.seed, faults)?;
        let outcome = self.run_on(&mut *run, faults, repetitions);
        // Whatever else it was: no fault may break a law.
        Ok(run.broken_law().map_or(outcome, |law| Outcome::new(Class::LawBroken, law)))
    }

    fn run_on(&self, run: &mut dyn ExploredRun, faults: &[Fault], repetitions: u32) -> Outcome {
        let mut worst = Outcome::new(Class::Same, String::new());
        let mut connected = run.connect();
        for (step, execution_ns) in self.steps.iter().zip(&self.executions_ns).take(repetitions as usize) {
            let end = connected.map_or_else(RunEnd::failed, |()| run.execute(*step));
            connected = Ok(());
            let outcome = match end {
                RunEnd::Passed(found_ns) => self.passed(found_ns, *execution_ns),
                RunEnd::Altered(difference) => Outcome::new(Class::Altered, format!("{difference:#}")),
                RunEnd::NeverEnded(reason) => return Outcome::new(Class::Stuck, format!("{reason:#}")),
                RunEnd::OffPath(reason) | RunEnd::Failed(reason) => {
                    return self.refused(run, *step, faults, &format!("{reason:#}"));
                }
            };
            if (outcome.class, outcome.later_ns) > (worst.class, worst.later_ns) {
                worst = outcome;
            }
        }
        worst
    }

    fn passed(&self, found_ns: u64, execution_ns: u64) -> Outcome {
        let signed = |nanos: u64| i64::try_from(nanos).unwrap_or(i64::MAX);
        let later_ns = signed(found_ns) - signed(execution_ns);
        let (class, reason) = match later_ns {
            0 => (Class::Same, ""),
            later_ns if later_ns <= self.late_ns => (Class::Late, ""),
            _ => (Class::TooLate, "the run ended too late"),
        };
        Outcome { later_ns, ..Outcome::new(class, reason.to_owned()) }
    }

    /// Checks whether a run passes after one that was refused. Each further fault may fail one more run, and an axis that is
    /// held every run that begins meanwhile.
    fn refused(&self, run: &mut dyn ExploredRun, step: Step, faults: &[Fault], reason: &str) -> Outcome {
        if !self.explored.is_located(reason) {
            return Outcome::new(Class::LawBroken, format!("the failure names no station: {reason}"));
        }
        let mut again = || match run.recover() {
            Ok(()) => run.execute(step).into_error(),
            Err(error) => Some(error),
        };
        let most: usize =
            faults.iter().map(|fault| if fault.is_of_drive() { RUNS_WHILE_HELD } else { 1 }).sum();
        let attempts: Vec<_> = (0..most).map_while(|_| again()).collect();
        match attempts.get(most.saturating_sub(1)) {
            None => Outcome::new(Class::Refused, reason.to_owned()),
            Some(then) => Outcome::new(Class::Stuck, format!("{reason}; and then no run passes: {then:#}")),
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

/// Executes a step that has to pass; returns its time in ns.
fn execute(run: &mut dyn ExploredRun, step: Step) -> anyhow::Result<u64> {
    match run.execute(step) {
        RunEnd::Passed(execution_ns) => Ok(execution_ns),
        other => Err(other.into_error().context("a run that failed without a reason")?),
    }
}

/// Returns how many repetitions surely take so long, if each takes at least the shortest of these times and its pause.
fn repetitions_in(ms: u64, executions_ns: impl Iterator<Item = u64>) -> u32 {
    let shortest_ns = executions_ns.min().unwrap_or(0) + PAUSE.as_nanos() as u64;
    u32::try_from((ms * 1_000_000).div_ceil(shortest_ns)).unwrap_or(u32::MAX)
}
