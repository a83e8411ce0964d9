//! Products of small dense matrices in column-major order; the order of summation is independent of the vector width.

use crate::maths::wide::wide;

wide! {
    /// y += A·x; A is (y.len(), x.len()), column by column.
    pub(crate) fn apply(columns: &[f64], x: &[f64], y: &mut [f64]) {
        for (column, &x) in columns.chunks_exact(y.len()).zip(x) {
            for (y, a) in y.iter_mut().zip(column) {
                *y += a * x;
            }
        }
    }
}

wide! {
    /// C += A·B, (n, n) each: four columns at a time, so that A is read a quarter as often.
    pub(crate) fn product(n: usize, a: &[f64], b: &[f64], c: &mut [f64]) {
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
                let ends = c0.iter_mut().zip(c1.iter_mut()).zip(c2.iter_mut().zip(c3.iter_mut()));
                for (((c0, c1), (c2, c3)), a) in ends.zip(a) {
                    *c0 += a * b0;
                    *c1 += a * b1;
                    *c2 += a * b2;
                    *c3 += a * b3;
                }
            }
        }
    }
}
