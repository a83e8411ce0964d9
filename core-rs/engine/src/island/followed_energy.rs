//! Energy that is stored in links whose laws follow MATs, and energy that a change of the law gives or takes.

use crate::law::Law;
use crate::network::Followed;
use crate::scheme::{LinkRun, LinkRunKind, Scheme};

/// Energies of one link over a frame, in joules.
pub(super) struct FrameEnergies {
    /// ½(V(e[n]) + V(e[n−1])) by the law of frame n; the difference to the energy by the previous law is injected by
    /// the change.
    pub(super) last_energy: f64,
    /// ½(V(e[n+1]) + V(e[n])) by the same law.
    pub(super) next_energy: f64,
    /// The elastic part of the force at frame n [N].
    pub(super) elastic_force: f64,
    /// Force that the damping adds when the link stretches by `step` [N].
    pub(super) damping_force: f64,
}

impl FrameEnergies {
    /// From the law of frame n, elongations e[n−1], e[n], e[n+1] [m], and the step that led to e[n+1].
    pub(super) fn new(law: &Law, rate: f64, [e_before, e_now, e_next]: [f64; 3], step: f64) -> Self {
        let [potential_before, potential_now, potential_next] = [e_before, e_now, e_next].map(|e| law.potential(e));
        let elastic_force = law.spring(e_now);
        Self {
            last_energy: 0.5 * (potential_now + potential_before),
            next_energy: 0.5 * (potential_next + potential_now),
            elastic_force,
            damping_force: law.force(e_now, step * rate) - elastic_force,
        }
    }
}

/// What the law of a run follows, and the factor from steps to the law's velocities [1/s]; `None` if it does not follow
/// MATs.
pub(super) fn followed_law_and_rate(run: &LinkRun) -> Option<(&Followed, f64)> {
    match &run.kind {
        LinkRunKind::Followed {
            law: followed_law,
            velocity_factor,
            ..
        } => Some((followed_law, *velocity_factor)),
        _ => None,
    }
}

/// A buffer for the law of each run that follows MATs, in the order of the runs.
pub(super) fn followed_law_buffers(scheme: &Scheme) -> Vec<Law> {
    let followed_runs = scheme.runs.iter().filter_map(followed_law_and_rate);
    followed_runs
        .map(|(followed_law, _)| followed_law.law().clone())
        .collect()
}
