//! The figures of a run, derived from its results once for all tables: screen, Markdown, CSV, JUnit and report.

use plc_node::ExecutionType;

use crate::calibrated::{self, SKILL_OVERHEAD};
use crate::results::{Results, TypeResult};
use crate::statistics::{AetMad, aet_improvement};

/// The figures of one execution type.
#[derive(Clone, Copy, Debug)]
pub struct TypeFigures<'a> {
    /// The type.
    pub execution_type: ExecutionType,
    /// Its repetitions.
    pub result: &'a TypeResult,
    /// AET so far, in ms; `None` without samples.
    pub aet_ms: Option<f64>,
    /// MAD so far, in ms; `None` with fewer than two samples.
    pub mad_ms: Option<f64>,
    /// Whether a number of the setup was chosen to meet the paper's AET of this type.
    pub is_aet_calibrated: bool,
    /// Whether a number of the setup was chosen to meet the paper's MAD of this type, and the run has a MAD.
    pub is_mad_calibrated: bool,
    /// AET of the virtual run in which a skill call costs nothing, in ms.
    pub h0_aet_ms: Option<f64>,
    /// MAD of that run, in ms. It has as many repetitions as the run itself.
    pub h0_mad_ms: Option<f64>,
    /// The published figures.
    pub paper: Option<AetMad>,
}

impl TypeFigures<'_> {
    /// Returns the difference of the run's AET and the published one, in ms.
    #[must_use]
    pub fn aet_minus_paper_ms(&self) -> Option<f64> {
        Some(self.aet_ms? - self.paper?.aet_ms)
    }

    /// Returns how many repetitions succeeded.
    #[must_use]
    pub const fn count(&self) -> usize {
        self.result.samples_ms.len()
    }

    /// Returns the number of motions that ended in a stop because the next motion did not arrive in time.
    #[must_use]
    pub fn blends_suppressed(&self) -> u32 {
        self.result.blends_suppressed.iter().sum()
    }
}

/// AETi, the share (0…1) of SM's execution time that CM saves.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Improvement {
    /// That of the run.
    pub own: Option<f64>,
    /// Whether a number of the setup was chosen to meet it.
    pub is_calibrated: bool,
    /// That of the virtual run in which a skill call costs nothing.
    pub h0: Option<f64>,
    /// The published one.
    pub paper: Option<f64>,
}

impl Results {
    /// Returns the figures of each requested type, in the paper's order.
    #[must_use]
    pub fn figures(&self) -> Vec<TypeFigures<'_>> {
        ExecutionType::ALL
            .into_iter()
            .filter_map(|execution_type| self.type_figures(execution_type))
            .collect()
    }

    /// Returns the figures of a type; `None` if it was not requested.
    #[must_use]
    pub fn type_figures(&self, execution_type: ExecutionType) -> Option<TypeFigures<'_>> {
        let result = self.results.get(execution_type)?;
        let mad_ms = result.mad_ms.filter(|_| result.samples_ms.len() > 1);
        let h0 = self.without_skill_overhead.as_ref().and_then(|h0| h0.results.get(execution_type));
        let mad_keys = calibrated::of_mad(execution_type);
        Some(TypeFigures {
            execution_type,
            result,
            aet_ms: result.aet_ms,
            mad_ms,
            is_aet_calibrated: self.is_calibrated(calibrated::of_aet(execution_type)),
            is_mad_calibrated: mad_ms.is_some() && mad_keys.iter().any(|key| self.is_calibrated(key)),
            h0_aet_ms: h0.map(|h0| h0.aet_ms),
            h0_mad_ms: h0.filter(|_| mad_ms.is_some()).map(|h0| h0.mad_ms),
            paper: self.paper.as_ref().and_then(|paper| paper.get(execution_type)).copied(),
        })
    }

    /// Returns AETi of the run, of the run in which a skill call costs nothing, and of the paper.
    #[must_use]
    pub fn improvement(&self) -> Improvement {
        let paper = self.paper.as_ref().and_then(|paper| paper.sm.zip(paper.cm));
        Improvement {
            own: self.aet_improvement,
            is_calibrated: self.aet_improvement.is_some() && self.is_calibrated(SKILL_OVERHEAD),
            h0: self.without_skill_overhead.as_ref().and_then(|h0| h0.aet_improvement),
            paper: paper.map(|(sm, cm)| aet_improvement(sm.aet_ms, cm.aet_ms)),
        }
    }

    /// Returns AET and MAD of a type so far.
    #[must_use]
    pub fn figure(&self, execution_type: ExecutionType) -> Option<AetMad> {
        let result = self.results.get(execution_type)?;
        result.aet_ms.zip(result.mad_ms).map(|(aet_ms, mad_ms)| AetMad { aet_ms, mad_ms })
    }

    /// Returns whether a number of the setup was chosen to reproduce a published figure.
    #[must_use]
    pub fn is_calibrated(&self, key: &str) -> bool {
        self.calibrated.iter().any(|calibrated| calibrated.key == key)
    }

    /// Returns the number of motions of all types that ended in a stop because the next motion did not arrive in time.
    #[must_use]
    pub fn blends_suppressed(&self) -> u32 {
        self.figures().iter().map(TypeFigures::blends_suppressed).sum()
    }
}
