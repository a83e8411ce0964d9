//! All springs of a network in one pass; each force is added to its two ends at once.
//!
//! The vector width is chosen once per pass rather than once per run, since the runs of a mesh are short.

use super::pull::add;
use crate::maths::wide::wide;
use crate::scheme::{Pull, Spring};

/// A value at both ends of every link of a run, (len) each.
#[inline(always)]
pub(crate) fn ends<'a>(run: &Spring, x: &'a [f64]) -> (&'a [f64], &'a [f64]) {
    (&x[run.a..][..run.len], &x[run.b..][..run.len])
}

/// Add f(i) of every link to its end a and subtract it from its end b, but only at the ends that `pull` names.
#[inline(always)]
pub(crate) fn spread(run: &Spring, run_scratch: &mut [f64], force: &mut [f64], f: impl Fn(usize) -> f64) {
    let link_count = run.len;
    let (first_at_a, first_at_b) = match run.pull {
        Pull::Both(first_at_a, first_at_b) => (first_at_a, first_at_b),
        Pull::A(first_at_a) => {
            let force = &mut force[first_at_a..][..link_count];
            (0..link_count).for_each(|i| force[i] += f(i));
            return;
        }
        Pull::B(first_at_b) => {
            let force = &mut force[first_at_b..][..link_count];
            (0..link_count).for_each(|i| force[i] -= f(i));
            return;
        }
    };
    // If the two ends do not overlap, one loop gives the same sums.
    if first_at_b >= first_at_a + link_count {
        let (lower_forces, upper_forces) = force.split_at_mut(first_at_b);
        both(
            &mut lower_forces[first_at_a..][..link_count],
            &mut upper_forces[..link_count],
            f,
        );
    } else if first_at_a >= first_at_b + link_count {
        let (lower_forces, upper_forces) = force.split_at_mut(first_at_a);
        both(
            &mut upper_forces[..link_count],
            &mut lower_forces[first_at_b..][..link_count],
            f,
        );
    } else {
        let run_scratch = &mut run_scratch[..link_count];
        for (i, run_scratch) in run_scratch.iter_mut().enumerate() {
            *run_scratch = f(i);
        }
        add(run_scratch, force, first_at_a, first_at_b);
    }
}

#[inline(always)]
fn both(fa: &mut [f64], fb: &mut [f64], link_force: impl Fn(usize) -> f64) {
    let link_count = fa.len();
    let fb = &mut fb[..link_count];
    for i in 0..link_count {
        let link_force = link_force(i);
        fa[i] += link_force;
        fb[i] -= link_force;
    }
}

wide! {
    /// Add all forces at positions `x` and velocities `v` (per step).
    pub(crate) fn total(
        runs: &[Spring],
        x: &[f64],
        v: &[f64],
        run_scratch: &mut [f64],
        force: &mut [f64],
    ) {
        for run in runs {
            let Spring { len, k, q, z, rest, .. } = *run;
            let ((xa, xb), (va, vb)) = (ends(run, x), ends(run, v));
            let (xa, xb, va, vb) = (&xa[..len], &xb[..len], &va[..len], &vb[..len]);
            if q == 0.0 {
                spread(run, run_scratch, force, |i| {
                    k * (xb[i] - xa[i] - rest) + z * (vb[i] - va[i])
                });
            } else {
                spread(run, run_scratch, force, |i| {
                    let e = xb[i] - xa[i] - rest;
                    k * e + q * (e * e * e) + z * (vb[i] - va[i])
                });
            }
        }
    }
}
