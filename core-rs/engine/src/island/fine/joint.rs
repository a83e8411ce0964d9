//! Points that contacts touch: the free path of each in a frame, and its response to impulses.

use super::Script;
use super::basis::{Basis, POLYNOMIALS_MAX};
use crate::cell::{Cell, Ratios};
use crate::island::inside::RunningBody;
use crate::network::{MatKind, Network};
use crate::scheme::Scheme;
use crate::timeline::Timeline;
use crate::units::Rate;

/// Cost of a mode's response to an impulse, in products: it has an exponential and a sine.
pub(super) const RESPONSE: u64 = 200;

/// A point that contacts touch.
#[derive(Clone, Debug)]
pub(super) struct Joint {
    pub(super) mat: usize,
    /// The body that it is a port of, and which port.
    pub(super) port: Option<(usize, usize)>,
    /// For a MAT that is stepped: its free motion, and its rest position [m].
    pub(super) cell: Option<Cell>,
    pub(super) rest: f64,
    /// 1/M, κ and ζ of its cell, in this frame and in the next.
    pub(super) numbers: [[f64; 3]; 2],
    /// Weights of its position now and at the next frame in its position at each instant   (n)
    pub(super) frame_weights: Vec<(f64, f64)>,
    /// Forces in this frame and in the next [N] that replace an impulse at each instant [N·s]   (n)
    pub(super) split: Vec<[f64; 2]>,
}

/// The fastest motion of the points: |λ| of e^(λs) [1/frame].
pub(super) fn reach(
    mats: &[usize],
    network: &Network,
    scheme: &Scheme,
    bodies: &[RunningBody],
    timeline: &Timeline,
) -> f64 {
    let rate = timeline.rate;
    let reach_of = |mat: usize| {
        let body = bodies.iter().filter_map(RunningBody::modal);
        match body
            .into_iter()
            .find(|body| body.ports().any(|port| port == mat))
        {
            Some(body) => body.reach(),
            None => cell(mat, network, scheme).map_or(0.0, |cell| cell.reach()),
        }
    };
    let glides = timeline.glides.iter();
    let gliding = glides
        .filter(|glide| mats.contains(&glide.mat))
        .flat_map(|glide| glide.points.iter().filter_map(|&(_, ties)| ties))
        .map(|[k, z, m]| Cell::new(m, k, z).reach());
    let all = mats.iter().map(|&mat| reach_of(mat)).chain(gliding);
    all.fold(0.0, f64::max) * rate.step()
}

impl Script {
    /// Retune a stepped joint to the means of 1/M, κ and ζ of this frame and the next; the number of products that this
    /// takes, or `None` if they do not make a cell. Nothing is allocated.
    pub(super) fn retune(&mut self, joint: usize, numbers: [[f64; 3]; 2]) -> Option<u64> {
        let n_joints = self.joints.len();
        let joint_script = &mut self.joints[joint];
        joint_script.numbers = numbers;
        let [now, next] = numbers;
        let [w, kappa, zeta] = std::array::from_fn(|i| 0.5 * (now[i] + next[i]));
        let (rate, step) = (self.rate, self.rate.step());
        let cell = Cell::from_ratios(step * step / w, Ratios { kappa, zeta }, rate)?;
        joint_script.cell = Some(cell);
        // Each of the two forces that replace an impulse acts on the mass of its own frame.
        let masses = [w / now[0], w / next[0]];
        let step_response = cell.response(step);
        for ((path, split), &instant) in (joint_script
            .frame_weights
            .iter_mut()
            .zip(&mut joint_script.split))
        .zip(&self.basis.instants)
        {
            let (weights, forces) = cell.within_step(instant, rate, step_response);
            *path = weights;
            *split = [forces[0] * masses[0], forces[1] * masses[1]];
        }
        let pair = joint * n_joints + joint;
        self.jumps[pair] = step * cell.jump();
        let (n, moves) = (self.basis.n() as u64, &mut self.moves[pair]);
        if cell.has_answer_factors(step) {
            answers_by_factors(&self.basis, moves, &cell, step);
            return Some(8 * RESPONSE * n + 6 * n * n);
        }
        answers(&self.basis, moves, &|part| cell.answer_around(part * step));
        Some(RESPONSE * n * n + 2 * n * n * n)
    }
}

/// Write the coefficients of the response of a path at one instant to an impulse at another, which `answer` gives by
/// the time between them [frames]   (n·n)
fn answers(basis: &Basis, both: &mut [f64], answer: &dyn Fn(f64) -> f64) {
    for (row, from) in both.chunks_mut(basis.n()).zip(&basis.instants) {
        for (value, to) in row.iter_mut().zip(&basis.instants) {
            *value = answer(to - from);
        }
    }
    basis.fit_both(both);
}

/// The same for a cell whose answer is a sum of two products of a function of each instant: fitted apart, they take n
/// sines instead of n², and products in proportion to n² instead of n³.
fn answers_by_factors(basis: &Basis, both: &mut [f64], cell: &Cell, step: f64) {
    let n = basis.n();
    let (mut values, mut fitted) = (
        [[[0.0; POLYNOMIALS_MAX]; 2]; 2],
        [[[0.0; POLYNOMIALS_MAX]; 2]; 2],
    );
    for (m, instant) in basis.instants.iter().enumerate() {
        let factors = cell.answer_factors((instant - 0.5) * step);
        for (values, factors) in values.iter_mut().zip(factors) {
            for (values, factor) in values.iter_mut().zip(factors) {
                values[m] = factor;
            }
        }
    }
    for (values, fitted) in values.iter().flatten().zip(fitted.iter_mut().flatten()) {
        basis.fit(&values[..n], &mut fitted[..n]);
    }
    let [later, earlier] = &fitted;
    for (l, row) in both.chunks_mut(n).enumerate() {
        for (k, value) in row.iter_mut().enumerate() {
            *value = later[0][k] * earlier[0][l] + later[1][k] * earlier[1][l];
        }
    }
}

fn cell(mat: usize, network: &Network, scheme: &Scheme) -> Option<Cell> {
    let mats = network.mats();
    match mats.kind[mat] {
        _ if scheme.w[mat] == 0.0 => None,
        MatKind::Cel => Some(Cell::new(mats.m[mat], mats.k[mat], mats.z[mat])),
        _ => Some(Cell::new(mats.m[mat], 0.0, 0.0)),
    }
}

pub(super) fn joint(
    mat: usize,
    is_held: bool,
    network: &Network,
    scheme: &Scheme,
    bodies: &[RunningBody],
    (basis, rate): (&Basis, Rate),
) -> Joint {
    let port = bodies.iter().enumerate().find_map(|(owner, playing)| {
        let port = playing.modal()?.ports().position(|port| port == mat)?;
        Some((owner, port))
    });
    let cell = cell(mat, network, scheme).filter(|_| port.is_none() && !is_held);
    let instants = basis.instants.iter();
    let (path, rest) = match &cell {
        Some(cell) => (
            instants
                .clone()
                .map(|&at| cell.interpolation(at, rate))
                .collect(),
            network.mats().rest[mat],
        ),
        None => (instants.clone().map(|&at| (1.0 - at, at)).collect(), 0.0),
    };
    let split = |cell: &Cell| instants.map(|&at| cell.split(1.0, at, rate)).collect();
    Joint {
        mat,
        port,
        rest,
        numbers: [[scheme.w[mat], scheme.kappa[mat], scheme.zeta[mat]]; 2],
        frame_weights: path,
        split: cell.as_ref().map(split).unwrap_or_default(),
        cell,
    }
}

/// Response of each joint's path to an impulse at one of them: a row for each polynomial of the impulse's instant, (n,
/// n) [m/N·s], and the velocity at once [m/frame per N·s]. No rows if the impulse does not reach that joint within a
/// frame, or if both are on a crowded body.
pub(super) fn moves(
    from: &Joint,
    joints: &[Joint],
    bodies: &[RunningBody],
    (basis, rate): (&Basis, Rate),
    is_crowded: impl Fn(usize) -> bool,
) -> Vec<(Vec<f64>, f64)> {
    let (n, step) = (basis.n(), rate.step());
    let body = |owner: usize| bodies[owner].modal();
    let modal_responses = from.port.and_then(|(owner, port)| {
        if is_crowded(owner) {
            return None;
        }
        // All ports of a body move by the same modes: the response of each to this port is computed once.
        let instants = basis.instants.iter();
        let times: Vec<f64> = instants
            .flat_map(|from| basis.instants.iter().map(move |to| (to - from) * step))
            .collect();
        Some(body(owner)?.responses(port, &times))
    });
    let to = |to: &Joint| match (from.port, to.port) {
        (Some((owner, from)), Some((same, to))) if owner == same => {
            let Some(modal) = body(owner) else {
                return (Vec::new(), 0.0);
            };
            let jump = step * modal.jump(from, to);
            let Some(modal_responses) = &modal_responses else {
                return (Vec::new(), jump);
            };
            let mut both = vec![0.0; n * n];
            for (row, weight) in modal_responses.chunks(n * n).zip(modal.weights(from, to)) {
                for (value, answer) in both.iter_mut().zip(row) {
                    *value += weight * answer;
                }
            }
            basis.fit_both(&mut both);
            (both, jump)
        }
        (None, None) if from.mat == to.mat => match &from.cell {
            Some(cell) => {
                let mut both = vec![0.0; n * n];
                answers(basis, &mut both, &|part| cell.answer_around(part * step));
                (both, step * cell.jump())
            }
            None => (Vec::new(), 0.0),
        },
        _ => (Vec::new(), 0.0),
    };
    joints.iter().map(to).collect()
}
