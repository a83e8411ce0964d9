//! Least squares with few unknowns, by sums and square roots alone, so that the result has the same bits everywhere.

use crate::maths::sqrt;

/// The weights x of `columns` for which |Σ x_j·column_j − `target`| is least; columns and target (n_rows,).
///
/// A column that is spanned by those before it has the weight 0.
pub(super) fn least_squares(columns: &[Vec<f64>], target: &[f64]) -> Vec<f64> {
    /// Relative rounding error that remains of a column that is spanned by those before it.
    const SPANNED: f64 = 1e-13;
    let n = columns.len();
    let mut basis: Vec<Vec<f64>> = Vec::with_capacity(n);
    let mut upper = vec![vec![0.0; n]; n];
    let mut shares = vec![0.0; n];
    let mut left = target.to_vec();
    for (j, column) in columns.iter().enumerate() {
        let mut remainder = column.clone();
        // Twice: a single pass leaves the rounding errors of nearly parallel columns.
        for _ in 0..2 {
            for (i, axis) in basis.iter().enumerate() {
                let share = dot(axis, &remainder);
                upper[i][j] += share;
                subtract(&mut remainder, share, axis);
            }
        }
        let norm = sqrt(dot(&remainder, &remainder));
        let is_spanned = norm <= SPANNED * sqrt(dot(column, column));
        let scale = if is_spanned { 0.0 } else { 1.0 / norm };
        remainder.iter_mut().for_each(|value| *value *= scale);
        upper[j][j] = norm;
        shares[j] = dot(&remainder, &left);
        subtract(&mut left, shares[j], &remainder);
        basis.push(remainder);
    }
    let mut weights = vec![0.0; n];
    for i in (0..n).rev() {
        let above: f64 = (i + 1..n).map(|j| upper[i][j] * weights[j]).sum();
        if basis[i].iter().any(|value| *value != 0.0) {
            weights[i] = (shares[i] - above) / upper[i][i];
        }
    }
    weights
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn subtract(from: &mut [f64], share: f64, axis: &[f64]) {
    for (value, axis) in from.iter_mut().zip(axis) {
        *value -= share * axis;
    }
}

/// Σ c_j·u^j for j from 1: a polynomial without a constant.
pub(super) fn polynomial(coefficients: &[f64], u: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| (sum + c) * u)
}
