//! CA2P: CA with forces computed at a shifted position, which corrects the error of its pitch.
//!
//! The scheme x⁺ − 2x + x⁻ = T²a has an error of order T², which a(x + T²a/12) cancels (Takahashi & Imada 1984;
//! Chin 2007): order 4 for undamped linear bodies. Dampers take the velocity at the frame itself, v′ = d + ½a,
//! so that κ̃ = κ − κ²/12 − ½ζκ and ζ̃ = ζ − ½ζ² agree with the exact poles to the next order. With damped links
//! the order falls to 2, with an error far below that of CA. An impulse is a jump of the velocity within the step,
//! not a force held over the step: the factor 1/12 of a force becomes 1/6.

use std::sync::Arc;

use super::mesh::{Mesh, Scratch};
use super::mesh_system::MeshSystem;
use super::passes;
use super::{Stepper, certify};
use crate::guard::Guard;
use crate::kernel::thread_team::ThreadTeam;
use crate::network::{Error, Network};
use crate::state::PreviousState;

#[derive(Clone, Debug)]
pub(super) struct Ca2p {
    mesh: Arc<Mesh>,
    /// Position [m] and last step x − x⁻ [m]                    (n_mat)
    x: Vec<f64>,
    d: Vec<f64>,
    /// Position and last step at the previous frame, with its impulses applied.
    previous: Box<PreviousState>,
    guard: Option<Box<Guard>>,
    /// Positions and velocities at which the second pass computes forces   (n_mat)
    second_positions: Vec<f64>,
    second_velocities: Vec<f64>,
    /// Elastic and viscous forces at x and d, and the elastic forces of the step before [N]   (n_mat)
    elastic_forces: Vec<f64>,
    viscous_forces: Vec<f64>,
    previous_elastic_forces: Vec<f64>,
    /// All forces of the second pass [N]                        (n_mat)
    force: Vec<f64>,
    scratch: Scratch,
}

crate::archive::state!(Ca2p {
    x,
    d,
    previous,
    guard,
    second_positions,
    second_velocities,
    elastic_forces,
    viscous_forces,
    previous_elastic_forces,
    force
});

/// Number of backward steps over the frame before the start: with so many the error of the start is far below that of
/// the method.
const BACKWARD_STEPS: usize = 8;

impl Ca2p {
    pub(super) fn new(mesh: Arc<Mesh>, network: &Network) -> Result<Self, Error> {
        let guard = Guard::new(&mesh.scheme, network, certify::ca2p_guard_limit(&mesh), &[])?.map(Box::new);
        let (x, v) = (network.mats().x0.clone(), mesh.initial_velocities(network));
        let mut scratch = mesh.new_scratch();
        let d = initial_step(&mesh, &x, &v, &mut scratch);
        let zero_vector = vec![0.0; x.len()];
        let mut integrator = Self {
            second_positions: x.iter().zip(&d).map(|(x, d)| x - d).collect(),
            second_velocities: v,
            elastic_forces: zero_vector.clone(),
            viscous_forces: zero_vector.clone(),
            previous_elastic_forces: zero_vector.clone(),
            force: zero_vector,
            previous: PreviousState::new(x.len()),
            guard,
            scratch,
            x,
            d,
            mesh,
        };
        let lone_team = &mut ThreadTeam::alone();
        integrator.mesh.set_elastic_forces(
            &integrator.second_positions,
            &mut integrator.scratch,
            &mut integrator.elastic_forces,
            lone_team,
        );
        integrator.first_pass(lone_team);
        Ok(integrator)
    }

    /// The first pass: forces at the current frame.
    fn first_pass(&mut self, team: &mut ThreadTeam<'_>) {
        let (mesh, scratch) = (&*self.mesh, &mut self.scratch);
        std::mem::swap(&mut self.elastic_forces, &mut self.previous_elastic_forces);
        mesh.set_elastic_forces(&self.x, scratch, &mut self.elastic_forces, team);
        if mesh.is_damped {
            mesh.set_viscous_forces([&self.x, &self.d], scratch, &mut self.viscous_forces, team);
        }
    }
}

/// x(0) − x(−T) of the continuous motion [m], by classical Runge-Kutta backwards   (n_mat)
fn initial_step(mesh: &Mesh, x0: &[f64], v0: &[f64], scratch: &mut Scratch) -> Vec<f64> {
    let n_mats = x0.len();
    let (mut x, mut v) = (x0.to_vec(), v0.to_vec());
    let (mut force, mut stage_slopes) = (vec![0.0; n_mats], vec![[0.0; 2]; n_mats]);
    let back_step = -1.0 / BACKWARD_STEPS as f64;
    for _ in 0..BACKWARD_STEPS {
        let mut slope_sums = vec![[0.0; 2]; n_mats];
        stage_slopes.fill([0.0; 2]);
        for (stage_fraction, weight) in [(0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)] {
            let stage_positions: Vec<f64> = (0..n_mats)
                .map(|i| x[i] + stage_fraction * back_step * stage_slopes[i][0])
                .collect();
            let stage_velocities: Vec<f64> = (0..n_mats)
                .map(|i| v[i] + stage_fraction * back_step * stage_slopes[i][1])
                .collect();
            mesh.set_total_forces(
                [&stage_positions, &stage_velocities],
                scratch,
                &mut force,
                &mut ThreadTeam::alone(),
            );
            let mesh_scheme = &mesh.scheme;
            for i in 0..n_mats {
                let acceleration = force[i] * mesh_scheme.w[i]
                    - mesh_scheme.kappa[i] * (stage_positions[i] - mesh_scheme.rest[i])
                    - mesh_scheme.zeta[i] * stage_velocities[i];
                stage_slopes[i] = [stage_velocities[i], acceleration];
                slope_sums[i][0] += weight * stage_velocities[i];
                slope_sums[i][1] += weight * acceleration;
            }
        }
        for i in 0..n_mats {
            x[i] += back_step / 6.0 * slope_sums[i][0];
            v[i] += back_step / 6.0 * slope_sums[i][1];
        }
    }
    x0.iter().zip(&x).map(|(x0, earlier)| x0 - earlier).collect()
}

impl Stepper for Ca2p {
    fn partition(&mut self, threads: usize) {
        self.mesh.partition(&mut self.scratch, threads);
    }

    fn can_share_work(&self) -> bool {
        self.scratch.mesh_partition().is_some()
    }

    fn step(&mut self, impulses: &[(usize, f64)], team: &mut ThreadTeam<'_>) {
        let (mesh, scratch) = (&*self.mesh, &mut self.scratch);
        let [elastic_forces, viscous_forces] = [&self.elastic_forces, &self.viscous_forces];
        let (x, d, second_positions, v) = (
            &self.x,
            &self.d,
            &mut self.second_positions,
            &mut self.second_velocities,
        );
        mesh.for_each_range(
            scratch,
            team,
            [second_positions, v],
            |mats, ties, [second_positions, v]| {
                let mat_forces = [elastic_forces, viscous_forces].map(|values| &values[mats.clone()]);
                let mat_motion = [x, d].map(|values| &values[mats.clone()]);
                passes::set_evaluation_point(ties, mat_forces, mat_motion, second_positions, v);
            },
        );
        for &(mat, impulse) in impulses {
            let impulse_jump = mesh.velocity_step(mat, impulse);
            self.second_positions[mat] += impulse_jump * (1.0 / 6.0);
            self.second_velocities[mat] += 0.5 * impulse_jump;
        }
        mesh.set_total_forces(
            [&self.second_positions, &self.second_velocities],
            scratch,
            &mut self.force,
            team,
        );
        for &(mat, impulse) in impulses {
            self.d[mat] += mesh.velocity_step(mat, impulse);
        }
        self.previous.swap(&mut self.x, &mut self.d);
        let (force, second_positions, v, previous) = (
            &self.force,
            &self.second_positions,
            &self.second_velocities,
            &self.previous,
        );
        let (x, d) = (&mut self.x, &mut self.d);
        mesh.for_each_range(scratch, team, [&mut *x, &mut *d], |mats, ties, [x, d]| {
            let point_motion = [second_positions, v].map(|values| &values[mats.clone()]);
            let previous_motion = [&previous.x, &previous.d].map(|values| &values[mats.clone()]);
            passes::second_pass(ties, &force[mats], point_motion, previous_motion, x, d);
        });
        if let Some(guard) = &mut self.guard
            && guard.needs_finer(x, d, &mesh.scheme.w)
        {
            self.previous.swap(x, d);
            let (force, d) = (&mut self.force[..], &mut d[..]);
            MeshSystem {
                mesh,
                scratch,
                force,
                x,
                d,
                team,
            }
            .step_finer(guard);
        }
        self.first_pass(team);
    }

    fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    fn positions(&self) -> &[f64] {
        &self.x
    }

    /// From d = V − ½A + J/6, where the change of acceleration J is a difference between half a step ahead and half a
    /// step behind.
    fn velocity(&self, mat: usize) -> f64 {
        let x = |i: usize| self.x[i];
        let d = |i: usize| self.d[i];
        let speed_estimate = self.d[mat] + 0.5 * self.mesh.acceleration(mat, &x, &d);
        let accel_ahead = self.mesh.acceleration(mat, &|i| x(i) + 0.5 * d(i), &d);
        let accel_behind = self.mesh.acceleration(mat, &|i| x(i) - 0.5 * d(i), &d);
        let acceleration = self
            .mesh
            .acceleration(mat, &x, &|i| if i == mat { speed_estimate } else { d(i) });
        (self.d[mat] + 0.5 * acceleration - (accel_ahead - accel_behind) / 6.0) * self.mesh.scheme.rate
    }

    fn last_step(&self, mat: usize) -> f64 {
        self.d[mat]
    }

    fn set_motion(&mut self, mat: usize, x: f64, step: f64) {
        (self.x[mat], self.d[mat]) = (x, step);
    }

    fn update_after_motion(&mut self) {
        for (second_positions, (x, d)) in self.second_positions.iter_mut().zip(self.x.iter().zip(&self.d)) {
            *second_positions = x - d;
        }
        let (scratch, lone_team) = (&mut self.scratch, &mut ThreadTeam::alone());
        self.mesh
            .set_elastic_forces(&self.second_positions, scratch, &mut self.elastic_forces, lone_team);
        self.first_pass(lone_team);
    }

    fn guard(&self) -> Option<&Guard> {
        self.guard.as_deref()
    }

    fn guard_mut(&mut self) -> Option<&mut Guard> {
        self.guard.as_deref_mut()
    }

    fn velocities_mut(&mut self) -> &mut [f64] {
        &mut self.d
    }

    /// The energy of CA with K − KM⁻¹K/12 in place of K: undamped linear bodies conserve it exactly.
    fn energy(&self) -> f64 {
        let (mesh, scheme) = (&*self.mesh, &self.mesh.scheme);
        let acceleration =
            |force: &[f64], x: f64, i: usize| force[i] * scheme.w[i] - scheme.kappa[i] * (x - scheme.rest[i]);
        let frame_product = |i: usize| {
            acceleration(&self.elastic_forces, self.x[i], i)
                * acceleration(&self.previous_elastic_forces, self.x[i] - self.d[i], i)
        };
        let pull_product: f64 = (0..mesh.n_mat())
            .map(|i| mesh.scaled_masses[i] * frame_product(i))
            .sum();
        mesh.staggered_energy(&self.x, &self.d, true) - pull_product / 24.0
    }
}
