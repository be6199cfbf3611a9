//! The rows of a study as figures of each job.

use std::path::{Path, PathBuf};
use std::time::Duration;

use plc_node::ExecutionType;
use records::statistics::{AetMad, aet_improvement};

use super::file::RowFigure;
use super::lines::fields;
use super::plan::StudyPlan;
use super::rows::{Columns, SavedJob, Tail, read};

/// Fields of a row before its figures.
const BEFORE_FIGURES: usize = 4;

/// A figure of a job.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Measure {
    /// Mean of a row's figure over the repetitions of a type; a time is in ms.
    Mean(ExecutionType, RowFigure),
    /// Mean absolute deviation of the execution time of a type, in ms.
    Mad(ExecutionType),
    /// AETi: the share of SM's time that CM saves, in %.
    Improvement,
}

impl Measure {
    /// Returns all figures of a study's jobs.
    fn all(plan: &StudyPlan) -> Vec<Self> {
        let of_figure = |figure: RowFigure| plan.types.iter().map(move |one| Self::Mean(*one, figure));
        let (first, rest) = plan.figures.split_at(1.min(plan.figures.len()));
        let mut all: Vec<Self> = first.iter().copied().flat_map(of_figure).collect();
        if plan.file.study.reps > 1 {
            all.extend(plan.types.iter().map(|one| Self::Mad(*one)));
        }
        if [ExecutionType::Sm, ExecutionType::Cm].iter().all(|one| plan.types.contains(one)) {
            all.push(Self::Improvement);
        }
        all.extend(rest.iter().copied().flat_map(of_figure));
        all
    }

    /// Returns its type; `None` for what compares two.
    pub(crate) const fn execution_type(self) -> Option<ExecutionType> {
        match self {
            Self::Mean(execution_type, _) | Self::Mad(execution_type) => Some(execution_type),
            Self::Improvement => None,
        }
    }

    /// Returns the name of its figure, without the type.
    pub(crate) const fn figure(self) -> &'static str {
        match self {
            Self::Mean(_, RowFigure::ExecutionNs) => "AET",
            Self::Mean(_, RowFigure::RobotExecutionNs) => "execution time by the robot",
            Self::Mean(_, RowFigure::BlendsSuppressed) => "blends suppressed",
            Self::Mean(_, RowFigure::FramesLost) => "frames lost",
            Self::Mean(_, RowFigure::ImagesAltered) => "images altered",
            Self::Mean(_, RowFigure::PathLengthMm) => "path length",
            Self::Mean(_, RowFigure::PathDeviationMm) => "path deviation",
            Self::Mean(_, RowFigure::JointSpeed) => "joint speed",
            Self::Mean(_, RowFigure::JointAcceleration) => "joint acceleration",
            Self::Mean(_, RowFigure::JointJerk) => "joint jerk",
            Self::Mean(_, RowFigure::StartSkewUs) => "start skew",
            Self::Mean(_, RowFigure::MarkSkewUs) => "mark skew",
            Self::Mean(_, RowFigure::RelativePoseMm) => "relative pose",
            Self::Mad(_) => "MAD",
            Self::Improvement => "AETi",
        }
    }

    /// Returns its unit; empty for a count or a share.
    pub(crate) const fn unit(self) -> &'static str {
        match self {
            Self::Mean(_, figure) if matches!(figure.unit().as_bytes(), b"ns") => "ms",
            Self::Mean(_, figure) => figure.unit(),
            Self::Mad(_) => "ms",
            Self::Improvement => "%",
        }
    }

    fn of(self, plan: &StudyPlan, rows: &[PassedRow]) -> Option<f64> {
        let of_type = |wanted: ExecutionType| rows.iter().filter(move |row| row.execution_type == wanted);
        let nanos = |row: &PassedRow| row.figures.first().copied().unwrap_or_default();
        let aet_mad = |wanted| {
            AetMad::of(
                of_type(wanted)
                    .map(|row| Duration::from_nanos(nanos(row) as u64))
                    .collect::<Vec<_>>()
                    .into_iter(),
            )
        };
        match self {
            Self::Mean(wanted, RowFigure::ExecutionNs) => aet_mad(wanted).map(|found| found.aet_ms),
            Self::Mad(wanted) => aet_mad(wanted).map(|found| found.mad_ms),
            Self::Improvement => {
                let [sm, cm] = [ExecutionType::Sm, ExecutionType::Cm].map(aet_mad);
                Some(aet_improvement(sm?.aet_ms, cm?.aet_ms) * 100.0)
            }
            Self::Mean(wanted, figure) => {
                let index = plan.figures.iter().position(|one| *one == figure)?;
                // An empty field is one that was not measured.
                let value = |row: &PassedRow| row.figures.get(index).copied().filter(|value| !value.is_nan());
                let values: Vec<f64> = of_type(wanted).filter_map(value).collect();
                let scale = if figure.unit() == "ns" { 1e-6 } else { 1.0 };
                (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64 * scale)
            }
        }
    }
}

/// A repetition that passed.
struct PassedRow {
    execution_type: ExecutionType,
    figures: Vec<f64>,
}

/// A job with its figures.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct JobFigures {
    /// Its address.
    pub(super) address: u64,
    /// Its seed.
    pub(crate) seed: u64,
    /// Value of each varied key.
    pub(crate) values: Vec<String>,
    /// Its figures, in the order of the measures; none if it did not pass.
    pub(crate) measures: Vec<Option<f64>>,
}

/// The jobs of a study with their figures, sorted by address.
#[derive(Clone, PartialEq, Debug)]
pub(crate) struct Observations {
    /// Figures of each job.
    pub(crate) measures: Vec<Measure>,
    /// The jobs.
    pub(crate) jobs: Vec<JobFigures>,
    /// Jobs that did not pass.
    pub(crate) failed: usize,
}

impl Observations {
    /// Reads the rows of all directories of a study.
    pub(crate) fn read(plan: &StudyPlan, directories: &[PathBuf]) -> anyhow::Result<Self> {
        let mut observations = Self { measures: Measure::all(plan), jobs: Vec::new(), failed: 0 };
        for directory in directories {
            observations.read_directory(plan, directory)?;
        }
        // The same sums whatever the order in which the jobs ended.
        observations.jobs.sort_unstable_by_key(|job| job.address);
        Ok(observations)
    }

    fn read_directory(&mut self, plan: &StudyPlan, directory: &Path) -> anyhow::Result<()> {
        read(directory, &Columns::of(plan), Tail::MayBeCut, |job| {
            let is_failed = job.is_failed();
            self.failed += usize::from(is_failed);
            let rows: Vec<PassedRow> = job.rows.iter().filter_map(|row| passed_row(row)).collect();
            let of = |measure: &Measure| measure.of(plan, &rows).filter(|_| !is_failed);
            self.jobs.push(JobFigures {
                address: job.address.0,
                seed: seed_of(job),
                values: values_of(job.line),
                measures: self.measures.iter().map(of).collect(),
            });
        })?;
        Ok(())
    }

    /// Returns the number of a figure among the measures.
    pub(crate) fn index(&self, measure: Measure) -> Option<usize> {
        self.measures.iter().position(|one| *one == measure)
    }
}

fn seed_of(job: &SavedJob<'_>) -> u64 {
    let first = job.rows.first().and_then(|row| row.split(',').nth(1));
    first.and_then(|seed| seed.parse().ok()).unwrap_or_default()
}

/// Returns the values of the varied keys in a job's line: what is between its address and its reason.
fn values_of(line: &str) -> Vec<String> {
    let mut values = fields(line);
    values.pop();
    values.drain(..1.min(values.len()));
    values
}

fn passed_row(row: &str) -> Option<PassedRow> {
    let fields: Vec<&str> = row.trim_end().split(',').collect();
    let status = BEFORE_FIGURES + RowFigure::USUAL.len();
    (fields.get(status) == Some(&"passed")).then_some(())?;
    let figures = fields.iter().enumerate().skip(BEFORE_FIGURES).filter(|(index, _)| *index != status);
    Some(PassedRow {
        execution_type: fields.get(2)?.parse().ok()?,
        figures: figures.map(|(_, field)| field.parse().unwrap_or(f64::NAN)).collect(),
    })
}
