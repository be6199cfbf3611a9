//! Priors, posteriors and predictions as figures of the report.

use serde::Serialize;

use super::PaperFigure;
use super::algebra::covariance;
use crate::engine::axis::Axis;
use crate::engine::observations::JobFigures;
use crate::engine::plan::StudyPlan;

/// Ends of a 95 % interval.
const ENDS: [f64; 2] = [0.025, 0.975];

/// Points at which the deviation of a prior is computed.
const POINTS: u32 = 2_000;

/// Correlation from which only a combination of two keys is known.
const BOUND_TOGETHER: f64 = 0.8;

/// A drawn key with what was plausible before the paper's figures.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub(crate) struct DrawnPrior {
    /// The key.
    pub(crate) key: String,
    /// Lowest value.
    pub(crate) min: f64,
    /// Highest value.
    pub(crate) max: f64,
    /// Standard deviation.
    pub(crate) deviation: f64,
    /// Ends of the 95 % interval.
    pub(crate) interval: [f64; 2],
    #[serde(skip)]
    axis: Axis,
    #[serde(skip)]
    column: usize,
}

impl DrawnPrior {
    /// Returns the drawn keys of a study.
    pub(super) fn all(plan: &StudyPlan) -> Vec<Self> {
        let of = |(column, axis): (usize, &Axis)| {
            let (min, max) = axis.bounds()?;
            let at = |share: f64| axis.quantile(share).unwrap_or(min);
            let values: Vec<Vec<f64>> =
                (0..POINTS).map(|point| vec![at((f64::from(point) + 0.5) / f64::from(POINTS))]).collect();
            let variance = covariance(&values).1.first().and_then(|line| line.first().copied());
            Some(Self {
                key: axis.path.clone(),
                min,
                max,
                deviation: variance.unwrap_or_default().sqrt(),
                interval: ENDS.map(at),
                axis: axis.clone(),
                column,
            })
        };
        plan.axes.iter().enumerate().filter_map(of).collect()
    }

    /// Returns where a job's value lies between the bounds, 0 to 1.
    pub(super) fn position(&self, job: &JobFigures) -> Option<f64> {
        let value: f64 = job.values.get(self.column)?.parse().ok()?;
        Some((value - self.min) / (self.max - self.min))
    }

    /// Returns the value below which this share of the prior lies.
    fn value(&self, share: f64) -> f64 {
        self.axis.quantile(share).unwrap_or(self.min)
    }

    /// Returns where the value of a share lies between the bounds, 0 to 1.
    pub(super) fn position_of_share(&self, share: f64) -> f64 {
        (self.value(share) - self.min) / (self.max - self.min)
    }

    /// Returns the values of a draw.
    pub(super) fn values(priors: &[Self], shares: &[f64]) -> Vec<f64> {
        priors.iter().zip(shares).map(|(prior, share)| prior.value(*share)).collect()
    }
}

/// Knowledge of a key: its posterior beside its prior.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Knowledge {
    /// The posterior is at most a quarter as wide as the prior.
    Identified,
    /// It is narrower than the prior.
    Partly,
    /// It is as wide as the prior.
    NotIdentified,
}

impl Knowledge {
    fn of(ratio: f64) -> Self {
        match ratio {
            narrow if narrow <= 0.25 => Self::Identified,
            wide if wide >= 0.75 => Self::NotIdentified,
            _ => Self::Partly,
        }
    }

    /// Returns it in words.
    pub(crate) const fn text(self) -> &'static str {
        match self {
            Self::Identified => "identified",
            Self::Partly => "partly",
            Self::NotIdentified => "not identified",
        }
    }
}

/// Posterior of a drawn key.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub(crate) struct KeyPosterior {
    /// The key.
    pub(crate) key: String,
    /// Mean.
    pub(crate) mean: f64,
    /// Standard deviation.
    pub(crate) deviation: f64,
    /// Ends of the 95 % interval.
    pub(crate) interval: [f64; 2],
    /// Its deviation by that of the prior.
    pub(crate) ratio: f64,
    /// Knowledge of the key.
    pub(crate) knowledge: Knowledge,
}

impl KeyPosterior {
    /// Returns the posteriors of all keys.
    pub(super) fn all(priors: &[DrawnPrior], draws: &[Vec<f64>]) -> Vec<Self> {
        let (means, spread) = covariance(draws);
        let of = |(index, (prior, mean)): (usize, (&DrawnPrior, &f64))| {
            let variance = spread.get(index).and_then(|line| line.get(index)).copied().unwrap_or_default();
            let ratio = variance.sqrt() / prior.deviation;
            Self {
                key: prior.key.clone(),
                mean: *mean,
                deviation: variance.sqrt(),
                interval: ends(draws.iter().filter_map(|draw| draw.get(index).copied())),
                ratio,
                knowledge: Knowledge::of(ratio),
            }
        };
        priors.iter().zip(&means).enumerate().map(of).collect()
    }
}

/// Two keys of which the paper's figures know a combination only.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub(crate) struct KeyPair {
    /// The keys.
    pub(crate) keys: [String; 2],
    /// Correlation of their posteriors.
    pub(crate) correlation: f64,
}

impl KeyPair {
    /// Returns the pairs with a high correlation.
    pub(super) fn all(priors: &[DrawnPrior], draws: &[Vec<f64>]) -> Vec<Self> {
        let (_, spread) = covariance(draws);
        let at = |row: usize, column: usize| {
            spread.get(row).and_then(|line| line.get(column)).copied().unwrap_or_default()
        };
        let mut pairs = Vec::new();
        for (second, one) in priors.iter().enumerate() {
            for (first, other) in priors.iter().enumerate().take(second) {
                let correlation = at(first, second) / (at(first, first) * at(second, second)).sqrt();
                if correlation.abs() >= BOUND_TOGETHER {
                    pairs.push(Self { keys: [other.key.clone(), one.key.clone()], correlation });
                }
            }
        }
        pairs
    }
}

/// A figure of the paper beside its prediction from the others.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub(crate) struct PredictedFigure {
    /// The figure.
    pub(crate) figure: String,
    /// The paper's value in ms.
    pub(crate) paper_ms: f64,
    /// Middle of the prediction in ms.
    pub(crate) predicted_ms: f64,
    /// Ends of its 95 % interval in ms: what the parameters leave open, and the scatter of a measurement.
    pub(crate) interval_ms: [f64; 2],
    /// Difference of the paper's value from the prediction in deviations of the latter; for a MAD of their logarithms.
    pub(crate) deviations: f64,
    /// The paper's value is in the interval.
    pub(crate) is_within: bool,
}

impl PredictedFigure {
    /// Compares a figure with predictions of it, each with the scatter of a measurement.
    pub(super) fn of(figure: &PaperFigure, fitted: &[f64], scatter: f64) -> Self {
        let rows: Vec<Vec<f64>> = fitted.iter().map(|value| vec![*value]).collect();
        let (means, spread) = covariance(&rows);
        let mean = means.first().copied().unwrap_or_default();
        let variance = spread.first().and_then(|line| line.first()).copied().unwrap_or_default();
        let rounding = figure.rounding();
        let deviation = (variance + scatter * scatter + rounding * rounding).sqrt();
        // The scatter is normal, and where the parameters leave much open their draws show the shape.
        let [low, high] = ends(fitted.iter().copied());
        let own = 1.96 * libm::hypot(scatter, rounding);
        let [below, above] = [mean - low, high - mean].map(|half| libm::hypot(half, own));
        let interval_ms = [mean - below, mean + above].map(|value| figure.in_ms(value));
        Self {
            figure: figure.name(),
            paper_ms: figure.ms,
            predicted_ms: figure.in_ms(mean),
            interval_ms,
            deviations: (figure.fitted(figure.ms) - mean) / deviation,
            is_within: (interval_ms[0]..=interval_ms[1]).contains(&figure.ms),
        }
    }
}

fn ends(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().saturating_sub(1) as f64;
    ENDS.map(|share| sorted.get(libm::round(share * last) as usize).copied().unwrap_or_default())
}
