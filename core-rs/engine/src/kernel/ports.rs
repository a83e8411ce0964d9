//! What ports see of a group of modes, and what they do to it, at instants of a frame.

use super::bank::{LANES, Lanes, Sum, joined};
use crate::maths::wide::wide;

wide! {
    /// Add to each of `way` (S + 1) the sum of a row over modes that lie between `now` and `next`, by two weights
    /// an instant.
    pub(crate) fn way(
        row: &Lanes,
        table: &[[Lanes; 2]],
        now: &Lanes,
        next: &Lanes,
        way: &mut [f64],
    ) {
        for (x, [here, there]) in way.iter_mut().zip(table) {
            let mut sum = Sum::ZERO;
            for at in (0..LANES).step_by(8) {
                for (lane, sum) in sum.0.iter_mut().enumerate() {
                    let i = at + lane;
                    *sum += row.0[i] * (here.0[i] * now.0[i] + there.0[i] * next.0[i]);
                }
            }
            *x += joined(&sum);
        }
    }
}

wide! {
    /// What impulses at instants do to modes at the next frame, and at the one after: their sums over a table.
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
    /// What a row sees of a kick.
    pub(crate) fn see(row: &Lanes, kick: &Lanes) -> f64 {
        let mut sum = Sum::ZERO;
        for at in (0..LANES).step_by(8) {
            for (lane, sum) in sum.0.iter_mut().enumerate() {
                *sum += row.0[at + lane] * kick.0[at + lane];
            }
        }
        joined(&sum)
    }
}
