//! Pushes and ergons of a timeline.

use super::{Matter, Record, Script, State};
use crate::kernel;
use crate::scheme::Scheme;

/// Applies the pushes and ergons that fall on frame `n`.
pub(super) fn strike(script: &Script, scheme: &Scheme, state: &mut State, n: u64) {
    let t = 1.0 / scheme.rate;
    let State { matter, hands, .. } = state;
    let Matter { body, bodies, .. } = matter;
    while let Some(push) = script
        .pushes
        .get(hands.pushed)
        .filter(|push| push.frame <= n)
    {
        hands.pushed += 1;
        let mat = push.mat as usize;
        if scheme.w[mat] == 0.0 {
            continue; // the part was muted
        }
        if push.impulse != 0.0 && hands.stream.is_kept() {
            let velocity = kernel::centred(scheme, body, mat);
            let mass = t * t / scheme.w[mat];
            hands.stream.push(
                n,
                Record::event(push.instant, mat, push.source, mass, velocity, push.impulse),
            );
        }
        body.push(mat, push.force);
        bodies
            .iter_mut()
            .for_each(|body| body.struck(mat, push.force));
    }
    while let Some((_, ergon)) = script
        .ergons
        .get(hands.ergons)
        .filter(|(frame, _)| *frame <= n)
    {
        hands.ergons += 1;
        let mat = ergon.mat as usize;
        if scheme.w[mat] == 0.0 {
            continue;
        }
        // p = 2 m m_S/(m + m_S)·(v − V), where V is the centred velocity without the ergon: with this impulse the work
        // on the struck MAT is exactly the energy that the ergon loses.
        let mass = t * t / scheme.w[mat];
        let velocity = kernel::centred(scheme, body, mat);
        let impulse = 2.0 * ergon.mass * mass / (ergon.mass + mass) * (ergon.speed - velocity);
        let force = impulse * scheme.rate;
        body.push(mat, force);
        bodies.iter_mut().for_each(|body| body.struck(mat, force));
        let (mass, speed, source) = (ergon.mass, ergon.speed, ergon.source);
        hands.stream.push(
            n,
            Record {
                time: n as f64 / scheme.rate,
                mat: ergon.mat,
                source,
                mass,
                speed,
                impulse,
            },
        );
    }
}
