//! Undamped modes that damping couples: the eigenvalue problem of their state.

use super::{Complex, ComplexModes, Coordinates, Pole};
use crate::body_modes::constants::{COUPLED_MODES_MAX, COUPLING_ERROR_MAX, COUPLING_NONE, COUPLING_ROUNDING};
use crate::body_modes::linear::NoModes;
use crate::spectrum::{Eigensystem, general_eigensystem, inverse};

/// Sets of undamped modes that `damping` (n, n) couples, each in rising order.
pub(super) fn coupled_sets(damping: &[f64], n: usize) -> Vec<Vec<usize>> {
    let greatest_coupling = damping.iter().fold(0.0_f64, |greatest, x| greatest.max(x.abs()));
    let coupling_floor = (COUPLING_ROUNDING * greatest_coupling).max(COUPLING_NONE / n as f64);
    let (mut is_known, mut mode_blocks) = (vec![false; n], Vec::new());
    for first in 0..n {
        if is_known[first] {
            continue;
        }
        is_known[first] = true;
        let mut mode_block = vec![first];
        let mut next_index = 0;
        while next_index < mode_block.len() {
            let damping_row = &damping[mode_block[next_index] * n..(mode_block[next_index] + 1) * n];
            for (other, coupling) in damping_row.iter().enumerate() {
                if !is_known[other] && coupling.abs() > coupling_floor {
                    is_known[other] = true;
                    mode_block.push(other);
                }
            }
            next_index += 1;
        }
        mode_block.sort_unstable();
        mode_blocks.push(mode_block);
    }
    mode_blocks
}

/// The state of a block: p of the modes that a spring holds, then v of all.
struct State<'a> {
    block: &'a [usize],
    /// How many of them no spring holds; these come first.
    n_rigid: usize,
    omega: Vec<f64>,
}

impl State<'_> {
    fn len(&self) -> usize {
        self.n_held() + self.block.len()
    }

    fn n_held(&self) -> usize {
        self.block.len() - self.n_rigid
    }

    /// A of ẏ = A·y   (len, len)
    fn matrix(&self, damping: &[f64], n: usize) -> Vec<f64> {
        let (state_size, held_count) = (self.len(), self.n_held());
        let mut state_matrix = vec![0.0; state_size * state_size];
        for (i, &block_mode) in self.block.iter().enumerate() {
            for (j, &other_mode) in self.block.iter().enumerate() {
                state_matrix[(held_count + i) * state_size + held_count + j] = -damping[block_mode * n + other_mode];
            }
            if i >= self.n_rigid {
                let (position_row, velocity_row) = (i - self.n_rigid, held_count + i);
                state_matrix[position_row * state_size + velocity_row] = self.omega[i];
                state_matrix[velocity_row * state_size + position_row] = -self.omega[i];
            }
        }
        state_matrix
    }

    /// The sum Σ row·x over an eigenvector y; positions that no spring holds are integrals of their velocities.
    fn positions(&self, row: &[f64], y: &impl Fn(usize) -> Complex, s: Complex) -> Complex {
        let (mut held_sum, mut rigid_sum) = ([0.0; 2], [0.0; 2]);
        for (i, &mode) in self.block.iter().enumerate() {
            if i < self.n_rigid {
                rigid_sum = add_scaled(rigid_sum, row[mode], y(self.n_held() + i));
            } else {
                held_sum = add_scaled(held_sum, row[mode] / self.omega[i], y(i - self.n_rigid));
            }
        }
        if self.n_rigid == 0 {
            return held_sum;
        }
        add_scaled(held_sum, 1.0, divide(rigid_sum, s))
    }

    fn velocities(&self, row: &[f64], y: &impl Fn(usize) -> Complex) -> Complex {
        let block_modes = self.block.iter().enumerate();
        block_modes.fold([0.0; 2], |sum, (i, &mode)| {
            add_scaled(sum, row[mode], y(self.n_held() + i))
        })
    }
}

/// Add the modes of a block.
pub(super) fn add(
    modes: &mut ComplexModes,
    coordinates: &Coordinates,
    damping: &[f64],
    block: &[usize],
) -> Result<(), NoModes> {
    if block.len() > COUPLED_MODES_MAX {
        return Err(NoModes::TooLarge);
    }
    let n_rigid = block
        .iter()
        .filter(|&&block_mode| coordinates.lambda[block_mode] == 0.0)
        .count();
    let state = State {
        block,
        n_rigid,
        omega: block
            .iter()
            .map(|&block_mode| coordinates.lambda[block_mode].sqrt())
            .collect(),
    };
    let state_size = state.len();
    let state_matrix = state.matrix(damping, coordinates.lambda.len());
    let eigensystem = general_eigensystem(state_matrix.clone()).ok_or(NoModes::NotFinite)?;
    let vectors = columns(&eigensystem);
    let left_vectors = inverse(vectors.clone()).ok_or(NoModes::Inexact)?;
    if error(&state_matrix, &eigensystem, [&vectors, &left_vectors]) > COUPLING_ERROR_MAX {
        return Err(NoModes::Inexact);
    }
    // The state at t = 0 and the effect of an impulse, in the modes: through the inverse.
    let project = |row: usize, entry: &dyn Fn(usize) -> f64| -> f64 {
        let left_row = &left_vectors[row * state_size..(row + 1) * state_size];
        left_row.iter().enumerate().map(|(i, a)| a * entry(i)).sum()
    };
    let held_count = state.n_held();
    let initial_state = |row_index: usize| {
        if row_index < held_count {
            let block_mode = block[n_rigid + row_index];
            state.omega[n_rigid + row_index] * (coordinates.x0[block_mode] - coordinates.rest[block_mode])
        } else {
            coordinates.v0[block[row_index - held_count]]
        }
    };
    let impulse_state = |point: usize| {
        move |row_index: usize| {
            if row_index < held_count {
                0.0
            } else {
                coordinates.struck[point][block[row_index - held_count]]
            }
        }
    };
    // How far rigid modes have moved in total when everything else has died away.
    let n_points = coordinates.struck.len();
    let mut rigid_displacement = vec![vec![0.0; n_points + 1]; n_rigid];
    for (k, &(re, im)) in eigensystem.values.iter().enumerate() {
        if im < 0.0 {
            continue;
        }
        if re > COUPLING_ERROR_MAX {
            return Err(NoModes::Diverges);
        }
        let decay = (-re).max(0.0);
        let is_pole_pair = im > 0.0;
        let y = |row_index: usize| {
            let real_part = vectors[row_index * state_size + k];
            [
                real_part,
                if is_pole_pair {
                    -vectors[row_index * state_size + k + 1]
                } else {
                    0.0
                },
            ]
        };
        let projection = |entry: &dyn Fn(usize) -> f64| {
            [
                project(k, entry),
                if is_pole_pair { project(k + 1, entry) } else { 0.0 },
            ]
        };
        let eigenvalue = [re, im];
        let start_amplitude = projection(&initial_state);
        let excitation: Vec<Complex> = (0..n_points).map(|point| projection(&impulse_state(point))).collect();
        for (i, rigid_displacement) in rigid_displacement.iter_mut().enumerate() {
            let rigid_share = divide(y(held_count + i), eigenvalue);
            for (rigid_displacement, left_entry) in rigid_displacement
                .iter_mut()
                .zip(excitation.iter().chain([&start_amplitude]))
            {
                *rigid_displacement -= rigid_share[0] * left_entry[0] - rigid_share[1] * left_entry[1];
            }
        }
        let pole = if is_pole_pair {
            Pole::Pair { decay, omega: im }
        } else {
            Pole::Real { decay }
        };
        let output_shape = |output: usize| {
            let positions = state.positions(&coordinates.positions[output], &y, eigenvalue);
            add_scaled(positions, 1.0, state.velocities(&coordinates.velocities[output], &y))
        };
        modes.add((pole, start_amplitude), output_shape, |point| excitation[point]);
    }
    for (i, rigid_displacement) in rigid_displacement.iter().enumerate() {
        let block_mode = block[i];
        modes.add(
            (
                Pole::Real { decay: 0.0 },
                [coordinates.x0[block_mode] + rigid_displacement[n_points], 0.0],
            ),
            |output| [coordinates.positions[output][block_mode], 0.0],
            |point| [rigid_displacement[point], 0.0],
        );
    }
    Ok(())
}

/// Eigenvectors as the columns of a real matrix: for a pair, the real part and minus the imaginary part   (n, n). With
/// them y = V·(Re z, Im z).
fn columns(eigen: &Eigensystem) -> Vec<f64> {
    let state_size = eigen.values.len();
    let mut eigen_columns = vec![0.0; state_size * state_size];
    let mut first_column = 0;
    while first_column < state_size {
        let column_count = if eigen.values[first_column].1 == 0.0 { 1 } else { 2 };
        let column_pair = &eigen.vectors[first_column * state_size..(first_column + column_count) * state_size];
        let vector_norm = column_pair.iter().map(|x| x * x).sum::<f64>().sqrt();
        for (offset, x) in column_pair.iter().enumerate() {
            let (column, row) = (first_column + offset / state_size, offset % state_size);
            eigen_columns[row * state_size + column] = if column == first_column {
                x / vector_norm
            } else {
                -x / vector_norm
            };
        }
        first_column += column_count;
    }
    eigen_columns
}

/// ‖E‖, where A + E has exactly the computed eigenvalues and eigenvectors: E = (V·B − A·V)·V⁻¹.
fn error(matrix: &[f64], eigen: &Eigensystem, [vectors, left_vectors]: [&[f64]; 2]) -> f64 {
    let state_size = eigen.values.len();
    let mut residual = vec![0.0; state_size * state_size];
    for row in 0..state_size {
        let residual_row = &mut residual[row * state_size..(row + 1) * state_size];
        let vector_row = &vectors[row * state_size..(row + 1) * state_size];
        for (k, &(re, im)) in eigen.values.iter().enumerate() {
            // B turns (Re z, Im z): [re −im; im re].
            let pair_term = if im > 0.0 {
                vector_row[k + 1] * im
            } else if im < 0.0 {
                vector_row[k - 1] * im
            } else {
                0.0
            };
            residual_row[k] = vector_row[k] * re + pair_term;
        }
        multiply(
            &matrix[row * state_size..(row + 1) * state_size],
            vectors,
            -1.0,
            residual_row,
        );
    }
    let mut error_square = 0.0;
    let mut error_row = vec![0.0; state_size];
    for row in residual.chunks_exact(state_size) {
        error_row.fill(0.0);
        multiply(row, left_vectors, 1.0, &mut error_row);
        error_square += error_row.iter().map(|x| x * x).sum::<f64>();
    }
    error_square.sqrt()
}

/// into += factor·row·table.
fn multiply(row: &[f64], table: &[f64], factor: f64, target: &mut [f64]) {
    for (row_entry, table) in row.iter().zip(table.chunks_exact(target.len())) {
        if *row_entry != 0.0 {
            let row_entry = factor * row_entry;
            target.iter_mut().zip(table).for_each(|(sum, x)| *sum += row_entry * x);
        }
    }
}

fn add_scaled(sum: Complex, factor: f64, x: Complex) -> Complex {
    [sum[0] + factor * x[0], sum[1] + factor * x[1]]
}

fn divide(x: Complex, divisor: Complex) -> Complex {
    let squared_norm = divisor[0] * divisor[0] + divisor[1] * divisor[1];
    [
        (x[0] * divisor[0] + x[1] * divisor[1]) / squared_norm,
        (x[1] * divisor[0] - x[0] * divisor[1]) / squared_norm,
    ]
}
