//! One job: a schedule in virtual time, and its rows. All studies execute their runs by it.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Duration;

use plc_node::ExecutionType;
use records::faults::Fault;
use records::schedule::{Schedule, Step};
use records::statistics::AetMad;
use setup::{Cell, Setup};
use stands::planned_cell::PlannedCell;
use stands::planned_station::PlannedStation;
use stands::virtual_run::{execute_each, execute_each_of_cell};

use super::figure;
use super::file::RowFigure;

/// End of a repetition.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum RowStatus {
    /// It was executed as planned.
    Passed,
    /// It failed, and with it the rest of the job.
    Failed,
    /// An earlier repetition of the job failed.
    NotRun,
    /// Setup, application or faults allow no run.
    Refused,
}

impl RowStatus {
    /// Returns the end with this name in the rows.
    #[must_use]
    pub fn of_name(name: &str) -> Option<Self> {
        [Self::Passed, Self::Failed, Self::NotRun, Self::Refused]
            .into_iter()
            .find(|status| status.name() == name)
    }

    /// Returns its name in the rows.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Passed => "passed",
            Self::Failed => "failed",
            Self::NotRun => "not-run",
            Self::Refused => "refused",
        }
    }
}

/// A repetition of a job.
#[derive(Clone, PartialEq, Debug)]
pub struct JobRow {
    /// Its execution type.
    pub execution_type: ExecutionType,
    /// Its number among those of its type, from 1.
    pub repetition: u32,
    /// End of the repetition.
    pub status: RowStatus,
    /// Its figures, in the order in which they were asked for, not a number where one was not measured; none unless it passed.
    pub figures: Vec<f64>,
}

/// The rows of a job, sorted by the name of the type and the repetition.
#[derive(Clone, PartialEq, Debug, Default)]
pub struct JobRows {
    /// The rows.
    pub rows: Vec<JobRow>,
    /// Why the job failed or was refused; empty if it passed.
    pub reason: String,
}

/// Subject of a job: one robot, or several stations.
#[derive(Clone, Copy)]
pub enum JobSubject<'a> {
    /// One robot.
    Robot {
        /// The setup.
        setup: &'a Setup,
        /// The plan of its application.
        planned: &'a PlannedCell,
    },
    /// The stations of a cell.
    Cell {
        /// The setup.
        cell: &'a Cell,
        /// The plan of its applications.
        planned: &'a planning::PlannedCell,
        /// The stations in it.
        stations: &'a [PlannedStation],
    },
}

/// Inputs of a job's execution.
#[derive(Clone, Copy)]
pub struct JobInputs<'a> {
    /// The subject.
    pub subject: JobSubject<'a>,
    /// Types, repetitions and seed.
    pub schedule: &'a Schedule,
    /// Faults.
    pub faults: &'a [Fault],
    /// Figures of each row.
    pub figures: &'a [RowFigure],
}

impl JobInputs<'_> {
    /// Executes the job. Also a failure has its rows, one for each repetition.
    #[must_use]
    pub fn execute(&self) -> JobRows {
        let mut rows = Vec::new();
        // A panic is a fault of this program: one job shows it, and the others go on.
        let ended = catch_unwind(AssertUnwindSafe(|| self.execute_into(&mut rows)));
        let reason = match ended {
            Ok(Ok(())) => String::new(),
            Ok(Err(error)) => format!("{error:#}"),
            Err(panic) => format!("the program panicked: {}", text_of(&*panic)),
        };
        JobRows { rows, reason }.completed(self.schedule)
    }

    /// Executes the job of a study that ends with its first failure.
    ///
    /// # Errors
    ///
    /// A repetition failed, or none could begin.
    pub fn measured(&self) -> anyhow::Result<JobRows> {
        let mut rows = Vec::new();
        self.execute_into(&mut rows)?;
        Ok(JobRows { rows, reason: String::new() }.completed(self.schedule))
    }

    fn execute_into(&self, rows: &mut Vec<JobRow>) -> anyhow::Result<()> {
        let Self { schedule, faults, .. } = self;
        let mut passed = |Step { execution_type, repetition, .. }, value: &dyn Fn(RowFigure) -> f64| {
            let figures = self.figures.iter().map(|figure| value(*figure)).collect();
            rows.push(JobRow { execution_type, repetition, status: RowStatus::Passed, figures });
        };
        match self.subject {
            JobSubject::Robot { setup, planned } => {
                execute_each(setup, planned.clone(), schedule, faults, |step, measured, _| {
                    if let Some(quality) = &measured.quality {
                        quality.check_ratings()?;
                    }
                    passed(step, &|figure| figure::of_robot(figure, measured));
                    Ok(())
                })?;
                Ok(())
            }
            JobSubject::Cell { cell, planned, stations } => {
                execute_each_of_cell((cell, planned, stations), schedule, faults, |step, measured| {
                    passed(step, &|figure| figure::of_cell(figure, measured));
                    Ok(())
                })
            }
        }
    }

    /// Returns the rows of a job that cannot begin.
    #[must_use]
    pub fn refused(schedule: &Schedule, reason: String) -> JobRows {
        let mut rows = JobRows { rows: Vec::new(), reason }.completed(schedule);
        rows.rows.iter_mut().for_each(|row| row.status = RowStatus::Refused);
        rows
    }
}

impl JobRows {
    /// Adds a row for each repetition that did not pass, and sorts them.
    fn completed(mut self, schedule: &Schedule) -> Self {
        let passed = self.rows.len();
        for (index, step) in schedule.steps().enumerate().skip(passed) {
            let status = if index == passed { RowStatus::Failed } else { RowStatus::NotRun };
            let (execution_type, repetition) = (step.execution_type, step.repetition);
            self.rows.push(JobRow { execution_type, repetition, status, figures: Vec::new() });
        }
        self.rows.sort_by_cached_key(|row| (row.execution_type.to_string(), row.repetition));
        self
    }

    /// Returns a figure of all repetitions of a type that passed.
    pub fn figures(
        &self,
        execution_type: ExecutionType,
        index: usize,
    ) -> impl Iterator<Item = f64> + Clone + '_ {
        let of_type = self.rows.iter().filter(move |row| row.execution_type == execution_type);
        of_type.filter_map(move |row| row.figures.get(index).copied())
    }

    /// Returns AET and MAD of a type, where the first figure is the execution time in ns.
    #[must_use]
    pub fn aet_mad(&self, execution_type: ExecutionType) -> Option<AetMad> {
        AetMad::of(self.figures(execution_type, 0).map(|nanos| Duration::from_nanos(nanos as u64)))
    }

    /// Returns the mean of a figure over the repetitions of a type that passed.
    #[must_use]
    pub fn mean(&self, execution_type: ExecutionType, index: usize) -> Option<f64> {
        let count = self.figures(execution_type, index).count();
        (count > 0).then(|| self.figures(execution_type, index).sum::<f64>() / count as f64)
    }
}

/// A job of a study that lists its jobs itself: without faults, with the usual figures.
#[derive(Clone, Debug)]
pub struct ListedJob {
    /// The setup.
    pub setup: Setup,
    /// The plan of its application.
    pub planned: PlannedCell,
    /// Types, repetitions and seed.
    pub schedule: Schedule,
}

impl ListedJob {
    /// Executes the job.
    ///
    /// # Errors
    ///
    /// A repetition failed, or none could begin.
    pub fn measured(&self) -> anyhow::Result<JobRows> {
        let Self { setup, planned, schedule } = self;
        let subject = JobSubject::Robot { setup, planned };
        JobInputs { subject, schedule, faults: &[], figures: &RowFigure::USUAL }.measured()
    }
}

/// Returns the text of a panic.
pub fn text_of(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<String>().cloned();
    text.or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).to_owned()))
        .unwrap_or_else(|| "a panic without a text".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use stands::virtual_run;

    #[test]
    fn a_job_has_the_figures_of_a_whole_virtual_run() {
        let (setup, found) = planning::setup_with_application("A").unwrap();
        let planned = PlannedCell::of(&setup, &found.application).unwrap();
        let schedule = Schedule::new(&ExecutionType::ALL, 2, 5);
        let whole = virtual_run::whole_planned(&setup, planned.clone(), &schedule).unwrap();
        let figures = RowFigure::USUAL;
        let inputs = JobInputs {
            subject: JobSubject::Robot { setup: &setup, planned: &planned },
            schedule: &schedule,
            faults: &[],
            figures: &figures,
        };
        let rows = inputs.measured().unwrap();
        for execution_type in ExecutionType::ALL {
            assert_eq!(rows.aet_mad(execution_type), whole.figure(execution_type));
        }
        assert!(rows.rows.is_sorted_by_key(|row| (row.execution_type.to_string(), row.repetition)));
    }

    #[test]
    fn a_job_that_fails_has_a_row_for_each_repetition_and_its_reason() {
        let (setup, found) = planning::setup_with_application("A").unwrap();
        let planned = PlannedCell::of(&setup, &found.application).unwrap();
        let schedule = Schedule::new(&ExecutionType::ALL, 2, 1);
        let faults = ["cut-at=6s..9s".parse().unwrap()];
        let figures = RowFigure::USUAL;
        let inputs = JobInputs {
            subject: JobSubject::Robot { setup: &setup, planned: &planned },
            schedule: &schedule,
            faults: &faults,
            figures: &figures,
        };
        let JobRows { rows, reason } = inputs.execute();
        let statuses: Vec<_> = rows.iter().map(|row| row.status.name()).collect();
        assert_eq!(rows.len(), 6);
        assert!(
            statuses.contains(&"passed") && statuses.contains(&"failed") && statuses.contains(&"not-run")
        );
        assert!(!reason.is_empty());
    }
}
