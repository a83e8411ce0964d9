//! Eigenvectors of a matrix in real Schur form, by back-substitution.

use crate::interrupt;
use crate::spectrum::vector::{add_scaled, dot};

/// Eigenvectors, one a row, of the matrix whose Schur form is `h` and whose Schur vectors are the rows of `schur_vectors`; a
/// conjugate pair has two rows, the real and the imaginary part   (n, n).
pub(super) fn vectors(h: &[f64], n: usize, values: &[(f64, f64)], schur_vectors: &[f64]) -> Vec<f64> {
    let largest_entry = h.iter().fold(0.0_f64, |largest_yet, x| largest_yet.max(x.abs()));
    let mut vectors = vec![0.0; n * n];
    let (mut real_parts, mut imaginary_parts) = (vec![0.0; n], vec![0.0; n]);
    for last in (0..n).rev() {
        interrupt::spend(n * n);
        let (real_part, imaginary) = values[last];
        // A pair is solved when its second eigenvalue comes.
        if imaginary > 0.0 {
            continue;
        }
        real_parts.fill(0.0);
        imaginary_parts.fill(0.0);
        let shift = (real_part, -imaginary);
        if imaginary == 0.0 {
            real_parts[last] = 1.0;
            solve(
                h,
                n,
                last,
                (shift, largest_entry),
                values,
                [&mut real_parts, &mut imaginary_parts],
            );
            add_combination(
                &real_parts,
                schur_vectors,
                last + 1,
                &mut vectors[last * n..(last + 1) * n],
            );
        } else {
            // The last block gives (a − s) x + b = 0 and c x + (d − s) = 0; use the one with the larger of b and c.
            let first_row = last - 1;
            let (a, b) = (h[first_row * n + first_row], h[first_row * n + last]);
            let (c, d) = (h[last * n + first_row], h[last * n + last]);
            (real_parts[last], imaginary_parts[last]) = (1.0, 0.0);
            (real_parts[first_row], imaginary_parts[first_row]) = if c.abs() > b.abs() {
                ((shift.0 - d) / c, shift.1 / c)
            } else {
                complex_quotient((-b, 0.0), (a - shift.0, -shift.1))
            };
            solve(
                h,
                n,
                first_row,
                (shift, largest_entry),
                values,
                [&mut real_parts, &mut imaginary_parts],
            );
            add_combination(
                &real_parts,
                schur_vectors,
                last + 1,
                &mut vectors[first_row * n..(first_row + 1) * n],
            );
            add_combination(
                &imaginary_parts,
                schur_vectors,
                last + 1,
                &mut vectors[last * n..(last + 1) * n],
            );
        }
    }
    vectors
}

/// Solves the rows above `row_end` of (H − s) x = 0.
fn solve(
    h: &[f64],
    n: usize,
    row_end: usize,
    (s, largest_entry): ((f64, f64), f64),
    values: &[(f64, f64)],
    [re, im]: [&mut [f64]; 2],
) {
    // A pivot that vanishes is replaced by one of the size of rounding.
    let safe_pivot = |x: (f64, f64)| {
        if x.0.abs() + x.1.abs() <= f64::EPSILON * largest_entry {
            (f64::EPSILON * largest_entry, 0.0)
        } else {
            x
        }
    };
    let mut row_index = row_end;
    while row_index > 0 {
        row_index -= 1;
        let negated_sum = |row: usize, from: usize, re: &[f64], im: &[f64]| {
            let row_entries = &h[row * n + from..(row + 1) * n];
            (-dot(row_entries, &re[from..]), -dot(row_entries, &im[from..]))
        };
        if values[row_index].1 == 0.0 {
            let right_side = negated_sum(row_index, row_index + 1, re, im);
            let pivot = safe_pivot((h[row_index * n + row_index] - s.0, -s.1));
            (re[row_index], im[row_index]) = complex_quotient(right_side, pivot);
        } else {
            // A 2 × 2 block: [a b; c d] − s.
            let (upper_row, lower_row) = (row_index - 1, row_index);
            let (f, g) = (
                negated_sum(upper_row, lower_row + 1, re, im),
                negated_sum(lower_row, lower_row + 1, re, im),
            );
            let (b, c) = (h[upper_row * n + lower_row], h[lower_row * n + upper_row]);
            let a = (h[upper_row * n + upper_row] - s.0, -s.1);
            let d = (h[lower_row * n + lower_row] - s.0, -s.1);
            let ad = complex_product(a, d);
            let square_norm = |x: (f64, f64)| x.0 * x.0 + x.1 * x.1;
            let mut determinant = (ad.0 - b * c, ad.1);
            let least_norm = f64::EPSILON * (largest_entry * (a.0.abs() + a.1.abs() + b.abs() + c.abs()));
            if square_norm(determinant) <= least_norm * least_norm {
                determinant = (least_norm.max(f64::MIN_POSITIVE), 0.0);
            }
            let (df, ag) = (complex_product(d, f), complex_product(a, g));
            (re[upper_row], im[upper_row]) = complex_quotient((df.0 - b * g.0, df.1 - b * g.1), determinant);
            (re[lower_row], im[lower_row]) = complex_quotient((ag.0 - c * f.0, ag.1 - c * f.1), determinant);
            row_index = upper_row;
        }
        let greatest = re[row_index].abs().max(im[row_index].abs());
        if greatest > 1e150 {
            re.iter_mut().chain(im.iter_mut()).for_each(|x| *x /= greatest);
        }
    }
}

/// Adds Σ x·row over the first `n_rows` rows to `sum`.
fn add_combination(x: &[f64], rows: &[f64], n_rows: usize, sum: &mut [f64]) {
    let dimension = sum.len();
    for (x, row) in x.iter().zip(rows.chunks_exact(dimension)).take(n_rows) {
        add_scaled(*x, row, sum);
    }
}

fn complex_product(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0)
}

/// Quotient of two complex numbers (Smith 1962).
fn complex_quotient(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    if b.1 == 0.0 {
        (a.0 / b.0, a.1 / b.0)
    } else if b.0.abs() >= b.1.abs() {
        let ratio = b.1 / b.0;
        let denominator = b.0 + ratio * b.1;
        ((a.0 + ratio * a.1) / denominator, (a.1 - ratio * a.0) / denominator)
    } else {
        let ratio = b.0 / b.1;
        let denominator = b.0 * ratio + b.1;
        ((a.0 * ratio + a.1) / denominator, (a.1 * ratio - a.0) / denominator)
    }
}
