//! Square matrices: products, powers and exponentials, the same bits on every machine.

use nalgebra::DMatrix;

use crate::interrupt;
use crate::kernel::dense;

/// Terms of the exponential's series: at a norm of ½ the remainder is below 1e-19.
const SERIES_TERMS: u32 = 16;

/// An (n, n) matrix, stored column by column.
#[derive(Clone, Debug)]
pub(crate) struct SquareMatrix {
    pub(crate) n: usize,
    pub(crate) entries: Vec<f64>,
}

impl SquareMatrix {
    pub(crate) fn zero(n: usize) -> Self {
        Self {
            n,
            entries: vec![0.0; n * n],
        }
    }

    pub(crate) fn identity(n: usize) -> Self {
        let mut identity = Self::zero(n);
        (0..n).for_each(|i| *identity.entry_mut(i, i) = 1.0);
        identity
    }

    pub(crate) fn entry_mut(&mut self, row: usize, column: usize) -> &mut f64 {
        &mut self.entries[column * self.n + row]
    }

    pub(crate) fn value(&self, row: usize, column: usize) -> f64 {
        self.entries[column * self.n + row]
    }

    /// The (n, n) block whose first entry is at `row` and `column`.
    pub(crate) fn block(&self, row: usize, column: usize, n: usize) -> Self {
        let column = |j: usize| {
            let first_entry = (column + j) * self.n + row;
            &self.entries[first_entry..first_entry + n]
        };
        Self {
            n,
            entries: (0..n).flat_map(column).copied().collect(),
        }
    }

    pub(crate) fn times(&self, other: &Self) -> Self {
        interrupt::spend(self.n * self.n * self.n);
        let mut product = Self::zero(self.n);
        dense::add_matrix_product(self.n, &self.entries, &other.entries, &mut product.entries);
        product
    }

    /// self + factor·other.
    pub(crate) fn plus_scaled(mut self, other: &Self, factor: f64) -> Self {
        let entry_pairs = self.entries.iter_mut().zip(&other.entries);
        entry_pairs.for_each(|(entry, other)| *entry += factor * other);
        self
    }

    pub(crate) fn scaled(mut self, factor: f64) -> Self {
        self.entries.iter_mut().for_each(|entry| *entry *= factor);
        self
    }

    /// self·x.
    pub(crate) fn times_vector(&self, x: &[f64]) -> Vec<f64> {
        let mut product = vec![0.0; self.n];
        dense::add_matrix_vector(&self.entries, x, &mut product);
        product
    }

    pub(crate) fn power(&self, mut exponent: u32) -> Self {
        let (mut raised_matrix, mut squared_base) = (Self::identity(self.n), self.clone());
        while exponent > 0 {
            if exponent & 1 == 1 {
                raised_matrix = raised_matrix.times(&squared_base);
            }
            exponent >>= 1;
            if exponent > 0 {
                squared_base = squared_base.times(&squared_base);
            }
        }
        raised_matrix
    }

    /// e^self: the matrix is halved until its norm is ½ or less, and the sum of the series is squared as often.
    pub(crate) fn exponential(&self) -> Self {
        let columns = self.entries.chunks_exact(self.n.max(1));
        let column_sums = columns.map(|column| column.iter().map(|entry| entry.abs()).sum::<f64>());
        let (mut norm, mut squarings) = (column_sums.fold(0.0, f64::max), 0);
        while norm > 0.5 && squarings < 64 {
            (norm, squarings) = (0.5 * norm, squarings + 1);
        }
        let scaled_matrix = self.clone().scaled(1.0 / (1_u64 << squarings.min(63)) as f64);
        let mut series_sum = Self::identity(self.n);
        for term in (1..=SERIES_TERMS).rev() {
            series_sum = Self::identity(self.n).plus_scaled(&scaled_matrix.times(&series_sum), 1.0 / f64::from(term));
        }
        for _ in 0..squarings {
            series_sum = series_sum.times(&series_sum);
        }
        series_sum
    }

    /// self·other⁻¹; `None` if `other` has no inverse.
    pub(crate) fn times_inverse(&self, other: &Self) -> Option<Self> {
        // Y·B = A is Bᵀ·Yᵀ = Aᵀ; the columns of a matrix are the rows of its transpose.
        let b = DMatrix::from_row_slice(self.n, self.n, &other.entries);
        let a = DMatrix::from_row_slice(self.n, self.n, &self.entries);
        let y = b.lu().solve(&a)?.transpose();
        let entries = y.as_slice().to_vec();
        let is_finite = entries.iter().all(|entry| entry.is_finite());
        is_finite.then_some(Self { n: self.n, entries })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares e^A of a rotation, a decay and a shear with the closed form.
    #[test]
    fn exponential_of_rotation_decay_and_shear() {
        let mut test_matrix = SquareMatrix::zero(5);
        (*test_matrix.entry_mut(0, 1), *test_matrix.entry_mut(1, 0)) = (7.0, -7.0);
        *test_matrix.entry_mut(2, 2) = -3.0;
        *test_matrix.entry_mut(3, 4) = 40.0;
        let exponential = test_matrix.exponential();
        let entry_cases = [
            (0, 0, crate::maths::cos(7.0)),
            (0, 1, crate::maths::sin(7.0)),
            (1, 0, -crate::maths::sin(7.0)),
            (2, 2, crate::maths::exp(-3.0)),
            (3, 4, 40.0),
            (4, 4, 1.0),
            (2, 0, 0.0),
        ];
        for (row, column, expected) in entry_cases {
            assert!(
                (exponential.value(row, column) - expected).abs() < 1e-12,
                "{row} {column}"
            );
        }
    }

    #[test]
    fn power_and_quotient_of_square_matrices() {
        let matrix_size = 7;
        let mut test_matrix = SquareMatrix::identity(matrix_size);
        for i in 0..matrix_size * matrix_size {
            test_matrix.entries[i] += 0.1 * (((i * 37) % 11) as f64 - 5.0) / 5.0;
        }
        let repeated_power = (0..13).fold(SquareMatrix::identity(matrix_size), |power, _| {
            power.times(&test_matrix)
        });
        let power_error = test_matrix.power(13).plus_scaled(&repeated_power, -1.0);
        let largest = repeated_power.entries.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        assert!(power_error.entries.iter().all(|x| x.abs() < 1e-13 * largest));
        let quotient_error = test_matrix
            .times(&repeated_power)
            .times_inverse(&repeated_power)
            .map(|quotient_error| quotient_error.plus_scaled(&test_matrix, -1.0));
        assert!(quotient_error.is_some_and(|off| off.entries.iter().all(|x| x.abs() < 1e-10)));
        assert!(test_matrix.times_inverse(&SquareMatrix::zero(matrix_size)).is_none());
    }
}
