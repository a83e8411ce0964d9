//! Points that contacts touch: the free path of each in a frame, and its response to impulses.

use super::FineScript;
use super::basis::{Basis, POLYNOMIALS_MAX};
use crate::cell::{Cell, CellRatios};
use crate::island::bodies::RunningBody;
use crate::network::{MatKind, Network};
use crate::scheme::Scheme;
use crate::timeline::Timeline;
use crate::units::Rate;

/// Cost of a mode's response to an impulse, in products: it has an exponential and a sine.
pub(super) const RESPONSE_PRODUCTS: u64 = 200;

/// A point that contacts touch.
#[derive(Clone, Debug)]
pub(super) struct Joint {
    pub(super) mat: usize,
    /// The body that it is a port of, and which port.
    pub(super) port: Option<(usize, usize)>,
    /// For a MAT that is stepped: its free motion.
    pub(super) cell: Option<Cell>,
    /// The position where a CEL is at rest [m]. What has none rests where it is.
    pub(super) rest_position: Option<f64>,
    /// 1/M, κ and ζ of its cell, in this frame and in the next.
    pub(super) constants: [[f64; 3]; 2],
    /// Weights of its position now and at the next frame in its position at each instant   (n)
    pub(super) frame_weights: Vec<(f64, f64)>,
    /// Forces in this frame and in the next [N] that replace an impulse at each instant [N·s]   (n)
    pub(super) impulse_split: Vec<[f64; 2]>,
}

/// The fastest motion of the points: |λ| of e^(λs) [1/frame].
pub(super) fn fastest_rate(
    mats: &[usize],
    network: &Network,
    scheme: &Scheme,
    bodies: &[RunningBody],
    timeline: &Timeline,
) -> f64 {
    let frame_rate = timeline.rate;
    let mat_rate = |mat: usize| {
        let modal_bodies = bodies.iter().filter_map(RunningBody::modal);
        match modal_bodies
            .into_iter()
            .find(|body| body.ports().any(|port| port == mat))
        {
            Some(body) => body.pole_magnitude_max(),
            None => free_cell(mat, network, scheme).map_or(0.0, |cell| cell.pole_magnitude_max()),
        }
    };
    let timeline_glides = timeline.glides.iter();
    let gliding_rates = timeline_glides
        .filter(|glide| mats.contains(&glide.mat))
        .flat_map(|glide| glide.points.iter().filter_map(|&(_, ties)| ties))
        .map(|[k, z, m]| Cell::new(m, k, z).pole_magnitude_max());
    let all_rates = mats.iter().map(|&mat| mat_rate(mat)).chain(gliding_rates);
    all_rates.fold(0.0, f64::max) * frame_rate.step()
}

impl FineScript {
    /// Retune a stepped joint to the means of 1/M, κ and ζ of this frame and the next; the number of products that this
    /// takes, or `None` if they do not make a cell. Nothing is allocated.
    pub(super) fn retune(&mut self, joint: usize, constants: [[f64; 3]; 2]) -> Option<u64> {
        let n_joints = self.joints.len();
        let stepped_joint = &mut self.joints[joint];
        stepped_joint.constants = constants;
        let [constants_now, constants_next] = constants;
        let [w, kappa, zeta] = std::array::from_fn(|i| 0.5 * (constants_now[i] + constants_next[i]));
        let (rate, time_step) = (self.rate, self.rate.step());
        let mean_cell = Cell::from_ratios(time_step * time_step / w, CellRatios { kappa, zeta }, rate)?;
        stepped_joint.cell = Some(mean_cell);
        // Each of the two forces that replace an impulse acts on the mass of its own frame.
        let mass_ratios = [w / constants_now[0], w / constants_next[0]];
        let step_response = mean_cell.response(time_step);
        for ((instant_weights, split), &instant) in (stepped_joint
            .frame_weights
            .iter_mut()
            .zip(&mut stepped_joint.impulse_split))
        .zip(&self.basis.instants)
        {
            let (weights, split_forces) = mean_cell.within_step(instant, rate, step_response);
            *instant_weights = weights;
            *split = [split_forces[0] * mass_ratios[0], split_forces[1] * mass_ratios[1]];
        }
        let pair_index = joint * n_joints + joint;
        self.velocity_jumps[pair_index] = time_step * mean_cell.velocity_jump();
        let (n_instants, pair_responses) = (self.basis.n_polynomials() as u64, &mut self.path_responses[pair_index]);
        if mean_cell.has_impulse_response_factors(time_step) {
            fit_responses_by_factors(&self.basis, pair_responses, &mean_cell, time_step);
            return Some(8 * RESPONSE_PRODUCTS * n_instants + 6 * n_instants * n_instants);
        }
        fit_responses(&self.basis, pair_responses, &|time_between| {
            mean_cell.impulse_response_around(time_between * time_step)
        });
        Some(RESPONSE_PRODUCTS * n_instants * n_instants + 2 * n_instants * n_instants * n_instants)
    }
}

/// Write the coefficients of the response of a path at one instant to an impulse at another, which `response` gives by
/// the time between them [frames]   (n·n)
fn fit_responses(basis: &Basis, coefficients: &mut [f64], response: &dyn Fn(f64) -> f64) {
    for (row, from_instant) in coefficients.chunks_mut(basis.n_polynomials()).zip(&basis.instants) {
        for (value, to_instant) in row.iter_mut().zip(&basis.instants) {
            *value = response(to_instant - from_instant);
        }
    }
    basis.fit_pair_values(coefficients);
}

/// The same for a cell whose answer is a sum of two products of a function of each instant: fitted apart, they take n
/// sines instead of n², and products in proportion to n² instead of n³.
fn fit_responses_by_factors(basis: &Basis, coefficients: &mut [f64], cell: &Cell, step: f64) {
    let n_instants = basis.n_polynomials();
    let (mut factor_values, mut factor_fits) = ([[[0.0; POLYNOMIALS_MAX]; 2]; 2], [[[0.0; POLYNOMIALS_MAX]; 2]; 2]);
    for (m, instant) in basis.instants.iter().enumerate() {
        let factors = cell.impulse_response_factors((instant - 0.5) * step);
        for (term_values, term_factors) in factor_values.iter_mut().zip(factors) {
            for (point_values, factor) in term_values.iter_mut().zip(term_factors) {
                point_values[m] = factor;
            }
        }
    }
    for (point_values, coefficients) in factor_values.iter().flatten().zip(factor_fits.iter_mut().flatten()) {
        basis.fit(&point_values[..n_instants], &mut coefficients[..n_instants]);
    }
    let [later_factors, earlier_factors] = &factor_fits;
    for (l, row) in coefficients.chunks_mut(n_instants).enumerate() {
        for (k, value) in row.iter_mut().enumerate() {
            *value = later_factors[0][k] * earlier_factors[0][l] + later_factors[1][k] * earlier_factors[1][l];
        }
    }
}

fn free_cell(mat: usize, network: &Network, scheme: &Scheme) -> Option<Cell> {
    let mats = network.mats();
    match mats.kind[mat] {
        _ if scheme.w[mat] == 0.0 => None,
        MatKind::Cel => Some(Cell::new(mats.m[mat], mats.k[mat], mats.z[mat])),
        _ => Some(Cell::new(mats.m[mat], 0.0, 0.0)),
    }
}

pub(super) fn new_joint(
    mat: usize,
    is_imposed: bool,
    network: &Network,
    scheme: &Scheme,
    bodies: &[RunningBody],
    (basis, rate): (&Basis, Rate),
) -> Joint {
    let port = bodies.iter().enumerate().find_map(|(body_index, running_body)| {
        let port = running_body.modal()?.ports().position(|port| port == mat)?;
        Some((body_index, port))
    });
    let cell = free_cell(mat, network, scheme).filter(|_| port.is_none() && !is_imposed);
    let instants = basis.instants.iter();
    let frame_weights = match &cell {
        Some(cell) => instants
            .clone()
            .map(|&instant| cell.interpolation(instant, rate))
            .collect(),
        None => instants.clone().map(|&instant| (1.0 - instant, instant)).collect(),
    };
    let has_spring = cell.is_some() && network.mats().kind[mat] == MatKind::Cel;
    let split_impulse = |cell: &Cell| instants.map(|&instant| cell.split(1.0, instant, rate)).collect();
    Joint {
        mat,
        port,
        rest_position: has_spring.then(|| network.mats().rest[mat]),
        constants: [[scheme.w[mat], scheme.kappa[mat], scheme.zeta[mat]]; 2],
        frame_weights,
        impulse_split: cell.as_ref().map(split_impulse).unwrap_or_default(),
        cell,
    }
}

/// Response of each joint's path to an impulse at one of them: a row for each polynomial of the impulse's instant, (n,
/// n) [m/N·s], and the velocity at once [m/frame per N·s]. No rows if the impulse does not reach that joint within a
/// frame, or if both are on a crowded body.
pub(super) fn path_responses(
    from_joint: &Joint,
    joints: &[Joint],
    bodies: &[RunningBody],
    (basis, rate): (&Basis, Rate),
    is_crowded: impl Fn(usize) -> bool,
) -> Vec<(Vec<f64>, f64)> {
    let (n_instants, time_step) = (basis.n_polynomials(), rate.step());
    let modal_body = |body_index: usize| bodies[body_index].modal();
    let modal_responses = from_joint.port.and_then(|(body_index, port)| {
        if is_crowded(body_index) {
            return None;
        }
        // All ports of a body move by the same modes: the response of each to this port is computed once.
        let instants = basis.instants.iter();
        let time_spans: Vec<f64> = instants
            .flat_map(|from_instant| {
                basis
                    .instants
                    .iter()
                    .map(move |to_instant| (to_instant - from_instant) * time_step)
            })
            .collect();
        Some(modal_body(body_index)?.mode_responses(port, &time_spans))
    });
    let response_of = |to_joint: &Joint| match (from_joint.port, to_joint.port) {
        (Some((body_index, from_port)), Some((to_body, to_port))) if body_index == to_body => {
            let Some(modal) = modal_body(body_index) else {
                return (Vec::new(), 0.0);
            };
            let velocity_jump = time_step * modal.velocity_jump(from_port, to_port);
            let Some(modal_responses) = &modal_responses else {
                return (Vec::new(), velocity_jump);
            };
            let mut pair_response = vec![0.0; n_instants * n_instants];
            for (row, weight) in modal_responses
                .chunks(n_instants * n_instants)
                .zip(modal.response_weights(from_port, to_port))
            {
                for (value, response) in pair_response.iter_mut().zip(row) {
                    *value += weight * response;
                }
            }
            basis.fit_pair_values(&mut pair_response);
            (pair_response, velocity_jump)
        }
        (None, None) if from_joint.mat == to_joint.mat => match &from_joint.cell {
            Some(cell) => {
                let mut pair_response = vec![0.0; n_instants * n_instants];
                fit_responses(basis, &mut pair_response, &|time_between| {
                    cell.impulse_response_around(time_between * time_step)
                });
                (pair_response, time_step * cell.velocity_jump())
            }
            None => (Vec::new(), 0.0),
        },
        _ => (Vec::new(), 0.0),
    };
    joints.iter().map(response_of).collect()
}
