//! Eigenvectors of a matrix in real Schur form, by back-substitution.

use crate::interrupt;
use crate::spectrum::vector::{add, dot};

/// Eigenvectors, one a row, of the matrix whose Schur form is `h` and whose Schur vectors are the rows of `turned`; a
/// conjugate pair has two rows, the real and the imaginary part   (n, n).
pub(super) fn vectors(h: &[f64], n: usize, values: &[(f64, f64)], turned: &[f64]) -> Vec<f64> {
    let size = h.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    let mut vectors = vec![0.0; n * n];
    let (mut re, mut im) = (vec![0.0; n], vec![0.0; n]);
    for last in (0..n).rev() {
        interrupt::spend(n * n);
        let (value, imaginary) = values[last];
        // A pair is solved when its second eigenvalue comes.
        if imaginary > 0.0 {
            continue;
        }
        re.fill(0.0);
        im.fill(0.0);
        let shift = (value, -imaginary);
        if imaginary == 0.0 {
            re[last] = 1.0;
            solve(h, n, last, (shift, size), values, [&mut re, &mut im]);
            combine(
                &re,
                turned,
                last + 1,
                &mut vectors[last * n..(last + 1) * n],
            );
        } else {
            // The last block gives (a − s) x + b = 0 and c x + (d − s) = 0; use the one with the larger of b and c.
            let k = last - 1;
            let (a, b) = (h[k * n + k], h[k * n + last]);
            let (c, d) = (h[last * n + k], h[last * n + last]);
            (re[last], im[last]) = (1.0, 0.0);
            (re[k], im[k]) = if c.abs() > b.abs() {
                ((shift.0 - d) / c, shift.1 / c)
            } else {
                divide((-b, 0.0), (a - shift.0, -shift.1))
            };
            solve(h, n, k, (shift, size), values, [&mut re, &mut im]);
            combine(&re, turned, last + 1, &mut vectors[k * n..(k + 1) * n]);
            combine(
                &im,
                turned,
                last + 1,
                &mut vectors[last * n..(last + 1) * n],
            );
        }
    }
    vectors
}

/// Solves the rows above `below` of (H − s) x = 0.
fn solve(
    h: &[f64],
    n: usize,
    below: usize,
    (s, size): ((f64, f64), f64),
    values: &[(f64, f64)],
    [re, im]: [&mut [f64]; 2],
) {
    // A pivot that vanishes is replaced by one of the size of rounding.
    let pivot = |x: (f64, f64)| {
        if x.0.abs() + x.1.abs() <= f64::EPSILON * size {
            (f64::EPSILON * size, 0.0)
        } else {
            x
        }
    };
    let mut i = below;
    while i > 0 {
        i -= 1;
        let rest = |row: usize, from: usize, re: &[f64], im: &[f64]| {
            let row_entries = &h[row * n + from..(row + 1) * n];
            (
                -dot(row_entries, &re[from..]),
                -dot(row_entries, &im[from..]),
            )
        };
        if values[i].1 == 0.0 {
            let right = rest(i, i + 1, re, im);
            let row_entries = pivot((h[i * n + i] - s.0, -s.1));
            (re[i], im[i]) = divide(right, row_entries);
        } else {
            // A 2 × 2 block: [a b; c d] − s.
            let (k, l) = (i - 1, i);
            let (f, g) = (rest(k, l + 1, re, im), rest(l, l + 1, re, im));
            let (b, c) = (h[k * n + l], h[l * n + k]);
            let a = (h[k * n + k] - s.0, -s.1);
            let d = (h[l * n + l] - s.0, -s.1);
            let ad = times(a, d);
            let square = |x: (f64, f64)| x.0 * x.0 + x.1 * x.1;
            let mut det = (ad.0 - b * c, ad.1);
            let least = f64::EPSILON * (size * (a.0.abs() + a.1.abs() + b.abs() + c.abs()));
            if square(det) <= least * least {
                det = (least.max(f64::MIN_POSITIVE), 0.0);
            }
            let (df, ag) = (times(d, f), times(a, g));
            (re[k], im[k]) = divide((df.0 - b * g.0, df.1 - b * g.1), det);
            (re[l], im[l]) = divide((ag.0 - c * f.0, ag.1 - c * f.1), det);
            i = k;
        }
        let greatest = re[i].abs().max(im[i].abs());
        if greatest > 1e150 {
            re.iter_mut()
                .chain(im.iter_mut())
                .for_each(|x| *x /= greatest);
        }
    }
}

/// Adds Σ x·row over the first `n_rows` rows to `sum`.
fn combine(x: &[f64], rows: &[f64], n_rows: usize, sum: &mut [f64]) {
    let n = sum.len();
    for (x, row) in x.iter().zip(rows.chunks_exact(n)).take(n_rows) {
        add(*x, row, sum);
    }
}

fn times(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0)
}

/// Quotient of two complex numbers (Smith 1962).
fn divide(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    if b.1 == 0.0 {
        (a.0 / b.0, a.1 / b.0)
    } else if b.0.abs() >= b.1.abs() {
        let ratio = b.1 / b.0;
        let under = b.0 + ratio * b.1;
        ((a.0 + ratio * a.1) / under, (a.1 - ratio * a.0) / under)
    } else {
        let ratio = b.0 / b.1;
        let under = b.0 * ratio + b.1;
        ((a.0 * ratio + a.1) / under, (a.1 * ratio - a.0) / under)
    }
}
