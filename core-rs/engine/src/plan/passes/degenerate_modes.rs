//! Modes of the same frequency, rotated so that as few of them as possible move.
//!
//! A body with symmetries has several modes of the same frequency and decay, and any rotation among them gives equally
//! valid modes. Rotated towards what moves the body, only as many of them move as there are such directions; all others
//! rest for ever.

use std::ops::Range;

use crate::plan::constants::{ROW_ROUNDING, SAME_FREQUENCY};
use crate::plan::passes::modes::Modes;
use crate::units::Rate;

impl Modes {
    /// Rotates modes of the same frequency towards the rows that move the body, and towards its start and rest
    /// positions. The remaining ones are then moved by exactly nothing.
    pub(in crate::plan) fn rotate(&mut self, moved: &[usize], rate: Rate) {
        let step = if self.is_discrete { rate.step() } else { 1.0 };
        // Δλ = 2ω Δω
        let is_same = |low: f64, high: f64| high - low <= 2.0 * SAME_FREQUENCY * step * high.sqrt();
        let mut first = 0;
        while first < self.len() {
            let low = self.lambda[first];
            let beyond = self.lambda[first..].iter();
            let n = beyond.take_while(|&&high| is_same(low, high)).count();
            if n > 1 {
                self.rotate_group(first..first + n, moved);
            }
            first += n.max(1);
        }
    }

    /// Householder reflections, one row after the other (Golub & Van Loan, Matrix Computations, 5.1).
    fn rotate_group(&mut self, modes: Range<usize>, moved: &[usize]) {
        let n_rows = self.shapes.len();
        let mut rows: Vec<&mut Vec<f64>> = self.shapes.iter_mut().collect();
        rows.extend([&mut self.x0, &mut self.v0, &mut self.rest]);
        let moving: Vec<usize> = moved.iter().copied().chain(n_rows..n_rows + 3).collect();
        let mut left = modes;
        for &row in &moving {
            if left.is_empty() {
                return;
            }
            let remainder = &rows[row][left.clone()];
            let size = norm(remainder);
            if size <= ROW_ROUNDING * norm(rows[row]) {
                continue;
            }
            let mut mirror = remainder.to_vec();
            mirror[0] += size.copysign(remainder[0]);
            let square: f64 = mirror.iter().map(|v| v * v).sum();
            for row in &mut rows {
                let remainder = &mut row[left.clone()];
                let along: f64 = remainder.iter().zip(&mirror).map(|(x, v)| x * v).sum();
                let twice = 2.0 * along / square;
                remainder
                    .iter_mut()
                    .zip(&mirror)
                    .for_each(|(x, v)| *x -= twice * v);
            }
            left.start += 1;
            rows[row][left.clone()].fill(0.0);
        }
        for &row in &moving {
            rows[row][left.clone()].fill(0.0);
        }
    }
}

fn norm(row: &[f64]) -> f64 {
    row.iter().map(|x| x * x).sum::<f64>().sqrt()
}
