//! Figures over many seeds, and the paper's value of each.

use planning::Application;
use plc_node::ExecutionType;
use setup::{Paper, Setup};

use crate::engine::job::{JobRows, ListedJob};
use crate::engine::listed::ListedStudy;
use records::distance::Estimate;
use records::schedule::{REPETITIONS, Schedule};
use records::statistics::{error_of_mad, error_of_mean};
use stands::planned_cell::PlannedCell;

/// A figure of Table 2, or what follows from two of them.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Metric {
    /// Average execution time of a type.
    Aet(ExecutionType),
    /// Mean absolute deviation of a type.
    Mad(ExecutionType),
    /// AET of CM less that of RC.
    CmMinusRc,
}

impl Metric {
    /// All figures, in the order in which they are shown.
    pub const ALL: [Self; 7] = [
        Self::Aet(ExecutionType::Rc),
        Self::Aet(ExecutionType::Sm),
        Self::Aet(ExecutionType::Cm),
        Self::Mad(ExecutionType::Rc),
        Self::Mad(ExecutionType::Sm),
        Self::Mad(ExecutionType::Cm),
        Self::CmMinusRc,
    ];

    /// Returns its name, such as `RC AET`.
    #[must_use]
    pub fn name(self) -> String {
        match self {
            Self::Aet(execution_type) => format!("{} AET", execution_type.to_string().to_uppercase()),
            Self::Mad(execution_type) => format!("{} MAD", execution_type.to_string().to_uppercase()),
            Self::CmMinusRc => "CM − RC".to_owned(),
        }
    }

    /// Returns the paper's figure, with the standard error that its 25 repetitions leave.
    #[must_use]
    pub fn of_paper(self, paper: &Paper) -> Estimate {
        let row = |execution_type| match execution_type {
            ExecutionType::Rc => paper.rc,
            ExecutionType::Sm => paper.sm,
            ExecutionType::Cm => paper.cm,
        };
        match self {
            Self::Aet(execution_type) => {
                let setup::PaperRow { aet_ms, mad_ms } = row(execution_type);
                Estimate { ms: aet_ms, error_ms: error_of_mean(mad_ms, REPETITIONS).unwrap_or(0.0) }
            }
            Self::Mad(execution_type) => {
                let ms = row(execution_type).mad_ms;
                Estimate { ms, error_ms: error_of_mad(ms, REPETITIONS, REPETITIONS).unwrap_or(0.0) }
            }
            Self::CmMinusRc => {
                let [cm, rc] = [ExecutionType::Cm, ExecutionType::Rc]
                    .map(|execution_type| Self::Aet(execution_type).of_paper(paper));
                cm.less(rc)
            }
        }
    }

    /// Returns its execution types.
    const fn types(self) -> &'static [ExecutionType] {
        match self {
            Self::Aet(ExecutionType::Rc) | Self::Mad(ExecutionType::Rc) => &[ExecutionType::Rc],
            Self::Aet(ExecutionType::Sm) | Self::Mad(ExecutionType::Sm) => &[ExecutionType::Sm],
            Self::Aet(ExecutionType::Cm) | Self::Mad(ExecutionType::Cm) => &[ExecutionType::Cm],
            Self::CmMinusRc => &[ExecutionType::Rc, ExecutionType::Cm],
        }
    }

    /// Returns whether it is a MAD, which depends on the number of repetitions; a mean does not.
    pub(super) const fn is_mad(self) -> bool {
        matches!(self, Self::Mad(_))
    }
}

/// Measures figures of setups with one application, over many seeds.
#[derive(Clone, Copy)]
pub struct Seeds<'a> {
    /// What is executed.
    pub application: &'a Application,
    /// First seed.
    pub first: u64,
    /// How many seeds.
    pub count: u32,
    /// Repetitions of each type and seed.
    pub reps: u32,
    /// Executes the runs, and keeps them where it has a directory.
    pub study: &'a ListedStudy<'a>,
}

/// An interrupt came before a figure was complete.
#[derive(thiserror::Error, Clone, Copy, Debug)]
#[error("interrupted")]
pub(super) struct Interrupted;

/// Repetitions of each seed if only means are needed: more seeds then improve the estimate more than more repetitions.
const MEAN_REPETITIONS: u32 = 5;

impl Seeds<'_> {
    /// Returns the mean of each figure over the seeds, with its standard error.
    ///
    /// # Errors
    ///
    /// A run fails, or an interrupt ends them.
    pub fn measure(&self, setup: &Setup, figures: &[Metric]) -> anyhow::Result<Vec<Estimate>> {
        let needs_mad = figures.iter().any(|figure| figure.is_mad());
        let reps = if needs_mad { self.reps } else { self.reps.min(MEAN_REPETITIONS) };
        let types: Vec<_> = figures.iter().flat_map(|figure| figure.types()).copied().collect();
        let seeds: Vec<u64> =
            (0..u64::from(self.count)).map(|index| self.first.wrapping_add(index)).collect();
        let planned = PlannedCell::of(setup, self.application)?;
        let listed = seeds.iter().map(|seed| ListedJob {
            setup: setup.clone(),
            planned: planned.clone(),
            schedule: Schedule::new(&types, reps, *seed),
        });
        let values = |rows: JobRows| {
            let value = |figure: &Metric| {
                let measured = |execution_type| rows.aet_mad(execution_type);
                match *figure {
                    Metric::Aet(execution_type) => measured(execution_type).map(|found| found.aet_ms),
                    Metric::Mad(execution_type) => measured(execution_type).map(|found| found.mad_ms),
                    Metric::CmMinusRc => measured(ExecutionType::Cm)
                        .zip(measured(ExecutionType::Rc))
                        .map(|(cm, rc)| cm.aet_ms - rc.aet_ms),
                }
            };
            figures.iter().map(|figure| value(figure).unwrap_or(f64::NAN)).collect::<Vec<f64>>()
        };
        let runs = self.study.measured(&listed.collect::<Vec<_>>())?;
        let runs: Vec<_> =
            runs.into_iter().map(|rows| rows.map(values)).collect::<Option<_>>().ok_or(Interrupted)?;
        let column = |index: usize| runs.iter().filter_map(move |values| values.get(index).copied());
        Ok((0..figures.len()).map(|index| estimate(&column(index).collect::<Vec<_>>())).collect())
    }
}

/// Returns the mean of values and its standard error, which is 0 for one value.
fn estimate(values: &[f64]) -> Estimate {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let squares: f64 = values.iter().map(|value| (value - mean) * (value - mean)).sum();
    let error = if values.len() > 1 { (squares / (count - 1.0) / count).sqrt() } else { 0.0 };
    Estimate { ms: mean, error_ms: error }
}
