//! Forces of dry friction, given all other forces: friction opposes sliding, and holds ends that stick.

use super::super::{needed, predict};
use crate::dry::Turned;
use crate::scheme::{Kind, Run, Scheme};
use crate::state::{Body, Target};

/// Two ends with given positions slide if the distance between them changes by more than this in a frame [m]; less is
/// rounding.
pub(crate) const STILL: f64 = 1e-14;
/// A step below this fraction of the largest change that friction makes to a step is rounding: the mass is at rest.
const REST: f64 = 1e-12;

/// Force of one friction, given all other forces [N].
pub(super) fn force(
    scheme: &Scheme,
    gates: &[f64],
    targets: &[Target],
    body: &Body,
    run: &Run,
) -> f64 {
    let Kind::Dry { by, rate } = &run.kind else {
        return 0.0;
    };
    let (a, b) = (run.a, run.b);
    let open = run.gate.map_or(1.0, |gate| gates[gate]);
    let v = body.d[b] - body.d[a];
    let by = by.with(run.z);
    let level = |v: f64| open * by.level_at(v * rate);
    let imposed = |i: usize| targets.iter().find(|target| target.mat == i);
    let moved = |i: usize| match imposed(i) {
        Some(target) => (target.x - body.x[i], 0.0),
        None => (predict(scheme, body, i) - body.x[i], scheme.w[i]),
    };
    let ((da, wa), (db, wb)) = (moved(a), moved(b));
    let next = db - da;
    let per_force = wa + wb;
    if per_force > 0.0 {
        let after = |level: f64| Turned::after_step(v, next - v, per_force * level).v;
        let mut v_next = after(level(v));
        if by.falls() {
            v_next = after(level(0.5 * (v + v_next)));
            // Where it passes rest, the level is that near rest, in however short a time it passes.
            if v * v_next < 0.0 && (next - v).abs() <= per_force * level(0.0) {
                v_next = 0.0;
            }
        }
        return (next - v_next) / per_force;
    }
    // Both ends are imposed or fixed.
    let level = level(0.5 * (v + next));
    if next.abs() > STILL {
        let sign = next.signum();
        // If the sliding reverses within the frame, friction acts one way before and the other way after.
        let turns = if sign * v < -STILL {
            (v + next) / (next - v)
        } else {
            1.0
        };
        return sign * level * turns;
    }
    // The ends do not slide: friction gives the force that holds them, limited by its level.
    let holding = |i: usize| {
        imposed(i)
            .filter(|_| scheme.w[i] > 0.0)
            .map(|target| needed(scheme, body, i, target.x))
    };
    match (holding(a), holding(b)) {
        (Some(push), _) => push.clamp(-level, level),
        (None, Some(push)) => (-push).clamp(-level, level),
        (None, None) => 0.0,
    }
}

/// Stop masses that friction against a fixed point has brought to rest, if only a step of the size of rounding is left.
pub(crate) fn rest(scheme: &Scheme, body: &mut Body) {
    for run in scheme.exact.iter().filter(|run| run.is_dry()) {
        for (mass, other) in [(run.a, run.b), (run.b, run.a)] {
            let is_fixed = scheme.w[other] == 0.0 && body.d[other] == 0.0;
            let step = body.d[mass];
            if is_fixed && step != 0.0 && step.abs() <= REST * scheme.w[mass] * run.z {
                body.x[mass] -= step;
                body.d[mass] = 0.0;
            }
        }
    }
}
