//! The link phase: every run in three passes (forces; pull a; pull b), so that each pass vectorises
//! although a mesh's runs overlap themselves.

use crate::network::{But, Side};
use crate::plan::{Kind, Laws, Plan, Run};
use crate::state::Body;

/// Sum the forces of all links into `body.force`, and keep each one in `body.link`.
pub(crate) fn links(plan: &Plan, gates: &[f64], body: &mut Body, laws: &mut Laws) {
    body.force.fill(0.0);
    body.outside.fill(0.0);
    for run in &plan.runs {
        let span = run.first..run.first + run.len;
        let (x, d) = (&body.x, &body.d);
        let (xa, xb) = (&x[run.a..run.a + run.len], &x[run.b..run.b + run.len]);
        let (da, db) = (&d[run.a..run.a + run.len], &d[run.b..run.b + run.len]);
        let f = &mut body.link[span.clone()];
        match &run.kind {
            Kind::Ref => {
                let (k, z, rest) = (run.k, run.z, run.rest);
                for i in 0..run.len {
                    f[i] = k * (xb[i] - xa[i] - rest) + z * (db[i] - da[i]);
                }
            }
            Kind::But(but) => {
                for i in 0..run.len {
                    f[i] = contact(but, run, xb[i] - xa[i] - run.rest, db[i] - da[i]);
                }
            }
            Kind::Lnl { law, rate, room } => {
                let (e, v) = (&mut laws.e[..run.len], &mut laws.v[..run.len]);
                for i in 0..run.len {
                    e[i] = xb[i] - xa[i] - run.rest;
                    v[i] = (db[i] - da[i]) * rate;
                }
                law.eval_run(e, v, f, &mut laws.scratch[*room]);
            }
        }
        if let Some(gate) = run.gate {
            let open = gates[gate];
            f.iter_mut().for_each(|f| *f *= open);
        }
        scatter(run, body);
    }
}

/// Add a run's forces to its two ends: F_a += f, F_b −= f.
pub(super) fn scatter(run: &Run, body: &mut Body) {
    let f = &body.link[run.first..run.first + run.len];
    for (force, f) in body.force[run.a..run.a + run.len].iter_mut().zip(f) {
        *force += f;
    }
    for (force, f) in body.force[run.b..run.b + run.len].iter_mut().zip(f) {
        *force -= f;
    }
}

/// Sign of the side a striker comes from: the penetration is s·e.
pub(crate) fn side(but: &But) -> f64 {
    match but.side {
        Side::Below => -1.0,
        Side::Above => 1.0,
    }
}

fn contact(but: &But, run: &Run, e: f64, step: f64) -> f64 {
    let s = side(but);
    s * push(but, run.k, run.z, s * e, s * step)
}

/// Size of a contact's push at penetration p [m] with p − p⁻ = `step`: K·p^α + Z·step while p > 0.
pub(crate) fn push(but: &But, k: f64, z: f64, p: f64, step: f64) -> f64 {
    if p > 0.0 {
        let push = k * power(p, but.exponent) + z * step;
        if but.clamp { push.max(0.0) } else { push }
    } else {
        0.0
    }
}

/// p^α for p >= 0, without a call where α is 1.
pub(crate) fn power(p: f64, exponent: f64) -> f64 {
    if exponent == 1.0 {
        p
    } else {
        crate::maths::pow(p, exponent)
    }
}
