//! Pushes and ergons of a timeline.

use super::{ErgonRecord, MotionState, Script, State};
use crate::kernel;
use crate::scheme::Scheme;

/// Applies the pushes and ergons that fall on frame `n`.
pub(super) fn apply_pushes_and_ergons(script: &Script, scheme: &Scheme, state: &mut State, n: u64) {
    let time_step = 1.0 / scheme.rate;
    let State { motion, sources, .. } = state;
    let MotionState {
        modules: body, bodies, ..
    } = motion;
    while let Some(due_push) = script
        .pushes
        .get(sources.next_push)
        .filter(|due_push| due_push.frame <= n)
    {
        sources.next_push += 1;
        let mat = due_push.mat as usize;
        if scheme.w[mat] == 0.0 {
            continue; // the part was muted
        }
        if due_push.impulse != 0.0 && sources.ergon_stream.is_recording() {
            let velocity = kernel::centred_velocity(scheme, body, mat);
            let mass = time_step * time_step / scheme.w[mat];
            sources.ergon_stream.add(
                n,
                ErgonRecord::event(due_push.instant, mat, due_push.source, mass, velocity, due_push.impulse),
            );
        }
        body.push(mat, due_push.force);
        bodies.iter_mut().for_each(|body| body.note_strike(mat, due_push.force));
    }
    while let Some((_, due_ergon)) = script.ergons.get(sources.next_ergon).filter(|(frame, _)| *frame <= n) {
        sources.next_ergon += 1;
        let mat = due_ergon.mat as usize;
        if scheme.w[mat] == 0.0 {
            continue;
        }
        // p = 2 m m_S/(m + m_S)·(v − V), where V is the centred velocity without the ergon: with this impulse the work
        // on the struck MAT is exactly the energy that the ergon loses.
        let struck_mass = time_step * time_step / scheme.w[mat];
        let velocity = kernel::centred_velocity(scheme, body, mat);
        let impulse =
            2.0 * due_ergon.mass * struck_mass / (due_ergon.mass + struck_mass) * (due_ergon.speed - velocity);
        let ergon_force = impulse * scheme.rate;
        body.push(mat, ergon_force);
        bodies.iter_mut().for_each(|body| body.note_strike(mat, ergon_force));
        let (mass, speed, source) = (due_ergon.mass, due_ergon.speed, due_ergon.source);
        sources.ergon_stream.add(
            n,
            ErgonRecord {
                time: n as f64 / scheme.rate,
                mat: due_ergon.mat,
                source,
                mass,
                speed,
                impulse,
            },
        );
    }
}
