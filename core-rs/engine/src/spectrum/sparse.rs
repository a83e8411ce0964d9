//! A sparse symmetric matrix and its LDLᵀ factorisation, which solves systems and counts eigenvalues below a number.
//!
//! Pivots are taken in a fixed order, whatever their size: an indefinite matrix is factored at a shift that is not an
//! eigenvalue. Source: Davis, "Algorithm 849: a concise sparse Cholesky factorization package", ACM TOMS 31 (2005).

use std::ops::{Add, Div, Mul, Sub};

use super::ordering;
use crate::interrupt;

/// Type of the elements of a matrix: `f64`, or complex numbers where P(λ) = K + λZ + λ²M is solved.
pub(crate) trait Scalar:
    Copy + PartialEq + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + From<f64>
{
}

impl<T> Scalar for T where
    T: Copy + PartialEq + Add<Output = T> + Sub<Output = T> + Mul<Output = T> + Div<Output = T> + From<f64>
{
}

/// The positions of the entries of a symmetric matrix, and its elimination order.
#[derive(Debug)]
pub(crate) struct Pattern {
    /// Where each row begins in `columns`   (n + 1)
    row_starts: Vec<usize>,
    /// Columns off the diagonal, rising in each row
    columns: Vec<u32>,
    /// The elimination order (n), and its inverse
    order: Vec<u32>,
    inverse_order: Vec<u32>,
    /// Parent of each column in the elimination tree   (n)
    parents: Vec<Option<u32>>,
    /// Where each column of L begins   (n + 1)
    column_starts: Vec<usize>,
}

impl Pattern {
    /// The pattern of a matrix (n, n) with entries at `pairs` and on its diagonal.
    pub(crate) fn new(n: usize, pairs: impl Iterator<Item = (usize, usize)>) -> Self {
        let mut row_columns: Vec<Vec<u32>> = vec![Vec::new(); n];
        for (a, b) in pairs {
            if a != b {
                row_columns[a].push(b as u32);
                row_columns[b].push(a as u32);
            }
        }
        let (mut row_starts, mut columns) = (vec![0], Vec::new());
        for mut row in row_columns {
            row.sort_unstable();
            row.dedup();
            columns.extend(row);
            row_starts.push(columns.len());
        }
        let order = ordering::elimination_order(&row_starts, &columns);
        let mut inverse_order = vec![0; n];
        for (k, &i) in order.iter().enumerate() {
            inverse_order[i as usize] = k as u32;
        }
        let mut pattern = Self {
            row_starts,
            columns,
            order,
            inverse_order,
            parents: vec![None; n],
            column_starts: Vec::new(),
        };
        pattern.build_elimination_tree();
        pattern
    }

    pub(crate) fn dimension(&self) -> usize {
        self.order.len()
    }

    /// Number of entries of L.
    pub(crate) fn fill_count(&self) -> usize {
        self.column_starts[self.dimension()]
    }

    /// Index of an off-diagonal entry in `columns` and in the values.
    fn slot(&self, a: usize, b: usize) -> usize {
        let row_columns = &self.columns[self.row_starts[a]..self.row_starts[a + 1]];
        self.row_starts[a] + row_columns.partition_point(|&column| (column as usize) < b)
    }

    fn build_elimination_tree(&mut self) {
        let dimension = self.dimension();
        let (mut column_fill, mut last_visit) = (vec![0; dimension], vec![0; dimension]);
        for k in 0..dimension {
            last_visit[k] = k as u32; // so that the entries of earlier columns are below k until visited
            let original_row = self.order[k] as usize;
            for &j in &self.columns[self.row_starts[original_row]..self.row_starts[original_row + 1]] {
                let mut ancestor = self.inverse_order[j as usize] as usize;
                while ancestor < k && last_visit[ancestor] != k as u32 {
                    last_visit[ancestor] = k as u32;
                    column_fill[ancestor] += 1;
                    ancestor = *self.parents[ancestor].get_or_insert(k as u32) as usize;
                }
            }
        }
        self.column_starts = Vec::with_capacity(dimension + 1);
        self.column_starts.push(0);
        for column_fill in column_fill {
            self.column_starts
                .push(self.column_starts.last().unwrap_or(&0) + column_fill);
        }
    }
}

/// Values of a symmetric matrix on a pattern.
#[derive(Clone, Debug)]
pub(crate) struct Values<T> {
    pub(crate) diagonal: Vec<T>,
    /// Off-diagonal values, in the order of the pattern's columns
    off_diagonal: Vec<T>,
}

impl Values<f64> {
    pub(crate) fn new(pattern: &Pattern) -> Self {
        Self {
            diagonal: vec![0.0; pattern.dimension()],
            off_diagonal: vec![0.0; pattern.columns.len()],
        }
    }

    /// Add to the entries (a, b) and (b, a), which lie off the diagonal.
    pub(crate) fn add(&mut self, pattern: &Pattern, a: usize, b: usize, value: f64) {
        self.off_diagonal[pattern.slot(a, b)] += value;
        self.off_diagonal[pattern.slot(b, a)] += value;
    }
}

impl<T: Scalar> Values<T> {
    /// Combines two matrices of one pattern element by element with `combine_entries`, and adds `diagonal_shift` to the
    /// diagonal.
    pub(crate) fn combine<U: Copy>(
        first: &Values<U>,
        other: &Values<U>,
        diagonal_shift: T,
        combine_entries: impl Fn(U, U) -> T,
    ) -> Self {
        let combine_lists =
            |a: &[U], b: &[U]| -> Vec<T> { a.iter().zip(b).map(|(a, b)| combine_entries(*a, *b)).collect() };
        let mut diagonal = combine_lists(&first.diagonal, &other.diagonal);
        diagonal.iter_mut().for_each(|x| *x = *x + diagonal_shift);
        Self {
            diagonal,
            off_diagonal: combine_lists(&first.off_diagonal, &other.off_diagonal),
        }
    }

    /// y = A x.
    pub(crate) fn multiply(&self, pattern: &Pattern, x: &[T], y: &mut [T]) {
        for (i, y) in y.iter_mut().enumerate() {
            let mut row_sum = self.diagonal[i] * x[i];
            for entry in pattern.row_starts[i]..pattern.row_starts[i + 1] {
                row_sum = row_sum + self.off_diagonal[entry] * x[pattern.columns[entry] as usize];
            }
            *y = row_sum;
        }
    }
}

/// LDLᵀ factorisation of a symmetric matrix; also of a complex symmetric one, without conjugation.
pub(crate) struct Factor<'a, T> {
    pattern: &'a Pattern,
    rows: Vec<u32>,
    values: Vec<T>,
    pivots: Vec<T>,
}

impl<'a, T: Scalar> Factor<'a, T> {
    /// Factors A − `shift`·1; `None` if a pivot is 0.
    pub(crate) fn new(pattern: &'a Pattern, matrix: &Values<T>, shift: T) -> Option<Self> {
        let zero = T::from(0.0);
        let dimension = pattern.dimension();
        let (mut rows, mut values) = (vec![0; pattern.fill_count()], vec![zero; pattern.fill_count()]);
        let mut pivots = vec![zero; dimension];
        let mut column_ends = pattern.column_starts.clone();
        let (mut dense_row, mut last_visit) = (vec![zero; dimension], vec![0; dimension]);
        let (mut tree_path, mut row_reach) = (Vec::new(), Vec::new());
        let mut visited_count = 0;
        for k in 0..dimension {
            if k % 256 == 0 {
                interrupt::spend(std::mem::take(&mut visited_count));
            }
            last_visit[k] = k as u32;
            row_reach.clear();
            let original_row = pattern.order[k] as usize;
            for entry in pattern.row_starts[original_row]..pattern.row_starts[original_row + 1] {
                let start_column = pattern.inverse_order[pattern.columns[entry] as usize] as usize;
                if start_column >= k {
                    continue;
                }
                dense_row[start_column] = dense_row[start_column] + matrix.off_diagonal[entry];
                let mut column_index = start_column;
                while last_visit[column_index] != k as u32 {
                    last_visit[column_index] = k as u32;
                    tree_path.push(column_index as u32);
                    let Some(parent) = pattern.parents[column_index] else {
                        break;
                    };
                    column_index = parent as usize;
                }
                // Nearest to the root first. Read from the end, each column comes before those that it changes.
                row_reach.extend(tree_path.drain(..).rev());
            }
            let mut pivot = matrix.diagonal[original_row] - shift;
            for &column_index in row_reach.iter().rev() {
                let column_index = column_index as usize;
                let row_entry = dense_row[column_index];
                dense_row[column_index] = zero;
                let column_range = pattern.column_starts[column_index]..column_ends[column_index];
                visited_count += column_range.len() + 8;
                for (&j, &l) in rows[column_range.clone()].iter().zip(&values[column_range]) {
                    dense_row[j as usize] = dense_row[j as usize] - l * row_entry;
                }
                let factor_entry = row_entry / pivots[column_index];
                pivot = pivot - factor_entry * row_entry;
                rows[column_ends[column_index]] = k as u32;
                values[column_ends[column_index]] = factor_entry;
                column_ends[column_index] += 1;
            }
            if pivot == zero {
                return None;
            }
            pivots[k] = pivot;
        }
        Some(Self {
            pattern,
            rows,
            values,
            pivots,
        })
    }

    /// x of (A − shift·1) x = `right_side`.
    pub(crate) fn solve(&self, right_side: &[T]) -> Vec<T> {
        let pattern = self.pattern;
        interrupt::spend(2 * (self.values.len() + pattern.dimension()));
        let mut solution: Vec<T> = pattern.order.iter().map(|&i| right_side[i as usize]).collect();
        for k in 0..solution.len() {
            let column_range = pattern.column_starts[k]..pattern.column_starts[k + 1];
            let component = solution[k];
            for (&row, &l) in self.rows[column_range.clone()].iter().zip(&self.values[column_range]) {
                solution[row as usize] = solution[row as usize] - l * component;
            }
        }
        for k in (0..solution.len()).rev() {
            let column_range = pattern.column_starts[k]..pattern.column_starts[k + 1];
            let mut component = solution[k] / self.pivots[k];
            for (&row, &l) in self.rows[column_range.clone()].iter().zip(&self.values[column_range]) {
                component = component - l * solution[row as usize];
            }
            solution[k] = component;
        }
        pattern.inverse_order.iter().map(|&k| solution[k as usize]).collect()
    }
}

impl Factor<'_, f64> {
    /// How many eigenvalues lie below the shift (Sylvester's law of inertia).
    pub(crate) fn n_below_shift(&self) -> usize {
        self.pivots.iter().filter(|pivot| **pivot < 0.0).count()
    }
}
