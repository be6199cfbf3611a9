//! Finds the value of a number with which the model reproduces figures.
//!
//! An AET changes in steps, because motions start and end with a robot cycle. A step of SM is several cycles long, since
//! SM has many motions of one length. So the figures are measured at a few values around the target. A straight line
//! through them gives the value at which the figures are met, and how much each figure depends on the number. Further
//! measurements find the value near it that meets an AET best.

use anyhow::bail;

use super::metric::Metric;
use records::distance::Estimate;

/// Number of values on either side of the middle one at which the figures are measured; for MADs, which have no steps and
/// need more repetitions, one.
const EITHER_SIDE: i32 = 2;

/// Distance of the outermost measured values from the middle one, in errors of a figure: several steps of an AET.
const REACH: f64 = 8.0;

/// Largest rounding of a value, as a share of the accuracy to which it is known.
const ROUNDED_BY: f64 = 0.5;

/// Width of the search for a value that meets a figure with steps, in errors around the line's value, and number of times
/// that the interval is halved.
const TRIED: f64 = 2.0;
const HALVINGS: usize = 7;

/// Smallest and largest distance of the measured values from the middle one, as shares of the number's value.
const NARROWEST: f64 = 1e-3;
const WIDEST: f64 = 0.25;

/// Largest number of lines for one value.
const ROUNDS: usize = 12;

/// A figure with its wanted value and the error of that.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(super) struct FitTarget {
    /// The figure.
    pub(super) figure: Metric,
    /// The wanted value.
    pub(super) wanted: Estimate,
}

/// The result for a number.
#[derive(Clone, PartialEq, Debug)]
pub struct Fit {
    /// The value that meets the figures best.
    pub value: f64,
    /// How far from it the figures stay within their errors.
    pub known_to: f64,
    /// Change of each figure with the number, in ms by the number's unit.
    pub slopes: Vec<f64>,
}

impl Fit {
    /// Returns the value with no more digits than are known: the one with the fewest that is near enough; `own` where that
    /// is as near and as short. For a figure without steps.
    pub(super) fn rounded(&self, own: f64, finest: f64) -> f64 {
        let near = ROUNDED_BY * self.known_to;
        let short = shorter_and_shorter(finest).find_map(|step| {
            let candidates = [own, step.round(self.value)];
            candidates.into_iter().find(|value| step.has(*value) && (value - self.value).abs() <= near)
        });
        short.unwrap_or(self.value)
    }

    /// Returns a value with which the figure is measured within the error of its target, or as near as it comes: of those
    /// near the step at which the figure passes the target, the one with the fewest digits; `own` where that is as short.
    ///
    /// # Errors
    ///
    /// A measurement fails.
    pub(super) fn measured(
        &self,
        target: FitTarget,
        own: f64,
        finest: f64,
        mut measure: impl FnMut(f64) -> anyhow::Result<f64>,
    ) -> anyhow::Result<f64> {
        let Estimate { ms: wanted, error_ms } = target.wanted;
        let rises = self.slopes.first().is_some_and(|slope| *slope > 0.0);
        let reach = TRIED * self.known_to;
        let (mut low, mut high) = (self.value - reach, self.value + reach);
        let mut nearest = (f64::INFINITY, self.value);
        for _ in 0..HALVINGS {
            let middle = f64::midpoint(low, high);
            let found = measure(middle)?;
            let off = (found - wanted).abs() / error_ms;
            if off < nearest.0 {
                nearest = (off, middle);
            }
            if (found < wanted) == rises { low = middle } else { high = middle }
        }
        let (off, best) = nearest;
        let is_near = |value: f64| (value - best).abs() <= reach;
        for step in shorter_and_shorter(finest) {
            let candidates = [own].into_iter().filter(|own| step.has(*own)).chain(step.beside(best));
            for value in candidates.filter(|value| is_near(*value)) {
                if (measure(value)? - wanted).abs() / error_ms <= off.max(1.0) {
                    return Ok(value);
                }
            }
        }
        Ok(best)
    }
}

/// A power of ten, as factor and divisor: both are exact.
#[derive(Clone, Copy, Debug)]
struct Step {
    factor: f64,
    divisor: f64,
}

impl Step {
    fn round(self, value: f64) -> f64 {
        (value * self.divisor / self.factor).round() * self.factor / self.divisor
    }

    fn has(self, value: f64) -> bool {
        (self.round(value) - value).abs() < 1e-9 * self.factor / self.divisor
    }

    /// Returns its multiples on either side of a value, the nearer one first.
    fn beside(self, value: f64) -> [f64; 2] {
        let (nearer, width) = (self.round(value), self.factor / self.divisor);
        let other = if nearer > value { nearer - width } else { nearer + width };
        [nearer, self.round(other)]
    }
}

/// Returns the powers of ten from ten million down to `finest`.
fn shorter_and_shorter(finest: f64) -> impl Iterator<Item = Step> {
    let power_of_ten = |power: u32| f64::from(10_u32.pow(power));
    let coarse = (0..8).rev().map(move |power| Step { factor: power_of_ten(power), divisor: 1.0 });
    let fine = (1..8).map(move |power| Step { factor: 1.0, divisor: power_of_ten(power) });
    coarse.chain(fine).take_while(move |step| step.factor / step.divisor >= finest * 0.999)
}

/// Finds the value in `lowest..=highest` with which the figures meet their targets best, from `start` on. `measure` returns
/// the figures of a value, in the order of the targets.
///
/// # Errors
///
/// A measurement fails, or the targets are out of reach.
pub(super) fn fit(
    targets: &[FitTarget],
    start: f64,
    (lowest, highest, finest): (f64, f64, f64),
    mut measure: impl FnMut(f64) -> anyhow::Result<Vec<Estimate>>,
) -> anyhow::Result<Fit> {
    let mut middle = start.clamp(lowest, highest);
    let mut half_width = (WIDEST * middle).max(finest);
    for round in 1.. {
        let either_side = if targets.iter().any(|target| target.figure.is_mad()) { 1 } else { EITHER_SIDE };
        let offsets: Vec<f64> = (-either_side..=either_side)
            .map(|step| {
                (middle + half_width * f64::from(step) / f64::from(either_side)).clamp(lowest, highest)
                    - middle
            })
            .collect();
        let mut measured = Vec::new();
        for offset in &offsets {
            measured.push(measure(middle + offset)?);
        }
        let lines: Vec<FittedLine> =
            (0..targets.len()).map(|index| FittedLine::through(&offsets, &measured, index)).collect();
        let Some((offset, error)) = best(targets, &lines) else {
            bail!("the figure does not depend on the number around {middle}");
        };
        let wanted_width = (REACH * error).clamp(NARROWEST * middle, WIDEST * middle).max(2.0 * finest);
        let is_found = offset.abs() <= half_width && half_width <= wanted_width * 1.5;
        if is_found {
            let met = middle + offset;
            let known_to = libm::hypot(error, scatter(&lines));
            if met < lowest - known_to || met > highest + known_to {
                bail!("no value from {lowest} to {highest} meets it; {met:.3} would");
            }
            let slopes = lines.iter().map(|line| line.slope).collect();
            return Ok(Fit { value: met.clamp(lowest, highest), known_to, slopes });
        }
        if round == ROUNDS {
            bail!("no value from {lowest} to {highest} meets it; the last one tried is {middle:.3}");
        }
        // At most twice as far as the line was measured, because the curve bends. The next round measures as far as this step.
        let step = offset.clamp(-2.0 * half_width, 2.0 * half_width);
        middle = (middle + step).clamp(lowest, highest);
        half_width = (2.0 * step.abs()).clamp(wanted_width, (WIDEST * middle).max(wanted_width));
    }
    bail!("no round was made")
}

/// Finds a whole number that is small and that a figure depends on exactly: from its figures at 0 and at 1.
///
/// # Errors
///
/// A measurement fails, or the figures do not depend on the number.
pub(super) fn fit_from_zero(
    targets: &[FitTarget],
    (lowest, highest, finest): (f64, f64, f64),
    mut measure: impl FnMut(f64) -> anyhow::Result<Vec<Estimate>>,
) -> anyhow::Result<Fit> {
    let offsets = [0.0, finest];
    let measured = [measure(lowest)?, measure(lowest + finest)?];
    let lines: Vec<FittedLine> =
        (0..targets.len()).map(|index| FittedLine::through(&offsets, &measured, index)).collect();
    let Some((offset, known_to)) = best(targets, &lines) else {
        bail!("the figure does not depend on the number");
    };
    let slopes = lines.iter().map(|line| line.slope).collect();
    Ok(Fit { value: (lowest + offset).clamp(lowest, highest), known_to, slopes })
}

/// A straight line through what was measured.
#[derive(Clone, Copy, Debug)]
struct FittedLine {
    /// Value at offset 0.
    at_zero: f64,
    slope: f64,
    /// Largest standard error of what was measured.
    error: f64,
    /// Distance of what was measured from the line, as root mean square.
    scatter: f64,
}

impl FittedLine {
    /// Returns the line with the least squares through column `index` of what was measured at these offsets.
    fn through(offsets: &[f64], measured: &[Vec<Estimate>], index: usize) -> Self {
        let count = offsets.len() as f64;
        let column = || measured.iter().filter_map(|values| values.get(index));
        let values: Vec<f64> = column().map(|estimate| estimate.ms).collect();
        let error = column().map(|estimate| estimate.error_ms).fold(0.0, f64::max);
        let mean = |values: &[f64]| values.iter().sum::<f64>() / count;
        let (x, y) = (mean(offsets), mean(&values));
        let products: f64 =
            offsets.iter().zip(&values).map(|(offset, value)| (offset - x) * (value - y)).sum();
        let squares: f64 = offsets.iter().map(|offset| (offset - x) * (offset - x)).sum();
        let slope = if squares > 0.0 { products / squares } else { 0.0 };
        let at_zero = y - slope * x;
        let off = |(offset, value): (&f64, &f64)| value - (at_zero + slope * offset);
        let scatter: f64 = offsets.iter().zip(&values).map(off).map(|off| off * off).sum();
        Self { at_zero, slope, error, scatter: (scatter / count).sqrt() }
    }
}

/// Returns how far a value may be off because the figures go up in steps, which the lines do not show.
fn scatter(lines: &[FittedLine]) -> f64 {
    let by_number = lines.iter().filter(|line| line.slope != 0.0).map(|line| line.scatter / line.slope.abs());
    by_number.fold(f64::INFINITY, f64::min).min(f64::MAX)
}

/// Returns the offset with the least squared errors, and how far from it these grow by one; `None` if no figure depends on
/// the number.
fn best(targets: &[FitTarget], lines: &[FittedLine]) -> Option<(f64, f64)> {
    let (mut weight, mut pull) = (0.0, 0.0);
    for (FitTarget { wanted, .. }, line) in targets.iter().zip(lines) {
        let square = wanted.error_ms * wanted.error_ms + line.error * line.error;
        weight += line.slope * line.slope / square;
        pull += line.slope * (wanted.ms - line.at_zero) / square;
    }
    (weight > 0.0).then(|| (pull / weight, 1.0 / weight.sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use plc_node::ExecutionType;

    fn target(ms: f64, error_ms: f64) -> FitTarget {
        FitTarget { figure: Metric::Aet(ExecutionType::Rc), wanted: Estimate { ms, error_ms } }
    }

    fn exact(ms: f64) -> Estimate {
        Estimate { ms, error_ms: 0.0 }
    }

    #[test]
    fn a_figure_that_falls_in_steps_is_met_from_either_side() {
        // 40,000 ms by the number, in steps of 4 ms, as a robot cycle makes them.
        let measure = |percent: f64| Ok(vec![exact((40_000.0 / percent / 4.0_f64).ceil() * 4.0)]);
        for start in [2.0, 9.0, 40.0, 100.0] {
            let found = fit(&[target(4_000.0, 1.5)], start, (0.5, 100.0, 1e-3), measure).unwrap();
            // Half a step, which the line takes off, is 0.5 % of the slope of 400 ms by the number.
            assert!((found.value - 10.0).abs() < 0.012, "{found:?}");
            // The error of the figure, and the scatter of the steps about the line.
            let known_to = libm::hypot(1.5, 4.0 / 12.0_f64.sqrt()) / 400.0;
            assert!((found.known_to / known_to - 1.0).abs() < 0.2, "{found:?}");
            assert!((found.slopes[0] + 400.0).abs() < 40.0, "{found:?}");
        }
        let refused = fit(&[target(100.0, 1.5)], 10.0, (0.5, 100.0, 1e-3), measure).unwrap_err().to_string();
        assert!(refused.starts_with("no value from 0.5 to 100 meets it"), "{refused}");
        assert!(fit(&[target(1.0, 1.0)], 10.0, (0.5, 100.0, 1e-3), |_| Ok(vec![exact(3.0)])).is_err());
    }

    #[test]
    fn of_two_figures_that_contradict_each_other_the_better_known_one_counts_more() {
        let measure = |value: f64| Ok(vec![exact(value), exact(value)]);
        let found = fit(&[target(10.0, 1.0), target(13.0, 2.0)], 12.0, (0.0, 100.0, 1e-3), measure).unwrap();
        assert!(
            (found.value - 10.6).abs() < 1e-9 && (found.known_to - 0.8_f64.sqrt()).abs() < 1e-9,
            "{found:?}"
        );
    }

    #[test]
    fn a_number_has_as_many_digits_as_are_known() {
        let rounded = |value, known_to, own| Fit { value, known_to, slopes: Vec::new() }.rounded(own, 1e-3);
        assert_eq!(rounded(31.86, 0.2, 1.0), 31.9);
        assert_eq!(rounded(31.86, 0.4, 1.0), 32.0);
        assert_eq!(rounded(7.558_3, 0.004, 1.0), 7.56);
        assert_eq!(rounded(35_072.0, 7_900.0, 1.0), 35_000.0);
        assert_eq!(rounded(38.5, 20.0, 1.0), 40.0);
        // The own one, if it is near and no longer; another one if it is longer or off.
        assert_eq!(rounded(31.86, 0.2, 31.8), 31.8);
        assert_eq!(rounded(31.86, 0.2, 31.815), 31.9);
        assert_eq!(rounded(31.86, 0.2, 31.7), 31.9);
    }

    #[test]
    fn in_a_figure_with_steps_the_shortest_number_is_taken_that_meets_it() {
        // Steps of 16 ms: the line's value lies on the wrong side of one.
        let measure = |value: f64| Ok(if value < 151_730.0 { 6_463.0 } else { 6_479.0 });
        let fit = Fit { value: 151_550.0, known_to: 240.0, slopes: vec![13e-3] };
        let found = |own, wanted| fit.measured(target(wanted, 3.1), own, 1.0, measure).unwrap();
        assert_eq!(found(1.0, 6_477.0), 152_000.0);
        assert_eq!(found(151_452.0, 6_477.0), 152_000.0, "its own one is off");
        // Below the step a hundred is short enough, and where neither side meets the figure the nearer one is taken.
        for wanted in [6_464.0, 6_470.0] {
            let value = found(151_452.0, wanted);
            assert!(value % 100.0 == 0.0 && value < 151_730.0, "{wanted} ms: {value}");
        }
    }
}
