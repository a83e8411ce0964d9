//! Sums and combinations of long vectors, in an order that no SIMD width changes.

use crate::maths::sqrt;
use crate::maths::wide::wide;

/// Number of partial sums: that of the widest registers, on every machine.
const LANES: usize = 8;

wide! {
    /// Sum of products.
    pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
        let mut sums = [0.0; LANES];
        let (a_chunks, b_chunks) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
        let tail_sum = a_chunks.remainder().iter().zip(b_chunks.remainder());
        let tail_sum = tail_sum.fold(0.0, |sum, (a, b)| sum + a * b);
        for (a, b) in a_chunks.zip(b_chunks) {
            for lane in 0..LANES {
                sums[lane] += a[lane] * b[lane];
            }
        }
        let [s0, s1, s2, s3, s4, s5, s6, s7] = sums;
        ((s0 + s4) + (s2 + s6)) + ((s1 + s5) + (s3 + s7)) + tail_sum
    }
}

wide! {
    /// y += factor·x.
    pub(crate) fn add_scaled(factor: f64, x: &[f64], y: &mut [f64]) {
        for (y, x) in y.iter_mut().zip(x) {
            *y += factor * x;
        }
    }
}

wide! {
    /// y = x − factor·y.
    pub(super) fn scale_and_subtract(x: &[f64], factor: f64, y: &mut [f64]) {
        for (y, x) in y.iter_mut().zip(x) {
            *y = x - factor * *y;
        }
    }
}

wide! {
    fn divide(x: &mut [f64], divisor: f64) {
        x.iter_mut().for_each(|x| *x /= divisor);
    }
}

/// Length.
pub(crate) fn norm(x: &[f64]) -> f64 {
    sqrt(dot(x, x))
}

/// Bring to length 1; returns the length it had. A zero vector stays.
pub(crate) fn normalise(x: &mut [f64]) -> f64 {
    let vector_norm = norm(x);
    if vector_norm > 0.0 {
        divide(x, vector_norm);
    }
    vector_norm
}

/// Take away the parts along the orthonormal `basis`; twice, which leaves rounding only (Kahan, Parlett).
pub(crate) fn orthogonalise(x: &mut [f64], basis: &[Vec<f64>]) {
    orthogonalise_once(x, basis);
    orthogonalise_once(x, basis);
}

/// Take away the parts along the orthonormal `basis`, once.
pub(super) fn orthogonalise_once(x: &mut [f64], basis: &[Vec<f64>]) {
    for direction in basis {
        let projection = dot(direction, x);
        add_scaled(-projection, direction, x);
    }
}

/// The vectors (n) of length 1 along each axis.
pub(crate) fn unit_vectors(n: usize) -> Vec<Vec<f64>> {
    let unit_vector = |i: usize| (0..n).map(|j| f64::from(u8::from(i == j))).collect();
    (0..n).map(unit_vector).collect()
}

/// Orthonormal vectors that span `vectors`; vectors that depend on earlier ones are left out.
pub(super) fn orthonormal(vectors: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut basis: Vec<Vec<f64>> = Vec::with_capacity(vectors.len());
    for vector in vectors {
        let mut vector = vector.clone();
        let vector_norm = normalise(&mut vector);
        orthogonalise(&mut vector, &basis);
        if vector_norm > 0.0 && normalise(&mut vector) > 1e-8 {
            basis.push(vector);
        }
    }
    basis
}

/// A start vector with a part along every eigenvector: SplitMix64 (Steele, Lea, Flood 2014) of the index.
pub(super) fn start_vector(n: usize, index: usize) -> Vec<f64> {
    let seed = (index as u64 + 1).wrapping_mul(0xd1b5_4a32_d192_ed03);
    (0..n as u64)
        .map(|i| {
            let mut mixed_bits = seed.wrapping_add((i + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
            mixed_bits = (mixed_bits ^ (mixed_bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            mixed_bits = (mixed_bits ^ (mixed_bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            mixed_bits ^= mixed_bits >> 31;
            // The top 53 bits, mapped to −1 to 1.
            (mixed_bits >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        })
        .collect()
}
