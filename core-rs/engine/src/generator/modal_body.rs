//! MODES: masses at the places of a body whose modes are known, joined so that the body has these modes and levels.
//!
//! The motion at place p is Σ φ_kp·q_k, where the modes q have the mass M. An orthogonal change of coordinates turns
//! modes into masses: one at each place, the others inside. It exists if the places move independently of each other at
//! the first instant, as they do on a real body. A list of modes is finite, so short high modes are added to make this
//! true.

use super::{GeneratorError, check_count};
use crate::interrupt;
use crate::maths::sqrt;

/// Most modes of one body: each pair of masses has a link.
pub const MAX_MODAL: usize = 500;
/// Most places of one body.
pub const MAX_PLACES: usize = 64;
/// Fraction of a place's own mobility below which the remainder is rounding error.
const PIVOT_MIN: f64 = 1e-12;

/// Masses, and the stiffness and damping between them.
#[derive(Clone, Debug, PartialEq)]
pub struct ModalBody {
    /// Places first, then masses inside   (n,)
    pub masses: Vec<f64>,
    /// (n, n)
    pub stiffness: Vec<f64>,
    /// (n, n)
    pub damping: Vec<f64>,
}

/// The body whose modes have `poles` (ω² and ζ of a mass of 1, n_modes), `levels` (n_modes, n_places), and the modal
/// mass `mass` [kg] at a level of 1; `added_pole` is that of the modes that are added.
///
/// ```
/// use ergon_engine::generator::modal_body;
///
/// let body = modal_body(0.25, &[(4e4, 3.0)], &[vec![1.0]], (1e10, 9.0))?;
/// assert_eq!((body.masses, body.stiffness, body.damping), (vec![0.25], vec![1e4], vec![0.75]));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// No mode or too many, no place or too many, or a place that no mode moves.
pub fn modal_body(
    mass: f64,
    poles: &[(f64, f64)],
    levels: &[Vec<f64>],
    added_pole: (f64, f64),
) -> Result<ModalBody, GeneratorError> {
    check_count("The number of modes", poles.len(), 1, MAX_MODAL)?;
    let n_places = levels.first().map_or(0, Vec::len);
    check_count("The number of places", n_places, 1, MAX_PLACES)?;
    for place in 0..n_places {
        let level_sum: f64 = levels.iter().map(|row| row[place] * row[place]).sum();
        if !(level_sum > 0.0 && level_sum.is_finite()) {
            return Err(GeneratorError::Still { place });
        }
    }
    let added_levels = added(levels);
    let mut mode_shapes: Vec<Vec<f64>> = levels.to_vec();
    mode_shapes.extend(added_levels.iter().cloned());
    let mut poles = poles.to_vec();
    poles.resize(mode_shapes.len(), added_pole);
    let n_modes = mode_shapes.len();
    // Coordinates x = Hᵀ q, of which the first are those of the places.
    let mut place_basis: Vec<Vec<f64>> = (0..n_places)
        .map(|place| mode_shapes.iter().map(|row| row[place]).collect())
        .collect();
    let basis_norm: Vec<f64> = place_basis.iter().map(|row| sqrt(dot(row, row))).collect();
    let mut stiffness = diagonal(poles.iter().map(|pole| pole.0), n_modes);
    let mut damping = diagonal(poles.iter().map(|pole| pole.1), n_modes);
    for step in 0..n_places {
        interrupt::poll();
        let Some(householder) = householder_vector(&place_basis[step], step) else {
            continue;
        };
        for row in &mut place_basis[step..] {
            reflect(row, &householder);
        }
        reflect_both(&mut stiffness, &householder);
        reflect_both(&mut damping, &householder);
    }
    let inner_mass = mass / (basis_norm[0] * basis_norm[0]);
    let mut masses: Vec<f64> = basis_norm
        .iter()
        .map(|basis_norm| mass / (basis_norm * basis_norm))
        .collect();
    masses.resize(n_modes, inner_mass);
    let mass_roots: Vec<f64> = masses.iter().map(|mass| sqrt(*mass)).collect();
    for matrix in [&mut stiffness, &mut damping] {
        for (i, row) in matrix.chunks_exact_mut(n_modes).enumerate() {
            for (value, other) in row.iter_mut().zip(&mass_roots) {
                *value *= mass_roots[i] * other;
            }
        }
    }
    Ok(ModalBody {
        masses,
        stiffness,
        damping,
    })
}

/// Levels of additional modes, each at all places: with them, places move independently at the first instant.
///
/// With G = Σ φφᵀ of the known modes, they are the columns of L in E = L·Lᵀ, where G + E is diagonal. Each place gains
/// as much on the diagonal as it has in common with the others.
fn added(levels: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let n_places = levels.first().map_or(0, Vec::len);
    let level_product = |p: usize, q: usize| -> f64 { levels.iter().map(|row| row[p] * row[q]).sum() };
    let place_norm: Vec<f64> = (0..n_places).map(|p| sqrt(level_product(p, p))).collect();
    // In units of the mobility of each place.
    let mut remainder = vec![0.0; n_places * n_places];
    for p in 0..n_places {
        for q in (0..n_places).filter(|&q| q != p) {
            let shared_part = level_product(p, q) / (place_norm[p] * place_norm[q]);
            remainder[p * n_places + q] = -shared_part;
            remainder[p * n_places + p] += shared_part.abs();
        }
    }
    // Cholesky; pivots that are only rounding errors are skipped.
    let mut added_modes = Vec::new();
    for pivot_index in 0..n_places {
        let pivot_entry = remainder[pivot_index * n_places + pivot_index];
        if pivot_entry <= PIVOT_MIN {
            continue;
        }
        let pivot_root = sqrt(pivot_entry);
        let factor_column: Vec<f64> = (0..n_places)
            .map(|row| remainder[row * n_places + pivot_index] / pivot_root)
            .collect();
        for (row, a) in factor_column.iter().enumerate() {
            for (other, b) in factor_column.iter().enumerate() {
                remainder[row * n_places + other] -= a * b;
            }
        }
        for other_row in 0..n_places {
            remainder[pivot_index * n_places + other_row] = 0.0;
            remainder[other_row * n_places + pivot_index] = 0.0;
        }
        added_modes.push(
            factor_column
                .iter()
                .zip(&place_norm)
                .map(|(a, place_norm)| a * place_norm)
                .collect(),
        );
    }
    added_modes
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn diagonal(values: impl Iterator<Item = f64>, n: usize) -> Vec<f64> {
    let mut diagonal_matrix = vec![0.0; n * n];
    for (i, value) in values.enumerate() {
        diagonal_matrix[i * n + i] = value;
    }
    diagonal_matrix
}

/// v of the reflection 1 - v·vᵀ that takes `vector` to a positive multiple of axis `first` and leaves the axes before
/// it alone.
fn householder_vector(vector: &[f64], first: usize) -> Option<Vec<f64>> {
    let mut reflector: Vec<f64> = vector.to_vec();
    reflector[..first].fill(0.0);
    let tail_square = dot(&reflector[first + 1..], &reflector[first + 1..]);
    if tail_square == 0.0 && reflector[first] >= 0.0 {
        return None;
    }
    let tail_norm = sqrt(reflector[first] * reflector[first] + tail_square);
    // vector - |vector|·axis, without a difference of nearly equal numbers.
    reflector[first] = if reflector[first] > 0.0 {
        -tail_square / (reflector[first] + tail_norm)
    } else {
        reflector[first] - tail_norm
    };
    let reflector_scale = sqrt(2.0 / dot(&reflector, &reflector));
    reflector.iter_mut().for_each(|value| *value *= reflector_scale);
    Some(reflector)
}

fn reflect(vector: &mut [f64], mirror: &[f64]) {
    let projection = dot(vector, mirror);
    for (value, m) in vector.iter_mut().zip(mirror) {
        *value -= projection * m;
    }
}

/// H·A·H of a symmetric A, exactly symmetric.
fn reflect_both(matrix: &mut [f64], mirror: &[f64]) {
    let matrix_size = mirror.len();
    let mirror_image: Vec<f64> = matrix.chunks_exact(matrix_size).map(|row| dot(row, mirror)).collect();
    let half_projection = 0.5 * dot(&mirror_image, mirror);
    let correction: Vec<f64> = mirror_image
        .iter()
        .zip(mirror)
        .map(|(a, m)| a - half_projection * m)
        .collect();
    for i in 0..matrix_size {
        for j in i..matrix_size {
            let mirrored_entry = matrix[i * matrix_size + j] - mirror[i] * correction[j] - correction[i] * mirror[j];
            matrix[i * matrix_size + j] = mirrored_entry;
            matrix[j * matrix_size + i] = mirrored_entry;
        }
    }
}
