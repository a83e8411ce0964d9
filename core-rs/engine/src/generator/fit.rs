//! Least squares with few unknowns, by sums and square roots alone, so that the result has the same bits everywhere.

use crate::maths::sqrt;

/// The weights x of `columns` for which |Σ x_j·column_j − `target`| is least; columns and target (n_rows,).
///
/// A column that is spanned by those before it has the weight 0.
pub(super) fn least_squares(columns: &[Vec<f64>], target: &[f64]) -> Vec<f64> {
    /// Relative rounding error that remains of a column that is spanned by those before it.
    const SPANNED: f64 = 1e-13;
    let n_columns = columns.len();
    let mut basis_columns: Vec<Vec<f64>> = Vec::with_capacity(n_columns);
    let mut upper_triangle = vec![vec![0.0; n_columns]; n_columns];
    let mut basis_shares = vec![0.0; n_columns];
    let mut target_left = target.to_vec();
    for (j, column) in columns.iter().enumerate() {
        let mut remainder = column.clone();
        // Twice: a single pass leaves the rounding errors of nearly parallel columns.
        for _ in 0..2 {
            for (i, axis) in basis_columns.iter().enumerate() {
                let basis_share = dot(axis, &remainder);
                upper_triangle[i][j] += basis_share;
                subtract(&mut remainder, basis_share, axis);
            }
        }
        let remainder_norm = sqrt(dot(&remainder, &remainder));
        let is_spanned = remainder_norm <= SPANNED * sqrt(dot(column, column));
        let inverse_norm = if is_spanned { 0.0 } else { 1.0 / remainder_norm };
        remainder.iter_mut().for_each(|value| *value *= inverse_norm);
        upper_triangle[j][j] = remainder_norm;
        basis_shares[j] = dot(&remainder, &target_left);
        subtract(&mut target_left, basis_shares[j], &remainder);
        basis_columns.push(remainder);
    }
    let mut weights = vec![0.0; n_columns];
    for i in (0..n_columns).rev() {
        let later_sum: f64 = (i + 1..n_columns).map(|j| upper_triangle[i][j] * weights[j]).sum();
        if basis_columns[i].iter().any(|value| *value != 0.0) {
            weights[i] = (basis_shares[i] - later_sum) / upper_triangle[i][i];
        }
    }
    weights
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn subtract(target: &mut [f64], share: f64, axis: &[f64]) {
    for (value, axis) in target.iter_mut().zip(axis) {
        *value -= share * axis;
    }
}

/// Σ c_j·u^j for j from 1: a polynomial without a constant.
pub(super) fn polynomial(coefficients: &[f64], u: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| (sum + c) * u)
}
