//! Least squares and normal distributions of a few dimensions.

/// A square matrix, row by row.
pub(crate) type Matrix = Vec<Vec<f64>>;

/// Factor of a positive definite matrix: the lower triangle whose square it is.
#[derive(Clone, Debug)]
pub(crate) struct Cholesky(Matrix);

impl Cholesky {
    /// Factors a matrix; `None` if it is not positive definite.
    pub(crate) fn of(matrix: &[Vec<f64>]) -> Option<Self> {
        let mut lower: Matrix = Vec::with_capacity(matrix.len());
        for (row, values) in matrix.iter().enumerate() {
            let mut line: Vec<f64> = Vec::with_capacity(row + 1);
            for column in 0..=row {
                let other = if column == row { &line } else { lower.get(column)? };
                let sum: f64 = line.iter().zip(other).take(column).map(|(a, b)| a * b).sum();
                let rest = values.get(column)? - sum;
                if column == row {
                    // A pivot that only rounding has left says nothing.
                    let is_usable = rest > values.get(column)?.abs() * 1e-12;
                    line.push(is_usable.then(|| rest.sqrt())?);
                } else {
                    line.push(rest / lower.get(column)?.get(column)?);
                }
            }
            lower.push(line);
        }
        Some(Self(lower))
    }

    /// Solves the lower triangle for a right side.
    pub(crate) fn forward(&self, right: &[f64]) -> Vec<f64> {
        let mut solved: Vec<f64> = Vec::with_capacity(right.len());
        for (line, value) in self.0.iter().zip(right) {
            let sum: f64 = line.iter().zip(&solved).map(|(a, b)| a * b).sum();
            solved.push((value - sum) / line.last().copied().unwrap_or(1.0));
        }
        solved
    }

    /// Solves the matrix for a right side.
    pub(crate) fn solve(&self, right: &[f64]) -> Vec<f64> {
        let mut solved = self.forward(right);
        for row in (0..solved.len()).rev() {
            let own = self.0.get(row).and_then(|line| line.get(row)).copied().unwrap_or(1.0);
            let after = self.0.iter().zip(&solved).skip(row + 1);
            let sum: f64 = after.filter_map(|(line, value)| Some(line.get(row)? * value)).sum();
            if let Some(value) = solved.get_mut(row) {
                *value = (*value - sum) / own;
            }
        }
        solved
    }

    /// Multiplies the lower triangle with a vector: independent standard normal values get this covariance.
    pub(crate) fn times(&self, vector: &[f64]) -> Vec<f64> {
        self.0.iter().map(|line| line.iter().zip(vector).map(|(a, b)| a * b).sum()).collect()
    }

    /// Returns the logarithm of the density of a normal distribution with this covariance, at a distance from its mean.
    pub(crate) fn log_density(&self, distance: &[f64]) -> f64 {
        let square: f64 = self.forward(distance).iter().map(|value| value * value).sum();
        let log_root: f64 = self.0.iter().filter_map(|line| line.last()).map(|value| libm::log(*value)).sum();
        let turns = libm::log(2.0 * std::f64::consts::PI);
        -0.5 * square - log_root - 0.5 * self.0.len() as f64 * turns
    }
}

/// A line that was fitted by least squares.
#[derive(Clone, Debug)]
pub(crate) struct LeastSquares {
    /// Coefficient of each column.
    pub(crate) coefficients: Vec<f64>,
    /// Difference of each value from the line.
    pub(crate) residuals: Vec<f64>,
    /// Share of each row in its own fitted value.
    pub(crate) leverages: Vec<f64>,
    /// Diagonal of the inverse of the columns' products.
    pub(crate) inverse_diagonal: Vec<f64>,
}

/// Fits columns to values; `None` if they depend on each other.
pub(crate) fn least_squares(rows: &[Vec<f64>], values: &[f64]) -> Option<LeastSquares> {
    let columns = rows.first()?.len();
    let mut products = vec![vec![0.0; columns]; columns];
    let mut right = vec![0.0; columns];
    for (row, value) in rows.iter().zip(values) {
        for ((line, sum), a) in products.iter_mut().zip(&mut right).zip(row) {
            line.iter_mut().zip(row).for_each(|(product, b)| *product += a * b);
            *sum += a * value;
        }
    }
    let factor = Cholesky::of(&products)?;
    let coefficients = factor.solve(&right);
    let fitted = |row: &Vec<f64>| row.iter().zip(&coefficients).map(|(a, b)| a * b).sum::<f64>();
    let residuals = rows.iter().zip(values).map(|(row, value)| value - fitted(row)).collect();
    let square = |vector: Vec<f64>| vector.iter().map(|value| value * value).sum::<f64>();
    let leverages = rows.iter().map(|row| square(factor.forward(row))).collect();
    let unit =
        |index: usize| (0..columns).map(|column| f64::from(u8::from(column == index))).collect::<Vec<_>>();
    let inverse_diagonal = (0..columns).map(|index| square(factor.forward(&unit(index)))).collect();
    Some(LeastSquares { coefficients, residuals, leverages, inverse_diagonal })
}

/// Returns means and covariance of rows.
pub(crate) fn covariance(rows: &[Vec<f64>]) -> (Vec<f64>, Matrix) {
    let (count, columns) = (rows.len() as f64, rows.first().map_or(0, Vec::len));
    let mut means = vec![0.0; columns];
    rows.iter().for_each(|row| means.iter_mut().zip(row).for_each(|(mean, value)| *mean += value / count));
    let mut matrix = vec![vec![0.0; columns]; columns];
    for row in rows {
        let from_mean: Vec<f64> = row.iter().zip(&means).map(|(value, mean)| value - mean).collect();
        for (line, a) in matrix.iter_mut().zip(&from_mean) {
            line.iter_mut().zip(&from_mean).for_each(|(sum, b)| *sum += a * b / (count - 1.0).max(1.0));
        }
    }
    (means, matrix)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_matrix_is_solved_and_one_that_is_not_positive_is_refused() {
        let factor = Cholesky::of(&[vec![4.0, 2.0], vec![2.0, 5.0]]).unwrap();
        assert_eq!(factor.solve(&[10.0, 13.0]), [1.5, 2.0]);
        // Density of two independent values of variance 4 at the mean: 1 / (2π · 4).
        let apart = Cholesky::of(&[vec![4.0, 0.0], vec![0.0, 4.0]]).unwrap().log_density(&[0.0, 0.0]);
        assert!((apart - libm::log(1.0 / (8.0 * std::f64::consts::PI))).abs() < 1e-12, "{apart}");
        assert!(Cholesky::of(&[vec![1.0, 1.0], vec![1.0, 1.0]]).is_none());
    }

    #[test]
    fn least_squares_give_the_line_its_errors_and_its_leverages() {
        // y = 1, 3, 4, 6 at 0, 1, 2, 3: 1.1 + 1.6 x; leverages of four equal steps 0.7, 0.3, 0.3, 0.7.
        let rows: Vec<_> = (0..4).map(|x| vec![1.0, f64::from(x)]).collect();
        let fit = least_squares(&rows, &[1.0, 3.0, 4.0, 6.0]).unwrap();
        let near = |found: &[f64], wanted: &[f64]| {
            assert!(found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-12), "{found:?}");
        };
        near(&fit.coefficients, &[1.1, 1.6]);
        near(&fit.residuals, &[-0.1, 0.3, -0.3, 0.1]);
        near(&fit.leverages, &[0.7, 0.3, 0.3, 0.7]);
        near(&fit.inverse_diagonal, &[0.7, 0.2]);
    }
}
