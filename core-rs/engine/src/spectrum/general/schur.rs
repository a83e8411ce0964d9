//! Reduction of a Hessenberg matrix to real Schur form by Francis' double-shift QR.

use crate::interrupt;
use crate::maths::{copysign, sqrt};

/// Largest number of QR rounds for one eigenvalue or pair; two to four are usual.
const ROUNDS_MAX: usize = 60;

/// Bring `h` (n, n) to real Schur form, and apply the same rotations to `rotation` (n, n). Returns the eigenvalues, or
/// `None` if the iteration does not converge.
pub(super) fn iterate(h: &mut [f64], n: usize, rotation: &mut [f64]) -> Option<Vec<(f64, f64)>> {
    let mut eigenvalues = vec![(0.0, 0.0); n];
    let matrix_norm: f64 = h.iter().map(|x| x.abs()).sum();
    let (mut block_end, mut round) = (n, 0);
    while block_end > 0 {
        interrupt::spend(8 * n * n);
        let last_row = block_end - 1;
        let first_row = unreduced_block_start(h, n, last_row, matrix_norm);
        if first_row == last_row {
            eigenvalues[last_row] = (h[last_row * n + last_row], 0.0);
            (block_end, round) = (last_row, 0);
        } else if first_row + 1 == last_row {
            [eigenvalues[first_row], eigenvalues[last_row]] = block_eigenvalues(h, n, first_row, rotation);
            (block_end, round) = (first_row, 0);
        } else {
            if round == ROUNDS_MAX {
                return None;
            }
            round += 1;
            sweep(h, n, [first_row, last_row], round, rotation);
        }
    }
    Some(eigenvalues)
}

/// First row of the unreduced block that ends at row `last`; the small subdiagonal element before it is set to 0.
fn unreduced_block_start(h: &mut [f64], n: usize, last: usize, matrix_norm: f64) -> usize {
    for l in (1..=last).rev() {
        let diagonal_sum = h[(l - 1) * n + l - 1].abs() + h[l * n + l].abs();
        let reference_size = if diagonal_sum == 0.0 { matrix_norm } else { diagonal_sum };
        if h[l * n + l - 1].abs() <= f64::EPSILON * reference_size {
            h[l * n + l - 1] = 0.0;
            return l;
        }
    }
    0
}

/// The eigenvalues of the 2 × 2 block at rows k and k + 1. If they are real, the block is made triangular.
fn block_eigenvalues(h: &mut [f64], n: usize, k: usize, rotation: &mut [f64]) -> [(f64, f64); 2] {
    let entry_index = |i: usize, j: usize| (k + i) * n + k + j;
    let (a, b, c, d) = (
        h[entry_index(0, 0)],
        h[entry_index(0, 1)],
        h[entry_index(1, 0)],
        h[entry_index(1, 1)],
    );
    let half_difference = 0.5 * (a - d);
    let discriminant = half_difference * half_difference + b * c;
    let square_root = sqrt(discriminant.abs());
    if discriminant < 0.0 {
        let real_part = 0.5 * (a + d);
        return [(real_part, square_root), (real_part, -square_root)];
    }
    let far_offset = half_difference + copysign(square_root, half_difference);
    let first_root = d + far_offset;
    let second_root = if far_offset == 0.0 {
        first_root
    } else {
        d - b * c / far_offset
    };
    // Rotate the eigenvector of `first_root` into the first axis.
    let vector_length = sqrt(far_offset * far_offset + c * c);
    let (cosine, sine) = (far_offset / vector_length, c / vector_length);
    rotate(h, n, k, rotation, [cosine, sine]);
    h[entry_index(1, 0)] = 0.0;
    [(first_root, 0.0), (second_root, 0.0)]
}

fn rotate(h: &mut [f64], n: usize, k: usize, rotation: &mut [f64], [c, s]: [f64; 2]) {
    let rotate_rows = |table: &mut [f64], first_column: usize| {
        let (first_row, second_row) = table[k * n..(k + 2) * n].split_at_mut(n);
        for (x, y) in first_row[first_column..]
            .iter_mut()
            .zip(&mut second_row[first_column..])
        {
            (*x, *y) = (c * *x + s * *y, c * *y - s * *x);
        }
    };
    rotate_rows(h, k);
    rotate_rows(rotation, 0);
    for row in h.chunks_exact_mut(n).take(k + 2) {
        let (x, y) = (row[k], row[k + 1]);
        (row[k], row[k + 1]) = (c * x + s * y, c * y - s * x);
    }
}

/// One double step on the block of rows `first` to `last`.
fn sweep(h: &mut [f64], n: usize, [first, last]: [usize; 2], round: usize, rotation: &mut [f64]) {
    let entry_index = |i: usize, j: usize| i * n + j;
    // Sum and product of the two shifts: the eigenvalues of the last 2 × 2 block, or exceptional shifts in every tenth
    // round, in case the iteration is stuck.
    let (shift_sum, product) = if round.is_multiple_of(10) {
        let subdiagonal_sum = h[entry_index(last, last - 1)].abs() + h[entry_index(last - 1, last - 2)].abs();
        (1.5 * subdiagonal_sum, subdiagonal_sum * subdiagonal_sum)
    } else {
        let (a, b) = (h[entry_index(last - 1, last - 1)], h[entry_index(last - 1, last)]);
        let (c, d) = (h[entry_index(last, last - 1)], h[entry_index(last, last)]);
        (a + d, a * d - b * c)
    };
    let mut start_row = first;
    let mut bulge_column = [0.0; 3];
    // Two consecutive small subdiagonal elements also split the block.
    for m in (first..=last - 2).rev() {
        let (a, b, c) = (h[entry_index(m, m)], h[entry_index(m, m + 1)], h[entry_index(m + 1, m)]);
        let (d, e) = (h[entry_index(m + 1, m + 1)], h[entry_index(m + 2, m + 1)]);
        bulge_column = [a * (a - shift_sum) + product + b * c, c * (a + d - shift_sum), c * e];
        let column_sum: f64 = bulge_column.iter().map(|x| x.abs()).sum();
        if column_sum > 0.0 {
            bulge_column.iter_mut().for_each(|x| *x /= column_sum);
        }
        start_row = m;
        if m == first {
            break;
        }
        let coupling_product = h[entry_index(m, m - 1)].abs() * (bulge_column[1].abs() + bulge_column[2].abs());
        let diagonal_sum = h[entry_index(m - 1, m - 1)].abs() + a.abs() + d.abs();
        if coupling_product <= f64::EPSILON * bulge_column[0].abs() * diagonal_sum {
            break;
        }
    }
    for k in start_row..last {
        let n_rows = 3.min(last + 1 - k);
        if k > start_row {
            for (i, x) in bulge_column.iter_mut().enumerate() {
                *x = if i < n_rows { h[entry_index(k + i, k - 1)] } else { 0.0 };
            }
        }
        let column_length = sqrt(bulge_column.iter().map(|x| x * x).sum());
        if column_length == 0.0 {
            continue;
        }
        let column_length = copysign(column_length, bulge_column[0]);
        if k > start_row {
            h[entry_index(k, k - 1)] = -column_length;
            (1..n_rows).for_each(|i| h[entry_index(k + i, k - 1)] = 0.0);
        } else if start_row > first {
            h[entry_index(k, k - 1)] = -h[entry_index(k, k - 1)];
        }
        // The reflection is I − v wᵀ with v₀ = 1.
        let mirror_head = bulge_column[0] + column_length;
        let v = [1.0, bulge_column[1] / mirror_head, bulge_column[2] / mirror_head];
        let w = [
            mirror_head / column_length,
            bulge_column[1] / column_length,
            bulge_column[2] / column_length,
        ];
        reflect_rows(h, n, k, [v, w], k);
        reflect_rows(rotation, n, k, [v, w], 0);
        let row_limit = (last + 1).min(k + 4);
        for row in h.chunks_exact_mut(n).take(row_limit) {
            let entries = &mut row[k..k + n_rows];
            let projection: f64 = entries.iter().zip(&v).map(|(x, v)| x * v).sum();
            entries.iter_mut().zip(&w).for_each(|(x, w)| *x -= projection * w);
        }
    }

    fn reflect_rows(table: &mut [f64], n: usize, k: usize, [v, w]: [[f64; 3]; 2], first_column: usize) {
        let (first_row, rows_below) = table[k * n..].split_at_mut(n);
        let (second_row, rows_below) = rows_below.split_at_mut(n);
        let (first_row, second_row) = (&mut first_row[first_column..], &mut second_row[first_column..]);
        if w[2] == 0.0 {
            for (x, y) in first_row.iter_mut().zip(second_row) {
                let projection = w[0] * *x + w[1] * *y;
                (*x, *y) = (*x - projection, *y - projection * v[1]);
            }
            return;
        }
        let third_row = &mut rows_below[first_column..n];
        for ((x, y), z) in first_row.iter_mut().zip(second_row).zip(third_row) {
            let projection = w[0] * *x + w[1] * *y + w[2] * *z;
            (*x, *y, *z) = (*x - projection, *y - projection * v[1], *z - projection * v[2]);
        }
    }
}
