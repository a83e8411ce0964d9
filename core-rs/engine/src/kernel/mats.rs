//! The MAT phase: all kinds by one formula, d += F·w − κ(x − rest) − ζd, x += d.

use crate::plan::Plan;
use crate::state::{Body, Target};

/// Beyond this a MAT has left every stage: it is taken for non-finite [m].
const RUNAWAY: f64 = 1e4;

/// Where a MAT will be at the next frame by the forces summed so far [m].
pub(crate) fn predict(plan: &Plan, body: &Body, i: usize) -> f64 {
    let step = body.force[i] * plan.w[i]
        - plan.kappa[i] * (body.x[i] - plan.rest[i])
        - plan.zeta[i] * body.d[i];
    body.x[i] + (body.d[i] + step)
}

/// Move every MAT one frame, those with a target onto it. Says whether all stayed within reason.
pub(crate) fn advance(plan: &Plan, targets: &mut [Target], body: &mut Body) -> bool {
    for target in &mut *targets {
        target.was = body.x[target.mat];
    }
    let sound = free(plan, body);
    for target in targets {
        body.d[target.mat] = target.x - target.was;
        body.x[target.mat] = target.x;
    }
    sound
}

#[allow(clippy::neg_cmp_op_on_partial_ord)] // NaN must count as beyond
fn free(plan: &Plan, body: &mut Body) -> bool {
    let n = plan.w.len();
    let (w, kappa, zeta, rest) = (
        &plan.w[..n],
        &plan.kappa[..n],
        &plan.zeta[..n],
        &plan.rest[..n],
    );
    let (x, d, force) = (&mut body.x[..n], &mut body.d[..n], &body.force[..n]);
    let mut bad = 0_u64;
    for i in 0..n {
        let step = force[i] * w[i] - kappa[i] * (x[i] - rest[i]) - zeta[i] * d[i];
        d[i] += step;
        x[i] += d[i];
        bad |= u64::from(!(x[i].abs() <= RUNAWAY));
    }
    bad == 0
}

/// Whether one MAT is where a MAT can be.
pub(crate) fn sound(x: f64) -> bool {
    x.abs() <= RUNAWAY
}
