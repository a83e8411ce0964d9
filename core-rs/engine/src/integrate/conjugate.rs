//! Conjugate gradients with a diagonal preconditioner (Hestenes & Stiefel 1952), iterated down to rounding.
//!
//! The number of iterations depends on the numbers alone, and every sum has a fixed order of lanes: the result has the
//! same bits on any processor.

use crate::interrupt;
use crate::maths::wide::wide;

/// The residual relative to the right side, below which only rounding is left.
const TOLERANCE: f64 = 1e-16;
/// Largest number of iterations: a mesh takes a few dozen.
const ITERATIONS_MAX: usize = 2000;
/// A restart is worth it only if the squared residual has fallen below this part of its value at the last restart.
const RESTART_GAIN: f64 = 0.1;
const LANES: usize = 8;

/// Work space for a solution.
#[derive(Clone, Debug)]
pub(super) struct ConjugateGradients {
    /// Residual r, direction p, and A·p or A·x    (n)
    r: Vec<f64>,
    p: Vec<f64>,
    y: Vec<f64>,
}

impl ConjugateGradients {
    pub(super) fn new(n: usize) -> Self {
        Self {
            r: vec![0.0; n],
            p: vec![0.0; n],
            y: vec![0.0; n],
        }
    }

    /// Solve A·x = `right_side` from the guess in `x`. `apply`: y = A·p; `inverse_diagonal`: 1 over A's diagonal, 0
    /// where x does not change.
    ///
    /// The residual that the iterations update drifts away from the true one if A is stiff. So they restart from the
    /// true residual as long as this makes it smaller.
    pub(super) fn solve(
        &mut self,
        apply: &mut dyn FnMut(&[f64], &mut [f64]),
        inverse_diagonal: &[f64],
        right_side: &[f64],
        x: &mut [f64],
    ) {
        let Self { r, p, y } = self;
        let target_square = TOLERANCE * TOLERANCE * squared_norm(inverse_diagonal, right_side);
        let (mut iterations, mut last_square) = (0, f64::INFINITY);
        while iterations < ITERATIONS_MAX {
            apply(x, y);
            let mut residual_square = residual(inverse_diagonal, right_side, y, r);
            // Written so that a NaN ends the loop too.
            if !(residual_square > target_square && residual_square < RESTART_GAIN * last_square) {
                break;
            }
            last_square = residual_square;
            update_direction(inverse_diagonal, r, 0.0, p);
            while residual_square > target_square && iterations < ITERATIONS_MAX {
                interrupt::poll_for(p.len());
                apply(p, y);
                let curvature = dot(p, y);
                if curvature <= 0.0 || curvature.is_nan() {
                    break;
                }
                let next_square = update_solution(residual_square / curvature, [inverse_diagonal, p, y], x, r);
                update_direction(inverse_diagonal, r, next_square / residual_square, p);
                residual_square = next_square;
                iterations += 1;
            }
        }
    }
}

/// The sum of f(0) … f(n − 1) by a fixed tree of eight lanes.
#[inline(always)]
fn sum(n: usize, mut f: impl FnMut(usize) -> f64) -> f64 {
    let mut lane_sums = [0.0; LANES];
    let laned_count = n - n % LANES;
    let mut block_start = 0;
    while block_start < laned_count {
        for (lane, sum) in lane_sums.iter_mut().enumerate() {
            *sum += f(block_start + lane);
        }
        block_start += LANES;
    }
    for (lane, sum) in lane_sums.iter_mut().enumerate().take(n - laned_count) {
        *sum += f(laned_count + lane);
    }
    let [a, b, c, d, e, f, g, h] = lane_sums;
    ((a + e) + (c + g)) + ((b + f) + (d + h))
}

wide! {
    fn dot(a: &[f64], b: &[f64]) -> f64 {
        let b = &b[..a.len()];
        sum(a.len(), |i| a[i] * b[i])
    }
}

wide! {
    /// Σ inverse·r².
    fn squared_norm(inverse: &[f64], r: &[f64]) -> f64 {
        let r = &r[..inverse.len()];
        sum(inverse.len(), |i| inverse[i] * (r[i] * r[i]))
    }
}

wide! {
    /// r = right − y; returns Σ inverse·r².
    fn residual(inverse: &[f64], right: &[f64], y: &[f64], r: &mut [f64]) -> f64 {
        let n = inverse.len();
        let (right, y, r) = (&right[..n], &y[..n], &mut r[..n]);
        sum(n, |i| {
            r[i] = right[i] - y[i];
            inverse[i] * (r[i] * r[i])
        })
    }
}

wide! {
    /// p = inverse·r + factor·p.
    fn update_direction(inverse: &[f64], r: &[f64], factor: f64, p: &mut [f64]) {
        let n = inverse.len();
        let (r, p) = (&r[..n], &mut p[..n]);
        for i in 0..n {
            p[i] = inverse[i] * r[i] + factor * p[i];
        }
    }
}

wide! {
    /// x += α·p, r −= α·y; returns the new Σ inverse·r². `inverse_p_and_y` are inverse, p and y.
    fn update_solution(
        alpha: f64,
        inverse_p_and_y: [&[f64]; 3],
        x: &mut [f64],
        r: &mut [f64],
    ) -> f64 {
        let [inverse, p, y] = inverse_p_and_y;
        let n = inverse.len();
        let (p, y, x, r) = (&p[..n], &y[..n], &mut x[..n], &mut r[..n]);
        sum(n, |i| {
            x[i] += alpha * p[i];
            r[i] -= alpha * y[i];
            inverse[i] * (r[i] * r[i])
        })
    }
}
