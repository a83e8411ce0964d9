//! Symmetric matrices with few entries in a row, and the links that they stand for.

use std::collections::BTreeMap;

use super::{Topology, TopologyRun};
use crate::interrupt;

/// A symmetric matrix by rows: column → entry.
#[derive(Clone, Debug)]
pub(super) struct Sparse(pub(super) Vec<BTreeMap<usize, f64>>);

/// Rows between two polls of an interruption.
const POLL_EVERY: usize = 256;
/// Entries below this fraction of the largest are rounding errors, and so are smaller differences of factors.
const RELATIVE_ENTRY_MIN: f64 = 1e-14;

impl Sparse {
    pub(super) fn zero(n: usize) -> Self {
        Self(vec![BTreeMap::new(); n])
    }

    /// The stiffness matrix of a body's springs.
    pub(super) fn stiffness(topology: &Topology) -> Self {
        let n_masses = topology.n_mat;
        let mut stiffness_matrix = Self::zero(n_masses);
        for run in &topology.runs {
            for (a, b) in (0..run.len).map(|i| (run.a + i, run.b + i)) {
                for (row, other) in [(a, b), (b, a)] {
                    if row < n_masses {
                        stiffness_matrix.add(row, row, run.factor);
                        if other < n_masses {
                            stiffness_matrix.add(row, other, -run.factor);
                        }
                    }
                }
            }
        }
        stiffness_matrix
    }

    pub(super) fn add(&mut self, row: usize, column: usize, value: f64) {
        *self.0[row].entry(column).or_insert(0.0) += value;
    }

    pub(super) fn product(&self, other: &Self) -> Self {
        let mut product_matrix = Self::zero(self.0.len());
        for (i, (row, sum)) in self.0.iter().zip(&mut product_matrix.0).enumerate() {
            if i.is_multiple_of(POLL_EVERY) {
                interrupt::poll();
            }
            for (inner, value) in row {
                for (column, other) in &other.0[*inner] {
                    *sum.entry(*column).or_insert(0.0) += value * other;
                }
            }
        }
        product_matrix
    }

    pub(super) fn add_scaled(&mut self, factor: f64, other: &Self) {
        for (target, row) in self.0.iter_mut().zip(&other.0) {
            for (column, value) in row {
                *target.entry(*column).or_insert(0.0) += factor * value;
            }
        }
    }

    /// The links whose matrix this is: between masses by its entries, and from each mass to the fixed point `ground` by
    /// the sum of its row. `link_hardens` tells whether the link between two masses hardens.
    pub(super) fn links(&self, ground: usize, link_hardens: impl Fn(usize, usize) -> bool) -> Vec<TopologyRun> {
        let largest = self.0.iter().flat_map(BTreeMap::values);
        let entry_threshold =
            RELATIVE_ENTRY_MIN * largest.fold(0.0, |largest_so_far: f64, value| largest_so_far.max(value.abs()));
        let mut matrix_links = Vec::new();
        for (i, row) in self.0.iter().enumerate() {
            for (j, value) in row.range(i + 1..) {
                if value.abs() > entry_threshold {
                    matrix_links.push((false, j - i, i, *j, -value));
                }
            }
            let row_magnitude: f64 = row.values().map(|value| value.abs()).sum();
            let row_sum: f64 = row.values().sum();
            if row_sum.abs() > 1e-11 * row_magnitude {
                matrix_links.push((true, 0, ground, i, row_sum));
            }
        }
        // Links to the ground come last.
        matrix_links.sort_by_key(|(is_grounded, spacing, a, b, _)| (*is_grounded, *spacing, *a, *b));
        let mut link_runs: Vec<TopologyRun> = Vec::new();
        for (is_grounded, _, a, b, factor) in matrix_links {
            let hardens = !is_grounded && link_hardens(a, b);
            match link_runs.last_mut() {
                Some(run)
                    if (run.a + run.len, run.b + run.len) == (a, b)
                        && (run.factor - factor).abs() <= RELATIVE_ENTRY_MIN * factor.abs()
                        && run.hardens == hardens =>
                {
                    run.len += 1;
                }
                _ => link_runs.push(TopologyRun {
                    a,
                    b,
                    len: 1,
                    factor,
                    hardens,
                }),
            }
        }
        link_runs
    }
}
