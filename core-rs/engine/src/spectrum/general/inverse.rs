//! The inverse of a dense matrix by elimination with row pivots.

use crate::interrupt;
use crate::spectrum::vector::add;

/// The inverse of `matrix` (n, n), row after row; `None` if it is singular.
pub(crate) fn inverse(mut matrix: Vec<f64>) -> Option<Vec<f64>> {
    let n = matrix.len().isqrt();
    let mut inverse = vec![0.0; n * n];
    for i in 0..n {
        inverse[i * n + i] = 1.0;
    }
    for k in 0..n {
        interrupt::spend(4 * n * n);
        let size = |row: usize| matrix[row * n + k].abs();
        let best = (k..n).fold(
            k,
            |best, row| if size(row) > size(best) { row } else { best },
        );
        let pivot = matrix[best * n + k];
        if pivot == 0.0 || !pivot.is_finite() {
            return None;
        }
        for table in [&mut matrix, &mut inverse] {
            for column in 0..n {
                table.swap(k * n + column, best * n + column);
            }
            let row = table[k * n..(k + 1) * n].iter_mut();
            row.for_each(|x| *x /= pivot);
        }
        let pivot_row = matrix[k * n..(k + 1) * n].to_vec();
        let theirs = inverse[k * n..(k + 1) * n].to_vec();
        for row in (0..n).filter(|&row| row != k) {
            let by = -matrix[row * n + k];
            if by != 0.0 {
                add(by, &pivot_row[k..], &mut matrix[row * n + k..(row + 1) * n]);
                add(by, &theirs, &mut inverse[row * n..(row + 1) * n]);
            }
        }
    }
    inverse.iter().all(|x| x.is_finite()).then_some(inverse)
}
