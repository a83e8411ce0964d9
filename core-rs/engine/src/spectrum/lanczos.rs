//! The largest eigenvalue, with bounds: Lanczos with full reorthogonalisation.

use super::vector::{add_scaled, dot, normalise, orthogonalise, start_vector};
use super::{Apply, jacobi};
use crate::interrupt;

/// Largest number of steps; the bounds cover the error that is left then.
const STEPS_MAX: usize = 60;
/// Largest number of stored values (96 MB): a network of millions of masses gets fewer steps.
const STORED_MAX: usize = 12_000_000;
/// Number of steps between two diagonalisations of the tridiagonal matrix.
const CHECK_EVERY: usize = 5;
/// Relative residual at which the eigenvalue counts as converged.
const CONVERGED_RESIDUAL: f64 = 1e-10;

/// The upper end of a spectrum.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LargestRitz {
    /// The largest Ritz value: a lower bound of λmax.
    pub(crate) theta: f64,
    /// |β_k s_k|: an eigenvalue lies within this of `theta`.
    pub(crate) residual: f64,
    /// θ + |β_k|: in practice always an upper bound of λmax (Zhou & Li 2011), loose before convergence.
    pub(crate) upper_bound: f64,
    /// Steps taken, k.
    pub(crate) steps: usize,
    /// The Ritz vector (n,), of length 1.
    pub(crate) vector: Vec<f64>,
}

/// The largest eigenvalue of the symmetric operator `apply` on vectors of `n` >= 1 numbers.
pub(crate) fn largest_eigenvalue(n: usize, apply: Apply<'_>) -> LargestRitz {
    largest_eigenvalue_up_to(n, apply, f64::INFINITY)
}

/// As [`largest_eigenvalue`], but stops as soon as the largest eigenvalue is known to be at least `enough`.
pub(crate) fn largest_eigenvalue_up_to(n: usize, apply: Apply<'_>, enough: f64) -> LargestRitz {
    let steps_max = STEPS_MAX.min(n).min((STORED_MAX / n.max(1)).max(8));
    let mut next_vector = start_vector(n, 0);
    normalise(&mut next_vector);
    let mut basis: Vec<Vec<f64>> = Vec::new();
    let (mut alphas, mut betas): (Vec<f64>, Vec<f64>) = (Vec::new(), Vec::new());
    loop {
        interrupt::spend(n * (2 * basis.len() + 16));
        let mut image = vec![0.0; n];
        apply(&next_vector, &mut image);
        let alpha = dot(&next_vector, &image);
        basis.push(next_vector);
        alphas.push(alpha);
        orthogonalise(&mut image, &basis);
        let beta = normalise(&mut image);
        let steps = basis.len();
        // Only rounding is left: the Krylov space of the start vector is exhausted.
        let is_exhausted = steps == n || beta <= 1e-14 * (alpha.abs() + betas.last().unwrap_or(&0.0));
        let is_last = is_exhausted || steps == steps_max;
        if is_last || steps.is_multiple_of(CHECK_EVERY) {
            let beta = if is_exhausted { 0.0 } else { beta };
            let (theta, ritz_weights) = jacobi::largest_eigenpair(tridiagonal(&alphas, &betas));
            let residual = (beta * ritz_weights[steps - 1]).abs();
            if is_last || residual <= CONVERGED_RESIDUAL * theta.abs() || theta >= enough {
                let mut vector = vec![0.0; n];
                for (weight, direction) in ritz_weights.iter().zip(&basis) {
                    interrupt::poll_for(n);
                    add_scaled(*weight, direction, &mut vector);
                }
                return LargestRitz {
                    theta,
                    residual,
                    upper_bound: theta + beta,
                    steps,
                    vector,
                };
            }
        }
        betas.push(beta);
        next_vector = image;
    }
}

fn tridiagonal(alphas: &[f64], betas: &[f64]) -> Vec<Vec<f64>> {
    let dimension = alphas.len();
    let mut matrix = vec![vec![0.0; dimension]; dimension];
    for (i, alpha) in alphas.iter().enumerate() {
        matrix[i][i] = *alpha;
    }
    for (i, beta) in betas.iter().enumerate() {
        (matrix[i][i + 1], matrix[i + 1][i]) = (*beta, *beta);
    }
    matrix
}
