//! All eigenvalues and vectors of a small dense symmetric matrix (cyclic Jacobi; Golub & Van Loan 8.5).

use crate::interrupt;
use crate::maths::sqrt;

/// Eigenvalues, rising, each with its vector of length 1.
///
/// `matrix` is (n, n), row after row; only its symmetric part counts.
pub(super) fn eigenpairs(mut matrix: Vec<Vec<f64>>) -> Vec<(f64, Vec<f64>)> {
    /// Convergence is quadratic: about eight sweeps for n = 100.
    const SWEEPS_MAX: usize = 40;
    let dimension = matrix.len();
    let transposed: Vec<Vec<f64>> = (0..dimension)
        .map(|j| matrix.iter().map(|row| row[j]).collect())
        .collect();
    for (row, column) in matrix.iter_mut().zip(&transposed) {
        for (a, b) in row.iter_mut().zip(column) {
            *a = 0.5 * (*a + b);
        }
    }
    // Row i of `vectors` becomes the i-th eigenvector.
    let mut vectors: Vec<Vec<f64>> = (0..dimension)
        .map(|i| (0..dimension).map(|j| f64::from(i == j)).collect())
        .collect();
    for _ in 0..SWEEPS_MAX {
        let mut is_diagonal = true;
        for p in 0..dimension {
            interrupt::spend(4 * dimension * (dimension - p));
            for q in p + 1..dimension {
                is_diagonal &= !rotate(&mut matrix, &mut vectors, p, q);
            }
        }
        if is_diagonal {
            break;
        }
    }
    let mut eigenpairs: Vec<(f64, Vec<f64>)> = vectors
        .into_iter()
        .enumerate()
        .map(|(i, vector)| (matrix[i][i], vector))
        .collect();
    eigenpairs.sort_by(|a, b| a.0.total_cmp(&b.0));
    eigenpairs
}

/// The largest eigenvalue and its vector; 0 for an empty matrix.
pub(super) fn largest_eigenpair(matrix: Vec<Vec<f64>>) -> (f64, Vec<f64>) {
    eigenpairs(matrix).pop().unwrap_or_default()
}

/// Rotate the plane (p, q) so that element (p, q) vanishes; false if the element is negligible already.
fn rotate(matrix: &mut [Vec<f64>], vectors: &mut [Vec<f64>], p: usize, q: usize) -> bool {
    let off_diagonal = matrix[p][q];
    let (first_diagonal, second_diagonal) = (matrix[p][p], matrix[q][q]);
    if off_diagonal.abs() <= f64::EPSILON * 0.25 * sqrt(first_diagonal.abs()) * sqrt(second_diagonal.abs())
        || off_diagonal == 0.0
    {
        return false;
    }
    let tau = (second_diagonal - first_diagonal) / (2.0 * off_diagonal);
    let cotangent = tau.abs() + sqrt(1.0 + tau * tau);
    let tangent = if tau < 0.0 { -1.0 / cotangent } else { 1.0 / cotangent };
    let cosine = 1.0 / sqrt(1.0 + tangent * tangent);
    let sine = tangent * cosine;
    rotate_rows(matrix, p, q, cosine, sine);
    rotate_rows(vectors, p, q, cosine, sine);
    for row in matrix.iter_mut() {
        (row[p], row[q]) = (cosine * row[p] - sine * row[q], sine * row[p] + cosine * row[q]);
    }
    matrix[p][p] = first_diagonal - tangent * off_diagonal;
    matrix[q][q] = second_diagonal + tangent * off_diagonal;
    (matrix[p][q], matrix[q][p]) = (0.0, 0.0);
    true
}

fn rotate_rows(rows: &mut [Vec<f64>], p: usize, q: usize, cosine: f64, sine: f64) {
    let (upper_rows, lower_rows) = rows.split_at_mut(q);
    for (a, b) in upper_rows[p].iter_mut().zip(&mut lower_rows[0]) {
        (*a, *b) = (cosine * *a - sine * *b, sine * *a + cosine * *b);
    }
}
