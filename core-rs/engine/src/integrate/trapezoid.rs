//! The trapezoidal rule for linear bodies: stable for any stiffness, conserves the energy exactly, lowers the pitch.
//!
//! With u = ½(V + V⁺): (M + ½Z + ¼K)·u = M·V + ½F(x), then x⁺ = x + u, V⁺ = 2u − V. The matrix is factorised once.
//! Without losses ½V'MV + ½x'Kx is constant to rounding; dampers take u'Zu of it per step.

use std::sync::Arc;

use super::Stepper;
use super::banded::{Factor, MOST};
use super::mesh::{Mesh, Scratch};
use super::order;
use crate::kernel::thread_team::ThreadTeam;
use crate::network::{Error, Network};

#[derive(Clone, Debug)]
pub(super) struct Trapezoid {
    mesh: Arc<Mesh>,
    factor: Arc<Factor>,
    /// The MAT at each row of the factor               (n_moving)
    mats: Arc<Vec<usize>>,
    /// Position [m] and velocity per step [m]         (n_mat)
    x: Vec<f64>,
    v: Vec<f64>,
    /// Elastic forces at x [N]                        (n_mat)
    force: Vec<f64>,
    /// Right side, then u                             (n_moving)
    u: Vec<f64>,
    scratch: Scratch,
}

crate::archive::state!(Trapezoid { x, v, force, u });

impl Trapezoid {
    pub(super) fn new(mesh: Arc<Mesh>, network: &Network) -> Result<Self, Error> {
        check_linear(&mesh, network)?;
        let (mats, factor) = factorise(&mesh, network)?;
        let (x, v) = (network.mats().x0.clone(), mesh.start(network));
        Ok(Self {
            force: vec![0.0; x.len()],
            u: vec![0.0; mats.len()],
            scratch: mesh.scratch(),
            factor: Arc::new(factor),
            mats: Arc::new(mats),
            x,
            v,
            mesh,
        })
    }
}

/// Refuses a link that is not linear.
pub(super) fn check_linear(mesh: &Mesh, network: &Network) -> Result<(), Error> {
    let hardening = mesh.springs.iter().find(|spring| spring.q != 0.0);
    let hardening = hardening.and_then(|spring| {
        let same = |run: &&crate::network::Run| (run.a, run.b) == (spring.a, spring.b);
        network.runs().iter().find(same)
    });
    let other = mesh.others.first().map(|run| run.first);
    match hardening.map(|run| run.first).or(other) {
        None => Ok(()),
        Some(link) => Err(Error::Refused {
            module: network.link_name(link),
            message: "the trapezoidal rule computes linear bodies only; choose another method"
                .to_owned(),
        }),
    }
}

/// M + ½Z + ¼K of the MATs that move, in an order with a narrow band, factorised.
fn factorise(mesh: &Mesh, network: &Network) -> Result<(Vec<usize>, Factor), Error> {
    let moving: Vec<usize> = (0..mesh.n_mat()).filter(|&i| mesh.m[i] > 0.0).collect();
    let mut slot = vec![usize::MAX; mesh.n_mat()];
    for (at, &mat) in moving.iter().enumerate() {
        slot[mat] = at;
    }
    // The two MATs of each link, and ½z + ¼k of the link. The `slot` of a MAT that does not move is `usize::MAX`.
    let links = || {
        mesh.springs.iter().flat_map(|run| {
            let stiff = 0.5 * run.z + 0.25 * run.k;
            (0..run.len).map(move |i| (run.a + i, run.b + i, stiff))
        })
    };
    let mut neighbours = vec![Vec::new(); moving.len()];
    for (a, b, _) in links() {
        let (a, b) = (slot[a], slot[b]);
        if a.max(b) != usize::MAX {
            neighbours[a].push(b);
            neighbours[b].push(a);
        }
    }
    for near in &mut neighbours {
        near.sort_unstable();
        near.dedup();
    }
    let order = order::reverse_cuthill_mckee(&neighbours);
    let mats: Vec<usize> = order.iter().map(|&at| moving[at]).collect();
    for (row, &mat) in mats.iter().enumerate() {
        slot[mat] = row;
    }
    let pairs = || links().map(|(a, b, stiff)| (slot[a], slot[b], stiff));
    let inner = pairs().filter(|(a, b, _)| *a.max(b) != usize::MAX);
    let band = inner.map(|(a, b, _)| a.abs_diff(b)).max().unwrap_or(0);
    if mats.len().saturating_mul(band + 1) > MOST {
        return Err(Error::Refused {
            module: network.mat_name(mats[0]),
            message:
                "the matrix of its mesh is too wide for the trapezoidal rule; choose another method"
                    .to_owned(),
        });
    }
    let mut columns = vec![0.0; mats.len() * (band + 1)];
    for (row, &mat) in mats.iter().enumerate() {
        let tie = 0.5 * mesh.scheme.zeta[mat] + 0.25 * mesh.scheme.kappa[mat];
        columns[row * (band + 1)] = mesh.m[mat] * (1.0 + tie);
    }
    for (a, b, stiff) in pairs() {
        for end in [a, b] {
            if end != usize::MAX {
                columns[end * (band + 1)] += stiff;
            }
        }
        if a.max(b) != usize::MAX {
            columns[a.min(b) * (band + 1) + a.abs_diff(b)] -= stiff;
        }
    }
    let factor = Factor::new(band, columns).ok_or_else(|| Error::Refused {
        module: network.mat_name(mats.first().copied().unwrap_or(0)),
        message: "its smallest and largest masses and stiffnesses differ too much for a solution in floating point"
            .to_owned(),
    })?;
    Ok((mats, factor))
}

impl Stepper for Trapezoid {
    fn step(&mut self, impulses: &[(usize, f64)], _team: &mut ThreadTeam<'_>) {
        let mesh = &*self.mesh;
        for &(mat, impulse) in impulses {
            self.v[mat] += mesh.jump(mat, impulse);
        }
        mesh.elastic(
            &self.x,
            &mut self.scratch,
            &mut self.force,
            &mut ThreadTeam::alone(),
        );
        let scheme = &mesh.scheme;
        for (u, &i) in self.u.iter_mut().zip(&*self.mats) {
            let tie = 0.5 * scheme.kappa[i] * (self.x[i] - scheme.rest[i]);
            *u = mesh.m[i] * (self.v[i] - tie) + 0.5 * self.force[i];
        }
        self.factor.solve(&mut self.u);
        for (u, &i) in self.u.iter().zip(&*self.mats) {
            self.x[i] += u;
            self.v[i] = 2.0 * u - self.v[i];
        }
    }

    fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    fn x(&self) -> &[f64] {
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

    fn settle(&mut self) {
        self.mesh
            .velocities_from_steps(&self.x, &mut self.v, &mut self.force);
    }

    fn velocities_mut(&mut self) -> &mut [f64] {
        &mut self.v
    }

    fn energy(&self) -> f64 {
        self.mesh.kinetic(&self.v) + self.mesh.stored(&self.x)
    }
}
