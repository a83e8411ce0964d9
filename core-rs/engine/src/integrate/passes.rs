//! Inner loops over all springs of a mesh. Each loop chooses the vector instructions once per pass rather than once per
//! run, since the rows of a mesh are short.

use std::ops::Range;

use crate::kernel::springs::{add_run_forces, end_values};
use crate::maths::wide::wide;
use crate::scheme::Spring;

wide! {
    /// Add the forces of links that each have a stiffness `c`, (n_links): y −= L·p, with L their Laplacian.
    pub(super) fn apply_stiffnesses(
        runs: &[Spring],
        c: &[f64],
        p: &[f64],
        scratch: &mut [f64],
        y: &mut [f64],
    ) {
        let mut first = 0;
        for run in runs {
            let len = run.len;
            let ((pa, pb), c) = (end_values(run, p), &c[first..][..len]);
            let (pa, pb) = (&pa[..len], &pb[..len]);
            add_run_forces(run, scratch, y, |i| c[i] * (pb[i] - pa[i]));
            first += len;
        }
    }
}

wide! {
    /// Add the forces of a run to its ends: F_a += f, F_b −= f.
    pub(super) fn add_to_ends(f: &[f64], a: usize, b: usize, force: &mut [f64]) {
        for (force, f) in force[a..][..f.len()].iter_mut().zip(f) {
            *force += f;
        }
        for (force, f) in force[b..][..f.len()].iter_mut().zip(f) {
            *force -= f;
        }
    }
}

/// The ties of MATs to the ground, (n_mat) each: 1/M of the MAT, κ and ζ of its tie, and the rest position.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ties<'a> {
    pub(super) w: &'a [f64],
    pub(super) kappa: &'a [f64],
    pub(super) zeta: &'a [f64],
    pub(super) rest: &'a [f64],
}

impl<'a> Ties<'a> {
    /// The ties of a range of MATs.
    pub(super) fn range(&self, mats: Range<usize>) -> Self {
        let mat_slice = |numbers: &'a [f64]| &numbers[mats.clone()];
        Self {
            w: mat_slice(self.w),
            kappa: mat_slice(self.kappa),
            zeta: mat_slice(self.zeta),
            rest: mat_slice(self.rest),
        }
    }

    /// The same arrays, with a length that the compiler can see.
    #[inline(always)]
    fn equal_slices(&self, n: usize) -> [&[f64]; 4] {
        [&self.w[..n], &self.kappa[..n], &self.zeta[..n], &self.rest[..n]]
    }
}

wide! {
    /// v += b·(F/M − κ(x − rest)), x += a·v; `stage` is [b, a].
    pub(super) fn kick_drift(
        stage: [f64; 2],
        ties: Ties<'_>,
        force: &[f64],
        x: &mut [f64],
        v: &mut [f64],
    ) {
        let [b, a] = stage;
        let n = force.len();
        let [w, kappa, _, rest] = ties.equal_slices(n);
        let (x, v) = (&mut x[..n], &mut v[..n]);
        for i in 0..n {
            v[i] += b * (force[i] * w[i] - kappa[i] * (x[i] - rest[i]));
            x[i] += a * v[i];
        }
    }
}

wide! {
    /// v = decay·v + gain·(F/M − κ(x − rest)), x += a·v: a kick with exact losses of the ties.
    pub(super) fn decaying_kick_drift(
        a: f64,
        losses: [&[f64]; 2],
        ties: Ties<'_>,
        force: &[f64],
        x: &mut [f64],
        v: &mut [f64],
    ) {
        let n = force.len();
        let [w, kappa, _, rest] = ties.equal_slices(n);
        let [decay, gain] = losses.map(|numbers| &numbers[..n]);
        let (x, v) = (&mut x[..n], &mut v[..n]);
        for i in 0..n {
            let pull = force[i] * w[i] - kappa[i] * (x[i] - rest[i]);
            v[i] = decay[i] * v[i] + gain[i] * pull;
            x[i] += a * v[i];
        }
    }
}

wide! {
    /// v_m = v + h·((F_e + F_v)/M − κ(x − rest) − ζv).
    pub(super) fn set_midpoint_velocities(
        h: f64,
        ties: Ties<'_>,
        forces: [&[f64]; 2],
        motion: [&[f64]; 2],
        midpoint_velocities: &mut [f64],
    ) {
        let ([elastic_forces, viscous_forces], [x, v]) = (forces, motion);
        let n = elastic_forces.len();
        let [w, kappa, zeta, rest] = ties.equal_slices(n);
        let (viscous_forces, x, v) = (&viscous_forces[..n], &x[..n], &v[..n]);
        let midpoint_velocities = &mut midpoint_velocities[..n];
        for i in 0..n {
            let tie_pull = kappa[i] * (x[i] - rest[i]) + zeta[i] * v[i];
            midpoint_velocities[i] = v[i] + h * ((elastic_forces[i] + viscous_forces[i]) * w[i] - tie_pull);
        }
    }
}

wide! {
    /// v += b·((F_e + F_v)/M − κ(x − rest) − ζ·v_m), x += a·v, with F_v computed at v_m, the `midpoint_velocities`;
    /// `stage` is [b, a].
    pub(super) fn lossy_kick_drift(
        stage: [f64; 2],
        ties: Ties<'_>,
        forces: [&[f64]; 2],
        midpoint_velocities: &[f64],
        x: &mut [f64],
        v: &mut [f64],
    ) {
        let ([b, a], [elastic_forces, viscous_forces]) = (stage, forces);
        let n = elastic_forces.len();
        let [w, kappa, zeta, rest] = ties.equal_slices(n);
        let (viscous_forces, midpoint_velocities) = (&viscous_forces[..n], &midpoint_velocities[..n]);
        let (x, v) = (&mut x[..n], &mut v[..n]);
        for i in 0..n {
            let tie_pull = kappa[i] * (x[i] - rest[i]) + zeta[i] * midpoint_velocities[i];
            v[i] += b * ((elastic_forces[i] + viscous_forces[i]) * w[i] - tie_pull);
            x[i] += a * v[i];
        }
    }
}

wide! {
    /// The point at which the second pass of CA2P computes forces: x′ = x + a_e/12, v′ = d + ½(a_e + a_v), with the
    /// elastic and the viscous acceleration, including those of the ties.
    pub(super) fn set_evaluation_point(
        ties: Ties<'_>,
        forces: [&[f64]; 2],
        motion: [&[f64]; 2],
        second_positions: &mut [f64],
        v: &mut [f64],
    ) {
        let ([elastic_forces, viscous_forces], [x, d]) = (forces, motion);
        let n = elastic_forces.len();
        let [w, kappa, zeta, rest] = ties.equal_slices(n);
        let (x, d, viscous_forces) = (&x[..n], &d[..n], &viscous_forces[..n]);
        let (second_positions, v) = (&mut second_positions[..n], &mut v[..n]);
        for i in 0..n {
            let elastic_acceleration = elastic_forces[i] * w[i] - kappa[i] * (x[i] - rest[i]);
            let viscous_acceleration = viscous_forces[i] * w[i] - zeta[i] * d[i];
            second_positions[i] = x[i] + elastic_acceleration * (1.0 / 12.0);
            v[i] = d[i] + 0.5 * (elastic_acceleration + viscous_acceleration);
        }
    }
}

wide! {
    /// d += F/M − κ(x′ − rest) − ζv′, x += d, with F computed at x′, v′ (see `set_evaluation_point`); `previous` holds
    /// x and d before the step.
    pub(super) fn second_pass(
        ties: Ties<'_>,
        force: &[f64],
        point: [&[f64]; 2],
        previous: [&[f64]; 2],
        x: &mut [f64],
        d: &mut [f64],
    ) {
        let ([second_positions, v], n) = (point, force.len());
        let [previous_positions, previous_steps] = previous.map(|values| &values[..n]);
        let [w, kappa, zeta, rest] = ties.equal_slices(n);
        let (second_positions, v, x, d) = (&second_positions[..n], &v[..n], &mut x[..n], &mut d[..n]);
        for i in 0..n {
            d[i] = previous_steps[i] + (force[i] * w[i] - kappa[i] * (second_positions[i] - rest[i]) - zeta[i] * v[i]);
            x[i] = previous_positions[i] + d[i];
        }
    }
}

wide! {
    /// Whether all positions are finite and within range.
    pub(super) fn are_in_range(x: &[f64]) -> bool {
        let out_of_range_flag = x
            .iter()
            .fold(0_u64, |flag, &x| flag | u64::from(!crate::kernel::is_bounded(x)));
        out_of_range_flag == 0
    }
}
