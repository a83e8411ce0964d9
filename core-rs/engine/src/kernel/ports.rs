//! Coupling between ports and a group of modes at instants within a frame: reads positions, applies impulses.

use super::bank::{LANES, Lanes, SUMS, Sum, joined};
use crate::maths::wide::wide;

/// The sum of a group, lane by lane. The terms come from a loop of their own: fused with the sums they would be loaded
/// from memory one by one.
#[inline(always)]
fn summed(terms: &Lanes) -> f64 {
    let mut sum = Sum::ZERO;
    for at in (0..LANES).step_by(SUMS) {
        for (lane, sum) in sum.0.iter_mut().enumerate() {
            *sum += terms.0[at + lane];
        }
    }
    joined(&sum)
}

wide! {
    /// Add to `path` [m], (S + 1), the position of a port at each instant: the sum over modes of its row times the
    /// mode's position, interpolated between `now` and `next` with the two weights of the instant in `table`.
    pub(crate) fn add_path(
        row: &Lanes,
        table: &[[Lanes; 2]],
        now: &Lanes,
        next: &Lanes,
        path: &mut [f64],
    ) {
        for (x, [weight_now, weight_next]) in path.iter_mut().zip(table) {
            let mut terms = Lanes::ZERO;
            for (i, term) in terms.0.iter_mut().enumerate() {
                *term = row.0[i] * (weight_now.0[i] * now.0[i] + weight_next.0[i] * next.0[i]);
            }
            *x += summed(&terms);
        }
    }
}

wide! {
    /// Set `kicks` to the displacements of the modes at the next frame and at the one after it that `impulses` at the
    /// instants of `table` cause; `row`: the share of each mode.
    pub(crate) fn kick(impulses: &[f64], table: &[[Lanes; 2]], row: &Lanes, kicks: &mut [Lanes; 2]) {
        let mut sums = [[0.0; LANES]; 2];
        for (&impulse, pair) in impulses.iter().zip(table) {
            for (sums, lanes) in sums.iter_mut().zip(pair) {
                for (sum, lane) in sums.iter_mut().zip(&lanes.0) {
                    *sum += lane * impulse;
                }
            }
        }
        for (kick, sums) in kicks.iter_mut().zip(&sums) {
            for ((kick, sum), share) in kick.0.iter_mut().zip(sums).zip(&row.0) {
                *kick = sum * share;
            }
        }
    }
}

wide! {
    /// x += factor·y.
    pub(crate) fn add(x: &mut Lanes, y: &Lanes, factor: f64) {
        for (x, y) in x.0.iter_mut().zip(&y.0) {
            *x += y * factor;
        }
    }
}

wide! {
    /// Change of the position of a port by a kick: the product of its row and the kick.
    pub(crate) fn see(row: &Lanes, kick: &Lanes) -> f64 {
        let mut terms = Lanes::ZERO;
        for ((term, row), kick) in terms.0.iter_mut().zip(&row.0).zip(&kick.0) {
            *term = row * kick;
        }
        summed(&terms)
    }
}
