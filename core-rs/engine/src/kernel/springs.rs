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
pub(crate) fn spread(run: &Spring, room: &mut [f64], force: &mut [f64], f: impl Fn(usize) -> f64) {
    let len = run.len;
    let (a, b) = match run.pull {
        Pull::Both(a, b) => (a, b),
        Pull::A(a) => {
            let force = &mut force[a..][..len];
            (0..len).for_each(|i| force[i] += f(i));
            return;
        }
        Pull::B(b) => {
            let force = &mut force[b..][..len];
            (0..len).for_each(|i| force[i] -= f(i));
            return;
        }
    };
    // If the two ends do not overlap, one loop gives the same sums.
    if b >= a + len {
        let (low, high) = force.split_at_mut(b);
        both(&mut low[a..][..len], &mut high[..len], f);
    } else if a >= b + len {
        let (low, high) = force.split_at_mut(a);
        both(&mut high[..len], &mut low[b..][..len], f);
    } else {
        let room = &mut room[..len];
        for (i, room) in room.iter_mut().enumerate() {
            *room = f(i);
        }
        add(room, force, a, b);
    }
}

#[inline(always)]
fn both(fa: &mut [f64], fb: &mut [f64], f: impl Fn(usize) -> f64) {
    let n = fa.len();
    let fb = &mut fb[..n];
    for i in 0..n {
        let f = f(i);
        fa[i] += f;
        fb[i] -= f;
    }
}

wide! {
    /// Add all forces at positions `x` and velocities `v` (per step).
    pub(crate) fn total(
        runs: &[Spring],
        x: &[f64],
        v: &[f64],
        room: &mut [f64],
        force: &mut [f64],
    ) {
        for run in runs {
            let Spring { len, k, q, z, rest, .. } = *run;
            let ((xa, xb), (va, vb)) = (ends(run, x), ends(run, v));
            let (xa, xb, va, vb) = (&xa[..len], &xb[..len], &va[..len], &vb[..len]);
            if q == 0.0 {
                spread(run, room, force, |i| {
                    k * (xb[i] - xa[i] - rest) + z * (vb[i] - va[i])
                });
            } else {
                spread(run, room, force, |i| {
                    let e = xb[i] - xa[i] - rest;
                    k * e + q * (e * e * e) + z * (vb[i] - va[i])
                });
            }
        }
    }
}
