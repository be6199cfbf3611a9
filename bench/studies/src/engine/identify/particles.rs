//! Draws from a posterior, and its evidence: sequential Monte Carlo from the prior to the posterior (Del Moral, Doucet and Jasra,
//! 2006), with random walks of Metropolis.
//!
//! Shares of the prior are drawn, so that the prior is even from 0 to 1 in each key.

use rand_core::{Rng as _, SeedableRng as _};
use rand_pcg::Pcg64Mcg;

use super::algebra::{Cholesky, covariance};

/// Steps of each particle's walk at each temperature.
const STEPS: usize = 12;

/// Share of the particles that count as independent after a temperature's weights.
const KEPT: f64 = 0.5;

/// Halvings that find the next temperature.
const HALVINGS: u32 = 40;

/// Most temperatures: a likelihood that needs more is far from the prior.
const MOST_TEMPERATURES: usize = 500;

/// Draws from a posterior.
#[derive(Clone, Debug)]
pub(crate) struct Posterior {
    /// The draws: a share of the prior for each key.
    pub(crate) draws: Vec<Vec<f64>>,
    /// Logarithm of the evidence: the mean of the likelihood over the prior.
    pub(crate) log_evidence: f64,
}

/// Draws from the posterior of a likelihood over `keys` shares, always the same for a seed.
pub(crate) fn posterior(
    keys: usize,
    count: usize,
    seed: u64,
    log_likelihood: impl Fn(&[f64]) -> f64,
) -> Posterior {
    let mut random = DrawNumbers(Pcg64Mcg::seed_from_u64(seed));
    let mut draws: Vec<Vec<f64>> = (0..count).map(|_| (0..keys).map(|_| random.share()).collect()).collect();
    let mut logs: Vec<f64> = draws.iter().map(|draw| log_likelihood(draw)).collect();
    let (mut temperature, mut log_evidence) = (0.0, 0.0);
    for _ in 0..MOST_TEMPERATURES {
        let step = next_step(&logs, 1.0 - temperature);
        let (weights, log_mean) = weights(&logs, step);
        temperature += step;
        log_evidence += log_mean;
        let chosen = resampled(&weights, random.share());
        draws = chosen.iter().filter_map(|index| draws.get(*index).cloned()).collect();
        logs = chosen.iter().filter_map(|index| logs.get(*index).copied()).collect();
        walk(&mut draws, &mut logs, temperature, &mut random, &log_likelihood);
        if temperature >= 1.0 {
            break;
        }
    }
    Posterior { draws, log_evidence }
}

/// Returns the largest step of the temperature that keeps enough particles.
fn next_step(logs: &[f64], most: f64) -> f64 {
    let is_kept = |step: f64| {
        let (weights, _) = weights(logs, step);
        let square: f64 = weights.iter().map(|weight| weight * weight).sum();
        1.0 / square >= KEPT * logs.len() as f64
    };
    if is_kept(most) {
        return most;
    }
    let (mut low, mut high) = (0.0, most);
    for _ in 0..HALVINGS {
        let middle = (low + high) / 2.0;
        if is_kept(middle) { low = middle } else { high = middle }
    }
    high
}

/// Returns weights with the sum 1, and the logarithm of the mean weight before.
fn weights(logs: &[f64], step: f64) -> (Vec<f64>, f64) {
    let highest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let raw: Vec<f64> = logs.iter().map(|log| libm::exp(step * (log - highest))).collect();
    let sum: f64 = raw.iter().sum();
    let log_mean = step * highest + libm::log(sum / logs.len() as f64);
    (raw.iter().map(|weight| weight / sum).collect(), log_mean)
}

/// Returns the numbers of as many particles, each as often as its weight says, from one random share.
fn resampled(weights: &[f64], share: f64) -> Vec<usize> {
    let count = weights.len() as f64;
    let (mut chosen, mut sum) = (Vec::with_capacity(weights.len()), 0.0);
    for (index, weight) in weights.iter().enumerate() {
        sum += weight;
        while chosen.len() < weights.len() && (chosen.len() as f64 + share) / count < sum {
            chosen.push(index);
        }
    }
    // The sum of the weights may be a last digit below 1.
    while chosen.len() < weights.len() {
        chosen.push(weights.len() - 1);
    }
    chosen
}

/// Walks each particle at a temperature, with steps as wide as all particles lie.
fn walk(
    draws: &mut [Vec<f64>],
    logs: &mut [f64],
    temperature: f64,
    random: &mut DrawNumbers,
    log_likelihood: &impl Fn(&[f64]) -> f64,
) {
    let (_, mut spread) = covariance(draws);
    let keys = spread.len() as f64;
    for (index, line) in spread.iter_mut().enumerate() {
        // The widest step that a random walk should have (Roberts, Gelman and Gilks, 1997).
        line.iter_mut().for_each(|value| *value *= 2.38 * 2.38 / keys);
        line.iter_mut().skip(index).take(1).for_each(|value| *value += 1e-14);
    }
    let Some(factor) = Cholesky::of(&spread) else { return };
    for (draw, log) in draws.iter_mut().zip(logs) {
        for _ in 0..STEPS {
            let normal: Vec<f64> = draw.iter().map(|_| random.normal()).collect();
            let tried: Vec<f64> =
                draw.iter().zip(factor.times(&normal)).map(|(share, step)| share + step).collect();
            let accepted = random.share();
            if !tried.iter().all(|share| (0.0..=1.0).contains(share)) {
                continue;
            }
            let tried_log = log_likelihood(&tried);
            if accepted < libm::exp(temperature * (tried_log - *log)) {
                (*draw, *log) = (tried, tried_log);
            }
        }
    }
}

/// DrawNumbers numbers that are the same on every machine.
pub(crate) struct DrawNumbers(pub(crate) Pcg64Mcg);

impl DrawNumbers {
    /// Returns a number from 0 to below 1.
    pub(crate) fn share(&mut self) -> f64 {
        (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Returns a standard normal number (Box and Muller, 1958).
    pub(crate) fn normal(&mut self) -> f64 {
        let (radius, turn) = (1.0 - self.share(), self.share());
        (-2.0 * libm::log(radius)).sqrt() * libm::cos(2.0 * std::f64::consts::PI * turn)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_narrow_normal_posterior_has_its_mean_deviation_correlation_and_evidence() {
        // Normal about 0.4 and 0.6, deviations 0.01 and 0.02, correlation 0.8; its evidence is 1, as the density is whole inside.
        let covariance_wanted = [vec![1e-4, 1.6e-4], vec![1.6e-4, 4e-4]];
        let factor = Cholesky::of(&covariance_wanted).unwrap();
        let found = posterior(2, 2_000, 1, |draw| factor.log_density(&[draw[0] - 0.4, draw[1] - 0.6]));
        let (means, matrix) = covariance(&found.draws);
        assert!((means[0] - 0.4).abs() < 0.001 && (means[1] - 0.6).abs() < 0.002, "{means:?}");
        let deviations = [matrix[0][0].sqrt(), matrix[1][1].sqrt()];
        assert!((deviations[0] / 0.01 - 1.0).abs() < 0.08 && (deviations[1] / 0.02 - 1.0).abs() < 0.08);
        let correlation = matrix[0][1] / deviations[0] / deviations[1];
        assert!((correlation - 0.8).abs() < 0.05, "{correlation}");
        assert!(found.log_evidence.abs() < 0.25, "{}", found.log_evidence);
    }

    #[test]
    fn a_key_that_nothing_depends_on_keeps_its_prior() {
        let found = posterior(2, 1_000, 2, |draw| -0.5 * (draw[0] - 0.5) * (draw[0] - 0.5) * 1e6);
        let (means, matrix) = covariance(&found.draws);
        assert!(
            (matrix[1][1].sqrt() / (1.0_f64 / 12.0).sqrt() - 1.0).abs() < 0.1
                && (means[1] - 0.5).abs() < 0.05
        );
    }
}
