//! How far a run is from the paper, in standard errors.
//!
//! Run and paper are both samples of a few repetitions, so a difference has no meaning without its standard error. The
//! paper's error follows from its MADs, the run's from its own; for MADs see [`error_of_mad`]. The formulas are those of
//! a normal distribution.

use plc_node::ExecutionType;

use crate::figures::TypeFigures;
use crate::results::Results;
use crate::schedule::REPETITIONS;
use crate::statistics::{AetMad, error_of_mad, error_of_mean};

/// Number of standard errors beyond which a figure counts as not reproduced; by chance, one figure of twenty is.
pub const REPRODUCED_WITHIN: f64 = 2.0;

/// Fewest repetitions of each type from which an error is derived.
const FEWEST: usize = 5;

/// A figure with its standard error, in ms.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Estimate {
    /// The figure.
    pub ms: f64,
    /// Its standard error.
    pub error_ms: f64,
}

impl Estimate {
    /// Subtracts another estimate; the errors are independent.
    #[must_use]
    pub fn less(self, other: Self) -> Self {
        Self { ms: self.ms - other.ms, error_ms: libm::hypot(self.error_ms, other.error_ms) }
    }
}

/// A figure of a run beside the paper's.
#[derive(Clone, PartialEq, Debug)]
pub struct Distance {
    /// Its name, such as `CM − RC`.
    pub figure: String,
    /// The paper's.
    pub paper: Estimate,
    /// The run's.
    pub run: Estimate,
    /// Whether a number of the setup was chosen to meet it.
    pub is_calibrated: bool,
}

impl Distance {
    /// Returns how far the run is from the paper, in standard errors of the difference.
    #[must_use]
    pub fn in_errors(&self) -> f64 {
        let Estimate { ms, error_ms } = self.run.less(self.paper);
        ms / error_ms
    }

    /// Returns whether the difference is too large to be by chance.
    #[must_use]
    pub fn is_too_large(&self) -> bool {
        self.in_errors().abs() > REPRODUCED_WITHIN
    }
}

/// Returns the distance of each figure that the paper has: AETs, MADs, and the difference of CM's and RC's AETs. Empty if
/// the run is not compared with the paper; a type of fewer than five repetitions, or without scatter, is left out.
#[must_use]
pub fn distances(results: &Results) -> Vec<Distance> {
    let of_types: Vec<OfType> = results.figures().iter().filter_map(OfType::new).collect();
    let aets = of_types.iter().map(OfType::aet);
    let mads = of_types.iter().filter_map(OfType::mad);
    let find = |wanted| of_types.iter().find(|of_type| of_type.execution_type == wanted);
    let cm_and_rc = find(ExecutionType::Cm).zip(find(ExecutionType::Rc));
    let difference = cm_and_rc.map(|(cm, rc)| Distance {
        figure: "CM − RC".to_owned(),
        paper: cm.paper_aet.less(rc.paper_aet),
        run: cm.run_aet.less(rc.run_aet),
        is_calibrated: cm.is_aet_calibrated,
    });
    aets.chain(mads).chain(difference).collect()
}

/// One type of a run and of the paper.
struct OfType {
    execution_type: ExecutionType,
    count: u32,
    paper: AetMad,
    run: AetMad,
    paper_aet: Estimate,
    run_aet: Estimate,
    is_aet_calibrated: bool,
    is_mad_calibrated: bool,
}

impl OfType {
    fn new(figures: &TypeFigures<'_>) -> Option<Self> {
        let paper = figures.paper?;
        let mad_ms = figures.mad_ms.filter(|mad_ms| *mad_ms > 0.0)?;
        let run = AetMad { aet_ms: figures.aet_ms?, mad_ms };
        let count = u32::try_from(figures.count()).ok().filter(|_| figures.count() >= FEWEST)?;
        let estimate = |AetMad { aet_ms, mad_ms }, count| {
            Some(Estimate { ms: aet_ms, error_ms: error_of_mean(mad_ms, count)? })
        };
        Some(Self {
            execution_type: figures.execution_type,
            count,
            paper,
            run,
            paper_aet: estimate(paper, REPETITIONS)?,
            run_aet: estimate(run, count)?,
            is_aet_calibrated: figures.is_aet_calibrated,
            is_mad_calibrated: figures.is_mad_calibrated,
        })
    }

    fn aet(&self) -> Distance {
        Distance {
            figure: format!("{} AET", self.execution_type.to_string().to_uppercase()),
            paper: self.paper_aet,
            run: self.run_aet,
            is_calibrated: self.is_aet_calibrated,
        }
    }

    /// Returns the distance of the MAD. The standard error of a MAD is proportional to the MAD; both errors are computed
    /// from the run's MAD, which the paper's repetitions would have if they came from the model.
    fn mad(&self) -> Option<Distance> {
        let error = |count| error_of_mad(self.run.mad_ms, self.count, count);
        Some(Distance {
            figure: format!("{} MAD", self.execution_type.to_string().to_uppercase()),
            paper: Estimate { ms: self.paper.mad_ms, error_ms: error(REPETITIONS)? },
            run: Estimate { ms: self.run.mad_ms, error_ms: error(self.count)? },
            is_calibrated: self.is_mad_calibrated,
        })
    }
}
