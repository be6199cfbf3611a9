//! The figures as polynomials of the drawn keys, fitted to the jobs of a study.

use super::algebra::{Cholesky, Matrix, covariance, least_squares};

/// Highest degree of a polynomial.
const HIGHEST_DEGREE: usize = 3;

/// Jobs beyond the number of coefficients that a degree needs: fewer do not show its errors.
const JOBS_BEYOND: usize = 20;

/// Figures as polynomials of shares: 0 and 1 are the bounds of each key.
#[derive(Clone, Debug)]
pub(crate) struct FigureSurface {
    /// Degree in all keys together.
    pub(crate) degree: usize,
    /// Coefficients of each figure.
    coefficients: Vec<Vec<f64>>,
    /// Covariance of the differences of a job from the polynomials that are fitted to all others. A job is the paper's measurement
    /// once, so this is also the scatter of that measurement.
    pub(crate) scatter: Matrix,
    powers: Vec<Vec<usize>>,
}

impl FigureSurface {
    /// Fits polynomials to jobs: `shares` and `figures` have a row for each. The degree is the one that predicts left-out jobs best.
    /// `None` with too few jobs.
    pub(crate) fn fit(shares: &[Vec<f64>], figures: &[Vec<f64>]) -> Option<Self> {
        let degrees = (1..=HIGHEST_DEGREE).filter_map(|degree| Self::of_degree(degree, shares, figures));
        let quality = |surface: &Self| {
            (0..surface.scatter.len())
                .map(|index| libm::log(surface.deviation(index).max(1e-12)))
                .sum::<f64>()
        };
        degrees.min_by(|one, other| quality(one).total_cmp(&quality(other)))
    }

    fn of_degree(degree: usize, shares: &[Vec<f64>], figures: &[Vec<f64>]) -> Option<Self> {
        let powers = powers(shares.first()?.len(), degree);
        if shares.len() < powers.len() + JOBS_BEYOND {
            return None;
        }
        let rows: Vec<Vec<f64>> = shares.iter().map(|share| terms(&powers, share)).collect();
        let (mut coefficients, mut left_out) = (Vec::new(), vec![Vec::new(); rows.len()]);
        for index in 0..figures.first()?.len() {
            let values: Vec<f64> = figures.iter().filter_map(|row| row.get(index).copied()).collect();
            let fit = least_squares(&rows, &values)?;
            let errors = fit.residuals.iter().zip(&fit.leverages);
            // The difference from a fit without the job itself.
            for (row, (residual, leverage)) in left_out.iter_mut().zip(errors) {
                row.push(residual / (1.0 - leverage).max(1e-6));
            }
            coefficients.push(fit.coefficients);
        }
        let (_, scatter) = covariance(&left_out);
        Some(Self { degree, coefficients, scatter, powers })
    }

    /// Returns the figures at these shares.
    pub(crate) fn at(&self, shares: &[f64]) -> Vec<f64> {
        let terms = terms(&self.powers, shares);
        let value = |line: &Vec<f64>| line.iter().zip(&terms).map(|(a, b)| a * b).sum();
        self.coefficients.iter().map(value).collect()
    }

    /// Returns the deviation of a figure from its polynomial.
    pub(crate) fn deviation(&self, index: usize) -> f64 {
        let variance = self.scatter.get(index).and_then(|line| line.get(index)).copied();
        variance.unwrap_or_default().max(0.0).sqrt()
    }

    /// Returns the likelihood of figures, without some of them.
    pub(crate) fn likelihood(
        &self,
        wanted: &[f64],
        rounding: &[f64],
        left_out: Option<usize>,
    ) -> Option<Likelihood<'_>> {
        let kept: Vec<usize> = (0..wanted.len()).filter(|index| Some(*index) != left_out).collect();
        let picked =
            |row: &Vec<f64>| kept.iter().filter_map(|index| row.get(*index).copied()).collect::<Vec<_>>();
        let mut matrix: Matrix =
            kept.iter().filter_map(|index| self.scatter.get(*index).map(picked)).collect();
        for (index, (line, own)) in matrix.iter_mut().zip(&kept).enumerate() {
            if let (Some(variance), Some(rounding)) = (line.get_mut(index), rounding.get(*own)) {
                *variance += rounding * rounding;
            }
        }
        Some(Likelihood { surface: self, factor: Cholesky::of(&matrix)?, wanted: wanted.to_vec(), kept })
    }
}

/// Likelihood of measured figures by the shares of the keys.
pub(crate) struct Likelihood<'a> {
    surface: &'a FigureSurface,
    factor: Cholesky,
    wanted: Vec<f64>,
    kept: Vec<usize>,
}

impl Likelihood<'_> {
    /// Returns its logarithm.
    pub(crate) fn log(&self, shares: &[f64]) -> f64 {
        let found = self.surface.at(shares);
        let difference = |index: &usize| Some(self.wanted.get(*index)? - found.get(*index)?);
        self.factor.log_density(&self.kept.iter().filter_map(difference).collect::<Vec<_>>())
    }
}

/// Returns the powers of all products up to a degree.
fn powers(keys: usize, degree: usize) -> Vec<Vec<usize>> {
    let mut all = vec![Vec::new()];
    for _ in 0..keys {
        let longer = |powers: &Vec<usize>| {
            let left = degree - powers.iter().sum::<usize>();
            (0..=left).map(|power| powers.iter().copied().chain([power]).collect()).collect::<Vec<Vec<_>>>()
        };
        all = all.iter().flat_map(longer).collect();
    }
    all
}

/// Returns the products of Legendre polynomials of the shares, which hardly depend on each other.
fn terms(powers: &[Vec<usize>], shares: &[f64]) -> Vec<f64> {
    let of = |share: f64| {
        let x = 2.0 * share - 1.0;
        [1.0, x, (3.0 * x * x - 1.0) / 2.0, (5.0 * x * x * x - 3.0 * x) / 2.0]
    };
    let legendre: Vec<[f64; HIGHEST_DEGREE + 1]> = shares.iter().map(|share| of(*share)).collect();
    let product = |powers: &Vec<usize>| {
        powers.iter().zip(&legendre).filter_map(|(power, values)| values.get(*power)).product()
    };
    powers.iter().map(product).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> Vec<Vec<f64>> {
        (0..64_u32).map(|index| vec![f64::from(index % 8) / 7.0, f64::from(index / 8) / 7.0]).collect()
    }

    #[test]
    fn a_polynomial_of_the_keys_is_found_with_its_degree_and_no_scatter() {
        let shares = grid();
        let law =
            |share: &Vec<f64>| vec![3.0 + share[0] * share[1] - 2.0 * share[0] * share[0], 5.0 * share[1]];
        let figures: Vec<_> = shares.iter().map(law).collect();
        let surface = FigureSurface::fit(&shares, &figures).unwrap();
        let found = surface.at(&[0.3, 0.9]);
        assert!((found[0] - (3.0 + 0.27 - 0.18)).abs() < 1e-9 && (found[1] - 4.5).abs() < 1e-9, "{found:?}");
        assert!(surface.degree >= 2 && surface.deviation(0) < 1e-9);
    }

    #[test]
    fn too_few_jobs_give_no_surface() {
        let shares = grid().split_off(64 - 22);
        assert!(FigureSurface::fit(&shares, &shares).is_none());
    }
}
