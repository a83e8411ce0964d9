//! Pushes and ergons of a timeline.

use super::{ErgonRecord, MotionState, Script, State};
use crate::kernel;
use crate::scheme::Scheme;

/// Applies the pushes and ergons that fall on frame `n`.
pub(super) fn apply_strikes_and_ergons(script: &Script, scheme: &Scheme, state: &mut State, n: u64) {
    let time_step = 1.0 / scheme.rate;
    let State { motion, sources, .. } = state;
    let MotionState {
        modules: body, bodies, ..
    } = motion;
    while let Some(strike) = script
        .strike_forces
        .get(sources.next_strike)
        .filter(|strike| strike.frame <= n)
    {
        sources.next_strike += 1;
        let mat = strike.mat as usize;
        if scheme.w[mat] == 0.0 {
            continue; // the part was muted
        }
        if strike.impulse != 0.0 && sources.ergon_stream.is_recording() {
            let velocity = kernel::centred_velocity(scheme, body, mat);
            let mass = time_step * time_step / scheme.w[mat];
            sources.ergon_stream.add(
                n,
                ErgonRecord::event(strike.instant, mat, strike.source, mass, velocity, strike.impulse),
            );
        }
        body.push(mat, strike.force);
        bodies.iter_mut().for_each(|body| body.record_strike(mat, strike.force));
    }
    while let Some((_, ergon)) = script.ergons.get(sources.next_ergon).filter(|(frame, _)| *frame <= n) {
        sources.next_ergon += 1;
        let mat = ergon.mat as usize;
        if scheme.w[mat] == 0.0 {
            continue;
        }
        // p = 2 m m_S/(m + m_S)·(v − V), where V is the centred velocity without the ergon: with this impulse the work
        // on the struck MAT is exactly the energy that the ergon loses.
        let struck_mass = time_step * time_step / scheme.w[mat];
        let velocity = kernel::centred_velocity(scheme, body, mat);
        let impulse = 2.0 * ergon.mass * struck_mass / (ergon.mass + struck_mass) * (ergon.speed - velocity);
        let ergon_force = impulse * scheme.rate;
        body.push(mat, ergon_force);
        bodies.iter_mut().for_each(|body| body.record_strike(mat, ergon_force));
        let (mass, speed, source) = (ergon.mass, ergon.speed, ergon.source);
        sources.ergon_stream.add(
            n,
            ErgonRecord {
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
