//! All eigenvalues of a dense symmetric matrix, and the coordinates of some vectors along its eigenvectors:
//! Householder's reduction to tridiagonal form, then implicit QL (Golub & Van Loan 8.3; Bowdler, Martin, Reinsch &
//! Wilkinson 1968). The eigenvectors themselves are never formed.

use super::vector::dot;
use crate::interrupt;
use crate::maths::wide::wide;
use crate::maths::{copysign, sqrt};

/// Largest number of QL rounds for one eigenvalue; two are usual.
const QL_ITERATIONS_MAX: usize = 60;

/// Eigenvalues, rising (n,), and for each of `vectors` (n,) its coordinates along their eigenvectors, in the same order
/// (n,). `matrix` is (n, n), row after row, and is overwritten.
///
/// `None` if a number is not finite or QL does not converge.
pub(crate) fn all_eigenvalues(mut matrix: Vec<f64>, vectors: &[Vec<f64>]) -> Option<(Vec<f64>, Vec<Vec<f64>>)> {
    let dimension = matrix.len().isqrt();
    let mut reduced_vectors = vectors.to_vec();
    let (mut diagonal, mut off_diagonal) = reduce_to_tridiagonal(&mut matrix, dimension, &mut reduced_vectors);
    drop(matrix);
    // One row for each coordinate, so that a rotation combines two adjacent rows.
    let vector_count = reduced_vectors.len();
    let mut rotated_rows: Vec<f64> = (0..dimension * vector_count)
        .map(|index| reduced_vectors[index % vector_count][index / vector_count])
        .collect();
    iterate_ql(&mut diagonal, &mut off_diagonal, &mut rotated_rows, vector_count)?;
    let mut rising_order: Vec<usize> = (0..dimension).collect();
    rising_order.sort_by(|&i, &j| diagonal[i].total_cmp(&diagonal[j]));
    let eigenvalues = rising_order.iter().map(|&i| diagonal[i]).collect();
    let coordinates = |vector: usize| {
        rising_order
            .iter()
            .map(|&i| rotated_rows[i * vector_count + vector])
            .collect()
    };
    Some((eigenvalues, (0..vector_count).map(coordinates).collect()))
}

wide! {
    /// row −= f·w + g·v; returns the product of the new row with u.
    fn update_row(row: &mut [f64], f: f64, w: &[f64], g: f64, v: &[f64], u: &[f64]) -> f64 {
        let n = row.len();
        let (w, v, u) = (&w[..n], &v[..n], &u[..n]);
        let mut lanes = [0.0; 8];
        let lanes_end = n / 8 * 8;
        for index in (0..lanes_end).step_by(8) {
            for (lane, sum) in lanes.iter_mut().enumerate() {
                let i = index + lane;
                row[i] -= f * w[i] + g * v[i];
                *sum += row[i] * u[i];
            }
        }
        let mut tail_sum = 0.0;
        for i in lanes_end..n {
            row[i] -= f * w[i] + g * v[i];
            tail_sum += row[i] * u[i];
        }
        let [s0, s1, s2, s3, s4, s5, s6, s7] = lanes;
        ((s0 + s4) + (s2 + s6)) + ((s1 + s5) + (s3 + s7)) + tail_sum
    }
}

/// Reduces to tridiagonal form: the diagonal and the off-diagonal (n), with the reflections applied to `vectors`.
fn reduce_to_tridiagonal(matrix: &mut [f64], n: usize, vectors: &mut [Vec<f64>]) -> (Vec<f64>, Vec<f64>) {
    let (mut diagonal, mut off_diagonal) = (vec![0.0; n], vec![0.0; n]);
    // Vectors of the last reflection: its update is applied when the next step reads the rows anyway.
    let (mut v, mut w, mut reflector, mut scaled_image) = (vec![0.0; n], vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let zero_vector = vec![0.0; n];
    for k in 0..n {
        interrupt::spend((n - k) * (n - k));
        let matrix_row = &mut matrix[k * n..(k + 1) * n];
        update_row(&mut matrix_row[k..], v[k], &w[k..], w[k], &v[k..], &zero_vector[k..]);
        diagonal[k] = matrix_row[k];
        if k + 1 == n {
            break;
        }
        let column_below = &matrix_row[k + 1..];
        let tail_square = dot(&column_below[1..], &column_below[1..]);
        reflector[..=k].fill(0.0);
        reflector[k + 1..].copy_from_slice(column_below);
        let reflection_scale = if tail_square == 0.0 {
            // The column is in tridiagonal form already: no reflection.
            off_diagonal[k + 1] = column_below[0];
            reflector.fill(0.0);
            0.0
        } else {
            let signed_length = copysign(sqrt(tail_square + column_below[0] * column_below[0]), column_below[0]);
            off_diagonal[k + 1] = -signed_length;
            reflector[k + 1] += signed_length;
            2.0 / dot(&reflector[k + 1..], &reflector[k + 1..])
        };
        let is_unchanged = reflection_scale == 0.0 && v[k + 1..].iter().all(|v| *v == 0.0);
        if !is_unchanged {
            for i in k + 1..n {
                let matrix_row = &mut matrix[i * n + k + 1..(i + 1) * n];
                let (v, w) = (&v[..], &w[..]);
                scaled_image[i] = reflection_scale
                    * update_row(matrix_row, v[i], &w[k + 1..], w[i], &v[k + 1..], &reflector[k + 1..]);
            }
        }
        let half_product = 0.5 * reflection_scale * dot(&reflector[k + 1..], &scaled_image[k + 1..]);
        for i in k + 1..n {
            (v[i], w[i]) = (
                reflector[i],
                if reflection_scale == 0.0 {
                    0.0
                } else {
                    scaled_image[i] - half_product * reflector[i]
                },
            );
        }
        if reflection_scale != 0.0 {
            for vectors in vectors.iter_mut() {
                let projection = reflection_scale * dot(&reflector[k + 1..], &vectors[k + 1..]);
                super::vector::add_scaled(-projection, &reflector[k + 1..], &mut vectors[k + 1..]);
            }
        }
    }
    (diagonal, off_diagonal)
}

/// QL with implicit shifts: `d` becomes the eigenvalues; the rotations are applied to the rows of `rotated_rows` (n ·
/// k).
fn iterate_ql(d: &mut [f64], e: &mut [f64], rotated_rows: &mut [f64], k: usize) -> Option<()> {
    let dimension = d.len();
    e.rotate_left(1); // e[i] now couples i and i + 1
    for l in 0..dimension {
        for round in 0.. {
            interrupt::spend((dimension - l) * (k + 8));
            let is_small = |split_index: usize| {
                e[split_index].abs() <= f64::EPSILON * (d[split_index].abs() + d[split_index + 1].abs())
            };
            let split_index = (l..dimension - 1)
                .find(|&split_index| is_small(split_index))
                .unwrap_or(dimension - 1);
            if split_index == l {
                break;
            }
            if round == QL_ITERATIONS_MAX || !d[l].is_finite() {
                return None;
            }
            // Wilkinson's shift.
            let g = (d[l + 1] - d[l]) / (2.0 * e[l]);
            let r = sqrt(g * g + 1.0);
            let mut g = d[split_index] - d[l] + e[l] / (g + copysign(r, g));
            let (mut sine, mut cosine, mut correction) = (1.0, 1.0, 0.0);
            let mut row_index = split_index;
            while row_index > l {
                row_index -= 1;
                let (f, b) = (sine * e[row_index], cosine * e[row_index]);
                let r = sqrt(f * f + g * g);
                e[row_index + 1] = r;
                if r == 0.0 {
                    d[row_index + 1] -= correction;
                    e[split_index] = 0.0;
                    break;
                }
                (sine, cosine) = (f / r, g / r);
                let shifted_diagonal = d[row_index + 1] - correction;
                let r = (d[row_index] - shifted_diagonal) * sine + 2.0 * cosine * b;
                correction = sine * r;
                d[row_index + 1] = shifted_diagonal + correction;
                g = cosine * r - b;
                let (low, high) = rotated_rows[row_index * k..(row_index + 2) * k].split_at_mut(k);
                for (low, high) in low.iter_mut().zip(high) {
                    (*low, *high) = (cosine * *low - sine * *high, sine * *low + cosine * *high);
                }
            }
            if e[split_index] == 0.0 && row_index > l && split_index != l && g == 0.0 {
                continue;
            }
            d[l] -= correction;
            e[l] = g;
            e[split_index] = 0.0;
        }
    }
    Some(())
}
