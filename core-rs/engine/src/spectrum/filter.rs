//! The lowest modes: subspace iteration with a Chebyshev filter, which finds modes that share a frequency.
//!
//! Source: Zhou, Saad, Tiago, Chelikowsky, "Self-consistent-field calculations using Chebyshev-filtered subspace
//! iteration", J. Comput. Phys. 219 (2006), algorithms 3.1 and 4.1.

use super::vector::{add, dot, norm, normalise, orthogonalise, orthonormal, scattered};
use super::{Apply, Mode, jacobi, largest};
use crate::interrupt;
use crate::maths::{log, sqrt};

/// Vectors beyond the modes asked for: the filter's edge lies at the last of them.
const GUARDS: usize = 6;
/// Residual, relative to λ, at which a mode is known.
const KNOWN: f64 = 1e-8;
/// Residuals of so many rounding units of λmax cannot be made smaller.
const ROUNDING: f64 = 16.0 * f64::EPSILON;
/// Logarithm by which one filter raises the lowest mode over the edge: more would leave nothing but the
/// lowest mode in a raw block.
const RAISE: f64 = 16.0;
const ROUNDS: usize = 100;

/// The `k` smallest eigenvalues of a symmetric positive semi-definite operator outside the span of
/// `nullspace`, rising, with their vectors; fewer where there are fewer.
pub(crate) fn lowest_modes(
    n: usize,
    apply: Apply<'_>,
    nullspace: &[Vec<f64>],
    k: usize,
) -> Vec<Mode> {
    let null = orthonormal(nullspace);
    let available = n - null.len().min(n);
    let k = k.min(available);
    let width = (k + GUARDS + k / 4).min(available);
    if k == 0 {
        return Vec::new();
    }
    let top = largest(n, apply).safe;
    let mut block: Vec<Vec<f64>> = (0..width).map(|i| scattered(n, i + 1)).collect();
    let mut degree = 8;
    let mut modes = Vec::new();
    for round in 0..ROUNDS {
        make_orthonormal(&mut block, &null, n * round);
        let (values, residuals) = rotate(&mut block, apply);
        let known = |i: usize| residuals[i] <= f64::max(KNOWN * values[i], ROUNDING * top);
        let done = (0..k).all(known) || width == available;
        modes = values;
        if done {
            break;
        }
        let (low, edge) = (modes[0], modes[width - 1]);
        degree = degree_for(low, edge, top).min(2 * degree);
        for vector in &mut block {
            filter(vector, apply, (low, edge, top), degree);
        }
    }
    let modes = modes.into_iter().zip(block).take(k);
    modes
        .map(|(lambda, vector)| Mode { lambda, vector })
        .collect()
}

fn make_orthonormal(block: &mut [Vec<f64>], null: &[Vec<f64>], fresh: usize) {
    for i in 0..block.len() {
        interrupt::poll();
        let (done, rest) = block.split_at_mut(i);
        let vector = &mut rest[0];
        for attempt in 1..4 {
            let length = normalise(vector);
            orthogonalise(vector, null);
            orthogonalise(vector, done);
            if length > 0.0 && normalise(vector) > 1e-10 {
                break;
            }
            // It depended on the others: anything new will do.
            *vector = scattered(vector.len(), fresh + attempt * block_seed(i));
        }
    }
}

fn block_seed(i: usize) -> usize {
    1_000 + i
}

/// Rayleigh and Ritz: turn the block into its Ritz vectors; their values and residuals.
fn rotate(block: &mut Vec<Vec<f64>>, apply: Apply<'_>) -> (Vec<f64>, Vec<f64>) {
    let n = block[0].len();
    let mut images = vec![vec![0.0; n]; block.len()];
    for (vector, image) in block.iter().zip(&mut images) {
        apply(vector, image);
    }
    let small = block
        .iter()
        .map(|a| images.iter().map(|b| dot(a, b)).collect())
        .collect();
    let pairs = jacobi::eigen(small);
    let combine = |of: &[Vec<f64>], weights: &[f64]| {
        let mut sum = vec![0.0; n];
        for (weight, vector) in weights.iter().zip(of) {
            add(*weight, vector, &mut sum);
        }
        sum
    };
    let rotated: Vec<Vec<f64>> = pairs
        .iter()
        .map(|(_, weights)| {
            interrupt::poll();
            combine(block, weights)
        })
        .collect();
    let residuals = pairs
        .iter()
        .zip(&rotated)
        .map(|((value, weights), vector)| {
            let mut residual = combine(&images, weights);
            add(-value, vector, &mut residual);
            norm(&residual)
        });
    let residuals = residuals.collect();
    *block = rotated;
    (
        pairs.into_iter().map(|(value, _)| value).collect(),
        residuals,
    )
}

/// Degree that raises `low` over `edge` by e^RAISE: cosh(m·arcosh x) at x = 1 + 2(edge-low)/(top-edge).
fn degree_for(low: f64, edge: f64, top: f64) -> usize {
    let excess = 2.0 * (edge - low) / (top - edge);
    let growth = log(1.0 + excess + sqrt(excess * (excess + 2.0)));
    // All values equal: any degree does. None above the edge: a low degree does.
    if growth > 0.0 {
        (RAISE / growth).clamp(4.0, 1e5) as usize
    } else {
        64
    }
}

/// The vector seen through the Chebyshev polynomial that is small from `edge` to `top`, scaled to 1 at `low`.
fn filter(
    vector: &mut Vec<f64>,
    apply: Apply<'_>,
    (low, edge, top): (f64, f64, f64),
    degree: usize,
) {
    let (half, centre) = (0.5 * (top - edge), 0.5 * (top + edge));
    if half <= 0.0 || low >= centre {
        return;
    }
    let first = half / (low - centre);
    let mut sigma = first;
    let mut image = vec![0.0; vector.len()];
    apply(vector, &mut image);
    let mut now: Vec<f64> = image
        .iter()
        .zip(&*vector)
        .map(|(image, x)| (image - centre * x) * (sigma / half))
        .collect();
    for _ in 1..degree {
        interrupt::poll();
        let next = 1.0 / (2.0 / first - sigma);
        apply(&now, &mut image);
        let (gain, keep) = (2.0 * next / half, sigma * next);
        for ((before, now), image) in vector.iter_mut().zip(&now).zip(&image) {
            *before = (image - centre * now) * gain - keep * *before;
        }
        std::mem::swap(vector, &mut now);
        sigma = next;
    }
    *vector = now;
}
