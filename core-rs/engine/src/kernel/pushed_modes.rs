//! Modes of a body between two frames, while impulses push it at one instant after another.
//!
//! What the impulses of a frame add to the free motion of a mode is P·C(s) + Q·S(s). C and S are the motions that begin
//! with a unit of displacement and of velocity; their slopes are C' = −κ·S and S' = C − ζ·S. An impulse that changes
//! the velocity by δ at the instant s changes P by −S·δ/D and Q by C·δ/D, with D = C·S' − C'·S.

use super::bank::{SUMS, Sum, lane_total};
use crate::maths::wide::wide;

/// One value for each mode of a group.
pub(crate) type Group = [f64; SUMS];

/// The constant data of the modes of a body.
#[derive(Clone, Debug)]
pub(crate) struct ModeTables {
    /// Polynomials in the sums that give C and S.
    pub(crate) n: usize,
    /// Coefficients of C and S   (n_groups, n)
    pub(crate) motions: Vec<[Group; 2]>,
    /// κ and ζ   (n_groups)
    pub(crate) rates: Vec<[Group; 2]>,
}

/// A running group of modes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PushedGroup {
    /// P and Q, without the impulses at this instant.
    pub(crate) amplitudes: [Group; 2],
    /// C and S at this instant.
    unit: [Group; 2],
    /// Displacement and velocity at this instant.
    now: [Group; 2],
    /// Velocity that impulses at this instant have given.
    added_velocity: Group,
}

impl PushedGroup {
    /// The state at the start of a frame.
    pub(crate) const START: Self = Self {
        amplitudes: [[0.0; SUMS]; 2],
        unit: [[1.0; SUMS], [0.0; SUMS]],
        now: [[0.0; SUMS]; 2],
        added_velocity: [0.0; SUMS],
    };

    /// Return to earlier amplitudes; what is known of this instant is void.
    pub(crate) fn restore(&mut self, amplitudes: [Group; 2]) {
        (self.amplitudes, self.added_velocity) = (amplitudes, [0.0; SUMS]);
    }
}

/// Add the impulses of this instant to the amplitudes.
#[inline(always)]
fn add_given(group: &mut PushedGroup, [kappa, zeta]: &[Group; 2]) {
    for i in 0..SUMS {
        let (c, s) = (group.unit[0][i], group.unit[1][i]);
        let impulse_factor = group.added_velocity[i] / (c * (c - zeta[i] * s) + kappa[i] * s * s);
        group.amplitudes[0][i] -= s * impulse_factor;
        group.amplitudes[1][i] += c * impulse_factor;
    }
    group.added_velocity = [0.0; SUMS];
}

wide! {
    /// Add the impulses of this instant to the amplitudes of all groups.
    pub(crate) fn settle(tables: &ModeTables, groups: &mut [PushedGroup]) {
        for (group, rates) in groups.iter_mut().zip(&tables.rates) {
            add_given(group, rates);
        }
    }
}

wide! {
    /// Bring all groups to another instant, at which the polynomials have the `values` (n).
    pub(crate) fn bring(tables: &ModeTables, values: &[f64], groups: &mut [PushedGroup]) {
        let motions = tables.motions.chunks_exact(tables.n);
        for ((group, rates), motions) in groups.iter_mut().zip(&tables.rates).zip(motions) {
            add_given(group, rates);
            let mut unit = [[0.0; SUMS]; 2];
            for (motion, value) in motions.iter().zip(values) {
                for (unit, motion) in unit.iter_mut().zip(motion) {
                    for (own, by) in unit.iter_mut().zip(motion) {
                        *own += value * by;
                    }
                }
            }
            let ([p, q], [kappa, zeta]) = (&group.amplitudes, rates);
            for i in 0..SUMS {
                let (c, s) = (unit[0][i], unit[1][i]);
                group.now[0][i] = p[i] * c + q[i] * s;
                group.now[1][i] = q[i] * (c - zeta[i] * s) - p[i] * kappa[i] * s;
            }
            group.unit = unit;
        }
    }
}

wide! {
    /// Displacement and velocity, at this instant, of a point in which the modes have the shares `row` (n_groups).
    pub(crate) fn see(row: &[Group], groups: &[PushedGroup]) -> [f64; 2] {
        let mut sums = [[0.0; SUMS]; 2];
        for (row, group) in row.iter().zip(groups) {
            for (sum, now) in sums.iter_mut().zip(&group.now) {
                for ((sum, share), now) in sum.iter_mut().zip(row).zip(now) {
                    *sum += share * now;
                }
            }
        }
        sums.map(|sum| lane_total(&Sum(sum)))
    }
}

wide! {
    /// Push such a point at this instant: a mode whose share were 1 would change its velocity by `velocity`.
    pub(crate) fn push(row: &[Group], velocity: f64, groups: &mut [PushedGroup]) {
        for (row, group) in row.iter().zip(groups) {
            let speeds = group.now[1].iter_mut().zip(&mut group.added_velocity);
            for ((speed, given), share) in speeds.zip(row) {
                let by = velocity * share;
                *speed += by;
                *given += by;
            }
        }
    }
}
