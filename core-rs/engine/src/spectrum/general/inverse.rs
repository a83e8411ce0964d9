//! The inverse of a dense matrix by elimination with row pivots.

use crate::interrupt;
use crate::spectrum::vector::add_scaled;

/// The inverse of `matrix` (n, n), row after row; `None` if it is singular.
pub(crate) fn inverse(mut matrix: Vec<f64>) -> Option<Vec<f64>> {
    let dimension = matrix.len().isqrt();
    let mut inverse = vec![0.0; dimension * dimension];
    for i in 0..dimension {
        inverse[i * dimension + i] = 1.0;
    }
    for k in 0..dimension {
        interrupt::spend(4 * dimension * dimension);
        let pivot_size = |row: usize| matrix[row * dimension + k].abs();
        let best_row = (k..dimension).fold(k, |best_row, row| {
            if pivot_size(row) > pivot_size(best_row) {
                row
            } else {
                best_row
            }
        });
        let pivot = matrix[best_row * dimension + k];
        if pivot == 0.0 || !pivot.is_finite() {
            return None;
        }
        for table in [&mut matrix, &mut inverse] {
            for column in 0..dimension {
                table.swap(k * dimension + column, best_row * dimension + column);
            }
            let row = table[k * dimension..(k + 1) * dimension].iter_mut();
            row.for_each(|x| *x /= pivot);
        }
        let pivot_row = matrix[k * dimension..(k + 1) * dimension].to_vec();
        let inverse_row = inverse[k * dimension..(k + 1) * dimension].to_vec();
        for row in (0..dimension).filter(|&row| row != k) {
            let row_factor = -matrix[row * dimension + k];
            if row_factor != 0.0 {
                add_scaled(
                    row_factor,
                    &pivot_row[k..],
                    &mut matrix[row * dimension + k..(row + 1) * dimension],
                );
                add_scaled(
                    row_factor,
                    &inverse_row,
                    &mut inverse[row * dimension..(row + 1) * dimension],
                );
            }
        }
    }
    inverse.iter().all(|x| x.is_finite()).then_some(inverse)
}
