//! IEQ: the energy of each non-linear link is written ½ψ², and ψ is a state of the scheme (Ducceschi, Bilbao, Willemsen
//! & Serafin 2021).
//!
//! With s = x⁺ − x⁻ and g = dψ/de at the current frame, a link's force is g·(ψ + ¼g·s) and ψ⁺ = ψ + ½g·s. Each step
//! solves one symmetric positive definite linear system (M + ½Z + ¼BG²Bᵀ + βK)·s = r, whatever the law. Linear springs
//! are explicit (β = 0) as long as the rate allows it. Beyond that, β (Newmark 1959) makes just enough of them implicit
//! to keep the energy positive. This energy makes the scheme stable for any stiffness; its errors are those of CA.

mod links;
mod loops;

use std::sync::Arc;

use super::Stepper;
use super::conjugate::ConjugateGradients;
use super::mesh::Mesh;
use super::passes;
use crate::kernel::thread_team::ThreadTeam;
use crate::maths::wide::wide;
use crate::network::{Error, Network};
use links::{IeqLinks, LinkStates};

pub(super) use links::check_supported;

/// Largest λmax(M⁻¹K) at which all springs are explicit; the stability limit is 4.
const EXPLICIT_LAMBDA_MAX: f64 = 3.9;

#[derive(Clone, Debug)]
pub(super) struct Ieq {
    mesh: Arc<Mesh>,
    links: Arc<IeqLinks>,
    state: LinkStates,
    /// Position x [m], last step x − x⁻ [m], and x − x⁻⁻, the first guess of the next solution   (n_mat)
    x: Vec<f64>,
    d: Vec<f64>,
    s: Vec<f64>,
    /// The part of the system's diagonal that comes from each MAT alone, M·(1 + ½ζ + βκ); 0 for fixed points   (n_mat)
    mat_diagonal: Arc<Vec<f64>>,
    /// Right side, and 1 over the system's diagonal                                              (n_mat)
    right_side: Vec<f64>,
    inverse_diagonal: Vec<f64>,
    solver: ConjugateGradients,
    /// Forces of one run   (longest run)
    run_forces: Vec<f64>,
}

crate::archive::state!(Ieq {
    state,
    x,
    d,
    s,
    right_side,
    inverse_diagonal
});

impl Ieq {
    pub(super) fn new(mesh: Arc<Mesh>, network: &Network) -> Result<Self, Error> {
        check_supported(&mesh, network)?;
        let linear_lambda = links::linear_lambda_max(&mesh, network)?;
        let beta = if linear_lambda <= EXPLICIT_LAMBDA_MAX {
            0.0
        } else {
            0.25 * (1.0 - EXPLICIT_LAMBDA_MAX / linear_lambda)
        };
        let x = network.mats().x0.clone();
        let links = IeqLinks::new(&mesh, beta);
        let d = initial_step(&mesh, &links, network);
        let mesh_scheme = &mesh.scheme;
        let mat_diagonal = (0..x.len())
            .map(|i| mesh.scaled_masses[i] * (1.0 + 0.5 * mesh_scheme.zeta[i] + beta * mesh_scheme.kappa[i]))
            .collect();
        Ok(Self {
            state: links.initial_states(&mesh, &x, &d),
            s: d.iter().map(|d| 2.0 * d).collect(),
            mat_diagonal: Arc::new(mat_diagonal),
            right_side: vec![0.0; x.len()],
            inverse_diagonal: vec![0.0; x.len()],
            solver: ConjugateGradients::new(x.len()),
            run_forces: vec![0.0; links.longest_run()],
            links: Arc::new(links),
            x,
            d,
            mesh,
        })
    }
}

/// x(0) − x(−T) = V − ½A [m], with the acceleration A that the implicit system gives; of the method's own order
/// (n_mat)
fn initial_step(mesh: &Mesh, links: &IeqLinks, network: &Network) -> Vec<f64> {
    let (x, v) = (&network.mats().x0, mesh.initial_velocities(network));
    let (mesh_scheme, n_mats) = (&mesh.scheme, x.len());
    let mut force = vec![0.0; n_mats];
    mesh.set_total_forces([x, &v], &mut mesh.new_scratch(), &mut force, &mut ThreadTeam::alone());
    for (i, force) in force.iter_mut().enumerate() {
        let tie_pull = mesh_scheme.kappa[i] * (x[i] - mesh_scheme.rest[i]) + mesh_scheme.zeta[i] * v[i];
        *force -= mesh.scaled_masses[i] * tie_pull;
    }
    let mat_diagonal: Vec<f64> = (0..n_mats)
        .map(|i| mesh.scaled_masses[i] * (1.0 + links.beta * mesh_scheme.kappa[i]))
        .collect();
    let mut inverse_diagonal = mat_diagonal.clone();
    let elastic_terms = links.elastic_matrix(mesh, [x, &v], &mut inverse_diagonal);
    for (inverse, mat_diagonal) in inverse_diagonal.iter_mut().zip(&mat_diagonal) {
        *inverse = if *mat_diagonal > 0.0 { 1.0 / *inverse } else { 0.0 };
    }
    let (mut acceleration, mut scratch) = (vec![0.0; n_mats], vec![0.0; links.longest_run()]);
    let mut apply_system = |p: &[f64], y: &mut [f64]| {
        y.fill(0.0);
        passes::apply_stiffnesses(&links.runs, &elastic_terms, p, &mut scratch, y);
        diagonal_minus(&mat_diagonal, p, y);
    };
    ConjugateGradients::new(n_mats).solve(&mut apply_system, &inverse_diagonal, &force, &mut acceleration);
    v.iter()
        .zip(&acceleration)
        .map(|(v, acceleration)| v - 0.5 * acceleration)
        .collect()
}

impl Stepper for Ieq {
    fn step(&mut self, impulses: &[(usize, f64)], _team: &mut ThreadTeam<'_>) {
        let (mesh, links) = (&*self.mesh, &*self.links);
        // Add the links' explicit forces to `right_side` and their part of the diagonal to `inverse_diagonal`.
        self.right_side.fill(0.0);
        self.inverse_diagonal.copy_from_slice(&self.mat_diagonal);
        links.add_explicit_forces(
            mesh,
            [&self.x, &self.d],
            &mut self.state,
            &mut self.run_forces,
            [&mut self.right_side, &mut self.inverse_diagonal],
        );
        let mesh_ties = mesh.ties();
        for i in 0..self.x.len() {
            let tie_pull = mesh_ties.kappa[i] * ((self.x[i] - mesh_ties.rest[i]) - 2.0 * links.beta * self.d[i]);
            self.right_side[i] += mesh.scaled_masses[i] * (2.0 * self.d[i] - tie_pull);
            let is_moving = self.mat_diagonal[i] > 0.0;
            self.inverse_diagonal[i] = if is_moving { 1.0 / self.inverse_diagonal[i] } else { 0.0 };
        }
        for &(mat, impulse) in impulses {
            self.right_side[mat] += impulse * mesh.scheme.rate;
        }
        let (link_terms, mat_diagonal, link_forces) =
            (&self.state.matrix_terms, &*self.mat_diagonal, &mut self.run_forces);
        self.solver.solve(
            &mut |p, y| {
                y.fill(0.0);
                passes::apply_stiffnesses(&links.runs, link_terms, p, link_forces, y);
                diagonal_minus(mat_diagonal, p, y);
            },
            &self.inverse_diagonal,
            &self.right_side,
            &mut self.s,
        );
        links.advance_psi(&self.s, &mut self.state);
        for ((x, d), s) in self.x.iter_mut().zip(&mut self.d).zip(&self.s) {
            *d = s - *d;
            *x += *d;
        }
    }

    fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    fn positions(&self) -> &[f64] {
        &self.x
    }

    fn velocity(&self, mat: usize) -> f64 {
        let (x, d) = (|i: usize| self.x[i], |i: usize| self.d[i]);
        (self.d[mat] + 0.5 * self.mesh.acceleration(mat, &x, &d)) * self.mesh.scheme.rate
    }

    fn last_step(&self, mat: usize) -> f64 {
        self.d[mat]
    }

    fn set_motion(&mut self, mat: usize, x: f64, step: f64) {
        (self.x[mat], self.d[mat]) = (x, step);
    }

    fn update_after_motion(&mut self) {
        self.links
            .set_initial_states(&self.mesh, &self.x, &self.d, &mut self.state);
        for (s, d) in self.s.iter_mut().zip(&self.d) {
            *s = 2.0 * d;
        }
    }

    fn velocities_mut(&mut self) -> &mut [f64] {
        &mut self.d
    }

    /// Energy between the last frame and this one; conserved exactly if there are no losses.
    fn energy(&self) -> f64 {
        let (mesh, beta) = (&*self.mesh, self.links.beta);
        let position_before = |i: usize| self.x[i] - self.d[i];
        let shifted_step = |i: usize| self.d[i] + mesh.scheme.rest[i];
        let link_energy = self.links.energy(mesh, &self.x, &self.d, &self.state);
        mesh.kinetic_energy(&self.d)
            + mesh.ground_energy(&position_before, &|i| self.x[i])
            + beta * mesh.ground_energy(&shifted_step, &shifted_step)
            + link_energy
    }

    fn stored_energy(&self) -> f64 {
        let (psi_energy, law_energy) = self.links.nonlinear_energies(&self.mesh, &self.x, &self.d, &self.state);
        self.energy() - psi_energy + law_energy
    }
}

wide! {
    /// y = mat_diagonal·p − y.
    fn diagonal_minus(mat_diagonal: &[f64], p: &[f64], y: &mut [f64]) {
        let n = mat_diagonal.len();
        let (p, y) = (&p[..n], &mut y[..n]);
        for i in 0..n {
            y[i] = mat_diagonal[i] * p[i] - y[i];
        }
    }
}
