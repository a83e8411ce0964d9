//! The lowest mode: Lanczos without storage, in two passes.
//!
//! The first pass keeps only the tridiagonal matrix, until its lowest Ritz pair has settled; the second goes
//! the same way again and adds up the vector. Only pairs that have settled lose orthogonality
//! (Paige 1971), so the pair sought does not. A Rayleigh quotient squares the vector's error away.

use super::vector::{add, dot, norm, normalise, orthogonalise, orthonormal, scattered, take_from};
use super::{Apply, Mode};
use crate::interrupt;

/// Residual, relative to λ, at which the vector is known: λ's error is the square over the gap.
const KNOWN: f64 = 1e-8;
/// Residuals of so many rounding units of the largest eigenvalue cannot be made smaller.
const ROUNDING: f64 = 16.0 * f64::EPSILON;
/// Restarts from the vector found, should rounding have kept it from being known.
const RESTARTS: usize = 8;
/// Each look at the small matrix comes this much later than the one before.
const LOOK: f64 = 1.1;

/// The smallest eigenvalue of a symmetric positive semi-definite operator outside the span of `nullspace`
/// (the constant vector for a network without ground), and its vector.
///
/// To some 1e-13 of λ. `None` where the nullspace is all there is.
pub(crate) fn lowest(n: usize, apply: Apply<'_>, nullspace: &[Vec<f64>]) -> Option<Mode> {
    let null = orthonormal(nullspace);
    if null.len() >= n {
        return None;
    }
    let mut vector = scattered(n, 1);
    let mut image = vec![0.0; n];
    let mut best: Option<(f64, Mode)> = None;
    for _ in 0..=RESTARTS {
        orthogonalise(&mut vector, &null);
        normalise(&mut vector);
        let small = Small::build(&vector, apply, &null);
        vector = small.vector(vector, apply, &null);
        apply(&vector, &mut image);
        let lambda = dot(&vector, &image);
        add(-lambda, &vector, &mut image);
        let residual = norm(&image);
        // Once rounding decides, a restart makes nothing better.
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
        if residual <= f64::max(KNOWN * lambda, ROUNDING * small.scale) {
            break;
        }
    }
    best.map(|(_, mode)| mode)
}

/// The tridiagonal matrix of a first pass and its lowest vector.
struct Small {
    alphas: Vec<f64>,
    betas: Vec<f64>,
    lowest: Vec<f64>,
    /// Not below the lowest eigenvalue.
    above: f64,
    /// The size of the largest.
    scale: f64,
}

/// One step of Lanczos: q is replaced by what follows it, `before` by q; `image` is room   (n each).
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
    take_from(image, beta, &mut next);
    let alpha = dot(q, &next);
    add(-alpha, q, &mut next);
    // The nullspace is the lowest of all: rounding brings it back unless it is kept out.
    for direction in null {
        let along = dot(direction, &next);
        add(-along, direction, &mut next);
    }
    let beta = normalise(&mut next);
    *before = std::mem::replace(q, next);
    (alpha, beta)
}

impl Small {
    fn build(start: &[f64], apply: Apply<'_>, null: &[Vec<f64>]) -> Self {
        let n = start.len();
        // In exact arithmetic n steps see everything; lost orthogonality costs a few times as many.
        let most = 4 * n + 100;
        let (mut q, mut before, mut image) = (start.to_vec(), vec![0.0; n], vec![0.0; n]);
        let mut small = Self {
            alphas: Vec::new(),
            betas: Vec::new(),
            lowest: Vec::new(),
            above: f64::INFINITY,
            scale: 0.0,
        };
        let (mut beta, mut look) = (0.0, 4.0);
        loop {
            let alpha;
            (alpha, beta) = step(&mut q, &mut before, &mut image, beta, apply, null);
            small.alphas.push(alpha);
            small.scale = f64::max(small.scale, alpha.abs() + beta);
            let steps = small.alphas.len();
            let exhausted = beta <= 1e-13 * small.scale;
            if exhausted || steps as f64 >= look || steps == most {
                look *= LOOK;
                let theta = small.settle();
                let residual = (beta * small.lowest[steps - 1]).abs();
                if exhausted || residual <= 0.5 * KNOWN * theta || steps == most {
                    return small;
                }
            }
            small.betas.push(beta);
        }
    }

    /// The lowest eigenvalue, between bounds by bisection, and its vector by inverse iteration from the
    /// lower bound: what is left of the matrix there is positive definite, and LDLᵀ needs no pivoting.
    fn settle(&mut self) -> f64 {
        /// Bounds this close tell modes apart that lie a millionth from each other.
        const CLOSE: f64 = 1e-9;
        /// So many halvings from the largest number to the smallest of interest; 0 is never reached.
        const HALVINGS: usize = 100;
        const ITERATIONS: usize = 5;
        let n = self.alphas.len();
        // The first component of the vector sought never vanishes.
        if self.lowest.is_empty() {
            self.lowest.push(1.0);
        }
        self.lowest.resize(n, 0.0);
        let mut low = 0.0;
        // A larger matrix has a lower lowest eigenvalue, and none has it above its diagonal.
        let mut high = f64::min(self.above, self.alphas[n - 1]);
        for _ in 0..HALVINGS {
            interrupt::poll();
            let middle = low + 0.5 * (high - low);
            if high - low <= CLOSE * high {
                break;
            }
            *(if self.is_positive_less(middle) {
                &mut low
            } else {
                &mut high
            }) = middle;
        }
        self.above = high;
        let pivots = self.pivots_less(low);
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
    fn pivots_less(&self, shift: f64) -> Vec<f64> {
        let mut pivots: Vec<f64> = Vec::with_capacity(self.alphas.len());
        for (i, alpha) in self.alphas.iter().enumerate() {
            let above = pivots
                .last()
                .map_or(0.0, |p| self.betas[i - 1] * self.betas[i - 1] / p);
            // Rounding may leave a last pivot at or below 0 where T itself is singular.
            pivots.push(f64::max(alpha - shift - above, f64::MIN_POSITIVE));
        }
        pivots
    }

    /// Whether T - shift is positive definite: no eigenvalue lies at or below the shift.
    fn is_positive_less(&self, shift: f64) -> bool {
        let mut pivot = self.alphas[0] - shift;
        for (alpha, beta) in self.alphas[1..].iter().zip(&self.betas) {
            if pivot <= 0.0 {
                return false;
            }
            pivot = alpha - shift - beta * beta / pivot;
        }
        pivot > 0.0
    }

    /// The Ritz vector, the same way again.
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
