//! Undamped modes that damping couples: the eigenvalue problem of their state.

use super::{Complex, ComplexModes, Coordinates, Pole};
use crate::plan::constants::{COUPLED_MAX, COUPLING_ERROR_MAX, COUPLING_NONE, COUPLING_ROUNDING};
use crate::plan::passes::linear::NoModes;
use crate::spectrum::{General, general, inverse};

/// Sets of undamped modes that `damping` (n, n) couples, each in rising order.
pub(super) fn all(damping: &[f64], n: usize) -> Vec<Vec<usize>> {
    let greatest = damping
        .iter()
        .fold(0.0_f64, |greatest, x| greatest.max(x.abs()));
    let least = (COUPLING_ROUNDING * greatest).max(COUPLING_NONE / n as f64);
    let (mut is_known, mut blocks) = (vec![false; n], Vec::new());
    for first in 0..n {
        if is_known[first] {
            continue;
        }
        is_known[first] = true;
        let mut block = vec![first];
        let mut next = 0;
        while next < block.len() {
            let row = &damping[block[next] * n..(block[next] + 1) * n];
            for (other, coupling) in row.iter().enumerate() {
                if !is_known[other] && coupling.abs() > least {
                    is_known[other] = true;
                    block.push(other);
                }
            }
            next += 1;
        }
        block.sort_unstable();
        blocks.push(block);
    }
    blocks
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
        let (size, held) = (self.len(), self.n_held());
        let mut matrix = vec![0.0; size * size];
        for (i, &state_row) in self.block.iter().enumerate() {
            for (j, &other) in self.block.iter().enumerate() {
                matrix[(held + i) * size + held + j] = -damping[state_row * n + other];
            }
            if i >= self.n_rigid {
                let (p, v) = (i - self.n_rigid, held + i);
                matrix[p * size + v] = self.omega[i];
                matrix[v * size + p] = -self.omega[i];
            }
        }
        matrix
    }

    /// The sum Σ row·x over an eigenvector y; positions that no spring holds are integrals of their velocities.
    fn positions(&self, row: &[f64], y: &impl Fn(usize) -> Complex, s: Complex) -> Complex {
        let (mut held, mut rigid) = ([0.0; 2], [0.0; 2]);
        for (i, &mode) in self.block.iter().enumerate() {
            if i < self.n_rigid {
                rigid = add_scaled(rigid, row[mode], y(self.n_held() + i));
            } else {
                held = add_scaled(held, row[mode] / self.omega[i], y(i - self.n_rigid));
            }
        }
        if self.n_rigid == 0 {
            return held;
        }
        add_scaled(held, 1.0, divide(rigid, s))
    }

    fn velocities(&self, row: &[f64], y: &impl Fn(usize) -> Complex) -> Complex {
        let all = self.block.iter().enumerate();
        all.fold([0.0; 2], |sum, (i, &mode)| {
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
    if block.len() > COUPLED_MAX {
        return Err(NoModes::Large);
    }
    let n_rigid = block
        .iter()
        .filter(|&&mode| coordinates.lambda[mode] == 0.0)
        .count();
    let state = State {
        block,
        n_rigid,
        omega: block
            .iter()
            .map(|&mode| coordinates.lambda[mode].sqrt())
            .collect(),
    };
    let size = state.len();
    let matrix = state.matrix(damping, coordinates.lambda.len());
    let eigen = general(matrix.clone()).ok_or(NoModes::NotFinite)?;
    let vectors = columns(&eigen);
    let left = inverse(vectors.clone()).ok_or(NoModes::Inexact)?;
    if error(&matrix, &eigen, [&vectors, &left]) > COUPLING_ERROR_MAX {
        return Err(NoModes::Inexact);
    }
    // The state at t = 0 and the effect of an impulse, in the modes: through the inverse.
    let project = |row: usize, state: &dyn Fn(usize) -> f64| -> f64 {
        let left_row = &left[row * size..(row + 1) * size];
        left_row
            .iter()
            .enumerate()
            .map(|(i, by)| by * state(i))
            .sum()
    };
    let held = state.n_held();
    let initial_state = |row_index: usize| {
        if row_index < held {
            let mode = block[n_rigid + row_index];
            state.omega[n_rigid + row_index] * (coordinates.x0[mode] - coordinates.rest[mode])
        } else {
            coordinates.v0[block[row_index - held]]
        }
    };
    let impulse_state = |point: usize| {
        move |row_index: usize| {
            if row_index < held {
                0.0
            } else {
                coordinates.struck[point][block[row_index - held]]
            }
        }
    };
    // How far rigid modes have moved in total when everything else has died away.
    let n_points = coordinates.struck.len();
    let mut rigid_displacement = vec![vec![0.0; n_points + 1]; n_rigid];
    for (k, &(re, im)) in eigen.values.iter().enumerate() {
        if im < 0.0 {
            continue;
        }
        if re > COUPLING_ERROR_MAX {
            return Err(NoModes::Diverges);
        }
        let decay = (-re).max(0.0);
        let is_pair = im > 0.0;
        let y = |row_index: usize| {
            let left_row = vectors[row_index * size + k];
            [
                left_row,
                if is_pair {
                    -vectors[row_index * size + k + 1]
                } else {
                    0.0
                },
            ]
        };
        let part = |state: &dyn Fn(usize) -> f64| {
            [
                project(k, state),
                if is_pair { project(k + 1, state) } else { 0.0 },
            ]
        };
        let s = [re, im];
        let start = part(&initial_state);
        let excitation: Vec<Complex> = (0..n_points)
            .map(|point| part(&impulse_state(point)))
            .collect();
        for (i, rigid_displacement) in rigid_displacement.iter_mut().enumerate() {
            let share = divide(y(held + i), s);
            for (rigid_displacement, by) in rigid_displacement
                .iter_mut()
                .zip(excitation.iter().chain([&start]))
            {
                *rigid_displacement -= share[0] * by[0] - share[1] * by[1];
            }
        }
        let pole = if is_pair {
            Pole::Pair { decay, omega: im }
        } else {
            Pole::Real { decay }
        };
        let seen = |output: usize| {
            let positions = state.positions(&coordinates.positions[output], &y, s);
            add_scaled(
                positions,
                1.0,
                state.velocities(&coordinates.velocities[output], &y),
            )
        };
        modes.add((pole, start), seen, |point| excitation[point]);
    }
    for (i, rigid_displacement) in rigid_displacement.iter().enumerate() {
        let mode = block[i];
        modes.add(
            (
                Pole::Real { decay: 0.0 },
                [coordinates.x0[mode] + rigid_displacement[n_points], 0.0],
            ),
            |output| [coordinates.positions[output][mode], 0.0],
            |point| [rigid_displacement[point], 0.0],
        );
    }
    Ok(())
}

/// Eigenvectors as the columns of a real matrix: for a pair, the real part and minus the imaginary part   (n, n). With
/// them y = V·(Re z, Im z).
fn columns(eigen: &General) -> Vec<f64> {
    let n = eigen.values.len();
    let mut columns = vec![0.0; n * n];
    let mut k = 0;
    while k < n {
        let width = if eigen.values[k].1 == 0.0 { 1 } else { 2 };
        let column_pair = &eigen.vectors[k * n..(k + width) * n];
        let length = column_pair.iter().map(|x| x * x).sum::<f64>().sqrt();
        for (offset, x) in column_pair.iter().enumerate() {
            let (column, row) = (k + offset / n, offset % n);
            columns[row * n + column] = if column == k { x / length } else { -x / length };
        }
        k += width;
    }
    columns
}

/// ‖E‖, where A + E has exactly the computed eigenvalues and eigenvectors: E = (V·B − A·V)·V⁻¹.
fn error(matrix: &[f64], eigen: &General, [vectors, left]: [&[f64]; 2]) -> f64 {
    let n = eigen.values.len();
    let mut off = vec![0.0; n * n];
    for row in 0..n {
        let into = &mut off[row * n..(row + 1) * n];
        let row_vector = &vectors[row * n..(row + 1) * n];
        for (k, &(re, im)) in eigen.values.iter().enumerate() {
            // B turns (Re z, Im z): [re −im; im re].
            let other = if im > 0.0 {
                row_vector[k + 1] * im
            } else if im < 0.0 {
                row_vector[k - 1] * im
            } else {
                0.0
            };
            into[k] = row_vector[k] * re + other;
        }
        multiply(&matrix[row * n..(row + 1) * n], vectors, -1.0, into);
    }
    let mut square = 0.0;
    let mut row_of = vec![0.0; n];
    for row in off.chunks_exact(n) {
        row_of.fill(0.0);
        multiply(row, left, 1.0, &mut row_of);
        square += row_of.iter().map(|x| x * x).sum::<f64>();
    }
    square.sqrt()
}

/// into += factor·row·table.
fn multiply(row: &[f64], table: &[f64], factor: f64, into: &mut [f64]) {
    for (by, table) in row.iter().zip(table.chunks_exact(into.len())) {
        if *by != 0.0 {
            let by = factor * by;
            into.iter_mut()
                .zip(table)
                .for_each(|(sum, x)| *sum += by * x);
        }
    }
}

fn add_scaled(sum: Complex, by: f64, x: Complex) -> Complex {
    [sum[0] + by * x[0], sum[1] + by * x[1]]
}

fn divide(x: Complex, by: Complex) -> Complex {
    let square = by[0] * by[0] + by[1] * by[1];
    [
        (x[0] * by[0] + x[1] * by[1]) / square,
        (x[1] * by[0] - x[0] * by[1]) / square,
    ]
}
