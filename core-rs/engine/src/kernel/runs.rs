//! Forces of links of every kind (springs, dampers, contacts, laws), one run of equal links at a time. Each run takes
//! three passes (forces, ends a, ends b), so that each pass vectorises although the two ends of a run may overlap.

use super::KernelScratch;
use super::pull::add_link_forces_wide;
use super::springs::ForcePart;
use super::thread_team::ThreadTeam;
use super::{pairwise, space};
use crate::law::Hardening;
use crate::maths::wide::wide;
use crate::network::But;
use crate::scheme::{LinkRun, LinkRunKind, Scheme};
use crate::state::ModuleState;

/// Set `modules.force` to the sum of all link forces on each MAT [N], and `modules.link_forces` to the force of each
/// link
/// [N].
pub(crate) fn compute_link_forces(
    scheme: &Scheme,
    gates: &[f64],
    modules: &mut ModuleState,
    laws: &mut KernelScratch,
    team: &mut ThreadTeam<'_>,
) {
    modules.outside_forces.fill(0.0);
    modules.pair_forces.fill(0.0);
    let ModuleState { x, d, force, .. } = modules;
    if scheme.fused_springs.is_empty() {
        force.fill(0.0);
    } else {
        laws.spring_forces(ForcePart::Total, &scheme.fused_springs, [x, d], force, team);
    }
    for (force, weight) in force.iter_mut().zip(&scheme.weight) {
        *force += weight;
    }
    for run in &scheme.runs {
        if let LinkRunKind::Space(space_link) = &run.kind {
            space::add_space_forces(run, space_link, gates, modules, &mut laws.space_scratch);
            continue;
        }
        if let (LinkRunKind::Pairwise { slot, .. }, Some(pairs)) = (&run.kind, run.pairwise()) {
            let pair_memory = (*slot, &mut laws.neighbours[*slot]);
            pairwise::add_pair_forces(run, &pairs, gates, modules, pair_memory);
            continue;
        }
        let run_ends = EndMotions::new(run, &modules.x, &modules.d);
        let link_force = &mut modules.link_forces[run.first_link..run.first_link + run.len];
        match &run.kind {
            LinkRunKind::Ref => set_spring_forces(run.k, run.z, run.rest, &run_ends, link_force),
            LinkRunKind::Hardening(q) => {
                let hardening_law = Hardening {
                    k: run.k,
                    q: *q,
                    z: (run.z != 0.0).then_some(run.z),
                };
                set_hardening_forces(hardening_law, 1.0, run.rest, &run_ends, link_force);
            }
            LinkRunKind::But(but) => set_contact_forces(run, but, &run_ends, link_force),
            LinkRunKind::Bristle { .. } => set_bristle_forces(run, &run_ends, &modules.link_memories, link_force),
            LinkRunKind::Followed {
                law,
                velocity_factor,
                slot,
            } => {
                let current_law = &mut laws.following_laws[*slot];
                law.update_law(current_law, |mat| modules.x[mat]);
                let EndMotions { xa, xb, da, db } = run_ends;
                for i in 0..run.len {
                    link_force[i] = current_law.force(xb[i] - xa[i] - run.rest, (db[i] - da[i]) * velocity_factor);
                }
            }
            // Dry friction is solved later, with the exact contacts; links in space are already computed above.
            LinkRunKind::Dry { .. } | LinkRunKind::Space(_) | LinkRunKind::Pairwise { .. } => link_force.fill(0.0),
            LinkRunKind::Lnl {
                law,
                velocity_factor,
                slot,
            } => match law.hardening_spring() {
                Some(hardening_law) => {
                    set_hardening_forces(hardening_law, *velocity_factor, run.rest, &run_ends, link_force)
                }
                None => {
                    let EndMotions { xa, xb, da, db } = run_ends;
                    let (e, v) = (&mut laws.elongations[..run.len], &mut laws.elongation_rates[..run.len]);
                    for i in 0..run.len {
                        e[i] = xb[i] - xa[i] - run.rest;
                        v[i] = (db[i] - da[i]) * velocity_factor;
                    }
                    law.eval_in(e, v, link_force, &mut laws.law_scratch[*slot], &mut laws.native_scratch);
                }
            },
        }
        if let Some(gate) = run.gate {
            let gate_opening = gates[gate];
            link_force.iter_mut().for_each(|link_force| *link_force *= gate_opening);
        }
        scatter(run, modules);
    }
    for (force, pair_force) in modules.force.iter_mut().zip(&modules.pair_forces) {
        *force += pair_force;
    }
}

#[inline(always)]
fn set_contact_forces(run: &LinkRun, but: &But, run_ends: &EndMotions<'_>, link_force: &mut [f64]) {
    let EndMotions { xa, xb, da, db } = run_ends;
    for i in 0..run.len {
        let (e, step) = (xb[i] - xa[i] - run.rest, db[i] - da[i]);
        link_force[i] = but.force(run.k, run.z, e, step);
    }
}

#[inline(always)]
fn set_bristle_forces(run: &LinkRun, run_ends: &EndMotions<'_>, link_memories: &[f64], link_force: &mut [f64]) {
    let Some((bristle_law, step)) = run.bristle() else {
        return;
    };
    let bristle_bends = &link_memories[run.first_link..run.first_link + run.len];
    let EndMotions { da, db, .. } = run_ends;
    for i in 0..run.len {
        link_force[i] = bristle_law.force(bristle_bends[i], (db[i] - da[i]) / step);
    }
}

/// Update the bending of all bristles at the end of a frame, from the motion of their ends in it.
pub(crate) fn slide_bristles(scheme: &Scheme, modules: &mut ModuleState) {
    if modules.link_memories.is_empty() {
        return;
    }
    for run in &scheme.runs {
        let Some((bristle_law, time_step)) = run.bristle() else {
            continue;
        };
        for i in 0..run.len {
            let ends_step = modules.d[run.b + i] - modules.d[run.a + i];
            let bristle = &mut modules.link_memories[run.first_link + i];
            *bristle = bristle_law.slide(*bristle, ends_step / time_step, time_step);
        }
    }
}

/// Positions and steps at both ends of a run, (len) each.
pub(super) struct EndMotions<'a> {
    pub(super) xa: &'a [f64],
    pub(super) xb: &'a [f64],
    pub(super) da: &'a [f64],
    pub(super) db: &'a [f64],
}

impl<'a> EndMotions<'a> {
    fn new(run: &LinkRun, x: &'a [f64], d: &'a [f64]) -> Self {
        let (mats_at_a, mats_at_b) = (run.a..run.a + run.len, run.b..run.b + run.len);
        Self {
            xa: &x[mats_at_a.clone()],
            xb: &x[mats_at_b.clone()],
            da: &d[mats_at_a],
            db: &d[mats_at_b],
        }
    }

    /// The same values as slices of one length, so that the compiler drops bounds checks.
    #[inline(always)]
    fn equal_slices(&self, n: usize) -> [&'a [f64]; 4] {
        [&self.xa[..n], &self.xb[..n], &self.da[..n], &self.db[..n]]
    }
}

wide! {
    pub(super) fn set_spring_forces(k: f64, z: f64, rest: f64, ends: &EndMotions<'_>, f: &mut [f64]) {
        let n = f.len();
        let [xa, xb, da, db] = ends.equal_slices(n);
        for i in 0..n {
            f[i] = k * (xb[i] - xa[i] - rest) + z * (db[i] - da[i]);
        }
    }
}

wide! {
    /// Hardening springs without the interpreter; the operations have the order of the interpreted law, so that the
    /// bits are the same.
    pub(super) fn set_hardening_forces(
        law: Hardening,
        velocity_factor: f64,
        rest: f64,
        ends: &EndMotions<'_>,
        f: &mut [f64],
    ) {
        let n = f.len();
        let [xa, xb, da, db] = ends.equal_slices(n);
        let Hardening { k, q, z } = law;
        for i in 0..n {
            let e = xb[i] - xa[i] - rest;
            f[i] = k * e + q * (e * e * e);
        }
        if let Some(z) = z {
            for i in 0..n {
                f[i] += z * ((db[i] - da[i]) * velocity_factor);
            }
        }
    }
}

/// Add a run's forces to its two ends: F_a += f, F_b −= f.
pub(super) fn scatter(run: &LinkRun, modules: &mut ModuleState) {
    let link_force = &modules.link_forces[run.first_link..run.first_link + run.len];
    add_link_forces_wide(link_force, &mut modules.force, run.a, run.b);
}
