//! Modes of a body between two frames, while impulses push it at one instant after another.
//!
//! What the impulses of a frame add to the free motion of a mode is P·C(s) + Q·S(s). C and S are the motions that begin
//! with a unit of displacement and of velocity; their slopes are C' = −κ·S and S' = C − ζ·S. An impulse that changes
//! the velocity by δ at the instant s changes P by −S·δ/D and Q by C·δ/D, with D = C·S' − C'·S.

use super::bank::{LaneSum, SUM_LANES, lane_total};
use crate::maths::wide::wide;

/// One value for each mode of a group.
pub(crate) type ModeValues = [f64; SUM_LANES];

/// The constant data of the modes of a body.
#[derive(Clone, Debug)]
pub(crate) struct ModeTables {
    /// Number of polynomials in the sums that give C and S.
    pub(crate) n_polynomials: usize,
    /// Coefficients of C and S   (n_groups, n_polynomials)
    pub(crate) motion_coefficients: Vec<[ModeValues; 2]>,
    /// κ and ζ   (n_groups)
    pub(crate) kappa_and_zeta: Vec<[ModeValues; 2]>,
}

/// A running group of modes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PushedGroup {
    /// P and Q, without the impulses at this instant.
    pub(crate) amplitudes: [ModeValues; 2],
    /// C and S at this instant.
    unit_motions: [ModeValues; 2],
    /// Displacement and velocity at this instant.
    displacement_and_velocity: [ModeValues; 2],
    /// Velocity that impulses at this instant add.
    added_velocity: ModeValues,
}

impl PushedGroup {
    /// The state at the start of a frame.
    pub(crate) const START: Self = Self {
        amplitudes: [[0.0; SUM_LANES]; 2],
        unit_motions: [[1.0; SUM_LANES], [0.0; SUM_LANES]],
        displacement_and_velocity: [[0.0; SUM_LANES]; 2],
        added_velocity: [0.0; SUM_LANES],
    };

    /// Return to earlier amplitudes; the values of this instant are then invalid.
    pub(crate) fn restore(&mut self, amplitudes: [ModeValues; 2]) {
        (self.amplitudes, self.added_velocity) = (amplitudes, [0.0; SUM_LANES]);
    }
}

/// Add the impulses of this instant to the amplitudes.
#[inline(always)]
fn add_instant_impulses(group: &mut PushedGroup, [kappa, zeta]: &[ModeValues; 2]) {
    for i in 0..SUM_LANES {
        let (c, s) = (group.unit_motions[0][i], group.unit_motions[1][i]);
        let impulse_factor = group.added_velocity[i] / (c * (c - zeta[i] * s) + kappa[i] * s * s);
        group.amplitudes[0][i] -= s * impulse_factor;
        group.amplitudes[1][i] += c * impulse_factor;
    }
    group.added_velocity = [0.0; SUM_LANES];
}

wide! {
    /// Add the impulses of this instant to the amplitudes of all groups.
    pub(crate) fn add_all_impulses(tables: &ModeTables, groups: &mut [PushedGroup]) {
        for (group, rates) in groups.iter_mut().zip(&tables.kappa_and_zeta) {
            add_instant_impulses(group, rates);
        }
    }
}

wide! {
    /// Bring all groups to another instant, at which the polynomials have the `values` (n_polynomials).
    pub(crate) fn move_to_instant(tables: &ModeTables, values: &[f64], groups: &mut [PushedGroup]) {
        let motions = tables.motion_coefficients.chunks_exact(tables.n_polynomials);
        for ((group, rates), motions) in groups.iter_mut().zip(&tables.kappa_and_zeta).zip(motions) {
            add_instant_impulses(group, rates);
            let mut unit = [[0.0; SUM_LANES]; 2];
            for (motion, value) in motions.iter().zip(values) {
                for (unit, motion) in unit.iter_mut().zip(motion) {
                    for (sum, coefficient) in unit.iter_mut().zip(motion) {
                        *sum += value * coefficient;
                    }
                }
            }
            let ([p, q], [kappa, zeta]) = (&group.amplitudes, rates);
            for i in 0..SUM_LANES {
                let (c, s) = (unit[0][i], unit[1][i]);
                group.displacement_and_velocity[0][i] = p[i] * c + q[i] * s;
                group.displacement_and_velocity[1][i] = q[i] * (c - zeta[i] * s) - p[i] * kappa[i] * s;
            }
            group.unit_motions = unit;
        }
    }
}

wide! {
    /// Displacement and velocity, at this instant, of a point in which the modes have the shares `row` (n_groups).
    pub(crate) fn point_motion(row: &[ModeValues], groups: &[PushedGroup]) -> [f64; 2] {
        let mut sums = [[0.0; SUM_LANES]; 2];
        for (row, group) in row.iter().zip(groups) {
            for (sum, values) in sums.iter_mut().zip(&group.displacement_and_velocity) {
                for ((sum, share), value) in sum.iter_mut().zip(row).zip(values) {
                    *sum += share * value;
                }
            }
        }
        sums.map(|sum| lane_total(&LaneSum(sum)))
    }
}

wide! {
    /// Push a point at this instant: the velocity of each mode changes by `velocity` times its share in `row`.
    pub(crate) fn push_point(row: &[ModeValues], velocity: f64, groups: &mut [PushedGroup]) {
        for (row, group) in row.iter().zip(groups) {
            let speeds = group.displacement_and_velocity[1].iter_mut().zip(&mut group.added_velocity);
            for ((speed, added), share) in speeds.zip(row) {
                let velocity_change = velocity * share;
                *speed += velocity_change;
                *added += velocity_change;
            }
        }
    }
}
