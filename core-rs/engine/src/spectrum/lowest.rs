//! The lowest mode: Lanczos without storage of the basis, in two passes.
//!
//! The first pass keeps only the tridiagonal matrix, until its lowest Ritz pair has converged; the second repeats the
//! same steps and sums the vector. Orthogonality is lost only along converged pairs (Paige 1971), so it is kept for the
//! pair that is sought. The error of the Rayleigh quotient is the square of the vector's error.

use super::vector::{add_scaled, dot, norm, normalise, orthogonalise, orthonormal, scale_and_subtract, start_vector};
use super::{Apply, Mode};
use crate::interrupt;

/// Residual, relative to λ, at which the vector counts as converged: the error of λ is residual² over the gap.
const CONVERGED_RESIDUAL: f64 = 1e-8;
/// Relative to the largest eigenvalue: rounding keeps residuals from becoming smaller than this.
const RELATIVE_ROUNDING: f64 = 16.0 * f64::EPSILON;
/// Largest number of restarts from the vector found, if rounding has kept it from converging.
const RESTARTS_MAX: usize = 8;
/// Ratio of the step numbers of two consecutive diagonalisations of the tridiagonal matrix.
const CHECK_RATIO: f64 = 1.1;

/// The smallest eigenvalue of a symmetric positive semi-definite operator outside the span of `nullspace` (the constant
/// vector for a network without ground), and its vector.
///
/// λ is exact to about 1e-13 of itself. `None` if the nullspace is the whole space.
pub(crate) fn lowest_mode(n: usize, apply: Apply<'_>, nullspace: &[Vec<f64>]) -> Option<Mode> {
    let null_basis = orthonormal(nullspace);
    if null_basis.len() >= n {
        return None;
    }
    let mut vector = start_vector(n, 1);
    let mut image = vec![0.0; n];
    let mut best_mode: Option<(f64, Mode)> = None;
    for _ in 0..=RESTARTS_MAX {
        orthogonalise(&mut vector, &null_basis);
        normalise(&mut vector);
        let tridiagonal = Tridiagonal::build(&vector, apply, &null_basis);
        vector = tridiagonal.vector(vector, apply, &null_basis);
        apply(&vector, &mut image);
        let lambda = dot(&vector, &image);
        add_scaled(-lambda, &vector, &mut image);
        let residual = norm(&image);
        // Once rounding decides the residual, a restart does not improve it.
        if best_mode
            .as_ref()
            .is_some_and(|(residual_before, _)| residual >= 0.5 * residual_before)
        {
            break;
        }
        best_mode = Some((
            residual,
            Mode {
                lambda,
                vector: vector.clone(),
            },
        ));
        if residual <= f64::max(CONVERGED_RESIDUAL * lambda, RELATIVE_ROUNDING * tridiagonal.scale) {
            break;
        }
    }
    best_mode.map(|(_, mode)| mode)
}

/// The tridiagonal matrix of a first pass, and its eigenvector of the lowest eigenvalue.
struct Tridiagonal {
    alphas: Vec<f64>,
    betas: Vec<f64>,
    lowest_eigenvector: Vec<f64>,
    /// An upper bound of the lowest eigenvalue.
    upper_bound: f64,
    /// About the size of the largest eigenvalue.
    scale: f64,
}

/// One Lanczos step: q becomes the next vector and `previous_vector` the old q; `image` is working memory   (n each).
/// Returns α and β.
fn step(
    q: &mut Vec<f64>,
    previous_vector: &mut Vec<f64>,
    image: &mut [f64],
    beta: f64,
    apply: Apply<'_>,
    null_basis: &[Vec<f64>],
) -> (f64, f64) {
    interrupt::poll();
    let mut next_vector = std::mem::take(previous_vector);
    apply(q, image);
    scale_and_subtract(image, beta, &mut next_vector);
    let alpha = dot(q, &next_vector);
    add_scaled(-alpha, q, &mut next_vector);
    // The nullspace has the lowest eigenvalue of all: rounding would bring it back unless it is projected out.
    for direction in null_basis {
        let projection = dot(direction, &next_vector);
        add_scaled(-projection, direction, &mut next_vector);
    }
    let beta = normalise(&mut next_vector);
    *previous_vector = std::mem::replace(q, next_vector);
    (alpha, beta)
}

impl Tridiagonal {
    fn build(start: &[f64], apply: Apply<'_>, null_basis: &[Vec<f64>]) -> Self {
        let dimension = start.len();
        // In exact arithmetic n steps span the whole space; loss of orthogonality costs a few times as many.
        let steps_max = 4 * dimension + 100;
        let (mut krylov_vector, mut previous_vector, mut image) =
            (start.to_vec(), vec![0.0; dimension], vec![0.0; dimension]);
        let mut tridiagonal = Self {
            alphas: Vec::new(),
            betas: Vec::new(),
            lowest_eigenvector: Vec::new(),
            upper_bound: f64::INFINITY,
            scale: 0.0,
        };
        let (mut beta, mut next_check) = (0.0, 4.0);
        loop {
            let alpha;
            (alpha, beta) = step(
                &mut krylov_vector,
                &mut previous_vector,
                &mut image,
                beta,
                apply,
                null_basis,
            );
            tridiagonal.alphas.push(alpha);
            tridiagonal.scale = f64::max(tridiagonal.scale, alpha.abs() + beta);
            let step_count = tridiagonal.alphas.len();
            let is_exhausted = beta <= 1e-13 * tridiagonal.scale;
            if is_exhausted || step_count as f64 >= next_check || step_count == steps_max {
                next_check *= CHECK_RATIO;
                let theta = tridiagonal.lowest_pair();
                let residual = (beta * tridiagonal.lowest_eigenvector[step_count - 1]).abs();
                if is_exhausted || residual <= 0.5 * CONVERGED_RESIDUAL * theta || step_count == steps_max {
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
        const BISECTION_TOLERANCE: f64 = 1e-9;
        /// Enough halvings to reach the smallest eigenvalue of interest from the largest number; 0 is never reached.
        const HALVINGS: usize = 100;
        const ITERATIONS: usize = 5;
        let dimension = self.alphas.len();
        // The first component of the vector sought is never 0.
        if self.lowest_eigenvector.is_empty() {
            self.lowest_eigenvector.push(1.0);
        }
        self.lowest_eigenvector.resize(dimension, 0.0);
        let mut lower_bound = 0.0;
        // The lowest eigenvalue falls as the matrix grows, and is never above an element of its diagonal.
        let mut upper_bound = f64::min(self.upper_bound, self.alphas[dimension - 1]);
        for _ in 0..HALVINGS {
            interrupt::poll();
            let midpoint = lower_bound + 0.5 * (upper_bound - lower_bound);
            if upper_bound - lower_bound <= BISECTION_TOLERANCE * upper_bound {
                break;
            }
            *(if self.lies_above(midpoint) {
                &mut lower_bound
            } else {
                &mut upper_bound
            }) = midpoint;
        }
        self.upper_bound = upper_bound;
        let pivots = self.shifted_pivots(lower_bound);
        let eigenvector = &mut self.lowest_eigenvector;
        let mut distance = 0.0;
        for _ in 0..ITERATIONS {
            for i in 1..dimension {
                eigenvector[i] -= self.betas[i - 1] / pivots[i - 1] * eigenvector[i - 1];
            }
            eigenvector[dimension - 1] /= pivots[dimension - 1];
            for i in (0..dimension - 1).rev() {
                eigenvector[i] = eigenvector[i] / pivots[i] - self.betas[i] / pivots[i] * eigenvector[i + 1];
            }
            distance = 1.0 / normalise(eigenvector);
        }
        lower_bound + distance
    }

    /// D of LDLᵀ = T - shift.
    fn shifted_pivots(&self, shift: f64) -> Vec<f64> {
        let mut pivots: Vec<f64> = Vec::with_capacity(self.alphas.len());
        for (i, alpha) in self.alphas.iter().enumerate() {
            let pivot_update = pivots.last().map_or(0.0, |p| self.betas[i - 1] * self.betas[i - 1] / p);
            // Rounding may make the last pivot 0 or negative if T itself is singular.
            pivots.push(f64::max(alpha - shift - pivot_update, f64::MIN_POSITIVE));
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
    fn vector(&self, start: Vec<f64>, apply: Apply<'_>, null_basis: &[Vec<f64>]) -> Vec<f64> {
        let dimension = start.len();
        let (mut krylov_vector, mut previous_vector, mut beta) = (start, vec![0.0; dimension], 0.0);
        let (mut ritz_vector, mut image) = (vec![0.0; dimension], vec![0.0; dimension]);
        for (i, weight) in self.lowest_eigenvector.iter().enumerate() {
            add_scaled(*weight, &krylov_vector, &mut ritz_vector);
            if i + 1 < self.lowest_eigenvector.len() {
                (_, beta) = step(
                    &mut krylov_vector,
                    &mut previous_vector,
                    &mut image,
                    beta,
                    apply,
                    null_basis,
                );
            }
        }
        orthogonalise(&mut ritz_vector, null_basis);
        normalise(&mut ritz_vector);
        ritz_vector
    }
}
