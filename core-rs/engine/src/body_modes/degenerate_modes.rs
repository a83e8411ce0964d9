//! Modes of the same frequency, rotated so that as few of them as possible move.
//!
//! A body with symmetries has several modes of the same frequency and decay, and any rotation among them gives equally
//! valid modes. Rotated towards what moves the body, only as many of them move as there are such directions; all others
//! rest for ever.

use std::ops::Range;

use crate::body_modes::constants::{FREQUENCY_TOLERANCE, ROW_ROUNDING};
use crate::body_modes::normal_modes::Modes;
use crate::units::Rate;

impl Modes {
    /// Rotates modes of the same frequency towards the rows that move the body, and towards its start and rest
    /// positions. The remaining ones are then moved by exactly nothing.
    pub(crate) fn rotate(&mut self, moved_rows: &[usize], rate: Rate) {
        let step = if self.is_discrete { rate.step() } else { 1.0 };
        // Δλ = 2ω Δω
        let is_same_frequency =
            |lower_lambda: f64, high: f64| high - lower_lambda <= 2.0 * FREQUENCY_TOLERANCE * step * high.sqrt();
        let mut group_start = 0;
        while group_start < self.len() {
            let lower_lambda = self.lambda[group_start];
            let higher_lambdas = self.lambda[group_start..].iter();
            let group_size = higher_lambdas
                .take_while(|&&high| is_same_frequency(lower_lambda, high))
                .count();
            if group_size > 1 {
                self.rotate_group(group_start..group_start + group_size, moved_rows);
            }
            group_start += group_size.max(1);
        }
    }

    /// Householder reflections, one row after the other (Golub & Van Loan, Matrix Computations, 5.1).
    fn rotate_group(&mut self, modes: Range<usize>, moved_rows: &[usize]) {
        let shape_count = self.shapes.len();
        let mut mode_rows: Vec<&mut Vec<f64>> = self.shapes.iter_mut().collect();
        mode_rows.extend([&mut self.x0, &mut self.v0, &mut self.rest]);
        let moving_rows: Vec<usize> = moved_rows.iter().copied().chain(shape_count..shape_count + 3).collect();
        let mut modes_left = modes;
        for &row_index in &moving_rows {
            if modes_left.is_empty() {
                return;
            }
            let row_remainder = &mode_rows[row_index][modes_left.clone()];
            let remainder_norm = norm(row_remainder);
            if remainder_norm <= ROW_ROUNDING * norm(mode_rows[row_index]) {
                continue;
            }
            let mut mirror_vector = row_remainder.to_vec();
            mirror_vector[0] += remainder_norm.copysign(row_remainder[0]);
            let mirror_square: f64 = mirror_vector.iter().map(|v| v * v).sum();
            for mode_row in &mut mode_rows {
                let row_remainder = &mut mode_row[modes_left.clone()];
                let mirror_product: f64 = row_remainder.iter().zip(&mirror_vector).map(|(x, v)| x * v).sum();
                let mirror_factor = 2.0 * mirror_product / mirror_square;
                row_remainder
                    .iter_mut()
                    .zip(&mirror_vector)
                    .for_each(|(x, v)| *x -= mirror_factor * v);
            }
            modes_left.start += 1;
            mode_rows[row_index][modes_left.clone()].fill(0.0);
        }
        for &row in &moving_rows {
            mode_rows[row][modes_left.clone()].fill(0.0);
        }
    }
}

fn norm(row: &[f64]) -> f64 {
    row.iter().map(|x| x * x).sum::<f64>().sqrt()
}
