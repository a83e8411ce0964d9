//! Products of small dense matrices in column-major order; the order of summation is independent of the vector width.

use crate::maths::wide::wide;

wide! {
    /// y += A·x; A is (y.len(), x.len()), column by column: four at a time, so that y is read and written a quarter as
    /// often. Each element is added to in the order of columns.
    pub(crate) fn add_matrix_vector(columns: &[f64], x: &[f64], y: &mut [f64]) {
        let n_rows = y.len();
        let (quad_columns, last_columns) = columns.split_at(x.len() / 4 * 4 * n_rows);
        for (columns, x) in quad_columns.chunks_exact(4 * n_rows).zip(x.chunks_exact(4)) {
            let (a0, rest) = columns.split_at(n_rows);
            let (a1, rest) = rest.split_at(n_rows);
            let (a2, a3) = rest.split_at(n_rows);
            let quads = a0.iter().zip(a1).zip(a2.iter().zip(a3));
            for (y, ((a0, a1), (a2, a3))) in y.iter_mut().zip(quads) {
                *y = *y + a0 * x[0] + a1 * x[1] + a2 * x[2] + a3 * x[3];
            }
        }
        for (column, &x) in last_columns.chunks_exact(n_rows).zip(&x[x.len() / 4 * 4..]) {
            for (y, a) in y.iter_mut().zip(column) {
                *y += a * x;
            }
        }
    }
}

wide! {
    /// C += A·B, (n, n) each: four columns at a time, so that A is read a quarter as often.
    pub(crate) fn add_matrix_product(n: usize, a: &[f64], b: &[f64], c: &mut [f64]) {
        for (c, b) in c.chunks_mut(4 * n).zip(b.chunks(4 * n)) {
            if c.len() < 4 * n {
                for (c, b) in c.chunks_exact_mut(n).zip(b.chunks_exact(n)) {
                    for (a, &b) in a.chunks_exact(n).zip(b) {
                        for (c, a) in c.iter_mut().zip(a) {
                            *c += a * b;
                        }
                    }
                }
                continue;
            }
            let (c0, rest) = c.split_at_mut(n);
            let (c1, rest) = rest.split_at_mut(n);
            let (c2, c3) = rest.split_at_mut(n);
            for (k, a) in a.chunks_exact(n).enumerate() {
                let [b0, b1, b2, b3] = [b[k], b[n + k], b[2 * n + k], b[3 * n + k]];
                let quads = c0.iter_mut().zip(c1.iter_mut()).zip(c2.iter_mut().zip(c3.iter_mut()));
                for (((c0, c1), (c2, c3)), a) in quads.zip(a) {
                    *c0 += a * b0;
                    *c1 += a * b1;
                    *c2 += a * b2;
                    *c3 += a * b3;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn apply_adds_columns_in_their_order_to_the_bit() {
        for (n_rows, n_columns) in [(1, 1), (3, 4), (7, 11), (40, 40), (29, 6), (5, 0)] {
            let entry = |i: usize| ((i * 7919 + 3) % 1009) as f64 / 37.0 - 11.3;
            let columns: Vec<f64> = (0..n_rows * n_columns).map(entry).collect();
            let x: Vec<f64> = (0..n_columns).map(|i| entry(i + 5) * 1e-3).collect();
            let mut y: Vec<f64> = (0..n_rows).map(|i| entry(i + 77)).collect();
            let mut by_columns = y.clone();
            for (column, &x) in columns.chunks_exact(n_rows).zip(&x) {
                by_columns.iter_mut().zip(column).for_each(|(y, a)| *y += a * x);
            }
            add_matrix_vector(&columns, &x, &mut y);
            assert_eq!(y, by_columns);
        }
    }
}
