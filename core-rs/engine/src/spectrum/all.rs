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
pub(crate) fn all_eigenvalues(
    mut matrix: Vec<f64>,
    vectors: &[Vec<f64>],
) -> Option<(Vec<f64>, Vec<Vec<f64>>)> {
    let n = matrix.len().isqrt();
    let mut seen = vectors.to_vec();
    let (mut diagonal, mut off_diagonal) = reduce(&mut matrix, n, &mut seen);
    drop(matrix);
    // One row for each coordinate, so that a rotation combines two adjacent rows.
    let k = seen.len();
    let mut rotated: Vec<f64> = (0..n * k).map(|at| seen[at % k][at / k]).collect();
    iterate(&mut diagonal, &mut off_diagonal, &mut rotated, k)?;
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&i, &j| diagonal[i].total_cmp(&diagonal[j]));
    let values = order.iter().map(|&i| diagonal[i]).collect();
    let along = |vector: usize| order.iter().map(|&i| rotated[i * k + vector]).collect();
    Some((values, (0..k).map(along).collect()))
}

wide! {
    /// row −= f·w + g·v; returns the product of the new row with u.
    fn update(row: &mut [f64], f: f64, w: &[f64], g: f64, v: &[f64], u: &[f64]) -> f64 {
        let n = row.len();
        let (w, v, u) = (&w[..n], &v[..n], &u[..n]);
        let mut lanes = [0.0; 8];
        let whole = n / 8 * 8;
        for at in (0..whole).step_by(8) {
            for (lane, sum) in lanes.iter_mut().enumerate() {
                let i = at + lane;
                row[i] -= f * w[i] + g * v[i];
                *sum += row[i] * u[i];
            }
        }
        let mut tail = 0.0;
        for i in whole..n {
            row[i] -= f * w[i] + g * v[i];
            tail += row[i] * u[i];
        }
        let [s0, s1, s2, s3, s4, s5, s6, s7] = lanes;
        ((s0 + s4) + (s2 + s6)) + ((s1 + s5) + (s3 + s7)) + tail
    }
}

/// Reduces to tridiagonal form: the diagonal and the off-diagonal (n), with the reflections applied to `seen`.
fn reduce(matrix: &mut [f64], n: usize, seen: &mut [Vec<f64>]) -> (Vec<f64>, Vec<f64>) {
    let (mut diagonal, mut off_diagonal) = (vec![0.0; n], vec![0.0; n]);
    // Vectors of the last reflection: its update is applied when the next step reads the rows anyway.
    let (mut v, mut w, mut u, mut p) = (vec![0.0; n], vec![0.0; n], vec![0.0; n], vec![0.0; n]);
    let zero = vec![0.0; n];
    for k in 0..n {
        interrupt::spend((n - k) * (n - k));
        let row = &mut matrix[k * n..(k + 1) * n];
        update(&mut row[k..], v[k], &w[k..], w[k], &v[k..], &zero[k..]);
        diagonal[k] = row[k];
        if k + 1 == n {
            break;
        }
        let column = &row[k + 1..];
        let rest = dot(&column[1..], &column[1..]);
        u[..=k].fill(0.0);
        u[k + 1..].copy_from_slice(column);
        let scale = if rest == 0.0 {
            // The column is in tridiagonal form already: no reflection.
            off_diagonal[k + 1] = column[0];
            u.fill(0.0);
            0.0
        } else {
            let length = copysign(sqrt(rest + column[0] * column[0]), column[0]);
            off_diagonal[k + 1] = -length;
            u[k + 1] += length;
            2.0 / dot(&u[k + 1..], &u[k + 1..])
        };
        let idle = scale == 0.0 && v[k + 1..].iter().all(|v| *v == 0.0);
        if !idle {
            for i in k + 1..n {
                let row = &mut matrix[i * n + k + 1..(i + 1) * n];
                let (v, w) = (&v[..], &w[..]);
                p[i] = scale * update(row, v[i], &w[k + 1..], w[i], &v[k + 1..], &u[k + 1..]);
            }
        }
        let half = 0.5 * scale * dot(&u[k + 1..], &p[k + 1..]);
        for i in k + 1..n {
            (v[i], w[i]) = (
                u[i],
                if scale == 0.0 {
                    0.0
                } else {
                    p[i] - half * u[i]
                },
            );
        }
        if scale != 0.0 {
            for seen in seen.iter_mut() {
                let along = scale * dot(&u[k + 1..], &seen[k + 1..]);
                super::vector::add(-along, &u[k + 1..], &mut seen[k + 1..]);
            }
        }
    }
    (diagonal, off_diagonal)
}

/// QL with implicit shifts: `d` becomes the eigenvalues; the rotations are applied to the rows of `rotated` (n · k).
fn iterate(d: &mut [f64], e: &mut [f64], rotated: &mut [f64], k: usize) -> Option<()> {
    let n = d.len();
    e.rotate_left(1); // e[i] now couples i and i + 1
    for l in 0..n {
        for round in 0.. {
            interrupt::spend((n - l) * (k + 8));
            let is_small = |m: usize| e[m].abs() <= f64::EPSILON * (d[m].abs() + d[m + 1].abs());
            let m = (l..n - 1).find(|&m| is_small(m)).unwrap_or(n - 1);
            if m == l {
                break;
            }
            if round == QL_ITERATIONS_MAX || !d[l].is_finite() {
                return None;
            }
            // Wilkinson's shift.
            let g = (d[l + 1] - d[l]) / (2.0 * e[l]);
            let r = sqrt(g * g + 1.0);
            let mut g = d[m] - d[l] + e[l] / (g + copysign(r, g));
            let (mut s, mut c, mut p) = (1.0, 1.0, 0.0);
            let mut i = m;
            while i > l {
                i -= 1;
                let (f, b) = (s * e[i], c * e[i]);
                let r = sqrt(f * f + g * g);
                e[i + 1] = r;
                if r == 0.0 {
                    d[i + 1] -= p;
                    e[m] = 0.0;
                    break;
                }
                (s, c) = (f / r, g / r);
                let shifted = d[i + 1] - p;
                let r = (d[i] - shifted) * s + 2.0 * c * b;
                p = s * r;
                d[i + 1] = shifted + p;
                g = c * r - b;
                let (low, high) = rotated[i * k..(i + 2) * k].split_at_mut(k);
                for (low, high) in low.iter_mut().zip(high) {
                    (*low, *high) = (c * *low - s * *high, s * *low + c * *high);
                }
            }
            if e[m] == 0.0 && i > l && m != l && g == 0.0 {
                continue;
            }
            d[l] -= p;
            e[l] = g;
            e[m] = 0.0;
        }
    }
    Some(())
}
