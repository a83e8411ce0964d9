//! Reduction of a Hessenberg matrix to real Schur form by Francis' double-shift QR.

use crate::interrupt;
use crate::maths::{copysign, sqrt};

/// Largest number of QR rounds for one eigenvalue or pair; two to four are usual.
const ROUNDS: usize = 60;

/// Bring `h` (n, n) to real Schur form, and apply the same rotations to `turned` (n, n). Returns the eigenvalues, or
/// `None` if the iteration does not converge.
pub(super) fn iterate(h: &mut [f64], n: usize, turned: &mut [f64]) -> Option<Vec<(f64, f64)>> {
    let mut values = vec![(0.0, 0.0); n];
    let size: f64 = h.iter().map(|x| x.abs()).sum();
    let (mut end, mut round) = (n, 0);
    while end > 0 {
        interrupt::spend(8 * n * n);
        let last = end - 1;
        let first = split(h, n, last, size);
        if first == last {
            values[last] = (h[last * n + last], 0.0);
            (end, round) = (last, 0);
        } else if first + 1 == last {
            [values[first], values[last]] = pair(h, n, first, turned);
            (end, round) = (first, 0);
        } else {
            if round == ROUNDS {
                return None;
            }
            round += 1;
            sweep(h, n, [first, last], round, turned);
        }
    }
    Some(values)
}

/// First row of the unreduced block that ends at row `last`; the small subdiagonal element before it is set to 0.
fn split(h: &mut [f64], n: usize, last: usize, size: f64) -> usize {
    for l in (1..=last).rev() {
        let beside = h[(l - 1) * n + l - 1].abs() + h[l * n + l].abs();
        let scale = if beside == 0.0 { size } else { beside };
        if h[l * n + l - 1].abs() <= f64::EPSILON * scale {
            h[l * n + l - 1] = 0.0;
            return l;
        }
    }
    0
}

/// The eigenvalues of the 2 × 2 block at rows k and k + 1. If they are real, the block is made triangular.
fn pair(h: &mut [f64], n: usize, k: usize, turned: &mut [f64]) -> [(f64, f64); 2] {
    let index = |i: usize, j: usize| (k + i) * n + k + j;
    let (a, b, c, d) = (
        h[index(0, 0)],
        h[index(0, 1)],
        h[index(1, 0)],
        h[index(1, 1)],
    );
    let p = 0.5 * (a - d);
    let square = p * p + b * c;
    let root = sqrt(square.abs());
    if square < 0.0 {
        let middle = 0.5 * (a + d);
        return [(middle, root), (middle, -root)];
    }
    let far = p + copysign(root, p);
    let first = d + far;
    let other = if far == 0.0 { first } else { d - b * c / far };
    // Rotate the eigenvector of `first` into the first axis.
    let length = sqrt(far * far + c * c);
    let (cosine, sine) = (far / length, c / length);
    rotate(h, n, k, turned, [cosine, sine]);
    h[index(1, 0)] = 0.0;
    [(first, 0.0), (other, 0.0)]
}

fn rotate(h: &mut [f64], n: usize, k: usize, turned: &mut [f64], [c, s]: [f64; 2]) {
    let rows = |table: &mut [f64], from: usize| {
        let (low, high) = table[k * n..(k + 2) * n].split_at_mut(n);
        for (x, y) in low[from..].iter_mut().zip(&mut high[from..]) {
            (*x, *y) = (c * *x + s * *y, c * *y - s * *x);
        }
    };
    rows(h, k);
    rows(turned, 0);
    for row in h.chunks_exact_mut(n).take(k + 2) {
        let (x, y) = (row[k], row[k + 1]);
        (row[k], row[k + 1]) = (c * x + s * y, c * y - s * x);
    }
}

/// One double step on the block of rows `first` to `last`.
fn sweep(h: &mut [f64], n: usize, [first, last]: [usize; 2], round: usize, turned: &mut [f64]) {
    let index = |i: usize, j: usize| i * n + j;
    // Sum and product of the two shifts: the eigenvalues of the last 2 × 2 block, or exceptional shifts in every tenth
    // round, in case the iteration is stuck.
    let (sum, product) = if round.is_multiple_of(10) {
        let size = h[index(last, last - 1)].abs() + h[index(last - 1, last - 2)].abs();
        (1.5 * size, size * size)
    } else {
        let (a, b) = (h[index(last - 1, last - 1)], h[index(last - 1, last)]);
        let (c, d) = (h[index(last, last - 1)], h[index(last, last)]);
        (a + d, a * d - b * c)
    };
    let mut start = first;
    let mut column = [0.0; 3];
    // Two consecutive small subdiagonal elements also split the block.
    for m in (first..=last - 2).rev() {
        let (a, b, c) = (h[index(m, m)], h[index(m, m + 1)], h[index(m + 1, m)]);
        let (d, e) = (h[index(m + 1, m + 1)], h[index(m + 2, m + 1)]);
        column = [a * (a - sum) + product + b * c, c * (a + d - sum), c * e];
        let scale: f64 = column.iter().map(|x| x.abs()).sum();
        if scale > 0.0 {
            column.iter_mut().for_each(|x| *x /= scale);
        }
        start = m;
        if m == first {
            break;
        }
        let left = h[index(m, m - 1)].abs() * (column[1].abs() + column[2].abs());
        let beside = h[index(m - 1, m - 1)].abs() + a.abs() + d.abs();
        if left <= f64::EPSILON * column[0].abs() * beside {
            break;
        }
    }
    for k in start..last {
        let n_rows = 3.min(last + 1 - k);
        if k > start {
            for (i, x) in column.iter_mut().enumerate() {
                *x = if i < n_rows {
                    h[index(k + i, k - 1)]
                } else {
                    0.0
                };
            }
        }
        let length = sqrt(column.iter().map(|x| x * x).sum());
        if length == 0.0 {
            continue;
        }
        let length = copysign(length, column[0]);
        if k > start {
            h[index(k, k - 1)] = -length;
            (1..n_rows).for_each(|i| h[index(k + i, k - 1)] = 0.0);
        } else if start > first {
            h[index(k, k - 1)] = -h[index(k, k - 1)];
        }
        // The reflection is I − v wᵀ with v₀ = 1.
        let head = column[0] + length;
        let v = [1.0, column[1] / head, column[2] / head];
        let w = [head / length, column[1] / length, column[2] / length];
        reflect_rows(h, n, k, [v, w], k);
        reflect_rows(turned, n, k, [v, w], 0);
        let down = (last + 1).min(k + 4);
        for row in h.chunks_exact_mut(n).take(down) {
            let entries = &mut row[k..k + n_rows];
            let along: f64 = entries.iter().zip(&v).map(|(x, v)| x * v).sum();
            entries
                .iter_mut()
                .zip(&w)
                .for_each(|(x, w)| *x -= along * w);
        }
    }

    fn reflect_rows(table: &mut [f64], n: usize, k: usize, [v, w]: [[f64; 3]; 2], from: usize) {
        let (low, rest) = table[k * n..].split_at_mut(n);
        let (middle, rest) = rest.split_at_mut(n);
        let (low, middle) = (&mut low[from..], &mut middle[from..]);
        if w[2] == 0.0 {
            for (x, y) in low.iter_mut().zip(middle) {
                let along = w[0] * *x + w[1] * *y;
                (*x, *y) = (*x - along, *y - along * v[1]);
            }
            return;
        }
        let high = &mut rest[from..n];
        for ((x, y), z) in low.iter_mut().zip(middle).zip(high) {
            let along = w[0] * *x + w[1] * *y + w[2] * *z;
            (*x, *y, *z) = (*x - along, *y - along * v[1], *z - along * v[2]);
        }
    }
}
