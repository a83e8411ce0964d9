//! CA2P: CA with forces computed at a shifted position, which corrects the error of its pitch.
//!
//! The scheme x⁺ − 2x + x⁻ = T²a has an error of order T², which a(x + T²a/12) cancels (Takahashi & Imada 1984;
//! Chin 2007): order 4 for undamped linear bodies. Dampers take the velocity at the frame itself, v′ = d + ½a,
//! so that κ̃ = κ − κ²/12 − ½ζκ and ζ̃ = ζ − ½ζ² agree with the exact poles to the next order. With damped links
//! the order falls to 2, with an error far below that of CA. An impulse is a jump of the velocity within the step,
//! not a force held over the step: the factor 1/12 of a force becomes 1/6.

use std::sync::Arc;

use super::mesh::{Mesh, Scratch};
use super::mesh_stage::MeshStage;
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
    there: Vec<f64>,
    v: Vec<f64>,
    /// Elastic and viscous forces at x and d, and the elastic forces of the step before [N]   (n_mat)
    elastic: Vec<f64>,
    viscous: Vec<f64>,
    elastic_before: Vec<f64>,
    /// All forces of the second pass [N]                        (n_mat)
    force: Vec<f64>,
    scratch: Scratch,
}

crate::archive::state!(Ca2p {
    x,
    d,
    previous,
    guard,
    there,
    v,
    elastic,
    viscous,
    elastic_before,
    force
});

/// Number of backward steps over the frame before the start: with so many the error of the start is far below that of
/// the method.
const STEPS_BACK: usize = 8;

impl Ca2p {
    pub(super) fn new(mesh: Arc<Mesh>, network: &Network) -> Result<Self, Error> {
        let guard =
            Guard::new(&mesh.scheme, network, certify::ca2p_guard_limit(&mesh), &[])?.map(Box::new);
        let (x, v) = (network.mats().x0.clone(), mesh.start(network));
        let mut scratch = mesh.scratch();
        let d = last_step(&mesh, &x, &v, &mut scratch);
        let zeros = vec![0.0; x.len()];
        let mut it = Self {
            there: x.iter().zip(&d).map(|(x, d)| x - d).collect(),
            v,
            elastic: zeros.clone(),
            viscous: zeros.clone(),
            elastic_before: zeros.clone(),
            force: zeros,
            previous: PreviousState::new(x.len()),
            guard,
            scratch,
            x,
            d,
            mesh,
        };
        let team = &mut ThreadTeam::alone();
        it.mesh
            .elastic(&it.there, &mut it.scratch, &mut it.elastic, team);
        it.first_pass(team);
        Ok(it)
    }

    /// The first pass: forces at the current frame.
    fn first_pass(&mut self, team: &mut ThreadTeam<'_>) {
        let (mesh, scratch) = (&*self.mesh, &mut self.scratch);
        std::mem::swap(&mut self.elastic, &mut self.elastic_before);
        mesh.elastic(&self.x, scratch, &mut self.elastic, team);
        if mesh.damped {
            mesh.viscous([&self.x, &self.d], scratch, &mut self.viscous, team);
        }
    }
}

/// x(0) − x(−T) of the continuous motion [m], by classical Runge-Kutta backwards   (n_mat)
fn last_step(mesh: &Mesh, x0: &[f64], v0: &[f64], scratch: &mut Scratch) -> Vec<f64> {
    let n = x0.len();
    let (mut x, mut v) = (x0.to_vec(), v0.to_vec());
    let (mut force, mut there) = (vec![0.0; n], vec![[0.0; 2]; n]);
    let h = -1.0 / STEPS_BACK as f64;
    for _ in 0..STEPS_BACK {
        let mut sums = vec![[0.0; 2]; n];
        there.fill([0.0; 2]);
        for (ahead, weight) in [(0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)] {
            let places: Vec<f64> = (0..n).map(|i| x[i] + ahead * h * there[i][0]).collect();
            let speed: Vec<f64> = (0..n).map(|i| v[i] + ahead * h * there[i][1]).collect();
            mesh.total(
                [&places, &speed],
                scratch,
                &mut force,
                &mut ThreadTeam::alone(),
            );
            let scheme = &mesh.scheme;
            for i in 0..n {
                let a = force[i] * scheme.w[i]
                    - scheme.kappa[i] * (places[i] - scheme.rest[i])
                    - scheme.zeta[i] * speed[i];
                there[i] = [speed[i], a];
                sums[i][0] += weight * speed[i];
                sums[i][1] += weight * a;
            }
        }
        for i in 0..n {
            x[i] += h / 6.0 * sums[i][0];
            v[i] += h / 6.0 * sums[i][1];
        }
    }
    x0.iter()
        .zip(&x)
        .map(|(now, before)| now - before)
        .collect()
}

impl Stepper for Ca2p {
    fn partition_for(&mut self, threads: usize) {
        self.mesh.partition_for(&mut self.scratch, threads);
    }

    fn is_shared(&self) -> bool {
        self.scratch.mesh_partition().is_some()
    }

    fn step(&mut self, impulses: &[(usize, f64)], team: &mut ThreadTeam<'_>) {
        let (mesh, scratch) = (&*self.mesh, &mut self.scratch);
        let [elastic, viscous] = [&self.elastic, &self.viscous];
        let (x, d, there, v) = (&self.x, &self.d, &mut self.there, &mut self.v);
        mesh.ranges(scratch, team, [there, v], |mats, ties, [there, v]| {
            let forces = [elastic, viscous].map(|all| &all[mats.clone()]);
            let motion = [x, d].map(|all| &all[mats.clone()]);
            passes::evaluation_point(ties, forces, motion, there, v);
        });
        for &(mat, impulse) in impulses {
            let jump = mesh.jump(mat, impulse);
            self.there[mat] += jump * (1.0 / 6.0);
            self.v[mat] += 0.5 * jump;
        }
        mesh.total([&self.there, &self.v], scratch, &mut self.force, team);
        for &(mat, impulse) in impulses {
            self.d[mat] += mesh.jump(mat, impulse);
        }
        self.previous.swap(&mut self.x, &mut self.d);
        let (force, there, v, previous) = (&self.force, &self.there, &self.v, &self.previous);
        let (x, d) = (&mut self.x, &mut self.d);
        mesh.ranges(scratch, team, [&mut *x, &mut *d], |mats, ties, [x, d]| {
            let point = [there, v].map(|all| &all[mats.clone()]);
            let from = [&previous.x, &previous.d].map(|all| &all[mats.clone()]);
            passes::second_pass(ties, &force[mats], point, from, x, d);
        });
        if let Some(guard) = &mut self.guard
            && guard.needs_finer(x, d, &mesh.scheme.w)
        {
            self.previous.swap(x, d);
            let (force, d) = (&mut self.force[..], &mut d[..]);
            MeshStage {
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

    fn x(&self) -> &[f64] {
        &self.x
    }

    /// From d = V − ½A + J/6, where the change of acceleration J is a difference between half a step ahead and half a
    /// step behind.
    fn velocity(&self, mat: usize) -> f64 {
        let x = |i: usize| self.x[i];
        let d = |i: usize| self.d[i];
        let speed = self.d[mat] + 0.5 * self.mesh.acceleration(mat, &x, &d);
        let ahead = self.mesh.acceleration(mat, &|i| x(i) + 0.5 * d(i), &d);
        let behind = self.mesh.acceleration(mat, &|i| x(i) - 0.5 * d(i), &d);
        let a = self
            .mesh
            .acceleration(mat, &x, &|i| if i == mat { speed } else { d(i) });
        (self.d[mat] + 0.5 * a - (ahead - behind) / 6.0) * self.mesh.scheme.rate
    }

    fn last_step(&self, mat: usize) -> f64 {
        self.d[mat]
    }

    fn set_motion(&mut self, mat: usize, x: f64, step: f64) {
        (self.x[mat], self.d[mat]) = (x, step);
    }

    fn settle(&mut self) {
        for (there, (x, d)) in self.there.iter_mut().zip(self.x.iter().zip(&self.d)) {
            *there = x - d;
        }
        let (scratch, team) = (&mut self.scratch, &mut ThreadTeam::alone());
        self.mesh
            .elastic(&self.there, scratch, &mut self.elastic, team);
        self.first_pass(team);
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
        let a = |force: &[f64], x: f64, i: usize| {
            force[i] * scheme.w[i] - scheme.kappa[i] * (x - scheme.rest[i])
        };
        let both = |i: usize| {
            a(&self.elastic, self.x[i], i) * a(&self.elastic_before, self.x[i] - self.d[i], i)
        };
        let pull: f64 = (0..mesh.n_mat()).map(|i| mesh.m[i] * both(i)).sum();
        mesh.staggered(&self.x, &self.d, true) - pull / 24.0
    }
}
