//! The lowest mode: Lanczos without storage of the basis, in two passes.
//!
//! The first pass keeps only the tridiagonal matrix, until its lowest Ritz pair has converged; the second repeats the
//! same steps and sums the vector. Orthogonality is lost only along converged pairs (Paige 1971), so it is kept for the
//! pair that is sought. The error of the Rayleigh quotient is the square of the vector's error.

use super::vector::{
    add, dot, norm, normalise, orthogonalise, orthonormal, scale_and_subtract, start_vector,
};
use super::{Apply, Mode};
use crate::interrupt;

/// Residual, relative to λ, at which the vector counts as converged: the error of λ is residual² over the gap.
const CONVERGED: f64 = 1e-8;
/// Relative to the largest eigenvalue: rounding keeps residuals from becoming smaller than this.
const ROUNDING: f64 = 16.0 * f64::EPSILON;
/// Largest number of restarts from the vector found, if rounding has kept it from converging.
const RESTARTS: usize = 8;
/// Ratio of the step numbers of two consecutive diagonalisations of the tridiagonal matrix.
const CHECK_RATIO: f64 = 1.1;

/// The smallest eigenvalue of a symmetric positive semi-definite operator outside the span of `nullspace` (the constant
/// vector for a network without ground), and its vector.
///
/// λ is exact to about 1e-13 of itself. `None` if the nullspace is the whole space.
pub(crate) fn lowest(n: usize, apply: Apply<'_>, nullspace: &[Vec<f64>]) -> Option<Mode> {
    let null = orthonormal(nullspace);
    if null.len() >= n {
        return None;
    }
    let mut vector = start_vector(n, 1);
    let mut image = vec![0.0; n];
    let mut best: Option<(f64, Mode)> = None;
    for _ in 0..=RESTARTS {
        orthogonalise(&mut vector, &null);
        normalise(&mut vector);
        let tridiagonal = Tridiagonal::build(&vector, apply, &null);
        vector = tridiagonal.vector(vector, apply, &null);
        apply(&vector, &mut image);
        let lambda = dot(&vector, &image);
        add(-lambda, &vector, &mut image);
        let residual = norm(&image);
        // Once rounding decides the residual, a restart does not improve it.
        if best
            .as_ref()
            .is_some_and(|(before, _)| residual >= 0.5 * before)
        {
            break;
        }
        best = Some((
            residual,
            Mode {
                lambda,
                vector: vector.clone(),
            },
        ));
        if residual <= f64::max(CONVERGED * lambda, ROUNDING * tridiagonal.scale) {
            break;
        }
    }
    best.map(|(_, mode)| mode)
}

/// The tridiagonal matrix of a first pass, and its eigenvector of the lowest eigenvalue.
struct Tridiagonal {
    alphas: Vec<f64>,
    betas: Vec<f64>,
    lowest: Vec<f64>,
    /// An upper bound of the lowest eigenvalue.
    above: f64,
    /// About the size of the largest eigenvalue.
    scale: f64,
}

/// One Lanczos step: q becomes the next vector and `before` the old q; `image` is working memory   (n each). Returns α
/// and β.
fn step(
    q: &mut Vec<f64>,
    before: &mut Vec<f64>,
    image: &mut [f64],
    beta: f64,
    apply: Apply<'_>,
    null: &[Vec<f64>],
) -> (f64, f64) {
    interrupt::poll();
    let mut next = std::mem::take(before);
    apply(q, image);
    scale_and_subtract(image, beta, &mut next);
    let alpha = dot(q, &next);
    add(-alpha, q, &mut next);
    // The nullspace has the lowest eigenvalue of all: rounding would bring it back unless it is projected out.
    for direction in null {
        let along = dot(direction, &next);
        add(-along, direction, &mut next);
    }
    let beta = normalise(&mut next);
    *before = std::mem::replace(q, next);
    (alpha, beta)
}

impl Tridiagonal {
    fn build(start: &[f64], apply: Apply<'_>, null: &[Vec<f64>]) -> Self {
        let n = start.len();
        // In exact arithmetic n steps span the whole space; loss of orthogonality costs a few times as many.
        let steps_max = 4 * n + 100;
        let (mut q, mut before, mut image) = (start.to_vec(), vec![0.0; n], vec![0.0; n]);
        let mut tridiagonal = Self {
            alphas: Vec::new(),
            betas: Vec::new(),
            lowest: Vec::new(),
            above: f64::INFINITY,
            scale: 0.0,
        };
        let (mut beta, mut next_check) = (0.0, 4.0);
        loop {
            let alpha;
            (alpha, beta) = step(&mut q, &mut before, &mut image, beta, apply, null);
            tridiagonal.alphas.push(alpha);
            tridiagonal.scale = f64::max(tridiagonal.scale, alpha.abs() + beta);
            let steps = tridiagonal.alphas.len();
            let exhausted = beta <= 1e-13 * tridiagonal.scale;
            if exhausted || steps as f64 >= next_check || steps == steps_max {
                next_check *= CHECK_RATIO;
                let theta = tridiagonal.lowest_pair();
                let residual = (beta * tridiagonal.lowest[steps - 1]).abs();
                if exhausted || residual <= 0.5 * CONVERGED * theta || steps == steps_max {
                    return tridiagonal;
                }
            }
            tridiagonal.betas.push(beta);
        }
    }

    /// Finds the lowest eigenvalue by bisection, and its vector by inverse iteration from the lower bound: the matrix
    /// shifted by this bound is positive definite, so LDLᵀ needs no pivoting.
    fn lowest_pair(&mut self) -> f64 {
        /// Relative distance of the bounds: close enough to separate modes that differ by a millionth.
        const CLOSE: f64 = 1e-9;
        /// Enough halvings to reach the smallest eigenvalue of interest from the largest number; 0 is never reached.
        const HALVINGS: usize = 100;
        const ITERATIONS: usize = 5;
        let n = self.alphas.len();
        // The first component of the vector sought is never 0.
        if self.lowest.is_empty() {
            self.lowest.push(1.0);
        }
        self.lowest.resize(n, 0.0);
        let mut low = 0.0;
        // The lowest eigenvalue falls as the matrix grows, and is never above an element of its diagonal.
        let mut high = f64::min(self.above, self.alphas[n - 1]);
        for _ in 0..HALVINGS {
            interrupt::poll();
            let middle = low + 0.5 * (high - low);
            if high - low <= CLOSE * high {
                break;
            }
            *(if self.lies_above(middle) {
                &mut low
            } else {
                &mut high
            }) = middle;
        }
        self.above = high;
        let pivots = self.shifted_pivots(low);
        let s = &mut self.lowest;
        let mut distance = 0.0;
        for _ in 0..ITERATIONS {
            for i in 1..n {
                s[i] -= self.betas[i - 1] / pivots[i - 1] * s[i - 1];
            }
            s[n - 1] /= pivots[n - 1];
            for i in (0..n - 1).rev() {
                s[i] = s[i] / pivots[i] - self.betas[i] / pivots[i] * s[i + 1];
            }
            distance = 1.0 / normalise(s);
        }
        low + distance
    }

    /// D of LDLᵀ = T - shift.
    fn shifted_pivots(&self, shift: f64) -> Vec<f64> {
        let mut pivots: Vec<f64> = Vec::with_capacity(self.alphas.len());
        for (i, alpha) in self.alphas.iter().enumerate() {
            let above = pivots
                .last()
                .map_or(0.0, |p| self.betas[i - 1] * self.betas[i - 1] / p);
            // Rounding may make the last pivot 0 or negative if T itself is singular.
            pivots.push(f64::max(alpha - shift - above, f64::MIN_POSITIVE));
        }
        pivots
    }

    /// Whether T - shift is positive definite: no eigenvalue lies at or below the shift.
    fn lies_above(&self, shift: f64) -> bool {
        let mut pivot = self.alphas[0] - shift;
        for (alpha, beta) in self.alphas[1..].iter().zip(&self.betas) {
            if pivot <= 0.0 {
                return false;
            }
            pivot = alpha - shift - beta * beta / pivot;
        }
        pivot > 0.0
    }

    /// The Ritz vector: repeats the Lanczos steps and sums their vectors.
    fn vector(&self, start: Vec<f64>, apply: Apply<'_>, null: &[Vec<f64>]) -> Vec<f64> {
        let n = start.len();
        let (mut q, mut before, mut beta) = (start, vec![0.0; n], 0.0);
        let (mut sum, mut image) = (vec![0.0; n], vec![0.0; n]);
        for (i, weight) in self.lowest.iter().enumerate() {
            add(*weight, &q, &mut sum);
            if i + 1 < self.lowest.len() {
                (_, beta) = step(&mut q, &mut before, &mut image, beta, apply, null);
            }
        }
        orthogonalise(&mut sum, null);
        normalise(&mut sum);
        sum
    }
}
