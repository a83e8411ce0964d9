//! Linear springs of a slow body: the exact flow of its masses over R frames.

use std::f64::consts::PI;
use std::sync::Arc;

use nalgebra::DMatrix;

use super::{Solution, moving_mats, resolves_phase};
use crate::assembly::constants::{FLOW_MASSES_MAX, LOOSE_STIFFNESS_RATIO};
use crate::assembly::wiring::WiredBody;
use crate::integrate::flow::{Flow, frame_map};
use crate::integrate::square::SquareMatrix;
use crate::island::slow::{BlockFlow, BodyInterface, Slow, SpringMethod, Weights, best_block_length};
use crate::maths;
use crate::network::Subset;
use crate::scheme::Scheme;
use crate::units::Rate;

/// A body of linear springs, or why it has no flow; `is_struck`: whether a MAT of the island may be struck.
pub(super) fn slow_body_of_springs(
    rate: Rate,
    (part, macrostep): (usize, u32),
    body: &WiredBody,
    subset: Subset,
    is_struck: impl Fn(usize) -> bool,
) -> Result<Slow, String> {
    let mass_count = body.mats.len();
    if mass_count > FLOW_MASSES_MAX {
        return Err(format!(
            "{mass_count} of its masses are connected; above {FLOW_MASSES_MAX}, a slow rate costs more than the audio rate"
        ));
    }
    let is_discrete = subset.network.parts()[part].ca_rate.is_some();
    let scheme = if is_discrete {
        Scheme::new(&subset.network, rate)
    } else {
        Scheme::physical(&subset.network, rate)
    };
    let scheme = scheme.map_err(|error| error.to_string())?;
    let matrices = Matrices::new(&subset, &scheme, body);
    let eigenmodes = matrices.eigenmodes();
    let lambda_max = eigenmodes
        .eigenvalues
        .iter()
        .fold(0.0_f64, |lambda_max, x| lambda_max.max(*x));
    let angle_max = if is_discrete {
        2.0 * maths::asin((0.5 * lambda_max.sqrt()).min(1.0))
    } else {
        lambda_max.sqrt()
    };
    let rate_error = || {
        let mode_hertz = angle_max * rate.hertz() / (2.0 * PI);
        format!("its highest mode is at {mode_hertz:.0} Hz, too high for the audio rate")
    };
    if !resolves_phase(angle_max) {
        return Err(rate_error());
    }
    let frame_matrix = frame_map(&matrices.stiffness, &matrices.viscosity, is_discrete);
    let frame_flow = Flow::new(&frame_matrix).ok_or_else(rate_error)?;
    let solution = Solution {
        kick_phase: angle_max,
        kick_interval: 1,
        rest_positions: matrices.equilibrium(&eigenmodes.eigenvalues, &eigenmodes.eigenvectors),
        moving_mats: matrices.moving_mats,
        inverse_masses: matrices.inverse_masses.clone(),
        is_discrete,
    };
    let springs = |ports: &[(usize, usize)], outputs: &[Weights]| {
        let deficit_at =
            |local: usize| frame_flow.push_deficit(local, &state_after_strike(&frame_matrix, local, is_discrete));
        let ports = ports.iter();
        let ports = ports.map(|&(local, mat)| (local, is_struck(mat).then(|| deficit_at(local))));
        let interface = BodyInterface {
            inverse_masses: &matrices.inverse_masses,
            ports: ports.collect(),
            outputs: outputs.to_vec(),
        };
        let n_frames = best_block_length(mass_count, interface.ports.len());
        SpringMethod::Exact(Arc::new(BlockFlow::new(frame_flow.clone(), interface, n_frames)))
    };
    let slow_body = solution.into_slow_body(rate, (part, macrostep), body, subset, springs)?;
    Ok(slow_body)
}

/// Positions and velocities one frame after a push by a metre a frame: in a CA network only the pushed mass has moved;
/// continuous motion follows the flow of a frame.
fn state_after_strike(frame_matrix: &SquareMatrix, port: usize, is_discrete: bool) -> Vec<f64> {
    let mass_count = frame_matrix.n / 2;
    let mut state = vec![0.0; 2 * mass_count];
    state[mass_count + port] = 1.0;
    if is_discrete {
        state[port] = 1.0;
        return state;
    }
    frame_matrix.times_vector(&state)
}

/// Springs and dampers of the body as matrices, in units of a frame.
struct Matrices {
    /// MATs that move, by their index in the subset.
    moving_mats: Vec<usize>,
    inverse_masses: Vec<f64>,
    /// M⁻¹K and M⁻¹Z   (n, n)
    stiffness: SquareMatrix,
    viscosity: SquareMatrix,
    /// Force where all are at 0 [N]   (n)
    force_at_origin: Vec<f64>,
}

impl Matrices {
    fn new(subset: &Subset, scheme: &Scheme, body: &WiredBody) -> Self {
        let mats = subset.network.mats();
        let moving_mats = moving_mats(body, subset);
        let mass_count = moving_mats.len();
        let slot_of_mat = |mat: usize| moving_mats.binary_search(&mat).ok();
        let inverse_masses: Vec<f64> = moving_mats.iter().map(|&i| scheme.w[i]).collect();
        let (mut stiffness, mut viscosity, mut force_at_origin) = (
            SquareMatrix::zero(mass_count),
            SquareMatrix::zero(mass_count),
            vec![0.0; mass_count],
        );
        for (local, &i) in moving_mats.iter().enumerate() {
            *stiffness.entry_mut(local, local) += scheme.kappa[i];
            *viscosity.entry_mut(local, local) += scheme.zeta[i];
            force_at_origin[local] += scheme.kappa[i] / inverse_masses[local] * scheme.rest[i];
        }
        for run in &scheme.runs {
            for i in 0..run.len {
                let end_pairs = [(run.a + i, run.b + i, 1.0), (run.b + i, run.a + i, -1.0)];
                for (mat, neighbour, sign) in end_pairs {
                    let Some(row) = slot_of_mat(mat) else {
                        continue;
                    };
                    *stiffness.entry_mut(row, row) += inverse_masses[row] * run.k;
                    *viscosity.entry_mut(row, row) += inverse_masses[row] * run.z;
                    force_at_origin[row] -= sign * run.k * run.rest;
                    match slot_of_mat(neighbour) {
                        Some(column) => {
                            *stiffness.entry_mut(row, column) -= inverse_masses[row] * run.k;
                            *viscosity.entry_mut(row, column) -= inverse_masses[row] * run.z;
                        }
                        None => force_at_origin[row] += run.k * mats.x0[neighbour],
                    }
                }
            }
        }
        Self {
            moving_mats,
            inverse_masses,
            stiffness,
            viscosity,
            force_at_origin,
        }
    }

    /// Modes of M^-½ K M^-½.
    fn eigenmodes(&self) -> nalgebra::SymmetricEigen<f64, nalgebra::Dyn> {
        let mass_count = self.inverse_masses.len();
        let inverse_roots: Vec<f64> = self.inverse_masses.iter().map(|w| w.sqrt()).collect();
        let scaled_entry =
            |row: usize, column: usize| self.stiffness.value(row, column) * inverse_roots[column] / inverse_roots[row];
        // Rounding makes the matrix slightly unsymmetric.
        let mean_entry = |row, column| 0.5 * (scaled_entry(row, column) + scaled_entry(column, row));
        DMatrix::from_fn(mass_count, mass_count, mean_entry).symmetric_eigen()
    }

    /// The equilibrium of the springs: K·x = force, and x = 0 along modes that nothing holds.
    fn equilibrium(&self, eigenvalues: &nalgebra::DVector<f64>, eigenvectors: &DMatrix<f64>) -> Vec<f64> {
        let mass_count = self.inverse_masses.len();
        let mut rest_position = vec![0.0; mass_count];
        if self.force_at_origin.iter().all(|force| *force == 0.0) {
            return rest_position;
        }
        let inverse_roots: Vec<f64> = self.inverse_masses.iter().map(|w| w.sqrt()).collect();
        let lambda_max = eigenvalues.iter().fold(0.0_f64, |lambda_max, x| lambda_max.max(*x));
        for (mode, &eigenvalue) in eigenvalues
            .iter()
            .enumerate()
            .filter(|(_, eigenvalue)| **eigenvalue > LOOSE_STIFFNESS_RATIO * lambda_max)
        {
            let mode_force: f64 = (0..mass_count)
                .map(|i| eigenvectors[(i, mode)] * inverse_roots[i] * self.force_at_origin[i])
                .sum();
            for (i, rest_position) in rest_position.iter_mut().enumerate() {
                *rest_position += eigenvectors[(i, mode)] * inverse_roots[i] * (mode_force / eigenvalue);
            }
        }
        rest_position
    }
}
