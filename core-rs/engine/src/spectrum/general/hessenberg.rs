//! Householder's reduction to Hessenberg form.

use crate::interrupt;
use crate::maths::{copysign, sqrt};
use crate::spectrum::vector::{add_scaled, dot};

/// Reduce `matrix` (n, n) to Hessenberg form; returns the product of the reflections, transposed   (n, n).
pub(super) fn reduce(matrix: &mut [f64], n: usize) -> Vec<f64> {
    let mut rotation = vec![0.0; n * n];
    for i in 0..n {
        rotation[i * n + i] = 1.0;
    }
    let (mut mirror, mut weighted_rows) = (vec![0.0; n], vec![0.0; n]);
    for k in 0..n.saturating_sub(2) {
        interrupt::spend(4 * n * n);
        let rows_below = k + 1..n;
        for i in rows_below.clone() {
            mirror[i] = matrix[i * n + k];
        }
        let reflector = &mirror[rows_below.clone()];
        let tail_square = dot(&reflector[1..], &reflector[1..]);
        if tail_square == 0.0 {
            continue;
        }
        let leading_entry = reflector[0];
        let signed_length = copysign(sqrt(tail_square + leading_entry * leading_entry), leading_entry);
        mirror[k + 1] += signed_length;
        let reflection_scale = 2.0 / dot(&mirror[rows_below.clone()], &mirror[rows_below.clone()]);
        // From the left: changes the rows below k.
        weighted_rows.fill(0.0);
        for i in rows_below.clone() {
            add_scaled(mirror[i], &matrix[i * n..(i + 1) * n], &mut weighted_rows);
        }
        for i in rows_below.clone() {
            add_scaled(
                -reflection_scale * mirror[i],
                &weighted_rows,
                &mut matrix[i * n..(i + 1) * n],
            );
        }
        // From the right: changes the columns beyond k.
        for i in 0..n {
            let trailing_row = &mut matrix[i * n + k + 1..(i + 1) * n];
            let row_factor = -reflection_scale * dot(trailing_row, &mirror[rows_below.clone()]);
            add_scaled(row_factor, &mirror[rows_below.clone()], trailing_row);
        }
        weighted_rows.fill(0.0);
        for i in rows_below.clone() {
            add_scaled(mirror[i], &rotation[i * n..(i + 1) * n], &mut weighted_rows);
        }
        for i in rows_below {
            add_scaled(
                -reflection_scale * mirror[i],
                &weighted_rows,
                &mut rotation[i * n..(i + 1) * n],
            );
        }
        matrix[(k + 1) * n + k] = -signed_length;
        for i in k + 2..n {
            matrix[i * n + k] = 0.0;
        }
    }
    rotation
}
