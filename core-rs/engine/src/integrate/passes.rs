//! Inner loops over all springs of a mesh at once: chosen for the processor once a pass, not once a run,
//! since a mesh's rows are short.

use std::ops::Range;

use crate::kernel::springs::{ends, spread};
use crate::maths::wide::wide;
use crate::scheme::Spring;

wide! {
    /// Add the elastic forces at positions `x`; `room` is as long as the longest run.
    pub(super) fn elastic(runs: &[Spring], x: &[f64], room: &mut [f64], force: &mut [f64]) {
        for run in runs {
            let ((xa, xb), Spring { len, k, q, rest, .. }) = (ends(run, x), *run);
            let (xa, xb) = (&xa[..len], &xb[..len]);
            if q == 0.0 {
                spread(run, room, force, |i| k * (xb[i] - xa[i] - rest));
            } else {
                spread(run, room, force, |i| {
                    let e = xb[i] - xa[i] - rest;
                    k * e + q * (e * e * e)
                });
            }
        }
    }
}

wide! {
    /// Add the dampers' forces at velocities `v` (per step).
    pub(super) fn viscous(runs: &[Spring], v: &[f64], room: &mut [f64], force: &mut [f64]) {
        for run in runs.iter().filter(|run| run.z != 0.0) {
            let ((va, vb), Spring { len, z, .. }) = (ends(run, v), *run);
            let (va, vb) = (&va[..len], &vb[..len]);
            spread(run, room, force, |i| z * (vb[i] - va[i]));
        }
    }
}

wide! {
    /// Take the forces of links with a stiffness each: y −= L·p with L their Laplacian; `c`: (n_links).
    pub(super) fn each(
        runs: &[Spring],
        c: &[f64],
        p: &[f64],
        room: &mut [f64],
        y: &mut [f64],
    ) {
        let mut first = 0;
        for run in runs {
            let len = run.len;
            let ((pa, pb), c) = (ends(run, p), &c[first..][..len]);
            let (pa, pb) = (&pa[..len], &pb[..len]);
            spread(run, room, y, |i| c[i] * (pb[i] - pa[i]));
            first += len;
        }
    }
}

wide! {
    /// Add the forces of a run to its ends: F_a += f, F_b −= f.
    pub(super) fn pull(f: &[f64], a: usize, b: usize, force: &mut [f64]) {
        for (force, f) in force[a..][..f.len()].iter_mut().zip(f) {
            *force += f;
        }
        for (force, f) in force[b..][..f.len()].iter_mut().zip(f) {
            *force -= f;
        }
    }
}

/// What a MAT brings with it, (n_mat) each: 1/M, κ, ζ of its tie, and where the ground is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ties<'a> {
    pub(super) w: &'a [f64],
    pub(super) kappa: &'a [f64],
    pub(super) zeta: &'a [f64],
    pub(super) rest: &'a [f64],
}

impl<'a> Ties<'a> {
    /// Those of some MATs.
    pub(super) fn of(&self, mats: Range<usize>) -> Self {
        let of = |numbers: &'a [f64]| &numbers[mats.clone()];
        Self {
            w: of(self.w),
            kappa: of(self.kappa),
            zeta: of(self.zeta),
            rest: of(self.rest),
        }
    }

    /// The same, with lengths that the compiler sees.
    #[inline(always)]
    fn cut(&self, n: usize) -> [&[f64]; 4] {
        [
            &self.w[..n],
            &self.kappa[..n],
            &self.zeta[..n],
            &self.rest[..n],
        ]
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
        let [w, kappa, _, rest] = ties.cut(n);
        let (x, v) = (&mut x[..n], &mut v[..n]);
        for i in 0..n {
            v[i] += b * (force[i] * w[i] - kappa[i] * (x[i] - rest[i]));
            x[i] += a * v[i];
        }
    }
}

wide! {
    /// v = decay·v + gain·(F/M − κ(x − rest)), x += a·v: a kick among exact losses of the ties.
    pub(super) fn decaying_kick_drift(
        a: f64,
        losses: [&[f64]; 2],
        ties: Ties<'_>,
        force: &[f64],
        x: &mut [f64],
        v: &mut [f64],
    ) {
        let n = force.len();
        let [w, kappa, _, rest] = ties.cut(n);
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
    /// mid = v + h·((F_e + F_v)/M − κ(x − rest) − ζv).
    pub(super) fn midway(
        h: f64,
        ties: Ties<'_>,
        forces: [&[f64]; 2],
        motion: [&[f64]; 2],
        mid: &mut [f64],
    ) {
        let ([elastic, viscous], [x, v]) = (forces, motion);
        let n = elastic.len();
        let [w, kappa, zeta, rest] = ties.cut(n);
        let (viscous, x, v, mid) = (&viscous[..n], &x[..n], &v[..n], &mut mid[..n]);
        for i in 0..n {
            let tie = kappa[i] * (x[i] - rest[i]) + zeta[i] * v[i];
            mid[i] = v[i] + h * ((elastic[i] + viscous[i]) * w[i] - tie);
        }
    }
}

wide! {
    /// v += b·((F_e + F_v)/M − κ(x − rest) − ζ·mid), x += a·v, the forces F_v at `mid`; `stage` is [b, a].
    pub(super) fn lossy_kick_drift(
        stage: [f64; 2],
        ties: Ties<'_>,
        forces: [&[f64]; 2],
        mid: &[f64],
        x: &mut [f64],
        v: &mut [f64],
    ) {
        let ([b, a], [elastic, viscous]) = (stage, forces);
        let n = elastic.len();
        let [w, kappa, zeta, rest] = ties.cut(n);
        let (viscous, mid, x, v) = (&viscous[..n], &mid[..n], &mut x[..n], &mut v[..n]);
        for i in 0..n {
            let tie = kappa[i] * (x[i] - rest[i]) + zeta[i] * mid[i];
            v[i] += b * ((elastic[i] + viscous[i]) * w[i] - tie);
            x[i] += a * v[i];
        }
    }
}

wide! {
    /// Where CA's second pass looks: x′ = x + a_e/12, v′ = d + ½(a_e + a_v) with the elastic and the
    /// viscous acceleration, ties among them.
    pub(super) fn look(
        ties: Ties<'_>,
        forces: [&[f64]; 2],
        motion: [&[f64]; 2],
        there: &mut [f64],
        v: &mut [f64],
    ) {
        let ([elastic, viscous], [x, d]) = (forces, motion);
        let n = elastic.len();
        let [w, kappa, zeta, rest] = ties.cut(n);
        let (x, d, viscous) = (&x[..n], &d[..n], &viscous[..n]);
        let (there, v) = (&mut there[..n], &mut v[..n]);
        for i in 0..n {
            let a = elastic[i] * w[i] - kappa[i] * (x[i] - rest[i]);
            let drag = viscous[i] * w[i] - zeta[i] * d[i];
            there[i] = x[i] + a * (1.0 / 12.0);
            v[i] = d[i] + 0.5 * (a + drag);
        }
    }
}

wide! {
    /// d += F/M − κ(x′ − rest) − ζv′, x += d, with forces found at x′, v′, the `look`; `from` are x and d before.
    pub(super) fn leap(
        ties: Ties<'_>,
        force: &[f64],
        look: [&[f64]; 2],
        from: [&[f64]; 2],
        x: &mut [f64],
        d: &mut [f64],
    ) {
        let ([there, v], n) = (look, force.len());
        let [previous, by] = from.map(|from| &from[..n]);
        let [w, kappa, zeta, rest] = ties.cut(n);
        let (there, v, x, d) = (&there[..n], &v[..n], &mut x[..n], &mut d[..n]);
        for i in 0..n {
            d[i] = by[i] + (force[i] * w[i] - kappa[i] * (there[i] - rest[i]) - zeta[i] * v[i]);
            x[i] = previous[i] + d[i];
        }
    }
}

wide! {
    /// Whether all positions are finite and within range.
    pub(super) fn within(x: &[f64]) -> bool {
        let bad = x
            .iter()
            .fold(0_u64, |bad, &x| bad | u64::from(!crate::kernel::sound(x)));
        bad == 0
    }
}
