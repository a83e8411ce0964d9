//! A symmetric positive definite matrix with a narrow band, factorised once: A = L·Lᵀ.

use crate::maths::sqrt;
use crate::maths::wide::wide;

/// Largest number of entries of a factor (1 GB for its two copies).
pub(super) const MOST: usize = 60_000_000;

/// The factor of a banded matrix.
#[derive(Clone, Debug)]
pub(super) struct Factor {
    n: usize,
    /// Entries below the diagonal of each column.
    band: usize,
    /// Column j of L from the diagonal down          (n · (band + 1))
    columns: Vec<f64>,
    /// Row i of L, left of the diagonal              (n · band)
    rows: Vec<f64>,
    /// 1/L[j, j]                                     (n)
    inverse: Vec<f64>,
}

impl Factor {
    /// Factorises a matrix given by the columns of its lower half, (n · (band + 1)), diagonal first. `None` if it is
    /// not positive definite.
    pub(super) fn new(band: usize, mut columns: Vec<f64>) -> Option<Self> {
        let width = band + 1;
        let n = columns.len() / width;
        let (mut rows, mut inverse) = (vec![0.0; n * band], vec![0.0; n]);
        for j in 0..n {
            let (column, after) = columns[j * width..].split_at_mut(width);
            let below = band.min(n - 1 - j);
            let pivot = column[0];
            if !(pivot > 0.0 && pivot.is_finite()) {
                return None;
            }
            column[0] = sqrt(pivot);
            inverse[j] = 1.0 / column[0];
            for (i, entry) in column[1..=below].iter_mut().enumerate() {
                *entry *= inverse[j];
                let row = j + 1 + i;
                rows[row * band + (band - 1 - i)] = *entry;
            }
            for k in 1..=below {
                let ahead = &mut after[(k - 1) * width..][..=below - k];
                subtract(column[k], &column[k..=below], ahead);
            }
        }
        Some(Self {
            n,
            band,
            columns,
            rows,
            inverse,
        })
    }

    /// Solve A·x = y in place, (n).
    pub(super) fn solve(&self, y: &mut [f64]) {
        solve(
            self.n,
            self.band,
            [&self.columns, &self.rows, &self.inverse],
            y,
        );
    }
}

wide! {
    fn subtract(factor: f64, column: &[f64], from: &mut [f64]) {
        for (from, entry) in from.iter_mut().zip(column) {
            *from -= factor * entry;
        }
    }
}

wide! {
    /// Forward substitution by the columns of L, backward substitution by those of Lᵀ: each column updates many
    /// independent sums, so that vectorisation does not change the order of any sum.
    fn solve(n: usize, band: usize, factor: [&[f64]; 3], y: &mut [f64]) {
        let [columns, rows, inverse] = factor;
        for j in 0..n {
            let below = band.min(n - 1 - j);
            let (head, tail) = y.split_at_mut(j + 1);
            head[j] *= inverse[j];
            let solved = head[j];
            let column = &columns[j * (band + 1) + 1..][..below];
            for (y, entry) in tail[..below].iter_mut().zip(column) {
                *y -= solved * entry;
            }
        }
        for i in (0..n).rev() {
            let left = band.min(i);
            let (head, tail) = y.split_at_mut(i);
            tail[0] *= inverse[i];
            let solved = tail[0];
            let row = &rows[(i + 1) * band - left..][..left];
            for (y, entry) in head[i - left..].iter_mut().zip(row) {
                *y -= solved * entry;
            }
        }
    }
}
