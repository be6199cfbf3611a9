//! The values of one varied key.

use rand_core::{Rng as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;
use sha2::{Digest as _, Sha256};

use super::file::{Normal, Scalar, Uniform, ValueRange, Variation};
use super::key::{FAULTS, InvalidKey, SetupKey, SetupKeys, ValueKind};

/// Least share of a normal distribution that may lie between its bounds: below it, the difference of two probabilities has
/// too few digits to draw from.
const LEAST_SHARE: f64 = 1e-6;

/// Halvings that find a drawn value: more than a double has digits.
const HALVINGS: u32 = 64;

/// Most values of one key.
const MOST_STEPS: u64 = 1_000_000_000_000;

/// A varied key with its values.
#[derive(Clone, PartialEq, Debug)]
pub struct Axis {
    /// Path of the key.
    pub path: String,
    /// The key; `None` for the faults.
    pub key: Option<SetupKey>,
    values: Values,
}

#[derive(Clone, PartialEq, Debug)]
enum Values {
    List(Vec<Scalar>),
    Steps(ValueRange),
    Uniform(Uniform),
    Normal(Normal),
}

/// A varied key that has no usable values.
#[derive(Clone, PartialEq, Debug, thiserror::Error)]
pub enum InvalidVariation {
    /// The key or a value.
    #[error("[[vary]] {0}")]
    Key(InvalidKey),
    /// None or several of the four ways to give values.
    #[error("[[vary]] `{key}`: found {found} of `values`, `range`, `uniform` and `normal`; give exactly one")]
    Ways {
        /// The key.
        key: String,
        /// Number of ways given.
        found: usize,
    },
    /// Values that cannot be used.
    #[error("[[vary]] `{key}`: {problem}")]
    Values {
        /// The key.
        key: String,
        /// Fault and remedy.
        problem: String,
    },
}

// Not `#[from]`, which would also make it the source: then it would be printed twice.
impl From<InvalidKey> for InvalidVariation {
    fn from(error: InvalidKey) -> Self {
        Self::Key(error)
    }
}

impl Axis {
    /// Checks a varied key and its values.
    ///
    /// # Errors
    ///
    /// The key is unknown, or its values cannot be used.
    pub fn of(variation: &Variation, keys: &SetupKeys) -> Result<Self, InvalidVariation> {
        let path = variation.key.clone();
        let problem =
            |problem: &str| InvalidVariation::Values { key: path.clone(), problem: problem.to_owned() };
        let key = if path == FAULTS { None } else { Some(keys.find(&path)?) };
        let Variation { values, range, uniform, normal, .. } = variation;
        let ways = [values.is_some(), range.is_some(), uniform.is_some(), normal.is_some()];
        let found = ways.into_iter().filter(|is_given| *is_given).count();
        if found != 1 {
            return Err(InvalidVariation::Ways { key: path, found });
        }
        let is_number = key.is_some_and(|key| matches!(key.kind, ValueKind::Integer | ValueKind::Number));
        if values.is_none() && !is_number {
            return Err(problem("only a number has a range or a distribution; give `values`"));
        }
        let values = if let Some(list) = values {
            Values::List(checked_list(&path, key, list)?)
        } else if let Some(range) = range {
            Values::Steps(checked_range(*range).map_err(problem)?)
        } else if let Some(Uniform { min, max }) = uniform {
            bounds(*min, *max).map_err(problem)?;
            Values::Uniform(Uniform { min: *min, max: *max })
        } else {
            let normal = normal.as_ref().ok_or_else(|| problem("give its values"))?;
            Values::Normal(checked_normal(*normal).map_err(problem)?)
        };
        let axis = Self { path, key, values };
        if let (Some(key), Values::Steps(range)) = (key, &axis.values) {
            // All steps are whole if the first and the distance are.
            for step in 0..range.steps.min(2) {
                key.value(&axis.path, &Scalar::Number(step_of(range, step)))?;
            }
        }
        Ok(axis)
    }

    /// Returns the number of values in the grid; 1 for a distribution.
    #[must_use]
    pub fn len(&self) -> u128 {
        match &self.values {
            Values::List(values) => values.len() as u128,
            Values::Steps(range) => range.steps.into(),
            Values::Uniform(_) | Values::Normal(_) => 1,
        }
    }

    /// Returns whether each seed has a value of its own.
    #[must_use]
    pub const fn is_drawn(&self) -> bool {
        matches!(self.values, Values::Uniform(_) | Values::Normal(_))
    }

    /// Returns the bounds of a distribution; `None` for values of a grid.
    #[must_use]
    pub const fn bounds(&self) -> Option<(f64, f64)> {
        match &self.values {
            Values::Uniform(Uniform { min, max }) | Values::Normal(Normal { min, max, .. }) => {
                Some((*min, *max))
            }
            Values::List(_) | Values::Steps(_) => None,
        }
    }

    /// Returns the value of a distribution below which this share of it lies; `None` for values of a grid.
    #[must_use]
    pub fn quantile(&self, share: f64) -> Option<f64> {
        match &self.values {
            Values::Uniform(Uniform { min, max }) => Some(min + (max - min) * share),
            Values::Normal(normal) => Some(quantile(normal, share)),
            Values::List(_) | Values::Steps(_) => None,
        }
    }

    /// Returns a value: that with this number in the grid, or the one that is drawn for a seed. A drawn value depends on the key and
    /// the seed alone.
    #[must_use]
    pub fn value(&self, number: u128, seed: u64) -> Scalar {
        let value = match &self.values {
            Values::List(values) => {
                let index = usize::try_from(number).unwrap_or(usize::MAX);
                return values.get(index).cloned().unwrap_or(Scalar::Truth(false));
            }
            Values::Steps(range) => step_of(range, u64::try_from(number).unwrap_or(u64::MAX)),
            Values::Uniform(_) | Values::Normal(_) => {
                self.quantile(share(&self.path, seed)).unwrap_or_default()
            }
        };
        match self.key {
            Some(SetupKey { kind: ValueKind::Integer, .. }) => Scalar::Integer(libm::round(value) as i64),
            _ => Scalar::Number(value),
        }
    }
}

fn checked_list(path: &str, key: Option<SetupKey>, list: &[Scalar]) -> Result<Vec<Scalar>, InvalidVariation> {
    let problem = |problem: String| InvalidVariation::Values { key: path.to_owned(), problem };
    if list.is_empty() {
        return Err(problem("`values` is empty; give at least one".to_owned()));
    }
    let Some(key) = key else {
        let texts = list.iter().all(|value| matches!(value, Scalar::Text(_)));
        let wanted =
            || problem("must be texts in quotes, such as \"loss=0.001\"; \"\" has no fault".to_owned());
        return if texts { Ok(list.to_vec()) } else { Err(wanted()) };
    };
    let values: Vec<Scalar> = list.iter().map(|value| key.value(path, value)).collect::<Result<_, _>>()?;
    for (index, value) in values.iter().enumerate() {
        if values.iter().take(index).any(|earlier| earlier == value) {
            return Err(problem(format!("{value} is given twice; remove one")));
        }
    }
    Ok(values)
}

fn checked_range(range: ValueRange) -> Result<ValueRange, &'static str> {
    bounds(range.from, range.to).or_else(|_| bounds(range.to, range.from))?;
    if (2..=MOST_STEPS).contains(&range.steps) { Ok(range) } else { Err("`steps` must be 2 to 10^12") }
}

fn bounds(min: f64, max: f64) -> Result<(), &'static str> {
    if min.is_finite() && max.is_finite() && min < max {
        Ok(())
    } else {
        Err("the bounds must be two finite numbers, the lower one first")
    }
}

fn checked_normal(normal: Normal) -> Result<Normal, &'static str> {
    bounds(normal.min, normal.max)?;
    if !(normal.mean.is_finite() && normal.sd.is_finite() && normal.sd > 0.0) {
        return Err("`mean` must be finite and `sd` above 0");
    }
    if share_between(&normal) < LEAST_SHARE {
        return Err(
            "less than a millionth of the distribution lies between its bounds; use `uniform`, or wider bounds",
        );
    }
    Ok(normal)
}

fn step_of(range: &ValueRange, step: u64) -> f64 {
    let last = range.steps.saturating_sub(1).max(1) as f64;
    let part = step as f64 / last;
    // Exact at both ends, and the same from either.
    range.from * (1.0 - part) + range.to * part
}

/// Returns a number from 0 to 1 that belongs to a key and a seed.
fn share(path: &str, seed: u64) -> f64 {
    let mut digest = Sha256::new();
    digest.update(b"skillbench study draw\n");
    digest.update(path.as_bytes());
    digest.update(seed.to_le_bytes());
    let start = digest.finalize().iter().take(8).fold(0_u64, |sum, byte| (sum << 8) | u64::from(*byte));
    let mut random = Pcg64Mcg::seed_from_u64(start);
    // The 53 bits that a double holds.
    (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
}

/// Returns the probability that a standard normal value is below `value`.
fn below(value: f64) -> f64 {
    libm::erfc(-value / core::f64::consts::SQRT_2) / 2.0
}

/// Returns the share of a distribution between its bounds. Beyond the mean it is counted from the other end, where the numbers are
/// small and exact.
fn share_between(normal: &Normal) -> f64 {
    mass(normal, normal.max)
}

fn mass(normal: &Normal, up_to: f64) -> f64 {
    let [low, high] = [normal.min, up_to].map(|value| (value - normal.mean) / normal.sd);
    if low > 0.0 { below(-low) - below(-high) } else { below(high) - below(low) }
}

/// Returns the value below which this share of the cut distribution lies.
fn quantile(normal: &Normal, share: f64) -> f64 {
    let wanted = share * share_between(normal);
    let (mut low, mut high) = (normal.min, normal.max);
    for _ in 0..HALVINGS {
        let middle = low + (high - low) / 2.0;
        if mass(normal, middle) < wanted {
            low = middle;
        } else {
            high = middle;
        }
    }
    low + (high - low) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn axis(toml: &str) -> Result<Axis, InvalidVariation> {
        Axis::of(&toml::from_str(toml).unwrap(), &SetupKeys::of(&setup::cell("A").unwrap().0).unwrap())
    }

    #[test]
    fn a_range_has_its_ends_and_a_list_its_values() {
        let range =
            axis("key = 'motions.approximation_mm'\nrange = { from = 0.0, to = 50.0, steps = 6 }").unwrap();
        let values: Vec<_> = (0..range.len()).map(|number| range.value(number, 1)).collect();
        assert_eq!(values, [0.0, 10.0, 20.0, 30.0, 40.0, 50.0].map(Scalar::Number));
        let list = axis("key = 'bus.cycle_us'\nvalues = [1000, 2000]").unwrap();
        assert_eq!(list.value(1, 7), Scalar::Integer(2_000));
    }

    #[test]
    fn draws_depend_on_key_and_seed_alone_and_follow_their_distribution() {
        let normal = "normal = { mean = 50.0, sd = 10.0, min = 40.0, max = 90.0 }";
        let speed = axis(&format!("key = 'motions.velocity_percent'\n{normal}")).unwrap();
        let other = axis(&format!("key = 'motions.acceleration_percent'\n{normal}")).unwrap();
        assert_eq!(speed.value(0, 9), speed.value(5, 9));
        assert_ne!(speed.value(0, 9), speed.value(0, 10));
        assert_ne!(speed.value(0, 9), other.value(0, 9));
        let number = |axis: &Axis, seed| match axis.value(0, seed) {
            Scalar::Number(value) => value,
            other => panic!("{other}"),
        };
        let draws: Vec<f64> = (0..20_000).map(|seed| number(&speed, seed)).collect();
        assert!(draws.iter().all(|value| (40.0..=90.0).contains(value)));
        // Mean of a normal distribution that is cut at -1 and 4: (φ(1) − φ(4)) / (Φ(4) − Φ(−1)) = 0.28745.
        let mean = draws.iter().sum::<f64>() / draws.len() as f64;
        assert!((mean - 52.8745).abs() < 0.25, "{mean}");
        let uniform = axis("key = 'motions.velocity_percent'\nuniform = { min = 10.0, max = 20.0 }").unwrap();
        let mean = (0..20_000).map(|seed| number(&uniform, seed)).sum::<f64>() / 20_000.0;
        assert!((mean - 15.0).abs() < 0.1, "{mean}");
        insta::assert_snapshot!(format!("{} {}", speed.value(0, 1), uniform.value(0, 1)), @"60.89477030314575 18.36041870473163");
    }

    #[test]
    fn a_distribution_far_in_its_tail_is_drawn_from_there() {
        let far = axis(
            "key = 'motions.velocity_percent'\nnormal = { mean = 10.0, sd = 10.0, min = 50.0, max = 100.0 }",
        );
        let far = far.unwrap();
        for seed in 0..1_000 {
            let Scalar::Number(value) = far.value(0, seed) else { panic!("a number") };
            assert!((50.0..90.0).contains(&value), "{value}");
        }
    }

    #[test]
    fn values_that_cannot_be_used_are_refused_with_the_reason() {
        let refused = |toml: &str| axis(toml).unwrap_err().to_string();
        let cases = [
            "key = 'bus.cycle_us'",
            "key = 'bus.cycle_us'\nvalues = []",
            "key = 'bus.cycle_us'\nvalues = [1000]\nrange = { from = 1.0, to = 2.0, steps = 2 }",
            "key = 'bus.cycle_us'\nvalues = [1000, 2000, 1000]",
            "key = 'bus.cycle_us'\nrange = { from = 1000.0, to = 2000.0, steps = 4 }",
            "key = 'bus.kind'\nuniform = { min = 1.0, max = 2.0 }",
            "key = 'motions.velocity_percent'\nuniform = { min = 2.0, max = 1.0 }",
            "key = 'motions.velocity_percent'\nuniform = { min = 2.0, max = inf }",
            "key = 'motions.velocity_percent'\nnormal = { mean = 1.0, sd = 0.0, min = 0.0, max = 1.0 }",
            "key = 'motions.velocity_percent'\nnormal = { mean = 0.0, sd = 1.0, min = 50.0, max = 60.0 }",
            "key = 'motions.velocity_percent'\nrange = { from = 1.0, to = 2.0, steps = 1 }",
            "key = 'faults'\nvalues = [1]",
        ];
        insta::assert_snapshot!(cases.map(refused).join("\n"), @r#"
[[vary]] `bus.cycle_us`: found 0 of `values`, `range`, `uniform` and `normal`; give exactly one
[[vary]] `bus.cycle_us`: `values` is empty; give at least one
[[vary]] `bus.cycle_us`: found 2 of `values`, `range`, `uniform` and `normal`; give exactly one
[[vary]] `bus.cycle_us`: 1000 is given twice; remove one
[[vary]] `bus.cycle_us` = 1333.3333333333335: must be a whole number
[[vary]] `bus.kind`: only a number has a range or a distribution; give `values`
[[vary]] `motions.velocity_percent`: the bounds must be two finite numbers, the lower one first
[[vary]] `motions.velocity_percent`: the bounds must be two finite numbers, the lower one first
[[vary]] `motions.velocity_percent`: `mean` must be finite and `sd` above 0
[[vary]] `motions.velocity_percent`: less than a millionth of the distribution lies between its bounds; use `uniform`, or wider bounds
[[vary]] `motions.velocity_percent`: `steps` must be 2 to 10^12
[[vary]] `faults`: must be texts in quotes, such as "loss=0.001"; "" has no fault
"#);
    }
}
