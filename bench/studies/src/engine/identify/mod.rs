//! Identification of the drawn keys of a study by the paper's figures: their posterior, what only a combination is known of, a predictive check, and
//! the evidence for each point of the grid as a variant of the model.
//!
//! ```text
//! surface    the figures as polynomials of the drawn keys, fitted to the jobs
//! particles  draws from the posterior, and the evidence
//! summary    both as the figures of the report
//! algebra    least squares, normal distributions
//! ```

pub(super) mod algebra;
mod particles;
mod summary;
mod surface;

use std::collections::BTreeMap;

use plc_node::ExecutionType;
use records::schedule::REPETITIONS;
use serde::Serialize;
use setup::Paper;

use super::file::RowFigure;
use super::observations::{JobFigures, Measure, Observations};
use super::plan::StudyPlan;
use particles::posterior;
pub(super) use summary::{DrawnPrior, KeyPair, KeyPosterior, PredictedFigure};
use surface::FigureSurface;

/// Particles of a posterior, and of the posteriors without one of the figures.
const PARTICLES: usize = 1_000;
const PARTICLES_LEFT_OUT: usize = 300;

/// Seed of all draws.
const SEED: u64 = 42;

/// Draws that the report keeps of each posterior.
const KEPT_DRAWS: usize = 300;

/// Least MAD in ms: its logarithm is fitted, and a job without scatter has none.
const LEAST_MAD_MS: f64 = 1e-3;

/// A figure of the paper, as it is compared.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct PaperFigure {
    execution_type: ExecutionType,
    is_mad: bool,
    ms: f64,
}

impl PaperFigure {
    /// Returns the figures of Table 2 for these types.
    fn all(paper: &Paper, types: &[ExecutionType]) -> Vec<Self> {
        let row = |execution_type| match execution_type {
            ExecutionType::Rc => paper.rc,
            ExecutionType::Sm => paper.sm,
            ExecutionType::Cm => paper.cm,
        };
        let of = |is_mad: bool| {
            types.iter().map(move |execution_type| {
                let setup::PaperRow { aet_ms, mad_ms } = row(*execution_type);
                Self { execution_type: *execution_type, is_mad, ms: if is_mad { mad_ms } else { aet_ms } }
            })
        };
        of(false).chain(of(true)).collect()
    }

    fn name(&self) -> String {
        let figure = if self.is_mad { "MAD" } else { "AET" };
        format!("{} {figure}", self.execution_type.to_string().to_uppercase())
    }

    const fn measure(&self) -> Measure {
        if self.is_mad {
            Measure::Mad(self.execution_type)
        } else {
            Measure::Mean(self.execution_type, RowFigure::ExecutionNs)
        }
    }

    /// Returns a figure in ms as it is fitted: a MAD by its logarithm, because its scatter grows with it.
    fn fitted(&self, ms: f64) -> f64 {
        if self.is_mad { libm::log(ms.max(LEAST_MAD_MS)) } else { ms }
    }

    /// Returns a fitted figure in ms.
    fn in_ms(&self, fitted: f64) -> f64 {
        if self.is_mad { libm::exp(fitted) } else { fitted }
    }

    /// Returns the deviation that the paper's rounding adds: to 1 ms, and of a MAD to 0.1 ms.
    fn rounding(&self) -> f64 {
        let evenly = |step: f64| step / 12.0_f64.sqrt();
        if self.is_mad { evenly(0.1) / self.ms.max(0.1) } else { evenly(1.0) }
    }
}

/// One point of the grid as a variant of the model.
#[derive(Clone, Debug, Serialize)]
pub(super) struct ModelVariant {
    /// Values of the grid's keys.
    pub(super) values: Vec<(String, String)>,
    /// Jobs that it was fitted to.
    pub(super) jobs: usize,
    /// Degree of the polynomials.
    pub(super) degree: usize,
    /// Natural logarithm of the evidence.
    pub(super) log_evidence: f64,
    /// Probability among the variants, where each was as likely before.
    pub(super) probability: f64,
    /// Posterior of each drawn key.
    pub(super) posterior: Vec<KeyPosterior>,
    /// Pairs of keys that only their combination is known of.
    pub(super) pairs: Vec<KeyPair>,
    /// Each figure of the paper, predicted from the others.
    pub(super) predicted: Vec<PredictedFigure>,
    /// Draws from the posterior, as values of the keys.
    pub(super) draws: Vec<Vec<f64>>,
}

/// Identification of a study's drawn keys by the paper's figures.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Identification {
    /// The drawn keys with what was plausible before.
    pub(super) priors: Vec<DrawnPrior>,
    /// The variants, in the order of their values.
    pub(super) variants: Vec<ModelVariant>,
}

impl Identification {
    /// Compares the jobs of a study with the paper's figures for its setup.
    ///
    /// # Errors
    ///
    /// Why they cannot be compared, as a sentence.
    pub(super) fn of(plan: &StudyPlan, observations: &Observations) -> Result<Self, String> {
        let paper = plan.base.paper.as_ref();
        let paper = paper.ok_or("Not compared with the paper: its Table 2 has no figures for this setup.")?;
        if plan.file.study.reps != REPETITIONS {
            return Err(format!(
                "Not compared with the paper: a job has {} repetitions, and the paper measured {REPETITIONS}; set reps = {REPETITIONS}.",
                plan.file.study.reps
            ));
        }
        let priors = DrawnPrior::all(plan);
        if priors.is_empty() {
            return Err("No posterior: the study draws no key from `uniform` or `normal`.".to_owned());
        }
        let figures = PaperFigure::all(paper, &plan.types);
        let fitted = by_variant(plan, observations).into_iter().filter_map(|(values, jobs)| {
            let keys = grid(plan).filter_map(|index| plan.axes.get(index)).map(|axis| axis.path.clone());
            variant(keys.zip(values).collect(), &jobs, &priors, &figures, observations)
        });
        let mut variants: Vec<ModelVariant> = fitted.collect();
        let best = variants.iter().map(|variant| variant.log_evidence).fold(f64::NEG_INFINITY, f64::max);
        let sum: f64 = variants.iter().map(|variant| libm::exp(variant.log_evidence - best)).sum();
        variants.iter_mut().for_each(|one| one.probability = libm::exp(one.log_evidence - best) / sum);
        if variants.is_empty() {
            return Err(format!(
                "No posterior yet: {} drawn keys need at least {} jobs that passed at a point of the grid.",
                priors.len(),
                priors.len() + 21
            ));
        }
        Ok(Self { priors, variants })
    }
}

/// Returns the numbers of the keys that form the grid.
fn grid(plan: &StudyPlan) -> impl Iterator<Item = usize> {
    plan.axes.iter().enumerate().filter(|(_, axis)| !axis.is_drawn()).map(|(index, _)| index)
}

fn by_variant<'a>(
    plan: &StudyPlan,
    observations: &'a Observations,
) -> BTreeMap<Vec<String>, Vec<&'a JobFigures>> {
    let mut variants: BTreeMap<Vec<String>, Vec<&JobFigures>> = BTreeMap::new();
    for job in &observations.jobs {
        let values = grid(plan).filter_map(|index| job.values.get(index).cloned());
        variants.entry(values.collect()).or_default().push(job);
    }
    variants
}

fn variant(
    values: Vec<(String, String)>,
    jobs: &[&JobFigures],
    priors: &[DrawnPrior],
    figures: &[PaperFigure],
    observations: &Observations,
) -> Option<ModelVariant> {
    let row = |job: &&JobFigures| {
        let shares = priors.iter().map(|prior| prior.position(job)).collect::<Option<Vec<f64>>>()?;
        let value = |figure: &PaperFigure| {
            let index = observations.index(figure.measure())?;
            job.measures.get(index).copied().flatten().map(|ms| figure.fitted(ms))
        };
        Some((shares, figures.iter().map(value).collect::<Option<Vec<f64>>>()?))
    };
    let (positions, measured): (Vec<_>, Vec<_>) = jobs.iter().filter_map(row).unzip();
    let surface = FigureSurface::fit(&positions, &measured)?;
    let wanted: Vec<f64> = figures.iter().map(|figure| figure.fitted(figure.ms)).collect();
    let rounding: Vec<f64> = figures.iter().map(PaperFigure::rounding).collect();
    // Positions are linear in the values, and particles are shares of the prior.
    let at = |shares: &[f64]| -> Vec<f64> {
        priors.iter().zip(shares).map(|(prior, share)| prior.position_of_share(*share)).collect()
    };
    let of = |left_out: Option<usize>, particles: usize| {
        let likelihood = surface.likelihood(&wanted, &rounding, left_out)?;
        Some(posterior(priors.len(), particles, SEED, |shares| likelihood.log(&at(shares))))
    };
    let whole = of(None, PARTICLES)?;
    let predicted = figures.iter().enumerate().map(|(index, figure)| {
        let without = of(Some(index), PARTICLES_LEFT_OUT)?;
        let fitted: Vec<f64> =
            without.draws.iter().filter_map(|draw| surface.at(&at(draw)).get(index).copied()).collect();
        Some(PredictedFigure::of(figure, &fitted, surface.deviation(index)))
    });
    let predicted = predicted.collect::<Option<Vec<_>>>()?;
    let draws: Vec<Vec<f64>> = whole.draws.iter().map(|draw| DrawnPrior::values(priors, draw)).collect();
    Some(ModelVariant {
        values,
        jobs: positions.len(),
        degree: surface.degree,
        log_evidence: whole.log_evidence,
        probability: 0.0,
        posterior: KeyPosterior::all(priors, &draws),
        pairs: KeyPair::all(priors, &draws),
        predicted,
        draws: draws.into_iter().take(KEPT_DRAWS).collect(),
    })
}
