//! Reference motions: known in closed form, or computed without code of the methods.

use nalgebra::{DMatrix, DVector};

use super::*;
use crate::network::{LinkKind, MatKind};

/// Motion of a linear network whose rest positions are all 0, by the matrix exponential.
pub(super) fn exactly(network: &Network, frames: usize, strikes: &[(usize, usize, f64)]) -> Vec<Vec<f64>> {
    let (mat_count, network_mats, time_step) = (network.n_mat(), network.mats(), rate().step());
    let mut state_matrix = DMatrix::zeros(2 * mat_count, 2 * mat_count);
    let is_moving = |i: usize| matches!(network_mats.kind[i], MatKind::Mas | MatKind::Cel);
    for i in (0..mat_count).filter(|&i| is_moving(i)) {
        state_matrix[(i, mat_count + i)] = 1.0;
        if network_mats.kind[i] == MatKind::Cel {
            state_matrix[(mat_count + i, i)] -= network_mats.k[i] / network_mats.m[i];
            state_matrix[(mat_count + i, mat_count + i)] -= network_mats.z[i] / network_mats.m[i];
        }
    }
    for run in network.runs() {
        for i in 0..run.len {
            for (to, from) in [(run.a + i, run.b + i), (run.b + i, run.a + i)] {
                if is_moving(to) {
                    for (first, c) in [(0, run.k), (mat_count, run.z)] {
                        state_matrix[(mat_count + to, first + to)] -= c / network_mats.m[to];
                        state_matrix[(mat_count + to, first + from)] += c / network_mats.m[to];
                    }
                }
            }
        }
    }
    let frame_map = (state_matrix * time_step).exp();
    let mut state_vector = DVector::zeros(2 * mat_count);
    for i in 0..mat_count {
        state_vector[i] = network_mats.x0[i];
        state_vector[mat_count + i] = network_mats.v0[i];
    }
    (0..frames)
        .map(|frame| {
            for strike in strikes.iter().filter(|strike| strike.0 == frame) {
                state_vector[mat_count + strike.1] += strike.2 / network_mats.m[strike.1];
            }
            state_vector = &frame_map * &state_vector;
            state_vector.rows(0, mat_count).iter().copied().collect()
        })
        .collect()
}

/// Classical Runge-Kutta in small steps, link by link: a reference that shares no code with the methods.
pub(super) fn finely(network: &Network, frames: usize, strikes: &[(usize, usize, f64)]) -> Vec<Vec<f64>> {
    const FINE: usize = 192;
    let (mat_count, network_mats) = (network.n_mat(), network.mats());
    let fine_step = rate().step() / FINE as f64;
    let state_slope = |state_vector: &[f64]| -> Vec<f64> {
        let mut state_slope = vec![0.0; 2 * mat_count];
        state_slope[..mat_count].copy_from_slice(&state_vector[mat_count..]);
        for run in network.runs() {
            let LinkKind::Lnl(link_law) = &run.kind else {
                panic!("a row of laws");
            };
            for i in 0..run.len {
                let (end_a, end_b) = (run.a + i, run.b + i);
                let link_force = link_law.force(
                    state_vector[end_b] - state_vector[end_a] - run.rest,
                    state_vector[mat_count + end_b] - state_vector[mat_count + end_a],
                );
                for (end, link_force) in [(end_a, link_force), (end_b, -link_force)] {
                    if network_mats.kind[end] == MatKind::Mas {
                        state_slope[mat_count + end] += link_force / network_mats.m[end];
                    }
                }
            }
        }
        state_slope
    };
    let mut state_vector: Vec<f64> = network_mats.x0.iter().chain(&network_mats.v0).copied().collect();
    let mut fine_path = Vec::new();
    for frame in 0..frames {
        for strike in strikes.iter().filter(|strike| strike.0 == frame) {
            state_vector[mat_count + strike.1] += strike.2 / network_mats.m[strike.1];
        }
        for _ in 0..FINE {
            let mut stage_slope = vec![0.0; 2 * mat_count];
            let mut slope_sum = vec![0.0; 2 * mat_count];
            for (ahead, weight) in [(0.0, 1.0), (0.5, 2.0), (0.5, 2.0), (1.0, 1.0)] {
                let position: Vec<f64> = state_vector
                    .iter()
                    .zip(&stage_slope)
                    .map(|(state_vector, stage_slope)| state_vector + ahead * fine_step * stage_slope)
                    .collect();
                stage_slope = state_slope(&position);
                slope_sum
                    .iter_mut()
                    .zip(&stage_slope)
                    .for_each(|(slope_sum, stage_slope)| *slope_sum += weight * stage_slope);
            }
            state_vector
                .iter_mut()
                .zip(&slope_sum)
                .for_each(|(state_vector, slope_sum)| *state_vector += fine_step / 6.0 * slope_sum);
        }
        fine_path.push(state_vector[..mat_count].to_vec());
    }
    fine_path
}

/// The same with other rest positions: they only shift the equilibrium.
pub(super) fn exactly_hung(network: &Network, frames: usize, strikes: &[(usize, usize, f64)]) -> Vec<Vec<f64>> {
    let (mat_count, network_mats) = (network.n_mat(), network.mats());
    // At equilibrium, K·x equals the forces of the rest positions.
    let mut stiffness = DMatrix::<f64>::zeros(mat_count, mat_count);
    let mut rest_pull = DVector::<f64>::zeros(mat_count);
    for i in 0..mat_count {
        match network_mats.kind[i] {
            MatKind::Cel => {
                stiffness[(i, i)] += network_mats.k[i];
                rest_pull[i] += network_mats.k[i] * network_mats.rest[i];
            }
            MatKind::Sol | MatKind::Imposed => stiffness[(i, i)] = 1e30,
            MatKind::Mas | MatKind::Proxy => {}
        }
    }
    for run in network.runs() {
        for i in 0..run.len {
            let (end_a, end_b) = (run.a + i, run.b + i);
            for (end, other, sign) in [(end_a, end_b, -1.0), (end_b, end_a, 1.0)] {
                stiffness[(end, end)] += run.k;
                stiffness[(end, other)] -= run.k;
                rest_pull[end] += sign * run.k * run.rest;
            }
        }
    }
    let equilibrium = stiffness.lu().solve(&rest_pull).expect("a place to hang");
    let mut shifted = network.clone();
    for i in 0..mat_count {
        shifted
            .set_initial_motion(i, network_mats.x0[i] - equilibrium[i], network_mats.v0[i])
            .expect("a start");
    }
    let mut hung_path = exactly(&shifted, frames, strikes);
    for x in hung_path
        .iter_mut()
        .flat_map(|frame| frame.iter_mut().zip(&equilibrium))
    {
        *x.0 += x.1;
    }
    hung_path
}
