//! BM4: kicks and drifts of order 4 with a small error constant, SRKN6b (Blanes & Moan 2002).
//!
//! Six force evaluations per step: the forces of the last kick serve the first kick of the next step. A kick is the
//! flow of v at fixed positions, with losses. For ties this flow is exact. For links it is the midpoint rule, which
//! reaches the midpoint with the damping forces of the kick before, so that each kick evaluates the dampers once. The
//! composition is symmetric and meets the conditions of order 3 for any two flows: its order stays 4 with losses, until
//! the error of these kicks dominates, (ζb)² of the losses.

use std::sync::Arc;

use super::Stepper;
use super::mesh::{Mesh, Scratch};
use super::passes;
use crate::kernel::thread_team::ThreadTeam;
use crate::maths;
use crate::network::Network;
use crate::timeline::Lead;

const A1: f64 = 0.245_298_957_184_271;
const A2: f64 = 0.604_872_665_711_080;
const A3: f64 = 0.5 - A1 - A2;
const B1: f64 = 0.082_984_406_417_405_2;
const B2: f64 = 0.396_309_801_498_368;
const B3: f64 = -0.039_056_304_922_348_6;
const B4: f64 = 1.0 - 2.0 * (B1 + B2 + B3);
/// A kick and the drift that follows it; a last kick of `B1` ends the step.
pub(crate) const STAGES: [[f64; 2]; 6] = [[B1, A1], [B2, A2], [B3, A3], [B4, A3], [B3, A2], [B2, A1]];

#[derive(Clone, Debug)]
pub(super) struct Bm4 {
    mesh: Arc<Mesh>,
    /// e^(−ζb) and (1 − e^(−ζb))/ζ of the ties for each stage's b; empty if no tie loses energy, or if links lose
    /// energy too   (n_mat each)
    stage_losses: Arc<Vec<[Vec<f64>; 2]>>,
    /// K and Z of the springs as written in the network      (n_springs)
    written_k_and_z: Arc<[[f64; 2]]>,
    /// Position [m] and velocity per step [m]                (n_mat)
    x: Vec<f64>,
    v: Vec<f64>,
    /// Elastic forces at x [N]                               (n_mat)
    force: Vec<f64>,
    /// Viscous forces of the last kick [N], and velocities at its midpoint       (n_mat)
    viscous_forces: Vec<f64>,
    midpoint_velocities: Vec<f64>,
    scratch: Scratch,
}

crate::archive::state!(Bm4 {
    x,
    v,
    force,
    viscous_forces,
    midpoint_velocities
});

impl Bm4 {
    pub(super) fn new(mesh: Arc<Mesh>, network: &Network) -> Self {
        let (x, v) = (network.mats().x0.clone(), mesh.initial_velocities(network));
        let (mut scratch, zero_vector) = (mesh.new_scratch(), vec![0.0; x.len()]);
        let mut force = zero_vector.clone();
        let lone_team = &mut ThreadTeam::alone();
        mesh.set_elastic_forces(&x, &mut scratch, &mut force, lone_team);
        let mut viscous_forces = zero_vector.clone();
        mesh.set_viscous_forces([&x, &v], &mut scratch, &mut viscous_forces, lone_team);
        let zeta = &mesh.scheme.zeta;
        let has_exact_losses = !mesh.is_damped && zeta.iter().any(|zeta| *zeta != 0.0);
        let loss_stages = STAGES.iter().filter(|_| has_exact_losses);
        let stage_losses = loss_stages.map(|[b, _]| decay_and_gain(zeta, *b)).collect();
        Self {
            written_k_and_z: mesh.springs.iter().map(|spring| [spring.k, spring.z]).collect(),
            stage_losses: Arc::new(stage_losses),
            x,
            v,
            force,
            viscous_forces,
            midpoint_velocities: zero_vector,
            scratch,
            mesh,
        }
    }

    /// The flow of v for a time b at fixed positions, then that of x for a time a; `stage` is an index into
    /// `stage_losses`.
    fn kick_drift(&mut self, stage: usize, [b, a]: [f64; 2], team: &mut ThreadTeam<'_>) {
        let (mesh, scratch) = (&*self.mesh, &mut self.scratch);
        let (x, v, force) = (&mut self.x, &mut self.v, &self.force);
        if mesh.is_damped {
            let (viscous_forces, midpoint_velocities) = (&mut self.viscous_forces, &mut self.midpoint_velocities);
            mesh.for_each_range(
                scratch,
                team,
                [&mut *midpoint_velocities],
                |mats, ties, [midpoint_velocities]| {
                    let mat_forces = [&force[mats.clone()], &viscous_forces[mats.clone()]];
                    let mat_motion = [&x[mats.clone()], &v[mats]];
                    passes::set_midpoint_velocities(0.5 * b, ties, mat_forces, mat_motion, midpoint_velocities);
                },
            );
            mesh.set_viscous_forces([x, midpoint_velocities], scratch, viscous_forces, team);
            mesh.for_each_range(scratch, team, [x, v], |mats, ties, [x, v]| {
                let mat_forces = [&force[mats.clone()], &viscous_forces[mats.clone()]];
                passes::lossy_kick_drift([b, a], ties, mat_forces, &midpoint_velocities[mats], x, v);
            });
        } else if let Some(stage_losses) = self.stage_losses.get(stage) {
            mesh.for_each_range(scratch, team, [x, v], |mats, ties, [x, v]| {
                let stage_losses = stage_losses.each_ref().map(|values| &values[mats.clone()]);
                passes::decaying_kick_drift(a, stage_losses, ties, &force[mats], x, v);
            });
        } else {
            mesh.for_each_range(scratch, team, [x, v], |mats, ties, [x, v]| {
                passes::kick_drift([b, a], ties, &force[mats], x, v);
            });
        }
    }
}

/// e^(−ζb) and (1 − e^(−ζb))/ζ.
fn decay_and_gain(zeta: &[f64], b: f64) -> [Vec<f64>; 2] {
    let decay_factors = zeta.iter().map(|zeta| maths::exp(-zeta * b)).collect();
    let gain_factors = zeta.iter().map(|&zeta| {
        if zeta == 0.0 {
            b
        } else {
            -maths::expm1(-zeta * b) / zeta
        }
    });
    [decay_factors, gain_factors.collect()]
}

impl Stepper for Bm4 {
    fn set_led_links(&mut self, lead: &Lead, (n, part): (u64, f64)) {
        let [k_factor, z_factor] = lead.factors(n, part);
        // The mesh is not shared since `unshare_parameters`: nothing is copied.
        let unshared_mesh = Arc::make_mut(&mut self.mesh);
        for (run, (first, [k, z])) in unshared_mesh.first_links.iter().zip(&*self.written_k_and_z).enumerate() {
            if lead.links().contains(first) {
                unshared_mesh.springs.set_k_and_z(run, [k * k_factor, z * z_factor]);
            }
        }
    }

    fn recompute_led(&mut self, team: &mut ThreadTeam<'_>) {
        let (mesh, scratch) = (&*self.mesh, &mut self.scratch);
        mesh.set_elastic_forces(&self.x, scratch, &mut self.force, team);
    }

    fn unshare_parameters(&mut self) {
        Arc::make_mut(&mut self.mesh);
    }

    fn partition(&mut self, threads: usize) {
        self.mesh.partition(&mut self.scratch, threads);
    }

    fn can_share_work(&self) -> bool {
        self.scratch.mesh_partition().is_some()
    }

    fn step(&mut self, impulses: &[(usize, f64)], team: &mut ThreadTeam<'_>) {
        for &(mat, impulse) in impulses {
            self.v[mat] += self.mesh.velocity_step(mat, impulse);
        }
        for (stage_index, stage) in STAGES.into_iter().enumerate() {
            self.kick_drift(stage_index, stage, team);
            self.mesh
                .set_elastic_forces(&self.x, &mut self.scratch, &mut self.force, team);
        }
        self.kick_drift(0, [B1, 0.0], team);
    }

    fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    fn positions(&self) -> &[f64] {
        &self.x
    }

    fn velocity(&self, mat: usize) -> f64 {
        self.v[mat] * self.mesh.scheme.rate
    }

    fn last_step(&self, mat: usize) -> f64 {
        let (x, v) = (|i: usize| self.x[i], |i: usize| self.v[i]);
        self.v[mat] - 0.5 * self.mesh.acceleration(mat, &x, &v)
    }

    fn set_motion(&mut self, mat: usize, x: f64, step: f64) {
        (self.x[mat], self.v[mat]) = (x, step);
    }

    fn update_after_motion(&mut self) {
        self.mesh
            .velocities_from_steps(&self.x, &mut self.v, &mut self.midpoint_velocities);
        let (scratch, lone_team) = (&mut self.scratch, &mut ThreadTeam::alone());
        self.mesh
            .set_elastic_forces(&self.x, scratch, &mut self.force, lone_team);
        let mat_motion = [&self.x[..], &self.v];
        self.mesh
            .set_viscous_forces(mat_motion, scratch, &mut self.viscous_forces, lone_team);
    }

    fn velocities_mut(&mut self) -> &mut [f64] {
        &mut self.v
    }

    fn energy(&self) -> f64 {
        self.mesh.kinetic_energy(&self.v) + self.mesh.potential_energy(&self.x)
    }
}
