//! Effect of each varied key on each figure, with 95 % intervals over the seeds: jobs of one seed share clocks, phases, pauses and drawn
//! values, so that they are one sample.

use std::collections::BTreeMap;

use records::interval::Mean;
use serde::Serialize;

use crate::engine::axis::Axis;
use crate::engine::identify::algebra::least_squares;
use crate::engine::observations::{JobFigures, Measure, Observations};

/// Parts into which the values of a drawn key are divided for pictures and tables.
const PARTS: usize = 10;

/// A value with half the width of its 95 % interval; without one where there are too few seeds.
#[derive(Clone, Copy, PartialEq, Debug, Serialize)]
pub(crate) struct WithMargin {
    /// The value.
    pub(crate) value: f64,
    /// Half the width of the interval.
    pub(crate) margin: Option<f64>,
}

impl WithMargin {
    /// Returns the mean of values, each with its seed; `None` without one.
    fn of(values: impl Iterator<Item = (u64, f64)>) -> Option<Self> {
        let samples = by_seed(values);
        let value = samples.iter().sum::<f64>() / samples.len() as f64;
        let margin = Mean::of(&samples).map(|mean| mean.margin_ms());
        (!samples.is_empty()).then_some(Self { value, margin })
    }
}

/// Returns the mean of each seed's values.
fn by_seed(values: impl Iterator<Item = (u64, f64)>) -> Vec<f64> {
    let mut sums: BTreeMap<u64, (f64, f64)> = BTreeMap::new();
    for (seed, value) in values {
        let (sum, count) = sums.entry(seed).or_default();
        (*sum, *count) = (*sum + value, *count + 1.0);
    }
    sums.into_values().map(|(sum, count)| sum / count).collect()
}

/// A figure at one value of a key, or in one part of the values that were drawn.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub(crate) struct EffectLevel {
    /// The value; the middle of the part for a drawn key.
    pub(crate) value: String,
    /// The value as a number.
    pub(crate) number: Option<f64>,
    /// Jobs with the figure.
    pub(crate) jobs: usize,
    /// Mean over these jobs.
    pub(crate) mean: WithMargin,
    /// Mean difference from the first value, between jobs that have all else in common, the seed too.
    pub(crate) change: Option<WithMargin>,
}

/// Change of a figure with a drawn key.
#[derive(Clone, Copy, PartialEq, Debug, Serialize)]
pub(crate) struct EffectSlope {
    /// Change of the figure from the lower to the upper bound of the key, where all else is the same.
    pub(crate) over_range: WithMargin,
    /// The same for one unit of the key.
    pub(crate) for_one: WithMargin,
}

/// Effect of one key on one figure.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub(crate) struct FigureEffect {
    /// Execution type; `None` for what compares two.
    #[serde(rename = "type")]
    pub(crate) execution_type: Option<String>,
    /// The figure.
    pub(crate) figure: &'static str,
    /// Its unit.
    pub(crate) unit: &'static str,
    /// The figure by the values of the key.
    pub(crate) levels: Vec<EffectLevel>,
    /// The straight line through a drawn key's values.
    pub(crate) slope: Option<EffectSlope>,
}

/// Effects of one key.
#[derive(Clone, PartialEq, Debug, Serialize)]
pub(crate) struct KeyEffects {
    /// The varied key.
    pub(crate) key: String,
    /// Its values were drawn.
    pub(crate) is_drawn: bool,
    /// Effects on each figure that is not the same everywhere.
    pub(crate) figures: Vec<FigureEffect>,
}

/// Returns the effects of all keys, and the figures that are the same in all jobs.
pub(super) fn effects(axes: &[Axis], observations: &Observations) -> (Vec<KeyEffects>, Vec<String>) {
    let all: Vec<(usize, Measure)> = observations.measures.iter().copied().enumerate().collect();
    let (constant, varying): (Vec<_>, Vec<_>) =
        all.into_iter().partition(|(index, _)| is_constant(observations, *index));
    let keys = axes.iter().enumerate().map(|(key, axis)| {
        let of = |(index, measure): &(usize, Measure)| FigureEffect {
            execution_type: measure.execution_type().map(|one| one.to_string()),
            figure: measure.figure(),
            unit: measure.unit(),
            levels: levels(axes, key, axis, observations, *index),
            slope: slope(axes, key, observations, *index),
        };
        KeyEffects {
            key: axis.path.clone(),
            is_drawn: axis.is_drawn(),
            figures: varying.iter().map(of).collect(),
        }
    });
    let same = |(index, measure): &(usize, Measure)| {
        let value = observations.jobs.iter().find_map(|job| job.measures.get(*index).copied().flatten())?;
        let of_type = measure
            .execution_type()
            .map_or_else(String::new, |one| format!(" of {}", one.to_string().to_uppercase()));
        Some(format!("{}{of_type}: {value} {}", measure.figure(), measure.unit()).trim_end().to_owned())
    };
    (keys.collect(), constant.iter().filter_map(same).collect())
}

/// Jobs, each with one of its figures.
type JobsWithFigure<'a> = Vec<(&'a JobFigures, f64)>;

fn values(observations: &Observations, measure: usize) -> impl Iterator<Item = (&JobFigures, f64)> {
    observations.jobs.iter().filter_map(move |job| Some((job, job.measures.get(measure).copied()??)))
}

fn is_constant(observations: &Observations, measure: usize) -> bool {
    let mut values = values(observations, measure).map(|(_, value)| value);
    let first = values.next();
    values.all(|value| Some(value) == first)
}

fn levels(
    axes: &[Axis],
    key: usize,
    axis: &Axis,
    observations: &Observations,
    measure: usize,
) -> Vec<EffectLevel> {
    if let Some(bounds) = axis.bounds() {
        return parts(key, bounds, observations, measure);
    }
    let mut by_value: BTreeMap<u128, JobsWithFigure<'_>> = BTreeMap::new();
    let numbers: BTreeMap<String, u128> =
        (0..axis.len()).map(|number| (axis.value(number, 0).to_string(), number)).collect();
    for (job, value) in values(observations, measure) {
        if let Some(number) = job.values.get(key).and_then(|text| numbers.get(text)) {
            by_value.entry(*number).or_default().push((job, value));
        }
    }
    // All but this key and what the seed determines.
    let rest = |job: &JobFigures| {
        let others = axes.iter().zip(&job.values).enumerate();
        let others = others.filter(|(index, (axis, _))| *index != key && !axis.is_drawn());
        (job.seed, others.map(|(_, (_, value))| value.clone()).collect::<Vec<_>>())
    };
    let first: BTreeMap<_, f64> =
        by_value.values().next().into_iter().flatten().map(|(job, value)| (rest(job), *value)).collect();
    let level = |(index, (number, jobs)): (usize, (&u128, &JobsWithFigure<'_>))| {
        let text = axis.value(*number, 0).to_string();
        let all = || jobs.iter().map(|(job, value)| (job.seed, *value));
        let change = |(job, value): &(&JobFigures, f64)| Some((job.seed, value - first.get(&rest(job))?));
        Some(EffectLevel {
            number: text.parse().ok(),
            value: text,
            jobs: jobs.len(),
            mean: WithMargin::of(all())?,
            change: WithMargin::of(jobs.iter().filter_map(change)).filter(|_| index > 0),
        })
    };
    by_value.iter().enumerate().filter_map(level).collect()
}

/// Returns the means in equal parts of a drawn key's range.
fn parts(
    key: usize,
    (min, max): (f64, f64),
    observations: &Observations,
    measure: usize,
) -> Vec<EffectLevel> {
    let mut in_parts: Vec<Vec<(u64, f64)>> = vec![Vec::new(); PARTS];
    for (job, value) in values(observations, measure) {
        let drawn = job.values.get(key).and_then(|text| text.parse::<f64>().ok());
        let part = drawn.map(|drawn| ((drawn - min) / (max - min) * PARTS as f64) as usize);
        if let Some(part) = part.and_then(|part| in_parts.get_mut(part.min(PARTS - 1))) {
            part.push((job.seed, value));
        }
    }
    let middle = |index: usize| min + (max - min) * (index as f64 + 0.5) / PARTS as f64;
    let level = |(index, values): (usize, &Vec<(u64, f64)>)| {
        Some(EffectLevel {
            value: format!("{:.6}", middle(index)).trim_end_matches('0').trim_end_matches('.').to_owned(),
            number: Some(middle(index)),
            jobs: values.len(),
            mean: WithMargin::of(values.iter().copied())?,
            change: None,
        })
    };
    in_parts.iter().enumerate().filter_map(level).collect()
}

/// Returns the slope of a drawn key, beside the slopes of all other drawn keys, within each point of the grid.
fn slope(axes: &[Axis], key: usize, observations: &Observations, measure: usize) -> Option<EffectSlope> {
    let (min, max) = axes.get(key)?.bounds()?;
    let drawn: Vec<usize> =
        (0..axes.len()).filter(|index| axes.get(*index).is_some_and(Axis::is_drawn)).collect();
    let mut points: BTreeMap<Vec<&String>, Vec<(u64, Vec<f64>)>> = BTreeMap::new();
    for (job, value) in values(observations, measure) {
        let fixed =
            job.values.iter().enumerate().filter(|(index, _)| !drawn.contains(index)).map(|(_, text)| text);
        let numbers = drawn.iter().filter_map(|index| job.values.get(*index)?.parse::<f64>().ok());
        points.entry(fixed.collect()).or_default().push((job.seed, numbers.chain([value]).collect()));
    }
    // The columns of each seed: the drawn values and the figure, each without the mean of its point.
    let mut columns: Vec<Vec<(u64, f64)>> = vec![Vec::new(); drawn.len() + 1];
    for jobs in points.values() {
        for (column, samples) in columns.iter_mut().enumerate() {
            let own = || jobs.iter().filter_map(move |(seed, row)| Some((*seed, *row.get(column)?)));
            let mean = own().map(|(_, value)| value).sum::<f64>() / jobs.len() as f64;
            samples.extend(own().map(|(seed, value)| (seed, value - mean)));
        }
    }
    let columns: Vec<Vec<f64>> = columns.into_iter().map(|column| by_seed(column.into_iter())).collect();
    let (wanted, drawn_columns) = columns.split_last()?;
    let row = |index| drawn_columns.iter().filter_map(|column| column.get(index).copied()).collect();
    let rows: Vec<Vec<f64>> = (0..wanted.len()).map(row).collect();
    let freedom = rows.len() as f64 - 1.0 - drawn.len() as f64;
    if freedom < 1.0 {
        return None;
    }
    let fit = least_squares(&rows, wanted)?;
    let column = drawn.iter().position(|index| *index == key)?;
    let variance = fit.residuals.iter().map(|residual| residual * residual).sum::<f64>() / freedom;
    let error = (variance * fit.inverse_diagonal.get(column)?).sqrt();
    let line = Mean::with_error(*fit.coefficients.get(column)?, error, freedom);
    let scaled = |scale: f64| WithMargin { value: line.ms * scale, margin: Some(line.margin_ms() * scale) };
    Some(EffectSlope { over_range: scaled(max - min), for_one: scaled(1.0) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::plan::StudyPlan;
    use plc_node::ExecutionType;

    const STUDY: &str = "[study]\nsetup = 'A'\nreps = 1\ntypes = ['cm']\nseeds = '1..=40'
        [[vary]]\nkey = 'bus.cycle_us'\nvalues = [1000, 2000]
        [[vary]]\nkey = 'motions.velocity_percent'\nuniform = { min = 10.0, max = 20.0 }\n";

    /// Jobs of a law: 100, 3 more with the second cycle, 2 for each per cent, and a scatter of the seed.
    fn observed(plan: &StudyPlan) -> Observations {
        let jobs = (0..80_u64).map(|number| {
            let job = plan.job(number.into());
            let values: Vec<String> = job.point.values.iter().map(ToString::to_string).collect();
            let velocity: f64 = values[1].parse().unwrap();
            let cycle = if values[0] == "2000" { 3.0 } else { 0.0 };
            let scatter = [-0.1, 0.1][(job.seed % 2) as usize];
            JobFigures {
                address: number,
                seed: job.seed,
                values,
                measures: vec![Some(100.0 + cycle + 2.0 * velocity + scatter)],
            }
        });
        let measures = vec![Measure::Mean(ExecutionType::Cm, crate::engine::file::RowFigure::ExecutionNs)];
        Observations { measures, jobs: jobs.collect(), failed: 0 }
    }

    #[test]
    fn each_key_has_the_effect_of_the_law_and_its_interval() {
        let plan = StudyPlan::of(toml::from_str(STUDY).unwrap(), None, "test".to_owned())
            .unwrap_or_else(|failure| panic!("{:#}", failure.error));
        let (keys, same) = effects(&plan.axes, &observed(&plan));
        assert!(same.is_empty());
        let change = keys[0].figures[0].levels[1].change.unwrap();
        // Pairs of one seed: the scatter is the same in both.
        assert!((change.value - 3.0).abs() < 1e-9 && change.margin.unwrap() < 1e-6, "{change:?}");
        let slope = keys[1].figures[0].slope.unwrap();
        let (found, margin) = (slope.over_range.value, slope.over_range.margin.unwrap());
        assert!((found - 20.0).abs() < margin && (0.01..0.3).contains(&margin), "{slope:?}");
        assert!(keys[1].figures[0].levels.iter().map(|level| level.jobs).sum::<usize>() == 80);
    }
}
