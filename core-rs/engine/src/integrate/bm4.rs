//! BM4: kicks and drifts of order 4 with a small constant, SRKN6b (Blanes & Moan 2002).
//!
//! Six passes a step, the last kick's forces being the next first one's. Losses act in two half steps
//! outside: ties by e^(−ζ/2), so that a cell's decay is exact, links by the midpoint rule at fixed
//! positions. Pitches are then out by (γT)²/24 of themselves, γ the rate of their energy's decay: of
//! order 2, and 0.0001 cents at a T60 of a quarter of a second.

use std::sync::Arc;

use super::Method;
use super::mesh::{Mesh, Room};
use super::passes;
use crate::maths;
use crate::network::Network;

const A1: f64 = 0.245_298_957_184_271;
const A2: f64 = 0.604_872_665_711_080;
const A3: f64 = 0.5 - A1 - A2;
const B1: f64 = 0.082_984_406_417_405_2;
const B2: f64 = 0.396_309_801_498_368;
const B3: f64 = -0.039_056_304_922_348_6;
const B4: f64 = 1.0 - 2.0 * (B1 + B2 + B3);
/// A kick and the drift that follows it; a last kick of `B1` ends the step.
const STAGES: [[f64; 2]; 6] = [[B1, A1], [B2, A2], [B3, A3], [B4, A3], [B3, A2], [B2, A1]];
/// Largest ωT of a stable undamped mode.
pub(super) const LIMIT: f64 = 3.164;

#[derive(Clone, Debug)]
pub(super) struct Bm4 {
    mesh: Arc<Mesh>,
    /// e^(−ζ/2) of the ties; empty where none loses energy   (n_mat)
    decay: Vec<f64>,
    /// Position [m] and velocity per step [m]                (n_mat)
    x: Vec<f64>,
    v: Vec<f64>,
    /// Elastic forces at x [N]                               (n_mat)
    force: Vec<f64>,
    /// Viscous forces [N], and velocities on the way         (n_mat)
    viscous: Vec<f64>,
    midway: Vec<f64>,
    room: Room,
}

impl Bm4 {
    pub(super) fn new(mesh: Arc<Mesh>, network: &Network) -> Self {
        let (x, v) = (network.mats().x0.clone(), mesh.start(network));
        let (mut room, zeros) = (mesh.room(), vec![0.0; x.len()]);
        let mut force = zeros.clone();
        mesh.elastic(&x, &mut room, &mut force);
        let zeta = &mesh.scheme.zeta;
        let decay = if zeta.iter().any(|zeta| *zeta != 0.0) {
            zeta.iter().map(|zeta| maths::exp(-0.5 * zeta)).collect()
        } else {
            Vec::new()
        };
        Self {
            decay,
            x,
            v,
            force,
            viscous: zeros.clone(),
            midway: zeros,
            room,
            mesh,
        }
    }

    /// Half a step of the links' losses.
    fn lose(&mut self) {
        let mesh = &*self.mesh;
        if !mesh.damped {
            return;
        }
        let w = &mesh.scheme.w;
        mesh.viscous(&self.x, &self.v, &mut self.room, &mut self.viscous);
        passes::push(0.25, w, &self.viscous, &self.v, &mut self.midway);
        mesh.viscous(&self.x, &self.midway, &mut self.room, &mut self.viscous);
        passes::push_on(0.5, w, &self.viscous, &mut self.v);
    }
}

impl Method for Bm4 {
    fn step(&mut self, impulses: &[(usize, f64)]) {
        for &(mat, impulse) in impulses {
            self.v[mat] += self.mesh.jump(mat, impulse);
        }
        passes::scale(&self.decay, &mut self.v);
        self.lose();
        for stage in STAGES {
            let ties = self.mesh.ties();
            passes::kick_drift(stage, ties, &self.force, &mut self.x, &mut self.v);
            self.mesh.elastic(&self.x, &mut self.room, &mut self.force);
        }
        let ties = self.mesh.ties();
        passes::kick_drift([B1, 0.0], ties, &self.force, &mut self.x, &mut self.v);
        self.lose();
        passes::scale(&self.decay, &mut self.v);
    }

    fn x(&self) -> &[f64] {
        &self.x
    }

    fn velocity(&self, mat: usize) -> f64 {
        self.v[mat] * self.mesh.scheme.rate
    }

    fn energy(&self) -> f64 {
        self.mesh.kinetic(&self.v) + self.mesh.stored(&self.x)
    }
}
